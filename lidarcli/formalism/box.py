"""The oriented bounding box of an object (§3, Fig. 6)."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.circle import Circles
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.members import Members
from lidarcli.formalism.outlines import Outlines
from lidarcli.formalism.ragged import span_bounds, span_first, span_max, spans
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

RIGHT_ANGLE = np.deg2rad(5.0)
"""Faces closer to a right angle than this propose the same box."""
TIE = 1e-9
"""Areas that differ by less than this share are equal, as for any two sides of a triangle: rounding must not choose."""


@record
class Boxes:
    """(K,) each: centre [m], length ≥ width [m], yaw of the long side in (-π/2, π/2] [rad]."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    yaw: Float64


def bounding_boxes(
    members: Members, outlines: Outlines, by_vertices: Bool, faces: Faces, is_round: Bool, circles: Circles
) -> Boxes:
    """The smaller of the rectangles around each object that have a side along one of its two longest faces.

    The box of a round object is the square around its circle that faces the sensor.

    Parameters
    ----------
    members, outlines : points, vertices and faces of K objects
    by_vertices : (K,) whether the box has to hold the vertices, not the points
    faces : all faces
    is_round, circles : (K,) which are round, and circles of those

    Returns
    -------
    Boxes of K objects
    """
    oblique = np.sin(2.0 * RIGHT_ANGLE)
    box_x, box_y, length, width, along_x, along_y = rectangles(
        members, outlines, by_vertices, faces, is_round, circles, oblique
    )
    return Boxes(box_x, box_y, length, width, np.arctan2(along_y, along_x))


@compiled
def rectangles(
    members: Members,
    outlines: Outlines,
    by_vertices: Bool,
    faces: Faces,
    is_round: Bool,
    circles: Circles,
    oblique: float,
) -> tuple[Float64, Float64, Float64, Float64, Float64, Float64]:
    """Boxes as `bounding_boxes` takes and returns them, but for the yaw, instead of which they have a direction.

    A second face matters only where |sin 2φ| of its angle φ with the longest is greater than `oblique`.

    Returns
    -------
    x, y, length, width, along_x, along_y : (K,) centre [m], sides [m], vector along the long side, forward
    """
    offsets, x, y = members.offsets, members.point_x, members.point_y
    direction_x, direction_y = faces.direction_x, faces.direction_y
    longest, second = _two_longest(faces.length, outlines.face, outlines.face_offsets)
    first, last = offsets[:-1], offsets[1:] - 1
    ux, uy = x[last] - x[first], y[last] - y[first]
    far = np.sqrt(ux * ux + uy * uy)
    is_point = far == 0.0
    far[is_point] = 1.0
    ux, uy = np.where(is_point, 1.0, ux / far), np.where(is_point, 0.0, uy / far)
    some = np.flatnonzero(longest >= 0)
    ux[some], uy[some] = direction_x[longest[some]], direction_y[longest[some]]
    # Points and vertices in one, of which each object has a stretch.
    begin = np.where(by_vertices, len(x) + outlines.offsets[:-1], first)
    size = np.where(by_vertices, np.diff(outlines.offsets), np.diff(offsets))
    hull = np.append(x, outlines.x), np.append(y, outlines.y)
    low_u, high_u, low_v, high_v = bounds = _bounds(*hull, begin, size, ux, uy)
    # A second direction matters only where the two longest faces are not at right angles anyway.
    two = np.flatnonzero(second >= 0)
    wx, wy = direction_x[second[two]], direction_y[second[two]]
    turn = np.abs(2.0 * (ux[two] * wy - uy[two] * wx) * (ux[two] * wx + uy[two] * wy)) > oblique
    two, wx, wy = two[turn], wx[turn], wy[turn]
    others = _bounds(*hull, begin[two], size[two], wx, wy)
    better = _area(others) < (1.0 - TIE) * _area(bounds)[two]
    for values, other in zip((*bounds, ux, uy), (*others, wx, wy), strict=True):
        values[two[better]] = other[better]
    u, v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
    along, across = high_u - low_u, high_v - low_v
    turned = across > along
    side_x = np.where(is_round, circles.x, np.where(turned, -uy, ux))
    side_y = np.where(is_round, circles.y, np.where(turned, ux, uy))
    # A side and its opposite are one: that which points forward tells the yaw.
    sign = np.where((side_x < 0.0) | (side_x == 0.0) & (side_y < 0.0), -1.0, 1.0)
    return (
        np.where(is_round, circles.x, u * ux - v * uy + 0.0),
        np.where(is_round, circles.y, u * uy + v * ux + 0.0),
        np.where(is_round, 2.0 * circles.radius, np.where(turned, across, along)),
        np.where(is_round, 2.0 * circles.radius, np.where(turned, along, across)),
        side_x * sign + 0.0,
        side_y * sign + 0.0,
    )


def _bounds(
    x: Float64, y: Float64, begin: Int64, size: Int64, along_x: Float64, along_y: Float64
) -> tuple[Float64, Float64, Float64, Float64]:
    """Bounds of the points of each object along a direction (K,) and across it [m]: low, high, low, high."""
    index, _, offsets = spans(begin, size)
    x, y, along_x, along_y = x[index], y[index], np.repeat(along_x, size), np.repeat(along_y, size)
    along, across = x * along_x + y * along_y, y * along_x - x * along_y
    return *span_bounds(along, offsets), *span_bounds(across, offsets)


def _area(bounds: tuple[Float64, Float64, Float64, Float64]) -> Float64:
    """(K,) areas of rectangles given by their bounds [m²]."""
    low_u, high_u, low_v, high_v = bounds
    area: Float64 = (high_u - low_u) * (high_v - low_v)
    return area


def _two_longest(length: Float64, face: Int64, face_offsets: Int64) -> tuple[Int64, Int64]:
    """The longest face of each object and the next longest, -1 where there is none. (K,) each."""
    sizes = np.diff(face_offsets)
    longest, second = np.full(len(sizes), -1), np.full(len(sizes), -1)
    some = np.flatnonzero(sizes > 0)
    longest[some] = face[face_offsets[some]]
    many = np.flatnonzero(sizes > 1)
    index, _, offsets = spans(face_offsets[many], sizes[many])
    far = length[face[index]]
    best = span_first(far == np.repeat(span_max(far, offsets), sizes[many]), offsets)
    longest[many] = face[index[best]]
    far[best] = -1.0
    best = span_first(far == np.repeat(span_max(far, offsets), sizes[many]), offsets)
    second[many] = face[index[best]]
    return longest, second
