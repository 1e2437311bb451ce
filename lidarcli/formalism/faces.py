"""Definition 7: the faces of a run, the straight or curved stretches between consecutive vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import offsets_of, span_max_positive, spans
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int64

MAX_SPLITS = 24
"""Levels of splitting; a run of n points needs log2 n, a jagged one more."""


@dataclass(frozen=True, slots=True)
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
    angle: Float64
    """(F,) bearing of that direction [rad]."""
    rms: Float64
    """(F,) root mean square distance of its points from the line [m]."""
    length: Float64
    """(F,) distance of its end points along the line [m]."""
    offsets: Int64
    """(R + 1,) faces of run j are `offsets[j]:offsets[j + 1]`."""

    def __len__(self) -> int:
        return len(self.run)


@dataclass(frozen=True, slots=True)
class Outline:
    """The points that stand for each run when its faces are sought: none, or at least its first and last."""

    cloud: Cloud
    index: Int64
    """(L,) indices of the points."""
    start: Int64
    """(R + 1,) run j has the points `index[start[j]:start[j + 1]]`."""
    x: Float64
    """(L,) forward [m]."""
    y: Float64
    """(L,) left [m]."""


def outline(runs: Runs, most: Int64) -> Outline:
    """The points of each run, thinned evenly to about `most` (R,); where that is less than 2, the run has none."""
    cloud = runs.points
    return Outline(cloud, *thinned(runs.first, runs.size, most, cloud.x, cloud.y))


@compiled
def thinned(
    first: Int64, size: Int64, most: Int64, x: Float64, y: Float64
) -> tuple[Int64, Int64, Float64, Float64]:
    """Of R runs of points at x, y, thinned evenly to about `most` (R,): index (L,), start (R + 1,), x and y (L,)."""
    last, size = first + size - 1, np.where(most < 2, 0, size)
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
    return index, start, x[index], y[index]


@compiled
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


def faces_between(shape: Outline, inner: Bool) -> Faces:
    """The faces between consecutive vertices (Def. 7), each with its straight line.

    Parameters
    ----------
    shape : outline of R runs, L points
    inner : (L,) True at the inner vertices

    Returns
    -------
    Faces; a run of one point has no face
    """
    lines = straight_lines(shape.x, shape.y, shape.start, inner)
    run, first, last, points, middle_x, middle_y, twice_xy, difference, rms, offsets = lines
    angle = 0.5 * np.arctan2(twice_xy, difference)
    direction_x, direction_y = np.cos(angle), np.sin(angle)
    return Faces(
        run=run,
        first=shape.index[first],
        last=shape.index[last],
        points=points,
        middle_x=middle_x,
        middle_y=middle_y,
        length=directed(shape.x, shape.y, first, last, direction_x, direction_y, angle),
        direction_x=direction_x,
        direction_y=direction_y,
        angle=angle,
        rms=rms,
        offsets=offsets,
    )


@compiled
def straight_lines(
    x: Float64, y: Float64, start: Int64, inner: Bool
) -> tuple[Int64, Int64, Int64, Int64, Float64, Float64, Float64, Float64, Float64, Int64]:
    """Total least squares lines through the points between consecutive vertices of each run.

    Returns
    -------
    run, first, last, points : (F,) the run of each, its first and last point, both vertices, and how many it has
    middle_x, middle_y : (F,) their mean [m]
    twice_xy, difference : (F,) twice the covariance, and by how much the variance of x exceeds that of y [m²]: sine and
        cosine of twice the angle of the line, but for a factor
    rms : (F,) root mean square distance of the points from the line [m]
    offsets : (R + 1,) lines of run j are `offsets[j]:offsets[j + 1]`
    """
    filled = np.flatnonzero(start[1:] > start[:-1])
    begins = inner.copy()
    begins[start[filled]] = True
    first = np.flatnonzero(begins)
    size = np.diff(first, append=len(x))
    inside = inner[first]
    run = filled[np.cumsum(~inside) - 1]
    # The vertex between two faces belongs to both.
    shared = np.zeros(len(first), bool)
    shared[:-1] = inside[1:]
    last = first + size - 1 + shared
    points = size + shared
    middle_x, middle_y, twice_xy, difference, rms = _fit(x, y, first, size, last, shared)
    # A run of a single point has no face.
    kept = last > first
    return (
        run[kept],
        first[kept],
        last[kept],
        points[kept],
        middle_x[kept],
        middle_y[kept],
        twice_xy[kept],
        difference[kept],
        rms[kept],
        offsets_of(np.bincount(run[kept], minlength=len(start) - 1)),
    )


def _fit(
    x: Float64, y: Float64, first: Int64, size: Int64, last: Int64, shared: Bool
) -> tuple[Float64, Float64, Float64, Float64, Float64]:
    """Total least squares lines through the points `first[j] … last[j]`, as `straight_lines` returns them, (J,) each.

    The stretches fill the points: each has `size[j]` of them, and where it is `shared` the first of the next as well.
    """
    if not len(first):
        empty = np.empty(0)
        return empty, empty, empty, empty, empty
    # Moments about the first point, moved to the middle afterwards: one pass, and accurate because it is near.
    x0, y0 = x[first], y[first]
    dx, dy = x - np.repeat(x0, size), y - np.repeat(y0, size)
    end_x, end_y = (x[last] - x0) * shared, (y[last] - y0) * shared
    share = 1.0 / (size + shared)
    mean_x = (np.add.reduceat(dx, first) + end_x) * share
    mean_y = (np.add.reduceat(dy, first) + end_y) * share
    xy = (np.add.reduceat(dx * dy, first) + end_x * end_y) * share - mean_x * mean_y
    xx = (np.add.reduceat(dx * dx, first) + end_x * end_x) * share - mean_x * mean_x
    yy = (np.add.reduceat(dy * dy, first) + end_y * end_y) * share - mean_y * mean_y
    half = 0.5 * (xx - yy)
    rms = np.sqrt(np.maximum(0.5 * (xx + yy) - np.sqrt(half * half + xy * xy), 0.0))
    return x0 + mean_x, y0 + mean_y, 2.0 * xy, xx - yy, rms


@compiled
def directed(
    x: Float64,
    y: Float64,
    first: Int64,
    last: Int64,
    direction_x: Float64,
    direction_y: Float64,
    angle: Float64,
) -> Float64:
    """Turn lines, given by their directions and angles [rad] (F,), to point from their first to their last point.

    Returns
    -------
    (F,) distance of these points along the line [m]
    """
    length = (x[last] - x[first]) * direction_x + (y[last] - y[first]) * direction_y
    turned = length < 0
    flip = np.where(turned, -1.0, 1.0)
    direction_x *= flip
    direction_y *= flip
    angle += np.pi * turned
    return np.abs(length)
