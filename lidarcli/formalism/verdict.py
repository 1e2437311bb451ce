"""Verdict of Definition 5: the probability that a body is a thing and not a piece of building.

Small decision trees ask for its features, and each adds to the log-odds of being a thing.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import features, forest
from lidarcli.formalism.features import Features
from lidarcli.formalism.segmentation import Segments
from lidarcli.formalism.surfaces import Survey


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
        self.trees = Trees(forest.TREES, forest.PRIOR)
        self.least = least
        self.thing = native.doubles(self.owner, most)
        """Probability of each body."""


def decide(verdict: Verdict, evidence: Features) -> None:
    """Decide the probability of each body to be a thing."""
    for k in range(evidence.count):
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-score(verdict.trees, evidence, k)))


def score(trees: Trees, evidence: Features, k: int) -> float:
    """Return the log-odds of a body: the sum of one leaf of each tree."""
    total, at = trees.prior, k * features.COUNT
    for tree in range(trees.trees):
        n = trees.root[tree]
        while trees.feature[n] >= 0:
            n = n + 1 if evidence.values[at + trees.feature[n]] <= trees.bound[n] else trees.above[n]
        total += trees.bound[n]
    return total


def choose(survey: Survey, segments: Segments, evidence: Features, verdict: Verdict) -> None:
    """Profile `robust`: mark the segments that are objects or fragments of some, and those that are building."""
    for j in range(segments.count):
        body = evidence.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True
