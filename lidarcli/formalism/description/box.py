"""The oriented bounding box of an object (§3, Fig. 6): the smaller of those with a side along one of its longest faces."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism.description.shape import Look
from lidarcli.formalism.surfaces.faces import Faces

RIGHT_ANGLE = math.radians(5.0)
"""[rad] Faces closer to a right angle than this propose the same box."""
SIN_TWICE = math.sin(2.0 * RIGHT_ANGLE)
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
    """The square around a circle that faces the sensor."""
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
    """The bounds of points along a direction and across it [m]."""
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
    """Direction of a side [rad]. A side and its opposite are one: that which points forward tells."""
    if x < 0.0 or (x == 0.0 and y < 0.0):
        x, y = -x, -y
    return math.atan2(y + 0.0, x + 0.0)
