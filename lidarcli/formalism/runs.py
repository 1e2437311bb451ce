"""Definition 5: the runs between two discontinuities, and what each of their edges says."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Steps
from lidarcli.formalism.points import MARGIN, NEVER, Cloud, Points, beam_at, place
from lidarcli.formalism.ragged import spans
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int32, Int64, Status, SweepBatch, UInt8

OWN, HIDDEN, OPEN, UNKNOWN, VIEW = EDGES = range(5)
"""An edge of a run: the run is the nearer side; the neighbour is, and hides the rest; a beam without a return is beside
it; an invalid or too close one is; the view ends."""


@record
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


@record
class _Entries:
    """Where the runs begin, (R,) each."""

    row: Int64
    rank: Int64
    """Number of the first point."""
    cell: Int64
    before: Int64
    """Cells of the first point and of the point before; any where the run is a whole turn."""
    missing: Int64
    """Lost beams between the two."""
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
    geometry = points.geometry
    row, first, size, start_edge, end_edge, s_start, s_end, again, beyond = cut(
        jump,
        steps.cell,
        steps.row,
        steps.stretch,
        steps.before,
        steps.missing,
        steps.s,
        points.begin,
        points.end,
        points.rank,
        points.stretches,
        points.start,
        points.stride,
        geometry.period,
        geometry.reverse,
        geometry.bearings,
        batch.beams,
        batch.status,
        max_gap,
    )
    cloud = place(batch, points, again, beyond)
    return Runs(cloud, row, first, size, start_edge, end_edge, s_start, s_end)


@compiled
def cut(
    jump: Bool,
    step_cell: Int64,
    step_row: Int64,
    step_stretch: Int64,
    step_before: Int64,
    step_missing: Int64,
    step_s: Float64,
    begin: Int64,
    end: Int64,
    rank: Int64,
    stretches: Int64,
    start: Int64,
    stride: int,
    period: Int64,
    reverse: Bool,
    bearings: Int32,
    beams: Int32,
    status: UInt8,
    max_gap: int,
) -> tuple[Int64, Int64, Int64, UInt8, UInt8, Float64, Float64, Int64, Bool]:
    """What `Runs` holds besides its points, and the points to list once more, see `points.place`.

    Parameters
    ----------
    jump : (E,) whether f is discontinuous before the point of a step
    step_cell, step_row, step_stretch, step_before, step_missing, step_s : (E,) as in `Steps`
    begin, end, rank, stretches, start, stride : as in `Points`
    period, reverse, bearings : (S,) as in `Geometry`
    beams, status : (S,) and (S, B) of the batch
    max_gap : a gap of more beams without a range is a discontinuity by itself
    """
    broken = np.flatnonzero(jump | (step_missing > max_gap))
    stretch, row = step_stretch[broken], step_row[broken]
    enter = _with_whole_turns(
        start,
        _Entries(
            row=row,
            rank=rank[stretch] + step_cell[broken] - begin[stretch],
            cell=step_cell[broken],
            before=step_before[broken],
            missing=step_missing[broken],
            s=step_s[broken],
            whole=np.zeros(len(row), bool),
        ),
    )
    row, first, count = enter.row, enter.rank, len(enter.row)

    # A run ends where the next one of its row begins, and the last one of a full turn where the first one does.
    ends_row = np.ones(count, bool)
    np.not_equal(row[1:], row[:-1], out=ends_row[:-1])
    final = np.flatnonzero(ends_row)
    lead = np.append(0, final[:-1] + 1)[: len(final)]
    turns = period[row[final]] > 0
    low, high = start[row[final]], start[row[final] + 1]
    stop = np.empty(count, np.int64)
    stop[:-1] = first[1:]
    stop[final] = np.where(turns, high + first[lead] - low, high)
    size = stop - first
    following = np.arange(1, count + 1)
    following[final] = lead
    s_end, missing_end, leave = enter.s[following], enter.missing[following], enter.before[following]
    last = final[~turns]
    s_end[last] = np.nan
    missing_end[last] = NEVER
    leave[last] = end[stretches[row[last] + 1] - 1]

    first, again, beyond = _repeat_over_seam(int(start[-1]), first, size, final, low, high)
    # Both edges of all runs at once, the starts first: how far the neighbour falls back behind the run.
    lone = np.concatenate([enter.missing, missing_end]) > max_gap
    s = np.concatenate([enter.s, s_end])
    edge = np.empty((2, count), np.uint8)
    np.choose(np.concatenate([s[:count] < 0, s[count:] > 0]), (HIDDEN, OWN), out=edge.reshape(-1))
    alone = np.flatnonzero(lone)
    s[alone] = np.nan
    at_end = alone >= count
    lonely = row[alone - count * at_end]
    position = np.concatenate([enter.cell - 1, leave + 1])[alone] - (lonely * stride + MARGIN)
    beam = beam_at(lonely, position, period, reverse, bearings)
    edge.reshape(-1)[alone] = _what_says(lonely, beam, beams, status)
    if enter.whole.any():
        s.reshape(2, count)[:, enter.whole] = np.nan
        edge[:, enter.whole] = HIDDEN
    return row, first, size, edge[0], edge[1], s[:count], s[count:], again, beyond


def _with_whole_turns(start: Int64, enter: _Entries) -> _Entries:
    """The same, and the first point of each full turn that has no discontinuity."""
    has_some = np.zeros(len(start) - 1, bool)
    has_some[enter.row] = True
    lacking = np.flatnonzero(~has_some & (start[1:] > start[:-1]))
    if not len(lacking):
        return enter
    at = np.searchsorted(enter.row, lacking)
    return _Entries(
        row=np.insert(enter.row, at, lacking),
        rank=np.insert(enter.rank, at, start[lacking]),
        cell=np.insert(enter.cell, at, 0),
        before=np.insert(enter.before, at, 0),
        missing=np.insert(enter.missing, at, 0),
        s=np.insert(enter.s, at, np.nan),
        whole=np.insert(enter.whole, at, True),
    )


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


def _what_says(row: Int64, beam: Int64, beams: Int32, status: UInt8) -> UInt8:
    """Edges of runs that have no neighbour within reach: what the beams beside them say."""
    outside = (beam < 0) | (beam >= beams[row])
    said = status.reshape(-1)[row * status.shape[1] + np.where(outside, 0, beam)]
    edge = np.where(said == Status.NO_RETURN, OPEN, UNKNOWN).astype(np.uint8)
    edge[outside] = VIEW
    return edge
