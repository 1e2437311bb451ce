"""Definition 7: the faces of a run, the straight or curved stretches between consecutive vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import offsets_of, span_first, span_max, span_sum, spans
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


def outline(runs: Runs, most: Int64) -> Outline:
    """The points of each run, thinned evenly to about `most` (R,); where that is less than 2, the run has none."""
    stride = -(-runs.size // np.maximum(most, 1))
    size = np.where(most < 2, 0, -(-(runs.size - 1) // stride) + 1)
    step, owner, start = spans(np.zeros(len(runs), np.int64), size)
    index = runs.first[owner] + stride[owner] * step
    return Outline(runs.points, np.minimum(index, runs.last[owner]), start)


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
    x, y = shape.cloud.x[shape.index], shape.cloud.y[shape.index]
    inner = np.zeros(len(x), bool)
    begin, end = shape.start[:-1], shape.start[1:] - 1
    for _ in range(MAX_SPLITS):
        worth = np.flatnonzero(end - begin > 1)
        begin, end, tolerance = begin[worth], end[worth], tolerance[worth]
        if not len(begin):
            break
        index, span, offsets = spans(begin + 1, end - begin - 1)
        away = _distance_from_chord(x, y, begin, end, tolerance, index, span)
        farthest = span_max(away, offsets)
        split = farthest > tolerance
        if not split.any():
            break
        at = span_first(away == farthest[span], span, len(begin))[split]
        middle = index[at]
        inner[middle] = True
        begin = np.stack([begin[split], middle], axis=1).reshape(-1)
        end = np.stack([middle, end[split]], axis=1).reshape(-1)
        tolerance = np.repeat(tolerance[split], 2)
    return inner


def _distance_from_chord(
    x: Float64, y: Float64, begin: Int64, end: Int64, tolerance: Float64, index: Int64, span: Int64
) -> Float64:
    """Distance of the points of `index` from the chord of their stretch; from its start where the chord is a point."""
    x0, y0 = x[begin], y[begin]
    chord_x, chord_y = x[end] - x0, y[end] - y0
    length = np.hypot(chord_x, chord_y)
    closed = length < tolerance
    scale = 1.0 / np.where(closed, 1.0, length)
    normal_x, normal_y = chord_y * scale, -chord_x * scale
    offset = x0 * normal_x + y0 * normal_y
    away = np.abs(x[index] * normal_x[span] + y[index] * normal_y[span] - offset[span])
    if closed.any():
        which = np.flatnonzero(closed[span])
        at, span = index[which], span[which]
        away[which] = np.hypot(x[at] - x0[span], y[at] - y0[span])
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
    size = np.diff(shape.start)
    begins = inner.copy()
    begins[shape.start[:-1][size > 1]] = True
    first = np.flatnonzero(begins)
    run = np.repeat(np.arange(len(size)), size)[first]
    last = np.minimum(np.append(first[1:], len(inner) - 1), shape.start[run + 1] - 1)
    x, y = shape.cloud.x[shape.index], shape.cloud.y[shape.index]
    middle_x, middle_y, angle, rms = fit_lines(x, y, first, last)
    direction_x, direction_y = np.cos(angle), np.sin(angle)
    length = (x[last] - x[first]) * direction_x + (y[last] - y[first]) * direction_y
    flip = np.where(length < 0, -1.0, 1.0)
    return Faces(
        run=run,
        first=shape.index[first],
        last=shape.index[last],
        points=last - first + 1,
        middle_x=middle_x,
        middle_y=middle_y,
        direction_x=direction_x * flip,
        direction_y=direction_y * flip,
        angle=angle + np.where(length < 0, np.pi, 0.0),
        rms=rms,
        length=np.abs(length),
        offsets=offsets_of(np.bincount(run, minlength=len(size))),
    )


def fit_lines(x: Float64, y: Float64, first: Int64, last: Int64) -> tuple[Float64, Float64, Float64, Float64]:
    """Total least squares lines through the points `first[j] … last[j]`: middle x, y, angle, rms, (J,) each."""
    if not len(first):
        empty = np.empty(0)
        return empty, empty, empty, empty
    index, owner, offsets = spans(first, last - first + 1)
    count = np.diff(offsets).astype(np.float64)
    x, y = x[index], y[index]
    middle_x, middle_y = span_sum(x, offsets) / count, span_sum(y, offsets) / count
    dx, dy = x - middle_x[owner], y - middle_y[owner]
    xx = span_sum(dx * dx, offsets) / count
    yy = span_sum(dy * dy, offsets) / count
    xy = span_sum(dx * dy, offsets) / count
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    spread = np.hypot(0.5 * (xx - yy), xy)
    rms = np.sqrt(np.maximum(0.5 * (xx + yy) - spread, 0.0))
    return middle_x, middle_y, angle, rms
