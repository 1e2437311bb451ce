"""Reasons for a verdict, thing or building: the part of each kind of evidence in the log-odds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism import forest
from lidarcli.formalism.features import NAMES
from lidarcli.sweeps import Float64

KINDS = {
    "edges": ("jump_least", "jump_most", "hidden", "open", "view", "flicker"),
    "lines": ("aligned", "support", "support_near", "line", "unbroken", "cross_line"),
    "relief": ("backing", "line_behind", "depth_behind", "line_before", "protrusion"),
    "size": ("width", "reach", "beams", "range"),
    "form": ("bulge_to", "bulge_away", "roughness", "grazing"),
    "sweep": ("walls", "noise"),
}
"""Kind of evidence → features that belong to it."""
START = "start"
"""Log-odds before any feature."""
PLACE, MAP = "place", "map"
"""Mean log-odds by all sweeps at that place, which take the place of this sweep's own, and what the map adds."""
LEAST = 0.05
"""Least log-odds that are shown."""


def contributions(features: Float64) -> dict[str, Float64]:
    """Return the part of each kind of evidence in the log-odds of being a thing; their sum is the whole.

    `features` is (K, F) as `Detection.features` has them.
    """
    kind_of = {name: kind for kind, names in KINDS.items() for name in names}
    found = {kind: np.zeros(len(features)) for kind in (START, *KINDS)}
    found[START] += forest.PRIOR
    every = np.arange(len(features))
    for questions, leaves in forest.TREES:
        asked, bound, value = (np.array(column) for column in zip(*questions, strict=True))
        value = np.append(value, leaves)
        found[START] += value[0]
        at: NDArray[np.int64] = np.zeros(len(features), np.int64)
        for _ in range(len(leaves).bit_length() - 1):
            then = 2 * at + 1 + (features[every, asked[at]] > bound[at])
            for feature in np.unique(asked[at]).tolist():
                mine = asked[at] == feature
                found[kind_of[NAMES[feature]]][mine] += (value[then] - value[at])[mine]
            at = then
    return found


def reasons(features: Float64, thing: Float64) -> list[str | None]:
    """Return (K,) the parts in words, the greatest first: `edges +2.1, lines -0.8`; None without a verdict."""
    told = contributions(features)
    names = list(told)
    values = np.stack(list(told.values()), axis=1)
    lines: list[str | None] = []
    for row, known in zip(values, ~np.isnan(thing), strict=True):
        order = [k for k in np.argsort(-np.abs(row)).tolist() if abs(row[k]) >= LEAST]
        lines.append(", ".join(f"{names[k]} {row[k]:+.1f}" for k in order) if known else None)
    return lines


def reasons_by_place(reasons: list[str | None], place: Float64, on_map: Float64) -> list[str | None]:
    """Return (K,) the parts of the place and of the map before those of the sweep: `place -0.7; this sweep: edges +2.1`.

    Parameters
    ----------
    reasons : (K,) as of `reasons`
    place, on_map : (K,) parts in the log-odds; NaN where the body has no place that is known
    """
    lines = []
    for sweep, here, line in zip(reasons, place.tolist(), on_map.tolist(), strict=True):
        parts = [f"{PLACE} {here:+.1f}"] + [f"{MAP} {line:+.1f}"] * (abs(line) >= LEAST)
        lines.append(sweep if sweep is None or here != here else f"{', '.join(parts)}; this sweep: {sweep}")
    return lines
