"""Definition 3: the threshold d_th, literal and as a real sensor needs it; the noise of the ranges."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Gaps
from lidarcli.formalism.points import BLOCK, Points
from lidarcli.sweeps import Closure, Float32, Float64, SweepBatch

NOISE_FLOOR = 0.003
"""[m] No scanner is better than this; keeps a noise-free simulation from splitting on rounding."""
MEDIAN_TO_SIGMA = 1.0 / 0.6744897501960817
SECOND_DIFFERENCE_GAIN = np.sqrt(6.0)
"""Standard deviation of n₋ - 2 n + n₊ for independent n of standard deviation 1."""


ROUGHNESS = 0.08
"""[m] Depth steps below this are the texture of a surface: foliage, folds, mouldings."""
NOISE_GAIN = 3.5
"""A difference of two ranges exceeds this many of its standard deviations in 5 of 10,000 beams."""


def noise_threshold(sigma: Float64) -> Float64:
    """The least difference [m] that noise of standard deviation `sigma` [m] does not explain. Any shape."""
    threshold: Float64 = np.maximum(NOISE_GAIN * np.sqrt(2.0) * sigma, ROUGHNESS)
    return threshold


def mean_difference(points: Points, gap: Gaps, steepness: Float64) -> Float64:
    """Def. 3's d_th = (1/N) Σ |s(θ_n)|, the mean absolute difference of each sweep.

    Parameters
    ----------
    points : M points of S sweeps
    gap, steepness : of these points, as `difference.gaps` and `difference.steepness` give them

    Returns
    -------
    (S,) metres. N counts the differences that exist: those of neighbouring beams that both have a range. 0 where there
    is none.
    """
    seam = np.flatnonzero(gap.missing == 0)
    over = np.abs(points.range[points.begin[seam]] - points.range[gap.before[seam]])
    count = np.diff(points.start) - np.diff(points.stretches)
    count[points.row[seam]] += 1
    # Block by block, and the blocks in order: zeros at the end of a row then change no bit of its sum.
    blocks = steepness.reshape(-1, points.stride // BLOCK, BLOCK).sum(axis=2)
    total = np.zeros(len(count))
    for block in blocks.T:
        total += block
    total[points.row[seam]] += over
    mean: Float64 = total / np.maximum(count, 1)
    return mean


def noise(batch: SweepBatch) -> Float64:
    """Standard deviation σ of the ranges of each sweep, from the median of second differences.

    On a straight surface 1/r is a sinusoid of the bearing, so u₋ + u₊ - 2 cos Δθ u vanishes for u = 1/r whatever the
    incidence: what is left is noise. The median does not see the few triples that straddle an edge.

    Parameters
    ----------
    batch : SweepBatch of S sweeps

    Returns
    -------
    (S,) metres, at least `NOISE_FLOOR`.
    """
    rows, width = batch.ranges.shape
    second = np.full((rows, width), np.inf, np.float32)
    if width >= 3:
        u = np.float32(1.0) / batch.ranges
        cosine = (2.0 * np.cos(batch.angle_increment)).astype(np.float32)[:, None]
        second[:, 1:-1] = u[:, :-2] + u[:, 2:] - cosine * u[:, 1:-1]
        _close(second, u, cosine, batch)
        second *= batch.ranges * batch.ranges
        np.abs(second, out=second)
    second.sort(axis=1)  # NaN, where a beam has no range, sorts last
    count = np.count_nonzero(np.isfinite(second), axis=1)
    median = second[np.arange(rows), np.maximum(count - 1, 0) // 2] if width else np.zeros(rows)
    sigma = np.where(count > 0, median, 0.0) * (MEDIAN_TO_SIGMA / SECOND_DIFFERENCE_GAIN)
    noise: Float64 = np.maximum(sigma, NOISE_FLOOR)
    return noise


def _close(second: Float32, u: Float32, cosine: Float32, batch: SweepBatch) -> None:
    """Fill in the two second differences over the seam of the sweeps that make a full turn."""
    rows = np.flatnonzero(batch.closure != Closure.OPEN)
    last = batch.beams[rows] - 1 - (batch.closure[rows] == Closure.SHARED)
    second[rows, 0] = u[rows, last] + u[rows, 1] - cosine[rows, 0] * u[rows, 0]
    second[rows, last] = u[rows, last - 1] + u[rows, 0] - cosine[rows, 0] * u[rows, last]
    repeated = rows[batch.closure[rows] == Closure.SHARED]
    second[repeated, batch.beams[repeated] - 1] = np.nan
