"""The oriented bounding box of an object (§3, Fig. 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.circle import Circles
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.ragged import span_bounds, span_first, span_max, spans
from lidarcli.sweeps import Float64, Int64

RIGHT_ANGLE = np.deg2rad(5.0)
"""Faces closer to a right angle than this propose the same box."""
TIE = 1e-9
"""Areas that differ by less than this share are equal, as for any two sides of a triangle: rounding must not choose."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """(K,) each: centre [m], length ≥ width [m], yaw of the long side in (-π/2, π/2] [rad]."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    yaw: Float64


def bounding_boxes(
    x: Float64,
    y: Float64,
    offsets: Int64,
    faces: Faces,
    face: Int64,
    face_offsets: Int64,
    round_ones: Int64,
    circles: Circles,
) -> Boxes:
    """The smaller of the rectangles around each object that have a side along one of its two longest faces.

    The box of a round object is the square around its circle that faces the sensor.

    Parameters
    ----------
    x, y, offsets : the points or vertices of K objects, joined [m]
    faces : all faces; object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`
    round_ones, circles : (C,) objects that are round, and their circles

    Returns
    -------
    Boxes of K objects
    """
    longest, second = _two_longest(faces, face, face_offsets)
    first, last = offsets[:-1], offsets[1:] - 1
    # Objects of a single point have no face, and there may be no others: -1 then finds the 0 at the end.
    angles = np.append(faces.angle, 0.0)
    angle = angles[longest]
    alone = np.flatnonzero(longest < 0)
    angle[alone] = np.arctan2(y[last[alone]] - y[first[alone]], x[last[alone]] - x[first[alone]])
    low_u, high_u, low_v, high_v = bounds = _rectangle(x, y, angle, offsets)
    # A second direction matters only where the two longest faces are not at right angles anyway.
    turn = np.abs(np.sin(2.0 * (angles[second] - angle)))
    oblique = np.flatnonzero((second >= 0) & (turn > np.sin(2.0 * RIGHT_ANGLE)))
    part, _, part_offsets = spans(first[oblique], np.diff(offsets)[oblique])
    other_angle = angles[second[oblique]]
    others = _rectangle(x[part], y[part], other_angle, part_offsets)
    better = _area(others) < (1.0 - TIE) * _area(bounds)[oblique]
    for values, other in zip((*bounds, angle), (*others, other_angle), strict=True):
        values[oblique[better]] = other[better]
    middle_u, middle_v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
    cos, sin = np.cos(angle), np.sin(angle)
    length, width = high_u - low_u, high_v - low_v
    turn = width > length
    yaw = np.where(turn, angle + 0.5 * np.pi, angle)
    boxes = Boxes(
        x=middle_u * cos - middle_v * sin,
        y=middle_u * sin + middle_v * cos,
        length=np.where(turn, width, length),
        width=np.where(turn, length, width),
        yaw=0.5 * np.pi - (0.5 * np.pi - yaw) % np.pi,
    )
    boxes.x[round_ones], boxes.y[round_ones] = circles.x, circles.y
    boxes.length[round_ones] = boxes.width[round_ones] = 2.0 * circles.radius
    bearing = np.arctan2(circles.y, circles.x)
    boxes.yaw[round_ones] = 0.5 * np.pi - (0.5 * np.pi - bearing) % np.pi
    return boxes


def _rectangle(
    x: Float64, y: Float64, angle: Float64, offsets: Int64
) -> tuple[Float64, Float64, Float64, Float64]:
    """Bounds of the points of each object in the direction `angle` (K,) and across it [m]: low, high, low, high."""
    size = np.diff(offsets)
    cos, sin = np.repeat(np.cos(angle), size), np.repeat(np.sin(angle), size)
    along, across = x * cos, y * cos
    along += y * sin
    across -= x * sin
    return *span_bounds(along, offsets), *span_bounds(across, offsets)


def _area(bounds: tuple[Float64, Float64, Float64, Float64]) -> Float64:
    """(K,) areas of rectangles given by their bounds [m²]."""
    low_u, high_u, low_v, high_v = bounds
    area: Float64 = (high_u - low_u) * (high_v - low_v)
    return area


def _two_longest(faces: Faces, face: Int64, face_offsets: Int64) -> tuple[Int64, Int64]:
    """The longest face of each object and the next longest, -1 where there is none. (K,) each."""
    sizes = np.diff(face_offsets)
    longest, second = np.full(len(sizes), -1), np.full(len(sizes), -1)
    some = np.flatnonzero(sizes > 0)
    longest[some] = face[face_offsets[some]]
    many = np.flatnonzero(sizes > 1)
    index, _, offsets = spans(face_offsets[many], sizes[many])
    length = faces.length[face[index]]
    best = span_first(length == np.repeat(span_max(length, offsets), sizes[many]), offsets)
    longest[many] = face[index[best]]
    length[best] = -1.0
    best = span_first(length == np.repeat(span_max(length, offsets), sizes[many]), offsets)
    second[many] = face[index[best]]
    return longest, second
