"""The outline of a sweep: its points, thinned, each with the normal of its wall; and the motion of the sensor meanwhile."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.system import native

TURN = 2.0 * math.pi
TINY = 1e-9
"""[rad] A smaller turn is none."""

NEAREST_RANGE, FARTHEST_RANGE = 0.02, 30.0
"""[m] Ranges below and above these are left out: flat views of far walls say little of the place, and the map stays
bounded."""
GRAIN = 0.05
"""[m] Distance between points of a sweep, and between surfels."""
MAX_POINTS = 400
"""Points of a sweep that are used; of more, evenly chosen ones."""
LINE_REACH, MIN_NEIGHBOURS, MAX_NEIGHBOURS = 0.12, 2, 12
"""[m] Length of wall to each side of a point to which its line is fitted, and limits of the number of points there."""
GAP, GAP_BEAMS = 0.15, 4.0
"""Neighbours are of one wall up to this distance [m], or this many times the distance of neighbours on a wall that beams
meet at a right angle; the greater of the two counts."""
LINE_VAR, LINE_VAR_GROWS, STRETCHED = 4e-4, 2.5e-5, 6.0
"""Points lie on a line whose variance across it is below this [m²], plus the growth times the squared range, and whose
variance along it is so many times greater."""
EVEN = 0.05
"""[m] Three beams lie on one line if the middle one is no further off than this, where walls are met at a flat angle."""
LONGEST_CHORD = 1.5
"""[m] Points of a flat wall whose neighbours are further apart than this are not used."""


class Outline:
    """The points of one sweep, thinned, each with the normal of its wall where it lies on one."""

    def __init__(self, beams: int) -> None:
        self.owner: list[Any] = []
        self.most = beams
        self.count = 0
        self.takes_time = 0
        self.x = native.doubles(self.owner, beams)
        self.y = native.doubles(self.owner, beams)
        self.nx = native.doubles(self.owner, beams)
        self.ny = native.doubles(self.owner, beams)
        self.late = native.doubles(self.owner, beams)
        self.r = native.doubles(self.owner, beams)
        self.line = native.integers(self.owner, beams)
        # Observed from where the sensor was at the header stamp.
        self.at_x = native.doubles(self.owner, beams)
        self.at_y = native.doubles(self.owner, beams)
        self.at_nx = native.doubles(self.owner, beams)
        self.at_ny = native.doubles(self.owner, beams)
        # All beams of the sweep: place, and range 0 where there is none.
        self.beam_x = native.doubles(self.owner, beams)
        self.beam_y = native.doubles(self.owner, beams)
        self.beam_r = native.doubles(self.owner, beams)


def read_outline(points: Outline, r: Any, at: int, beams: int, first: float, step: float, begin: float, end: float) -> None:
    """Take the points of a sweep, and fit lines to them."""
    points.count = 0
    points.takes_time = 1 if begin != 0.0 or end != 0.0 else 0
    x, y, ranges = points.beam_x, points.beam_y, points.beam_r
    cos, sin = math.cos(first), math.sin(first)
    by_cos, by_sin = math.cos(step), math.sin(step)
    for k in range(beams):
        if k % 64 == 0:
            cos, sin = math.cos(first + step * k), math.sin(first + step * k)
        ranges[k] = r[at + k] if r[at + k] > NEAREST_RANGE and r[at + k] < FARTHEST_RANGE else 0.0
        x[k], y[k] = ranges[k] * cos, ranges[k] * sin
        cos, sin = cos * by_cos - sin * by_sin, sin * by_cos + cos * by_sin
    turn = abs(step)
    closed = 1 if abs(turn * beams - TURN) < 1.5 * turn else 0
    lag = (end - begin) / (beams - 1) if beams > 1 else 0.0
    last = -1
    for k in range(beams):
        if ranges[k] == 0.0:
            continue
        if last >= 0:
            dx, dy = x[k] - x[last], y[k] - y[last]
            if dx * dx + dy * dy < GRAIN * GRAIN:
                continue
        last = k
        i = points.count
        points.x[i], points.y[i], points.r[i] = x[k], y[k], ranges[k]
        points.late[i] = begin + lag * k
        points.line[i] = 0
        points.nx[i] = points.ny[i] = 0.0
        if fit_line(points, i, k, beams, closed, turn):
            points.count += 1
    if points.count > MAX_POINTS:
        for i in range(MAX_POINTS):
            k = i * points.count // MAX_POINTS
            points.x[i], points.y[i], points.r[i], points.late[i] = (points.x[k], points.y[k], points.r[k], points.late[k])
            points.nx[i], points.ny[i], points.line[i] = points.nx[k], points.ny[k], points.line[k]
        points.count = MAX_POINTS


def fit_line(points: Outline, i: int, k: int, beams: int, closed: int, turn: float) -> int:
    """Find the normal of the wall at beam k, for point i; return 0 if the point is not to be used."""
    x, y, r = points.beam_x, points.beam_y, points.beam_r
    spacing = max(r[k] * turn, 1e-4)
    most = int(math.ceil(min(LINE_REACH / spacing, 1e6)))  # noqa: RUF046
    most = max(min(most, MAX_NEIGHBOURS), MIN_NEIGHBOURS)
    gap = max(GAP, GAP_BEAMS * spacing)
    sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    number, fewest = 1, beams
    for side in range(2):
        d = 2 * side - 1
        before, taken = k, 0
        for q in range(1, most + 1):
            j = adjacent_beam(k + d * q, beams, closed)
            if j < 0 or r[j] == 0.0:
                break
            dx, dy = x[j] - x[before], y[j] - y[before]
            if dx * dx + dy * dy > gap * gap:
                break
            dx, dy = x[j] - x[k], y[j] - y[k]
            sx += dx
            sy += dy
            sxx += dx * dx
            sxy += dx * dy
            syy += dy * dy
            before = j
            taken += 1
        number += taken
        fewest = min(fewest, taken)
    if fewest >= MIN_NEIGHBOURS:
        mx, my = sx / number, sy / number
        a, b, c = sxx / number - mx * mx, sxy / number - mx * my, syy / number - my * my
        root = math.sqrt(0.25 * (a - c) * (a - c) + b * b)
        across, along = 0.5 * (a + c) - root, 0.5 * (a + c) + root
        if across < LINE_VAR + LINE_VAR_GROWS * r[k] * r[k] and along > STRETCHED * across:
            bearing = 0.5 * math.atan2(2.0 * b, a - c)
            set_normal(points, i, -math.sin(bearing), math.cos(bearing))
            return 1
    # Walls observed at a flat angle: in 1/r three beams of a line are even.
    one, other = adjacent_beam(k - 1, beams, closed), adjacent_beam(k + 1, beams, closed)
    left, right = adjacent_beam(k - 2, beams, closed), adjacent_beam(k + 2, beams, closed)
    u, v = -1, -1
    if is_even(points, one, k, other, turn):
        u, v = one, other
    elif is_even(points, left, one, k, turn):
        u, v = left, k
    elif is_even(points, k, other, right, turn):
        u, v = k, right
    if u >= 0:
        dx, dy = x[v] - x[u], y[v] - y[u]
        chord = math.sqrt(dx * dx + dy * dy)
        if chord > 2.0 * spacing:
            set_normal(points, i, -dy / chord, dx / chord)
            if chord > LONGEST_CHORD:
                return 0
    return 1


def adjacent_beam(k: int, beams: int, closed: int) -> int:
    """Return the beam at a position, -1 beyond the ends of a sweep that is no full circle."""
    if k >= 0 and k < beams:
        return k
    if closed and k >= -beams and k < 2 * beams:
        return k + beams if k < 0 else k - beams
    return -1


def is_even(points: Outline, one: int, middle: int, other: int, turn: float) -> int:
    """Return 1 if three beams lie on one line."""
    r = points.beam_r
    if one < 0 or middle < 0 or other < 0 or r[one] == 0.0 or r[middle] == 0.0 or r[other] == 0.0:
        return 0
    between = 2.0 * math.cos(turn) / (1.0 / r[one] + 1.0 / r[other])
    return 1 if abs(between - r[middle]) < EVEN else 0


def set_normal(points: Outline, i: int, nx: float, ny: float) -> None:
    """Make point i one of a wall, whose normal looks towards the sensor."""
    sign = -1.0 if nx * points.x[i] + ny * points.y[i] > 0.0 else 1.0
    points.nx[i], points.ny[i], points.line[i] = sign * nx, sign * ny, 1


def deskew(points: Outline, vx: float, vy: float, vyaw: float) -> None:
    """Place all points as observed from where the sensor was at the header stamp, for a velocity in its frame."""
    if not points.takes_time:
        for i in range(points.count):
            points.at_x[i], points.at_y[i] = points.x[i], points.y[i]
            points.at_nx[i], points.at_ny[i] = points.nx[i], points.ny[i]
        return
    for i in range(points.count):
        dx, dy, turn = driven(vx, vy, vyaw, points.late[i])
        cos, sin = math.cos(turn), math.sin(turn)
        points.at_x[i] = dx + cos * points.x[i] - sin * points.y[i]
        points.at_y[i] = dy + sin * points.x[i] + cos * points.y[i]
        points.at_nx[i] = cos * points.nx[i] - sin * points.ny[i]
        points.at_ny[i] = sin * points.nx[i] + cos * points.ny[i]


def driven(vx: float, vy: float, vyaw: float, seconds: float) -> tuple[float, float, float]:
    """Return the step that a constant velocity makes, along an arc."""
    turn = vyaw * seconds
    ahead, aside = 1.0, 0.0
    if abs(turn) > TINY:
        ahead, aside = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn
    return seconds * (vx * ahead - vy * aside), seconds * (vx * aside + vy * ahead), turn


def velocity_of(x: float, y: float, yaw: float, seconds: float) -> tuple[float, float, float]:
    """Return the constant velocity that makes a step: the inverse of `driven`."""
    half = 0.5 * yaw
    along = half / math.tan(half) if abs(half) > TINY else 1.0
    return (along * x + half * y) / seconds, (along * y - half * x) / seconds, yaw / seconds


def step_between(x: float, y: float, yaw: float, to_x: float, to_y: float, to_yaw: float) -> tuple[float, float, float]:
    """Return the step from one pose to another, in the frame of the first."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = to_x - x, to_y - y
    return cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(to_yaw - yaw, TURN)


def pose_after(x: float, y: float, yaw: float, dx: float, dy: float, turn: float) -> tuple[float, float, float]:
    """Return the pose after a step in the frame of a pose."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + cos * dx - sin * dy, y + sin * dx + cos * dy, math.remainder(yaw + turn, TURN)


def copy_outline(to: Outline, of: Outline) -> None:
    """Write the points of one sweep over those of another."""
    to.count, to.takes_time = of.count, of.takes_time
    for i in range(of.count):
        to.x[i], to.y[i], to.nx[i], to.ny[i] = of.x[i], of.y[i], of.nx[i], of.ny[i]
        to.late[i], to.r[i], to.line[i] = of.late[i], of.r[i], of.line[i]
