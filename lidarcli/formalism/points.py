"""The valid beams of a batch as flat arrays in counter-clockwise order: what every later step works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.ragged import offsets_of
from lidarcli.sweeps import TURN, Bool, Closure, Float64, Int32, Int64, Status, SweepBatch


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
        period = np.where(batch.closure == Closure.OPEN, 0, bearings).astype(np.int64)
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
    """M valid beams of S sweeps, row after row, counter-clockwise within each."""

    geometry: Geometry
    start: Int64
    """(S + 1,) the points of row i are `start[i]:start[i + 1]`."""
    row: Int64
    """(M,) row of each point."""
    position: Int64
    """(M,) counter-clockwise position of its beam."""
    range: Float64
    """(M,) r [m], Def. 1."""

    def __len__(self) -> int:
        return len(self.row)


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points with their coordinates. In a full turn a row may start anywhere: positions run on past the seam."""

    geometry: Geometry
    start: Int64
    row: Int64
    position: Int64
    """(M,) increasing within each row."""
    range: Float64
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
    start = offsets_of(np.count_nonzero(valid, axis=1))
    flat = np.flatnonzero(valid)
    row = np.repeat(np.arange(len(batch)), np.diff(start))
    position = flat - row * batch.width
    if geometry.reverse.any():
        position = np.where(geometry.reverse[row], geometry.bearings[row] - 1 - position, position)
        order = np.lexsort((position, row))
        flat, position = flat[order], position[order]
    ranges = batch.ranges.reshape(-1)[flat].astype(np.float64)
    return Points(geometry, start, row, position, ranges)


def place(batch: SweepBatch, points: Points, order: Int64, beyond: Bool | None) -> Cloud:
    """Put the points in another order within their rows and give them coordinates.

    Parameters
    ----------
    batch : the sweeps the points come from
    points : M points
    order : (M,) which point comes where
    beyond : (M,) whether a point now lies past the seam; None: none does
    """
    ranges, position = points.range[order], points.position[order]
    reverse = points.geometry.reverse
    beam = position
    if reverse.any():
        beam = np.where(reverse[points.row], points.geometry.bearings[points.row] - 1 - position, position)
    cos, sin = _directions(batch, points.row, beam)
    if beyond is not None:
        position = position + beyond * points.geometry.period[points.row]
    return Cloud(points.geometry, points.start, points.row, position, ranges, ranges * cos, ranges * sin)


def _directions(batch: SweepBatch, row: Int64, beam: Int64) -> tuple[Float64, Float64]:
    """cos θ and sin θ of points: computed once per distinct geometry of the batch, then looked up."""
    pairs = np.stack([batch.angle_min, batch.angle_increment], axis=1)
    uniform = bool((pairs == pairs[:1]).all())
    distinct, code = (pairs[:1], None) if uniform else np.unique(pairs, axis=0, return_inverse=True)
    bearings = distinct[:, :1] + distinct[:, 1:] * np.arange(batch.width)
    index = beam if code is None else code.reshape(-1)[row] * batch.width + beam
    return np.cos(bearings).reshape(-1)[index], np.sin(bearings).reshape(-1)[index]


def neighbour(points: Points, index: Int64, offset: int) -> tuple[Int64, Int64, Bool]:
    """The points `offset` places further along their sweep than those of `index`, over the seam on a full turn.

    Returns
    -------
    other : indices; where there is no such point, some point of the same row
    position : their positions, beyond the turn (or below 0) where the seam lies between
    exists : whether there is such a point
    """
    other = index + offset
    np.clip(other, 0, len(points) - 1, out=other)
    row = points.row[index]
    position = points.position[other]
    outside = np.flatnonzero((points.row[other] != row) | (other != index + offset))
    exists = np.ones(len(index), bool)
    if len(outside):
        row = row[outside]
        begin, end = points.start[row], points.start[row + 1]
        period = points.geometry.period[row]
        turn = 1 if offset > 0 else -1
        over = index[outside] + offset - turn * (end - begin)
        exists[outside] = (period > 0) & (over >= begin) & (over < end)
        other[outside] = np.clip(over, begin, end - 1)
        position[outside] = points.position[other[outside]] + turn * period
    return other, position, exists
