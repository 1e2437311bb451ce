"""Definition 3: the breakpoints of a sweep, before which f is discontinuous.

As printed that is where |s(θ_n)| > d_th. A real sensor needs the one-sided limits of f: a breakpoint is what neither
side's surface explains.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from lidarcli import native
from lidarcli.formalism.sweep import points as sweep
from lidarcli.formalism.sweep.points import Points, Scans

ROUGHNESS = 0.08
"""[m] Depth steps below this are the texture of a surface: foliage, folds, mouldings."""
NOISE_GAIN = 3.5
"""A difference of two ranges exceeds this many of its standard deviations in 5 of 10,000 beams."""
ROOT_2 = math.sqrt(2.0)
"""Standard deviation of the difference of two ranges of standard deviation 1."""
SPACING_GAIN = 1.0
"""Depth steps below this share of the beam spacing r Δθ are the texture of a surface, not an edge."""
REACH = 3
"""How many points on each side of a step speak for the slope there."""
TINY = sys.float_info.min
"""[1/m] A surface that recedes to infinity has 1/r ≤ 0: as good as this."""


class Breakpoints:
    """Where a sweep breaks: the points `at[0] … at[count - 1]`, before which f is discontinuous, in order."""

    def __init__(self, most: int, adaptive: bool, max_gap: int) -> None:
        """
        Parameters
        ----------
        most : room for sweeps of so many beams
        adaptive : whether one-sided limits decide, not |s| alone
        max_gap : more lost beams than this are a discontinuity by themselves
        """
        self.owner: list[Any] = []
        self.at = native.integers(self.owner, most + 1)
        self.count = 0
        self.adaptive = adaptive
        self.max_gap = max_gap


def noise_threshold(sigma: float) -> float:
    """The least difference [m] that noise of standard deviation `sigma` [m] does not explain."""
    return max(NOISE_GAIN * ROOT_2 * sigma, ROUGHNESS)


def adaptive_threshold(points: Points, explained: float, r: float, s: float) -> float:
    """What noise and the beam spacing explain between a point and its predecessor [m].

    It grows with r Δθ at the nearer of the two points (Borges and Aldon 2004, Dietmayer 2001): a surface may turn or be
    rough between two beams.

    Parameters
    ----------
    explained : what noise does [m], see `noise_threshold`
    r, s : range of the point and difference to its predecessor [m]; NaN in s: as if they were equally far
    """
    before = r - s
    return explained + SPACING_GAIN * points.step * (before if before < r else r)


def find(breakpoints: Breakpoints, points: Points, scans: Scans) -> None:
    """Find the breakpoints; with a mask of beams that belong to objects, its borders are some, too."""
    s, missing, d_th, masked = points.s, points.missing, points.d_th, scans.has_within
    count = 0
    for k in range(points.count):
        if missing[k] == 0 and not abs(s[k]) > d_th and not masked:
            continue
        if missing[k] > breakpoints.max_gap:
            breaks = True
        elif abs(s[k]) > d_th:
            breaks = not breakpoints.adaptive or is_unexplained(points, k, breakpoints.max_gap)
        else:
            breaks = False
        if masked and not breaks:
            breaks = is_within(points, scans, k) != is_within(points, scans, k - 1 if k else points.count - 1)
        if breaks:
            breakpoints.at[count] = k
            count += 1
    breakpoints.count = count


def is_within(points: Points, scans: Scans, at: int) -> bool:
    """Whether the beam of a point is one of those that are known to belong to objects."""
    beam = sweep.beam_at(points, points.position[at])
    return scans.within[points.row * scans.width + beam] != 0


def is_unexplained(points: Points, at: int, max_gap: int) -> bool:
    """Def. 3 with the one-sided limits of f: whether no side's surface explains the step before a point.

    Each side is extended to the other beam along a straight surface (1/r is linear in θ for small steps). The step s
    is explained if it lies between 0 and the step that either side foresees, give or take `adaptive_threshold`. So a
    wall at grazing incidence does not break, and neither does a corner, where the step lies between the two extensions.

    Parameters
    ----------
    max_gap : points further than this many lost beams away say nothing about the slope
    """
    s, r = points.s[at], points.r[at]
    allowed = adaptive_threshold(points, points.d_th, r, s)
    if not abs(s) > allowed:
        return False
    before = at - 1 if at > 0 else points.count - 1
    r_before = points.r[before]
    step = points.missing[at] + 1.0
    left = 1.0 / max(1.0 / r_before + step * slope(points, before, -1, max_gap), TINY) - r_before
    right = r - 1.0 / max(1.0 / r - step * slope(points, at, 1, max_gap), TINY)
    return s > max(left, right, 0.0) + allowed or s < min(left, right, 0.0) - allowed


def slope(points: Points, at: int, way: int, max_gap: int) -> float:
    """d(1/r) per beam that the points on one side of a step support; `way` is -1 before it, 1 after it.

    The gentlest, because a span that straddles an earlier edge is too steep, never too gentle; 0 if they disagree in sign
    or there are none.
    """
    r, missing, count = points.r, points.missing, points.count
    u = 1.0 / r[at]
    least, greatest, some, span = 0.0, 0.0, False, 0
    for lag in range(1, REACH + 1):
        # Before the first point comes the last one: if only on a full turn, `missing` tells.
        if way < 0:
            span += missing[at] + 1
            at = at - 1 if at > 0 else count - 1
        else:
            at = at + 1 if at < count - 1 else 0
            span += missing[at] + 1
        if span > lag + max_gap:
            continue
        value = (1.0 / r[at] - u) / (span * way)
        least = min(value, least) if some else value
        greatest = max(value, greatest) if some else value
        some = True
    return max(least, 0.0) + min(greatest, 0.0)
