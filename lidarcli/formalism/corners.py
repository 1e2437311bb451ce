"""Definition 6 for real sensors: corners are jumps of f' between straight faces, not every kink that noise makes."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.faces import Columns, Faces, Outline, lines_between, outline, split_straight
from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import offsets_of
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

PASSES = 4
"""Flat vertices are dropped one neighbourhood at a time; more passes than this are never needed in practice."""
BLUNT = np.deg2rad(20.0)
"""Lines closer to parallel than this meet too far away to say where the corner is."""


def settled_faces(runs: Runs, chosen: Bool, tolerance: Float64) -> Faces:
    """Straight faces of the chosen runs whose vertices stand out between their neighbours, one for each corner.

    Splitting at the farthest point leaves vertices that are flat once their neighbours are known, and two of them
    where a corner lies between two beams.

    Parameters
    ----------
    runs : R runs
    chosen : (R,) which runs have faces
    tolerance : (R,) metres
    """
    cloud = runs.points
    return Faces(*settled(runs.first, runs.size, chosen, cloud.x, cloud.y, tolerance, np.sin(BLUNT)))


@compiled
def settled(
    first: Int64, size: Int64, chosen: Bool, x: Float64, y: Float64, tolerance: Float64, blunt: float
) -> Columns:
    """Columns of the `settled_faces` of R runs of points at x, y [m]; `blunt` is the sine of the least usable angle."""
    shape = outline(first, size, np.where(chosen, size, 0), x, y)
    inner = _standing(shape, split_straight(shape, tolerance), tolerance)
    columns = lines_between(shape, inner)
    double = _doubled(shape, inner, Faces(*columns), blunt)
    if not len(double):
        return columns
    inner[double] = False
    return lines_between(shape, inner)


def _standing(shape: Outline, inner: Bool, tolerance: Float64) -> Bool:
    """(L,) the inner vertices without the flat ones, of which neighbours never go in the same pass."""
    at, run, is_inner = _vertices(shape, inner)
    x, y = shape.x[at], shape.y[at]
    tolerance = tolerance[run]
    for _ in range(PASSES):
        flat = _flat(x, y, is_inner, tolerance)
        if not len(flat):
            break
        kept = np.ones(len(at), bool)
        kept[flat] = False
        at, is_inner, x, y, tolerance = at[kept], is_inner[kept], x[kept], y[kept], tolerance[kept]
    standing = np.zeros(len(inner), bool)
    standing[at[is_inner]] = True
    return standing


def _vertices(shape: Outline, inner: Bool) -> tuple[Int64, Int64, Bool]:
    """All vertices of the outline with two neighbours: their indices, runs, and which of them are inner ones."""
    filled = np.flatnonzero(np.diff(shape.start))
    first = shape.start[filled]
    marked = inner.copy()
    marked[first] = True
    marked[shape.start[filled + 1] - 1] = True
    at = np.flatnonzero(marked)
    begins = np.zeros(len(inner), bool)
    begins[first] = True
    return at, filled[np.cumsum(begins[at]) - 1], inner[at]


def _flat(x: Float64, y: Float64, inner: Bool, tolerance: Float64) -> Int64:
    """Which of N vertices in their order are inner ones within the tolerance of their neighbours' chord, and flatter
    than both."""
    mid = np.flatnonzero(inner)
    chord_x, chord_y = x[mid + 1] - x[mid - 1], y[mid + 1] - y[mid - 1]
    dx, dy = x[mid] - x[mid - 1], y[mid] - y[mid - 1]
    length = np.sqrt(chord_x * chord_x + chord_y * chord_y)
    wide = length > tolerance[mid]
    share = np.full(len(x), np.inf)
    share[mid[wide]] = np.abs(dx * chord_y - dy * chord_x)[wide] / length[wide]
    share /= tolerance
    lowest = (share[mid] < share[mid - 1]) & (share[mid] <= share[mid + 1])
    return mid[(share[mid] <= 1.0) & lowest]


def _doubled(shape: Outline, inner: Bool, faces: Faces, blunt: float) -> Int64:
    """Of two vertices on neighbouring points, the one further from where the faces beside them meet."""
    alike = faces.run[1:] == faces.run[:-1]
    many = faces.points > 2
    short = 1 + np.flatnonzero(alike[:-1] & alike[1:] & (faces.points[1:-1] == 2) & many[:-2] & many[2:])
    meet_x, meet_y, meet = _meeting(faces, short - 1, short + 1, blunt)
    # Where the points of the short faces are in the outline, of which no point is left out.
    begin = shape.start[faces.run[short]]
    first, last = (begin + point[short] - shape.index[begin] for point in (faces.first, faces.last))
    start = np.square(shape.x[first] - meet_x) + np.square(shape.y[first] - meet_y)
    end = np.square(shape.x[last] - meet_x) + np.square(shape.y[last] - meet_y)
    near = meet & (np.minimum(start, end) < np.square(2.0 * faces.length[short]))
    double: Int64 = np.where(start > end, first, last)[near]
    return double


def _meeting(faces: Faces, one: Int64, other: Int64, blunt: float) -> tuple[Float64, Float64, Bool]:
    """Where the lines of two faces meet: x, y [m], and whether they do at a usable angle."""
    ax, ay, bx, by = (
        faces.direction_x[one],
        faces.direction_y[one],
        faces.direction_x[other],
        faces.direction_y[other],
    )
    cross = ax * by - ay * bx
    usable = np.abs(cross) > blunt
    dx, dy = faces.middle_x[other] - faces.middle_x[one], faces.middle_y[other] - faces.middle_y[one]
    along = (dx * by - dy * bx) / np.where(usable, cross, 1.0)
    return faces.middle_x[one] + along * ax, faces.middle_y[one] + along * ay, usable


@record
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


def locate(cloud: Cloud, faces: Faces, tolerance: Float64) -> Corners:
    """Find the corners of R runs with F faces, no further than `tolerance` (R,) and two beams from their points."""
    return Corners(*located(cloud.x, cloud.y, faces, tolerance, np.sin(BLUNT)))


@compiled
def located(
    cloud_x: Float64, cloud_y: Float64, faces: Faces, tolerance: Float64, blunt: float
) -> tuple[Int64, Bool, Float64, Float64]:
    """Columns of `Corners`; `blunt` is the sine of the least usable angle."""
    count = np.diff(faces.offsets)
    offsets = offsets_of(np.where(count > 0, count + 1, 0))
    x, y = np.empty(offsets[-1]), np.empty(offsets[-1])
    begin = offsets[:-1][count > 0]
    first = faces.first[faces.offsets[:-1][count > 0]]
    follows = np.ones(len(x), bool)
    follows[begin] = False
    x[begin], y[begin] = _on_line(faces, faces.offsets[:-1][count > 0], cloud_x[first], cloud_y[first])
    x[follows], y[follows] = _on_line(faces, np.arange(len(faces)), cloud_x[faces.last], cloud_y[faces.last])
    one = np.flatnonzero(faces.run[:-1] == faces.run[1:])
    meet_x, meet_y, usable = _meeting(faces, one, one + 1, blunt)
    usable &= (faces.points[one] > 2) & (faces.points[one + 1] > 2)
    at = np.flatnonzero(follows)[one]
    spacing = np.minimum(faces.length[one] / faces.points[one], faces.length[one + 1] / faces.points[one + 1])
    dx, dy = meet_x - x[at], meet_y - y[at]
    usable &= np.sqrt(dx * dx + dy * dy) <= tolerance[faces.run[one]] + 2.0 * spacing
    moved = np.zeros(len(x), bool)
    moved[at[usable]] = True
    x[at[usable]], y[at[usable]] = meet_x[usable], meet_y[usable]
    return offsets, moved, x, y
