"""Verdict of Definition 5: the probability that decision trees give a body of being an object, by its features."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import features, forest
from lidarcli.formalism.features import Features
from lidarcli.formalism.segmentation import Segments
from lidarcli.formalism.surfaces import Survey
from lidarcli.system import native

COUNT = features.COUNT


class Trees:
    """Trees that ask three times if a feature is above a bound: node n of all, roots first, goes on with 2n or 2n + 1."""

    def __init__(self, trees: forest.Trees, prior: float) -> None:
        """`trees` as `forest` has them, `prior` the log-odds before any tree."""
        self.owner: list[Any] = []
        self.prior = prior
        self.trees = len(trees)
        self.feature = native.integers(self.owner, 8 * self.trees)
        self.bound = native.doubles(self.owner, 8 * self.trees)
        self.leaf = native.doubles(self.owner, 16 * self.trees)
        for number, (questions, leaves) in enumerate(trees):
            for n, (feature, bound, _) in enumerate(questions, 1):
                # Those of n's level in the trees before come first.
                node = (self.trees + number - 1 << n.bit_length() - 1) + n
                self.feature[node], self.bound[node] = feature, bound
            for n, value in enumerate(leaves):
                self.leaf[8 * (self.trees + number) + n] = value


TREES = Trees(forest.TREES, forest.PRIOR)


class Verdict:
    """Verdicts on the bodies of a sweep."""

    def __init__(self, most: int, least: float) -> None:
        """`most` is the greatest number of beams of a sweep, `least` the least probability of an object."""
        self.owner: list[Any] = []
        self.trees = TREES
        self.least = least
        self.asked = native.doubles(self.owner, COUNT)
        """Features of one body."""
        self.thing = native.doubles(self.owner, most)
        """Probability of each body."""


def decide(verdict: Verdict, evidence: Features) -> None:
    """Decide the probability of each body to be an object."""
    for k in range(evidence.count):
        for i in range(COUNT):
            verdict.asked[i] = evidence.values[k * COUNT + i]
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-score(verdict.trees, verdict.asked)))


def score(trees: Trees, values: Any) -> float:
    """Return the log-odds of a body by its features: the sum of one leaf of each tree."""
    feature, bound, leaf, total = trees.feature, trees.bound, trees.leaf, trees.prior
    for root in range(trees.trees, 2 * trees.trees):
        # Without branches, which would be guessed wrong.
        n = 2 * root + (values[feature[root]] > bound[root])
        n = 2 * n + (values[feature[n]] > bound[n])
        n = 2 * n + (values[feature[n]] > bound[n])
        total += leaf[n]
    return total


def choose(survey: Survey, segments: Segments, evidence: Features, verdict: Verdict) -> None:
    """Profile `robust`: mark the segments that are objects or fragments of some, and those that are building."""
    for j in range(segments.count):
        body = evidence.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True
