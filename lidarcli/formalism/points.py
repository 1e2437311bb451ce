"""The valid beams of a batch as flat arrays in counter-clockwise order: what every later step works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import TURN, Bool, Closure, Float64, Int32, Int64, Status, SweepBatch


@dataclass(frozen=True, slots=True)
class Geometry:
    """Where the beams of a batch point, counter-clockwise whatever the sign of the increment.

    Position k = 0, 1, … counts the beams of a sweep by increasing bearing: with a negative increment the last beam has
    position 0.
    """

    first: Float64
    """(S,) bearing of position 0 [rad]."""
    step: Float64
    """(S,) |angle_increment| [rad]."""
    period: Int64
    """(S,) positions in a full turn, 0 for a partial view; one less than the beams where the first and the last beam
    share a bearing."""
    reverse: Bool
    """(S,) whether the log counts the beams clockwise."""
    beams: Int32

    @staticmethod
    def of(batch: SweepBatch) -> Geometry:
        """The geometry of each row of a batch."""
        reverse = batch.angle_increment < 0
        last = batch.angle_min + (batch.beams - 1) * batch.angle_increment
        period = np.where(
            batch.closure == Closure.OPEN, 0, batch.beams - (batch.closure == Closure.SHARED)
        ).astype(np.int64)
        return Geometry(
            first=np.where(reverse, last, batch.angle_min),
            step=np.abs(batch.angle_increment),
            period=period,
            reverse=reverse,
            beams=batch.beams,
        )

    def beam(self, row: Int64, position: Int64) -> Int64:
        """Index in the log of the beam at a position, which may lie beyond the seam (Def. 1's n)."""
        period = self.period[row]
        position = np.where(period > 0, position % np.maximum(period, 1), position)
        beam: Int64 = np.where(self.reverse[row], self.beams[row] - 1 - position, position)
        return beam


@dataclass(frozen=True, slots=True)
class Points:
    """M valid beams of S sweeps, row after row, counter-clockwise within each.

    In a full turn a row may start anywhere; positions then run on past the seam, so that they always increase.
    """

    geometry: Geometry
    start: Int64
    """(S + 1,) the points of row i are `start[i]:start[i + 1]`."""
    row: Int64
    """(M,) row of each point."""
    position: Int64
    """(M,) counter-clockwise position of its beam."""
    range: Float64
    """(M,) r [m], Def. 1."""
    x: Float64
    """(M,) forward [m], sensor frame."""
    y: Float64
    """(M,) left [m]."""

    def __len__(self) -> int:
        return len(self.row)

    def theta(self, index: Int64) -> Float64:
        """Bearing [rad] of the points of `index`, growing past the seam."""
        row, position = self.row[index], self.position[index]
        period = self.geometry.period[row]
        beyond = (position >= period) & (period > 0)
        theta: Float64 = self.geometry.first[row] + self.geometry.step[row] * (position - beyond * period)
        return theta + beyond * TURN

    def take(self, order: Int64, position: Int64) -> Points:
        """The points in another order within each row, with their new positions."""
        return Points(
            geometry=self.geometry,
            start=self.start,
            row=self.row,
            position=position,
            range=self.range[order],
            x=self.x[order],
            y=self.y[order],
        )


def counted_once(batch: SweepBatch) -> Bool:
    """(S, B) the valid beams; where the first and the last beam of a turn share a bearing, without the last."""
    valid: Bool = batch.status == Status.VALID
    rows = np.flatnonzero(batch.closure == Closure.SHARED)
    valid[rows, batch.beams[rows] - 1] = False
    return valid


def collect(batch: SweepBatch) -> Points:
    """Gather the valid beams of a batch (Def. 1: r on Θ_k), each bearing once.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    Points with M = number of beams that have a range
    """
    geometry = Geometry.of(batch)
    valid = counted_once(batch)
    width = batch.width
    flat = np.flatnonzero(valid)
    if geometry.reverse.any():
        flat = flat[_counter_clockwise(flat, geometry, width)]
    row, column = np.divmod(flat, max(width, 1))
    position = (
        np.where(geometry.reverse[row], batch.beams[row] - 1 - column, column)
        if geometry.reverse.any()
        else column
    )
    counts = np.count_nonzero(valid, axis=1)
    start = np.zeros(len(batch) + 1, np.int64)
    np.cumsum(counts, out=start[1:])
    ranges = batch.ranges.reshape(-1)[flat].astype(np.float64)
    cos, sin = _directions(batch, row, column)
    return Points(geometry, start, row, position, ranges, ranges * cos, ranges * sin)


def _counter_clockwise(flat: Int64, geometry: Geometry, width: int) -> Int64:
    """Order that turns the points of clockwise rows round, each row in its place."""
    row, column = np.divmod(flat, width)
    order: Int64 = np.lexsort((np.where(geometry.reverse[row], -column, column), row))
    return order


def _directions(batch: SweepBatch, row: Int64, column: Int64) -> tuple[Float64, Float64]:
    """cos θ and sin θ of points: computed once per distinct geometry of the batch, then looked up."""
    pairs = np.stack([batch.angle_min, batch.angle_increment], axis=1)
    if (pairs == pairs[0]).all():
        distinct, code = pairs[:1], None
    else:
        distinct, code = np.unique(pairs, axis=0, return_inverse=True)
        code = code.reshape(-1)
    bearings = distinct[:, :1] + distinct[:, 1:] * np.arange(batch.width)
    cos, sin = np.cos(bearings), np.sin(bearings)
    if code is None:
        return cos[0][column], sin[0][column]
    index = code[row] * batch.width + column
    return cos.reshape(-1)[index], sin.reshape(-1)[index]


@dataclass(frozen=True, slots=True)
class Neighbours:
    """Points with `reach` neighbours repeated at both ends of each row, so that a window slides over the seam.

    All arrays are (E,), E = M + 2 reach S. In a partial view the neighbours beyond the edges do not exist: `inside`
    is False there, and values are those of some point of the row.
    """

    reach: int
    core: Int64
    """(M,) where each point stands in the extended arrays."""
    range: Float64
    position: Int64
    inside: Bool


def neighbours(points: Points, reach: int) -> Neighbours:
    """Extend each row of `points` by `reach` neighbours at both ends; over the seam on a full turn."""
    counts = np.diff(points.start)
    rows = len(counts)
    size = np.where(counts > 0, counts + 2 * reach, 0)
    begin = np.cumsum(size) - size
    row = np.repeat(np.arange(rows), size)
    offset = np.arange(len(row)) - np.repeat(begin + reach, size)
    turn, within = np.divmod(offset, counts[row])
    source = points.start[:-1][row] + within
    period = points.geometry.period[row]
    position: Int64 = points.position[source] + turn * period
    return Neighbours(
        reach=reach,
        core=np.arange(len(points))
        + (2 * points.row + 1) * reach
        - 2 * reach * _empty_before(counts)[points.row],
        range=points.range[source],
        position=position,
        inside=(turn == 0) | (period > 0),
    )


def _empty_before(counts: Int64) -> Int64:
    """(S,) how many rows without any point come before each row."""
    empty: Int64 = np.cumsum(counts == 0)
    return empty
