"""Definitions 1 to 3 and 5: from a sweep to its points, the breakpoints among them, and the segments between two of these.

As printed, f breaks where |s(θ_n)| > d_th (Definition 3). A real sensor needs the one-sided limits of f: a breakpoint is
what neither side's surface explains.
"""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from lidarcli.sweeps import types
from lidarcli.system import native

NEVER = 1 << 24
"""Number of lost beams between a point and a predecessor that does not exist: above every `max_gap`, in 32 bits, too."""
NAN = float("nan")
INFINITE = float("inf")
TURN = types.TURN
LONGEST_GAP = 3
"""Greatest number of lost beams in a row that should have returned."""
GAP_STEP, GAP_STEP_GROWS = 0.1, 0.02
"""[m], and per metre of range: greatest change of range of a surface past a gap."""
NO_RETURN = types.Status.NO_RETURN.value
OPEN_TURN, SHARED_TURN = types.Closure.OPEN.value, types.Closure.SHARED.value


def kept(owner: list[Any], values: Any, kind: Any) -> Any:
    """Return the values as a contiguous array of a type, which lives as long as `owner`."""
    array = np.require(values, kind, ["C", "A"])
    owner.append(array)
    return array


class Scans:
    """Columns of a batch of S sweeps with up to B beams, for the loops over one sweep."""

    def __init__(self, batch: types.SweepBatch, direction: Any, within: Any, sigma: Any) -> None:
        """`direction`: cos θ and sin θ, (D, B) each by increasing bearing, and which of them each sweep has, (S,)."""
        cos, sin, code = direction
        self.owner: list[Any] = []
        self.rows = len(batch)
        self.width = batch.width
        self.ranges = native.at_singles(kept(self.owner, batch.ranges, np.float32))
        self.status = native.at_bytes(kept(self.owner, batch.status, np.uint8))
        self.beams = native.at_ints(kept(self.owner, batch.beams, np.int32))
        self.closure = native.at_bytes(kept(self.owner, batch.closure, np.uint8))
        self.angle_min = native.at_doubles(kept(self.owner, batch.angle_min, np.float64))
        self.angle_increment = native.at_doubles(kept(self.owner, batch.angle_increment, np.float64))
        self.cos = native.at_doubles(kept(self.owner, cos, np.float64))
        self.sin = native.at_doubles(kept(self.owner, sin, np.float64))
        self.direction = native.at_longs(kept(self.owner, code, np.int64))
        self.within = native.at_bytes(kept(self.owner, np.zeros(0) if within is None else within, np.bool_))
        self.sigma = native.at_doubles(kept(self.owner, np.zeros(0) if sigma is None else sigma, np.float64))
        self.has_within = within is not None
        self.has_sigma = sigma is not None


class Points:
    """The `count` beams of one sweep that have a range, each bearing once, by increasing bearing.

    Position k = 0, 1, … counts the bearings counter-clockwise, whatever the sign of the increment. The first points are
    listed once more after the last, so that a segment over the seam of a full turn has consecutive points, too.
    """

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.most = most
        self.position = native.numbers(self.owner, 2 * most)
        self.r = native.doubles(self.owner, 2 * most)
        self.x = native.doubles(self.owner, 2 * most)
        self.y = native.doubles(self.owner, 2 * most)
        self.s = native.doubles(self.owner, most)
        self.missing = native.numbers(self.owner, most)
        self.gap = native.integers(self.owner, most + 1)
        """The `gaps` points before which beams were lost, and `count`."""
        self.row = 0
        self.count = self.gaps = 0
        self.nearest = -1
        """First point with the least range; -1 without a point."""
        self.first = 0.0
        self.step = 0.0
        self.cos_half = 1.0
        self.sin_half = 0.0
        self.sigma = 0.0
        self.d_th = 0.0
        self.flicker = 0.0
        self.beams = 0
        self.bearings = 0
        self.period = 0
        self.reverse = False


def load(points: Points, scans: Scans, row: int) -> None:
    """Lay out the sweep in a row of a batch: r on Θ_k, and where the points are [m]."""
    increment = scans.angle_increment[row]
    points.row = row
    points.beams = scans.beams[row]
    # The second beam on the first bearing says nothing new.
    points.bearings = points.beams - (scans.closure[row] == SHARED_TURN)
    points.period = 0 if scans.closure[row] == OPEN_TURN else points.bearings
    points.reverse = increment < 0
    points.step = abs(increment)
    points.cos_half, points.sin_half = math.cos(0.5 * points.step), math.sin(0.5 * points.step)
    points.first = scans.angle_min[row]
    if points.reverse:
        points.first += (points.bearings - 1) * increment

    position, r, x, y = points.position, points.r, points.x, points.y
    missing, gap, ranges, cos, sin = points.missing, points.gap, scans.ranges, scans.cos, scans.sin
    direction, bearings = scans.direction[row] * scans.width, points.bearings
    beam, stride = row * scans.width, 1
    if points.reverse:
        beam, stride = beam + bearings - 1, -1
    # Runs of beams that have a range; a lost beam is NaN, and so is a sum with one.
    count, gaps, k, last = 0, 0, 0, -1
    while k < bearings:
        if ranges[beam + k * stride] != ranges[beam + k * stride]:
            k += 1
            continue
        first = k
        while k + 4 <= bearings:
            at = beam + k * stride
            some = (ranges[at] + ranges[at + stride]) + (ranges[at + 2 * stride] + ranges[at + 3 * stride])
            if some != some:
                break
            k += 4
        while k < bearings and ranges[beam + k * stride] == ranges[beam + k * stride]:
            k += 1
        at, here, size = beam + first * stride, direction + first, k - first
        # A loop for each: none of them reads what it writes.
        for i in range(size):
            r[count + i] = ranges[at + i * stride]
        for i in range(size):
            away = r[count + i]
            x[count + i] = away * cos[here + i]
            y[count + i] = away * sin[here + i]
        for i in range(size):
            position[count + i] = first + i
        for i in range(size):
            missing[count + i] = 0
        if count > 0:
            missing[count] = first - last - 1
            gap[gaps] = count
            gaps += 1
        count += size
        last = k - 1
    points.count, points.gaps = count, gaps


def repeat(points: Points, lead: int) -> None:
    """List the first `lead` points once more after the last."""
    for k in range(lead):
        points.position[points.count + k] = points.position[k]
        points.r[points.count + k] = points.r[k]
        points.x[points.count + k] = points.x[k]
        points.y[points.count + k] = points.y[k]


def bearing(points: Points, at: int) -> float:
    """Return θ of a point [rad], which grows past the seam."""
    theta = points.first + points.step * points.position[at]
    return theta + TURN if at >= points.count else theta


def beam_at(points: Points, position: int) -> int:
    """Index in the log of the beam at a position, at most one turn beyond the seam on either side (Def. 1's n)."""
    if points.period > 0:
        if position >= points.period:
            position -= points.period
        elif position < 0:
            position += points.period
    return points.bearings - 1 - position if points.reverse else position


def distance(points: Points, a: int, b: int) -> float:
    """Return the distance of two points [m]."""
    dx, dy = points.x[b] - points.x[a], points.y[b] - points.y[a]
    return math.sqrt(dx * dx + dy * dy)


def differences(points: Points) -> None:
    """Def. 2: s(θ_n) = r(θ_n) - r(θ_{n-1}) [m], the lost beams before the first point and the gap there; the nearest point.

    The point before the first is the last one on a full turn; on a partial view there is none, and s is NaN.
    """
    r, s, missing, gap, count = points.r, points.s, points.missing, points.gap, points.count
    last, points.nearest = count - 1, -1
    for k in range(1, count):
        s[k] = r[k] - r[k - 1]
    if points.period > 0 and last > 0:
        s[0] = r[0] - r[last]
        missing[0] = points.position[0] + points.period - points.position[last] - 1
    else:
        s[0] = NAN
        missing[0] = NEVER
    if count > 0 and missing[0] != 0:
        for i in range(points.gaps, 0, -1):
            gap[i] = gap[i - 1]
        gap[0] = 0
        points.gaps += 1
    gap[points.gaps] = count
    least, at, fours = INFINITE, 0, count - count % 4
    for k in range(0, fours, 4):
        some = min(min(r[k], r[k + 1]), min(r[k + 2], r[k + 3]))
        if some < least:
            least, at = some, k
    for k in range(fours, count):
        if r[k] < least:
            least, at = r[k], k
    if count > 0:
        while r[at] > least:
            at += 1
        points.nearest = at


def flicker(points: Points, scans: Scans) -> float:
    """The share of the beams of a sweep that should have returned and did not: short gaps in what goes on past them."""
    gone = 0
    for i in range(points.gaps):
        k = points.gap[i]
        lost = points.missing[k]
        if lost > LONGEST_GAP:
            continue
        nearer = min(points.r[k], points.r[k] - points.s[k])
        if abs(points.s[k]) > GAP_STEP + GAP_STEP_GROWS * nearer:
            continue
        for back in range(1, lost + 1):
            beam = beam_at(points, points.position[k] - back)
            if beam >= 0 and scans.status[points.row * scans.width + beam] == NO_RETURN:
                gone += 1
    return gone / max(gone + points.count, 1.0)


def mean_difference(points: Points) -> float:
    """Def. 3's d_th = (1/N) Σ |s(θ_n)| [m], N the number of neighbouring beams that both have a range; 0 without any."""
    s, total, begin = points.s, 0.0, 0
    for i in range(points.gaps + 1):
        for k in range(begin, points.gap[i]):
            total += abs(s[k])
        begin = points.gap[i] + 1
    number = points.count - points.gaps
    return total / number if number > 0 else 0.0


# Definition 3: the breakpoints of a sweep, before which f is discontinuous.

ROUGHNESS, SPACING_GAIN = 0.08, 1.0
"""Depth steps below this [m], and below this share of the beam spacing r Δθ, are the texture of a surface: foliage,
folds."""
NOISE_GAIN = 3.5
"""A difference of two ranges exceeds this many of its standard deviations in 5 of 10,000 beams."""
ROOT_2 = math.sqrt(2.0)
"""Standard deviation of the difference of two ranges of standard deviation 1."""
SLOPE_REACH = 3
"""Number of points on each side of a step that give the slope there."""
TINY = sys.float_info.min
"""[1/m] A surface that recedes to infinity has 1/r ≤ 0: as good as this."""


class Breakpoints:
    """Breakpoints of a sweep: the points `at[0] … at[count - 1]`, before which f is discontinuous, in order."""

    def __init__(self, most: int, adaptive: bool, max_gap: int) -> None:
        """`adaptive`: one-sided limits decide, not |s| alone; more than `max_gap` lost beams are a discontinuity."""
        self.owner: list[Any] = []
        self.at = native.integers(self.owner, most + 1)
        self.count = 0
        self.adaptive = adaptive
        self.max_gap = max_gap


def noise_threshold(sigma: float) -> float:
    """Return the least difference [m] that noise of standard deviation `sigma` [m] does not explain."""
    return max(NOISE_GAIN * ROOT_2 * sigma, ROUGHNESS)


def adaptive_threshold(points: Points, explained: float, r: float, s: float) -> float:
    """Return the difference that noise and the beam spacing explain between a point and its predecessor [m].

    It grows with r Δθ at the nearer of the two points (Borges and Aldon 2004, Dietmayer 2001): a surface may turn or be
    rough between two beams. `explained` is what noise does, see `noise_threshold`; NaN in s: as if both were equally far.
    """
    before = r - s
    return explained + SPACING_GAIN * points.step * (before if before < r else r)


def find_breakpoints(breakpoints: Breakpoints, points: Points, scans: Scans) -> None:
    """Find the breakpoints; with a mask of beams that belong to objects, its borders are some, too."""
    s, missing, d_th, masked, max_gap = points.s, points.missing, points.d_th, scans.has_within, breakpoints.max_gap
    count, begin = 0, 0
    for i in range(points.gaps + 1):
        k, end = begin, points.gap[i]
        while k < end:
            last = min(k + 4, end)
            # Four at once: most steps are small, and beams are missing before the first alone.
            if last < k + 4 or k == begin or masked or not _all_small(s, k, d_th):
                for p in range(k, last):
                    if missing[p] > max_gap:
                        breaks = True
                    elif abs(s[p]) > d_th:
                        breaks = not breakpoints.adaptive or is_unexplained(points, p, max_gap)
                    else:
                        breaks = False
                    if masked and not breaks:
                        before = p - 1 if p else points.count - 1
                        breaks = is_within(points, scans, p) != is_within(points, scans, before)
                    if breaks:
                        breakpoints.at[count] = p
                        count += 1
            k = last
        begin = end
    breakpoints.count = count


def _all_small(s: Any, k: int, d_th: float) -> bool:
    """Return whether four steps from a point on are all no greater than d_th."""
    return not max(max(abs(s[k]), abs(s[k + 1])), max(abs(s[k + 2]), abs(s[k + 3]))) > d_th


def is_within(points: Points, scans: Scans, at: int) -> bool:
    """Return whether the beam of a point is known to belong to an object."""
    beam = beam_at(points, points.position[at])
    return scans.within[points.row * scans.width + beam] != 0


def is_unexplained(points: Points, at: int, max_gap: int) -> bool:
    """Def. 3 with the one-sided limits of f: True if no side's surface explains the step before a point.

    Each side is extended to the other beam along a straight surface (1/r is linear in θ for small steps). The step s
    is explained if it lies between 0 and the step that either side foresees, give or take `adaptive_threshold`. So a
    wall at grazing incidence does not break, and neither does a corner, where the step lies between the two extensions.
    Points further than `max_gap` lost beams away say nothing about the slope.
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


def slope(points: Points, at: int, sign: int, max_gap: int) -> float:
    """d(1/r) per beam that the points on one side of a step support; `sign` is -1 before it, 1 after it.

    The gentlest, because a span that straddles an earlier edge is too steep, never too gentle; 0 if they disagree in sign
    or there are none.
    """
    r, missing, count = points.r, points.missing, points.count
    u = 1.0 / r[at]
    least, greatest, some, span = 0.0, 0.0, False, 0
    for lag in range(1, SLOPE_REACH + 1):
        # Before the first point comes the last one: if only on a full turn, `missing` tells.
        if sign < 0:
            span += missing[at] + 1
            at = at - 1 if at > 0 else count - 1
        else:
            at = at + 1 if at < count - 1 else 0
            span += missing[at] + 1
        if span > lag + max_gap:
            continue
        value = (1.0 / r[at] - u) / (span * sign)
        least = min(value, least) if some else value
        greatest = max(value, greatest) if some else value
        some = True
    return max(least, 0.0) + min(greatest, 0.0)


# Definition 5: the segments of a sweep between two breakpoints, and what each of their edges says.

OWN, HIDDEN, OPEN, UNKNOWN, VIEW, FLICKERING = range(6)
"""An edge of a segment: the segment is the nearer side; the neighbour is, and hides the rest; a beam without a return is
next to it; an invalid or too close one is; the view ends; a beam without a return where such beams prove nothing."""
MAX_FLICKER = 0.05
"""Share of lost beams among those that should return, above which a beam without a return is no proof of free space."""


class Segments:
    """The `count` segments of a sweep by increasing bearing: point `first`, and `size` - 1 that follow it."""

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.first = native.integers(self.owner, most)
        self.size = native.integers(self.owner, most)
        self.start_edge = native.integers(self.owner, most)
        self.end_edge = native.integers(self.owner, most)
        self.s_start = native.doubles(self.owner, most)
        self.s_end = native.doubles(self.owner, most)
        self.count = 0


def cut(segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans) -> None:
    """Cut the points at every breakpoint; on a full turn a segment may cross the seam, or go all around."""
    first, size, at = segments.first, segments.size, breakpoints.at
    count = segments.count = breakpoints.count
    if count == 0:
        # A full turn without any breakpoint is one segment, which hides no edge of its own.
        if points.count > 0:
            segments.count = 1
            first[0], size[0] = 0, points.count
            segments.s_start[0] = segments.s_end[0] = NAN
            segments.start_edge[0] = segments.end_edge[0] = HIDDEN
        return
    for j in range(count):
        _enter(segments, points, breakpoints, scans, j)
        first[j] = at[j]
        if j > 0:
            size[j - 1] = at[j] - at[j - 1]
            _leave(segments, points, breakpoints, scans, j - 1, at[j])
    last = count - 1
    size[last] = points.count - at[last]
    if points.period > 0:
        # The first breakpoint of a full turn also ends the last segment.
        size[last] += at[0]
        _leave(segments, points, breakpoints, scans, last, at[0])
        repeat(points, at[0])
    else:
        segments.s_end[last] = NAN
        segments.end_edge[last] = _beside(points, scans, points.position[points.count - 1] + 1)


def _enter(segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans, j: int) -> None:
    """Set the first edge of a segment by the breakpoint before it."""
    at = breakpoints.at[j]
    if points.missing[at] > breakpoints.max_gap:
        segments.s_start[j] = NAN
        segments.start_edge[j] = _beside(points, scans, points.position[at] - 1)
    else:
        segments.s_start[j] = points.s[at]
        segments.start_edge[j] = OWN if points.s[at] < 0 else HIDDEN


def _leave(segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans, j: int, following: int) -> None:
    """Set the last edge of a segment by the breakpoint before the next segment."""
    before = following - 1 if following > 0 else points.count - 1
    if points.missing[following] > breakpoints.max_gap:
        segments.s_end[j] = NAN
        segments.end_edge[j] = _beside(points, scans, points.position[before] + 1)
    else:
        segments.s_end[j] = points.s[following]
        segments.end_edge[j] = OWN if points.s[following] > 0 else HIDDEN


def _beside(points: Points, scans: Scans, position: int) -> int:
    """Return the kind of an edge by the beam at a position next to the segment."""
    beam = beam_at(points, position)
    if beam < 0 or beam >= points.beams:
        return VIEW
    if scans.status[points.row * scans.width + beam] != NO_RETURN:
        return UNKNOWN
    return FLICKERING if points.flicker > MAX_FLICKER else OPEN


def copy_segments(source: Segments, target: Segments) -> None:
    """Make all segments of one sweep those of another."""
    for j in range(source.count):
        target.first[j], target.size[j] = source.first[j], source.size[j]
        target.start_edge[j], target.end_edge[j] = source.start_edge[j], source.end_edge[j]
        target.s_start[j], target.s_end[j] = source.s_start[j], source.s_end[j]
    target.count = source.count


def last_point(segments: Segments, j: int) -> int:
    """Return P_f of a segment."""
    return segments.first[j] + segments.size[j] - 1


def chord(segments: Segments, points: Points, j: int) -> float:
    """Return the distance of the first and the last point of a segment [m]."""
    return distance(points, segments.first[j], last_point(segments, j))


def following(segments: Segments, points: Points, j: int) -> int:
    """Return the next segment, over the seam on a full turn; itself where there is none."""
    if j + 1 < segments.count:
        return j + 1
    return 0 if points.period > 0 else j


def preceding(segments: Segments, points: Points, j: int) -> int:
    """Return the segment before, over the seam on a full turn; itself where there is none."""
    if j > 0:
        return j - 1
    return segments.count - 1 if points.period > 0 else j
