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

ASKED, LEAVES = 7, 8
"""Questions and leaves of a tree."""


class Trees:
    """Complete binary trees: each question is whether a feature is above a bound; node n goes on with 2n + 1 or 2n + 2."""

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
        self.feature = native.integers(self.owner, ASKED * self.trees)
        self.bound = native.doubles(self.owner, ASKED * self.trees)
        self.leaf = native.doubles(self.owner, LEAVES * self.trees)
        for number, (questions, leaves) in enumerate(trees):
            for n, (feature, bound, _) in enumerate(questions):
                self.feature[ASKED * number + n], self.bound[ASKED * number + n] = feature, bound
            for n, value in enumerate(leaves):
                self.leaf[LEAVES * number + n] = value


TREES = Trees(forest.TREES, forest.PRIOR)


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
        self.trees = TREES
        self.least = least
        self.thing = native.doubles(self.owner, most)
        """Probability of each body."""


def decide(verdict: Verdict, evidence: Features) -> None:
    """Decide the probability of each body to be a thing."""
    for k in range(evidence.count):
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-score(verdict.trees, evidence, k)))


def score(trees: Trees, evidence: Features, k: int) -> float:
    """Return the log-odds of a body: the sum of one leaf of each tree."""
    feature, bound, leaf, values = trees.feature, trees.bound, trees.leaf, evidence.values
    total, begin, root = trees.prior, k * features.COUNT, 0
    for tree in range(trees.trees):
        # Without branches, which would be guessed wrong.
        n = root + 1 + (values[begin + feature[root]] > bound[root])
        n = 2 * n + 1 - root + (values[begin + feature[n]] > bound[n])
        n = 2 * n + 1 - root + (values[begin + feature[n]] > bound[n])
        total += leaf[n - ASKED + tree]
        root += ASKED
    return total


def choose(survey: Survey, segments: Segments, evidence: Features, verdict: Verdict) -> None:
    """Profile `robust`: mark the segments that are objects or fragments of some, and those that are building."""
    for j in range(segments.count):
        body = evidence.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True
