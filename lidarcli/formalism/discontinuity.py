"""Definition 3: where f is discontinuous, from two samples (|s| > d_th) or from its one-sided limits."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.points import Points, neighbour
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


def one_sided_jumps(points: Points, s: Float64, sigma: Float64, max_gap: int) -> Bool:
    """Def. 3 with the one-sided limits of f: a jump is what neither side's surface explains.

    Each side is extended to the other beam along a straight surface (1/r is linear in θ for small steps). The step s
    is explained if it lies between 0 and the step that either side foresees, give or take `adaptive_threshold`. So a
    wall at grazing incidence does not break, and neither does a corner, where the step lies between the two extensions.

    Parameters
    ----------
    points : M points of S sweeps
    s : (M,) difference to the predecessor [m]
    sigma : (S,) noise of the ranges [m]
    max_gap : points further than this many lost beams away say nothing about the slope

    Returns
    -------
    (M,) whether f is discontinuous between a point and its predecessor
    """
    jump = np.zeros(len(points), bool)
    large = np.flatnonzero(jumps(s, noise_threshold(sigma)[points.row]))
    row = points.row[large]
    allowed = adaptive_threshold(sigma[row], points.geometry.step[row], points.range[large], s[large])
    candidate = np.abs(s[large]) > allowed
    here, allowed = large[candidate], allowed[candidate]
    before, position_before, _ = neighbour(points, here, -1)
    step = (points.position[here] - position_before).astype(np.float64)
    r_here, r_before, s = points.range[here], points.range[before], s[here]
    u_here = 1.0 / r_before + step * _gentlest_slope(points, before, -1, max_gap)
    foreseen_left = _range_of(u_here) - r_before
    u_before = 1.0 / r_here - step * _gentlest_slope(points, here, +1, max_gap)
    foreseen_right = r_here - _range_of(u_before)
    upper = np.maximum(np.maximum(foreseen_left, foreseen_right), 0.0)
    lower = np.minimum(np.minimum(foreseen_left, foreseen_right), 0.0)
    jump[here] = (s > upper + allowed) | (s < lower - allowed)
    return jump


def _range_of(u: Float64) -> Float64:
    """1/u; a surface that recedes to infinity has u ≤ 0."""
    ranges: Float64 = np.where(u > 0, 1.0 / np.where(u > 0, u, 1.0), np.inf)
    return ranges


def _gentlest_slope(points: Points, at: Int64, direction: int, max_gap: int) -> Float64:
    """du/dk per beam that the points on one side of `at` support: the least of three spans, 0 if they disagree in sign.

    The least, because a span that straddles an earlier edge is too steep, never too gentle.
    """
    least = np.full(len(at), np.inf)
    greatest = np.full(len(at), -np.inf)
    reachable = np.ones(len(at), bool)
    u_at = 1.0 / points.range[at]
    for lag in range(1, REACH + 1):
        other, position, exists = neighbour(points, at, direction * lag)
        span = (position - points.position[at]) * direction
        reachable &= exists & (span > 0) & (span <= lag + max_gap)
        slope = direction * (1.0 / points.range[other] - u_at) / np.maximum(span, 1)
        least = np.where(reachable, np.minimum(least, slope), least)
        greatest = np.where(reachable, np.maximum(greatest, slope), greatest)
    known = greatest >= least
    least, greatest = np.where(known, least, 0.0), np.where(known, greatest, 0.0)
    agreed: Float64 = np.maximum(least, 0.0) + np.minimum(greatest, 0.0)
    return agreed
