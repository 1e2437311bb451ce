"""§3: the shape of an object (Fig. 8) and the oriented box around it (Fig. 6).

The shape is the simpler of straight faces and a circle that explains the points. Both are compared by their Bayesian
information: n log rms² + p log n, with p parameters.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import detection, surfaces
from lidarcli.formalism.objects import Parts
from lidarcli.formalism.surfaces import Faces

PRISMATIC, ROUND = detection.PRISMATIC, detection.ROUND
IRREGULAR, UNKNOWN = detection.IRREGULAR, detection.UNKNOWN

# The circle through the points of a round object: an algebraic first guess, then least squares of the true distances.

REFINEMENTS = 4
"""Gauss-Newton steps; the algebraic guess is near enough that more change nothing that matters."""
LARGEST = 2.0
"""[m] A circle larger than this is taken for a straight line: its centre is not determined."""
INFINITY = float("inf")


class Circle:
    """A circle and the `n` points it is fitted to, joined from the parts of an object."""

    def __init__(self, most: int) -> None:
        """Make room for so many points."""
        self.owner: list[Any] = []
        self.n = 0
        self.x = native.doubles(self.owner, most)
        """Points, forward [m]."""
        self.y = native.doubles(self.owner, most)
        self.centre_x = 0.0
        """[m]"""
        self.centre_y = 0.0
        self.radius = 0.0
        self.rms = INFINITY
        """Root mean square distance of the points from the circle [m]; inf where there is none."""
        # The points from their middle, from the centre, and how far they are from that.
        self.middle_x = 0.0
        self.middle_y = 0.0
        self.known = False
        self.u = native.doubles(self.owner, most)
        self.v = native.doubles(self.owner, most)
        self.from_x = native.doubles(self.owner, most)
        self.from_y = native.doubles(self.owner, most)
        self.distance = native.doubles(self.owner, most)


def fit_circle(circle: Circle, within: float) -> None:
    """The circle through the points, by the least squares of their distances from it.

    The algebraic circle (Kåsa 1976), which is too small for short noisy arcs, is the start of a Gauss-Newton descent.

    Parameters
    ----------
    within : an algebraic circle that fits worse than this [m] is not refined: its rms is inf
    """
    _algebraic(circle)
    rms = _rms(circle) if circle.known else INFINITY
    circle.rms = INFINITY
    if rms <= within:
        for _ in range(REFINEMENTS):
            _refine(circle)
        if circle.known and circle.radius < LARGEST:
            circle.rms = _rms(circle)
    circle.centre_x += circle.middle_x
    circle.centre_y += circle.middle_y


def _algebraic(circle: Circle) -> None:
    """The circle from linear equations, about the middle of the points."""
    n, u, v = circle.n, circle.u, circle.v
    sum_x, sum_y = 0.0, 0.0
    for k in range(n):
        sum_x += circle.x[k]
        sum_y += circle.y[k]
    middle_x, middle_y = sum_x / n, sum_y / n
    for k in range(n):
        u[k] = circle.x[k] - middle_x
        v[k] = circle.y[k] - middle_y
    circle.middle_x, circle.middle_y = middle_x, middle_y
    uu, vv, uv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        w = u[k] * u[k] + v[k] * v[k]
        uu += u[k] * u[k]
        vv += v[k] * v[k]
        uv += u[k] * v[k]
        uw += u[k] * w
        vw += v[k] * w
    determinant = uu * vv - uv * uv
    circle.known = determinant > 1e-9 * ((uu + vv) * (uu + vv))
    circle.centre_x = circle.centre_y = 0.0
    if circle.known:
        circle.centre_x = 0.5 * (uw * vv - vw * uv) / determinant
        circle.centre_y = 0.5 * (vw * uu - uw * uv) / determinant
    a, b = circle.centre_x, circle.centre_y
    circle.radius = math.sqrt(a * a + b * b + (uu + vv) / n)
    _measure(circle)


def _measure(circle: Circle) -> None:
    """Compute the distances and directions of the points from the centre."""
    from_x, from_y, distance = circle.from_x, circle.from_y, circle.distance
    centre_x, centre_y = circle.centre_x, circle.centre_y
    for k in range(circle.n):
        dx, dy = circle.u[k] - centre_x, circle.v[k] - centre_y
        from_x[k], from_y[k] = dx, dy
        distance[k] = math.sqrt(dx * dx + dy * dy)


def _rms(circle: Circle) -> float:
    total = 0.0
    for k in range(circle.n):
        total += (circle.distance[k] - circle.radius) * (circle.distance[k] - circle.radius)
    return math.sqrt(total / circle.n)


def _refine(circle: Circle) -> None:
    """One Gauss-Newton step; the radius is eliminated, which leaves two equations for the centre."""
    n, distance, from_x, from_y = circle.n, circle.distance, circle.from_x, circle.from_y
    mean, mean_x, mean_y = 0.0, 0.0, 0.0
    for k in range(n):
        inverse = 1.0 / max(distance[k], 1e-9)
        from_x[k] *= inverse
        from_y[k] *= inverse
    for k in range(n):
        mean += distance[k]
        mean_x += from_x[k]
        mean_y += from_y[k]
    mean, mean_x, mean_y = mean / n, mean_x / n, mean_y / n
    xx, yy, xy, rx, ry = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        jx, jy, residual = mean_x - from_x[k], mean_y - from_y[k], distance[k] - mean
        xx += jx * jx
        yy += jy * jy
        xy += jx * jy
        rx += jx * residual
        ry += jy * residual
    determinant = xx * yy - xy * xy
    circle.known = circle.known and determinant > 1e-12 * ((xx + yy) * (xx + yy))
    if circle.known:
        step_x, step_y = (ry * xy - rx * yy) / determinant, (rx * xy - ry * xx) / determinant
        # No step beyond the radius: a nearly straight arc would throw the centre to infinity.
        length = math.sqrt(step_x * step_x + step_y * step_y)
        limit = min(1.0, max(circle.radius, 1e-9) / max(length, 1e-9))
        circle.centre_x += step_x * limit
        circle.centre_y += step_y * limit
    _measure(circle)
    total = 0.0
    for k in range(n):
        total += distance[k]
    circle.radius = total / n


# The category of an object by the topology of the faces that join its vertices.

ENOUGH_BEAMS = 5
"""Least number of beams that tell a corner from an arc."""
FIT_FLOOR = 0.004
"""[m] Fits better than this count as equally good."""
STRAIGHT_FIT = 0.012
"""[m] Points of a face may scatter this much, or twice the noise."""
SQUARE = math.radians(35.0)
"""[rad] Faces of a prism meet within this of a right angle, and point their corner at the sensor."""
COS_SQUARE = math.cos(SQUARE)
MOST_FACES = 3
"""Greatest number of faces of a box that are seen, even from its inside."""
WORSE = 1.5
"""Factor by which the algebraic circle may fit worse than the best one."""
ARC = 1.0
"""A circle is believed where the chord of its arc is longer than this share of its radius: else any flat piece is one."""


class Look:
    """Fit of the faces of one object to its points."""

    def __init__(self) -> None:
        self.count = 0
        """Number of faces."""
        self.rms = 0.0
        """Root mean square distance of the points from the faces [m]; 0 without faces."""
        self.square = True
        """All faces meet at right angles that point at the sensor."""
        self.longest = -1
        """The longest face and the next longest; -1 where there is none."""
        self.second = -1


def examine(look: Look, faces: Faces, parts: Parts, k: int, without_first: bool, without_last: bool) -> None:
    """Look at the faces of an object, all of them or without the first or the last one."""
    total, weight, before = 0.0, 0.0, -1
    first = faces.offset[parts.segment[parts.begin[k]]]
    last = faces.offset[parts.segment[parts.begin[k + 1] - 1] + 1] - 1
    look.count, look.square, look.longest, look.second = 0, True, -1, -1
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if (without_first and f == first) or (without_last and f == last):
                continue
            total += faces.points[f] * (faces.rms[f] * faces.rms[f])
            weight += faces.points[f]
            # Walking counter-clockwise around the sensor, the outline turns right at a corner that points at it.
            if before >= 0 and not surfaces.turn(faces, f, before) >= COS_SQUARE:
                look.square = False
            if look.longest < 0 or faces.length[f] > faces.length[look.longest]:
                look.longest, look.second = f, look.longest
            elif look.second < 0 or faces.length[f] > faces.length[look.second]:
                look.second = f
            before = f
            look.count += 1
    look.rms = math.sqrt(total / max(weight, 1.0))


def classify(look: Look, circle: Circle, sigma: float, chord: float, mean_x: float, mean_y: float, max_width: float) -> int:
    """The shape of an object, whose circle is fitted where it may win.

    Parameters
    ----------
    sigma : noise of the ranges [m]
    chord : distance of its first point from its last [m]
    mean_x, mean_y : mean of its points [m]
    max_width : nothing is wider [m]

    Returns
    -------
    PRISMATIC, ROUND, IRREGULAR or UNKNOWN
    """
    n, allowed, level = circle.n, max(2.0 * sigma, STRAIGHT_FIT), max(0.5 * sigma, FIT_FLOOR)
    if n < ENOUGH_BEAMS:
        return UNKNOWN
    if look.count > 1 or look.rms > FIT_FLOOR:
        # A circle has three parameters, c faces have 3c - 1: so many times worse may it fit to be simpler.
        handicap = math.exp((1.5 * look.count - 2.0) * math.log(n) / n)
        rival = max(look.rms, level) * handicap
        fit_circle(circle, WORSE * rival)
        x, y = circle.centre_x, circle.centre_y
        if (
            max(circle.rms, level) < rival
            and circle.rms <= allowed
            and x * x + y * y > mean_x * mean_x + mean_y * mean_y
            and chord > ARC * circle.radius
            and 2.0 * circle.radius <= max_width
        ):
            return ROUND
    if look.square and look.count <= MOST_FACES and look.rms <= allowed:
        return PRISMATIC
    return IRREGULAR


# The oriented bounding box: the smaller of those with a side along one of its two longest faces.

RIGHT_ANGLE_TOLERANCE = math.radians(5.0)
"""[rad] Faces closer to a right angle than this propose the same box."""
SIN_TWICE = math.sin(2.0 * RIGHT_ANGLE_TOLERANCE)
SLIM = 0.05
"""[m] Where areas are compared, no side counts as less."""
TIE = 1e-9
"""Areas that differ by less than this share are equal, as for any two sides of a triangle: rounding must not choose."""


class Box:
    """A rectangle: centre [m], length ≥ width [m], yaw of the long side in (-π/2, π/2] [rad]."""

    def __init__(self) -> None:
        self.x = 0.0
        self.y = 0.0
        self.length = 0.0
        self.width = 0.0
        self.yaw = 0.0
        # Its bounds along and across a direction while it is sought.
        self.low_u = 0.0
        self.high_u = 0.0
        self.low_v = 0.0
        self.high_v = 0.0


def around_circle(box: Box, x: float, y: float, radius: float) -> None:
    """Set the square around a circle that faces the sensor."""
    box.x, box.y = x, y
    box.length = box.width = 2.0 * radius
    box.yaw = _yaw(x, y)


def around_points(box: Box, look: Look, faces: Faces, x: Any, y: Any, n: int) -> None:
    """The smaller of the rectangles around points that have a side along one of the two longest faces of an object.

    Parameters
    ----------
    x, y : of the n points [m]; without a face the first and the last of them tell the direction
    """
    if look.longest >= 0:
        along_x, along_y = faces.direction_x[look.longest], faces.direction_y[look.longest]
    else:
        along_x, along_y = x[n - 1] - x[0], y[n - 1] - y[0]
        far = math.sqrt(along_x * along_x + along_y * along_y)
        if far > 0.0:
            along_x, along_y = along_x / far, along_y / far
        else:
            along_x, along_y = 1.0, 0.0
    _bound(box, x, y, n, along_x, along_y)
    if look.second >= 0:
        other_x, other_y = faces.direction_x[look.second], faces.direction_y[look.second]
        across, along = along_x * other_y - along_y * other_x, along_x * other_x + along_y * other_y
        if abs(2.0 * across * along) > SIN_TWICE:
            area = _area(box)
            _bound(box, x, y, n, other_x, other_y)
            if _area(box) < (1.0 - TIE) * area:
                along_x, along_y = other_x, other_y
            else:
                _bound(box, x, y, n, along_x, along_y)
    u, v = 0.5 * (box.low_u + box.high_u), 0.5 * (box.low_v + box.high_v)
    box.x, box.y = u * along_x - v * along_y + 0.0, u * along_y + v * along_x + 0.0
    box.length, box.width = box.high_u - box.low_u, box.high_v - box.low_v
    if box.width > box.length:
        box.length, box.width = box.width, box.length
        along_x, along_y = -along_y, along_x
    box.yaw = _yaw(along_x, along_y)


def area_along(faces: Faces, f: int, x: Any, y: Any, begin: int, end: int) -> float:
    """Area of the rectangle along a face around the points `begin` to `end` - 1 [m²], no side below `SLIM`."""
    along_x, along_y = faces.direction_x[f], faces.direction_y[f]
    low_u = high_u = x[begin] * along_x + y[begin] * along_y
    low_v = high_v = y[begin] * along_x - x[begin] * along_y
    for k in range(begin + 1, end):
        u, v = x[k] * along_x + y[k] * along_y, y[k] * along_x - x[k] * along_y
        low_u, high_u = min(u, low_u), max(u, high_u)
        low_v, high_v = min(v, low_v), max(v, high_v)
    length, width = max(high_u - low_u, SLIM), max(high_v - low_v, SLIM)
    return float(length * width)


def _bound(box: Box, x: Any, y: Any, n: int, along_x: float, along_y: float) -> None:
    """Compute the bounds of points along a direction and across it [m]."""
    low_u = high_u = x[0] * along_x + y[0] * along_y
    low_v = high_v = y[0] * along_x - x[0] * along_y
    for k in range(1, n):
        u, v = x[k] * along_x + y[k] * along_y, y[k] * along_x - x[k] * along_y
        low_u, high_u = min(u, low_u), max(u, high_u)
        low_v, high_v = min(v, low_v), max(v, high_v)
    box.low_u, box.high_u, box.low_v, box.high_v = low_u, high_u, low_v, high_v


def _area(box: Box) -> float:
    return (box.high_u - box.low_u) * (box.high_v - box.low_v)


def _yaw(x: float, y: float) -> float:
    """Return the direction of a side [rad]; of a side and its opposite, the one that points forward."""
    if x < 0.0 or (x == 0.0 and y < 0.0):
        x, y = -x, -y
    return math.atan2(y + 0.0, x + 0.0)
