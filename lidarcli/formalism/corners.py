"""Definition 6 for real sensors: corners are jumps of f' between straight faces, not every kink that noise makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.faces import Faces, Outline, faces_between
from lidarcli.formalism.ragged import offsets_of
from lidarcli.sweeps import Bool, Float64, Int64

PASSES = 4
"""Flat vertices are dropped one neighbourhood at a time; more passes than this are never needed in practice."""
BLUNT = np.deg2rad(20.0)
"""Lines closer to parallel than this meet too far away to say where the corner is."""


def settle(shape: Outline, inner: Bool, tolerance: Float64) -> tuple[Bool, Faces]:
    """Keep only the vertices that stand out between their neighbours, one for each corner.

    Splitting at the farthest point leaves vertices that are flat once their neighbours are known, and two of them
    where a corner lies between two beams.

    Parameters
    ----------
    shape : outline of R runs, L points
    inner : (L,) inner vertices, as `faces.split_straight` marks them
    tolerance : (R,) metres

    Returns
    -------
    (L,) inner vertices, and the faces between them
    """
    for _ in range(PASSES):
        flat = _flat(shape, inner, tolerance)
        if not len(flat):
            break
        inner = inner.copy()
        inner[flat] = False
    faces = faces_between(shape, inner)
    double = _doubled(shape, inner, faces)
    if len(double):
        inner = inner.copy()
        inner[double] = False
        faces = faces_between(shape, inner)
    return inner, faces


def _vertices(shape: Outline, inner: Bool) -> tuple[Int64, Int64, Bool]:
    """All vertices of the outline with two neighbours: their indices, runs, and which of them are inner ones."""
    size = np.diff(shape.start)
    run = np.repeat(np.arange(len(size)), size)
    marked = inner.copy()
    filled = size > 0
    marked[shape.start[:-1][filled]] = True
    marked[shape.start[1:][filled] - 1] = True
    at = np.flatnonzero(marked)
    return at, run[at], inner[at]


def _flat(shape: Outline, inner: Bool, tolerance: Float64) -> Int64:
    """Inner vertices within the tolerance of the chord of their neighbours, and flatter than both."""
    at, run, is_inner = _vertices(shape, inner)
    if not is_inner.any():
        return at[:0]
    x, y = shape.cloud.x[shape.index[at]], shape.cloud.y[shape.index[at]]
    height = np.full(len(at), np.inf)
    mid = np.flatnonzero(is_inner)
    chord_x, chord_y = x[mid + 1] - x[mid - 1], y[mid + 1] - y[mid - 1]
    dx, dy = x[mid] - x[mid - 1], y[mid] - y[mid - 1]
    length = np.sqrt(chord_x * chord_x + chord_y * chord_y)
    wide = length > tolerance[run[mid]]
    height[mid[wide]] = np.abs(dx * chord_y - dy * chord_x)[wide] / length[wide]
    share = height / tolerance[run]
    lowest = (share[mid] < share[mid - 1]) & (share[mid] <= share[mid + 1])
    return at[mid[(share[mid] <= 1.0) & lowest]]


def _doubled(shape: Outline, inner: Bool, faces: Faces) -> Int64:
    """Of two vertices on neighbouring beams, the one further from where the faces beside them meet."""
    if len(faces) < 3:
        return np.flatnonzero(inner)[:0]
    before, short, after = np.arange(len(faces) - 2), np.arange(1, len(faces) - 1), np.arange(2, len(faces))
    within = (faces.run[before] == faces.run[short]) & (faces.run[short] == faces.run[after])
    tiny = within & (faces.points[short] == 2) & (faces.points[before] > 2) & (faces.points[after] > 2)
    short = short[tiny]
    x, y, meet = _meeting(faces, short - 1, short + 1)
    cloud = shape.cloud
    start = np.square(cloud.x[faces.first[short]] - x) + np.square(cloud.y[faces.first[short]] - y)
    end = np.square(cloud.x[faces.last[short]] - x) + np.square(cloud.y[faces.last[short]] - y)
    near = meet & (np.minimum(start, end) < np.square(2.0 * faces.length[short]))
    point = np.where(start > end, faces.first[short], faces.last[short])[near]
    return np.flatnonzero(inner)[np.isin(shape.index[inner], point)]


def _meeting(faces: Faces, one: Int64, other: Int64) -> tuple[Float64, Float64, Bool]:
    """Where the lines of two faces meet: x, y [m], and whether they do at a usable angle."""
    ax, ay, bx, by = (
        faces.direction_x[one],
        faces.direction_y[one],
        faces.direction_x[other],
        faces.direction_y[other],
    )
    cross = ax * by - ay * bx
    usable = np.abs(cross) > np.sin(BLUNT)
    dx, dy = faces.middle_x[other] - faces.middle_x[one], faces.middle_y[other] - faces.middle_y[one]
    along = (dx * by - dy * bx) / np.where(usable, cross, 1.0)
    return faces.middle_x[one] + along * ax, faces.middle_y[one] + along * ay, usable


@dataclass(frozen=True, slots=True)
class Corners:
    """Where the vertices of R runs are: an inner one where its faces meet, which noise moves less than the point."""

    offsets: Int64
    """(R + 1,) vertices of each run; none where it has no face."""
    moved: Bool
    """(V,) vertices that are where their faces meet; the others are on their face, beside their point."""
    x: Float64
    """(V,) forward [m]."""
    y: Float64
    """(V,) left [m]."""


def _on_line(faces: Faces, face: Int64, x: Float64, y: Float64) -> tuple[Float64, Float64]:
    """The points of the lines of `face` that are nearest to x, y [m]."""
    along_x, along_y = faces.direction_x[face], faces.direction_y[face]
    along = (x - faces.middle_x[face]) * along_x + (y - faces.middle_y[face]) * along_y
    return faces.middle_x[face] + along * along_x, faces.middle_y[face] + along * along_y


def locate(shape: Outline, faces: Faces, tolerance: Float64) -> Corners:
    """Find the corners of R runs with F faces, no further than `tolerance` (R,) and two beams from their points."""
    count = np.diff(faces.offsets)
    offsets = offsets_of(np.where(count > 0, count + 1, 0))
    cloud = shape.cloud
    x, y = np.empty(offsets[-1]), np.empty(offsets[-1])
    begin = offsets[:-1][count > 0]
    first = faces.first[faces.offsets[:-1][count > 0]]
    follows = np.ones(len(x), bool)
    follows[begin] = False
    x[begin], y[begin] = _on_line(faces, faces.offsets[:-1][count > 0], cloud.x[first], cloud.y[first])
    x[follows], y[follows] = _on_line(faces, np.arange(len(faces)), cloud.x[faces.last], cloud.y[faces.last])
    one = np.flatnonzero(faces.run[:-1] == faces.run[1:])
    meet_x, meet_y, usable = _meeting(faces, one, one + 1)
    usable &= (faces.points[one] > 2) & (faces.points[one + 1] > 2)
    at = np.flatnonzero(follows)[one]
    spacing = np.minimum(faces.length[one] / faces.points[one], faces.length[one + 1] / faces.points[one + 1])
    usable &= np.hypot(meet_x - x[at], meet_y - y[at]) <= tolerance[faces.run[one]] + 2.0 * spacing
    moved = np.zeros(len(x), bool)
    moved[at[usable]] = True
    x[at[usable]], y[at[usable]] = meet_x[usable], meet_y[usable]
    return Corners(offsets, moved, x, y)
