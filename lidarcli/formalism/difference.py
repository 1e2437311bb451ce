"""Definition 2: the signed difference function s(θ_n) = r(θ_n) - r(θ_{n-1})."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.points import NEVER, Points, collect, refuse_geometry
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Float64, Int64, SweepBatch


@record
class Gaps:
    """What lies before each stretch of points without a gap. (G,) each."""

    before: Int64
    """Cell of the point before it; on a full turn over the seam. Any cell where there is none."""
    missing: Int64
    """Beams without a range between the two: 0 over a seam without loss; `NEVER` where there is no such point."""


def gaps(points: Points) -> Gaps:
    """The point before each stretch, however far. None before the first of a partial view, or a turn's only point."""
    return Gaps(*before_stretches(points.begin, points.end, points.stretches, points.geometry.period))


@compiled
def before_stretches(begin: Int64, end: Int64, stretches: Int64, period: Int64) -> tuple[Int64, Int64]:
    """`Gaps.before` and `missing` of the stretches of `Points` whose full turns have `period` positions."""
    before = np.empty_like(end)
    missing = np.empty_like(end)
    before[1:] = end[:-1]
    np.subtract(begin[1:], end[:-1] + 1, out=missing[1:])
    filled = np.flatnonzero(stretches[1:] > stretches[:-1])
    first, last = stretches[filled], stretches[filled + 1] - 1
    period = period[filled]
    closes = (period > 0) & (end[last] > begin[first])
    before[first] = end[last]
    missing[first] = np.where(closes, begin[first] + period - end[last] - 1, NEVER)
    return before, missing


def steepness(points: Points) -> Float64:
    """|s| of every cell [m], 0 where the beam or its neighbour has no range, and over the seam. (S * stride,)"""
    return sizes(points.range)


@compiled
def sizes(cells: Float64) -> Float64:
    """|s| of neighbouring values, 0 where there is none. (K,) → (K,)"""
    size = np.empty_like(cells)
    size[:1] = 0.0
    np.subtract(cells[1:], cells[:-1], out=size[1:])
    np.abs(size, out=size)
    np.fmax(size, 0.0, out=size)
    return size


@record
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
    return Steps(
        *following(
            points.range,
            steepness,
            least,
            points.begin,
            points.end,
            points.row,
            gap.before,
            gap.missing,
        )
    )


@compiled
def following(
    cells: Float64,
    size: Float64,
    least: Float64,
    begin: Int64,
    end: Int64,
    row: Int64,
    before: Int64,
    missing: Int64,
) -> tuple[Int64, Int64, Int64, Int64, Int64, Float64]:
    """What `Steps` holds.

    Parameters
    ----------
    cells, size : (S * stride,) range and |s| [m]
    least : (S,) of each row [m]
    begin, end, row : (G,) first cell, last cell and row of each stretch of points
    before, missing : (G,) what lies before them
    """
    event = size.reshape(len(least), -1) > least[:, None] if len(least) else np.zeros(0, bool)
    event = event.reshape(-1)
    event[begin] = True
    cell = np.flatnonzero(event)
    predecessor = cell - 1
    begins = np.isnan(cells[predecessor])
    stretch = np.cumsum(begins) - 1
    at = np.flatnonzero(begins)
    predecessor[at] = before
    lost = np.zeros(len(cell), np.int64)
    lost[at] = missing
    s = cells[cell] - cells[predecessor]
    s[at[missing == NEVER]] = np.nan
    return cell, row[stretch], stretch, predecessor, lost, s


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

    Raises
    ------
    ValueError
        `angle_min` or `angle_increment` of a sweep is NaN or infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from lidarcli.formalism import sweep
    >>> difference(sweep([2.0, 2.0, 1.0, 2.0], angle_min=0.0, angle_increment=np.pi / 2))
    array([[ 0.,  0., -1.,  1.]])
    """
    refuse_geometry(batch)
    points = collect(batch)
    s = np.full(len(points.range), np.nan)
    np.subtract(points.range[1:], points.range[:-1], out=s[1:])
    gap = gaps(points)
    whole = gap.missing == 0
    cell = points.begin[whole]
    s[cell] = points.range[cell] - points.range[gap.before[whole]]
    beams: Float64 = points.beams(s, batch.width, np.nan)
    return beams
