"""Verdict of Definition 5: the probability that a body is a thing and not a piece of building.

Two passes of small decision trees over its features. The second knows what the first says of all other bodies: an edge that
a thing hides says nothing, and where much is building, what is in doubt is less likely a thing.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import features, forest, segmentation
from lidarcli.formalism.features import Features
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import Survey

SURE_ODDS = 3.5
"""Log-odds of the first pass that are certain: the second pass skips these bodies and only uses them for others."""
PRIOR_THINGS, PRIOR_BODIES = 2.0, 1.0
"""Numbers of things and of all bodies that are added to those of a sweep, as a prior for the share of things."""


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
    """Verdicts on the bodies of a sweep."""

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


def decide(verdict: Verdict, evidence: Features, points: Points, segments: Segments) -> None:
    """Decide the probability of each body to be a thing."""
    count = evidence.count
    for k in range(count):
        verdict.odds[k] = score(verdict.first, evidence, k)
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-verdict.odds[k]))
    total = PRIOR_THINGS
    for k in range(count):
        total += verdict.thing[k]
    for k in range(count):
        at = k * features.COUNT
        evidence.values[at + features.FIRST] = verdict.odds[k]
        evidence.values[at + features.OTHERS] = (total - verdict.thing[k]) / (count + PRIOR_BODIES)
        _look_beside(verdict, evidence, points, segments, k)
    for k in range(count):
        if abs(verdict.odds[k]) < SURE_ODDS:
            verdict.odds[k] = score(verdict.second, evidence, k)
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-verdict.odds[k]))


def score(trees: Trees, evidence: Features, k: int) -> float:
    """Return the log-odds of a body: the sum of one leaf of each tree."""
    total, at = trees.prior, k * features.COUNT
    for tree in range(trees.trees):
        n = trees.root[tree]
        while trees.feature[n] >= 0:
            n = n + 1 if evidence.values[at + trees.feature[n]] <= trees.bound[n] else trees.above[n]
        total += trees.bound[n]
    return total


def _look_beside(verdict: Verdict, evidence: Features, points: Points, segments: Segments, k: int) -> None:
    """Fill in the features of the bodies that hide the edges of a body, by the first pass."""
    values, at = evidence.values, k * features.COUNT
    head, tail = evidence.head[k], evidence.tail[k]
    free, by_wall, by_thing, some = features.FAR, 0.0, 0.0, False
    for end in range(2):
        edge = segments.end_edge[tail] if end else segments.start_edge[head]
        step = segments.s_end[tail] if end else -segments.s_start[head]
        if edge == segmentation.HIDDEN:
            j = (
                segmentation.following(segments, points, tail)
                if end
                else segmentation.preceding(segments, points, head)
            )
            other = evidence.body[j]
            share = verdict.thing[other] if other >= 0 else 0.0
            by_thing += share
            by_wall += 1.0 - share
            if share > 0.5:
                continue
        elif edge == segmentation.VIEW or edge == segmentation.FLICKERING:
            continue
        some = True
        if edge == segmentation.OWN or edge == segmentation.HIDDEN:
            free = min(free, max(features.NEARER, min(step, features.FAR)) if step == step else 0.0)
    # Where things hide both ends, or the view ends there, none says something.
    values[at + features.JUMP_FREE] = free if some else features.NEARER
    values[at + features.HIDDEN_BY_WALL], values[at + features.HIDDEN_BY_THING] = by_wall, by_thing


def choose(survey: Survey, segments: Segments, evidence: Features, verdict: Verdict) -> None:
    """Profile `robust`: mark the segments that are objects or fragments of some, and those that are building."""
    for j in range(segments.count):
        body = evidence.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True
