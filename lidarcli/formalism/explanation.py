"""Why a body was taken for a thing or for a piece of building: what each kind of evidence adds to the log-odds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism import forest
from lidarcli.formalism.features import NAMES
from lidarcli.sweeps import Float64

KINDS = {
    "edges": ("jump_least", "jump_most", "hidden", "open", "view", "flicker"),
    "lines": ("aligned", "support", "support_near", "line", "unbroken", "cross_line"),
    "relief": ("backing", "line_behind", "depth_behind", "line_before", "before_back", "protrusion"),
    "size": ("width", "reach", "beams", "range"),
    "form": ("bulge_to", "bulge_away", "roughness", "grazing"),
    "sweep": ("walls", "noise"),
}
"""Kind of evidence → the features that give it, of the first look at a body."""
START, NEIGHBOURS = "start", "neighbours"
"""What is known before, and what the second look adds, which knows what all other bodies are."""
LEAST = 0.05
"""Less is not told."""


def contributions(features: Float64, thing: Float64) -> dict[str, Float64]:
    """What each kind of evidence adds to the log-odds of being a thing; together they are all.

    Parameters
    ----------
    features : (K, F) as `Detection.features` has them
    thing : (K,) the probabilities that were decided on
    """
    kind_of = {name: kind for kind, names in KINDS.items() for name in names}
    found = {kind: np.zeros(len(features)) for kind in (START, *KINDS, NEIGHBOURS)}
    found[START] += forest.PRIOR[0]
    every = np.arange(len(features))
    for tree in forest.FIRST:
        asked = np.array([node[0] for node in tree])
        bound = np.array([node[1] for node in tree])
        above = np.array([node[2] for node in tree])
        value = np.array([node[3] for node in tree])
        found[START] += value[0]
        at: NDArray[np.int64] = np.zeros(len(features), np.int64)
        while (asks := asked[at] >= 0).any():
            low = features[every, np.maximum(asked[at], 0)] <= bound[at]
            then = np.where(asks, np.where(low, at + 1, above[at]), at)
            for feature in np.unique(asked[at[asks]]).tolist():
                mine = asks & (asked[at] == feature)
                found[kind_of[NAMES[feature]]][mine] += (value[then] - value[at])[mine]
            at = then
    share = np.clip(thing, 1e-9, 1.0 - 1e-9)
    found[NEIGHBOURS] += np.log(share / (1.0 - share)) - sum(found.values())
    return found


def reasons(features: Float64, thing: Float64) -> list[str | None]:
    """(K,) the same in words, the weightiest first: `edges +2.1, lines -0.8`; None where nothing was decided."""
    told = contributions(features, thing)
    names = list(told)
    values = np.stack(list(told.values()), axis=1)
    lines: list[str | None] = []
    for row, known in zip(values, ~np.isnan(thing), strict=True):
        order = [k for k in np.argsort(-np.abs(row)).tolist() if abs(row[k]) >= LEAST]
        lines.append(", ".join(f"{names[k]} {row[k]:+.1f}" for k in order) if known else None)
    return lines
