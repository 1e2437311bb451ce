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


def split_straight(runs: Runs, tolerance: Float64) -> Bool:
    """Mark the points where the faces of each run meet (iterative end point fit, all runs at once).

    A stretch splits at its point farthest from the chord, as long as that distance exceeds the tolerance.

    Parameters
    ----------
    runs : R runs over M points
    tolerance : (R,) metres

    Returns
    -------
    (M,) True at inner vertices; the first and last point of a run are not marked
    """
    x, y = runs.points.x, runs.points.y
    inner = np.zeros(len(runs.points), bool)
    begin, end, owner = runs.first, runs.last, np.arange(len(runs))
    for _ in range(MAX_SPLITS):
        worth = end - begin > 1
        begin, end, owner = begin[worth], end[worth], owner[worth]
        if not len(begin):
            break
        index, span, offsets = spans(begin + 1, end - begin - 1)
        chord_x, chord_y = x[end] - x[begin], y[end] - y[begin]
        length = np.hypot(chord_x, chord_y)
        closed = length < tolerance[owner]
        scale = 1.0 / np.where(closed, 1.0, length)
        dx, dy = x[index] - x[begin][span], y[index] - y[begin][span]
        away = np.abs(dx * (chord_y * scale)[span] - dy * (chord_x * scale)[span])
        if closed.any():
            away = np.where(closed[span], np.hypot(dx, dy), away)
        farthest = span_max(away, offsets)
        split = farthest > tolerance[owner]
        at = span_first(away == farthest[span], span, len(begin))[split]
        middle = index[at]
        inner[middle] = True
        begin = np.stack([begin[split], middle], axis=1).reshape(-1)
        end = np.stack([middle, end[split]], axis=1).reshape(-1)
        owner = np.repeat(owner[split], 2)
    return inner


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
    begins = inner.copy()
    begins[runs.first] = True
    begins[runs.last] &= runs.size == 1
    begins[runs.last[runs.size == 1]] = False
    first = np.flatnonzero(begins)
    owner = np.searchsorted(runs.start, first, side="right") - 1
    last = np.append(first[1:], len(runs.points) - 1)
    last = np.minimum(last, runs.last[owner])
    middle_x, middle_y, direction_x, direction_y, rms = fit_lines(runs.points, first, last)
    x, y = runs.points.x, runs.points.y
    length = (x[last] - x[first]) * direction_x + (y[last] - y[first]) * direction_y
    flip = np.where(length < 0, -1.0, 1.0)
    return Faces(
        run=owner,
        first=first,
        last=last,
        middle_x=middle_x,
        middle_y=middle_y,
        direction_x=direction_x * flip,
        direction_y=direction_y * flip,
        rms=rms,
        length=np.abs(length),
        offsets=offsets_of(np.bincount(owner, minlength=len(runs))),
    )


def fit_lines(points: Cloud, first: Int64, last: Int64) -> tuple[Float64, Float64, Float64, Float64, Float64]:
    """Total least squares line through the points `first[j] … last[j]`: middle x, y, direction x, y, rms [m], (J,) each."""
    if not len(first):
        empty = np.empty(0)
        return empty, empty, empty, empty, empty
    index, owner, offsets = spans(first, last - first + 1)
    count = np.diff(offsets).astype(np.float64)
    x, y = points.x[index], points.y[index]
    middle_x, middle_y = span_sum(x, offsets) / count, span_sum(y, offsets) / count
    dx, dy = x - middle_x[owner], y - middle_y[owner]
    xx = span_sum(dx * dx, offsets) / count
    yy = span_sum(dy * dy, offsets) / count
    xy = span_sum(dx * dy, offsets) / count
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    spread = np.hypot(0.5 * (xx - yy), xy)
    rms = np.sqrt(np.maximum(0.5 * (xx + yy) - spread, 0.0))
    return middle_x, middle_y, np.cos(angle), np.sin(angle), rms
