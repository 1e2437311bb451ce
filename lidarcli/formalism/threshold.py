"""Definition 3: the threshold d_th, literal and as a real sensor needs it; the noise of the ranges."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Gaps
from lidarcli.formalism.points import BLOCK, Points
from lidarcli.kernels import compiled
from lidarcli.sweeps import Closure, Float32, Float64, Int32, Int64, SweepBatch, UInt8

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
    return mean_size(
        points.range,
        steepness,
        points.stride,
        points.begin,
        points.stretches,
        points.start,
        gap.before,
        gap.missing,
    )


@compiled
def mean_size(
    cells: Float64,
    size: Float64,
    stride: int,
    begin: Int64,
    stretches: Int64,
    start: Int64,
    before: Int64,
    missing: Int64,
) -> Float64:
    """(S,) means of |s| [m].

    Parameters
    ----------
    cells, size : (S * stride,) range and |s| [m]
    begin, stretches, start : first cells of the stretches, and the stretches and points of the rows, as in `Points`
    before, missing : what lies before each stretch, as in `Gaps`
    """
    # Nothing is missing before the first stretch of a turn alone; any other would be one with the last.
    seam = np.flatnonzero(missing == 0)
    row = np.searchsorted(stretches, seam, side="right") - 1
    over = np.abs(cells[begin[seam]] - cells[before[seam]])
    count = np.diff(start) - np.diff(stretches)
    count[row] += 1
    # One block onto the other, then across: zeros at the end of a row change no bit of its sum.
    total = size.reshape(len(count), -1, BLOCK).sum(axis=1).sum(axis=1) if len(count) else np.zeros(0)
    total[row] += over
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
    cosine = (2.0 * np.cos(batch.angle_increment)).astype(np.float32)
    median = middle_second_difference(batch.ranges, cosine, batch.beams, batch.closure)
    sigma = median * (MEDIAN_TO_SIGMA / SECOND_DIFFERENCE_GAIN)
    noise: Float64 = np.maximum(sigma, NOISE_FLOOR)
    return noise


@compiled
def middle_second_difference(ranges: Float32, cosine: Float32, beams: Int32, closure: UInt8) -> Float32:
    """(S,) lower medians of r² |u₋ + u₊ - 2 cos Δθ u|, 0 where there is none.

    Parameters
    ----------
    ranges : (S, B) r [m]
    cosine : (S,) 2 cos Δθ
    beams, closure : (S,) number of beams, and how they close to a full turn
    """
    rows, width = ranges.shape
    if width < 3 or not rows:
        return np.zeros(rows, np.float32)
    u = np.float32(1.0) / ranges
    second = np.empty((rows, width), np.float32)
    # All sweeps in one go; where one ends and the next begins there is no second difference, or that over the seam.
    flat, out = u.reshape(-1), second.reshape(-1)
    out[0] = out[-1] = np.nan
    np.add(flat[:-2], flat[2:], out=out[1:-1])
    second -= cosine[:, None] * u
    second[:, 0] = np.nan
    second[:, -1] = np.nan
    _close(second, u, cosine, beams, closure)
    second *= ranges * ranges
    np.abs(second, out=second)
    second.sort(axis=1)  # NaN, where a beam has no range, sorts last
    # Every sweep has a NaN but a turn without loss, for which argmax finds none and says 0.
    count = np.isnan(second).argmax(axis=1)
    count[~np.isnan(second[:, -1])] = width
    median: Float32 = second[np.arange(rows), np.maximum(count - 1, 0) // 2]
    median[count == 0] = 0.0
    return median


def _close(second: Float32, u: Float32, cosine: Float32, beams: Int32, closure: UInt8) -> None:
    """Fill in the two second differences over the seam of the sweeps that make a full turn."""
    rows = np.flatnonzero(closure != Closure.OPEN)
    if not len(rows):
        return
    shared = closure[rows] == Closure.SHARED
    cosine = cosine[rows]
    first = rows * u.shape[1]
    last = first + beams[rows] - 1
    repeated = last[shared]
    last = last - shared
    u, second = u.reshape(-1), second.reshape(-1)
    u_first, u_last = u[first], u[last]
    second[first] = u_last + u[first + 1] - cosine * u_first
    second[last] = u[last - 1] + u_first - cosine * u_last
    second[repeated] = np.nan
