"""Grow small boosted trees, and write them as constants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import GradientBoostingClassifier

from benchmarks.thing.examples import Examples
from lidarcli.formalism.features import NAMES
from lidarcli.sweeps import Float64

Node = tuple[int, float, int, float]
"""Feature (-1: a leaf), its bound or the leaf's value, the node to go on with above it, the mean of the leaves below."""
Trees = tuple[tuple[Node, ...], ...]

RATE = 0.15
"""Share of what a tree has learnt that is kept; the next ones correct the rest."""
SAMPLE = 0.6
"""Share of the examples that each tree sees."""
LEAST = 60
"""Examples in a leaf."""
SECOND_PASS = ("first", "jump_free", "hidden_by_wall", "hidden_by_thing", "others")
"""Features that the first pass does not have."""
DIGITS = 4
"""Of the constants."""


def grow(
    examples: Examples, *, trees: int, leaves: int, without: tuple[str, ...] = (), seed: int = 0
) -> tuple[Trees, float]:
    """Trees for some examples, which do not ask for some features; and the log-odds before any tree."""
    columns = [k for k, name in enumerate(NAMES) if name not in without]
    model = GradientBoostingClassifier(
        n_estimators=trees,
        max_leaf_nodes=leaves,
        max_depth=None,
        learning_rate=RATE,
        subsample=SAMPLE,
        min_samples_leaf=LEAST,
        random_state=seed,
    )
    model.fit(examples.features[:, columns], examples.thing, sample_weight=examples.weight)
    share = float(np.average(examples.thing, weights=examples.weight))
    prior = round(float(np.log(share / (1.0 - share))), DIGITS)
    return tuple(_nodes(tree.tree_, columns) for tree in model.estimators_[:, 0]), prior


def _nodes(tree: Any, columns: list[int]) -> tuple[Node, ...]:
    """The nodes of one tree, each before those below it: first all at most at its bound, then those above."""
    nodes: list[Node] = []

    def add(n: int) -> None:
        at = len(nodes)
        value = round(RATE * float(tree.value[n, 0, 0]), DIGITS)
        if tree.children_left[n] < 0:
            nodes.append((-1, value, 0, value))
            return
        nodes.append((0, 0.0, 0, 0.0))
        add(int(tree.children_left[n]))
        feature = columns[int(tree.feature[n])]
        nodes[at] = (feature, float(f"{tree.threshold[n]:.{DIGITS}g}"), len(nodes), value)
        add(int(tree.children_right[n]))

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


def write(path: Path, first: Trees, second: Trees, prior: tuple[float, float]) -> None:
    """Write the module of constants."""
    lines = [HEAD, f"PRIOR = {prior!r}\n", '"""Log-odds before any tree, of both passes."""\n']
    for name, trees in (("FIRST", first), ("SECOND", second)):
        lines.append(f"{name}: Trees = (\n")
        for tree in trees:
            lines.append(f"    ({', '.join(repr(node) for node in tree)},),\n")
        lines.append(")\n")
    path.write_text("".join(lines), encoding="utf-8")
