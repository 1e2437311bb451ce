"""The valid beams of a batch in counter-clockwise order: a grid of cells, and the points in it that runs are made of."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.ragged import offsets_of, spans
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import TURN, Bool, Closure, Float32, Float64, Int32, Int64, SweepBatch, UInt8

MARGIN = 4
"""Empty cells before and after each sweep: no look at so many neighbours reaches the next sweep."""
BLOCK = 32
"""Sweeps are padded to a multiple of this many cells; sums by blocks do not depend on the padding."""
NEVER = np.int64(1 << 40)
"""Number of lost beams between a point and a predecessor that does not exist."""


@record
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
        return Geometry(*bearings_of(batch.angle_min, batch.angle_increment, batch.beams, batch.closure))

    def beam(self, row: Int64, position: Int64) -> Int64:
        """Index in the log of the beam at a position, at most one turn beyond the seam on either side (Def. 1's n)."""
        return beam_at(row, position, self.period, self.reverse, self.bearings)


@compiled
def bearings_of(
    angle_min: Float64, angle_increment: Float64, beams: Int32, closure: UInt8
) -> tuple[Float64, Float64, Int64, Bool, Int32]:
    """Columns of the `Geometry` of sweeps with the angles, beams and closures of a `SweepBatch`."""
    reverse = angle_increment < 0
    bearings = beams - (closure == Closure.SHARED.value)
    last = angle_min + (bearings - 1) * angle_increment
    period = bearings.astype(np.int64)
    period[closure == Closure.OPEN.value] = 0
    return np.where(reverse, last, angle_min), np.abs(angle_increment), period, reverse, bearings


def beam_at(row: Int64, position: Int64, period: Int64, reverse: Bool, bearings: Int32) -> Int64:
    """`Geometry.beam` from the arrays of a geometry."""
    if period.any():
        turn = period[row]
        position = position - turn * (position >= turn) + turn * ((position < 0) & (turn > 0))
    if reverse.any():
        position = np.where(reverse[row], bearings[row] - 1 - position, position)
    return position


@record
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


def refuse_geometry(batch: SweepBatch) -> None:
    """Refuse sweeps whose bearings are no numbers; the readers of logs have done so before.

    Raises
    ------
    ValueError
        `angle_min` or `angle_increment` of a sweep is NaN or infinite.
    """
    for name in ("angle_min", "angle_increment"):
        values = getattr(batch, name)
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            row = int(wrong[0])
            raise ValueError(
                f"sweep {int(batch.sweep[row])} of {batch.topic}: {name} is {values[row]}, not a finite angle"
            )


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
    stride = -(-(batch.width + 2 * MARGIN) // BLOCK) * BLOCK
    return Points(geometry, stride, *lay_out(batch.ranges, geometry.bearings, geometry.reverse, stride))


@compiled
def lay_out(
    ranges: Float32, bearings: Int32, reverse: Bool, stride: int
) -> tuple[Float64, Bool, Int64, Int64, Int64, Int64, Int64, Int64]:
    """The cells of (S, B) ranges, NaN where there is none, and the stretches of points in them.

    Returns `Points.range`, `valid`, `begin`, `end`, `row`, `rank`, `stretches` and `start`.
    """
    rows, width = ranges.shape
    table = np.full((rows, stride), np.nan)
    column = np.arange(width)
    # Where the first and the last beam share a bearing, the last does not count.
    table[:, MARGIN : MARGIN + width] = np.where(column < bearings[:, None], ranges, np.nan)
    turned = np.flatnonzero(reverse)
    beam = bearings[turned, None] - 1 - column
    table[turned, MARGIN : MARGIN + width] = np.where(
        beam >= 0, ranges[turned[:, None], np.maximum(beam, 0)], np.nan
    )

    cells = table.reshape(-1)
    valid = cells == cells
    bounds = np.flatnonzero(valid[1:] != valid[:-1])
    begin, end = bounds[0::2] + 1, bounds[1::2]
    row = begin // stride
    rank = offsets_of(end - begin + 1)
    stretches = offsets_of(np.bincount(row, minlength=rows))
    return cells, valid, begin, end, row, rank[:-1], stretches, rank[stretches]


@record
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
    cos, sin, code = _directions(batch, points)
    cell, x, y = coordinates(
        points.range, points.begin, points.end, points.row, again, cos, sin, code, points.stride
    )
    return Cloud(points, cell, beyond, x, y)


@compiled
def coordinates(
    cells: Float64,
    begin: Int64,
    end: Int64,
    row: Int64,
    again: Int64,
    cos: Float64,
    sin: Float64,
    code: Int64,
    stride: int,
) -> tuple[Int64, Float64, Float64]:
    """Cell and coordinates of the points.

    Parameters
    ----------
    cells : (S * stride,) ranges
    begin, end, row : (G,) first cell, last cell and row of each stretch of points
    again : numbers of the points to list once more at the end
    cos, sin : (D, stride) of the bearings of the cells
    code : (S,) which of these each row has
    """
    cell, _, _ = spans(begin, end - begin + 1)
    table = cells.reshape(-1, stride)
    x, y = (table * cos[code]).reshape(-1), (table * sin[code]).reshape(-1)
    cell = np.concatenate([cell, cell[again]])
    return cell, x[cell], y[cell]


def _directions(batch: SweepBatch, points: Points) -> tuple[Float64, Float64, Int64]:
    """cos θ and sin θ of the cells, once per distinct geometry of the batch, (D, stride); which of them, (S,)."""
    last = points.geometry.reverse * (points.geometry.bearings - 1.0)
    columns = (batch.angle_min, batch.angle_increment, last)
    if len(batch) and alike(*columns):
        start, increment, end = (float(values[0]) for values in columns)
        cos, sin = _row_directions(start, increment, end, points.stride)
        return cos[None], sin[None], np.zeros(len(batch), np.int64)
    number: dict[tuple[float, float, float], int] = {}
    rows = zip(*(values.tolist() for values in columns), strict=True)
    code = np.array([number.setdefault(row, len(number)) for row in rows], np.int64)
    tables = np.empty((2, len(number), points.stride))
    for (start, increment, end), row in number.items():
        tables[:, row] = _row_directions(start, increment, end, points.stride)
    return tables[0], tables[1], code


@compiled
def alike(start: Float64, increment: Float64, last: Float64) -> bool:
    """Whether all rows have the same three values, (S,) each."""
    return all(bool((values == values[:1]).all()) for values in (start, increment, last))


@lru_cache(maxsize=64)
def _row_directions(start: float, increment: float, last: float, stride: int) -> tuple[Float64, Float64]:
    """cos θ and sin θ of the cells of one row. Sensors seldom have more geometries than these, batch after batch."""
    position = np.arange(stride) - MARGIN
    theta = start + increment * (last - position if increment < 0 else position)
    cos, sin = np.cos(theta), np.sin(theta)
    cos.flags.writeable = sin.flags.writeable = False
    return cos, sin
