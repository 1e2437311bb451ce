"""The oriented bounding box of an object (§3, Fig. 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.faces import Faces
from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import span_first, span_max, span_min, spans
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
    points: Cloud, index: Int64, owner: Int64, offsets: Int64, faces: Faces, face: Int64, face_offsets: Int64
) -> Boxes:
    """The smaller of the rectangles around each object that have a side along one of its two longest faces.

    Parameters
    ----------
    points : the points of the batch
    index, owner, offsets : the points of K objects, joined
    faces : all faces; object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`

    Returns
    -------
    Boxes of K objects
    """
    x, y = points.x[index], points.y[index]
    longest, second = _two_longest(faces, face, face_offsets)
    first, last = offsets[:-1], offsets[1:] - 1
    # Objects of a single point have no face, and there may be no others: -1 then finds the 0 at the end.
    angles = np.append(faces.angle, 0.0)
    angle = np.where(longest >= 0, angles[longest], np.arctan2(y[last] - y[first], x[last] - x[first]))
    rectangle = _rectangle(x, y, angle, owner, offsets)
    # A second direction matters only where the two longest faces are not at right angles anyway.
    turn = np.abs(np.sin(2.0 * (angles[second] - angle)))
    oblique = np.flatnonzero((second >= 0) & (turn > np.sin(2.0 * RIGHT_ANGLE)))
    part, part_owner, part_offsets = spans(first[oblique], np.diff(offsets)[oblique])
    other = _rectangle(x[part], y[part], faces.angle[second[oblique]], part_owner, part_offsets)
    better = other.area < (1.0 - TIE) * rectangle.area[oblique]
    for name in ("angle", "low_u", "high_u", "low_v", "high_v"):
        getattr(rectangle, name)[oblique[better]] = getattr(other, name)[better]
    angle, low_u, high_u = rectangle.angle, rectangle.low_u, rectangle.high_u
    low_v, high_v = rectangle.low_v, rectangle.high_v
    middle_u, middle_v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
    cos, sin = np.cos(angle), np.sin(angle)
    length, width = high_u - low_u, high_v - low_v
    turn = width > length
    yaw = np.where(turn, angle + 0.5 * np.pi, angle)
    return Boxes(
        x=middle_u * cos - middle_v * sin,
        y=middle_u * sin + middle_v * cos,
        length=np.where(turn, width, length),
        width=np.where(turn, length, width),
        yaw=0.5 * np.pi - (0.5 * np.pi - yaw) % np.pi,
    )


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """(K,) each: bounds along the direction `angle` [rad] and across it [m]."""

    angle: Float64
    low_u: Float64
    high_u: Float64
    low_v: Float64
    high_v: Float64

    @property
    def area(self) -> Float64:
        area: Float64 = (self.high_u - self.low_u) * (self.high_v - self.low_v)
        return area


def _rectangle(x: Float64, y: Float64, angle: Float64, owner: Int64, offsets: Int64) -> _Rectangle:
    """Bounds of the points of each object in the direction `angle` (K,)."""
    cos, sin = np.cos(angle)[owner], np.sin(angle)[owner]
    along, across = x * cos + y * sin, y * cos - x * sin
    return _Rectangle(
        angle.copy(),
        span_min(along, offsets),
        span_max(along, offsets),
        span_min(across, offsets),
        span_max(across, offsets),
    )


def _two_longest(faces: Faces, face: Int64, face_offsets: Int64) -> tuple[Int64, Int64]:
    """The longest face of each object and the next longest, -1 where there is none. (K,) each."""
    sizes = np.diff(face_offsets)
    longest, second = np.full(len(sizes), -1), np.full(len(sizes), -1)
    some = np.flatnonzero(sizes > 0)
    if not len(some):
        return longest, second
    offsets = np.append(face_offsets[some], len(face))
    owner = np.repeat(np.arange(len(some)), sizes[some])
    length = faces.length[face].copy()
    best = span_first(length == span_max(length, offsets)[owner], owner, len(some))
    longest[some] = face[best]
    length[best] = -1.0
    many = sizes[some] > 1
    next_best = span_first(length == span_max(length, offsets)[owner], owner, len(some))
    second[some[many]] = face[next_best[many]]
    return longest, second
