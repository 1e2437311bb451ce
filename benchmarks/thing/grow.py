"""Grow small boosted trees, and write them as constants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from benchmarks.thing.examples import Examples
from lidarcli.sweeps import Float64

Node = tuple[int, float, int, float]
"""Feature (-1: a leaf), its bound or the leaf's value, the node to go on with above it, the mean of the leaves below."""
Trees = tuple[tuple[Node, ...], ...]

TREES, LEAVES = 80, 8
RATE = 0.15
"""Share of what a tree has learnt that is kept; the next ones correct the rest."""
SAMPLE = 0.5
"""Share of the features that each split may ask for."""
LEAST, PENALTY = 40, 5.0
"""Examples in a leaf; what draws the values of leaves towards 0."""
DIGITS = 4
"""Of the constants."""


def grow(examples: Examples, *, seed: int = 0) -> tuple[Trees, float]:
    """Trees for some examples, and the log-odds before any tree."""
    model = HistGradientBoostingClassifier(
        max_iter=TREES,
        max_leaf_nodes=LEAVES,
        learning_rate=RATE,
        max_features=SAMPLE,
        min_samples_leaf=LEAST,
        l2_regularization=PENALTY,
        early_stopping=False,
        random_state=seed,
    )
    model.fit(examples.features, examples.thing, sample_weight=examples.weight)
    prior = round(float(model._baseline_prediction[0, 0]), DIGITS)
    return tuple(_nodes(each.nodes) for (each,) in model._predictors), prior


def _nodes(grown: Any) -> tuple[Node, ...]:
    """The nodes of one tree, each before those below it: first all at most at its bound, then those above."""
    nodes: list[Node] = []

    def add(n: int) -> float:
        """Add a node and those below it; returns the mean of their leaves."""
        at, node = len(nodes), grown[n]
        if node["is_leaf"]:
            value = round(float(node["value"]), DIGITS)
            nodes.append((-1, value, 0, value))
            return value
        nodes.append((0, 0.0, 0, 0.0))
        low, high = int(node["left"]), int(node["right"])
        mean = add(low) * int(grown[low]["count"])
        above = len(nodes)
        mean = (mean + add(high) * int(grown[high]["count"])) / int(node["count"])
        bound = float(f"{node['num_threshold']:.{DIGITS}g}")
        nodes[at] = (int(node["feature_idx"]), bound, above, round(mean, DIGITS))
        return mean

    add(0)
    return tuple(nodes)


def odds(trees: Trees, prior: float, features: Float64) -> Float64:
    """(N,) log-odds by the trees, as the core has them."""
    total = np.full(len(features), prior)
    for tree in trees:
        at = np.zeros(len(features), np.int64)
        kind = np.array([node[0] for node in tree])
        bound = np.array([node[1] for node in tree])
        above = np.array([node[2] for node in tree])
        for _ in range(len(tree)):
            asks = kind[at] >= 0
            low = features[np.arange(len(features)), np.maximum(kind[at], 0)] <= bound[at]
            at = np.where(asks, np.where(low, at + 1, above[at]), at)
        total += bound[at]
    return total


HEAD = '''"""The trees that tell things from pieces of building. Written by `python -m benchmarks.thing`: do not edit.

A node is a feature (its place in `features.NAMES`; -1: a leaf), a bound (of a leaf: what it adds to the log-odds), the node
of the tree to go on with above the bound (at or below it the next one follows), and what its leaves add on average.
"""

from __future__ import annotations

Trees = tuple[tuple[tuple[int, float, int, float], ...], ...]

'''


def write(path: Path, trees: Trees, prior: float) -> None:
    """Write the module of constants."""
    lines = [HEAD, f"PRIOR = {prior!r}\n", '"""Log-odds before any tree."""\n', "TREES: Trees = (\n"]
    lines += [f"    ({', '.join(repr(node) for node in tree)},),\n" for tree in trees]
    path.write_text("".join([*lines, ")\n"]), encoding="utf-8")
