"""Definition 3: where f is discontinuous, from two samples (|s| > d_th) or from its one-sided limits."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.points import Neighbours, Points
from lidarcli.formalism.threshold import noise_threshold
from lidarcli.sweeps import Bool, Float64

REACH = 4
"""Neighbours on each side that `one_sided_jumps` looks at."""
SPACING_GAIN = 1.0
"""Depth steps below this share of the beam spacing r Δθ are the texture of a surface, not an edge."""


def jumps(s: Float64, d_th: Float64) -> Bool:
    """Def. 3 as printed: f is discontinuous before a point where |s(θ_n)| > d_th. (M,), (M,) → (M,)."""
    with np.errstate(invalid="ignore"):
        jump: Bool = np.abs(s) > d_th
    return jump


def adaptive_threshold(points: Points, sigma: Float64, s: Float64) -> Float64:
    """(M,) metres: what noise and the beam spacing explain between a point and its predecessor.

    It grows with the noise σ of the sweep, and with r Δθ at the nearer of the two points (Borges and Aldon 2004,
    Dietmayer 2001): a surface may turn or be rough between two beams.
    """
    nearer = np.fmin(points.range, points.range - s)
    spacing = nearer * points.geometry.step[points.row]
    threshold: Float64 = noise_threshold(sigma)[points.row] + SPACING_GAIN * spacing
    return threshold


def one_sided_jumps(points: Points, around: Neighbours, s: Float64, d_th: Float64, max_gap: int) -> Bool:
    """Def. 3 with the one-sided limits of f: a jump is what neither side's surface explains.

    Each side is extended to the other beam along a straight surface (1/r is linear in θ for small steps). The step s
    is explained if it lies between 0 and the step that either side foresees, give or take d_th. So a wall at grazing
    incidence does not break, and neither does a corner, where the step lies between the two extensions.

    Parameters
    ----------
    points : M points
    around : their neighbours, `REACH` or more on each side
    s, d_th : (M,) difference to the predecessor and threshold there [m]
    max_gap : neighbours further than this many lost beams away say nothing about the slope

    Returns
    -------
    (M,) whether f is discontinuous between a point and its predecessor
    """
    jump = np.zeros(len(points), bool)
    candidate = np.flatnonzero(jumps(s, d_th))
    if not len(candidate):
        return jump
    u = 1.0 / around.range
    here = around.core[candidate]
    before = here - 1
    step = (around.position[here] - around.position[before]).astype(np.float64)
    s = s[candidate]
    u_here = u[before] + step * _gentlest_slope(u, around, before, -1, max_gap)
    foreseen_left = _range_of(u_here) - around.range[before]
    u_before = u[here] - step * _gentlest_slope(u, around, here, +1, max_gap)
    foreseen_right = around.range[here] - _range_of(u_before)
    upper = np.maximum(np.maximum(foreseen_left, foreseen_right), 0.0)
    lower = np.minimum(np.minimum(foreseen_left, foreseen_right), 0.0)
    allowed = d_th[candidate]
    jump[candidate] = (s > upper + allowed) | (s < lower - allowed)
    return jump


def _range_of(u: Float64) -> Float64:
    """1/u; a surface that recedes to infinity has u ≤ 0."""
    with np.errstate(divide="ignore"):
        ranges: Float64 = np.where(u > 0, 1.0 / np.where(u > 0, u, 1.0), np.inf)
    return ranges


def _gentlest_slope(u: Float64, around: Neighbours, at: np.ndarray, direction: int, max_gap: int) -> Float64:
    """du/dk per beam that the points on one side of `at` support: the least of three spans, 0 if they disagree in sign.

    The least, because a span that straddles an earlier edge is too steep, never too gentle.
    """
    least = np.full(len(at), np.inf)
    greatest = np.full(len(at), -np.inf)
    reachable = np.ones(len(at), bool)
    for lag in range(1, REACH):
        other = at + direction * lag
        span = (around.position[other] - around.position[at]) * direction
        reachable &= around.inside[other] & (span > 0) & (span <= lag + max_gap)
        slope = direction * (u[other] - u[at]) / np.maximum(span, 1)
        least = np.where(reachable, np.minimum(least, slope), least)
        greatest = np.where(reachable, np.maximum(greatest, slope), greatest)
    agreed: Float64 = np.maximum(least, 0.0) + np.minimum(greatest, 0.0)
    return np.where(np.isfinite(agreed), agreed, 0.0)
