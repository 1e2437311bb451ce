"""Definition 6: the vertices of an object."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.ragged import spans
from lidarcli.formalism.runs import Runs
from lidarcli.sweeps import Bool, Float64, Int64


def literal(runs: Runs, d_th: Float64) -> tuple[Bool, Bool]:
    """Vertices as printed: where f' = 0 and where f' jumps.

    Between beams f is monotone, so f' = 0 shows as a difference s that changes its sign or becomes 0. f' jumps where
    two consecutive differences differ by more than d_th, the only threshold the paper has.

    Parameters
    ----------
    runs : R runs over M points
    d_th : (S,) threshold of each sweep [m]

    Returns
    -------
    extremum : (M,) inner points where f' = 0: local minima and maxima of r, and where a level stretch begins
    corner : (M,) inner points where f' jumps, and which are no extremum
    """
    r = runs.points.range(np.arange(len(runs.points)))
    extremum, corner = np.zeros(len(r), bool), np.zeros(len(r), bool)
    inner = inner_points(runs)
    before = r[inner] - r[inner - 1]
    after = r[inner + 1] - r[inner]
    extremum[inner] = (before != 0) & (before * after <= 0)
    corner[inner] = (np.abs(after - before) > d_th[runs.points.row(inner)]) & ~extremum[inner]
    return extremum, corner


def inner_points(runs: Runs) -> Int64:
    """Indices of the points of each run but its first and its last."""
    size = np.maximum(runs.size - 2, 0)
    index, _, _ = spans(runs.first + 1, size)
    return index
