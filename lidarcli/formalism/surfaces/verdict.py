"""Definition 5, decided: how likely a body is a thing and not a piece of building.

Two passes of small decision trees over its features. The second knows what the first says of all other bodies: an edge that
a thing hides says nothing, and where much is building, what is in doubt is less likely a thing.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Scans, Segments
from lidarcli.formalism.surfaces import appearance, building, forest, sightlines
from lidarcli.formalism.surfaces import features as clues
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.features import Features
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey

SURE = 3.5
"""Log-odds of the first pass that the second would not turn: it looks at the others alone."""
PRIOR_THINGS, PRIOR_BODIES = 2.0, 1.0
"""What is said of the other bodies of a sweep starts from so many things among so many more."""


class Trees:
    """Binary trees, node by node: each asks whether a feature is at most a bound, and a leaf has a value."""

    def __init__(self, trees: forest.Trees, prior: float) -> None:
        """
        Parameters
        ----------
        trees : as `forest` has them
        prior : log-odds before any tree
        """
        self.owner: list[Any] = []
        self.prior = prior
        self.trees = len(trees)
        nodes = sum(len(tree) for tree in trees)
        self.root = native.integers(self.owner, self.trees)
        self.feature = native.integers(self.owner, nodes)
        self.bound = native.doubles(self.owner, nodes)
        self.above = native.integers(self.owner, nodes)
        n = 0
        for number, tree in enumerate(trees):
            self.root[number] = root = n
            for feature, bound, above, _ in tree:
                self.feature[n], self.bound[n], self.above[n] = feature, bound, root + above
                n += 1


class Verdict:
    """What is decided on the bodies of a sweep."""

    def __init__(self, most: int, least: float) -> None:
        """
        Parameters
        ----------
        most : room for sweeps of so many beams
        least : least probability of a thing
        """
        self.owner: list[Any] = []
        self.first = Trees(forest.FIRST, forest.PRIOR[0])
        self.second = Trees(forest.SECOND, forest.PRIOR[1])
        self.least = least
        self.odds = native.doubles(self.owner, most)
        """Log-odds of each body."""
        self.thing = native.doubles(self.owner, most)
        """Probability of each body."""


def measure(
    features: Features,
    survey: Survey,
    points: Points,
    segments: Segments,
    faces: Faces,
    bodies: Bodies,
    scans: Scans,
) -> None:
    """Fill in the features of all bodies, but for those of the second pass."""
    if features.count == 0:
        return
    building.find_direction(features, faces)
    building.align(features, points, faces)
    for k in range(features.count):
        appearance.measure_edges(features, points, segments, bodies, k)
        appearance.measure_outline(features, survey, points, segments, bodies, k)
        building.measure_support(features, points, segments, faces, k)
        sightlines.measure_line(features, points, segments, faces, scans, k)
        sightlines.measure_back(features, points, segments, k)


def decide(verdict: Verdict, features: Features, points: Points, segments: Segments) -> None:
    """How likely each body is a thing."""
    count = features.count
    for k in range(count):
        verdict.odds[k] = score(verdict.first, features, k)
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-verdict.odds[k]))
    total = PRIOR_THINGS
    for k in range(count):
        total += verdict.thing[k]
    for k in range(count):
        at = k * clues.COUNT
        features.values[at + clues.FIRST] = verdict.odds[k]
        features.values[at + clues.OTHERS] = (total - verdict.thing[k]) / (count + PRIOR_BODIES)
        _look_beside(verdict, features, points, segments, k)
    for k in range(count):
        if abs(verdict.odds[k]) < SURE:
            verdict.odds[k] = score(verdict.second, features, k)
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-verdict.odds[k]))


def score(trees: Trees, features: Features, k: int) -> float:
    """Log-odds of a body: the sum of one leaf of each tree."""
    total, at = trees.prior, k * clues.COUNT
    for tree in range(trees.trees):
        n = trees.root[tree]
        while trees.feature[n] >= 0:
            n = n + 1 if features.values[at + trees.feature[n]] <= trees.bound[n] else trees.above[n]
        total += trees.bound[n]
    return total


def _look_beside(verdict: Verdict, features: Features, points: Points, segments: Segments, k: int) -> None:
    """What hides the edges of a body, by the first pass."""
    values, at = features.values, k * clues.COUNT
    head, tail = features.head[k], features.tail[k]
    free, by_wall, by_thing, some = clues.FAR, 0.0, 0.0, False
    for end in range(2):
        edge = segments.end_edge[tail] if end else segments.start_edge[head]
        step = segments.s_end[tail] if end else -segments.s_start[head]
        if edge == segmentation.HIDDEN:
            j = (
                segmentation.following(segments, points, tail)
                if end
                else segmentation.preceding(segments, points, head)
            )
            other = features.body[j]
            share = verdict.thing[other] if other >= 0 else 0.0
            by_thing += share
            by_wall += 1.0 - share
            if share > 0.5:
                continue
        elif edge == segmentation.VIEW or edge == segmentation.FLICKERING:
            continue
        some = True
        if edge == segmentation.OWN or edge == segmentation.HIDDEN:
            free = min(free, max(clues.NEARER, min(step, clues.FAR)) if step == step else 0.0)
    # Where things hide both ends, or the view ends there, none says something.
    values[at + clues.JUMP_FREE] = free if some else clues.NEARER
    values[at + clues.HIDDEN_BY_WALL], values[at + clues.HIDDEN_BY_THING] = by_wall, by_thing
