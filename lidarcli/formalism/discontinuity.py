"""Definition 3: where f is discontinuous, from two samples (|s| > d_th) or from its one-sided limits."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Gaps, Steps
from lidarcli.formalism.points import NEVER, Points
from lidarcli.formalism.threshold import noise_threshold
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
    threshold: Float64 = noise_threshold(sigma) + SPACING_GAIN * step * np.fmin(r, r - s)
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
    row, s = steps.row, steps.s
    allowed = adaptive_threshold(sigma[row], points.geometry.step[row], points.range[steps.cell], s)
    candidate = np.flatnonzero((np.abs(s) > allowed) & (steps.missing < NEVER))
    allowed, s = allowed[candidate], s[candidate]
    cell, before = steps.cell[candidate], steps.before[candidate]
    u, slope_before, slope_here = _inverse_and_slopes(points, gap, steps, candidate, max_gap)
    step = (steps.missing[candidate] + 1).astype(np.float64)
    r_here, r_before = points.range[cell], points.range[before]
    foreseen_left = _range_of(u[0] + step * slope_before) - r_before
    foreseen_right = r_here - _range_of(u[1] - step * slope_here)
    upper = np.maximum(np.maximum(foreseen_left, foreseen_right), 0.0)
    lower = np.minimum(np.minimum(foreseen_left, foreseen_right), 0.0)
    jump = np.zeros(len(steps), bool)
    jump[candidate] = (s > upper + allowed) | (s < lower - allowed)
    return jump


def _range_of(u: Float64) -> Float64:
    """1/u; a surface that recedes to infinity has u ≤ 0."""
    ranges: Float64 = 1.0 / np.maximum(u, np.finfo(np.float64).tiny)
    return ranges


def _inverse_and_slopes(
    points: Points, gap: Gaps, steps: Steps, candidate: Int64, max_gap: int
) -> tuple[Float64, Float64, Float64]:
    """u = 1/r of the predecessor and of the point (2, C), and du/dk as either side of the step supports it, (C,) each.

    Most steps have no lost beam near: their neighbours are the cells beside them. The few others look for theirs.
    """
    cell = steps.cell[candidate]
    beside = np.arange(-1 - REACH, 1 + REACH)[:, None]
    u = 1.0 / points.range.take(cell + beside, mode="clip")
    before, here = REACH, REACH + 1
    slope_before = _agreed([(u[before] - u[before - lag]) / lag for lag in range(1, REACH + 1)])
    slope_here = _agreed([(u[here + lag] - u[here]) / lag for lag in range(1, REACH + 1)])
    some = np.flatnonzero(np.isnan(u.sum(axis=0)))
    u = u[before : here + 1]
    if len(some):
        near = candidate[some]
        stretch, cell, predecessor = steps.stretch[near], steps.cell[near], steps.before[near]
        preceding = _preceding(points)
        # The predecessor is in the same stretch, unless the point begins one.
        before_stretch = np.where(cell == points.begin[stretch], preceding[stretch], stretch)
        u[0, some] = 1.0 / points.range[predecessor]
        slope_before[some], slope_here[some] = _gentlest_slopes(
            points,
            gap,
            preceding,
            np.stack([predecessor, cell]),
            np.stack([before_stretch, stretch]),
            max_gap,
        )
    return u, slope_before, slope_here


def _preceding(points: Points) -> Int64:
    """(G,) the stretch before each in its row, before the first the last."""
    preceding = np.arange(-1, len(points.begin) - 1)
    filled = np.flatnonzero(points.stretches[1:] > points.stretches[:-1])
    preceding[points.stretches[filled]] = points.stretches[filled + 1] - 1
    return preceding


def _gentlest_slopes(
    points: Points, gap: Gaps, preceding: Int64, at: Int64, stretch: Int64, max_gap: int
) -> Float64:
    """du/dk per beam that the points on either side of a step support, over lost beams. (2, C)

    Parameters
    ----------
    preceding : (G,) the stretch before each
    at, stretch : (2, C) cells of the points before and after a step, and the stretches they are in
    max_gap : how many lost beams may lie between such a point and one that counts
    """
    count = len(preceding)
    following = np.empty_like(preceding)
    following[preceding] = np.arange(count)
    # Looking back, then looking ahead: where the next stretch begins, which that is, and how far it is.
    enter = np.stack([points.end[preceding], points.begin[following]])
    other = np.stack([preceding, following + count])
    far = np.stack([gap.missing, gap.missing[following]])
    enter, other, far = enter.reshape(-1), other.reshape(-1), far.reshape(-1)
    stretch = stretch + np.array([[0], [count]])
    direction = np.array([[-1], [1]])

    u_at = 1.0 / points.range[at]
    span = np.zeros(at.shape, np.int64)
    slopes = []
    for lag in range(1, REACH + 1):
        at = at + direction
        span += 1
        leaves = np.flatnonzero(~points.valid[at])
        left = stretch.reshape(-1)[leaves]
        span.reshape(-1)[leaves] += far[left]
        at.reshape(-1)[leaves] = enter[left]
        stretch.reshape(-1)[leaves] = other[left]
        slope = (1.0 / points.range[at] - u_at) / (span * direction)
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
