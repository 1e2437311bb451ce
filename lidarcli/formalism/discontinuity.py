"""Definition 3: where f is discontinuous, from two samples (|s| > d_th) or from its one-sided limits."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Gaps, Steps
from lidarcli.formalism.points import NEVER, Points
from lidarcli.formalism.threshold import noise_threshold
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

REACH = 3
"""How many points on each side of a step speak for the slope there."""
SPACING_GAIN = 1.0
"""Depth steps below this share of the beam spacing r Δθ are the texture of a surface, not an edge."""


def jumps(s: Float64, d_th: Float64) -> Bool:
    """Def. 3 as printed: f is discontinuous before a point where |s(θ_n)| > d_th. (M,), (M,) → (M,)."""
    with np.errstate(invalid="ignore"):
        jump: Bool = np.abs(s) > d_th
    return jump


def adaptive_threshold(sigma: Float64, step: Float64, r: Float64, s: Float64) -> Float64:
    """What noise and the beam spacing explain between a point and its predecessor [m].

    It grows with the noise σ of the sweep, and with r Δθ at the nearer of the two points (Borges and Aldon 2004,
    Dietmayer 2001): a surface may turn or be rough between two beams.

    Parameters
    ----------
    sigma, step : noise [m] and |Δθ| [rad] of the sweep of each point
    r, s : range of the point and difference to its predecessor [m]; NaN in s: as if they were equally far
    """
    return _with_spacing(noise_threshold(sigma), step, r, s)


def _with_spacing(explained: Float64, step: Float64, r: Float64, s: Float64) -> Float64:
    """What the beam spacing explains besides what noise does [m]."""
    threshold: Float64 = explained + SPACING_GAIN * step * np.fmin(r, r - s)
    return threshold


def one_sided_jumps(points: Points, steps: Steps, gap: Gaps, sigma: Float64, max_gap: int) -> Bool:
    """Def. 3 with the one-sided limits of f: a jump is what neither side's surface explains.

    Each side is extended to the other beam along a straight surface (1/r is linear in θ for small steps). The step s
    is explained if it lies between 0 and the step that either side foresees, give or take `adaptive_threshold`. So a
    wall at grazing incidence does not break, and neither does a corner, where the step lies between the two extensions.

    Parameters
    ----------
    points : M points of S sweeps
    steps : E of them that may follow a discontinuity
    gap : what lies before each stretch of points
    sigma : (S,) noise of the ranges [m]
    max_gap : points further than this many lost beams away say nothing about the slope

    Returns
    -------
    (E,) whether f is discontinuous between the point and its predecessor
    """
    return unexplained(
        points.range,
        points.begin,
        points.end,
        points.stretches,
        gap.missing,
        points.geometry.step,
        noise_threshold(sigma),
        steps.cell,
        steps.row,
        steps.stretch,
        steps.before,
        steps.missing,
        steps.s,
        max_gap,
    )


@compiled
def unexplained(
    cells: Float64,
    begin: Int64,
    end: Int64,
    stretches: Int64,
    gap_missing: Int64,
    bearing_step: Float64,
    explained: Float64,
    cell: Int64,
    row: Int64,
    stretch: Int64,
    before: Int64,
    missing: Int64,
    difference: Float64,
    max_gap: int,
) -> Bool:
    """(E,) whether no side's surface explains a step.

    Parameters
    ----------
    cells : (S * stride,) ranges [m]
    begin, end, stretches, gap_missing : (G,) first cell and last cell of each stretch, (S + 1,) the stretches of the
        rows, and (G,) the beams missing before each
    bearing_step, explained : (S,) |Δθ| [rad], and the difference that noise explains [m]
    cell, row, stretch, before, missing, difference : (E,) as in `Steps`
    max_gap : points further than this many lost beams away say nothing about the slope
    """
    allowed = _with_spacing(explained[row], bearing_step[row], cells[cell], difference)
    candidate = np.flatnonzero((np.abs(difference) > allowed) & (missing < NEVER))
    allowed, s = allowed[candidate], difference[candidate]
    cell, stretch, before = cell[candidate], stretch[candidate], before[candidate]
    stretched = _Stretches.of(begin, end, stretches, gap_missing)
    u, slope_before, slope_here = _inverse_and_slopes(cells, stretched, cell, stretch, before, max_gap)
    step = (missing[candidate] + 1).astype(np.float64)
    r_here, r_before = cells[cell], cells[before]
    foreseen_left = _range_of(u[0] + step * slope_before) - r_before
    foreseen_right = r_here - _range_of(u[1] - step * slope_here)
    upper = np.maximum(np.maximum(foreseen_left, foreseen_right), 0.0)
    lower = np.minimum(np.minimum(foreseen_left, foreseen_right), 0.0)
    jump = np.zeros(len(difference), bool)
    jump[candidate] = (s > upper + allowed) | (s < lower - allowed)
    return jump


def _range_of(u: Float64) -> Float64:
    """1/u; a surface that recedes to infinity has u ≤ 0."""
    ranges: Float64 = 1.0 / np.maximum(u, np.finfo(np.float64).tiny)
    return ranges


@record
class _Stretches:
    """The G stretches of points, and which of its row lies before each; before the first the last. (G,) each."""

    begin: Int64
    end: Int64
    missing: Int64
    """Beams missing before it."""
    preceding: Int64

    @staticmethod
    def of(begin: Int64, end: Int64, stretches: Int64, missing: Int64) -> _Stretches:
        preceding = np.arange(-1, len(begin) - 1)
        filled = np.flatnonzero(stretches[1:] > stretches[:-1])
        preceding[stretches[filled]] = stretches[filled + 1] - 1
        return _Stretches(begin, end, missing, preceding)


def _inverse_and_slopes(
    cells: Float64, stretches: _Stretches, cell: Int64, stretch: Int64, before: Int64, max_gap: int
) -> tuple[Float64, Float64, Float64]:
    """u = 1/r of the predecessor and of the point (2, C), and du/dk as either side of the step supports it, (C,) each.

    Most steps have no lost beam near: their neighbours are the cells beside them. The few others look for theirs.
    """
    beside = np.arange(-1 - REACH, 1 + REACH)[:, None]
    u = 1.0 / cells.take(cell + beside, mode="clip")
    at_before, here = REACH, REACH + 1
    slope_before = _agreed([(u[at_before] - u[at_before - lag]) / lag for lag in range(1, REACH + 1)])
    slope_here = _agreed([(u[here + lag] - u[here]) / lag for lag in range(1, REACH + 1)])
    some = np.flatnonzero(np.isnan(u.sum(axis=0)))
    u = u[at_before : here + 1]
    if len(some):
        cell, stretch, before = cell[some], stretch[some], before[some]
        # The predecessor is in the same stretch, unless the point begins one.
        begins = cell == stretches.begin[stretch]
        u[0, some] = 1.0 / cells[before]
        slope_before[some], slope_here[some] = _gentlest_slopes(
            cells,
            stretches,
            np.stack([before, cell]),
            np.stack([np.where(begins, stretches.preceding[stretch], stretch), stretch]),
            max_gap,
        )
    return u, slope_before, slope_here


def _gentlest_slopes(
    cells: Float64, stretches: _Stretches, at: Int64, stretch: Int64, max_gap: int
) -> Float64:
    """du/dk per beam that the points on either side of a step support, over lost beams. (2, C)

    Parameters
    ----------
    at, stretch : (2, C) cells of the points before and after a step, and the stretches they are in
    max_gap : how many lost beams may lie between such a point and one that counts
    """
    preceding, missing = stretches.preceding, stretches.missing
    count = len(preceding)
    following = np.empty_like(preceding)
    following[preceding] = np.arange(count)
    # Looking back, then looking ahead: where the next stretch begins, which that is, and how far it is.
    enter = np.concatenate([stretches.end[preceding], stretches.begin[following]])
    other = np.concatenate([preceding, following + count])
    far = np.concatenate([missing, missing[following]])
    stretch = stretch + np.array([[0], [count]])
    direction = np.array([[-1], [1]])

    u_at = 1.0 / cells[at]
    span = np.zeros(at.shape, np.int64)
    slopes = []
    for lag in range(1, REACH + 1):
        at = at + direction
        span += 1
        leaves = np.flatnonzero(np.isnan(cells[at]))
        left = stretch.reshape(-1)[leaves]
        span.reshape(-1)[leaves] += far[left]
        at.reshape(-1)[leaves] = enter[left]
        stretch.reshape(-1)[leaves] = other[left]
        slope = (1.0 / cells[at] - u_at) / (span * direction)
        slope[span > lag + max_gap] = np.nan
        slopes.append(slope)
    return _agreed(slopes)


def _agreed(slopes: list[Float64]) -> Float64:
    """The least of the slopes to the points on one side, 0 if they disagree in sign or there are none; NaN counts not.

    The least, because a span that straddles an earlier edge is too steep, never too gentle.
    """
    least, greatest = slopes[0], slopes[0]
    for slope in slopes[1:]:
        least, greatest = np.fmin(least, slope), np.fmax(greatest, slope)
    agreed: Float64 = np.fmax(least, 0.0) + np.fmin(greatest, 0.0)
    return agreed
