"""Grow small boosted trees, and write them as constants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from benchmarks.thing.examples import Examples
from lidarcli.sweeps.types import Float64

Question = tuple[int, float, float]
"""Feature, bound, and what the leaves below it add on average."""
Trees = tuple[tuple[tuple[Question, ...], tuple[float, ...]], ...]
Grown = tuple[Trees, float]
"""Trees, and the log-odds before any tree."""

TREES, DEPTH = 64, 3
ASKED, LEAVES = 2**DEPTH - 1, 2**DEPTH
SEED = 1
"""Of the features that are drawn for each split."""
RATE = 0.18
"""Share of what a tree has learnt that is kept; the next ones correct the rest."""
SAMPLE = 0.5
"""Share of the features that each split may ask for."""
LEAST, PENALTY = 80, 5.0
"""Examples in a leaf; what draws the values of leaves towards 0."""
DIGITS = 4
"""Of the constants."""


def grow(examples: Examples) -> Grown:
    """Trees for some examples, and the log-odds before any tree."""
    model = HistGradientBoostingClassifier(
        max_iter=TREES,
        max_leaf_nodes=LEAVES,
        max_depth=DEPTH,
        learning_rate=RATE,
        max_features=SAMPLE,
        min_samples_leaf=LEAST,
        l2_regularization=PENALTY,
        early_stopping=False,
        random_state=SEED,
    )
    # The mean weight is 1, as `LEAST` and `PENALTY` want it.
    weight = examples.weight / examples.weight.mean()
    model.fit(examples.features, examples.thing, sample_weight=weight)
    prior = round(float(model._baseline_prediction[0, 0]), DIGITS)
    return tuple(_tree(each.nodes) for (each,) in model._predictors), prior


def _tree(grown: Any) -> tuple[tuple[Question, ...], tuple[float, ...]]:
    """Questions and leaves of one tree; a leaf that came early stands for all below it."""
    questions: list[Question] = [(0, 0.0, 0.0)] * ASKED
    leaves = [0.0] * LEAVES

    def fill(at: int, n: int) -> float:
        """Fill in what is below a node; returns the mean of its leaves."""
        node = grown[n]
        if at >= ASKED:
            leaves[at - ASKED] = value = round(float(node["value"]), DIGITS)
            return value
        if node["is_leaf"]:
            questions[at] = (0, 0.0, fill(2 * at + 1, n))
            return fill(2 * at + 2, n)
        low, high = int(node["left"]), int(node["right"])
        mean: float = fill(2 * at + 1, low) * int(grown[low]["count"])
        mean = (mean + fill(2 * at + 2, high) * int(grown[high]["count"])) / int(node["count"])
        bound = float(f"{node['num_threshold']:.{DIGITS}g}")
        questions[at] = (int(node["feature_idx"]), bound, round(mean, DIGITS))
        return mean

    fill(0, 0)
    return tuple(questions), tuple(leaves)


def odds(trees: Trees, prior: float, features: Float64) -> Float64:
    """(N,) log-odds by the trees, as the core has them."""
    total, every = np.full(len(features), prior), np.arange(len(features))
    for questions, leaves in trees:
        asked, bound, _ = (np.array(column) for column in zip(*questions, strict=True))
        at = np.zeros(len(features), np.int64)
        for _ in range(DEPTH):
            at = 2 * at + 1 + (features[every, asked[at]] > bound[at])
        total += np.array(leaves)[at - ASKED]
    return total


HEAD = '''"""The trees that tell things from pieces of building. Written by `python -m benchmarks.thing`: do not edit.

A tree is its questions and its leaves, as `verdict.Trees` goes through them. A question is a feature (its place in
`features.NAMES`), a bound, and what the leaves below it add on average; a leaf is what it adds to the log-odds.
"""

from __future__ import annotations

Trees = tuple[tuple[tuple[tuple[int, float, float], ...], tuple[float, ...]], ...]

'''


def write(path: Path, trees: Trees, prior: float) -> None:
    """Write the module of constants."""
    lines = [HEAD, f"PRIOR = {prior!r}\n", '"""Log-odds before any tree."""\n', "TREES: Trees = (\n"]
    lines += [f"    {tree!r},\n" for tree in trees]
    path.write_text("".join([*lines, ")\n"]), encoding="utf-8")
