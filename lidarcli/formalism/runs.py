"""Definition 5: the runs between two discontinuities, and what each of their edges says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.difference import Steps
from lidarcli.formalism.points import NEVER, Cloud, Points, place
from lidarcli.formalism.ragged import spans
from lidarcli.sweeps import Bool, Float64, Int64, Status, SweepBatch, UInt8

OWN, HIDDEN, OPEN, UNKNOWN, VIEW = EDGES = range(5)
"""An edge of a run: the run is the nearer side; the neighbour is, and hides the rest; a beam without a return is beside
it; an invalid or too close one is; the view ends."""


@dataclass(frozen=True, slots=True)
class Runs:
    """R runs of points, in order of their rows and bearings."""

    points: Cloud
    row: Int64
    """(R,)"""
    first: Int64
    """(R,) index of the first point, P_i; the others follow."""
    size: Int64
    """(R,) number of points."""
    start_edge: UInt8
    end_edge: UInt8
    s_start: Float64
    """(R,) signed difference on entering the run [m]; NaN where undefined."""
    s_end: Float64
    """(R,) signed difference on leaving it."""

    def __len__(self) -> int:
        return len(self.row)

    @property
    def last(self) -> Int64:
        """(R,) index of the last point, P_f."""
        return self.first + self.size - 1


@dataclass(frozen=True, slots=True)
class _Entries:
    """Where the runs begin, (R,) each."""

    row: Int64
    rank: Int64
    """Number of the first point."""
    missing: Int64
    """Lost beams between it and the point before."""
    s: Float64
    """Difference to the point before [m]; NaN where there is none."""
    whole: Bool
    """The run is a full turn without a discontinuity."""


def split(batch: SweepBatch, points: Points, steps: Steps, jump: Bool, max_gap: int) -> Runs:
    """Cut the points into runs at every discontinuity (Def. 5); on a full turn a run may cross the seam.

    Parameters
    ----------
    batch : the sweeps the points come from
    points : M points
    steps : E of them that may follow a discontinuity
    jump : (E,) whether f is discontinuous before the point
    max_gap : a gap of more beams without a range is a discontinuity by itself
    """
    enter = _entries(points, steps, np.flatnonzero(jump | (steps.missing > max_gap)))
    row, first, count = enter.row, enter.rank, len(enter.row)

    # A run ends where the next one of its row begins, and the last one of a full turn where the first one does.
    ends_row = np.ones(count, bool)
    np.not_equal(row[1:], row[:-1], out=ends_row[:-1])
    final = np.flatnonzero(ends_row)
    lead = np.append(0, final[:-1] + 1)[: len(final)]
    turns = points.geometry.period[row[final]] > 0
    begin, end = points.start[row[final]], points.start[row[final] + 1]
    stop = np.empty(count, np.int64)
    stop[:-1] = first[1:]
    stop[final] = np.where(turns, end + first[lead] - begin, end)
    size = stop - first
    following = np.arange(1, count + 1)
    following[final] = lead
    s_end, missing_end = enter.s[following], enter.missing[following]
    s_end[final[~turns]] = np.nan
    missing_end[final[~turns]] = NEVER

    first, again, beyond = _repeat_over_seam(len(points), first, size, final, begin, end)
    cloud = place(batch, points, again, beyond)
    # Both edges of all runs at once, the starts first: how far the neighbour falls back behind the run.
    lone = np.concatenate([enter.missing, missing_end]) > max_gap
    s = np.concatenate([enter.s, s_end])
    edge = np.empty((2, count), np.uint8)
    np.choose(np.concatenate([s[:count] < 0, s[count:] > 0]), (HIDDEN, OWN), out=edge.reshape(-1))
    alone = np.flatnonzero(lone)
    s[alone] = np.nan
    at_end = alone >= count
    run = alone - count * at_end
    index = first[run] + (size[run] - 1) * at_end
    edge.reshape(-1)[alone] = _beside(batch, cloud, row[run], index, 2 * at_end - 1)
    if enter.whole.any():
        s.reshape(2, count)[:, enter.whole] = np.nan
        edge[:, enter.whole] = HIDDEN
    return Runs(cloud, row, first, size, edge[0], edge[1], s[:count], s[count:])


def _entries(points: Points, steps: Steps, broken: Int64) -> _Entries:
    """The points after a discontinuity, and the first point of each full turn that has none."""
    stretch, row = steps.stretch[broken], steps.row[broken]
    rank = points.rank[stretch] + steps.cell[broken] - points.begin[stretch]
    missing, s = steps.missing[broken], steps.s[broken]
    whole = np.zeros(len(row), bool)
    has_some = np.zeros(len(points.start) - 1, bool)
    has_some[row] = True
    lacking = np.flatnonzero(~has_some & (points.start[1:] > points.start[:-1]))
    if len(lacking):
        at = np.searchsorted(row, lacking)
        rank = np.insert(rank, at, points.start[lacking])
        row = np.insert(row, at, lacking)
        missing, s = np.insert(missing, at, 0), np.insert(s, at, np.nan)
        whole = np.insert(whole, at, True)
    return _Entries(row, rank, missing, s, whole)


def _repeat_over_seam(
    total: int, first: Int64, size: Int64, final: Int64, begin: Int64, end: Int64
) -> tuple[Int64, Int64, Bool]:
    """List the points of the runs that cross a seam once more, at the end, so that they are consecutive as well.

    Parameters
    ----------
    total : number of points M
    first, size : (R,) first point of each run and number of points
    final : the last run of each row that has any
    begin, end : points of these rows

    Returns
    -------
    first : (R,) index of the first point of each run
    again, beyond : the points to list once more, and whether those lie past the seam
    """
    crossing = np.flatnonzero(first[final] + size[final] > end)
    run = final[crossing]
    again, owner, offsets = spans(first[run], size[run])
    end = end[crossing][owner]
    beyond = again >= end
    again -= beyond * (end - begin[crossing][owner])
    first = first.copy()
    first[run] = total + offsets[:-1]
    return first, again, beyond


def _beside(batch: SweepBatch, points: Cloud, row: Int64, index: Int64, side: Int64) -> UInt8:
    """Edges of runs that have no neighbour within reach: what the beams beside points say, on the `side` -1 or +1."""
    beam = points.geometry.beam(row, points.position(index, row) + side)
    outside = (beam < 0) | (beam >= batch.beams[row])
    beam[outside] = 0
    status = batch.status.reshape(-1)[row * batch.width + beam]
    edge = np.where(status == Status.NO_RETURN, OPEN, UNKNOWN).astype(np.uint8)
    edge[outside] = VIEW
    return edge
