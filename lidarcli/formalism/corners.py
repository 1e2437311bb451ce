"""Definition 6 for real sensors: corners are jumps of f' between straight faces, not every kink that noise makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.faces import Faces, Outline, faces_between
from lidarcli.formalism.ragged import offsets_of, spans
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
    inner = _standing(shape, inner, tolerance)
    faces = faces_between(shape, inner)
    double = _doubled(shape, inner, faces)
    if len(double):
        inner[double] = False
        faces = _refitted(shape, inner, faces, np.searchsorted(shape.start, double, side="right") - 1)
    return inner, faces


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


def _refitted(shape: Outline, inner: Bool, faces: Faces, runs: Int64) -> Faces:
    """The faces again where `runs` have lost inner vertices; those of all other runs are as before."""
    changed = np.flatnonzero(np.bincount(runs))
    index, _, start = spans(shape.start[changed], np.diff(shape.start)[changed])
    part = Outline(shape.cloud, shape.index[index], start, shape.x[index], shape.y[index])
    fresh = faces_between(part, inner[index])
    count, after = np.diff(faces.offsets), np.diff(fresh.offsets)
    gone, _, _ = spans(faces.offsets[changed] + after, count[changed] - after)
    kept = np.ones(len(faces), bool)
    kept[gone] = False
    count[changed] = after
    offsets = offsets_of(count)
    place, _, _ = spans(offsets[changed], after)
    columns = {name: getattr(faces, name)[kept] for name in Faces.__slots__ if name != "offsets"}
    for name in columns.keys() - {"run"}:
        columns[name][place] = getattr(fresh, name)
    return Faces(**columns, offsets=offsets)


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
