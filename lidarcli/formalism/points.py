"""The valid beams of a batch in counter-clockwise order: a grid of cells, and the points in it that runs are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.ragged import offsets_of
from lidarcli.sweeps import TURN, Bool, Closure, Float64, Int32, Int64, SweepBatch

MARGIN = 4
"""Empty cells before and after each sweep: no look at so many neighbours reaches the next sweep."""
BLOCK = 32
"""Sweeps are padded to a multiple of this many cells; sums by blocks do not depend on the padding."""
NEVER = np.int64(1 << 40)
"""Number of lost beams between a point and a predecessor that does not exist."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """Where the beams of a batch point, counter-clockwise whatever the sign of the increment.

    Position k = 0, 1, … counts the beams of a sweep by increasing bearing: with a negative increment the last beam has
    position 0, or the last but one where the last repeats the first bearing.
    """

    first: Float64
    """(S,) bearing of position 0 [rad]."""
    step: Float64
    """(S,) |angle_increment| [rad]."""
    period: Int64
    """(S,) positions in a full turn (`bearings`), 0 for a partial view."""
    reverse: Bool
    """(S,) whether the log counts the beams clockwise."""
    bearings: Int32
    """(S,) number of distinct bearings: all beams, or all but the last where it repeats the first bearing."""

    @staticmethod
    def of(batch: SweepBatch) -> Geometry:
        """The geometry of each row of a batch."""
        reverse = batch.angle_increment < 0
        bearings = batch.beams - (batch.closure == Closure.SHARED)
        last = batch.angle_min + (bearings - 1) * batch.angle_increment
        period = bearings.astype(np.int64)
        period[batch.closure == Closure.OPEN] = 0
        return Geometry(
            first=np.where(reverse, last, batch.angle_min),
            step=np.abs(batch.angle_increment),
            period=period,
            reverse=reverse,
            bearings=bearings,
        )

    def beam(self, row: Int64, position: Int64) -> Int64:
        """Index in the log of the beam at a position, at most one turn beyond the seam on either side (Def. 1's n)."""
        if self.period.any():
            period = self.period[row]
            position = position - period * (position >= period) + period * ((position < 0) & (period > 0))
        if self.reverse.any():
            position = np.where(self.reverse[row], self.bearings[row] - 1 - position, position)
        return position


@dataclass(frozen=True, slots=True)
class Points:
    """S sweeps in cells, counter-clockwise: sweep i has its position k in cell `i * stride + MARGIN + k`.

    The cells that hold a range are the M points, numbered row after row. The G stretches of points without a gap are
    in the same order; every row begins a new one.
    """

    geometry: Geometry
    stride: int
    """Cells per row."""
    range: Float64
    """(S * stride,) r [m], Def. 1; NaN where a beam has none, and around the sweeps."""
    valid: Bool
    """(S * stride,) whether the cell holds a range."""
    begin: Int64
    """(G,) first cell of each stretch."""
    end: Int64
    """(G,) last cell of each stretch."""
    row: Int64
    """(G,) row of each stretch."""
    rank: Int64
    """(G,) number of the first point of each stretch."""
    stretches: Int64
    """(S + 1,) the stretches of row i are `stretches[i]:stretches[i + 1]`."""
    start: Int64
    """(S + 1,) the points of row i are `start[i]:start[i + 1]`."""

    def __len__(self) -> int:
        return int(self.start[-1])

    def table(self, cells: NDArray[Any]) -> NDArray[Any]:
        """(S, stride) the values of all cells by row."""
        return cells.reshape(-1, self.stride)

    def position(self, cell: Int64, row: Int64) -> Int64:
        """Counter-clockwise positions of cells of known rows."""
        return cell - (row * self.stride + MARGIN)

    def beams(self, cells: NDArray[Any], width: int, fill: Any) -> NDArray[Any]:
        """(S, width) the values of all cells at their beams, in the order of the log; `fill` where there is no bearing."""
        table = self.table(cells)
        out: NDArray[Any] = table[:, MARGIN : MARGIN + width].copy()
        out[np.arange(width) >= self.geometry.bearings[:, None]] = fill
        rows = np.flatnonzero(self.geometry.reverse)
        if len(rows):
            column = self.geometry.bearings[rows, None] - 1 - np.arange(width)
            turned = table[rows[:, None], np.maximum(column, 0) + MARGIN]
            turned[column < 0] = fill
            out[rows] = turned
        return out


def collect(batch: SweepBatch) -> Points:
    """Lay out the valid beams of a batch (Def. 1: r on Θ_k), each bearing once.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    Points with M = number of beams that have a range
    """
    geometry = Geometry.of(batch)
    rows, width = batch.ranges.shape
    stride = -(-(width + 2 * MARGIN) // BLOCK) * BLOCK
    table = np.empty((rows, stride))
    table[:, :MARGIN] = np.nan
    table[:, MARGIN + width :] = np.nan
    _fill(table[:, MARGIN : MARGIN + width], batch, geometry)
    shared = np.flatnonzero(batch.closure == Closure.SHARED)
    if len(shared):
        # Where the first and the last beam share a bearing, the last does not count.
        table.reshape(-1)[shared * stride + MARGIN + geometry.bearings[shared]] = np.nan

    ranges = table.reshape(-1)
    valid = ranges == ranges
    bounds = np.flatnonzero(valid[1:] != valid[:-1])
    begin, end = bounds[0::2] + 1, bounds[1::2]
    row = begin // stride
    rank = offsets_of(end - begin + 1)
    stretches = offsets_of(np.bincount(row, minlength=rows))
    return Points(
        geometry, stride, ranges, valid, begin, end, row, rank[:-1], stretches, start=rank[stretches]
    )


def _fill(table: Float64, batch: SweepBatch, geometry: Geometry) -> None:
    """Write the ranges into the (S, B) table by position; NaN beyond the last bearing of a sweep counted clockwise."""
    reverse, bearings = geometry.reverse, geometry.bearings
    if not reverse.any():
        table[:] = batch.ranges
        return
    count = int(bearings[0])
    if reverse.all() and bool((bearings == count).all()):
        table[:, :count] = batch.ranges[:, :count][:, ::-1]
        table[:, count:] = np.nan
        return
    table[:] = batch.ranges
    rows = np.flatnonzero(reverse)
    beam = bearings[rows, None] - 1 - np.arange(batch.width)
    turned = batch.ranges[rows[:, None], np.maximum(beam, 0)]
    turned[beam < 0] = np.nan
    table[rows] = turned


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points with their coordinates: all M points in order, and once more those of the runs that cross a seam.

    So the points of every run have consecutive indices: N in all, N ≥ M.
    """

    grid: Points
    cell: Int64
    """(N,)"""
    beyond: Bool
    """(N - M,) which of the points given once more lie past the seam."""
    x: Float64
    """(N,) forward [m], sensor frame."""
    y: Float64
    """(N,) left [m]."""

    def __len__(self) -> int:
        return len(self.cell)

    @property
    def geometry(self) -> Geometry:
        """Where the beams point."""
        return self.grid.geometry

    @property
    def start(self) -> Int64:
        """(S + 1,) row i has `start[i + 1] - start[i]` points."""
        return self.grid.start

    def range(self, index: Int64) -> Float64:
        """r [m] of the points of `index`."""
        ranges: Float64 = self.grid.range[self.cell[index]]
        return ranges

    def row(self, index: Int64) -> Int64:
        """Rows of the points of `index`."""
        return self.cell[index] // self.grid.stride

    def position(self, index: Int64, row: Int64) -> Int64:
        """Counter-clockwise positions of points in known rows, 0 … number of bearings - 1."""
        return self.grid.position(self.cell[index], row)

    def theta(self, index: Int64, row: Int64) -> Float64:
        """Bearing [rad] of points in known rows; within a run it grows past the seam."""
        geometry = self.geometry
        theta: Float64 = geometry.first[row] + geometry.step[row] * self.position(index, row)
        twice = np.flatnonzero(index >= len(self.grid))
        theta[twice] += TURN * self.beyond[index[twice] - len(self.grid)]
        return theta


def place(batch: SweepBatch, points: Points, again: Int64, beyond: Bool) -> Cloud:
    """Give the points coordinates.

    Parameters
    ----------
    batch : the sweeps the points come from
    points : M points
    again : (N - M,) points to list once more at the end
    beyond : (N - M,) whether those then lie past the seam
    """
    cell = np.flatnonzero(points.valid)
    if len(again):
        cell = np.concatenate([cell, cell[again]])
    cos, sin = _directions(batch, points)
    table = points.table(points.range)
    x, y = (table * cos).reshape(-1), (table * sin).reshape(-1)
    return Cloud(points, cell, beyond, x.take(cell, mode="clip"), y.take(cell, mode="clip"))


def _directions(batch: SweepBatch, points: Points) -> tuple[Float64, Float64]:
    """cos θ and sin θ of the cells: computed once per distinct geometry of the batch. (1 or S, stride) each."""
    position = np.arange(points.stride) - MARGIN
    start, increment = batch.angle_min, batch.angle_increment
    last = points.geometry.reverse * (points.geometry.bearings - 1.0)
    code = None
    if all(bool((values == values[:1]).all()) for values in (start, increment, last)):
        start, increment, last = start[:1, None], increment[:1, None], last[:1, None]
    else:
        distinct, code = np.unique(np.stack([start, increment, last], axis=1), axis=0, return_inverse=True)
        start, increment, last = (column[:, None] for column in distinct.T)
    theta = start + increment * np.where(increment < 0, last - position, position)
    cos, sin = np.cos(theta), np.sin(theta)
    return (cos, sin) if code is None else (cos[code.reshape(-1)], sin[code.reshape(-1)])
