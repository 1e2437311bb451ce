"""Definition 2: the signed difference function s(θ_n) = r(θ_n) - r(θ_{n-1})."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.points import NEVER, Points, collect
from lidarcli.sweeps import Float64, Int64, SweepBatch


@dataclass(frozen=True, slots=True)
class Gaps:
    """What lies before each stretch of points without a gap. (G,) each."""

    before: Int64
    """Cell of the point before it; on a full turn over the seam. Any cell where there is none."""
    missing: Int64
    """Beams without a range between the two: 0 over a seam without loss; `NEVER` where there is no such point."""


def gaps(points: Points) -> Gaps:
    """The point before each stretch, however far. None before the first of a partial view, or a turn's only point."""
    before = np.empty_like(points.end)
    missing = np.empty_like(points.end)
    before[1:] = points.end[:-1]
    np.subtract(points.begin[1:], points.end[:-1] + 1, out=missing[1:])
    filled = np.flatnonzero(points.stretches[1:] > points.stretches[:-1])
    first, last = points.stretches[filled], points.stretches[filled + 1] - 1
    period = points.geometry.period[filled]
    closes = (period > 0) & (points.end[last] > points.begin[first])
    before[first] = points.end[last]
    missing[first] = np.where(closes, points.begin[first] + period - points.end[last] - 1, NEVER)
    return Gaps(before, missing)


def steepness(points: Points) -> Float64:
    """|s| of every cell [m], 0 where the beam or its neighbour has no range, and over the seam. (S * stride,)"""
    size = np.empty_like(points.range)
    size[:1] = 0.0
    np.subtract(points.range[1:], points.range[:-1], out=size[1:])
    np.abs(size, out=size)
    np.fmax(size, 0.0, out=size)
    return size


@dataclass(frozen=True, slots=True)
class Steps:
    """E points that may follow a discontinuity: after a large difference, and after every gap. (E,) each, in order."""

    cell: Int64
    row: Int64
    stretch: Int64
    before: Int64
    """Cell of the predecessor; any cell where there is none."""
    missing: Int64
    """Beams without a range between the two, `NEVER` where there is no predecessor."""
    s: Float64
    """r(θ_n) - r(predecessor) [m]; NaN where there is none."""

    def __len__(self) -> int:
        return len(self.cell)


def steps(points: Points, gap: Gaps, steepness: Float64, least: Float64) -> Steps:
    """The points that may follow a discontinuity.

    Parameters
    ----------
    points : M points of S sweeps
    gap, steepness : of these points
    least : (S,) a smaller |s| is no discontinuity [m]
    """
    event = points.table(steepness) > least[:, None]
    event = event.reshape(-1)
    event[points.begin] = True
    cell = np.flatnonzero(event)
    before = cell - 1
    begins = ~points.valid[before]
    stretch = np.cumsum(begins) - 1
    at = np.flatnonzero(begins)
    before[at] = gap.before
    missing = np.zeros(len(cell), np.int64)
    missing[at] = gap.missing
    s = points.range[cell] - points.range[before]
    s[at[gap.missing == NEVER]] = np.nan
    return Steps(cell, points.row[stretch], stretch, before, missing, s)


def difference(batch: SweepBatch) -> Float64:
    """The difference function s of every beam (Def. 2), in the log's own beam order.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    (S, B) signed differences [m] towards the neighbour at the next smaller bearing. NaN where the beam or that neighbour
    has no range, and for the first beam of a partial view. On a full turn the predecessor of the first bearing is the
    last; a bearing that is measured twice counts once, its repetition is NaN.

    Examples
    --------
    >>> import numpy as np
    >>> from lidarcli.formalism import sweep
    >>> difference(sweep([2.0, 2.0, 1.0, 2.0], angle_min=0.0, angle_increment=np.pi / 2))
    array([[ 0.,  0., -1.,  1.]])
    """
    points = collect(batch)
    s = np.full(len(points.range), np.nan)
    np.subtract(points.range[1:], points.range[:-1], out=s[1:])
    gap = gaps(points)
    whole = gap.missing == 0
    cell = points.begin[whole]
    s[cell] = points.range[cell] - points.range[gap.before[whole]]
    beams: Float64 = points.beams(s, batch.width, np.nan)
    return beams
