"""Definition 7: the faces of a run, the straight or curved stretches between consecutive vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import offsets_of, span_max_positive, spans
from lidarcli.formalism.runs import Runs
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
    first, size = runs.first, np.where(most < 2, 0, runs.size)
    large = np.flatnonzero(size > most)
    stride = -(-size[large] // most[large])
    size[large] = -(-(size[large] - 1) // stride) + 1
    start = offsets_of(size)
    index = np.arange(start[-1])
    index += np.repeat(first - start[:-1], size)
    if len(large):
        at, owner, _ = spans(start[large], size[large])
        step = (at - start[large][owner]) * stride[owner]
        index[at] = np.minimum(first[large][owner] + step, runs.last[large][owner])
    return Outline(runs.points, index, start, runs.points.x[index], runs.points.y[index])


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
    worth = np.flatnonzero(size)
    begin, size, tolerance = shape.start[worth], size[worth], tolerance[worth]
    # First the whole runs, which follow each other without a gap, then ever fewer parts of them.
    end, offsets, index = begin + size - 1, np.append(begin, len(x)), None
    for _ in range(MAX_SPLITS):
        if not len(begin):
            break
        away = _distance_from_chord(x, y, begin, end, size, tolerance, offsets, index)
        farthest = span_max_positive(away, offsets)
        split = np.flatnonzero(farthest > tolerance)
        if not len(split):
            break
        threshold = np.full(len(begin), np.inf)
        threshold[split] = farthest[split]
        at = np.flatnonzero(away == np.repeat(threshold, size))
        at = at[np.searchsorted(at, offsets[split])]
        middle = at if index is None else index[at]
        inner[middle] = True
        # Both parts of each, of which those with an inner point of their own are worth a look.
        begin, end = _pairs(begin[split], middle), _pairs(middle, end[split])
        size = end - begin - 1
        worth = np.flatnonzero(size)
        begin, end, size = begin[worth], end[worth], size[worth]
        tolerance = tolerance[split[worth >> 1]]
        offsets = offsets_of(size)
        index = np.arange(offsets[-1])
        index += np.repeat(begin + 1 - offsets[:-1], size)
    return inner


def _pairs(one: Int64, other: Int64) -> Int64:
    """(2 J,) the values of both, in turns."""
    pairs = np.empty((len(one), 2), np.int64)
    pairs[:, 0], pairs[:, 1] = one, other
    return pairs.reshape(-1)


def _distance_from_chord(
    x: Float64,
    y: Float64,
    begin: Int64,
    end: Int64,
    size: Int64,
    tolerance: Float64,
    offsets: Int64,
    index: Int64 | None,
) -> Float64:
    """Distance of points from the chord `begin … end` of their stretch; from its start where the chord is a point.

    Stretch j has the `size[j]` points `index[offsets[j]:offsets[j + 1]]`, of all points where `index` is None.
    """
    x0, y0 = x[begin], y[begin]
    chord_x, chord_y = x[end] - x0, y[end] - y0
    length = np.hypot(chord_x, chord_y)
    closed = np.flatnonzero(length < tolerance)
    length[closed] = 1.0
    scale = 1.0 / length
    normal_x, normal_y = chord_y * scale, -chord_x * scale
    if index is not None:
        x, y = x[index], y[index]
    away = np.repeat(normal_x, size)
    away *= x
    across = np.repeat(normal_y, size)
    across *= y
    away += across
    away -= np.repeat(x0 * normal_x + y0 * normal_y, size)
    np.abs(away, out=away)
    if len(closed):
        at, owner, _ = spans(offsets[closed], size[closed])
        which = closed[owner]
        away[at] = np.hypot(x[at] - x0[which], y[at] - y0[which])
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
    x, y = shape.x, shape.y
    filled = np.flatnonzero(shape.start[1:] > shape.start[:-1])
    begins = inner.copy()
    begins[shape.start[filled]] = True
    first = np.flatnonzero(begins)
    size = np.diff(first, append=len(x))
    inside = inner[first]
    run = filled[np.cumsum(~inside) - 1]
    # The vertex between two faces belongs to both.
    shared = np.zeros(len(first), bool)
    shared[:-1] = inside[1:]
    last = first + size - 1 + shared
    middle_x, middle_y, angle, rms = fit_lines(x, y, first, size, last, shared)
    direction_x, direction_y = np.cos(angle), np.sin(angle)
    length = (x[last] - x[first]) * direction_x + (y[last] - y[first]) * direction_y
    turned = length < 0
    flip = np.where(turned, -1.0, 1.0)
    faces = Faces(
        run=run,
        first=shape.index[first],
        last=shape.index[last],
        points=size + shared,
        middle_x=middle_x,
        middle_y=middle_y,
        direction_x=direction_x * flip,
        direction_y=direction_y * flip,
        angle=angle + np.pi * turned,
        rms=rms,
        length=np.abs(length),
        offsets=offsets_of(np.bincount(run, minlength=len(shape.start) - 1)),
    )
    return _without_points(faces)


def _without_points(faces: Faces) -> Faces:
    """The faces but for those of a single point, the only "face" of its run."""
    single = faces.last == faces.first
    if not single.any():
        return faces
    offsets = offsets_of(np.bincount(faces.run[~single], minlength=len(faces.offsets) - 1))
    kept = {name: getattr(faces, name)[~single] for name in Faces.__slots__ if name != "offsets"}
    return Faces(**kept, offsets=offsets)


def fit_lines(
    x: Float64, y: Float64, first: Int64, size: Int64, last: Int64, shared: Bool
) -> tuple[Float64, Float64, Float64, Float64]:
    """Total least squares lines through the points `first[j] … last[j]`: middle x, y, angle, rms, (J,) each.

    The stretches fill the points: each has `size[j]` of them, and where it is `shared` the first of the next as well.
    """
    if not len(first):
        empty = np.empty(0)
        return empty, empty, empty, empty
    # Moments about the first point, moved to the middle afterwards: one pass, and accurate because it is near.
    x0, y0 = x[first], y[first]
    dx, dy = np.repeat(x0, size), np.repeat(y0, size)
    np.subtract(x, dx, out=dx)
    np.subtract(y, dy, out=dy)
    product = dx * dy
    end_x, end_y = (x[last] - x0) * shared, (y[last] - y0) * shared
    share = 1.0 / (size + shared)
    mean_x = (np.add.reduceat(dx, first) + end_x) * share
    mean_y = (np.add.reduceat(dy, first) + end_y) * share
    dx *= dx
    dy *= dy
    xy = (np.add.reduceat(product, first) + end_x * end_y) * share - mean_x * mean_y
    xx = (np.add.reduceat(dx, first) + end_x * end_x) * share - mean_x * mean_x
    yy = (np.add.reduceat(dy, first) + end_y * end_y) * share - mean_y * mean_y
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    half = 0.5 * (xx - yy)
    rms = np.sqrt(np.maximum(0.5 * (xx + yy) - np.sqrt(half * half + xy * xy), 0.0))
    return x0 + mean_x, y0 + mean_y, angle, rms
