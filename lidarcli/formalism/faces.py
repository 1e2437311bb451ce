"""Definition 7: the faces of a run, the straight or curved stretches between consecutive vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.ragged import offsets_of, span_max_positive, spans
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

MAX_SPLITS = 24
"""Levels of splitting; a run of n points needs log2 n, a jagged one more."""


Columns = tuple[Int64, Int64, Int64, Int64, Float64, Float64, Float64, Float64, Float64, Float64, Int64]
"""Of `Faces`, in the order of its fields."""


@record
class Faces:
    """F faces of the runs of a batch, in order; consecutive faces of a run share the vertex between them.

    The straight line of a face is given by its middle and direction: total least squares over its points.
    """

    run: Int64
    """(F,) the run a face belongs to."""
    first: Int64
    """(F,) index of the point where it starts."""
    last: Int64
    """(F,) index of the point where it ends."""
    points: Int64
    """(F,) number of points its line was fitted to."""
    middle_x: Float64
    middle_y: Float64
    direction_x: Float64
    """(F,) unit vector along the face, from its first to its last point."""
    direction_y: Float64
    rms: Float64
    """(F,) root mean square distance of its points from the line [m]."""
    length: Float64
    """(F,) distance of its end points along the line [m]."""
    offsets: Int64
    """(R + 1,) faces of run j are `offsets[j]:offsets[j + 1]`."""

    def __len__(self) -> int:
        return len(self.run)

    def turn(self, one: Int64, other: Int64) -> Float64:
        """Sine of the angle by which the faces `other` turn left from the faces `one`."""
        turn: Float64 = self.direction_x[one] * self.direction_y[other]
        turn -= self.direction_y[one] * self.direction_x[other]
        return turn


def straight_faces(runs: Runs, most: Int64, tolerance: Float64) -> Faces:
    """The faces of runs that are split until every point is near the chord of its face.

    Parameters
    ----------
    runs : R runs
    most : (R,) to about how many points each is thinned evenly before; a run of fewer than 2 has no face
    tolerance : (R,) metres
    """
    cloud = runs.points
    return Faces(*straight(runs.first, runs.size, most, cloud.x, cloud.y, tolerance))


@compiled
def straight(first: Int64, size: Int64, most: Int64, x: Float64, y: Float64, tolerance: Float64) -> Columns:
    """Columns of the `straight_faces` of R runs of points at x, y [m]."""
    shape = outline(first, size, most, x, y)
    return lines_between(shape, split_straight(shape, tolerance))


def faces_between(runs: Runs, inner: Bool) -> Faces:
    """The faces between consecutive vertices (Def. 7), each with its straight line.

    Parameters
    ----------
    runs : R runs over M points
    inner : (M,) True at the inner vertices

    Returns
    -------
    Faces; a run of one point has no face
    """
    return Faces(*between(runs.first, runs.size, runs.points.x, runs.points.y, inner))


@compiled
def between(first: Int64, size: Int64, x: Float64, y: Float64, inner: Bool) -> Columns:
    """Columns of the `faces_between` vertices of R runs of points at x, y [m]."""
    shape = outline(first, size, size, x, y)
    return lines_between(shape, inner[shape.index])


@record
class Outline:
    """The points that stand for each run when its faces are sought: none, or at least its first and last."""

    index: Int64
    """(L,) indices of the points."""
    start: Int64
    """(R + 1,) run j has the points `index[start[j]:start[j + 1]]`."""
    x: Float64
    """(L,) forward [m]."""
    y: Float64
    """(L,) left [m]."""


def outline(first: Int64, size: Int64, most: Int64, x: Float64, y: Float64) -> Outline:
    """The points of each run, thinned evenly to about `most` (R,); a run of fewer than 2, or for which that is less,
    has none."""
    last, size = first + size - 1, np.where((most < 2) | (size < 2), 0, size)
    large = np.flatnonzero(size > most)
    stride = -(-size[large] // most[large])
    size[large] = -(-(size[large] - 1) // stride) + 1
    start = offsets_of(size)
    index = np.arange(start[-1])
    index += np.repeat(first - start[:-1], size)
    if len(large):
        at, owner, _ = spans(start[large], size[large])
        step = (at - start[large][owner]) * stride[owner]
        index[at] = np.minimum(first[large][owner] + step, last[large][owner])
    return Outline(index, start, x[index], y[index])


def split_straight(shape: Outline, tolerance: Float64) -> Bool:
    """Mark the points where the faces of each run meet (iterative end point fit, all runs at once).

    A stretch splits at its point farthest from the chord, as long as that distance exceeds the tolerance.

    Parameters
    ----------
    shape : outline of R runs, L points
    tolerance : (R,) metres

    Returns
    -------
    (L,) True at inner vertices; the first and last point of a run are not marked
    """
    x, y = shape.x, shape.y
    inner = np.zeros(len(x), bool)
    size = np.diff(shape.start)
    worth = np.flatnonzero(size > 2)
    begin, size, tolerance = shape.start[worth], size[worth], tolerance[worth]
    # First the whole runs, then ever fewer parts of them, each without its ends.
    end = begin + size - 1
    size -= 2
    for _ in range(MAX_SPLITS):
        if not len(begin):
            break
        index, owner, offsets = spans(begin + 1, size)
        away = _distance_from_chord(x, y, begin, end, tolerance, index, owner)
        farthest = span_max_positive(away, offsets)
        split = np.flatnonzero(farthest > tolerance)
        if not len(split):
            break
        threshold = np.full(len(begin), np.inf)
        threshold[split] = farthest[split]
        at = np.flatnonzero(away == np.repeat(threshold, size))
        middle = index[at[np.searchsorted(at, offsets[split])]]
        inner[middle] = True
        # Both parts of each, of which those with an inner point of their own are worth a look.
        begin, end = _pairs(begin[split], middle), _pairs(middle, end[split])
        size = end - begin - 1
        worth = np.flatnonzero(size)
        begin, end, size = begin[worth], end[worth], size[worth]
        tolerance = tolerance[split[worth >> 1]]
    return inner


def _pairs(one: Int64, other: Int64) -> Int64:
    """(2 J,) the values of both, in turns."""
    pairs = np.empty((len(one), 2), np.int64)
    pairs[:, 0], pairs[:, 1] = one, other
    return pairs.reshape(-1)


def _distance_from_chord(
    x: Float64, y: Float64, begin: Int64, end: Int64, tolerance: Float64, index: Int64, owner: Int64
) -> Float64:
    """Distance of the points `index` from the chord `begin … end` of the stretch that owns them; from its start where
    the chord is a point."""
    x0, y0 = x[begin], y[begin]
    chord_x, chord_y = x[end] - x0, y[end] - y0
    length = np.sqrt(chord_x * chord_x + chord_y * chord_y)
    closed = length < tolerance
    length[closed] = 1.0
    scale = 1.0 / length
    normal_x, normal_y = chord_y * scale, -chord_x * scale
    away = normal_x[owner] * x[index]
    away += normal_y[owner] * y[index]
    away -= (x0 * normal_x + y0 * normal_y)[owner]
    np.abs(away, out=away)
    at = np.flatnonzero(closed[owner])
    dx, dy = x[index[at]] - x0[owner[at]], y[index[at]] - y0[owner[at]]
    away[at] = np.sqrt(dx * dx + dy * dy)
    return away


def lines_between(shape: Outline, inner: Bool) -> Columns:
    """Columns of the faces between consecutive vertices of an outline, of which `inner` (L,) marks the inner ones."""
    x, y, start = shape.x, shape.y, shape.start
    filled = np.flatnonzero(start[1:] > start[:-1])
    begins = inner.copy()
    begins[start[filled]] = True
    first = np.flatnonzero(begins)
    size = np.diff(first, append=len(x))
    inside = inner[first]
    run = filled[np.cumsum(~inside) - 1]
    # The vertex between two faces belongs to both.
    size[:-1] += inside[1:]
    last = first + size - 1
    return (
        run,
        shape.index[first],
        shape.index[last],
        size,
        *_fit(x, y, first, size),
        offsets_of(np.bincount(run, minlength=len(start) - 1)),
    )


def _fit(
    x: Float64, y: Float64, first: Int64, size: Int64
) -> tuple[Float64, Float64, Float64, Float64, Float64, Float64]:
    """Total least squares lines through `size[j]` points from `first[j]` on: middle, direction, rms, length, (J,) each."""
    index, owner, _ = spans(first, size)
    # Moments about the first point, moved to the middle afterwards: one pass, and accurate because it is near.
    x0, y0 = x[first], y[first]
    dx, dy = x[index] - x0[owner], y[index] - y0[owner]
    share = 1.0 / size
    mean_x, mean_y, xy, xx, yy = (
        np.bincount(owner, values, len(first)) * share for values in (dx, dy, dx * dy, dx * dx, dy * dy)
    )
    xy, xx, yy = xy - mean_x * mean_y, xx - mean_x * mean_x, yy - mean_y * mean_y
    half = 0.5 * (xx - yy)
    root = np.sqrt(half * half + xy * xy)
    rms = np.sqrt(np.maximum(0.5 * (xx + yy) - root, 0.0))
    # The line has half the angle of (half, xy); where all points are one, any.
    far = root + np.abs(half)
    norm = np.sqrt(far * far + xy * xy)
    scale = np.where(norm > 0.0, 1.0 / np.where(norm > 0.0, norm, 1.0), 0.0)
    along, across = np.where(norm > 0.0, far * scale, 1.0), xy * scale
    direction_x, direction_y = np.where(half >= 0.0, along, across), np.where(half >= 0.0, across, along)
    last = first + size - 1
    length = (x[last] - x0) * direction_x + (y[last] - y0) * direction_y
    flip = np.where(length < 0.0, -1.0, 1.0)
    return x0 + mean_x, y0 + mean_y, direction_x * flip, direction_y * flip, rms, np.abs(length)
