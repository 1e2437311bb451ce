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
    if width < 3 or not rows:
        return np.full(rows, NOISE_FLOOR)
    u = np.float32(1.0) / batch.ranges
    cosine = (2.0 * np.cos(batch.angle_increment)).astype(np.float32)[:, None]
    second = np.empty((rows, width), np.float32)
    # All sweeps in one go; where one ends and the next begins there is no second difference, or that over the seam.
    flat, out = u.reshape(-1), second.reshape(-1)
    out[0] = out[-1] = np.nan
    np.add(flat[:-2], flat[2:], out=out[1:-1])
    second -= cosine * u
    second[:, 0] = np.nan
    second[:, -1] = np.nan
    _close(second, u, cosine[:, 0], batch)
    u = batch.ranges * batch.ranges
    second *= u
    np.abs(second, out=second)
    second.sort(axis=1)  # NaN, where a beam has no range, sorts last
    # Every sweep has a NaN but a turn without loss, for which argmax finds none and says 0.
    count = np.isnan(second).argmax(axis=1)
    count[~np.isnan(second[:, -1])] = width
    median = second[np.arange(rows), np.maximum(count - 1, 0) // 2]
    sigma = np.where(count > 0, median, 0.0) * (MEDIAN_TO_SIGMA / SECOND_DIFFERENCE_GAIN)
    noise: Float64 = np.maximum(sigma, NOISE_FLOOR)
    return noise


def _close(second: Float32, u: Float32, cosine: Float32, batch: SweepBatch) -> None:
    """Fill in the two second differences over the seam of the sweeps that make a full turn."""
    rows = np.flatnonzero(batch.closure != Closure.OPEN)
    if not len(rows):
        return
    shared = batch.closure[rows] == Closure.SHARED
    cosine = cosine[rows]
    first = rows * batch.width
    last = first + batch.beams[rows] - 1
    repeated = last[shared]
    last = last - shared
    u, second = u.reshape(-1), second.reshape(-1)
    u_first, u_last = u[first], u[last]
    second[first] = u_last + u[first + 1] - cosine * u_first
    second[last] = u[last - 1] + u_first - cosine * u_last
    second[repeated] = np.nan
