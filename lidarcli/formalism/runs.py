"""Definition 5: the runs between two discontinuities, and what each of their edges says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.points import Cloud, Points, place
from lidarcli.sweeps import Bool, Float64, Int64, Status, SweepBatch, UInt8

OWN, HIDDEN, OPEN, UNKNOWN, VIEW = range(5)
"""An edge of a run: the run is the nearer side; the neighbour is, and hides the rest; a beam without a return is beside
it; an invalid or too close one is; the view ends."""


@dataclass(frozen=True, slots=True)
class Runs:
    """R runs of points, in order of their rows and bearings; none crosses the end of a row of `points`."""

    points: Cloud
    start: Int64
    """(R + 1,) the points of run j are `start[j]:start[j + 1]`."""
    row: Int64
    """(R,)"""
    start_edge: UInt8
    end_edge: UInt8
    s_start: Float64
    """(R,) signed difference on entering the run [m]; NaN where undefined."""
    s_end: Float64
    """(R,) signed difference on leaving it."""

    def __len__(self) -> int:
        return len(self.row)

    @property
    def first(self) -> Int64:
        """(R,) index of the first point, P_i."""
        return self.start[:-1]

    @property
    def last(self) -> Int64:
        """(R,) index of the last point, P_f."""
        return self.start[1:] - 1

    @property
    def size(self) -> Int64:
        """(R,) number of points."""
        return np.diff(self.start)


def split(
    batch: SweepBatch,
    points: Points,
    s: Float64,
    missing: Float64,
    jump: Bool,
    max_gap: int,
) -> Runs:
    """Cut the points into runs at every discontinuity (Def. 5); on a full turn a run may cross the seam.

    Parameters
    ----------
    batch : the sweeps the points come from
    points : M points
    s, missing : (M,) as `difference.predecessor_gap` gives them
    jump : (M,) whether f is discontinuous before a point
    max_gap : a gap of more beams without a range is a discontinuity by itself
    """
    broken = jump | (missing > max_gap)
    order, beyond, any_break = _from_first_break(points, broken)
    cloud = place(batch, points, order, beyond)
    begins = broken[order]
    begins[points.start[:-1][np.diff(points.start) > 0]] = True
    first = np.flatnonzero(begins)
    start = np.append(first, len(points))
    row = cloud.row[first]
    last = start[1:] - 1

    # The discontinuity that ends a run is the one before the point that follows it, over the seam on a full turn.
    following = start[1:] % max(len(points), 1)
    ends_row = start[1:] == points.start[row + 1]
    wraps = points.geometry.period[row] > 0
    following = np.where(ends_row, points.start[row], following)
    whole = (points.start[row] == first) & ends_row & ~any_break[row]
    exists = ~ends_row | wraps
    entering, leaving = order[first], order[following]
    s_start, s_end = s[entering], np.where(exists, s[leaving], np.nan)
    gap_start, gap_end = missing[entering], np.where(exists, missing[leaving], np.inf)
    start_edge = _edge(-s_start, gap_start, max_gap, batch, cloud, first, -1)
    end_edge = _edge(s_end, gap_end, max_gap, batch, cloud, last, +1)
    s_start = np.where((gap_start <= max_gap) & ~whole, s_start, np.nan)
    s_end = np.where((gap_end <= max_gap) & ~whole, s_end, np.nan)
    start_edge[whole & wraps] = HIDDEN
    end_edge[whole & wraps] = HIDDEN
    return Runs(cloud, start, row, start_edge, end_edge, s_start, s_end)


def _from_first_break(points: Points, broken: Bool) -> tuple[Int64, Bool | None, Bool]:
    """Turn each full-turn row so that it starts at its first discontinuity: no run then crosses the end of its row.

    Returns the order (M,), which points of that order lie past the seam (M,) or None, and which rows have any
    discontinuity (S,).
    """
    order = np.arange(len(points))
    at = np.flatnonzero(broken)
    row = points.row[at]
    leads = np.ones(len(at), bool)
    leads[1:] = row[1:] != row[:-1]
    rows = len(points.start) - 1
    any_break = np.zeros(rows, bool)
    any_break[row] = True
    shift = np.zeros(rows, np.int64)
    shift[row[leads]] = at[leads] - points.start[row[leads]]
    shift[points.geometry.period == 0] = 0
    if not shift.any():
        return order, None, any_break
    size = np.diff(points.start)
    order += np.repeat(shift, size)
    beyond = order >= np.repeat(points.start[1:], size)
    order -= beyond * np.repeat(size, size)
    return order, beyond, any_break


def _edge(
    drop: Float64, gap: Float64, max_gap: int, batch: SweepBatch, points: Cloud, index: Int64, side: int
) -> UInt8:
    """What lies beside the points of `index`: `drop` > 0 means the neighbour is further away than the run."""
    row = points.row[index]
    edge = np.where(drop > 0, OWN, HIDDEN).astype(np.uint8)
    lone = gap > max_gap
    beside = points.position[index[lone]] + side
    row = row[lone]
    beam = points.geometry.beam(row, beside)
    outside = (beam < 0) | (beam >= batch.beams[row])
    status = batch.status[row, np.clip(beam, 0, max(batch.width - 1, 0))]
    edge[lone] = np.where(outside, VIEW, np.where(status == Status.NO_RETURN, OPEN, UNKNOWN))
    return edge
