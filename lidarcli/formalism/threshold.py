"""Definition 3: the threshold d_th, literal and as a real sensor needs it; the noise of the ranges."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.points import Neighbours, Points
from lidarcli.sweeps import Float64

NOISE_FLOOR = 0.003
"""[m] No scanner is better than this; keeps a noise-free simulation from splitting on rounding."""
MEDIAN_TO_SIGMA = 1.0 / 0.6744897501960817
SECOND_DIFFERENCE_GAIN = np.sqrt(6.0)
"""Standard deviation of n₋ - 2 n + n₊ for independent n of standard deviation 1."""


NOISE_GAIN = 4.0
"""A difference of two ranges exceeds this many of its standard deviations in 6 of 100,000 beams."""


def noise_threshold(sigma: Float64) -> Float64:
    """The least difference [m] that noise of standard deviation `sigma` [m] does not explain. Any shape."""
    threshold: Float64 = NOISE_GAIN * np.sqrt(2.0) * sigma
    return threshold


def row_sum(values: Float64, start: np.ndarray) -> Float64:
    """(S,) sums of `values` (M,) over the rows `start[i]:start[i + 1]`; 0 for an empty row."""
    total = np.zeros(len(start) - 1)
    filled = np.flatnonzero(np.diff(start) > 0)
    if len(filled):
        total[filled] = np.add.reduceat(values, start[filled])
    return total


def mean_difference(s: Float64, missing: Float64, points: Points) -> Float64:
    """Def. 3's d_th = (1/N) Σ |s(θ_n)|, the mean absolute difference of each sweep.

    Parameters
    ----------
    s, missing : (M,), as `difference.predecessor_gap` gives them

    Returns
    -------
    (S,) metres. N counts the differences that exist: those of neighbouring beams that both have a range. 0 where there
    is none.
    """
    exists = missing == 0
    count = row_sum(exists.astype(np.float64), points.start)
    total = row_sum(np.where(exists, np.abs(s), 0.0), points.start)
    mean: Float64 = total / np.maximum(count, 1)
    return mean


def noise(points: Points, around: Neighbours) -> Float64:
    """Standard deviation σ of the ranges of each sweep, from the median of second differences.

    On a straight surface 1/r is a sinusoid of the bearing, so u₋ + u₊ - 2 cos Δθ u vanishes for u = 1/r whatever the
    incidence: what is left is noise. The median does not see the few triples that straddle an edge.

    Returns
    -------
    (S,) metres, at least `NOISE_FLOOR`.
    """
    u = 1.0 / around.range
    core = around.core
    triple = (
        around.inside[core - 1]
        & around.inside[core + 1]
        & (around.position[core + 1] - around.position[core - 1] == 2)
    )
    cosine = np.cos(points.geometry.step)[points.row]
    second = np.abs(u[core - 1] + u[core + 1] - 2.0 * cosine * u[core]) * points.range**2
    median = _row_median(second, triple, points)
    return np.maximum(median * (MEDIAN_TO_SIGMA / SECOND_DIFFERENCE_GAIN), NOISE_FLOOR)


def _row_median(values: Float64, use: np.ndarray, points: Points) -> Float64:
    """(S,) lower median of the used values of each row; 0 for a row without any."""
    rows = len(points.start) - 1
    row = points.row[use]
    count = np.bincount(row, minlength=rows)
    begin = np.cumsum(count) - count
    table = np.full((rows, max(int(count.max(initial=0)), 1)), np.inf, np.float32)
    table[row, np.arange(len(row)) - begin[row]] = values[use]
    table.sort(axis=1)
    median = table[np.arange(rows), np.maximum(count - 1, 0) // 2].astype(np.float64)
    return np.where(count > 0, median, 0.0)
