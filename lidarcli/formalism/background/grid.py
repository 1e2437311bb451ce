"""The bearings of a background, and sweeps with other bearings or from another place as they look from there."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.background.stations import Shift
from lidarcli.range_rules import NEAREST
from lidarcli.sweeps import TURN, Bool, Closure, Float64, Int32, SweepBatch, record

SAME_BEAM = 0.05
"""Bearings that differ by less than this share of a step are the same."""


def beam_at(
    angle_min: float | Float64,
    angle_increment: float | Float64,
    beams: int | Int32,
    period: int | Int32,
    bearing: Float64,
) -> Int32:
    """The beam of a geometry whose bearing is nearest; -1 where the bearing is out of view. Any shape.

    >>> beam_at(0.0, np.pi / 2, 4, 4, np.array([0.1, -0.1, 3 * np.pi])).tolist()
    [0, 0, 2]
    >>> beam_at(0.0, -0.1, 4, 0, np.array([-0.31, -0.4, 0.04, -0.1 + TURN])).tolist()
    [3, -1, 0, 1]
    """
    offset = (bearing - angle_min) / angle_increment
    turn = np.abs(TURN / angle_increment)
    # Half a step before the first beam still belongs to it.
    beam = np.rint(offset - turn * np.floor((offset + 0.5) / turn)).astype(np.int32)
    beyond = np.where(np.asarray(period) > 0, beam % np.maximum(period, 1), -1)
    limit = np.where(np.asarray(period) > 0, period, beams)
    return np.where(beam < limit, beam, beyond).astype(np.int32)


@record
class Grid:
    """The bearings of a background: those of the sweeps it was made of, or of the first of them."""

    angle_min: float
    angle_increment: float
    beams: int
    period: int
    """Number of distinct bearings of a full turn, 0 for a partial view."""

    def bearings(self) -> Float64:
        """(B,) bearings [rad]."""
        bearings: Float64 = self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)
        return bearings

    def beam(self, bearing: Float64) -> Int32:
        """The beam whose bearing is nearest; -1 where the bearing is out of view. Any shape."""
        return beam_at(self.angle_min, self.angle_increment, self.beams, self.period, bearing)

    def fits(self, batch: SweepBatch) -> Bool:
        """(S,) sweeps with the same bearings, beam by beam."""
        first = batch.angle_min - self.angle_min
        last = first + (self.beams - 1) * (batch.angle_increment - self.angle_increment)
        slack = SAME_BEAM * abs(self.angle_increment)
        result: Bool = (batch.beams == self.beams) & (np.abs(first) < slack) & (np.abs(last) < slack)
        return result

    @staticmethod
    def of(batch: SweepBatch, row: int) -> Grid:
        """The bearings of a sweep."""
        beams, kind = int(batch.beams[row]), batch.closure[row]
        period = 0 if kind == Closure.OPEN else beams - int(kind == Closure.SHARED)
        return Grid(float(batch.angle_min[row]), float(batch.angle_increment[row]), beams, period)


def project(batch: SweepBatch, grid: Grid, moved: Shift | None) -> tuple[Int32, Float64]:
    """The beams of sweeps as a station sees their ends.

    Parameters
    ----------
    batch : S sweeps of up to B beams
    grid : bearings at the station
    moved : (S,) where the sensor was, seen from the station; None: there, or nobody knows

    Returns
    -------
    beam : (S, B) beam of the station; -1 out of its view and for padding. A beam without a range keeps its direction
    range : (S, B) distance from the station [m], NaN without a range
    """
    bearing = batch.bearings()
    ranges = batch.ranges.astype(np.float64)
    if moved is not None:
        valid = ~np.isnan(ranges)
        # From where the sensor was at each beam to where it was at the first, and from there to the station.
        ahead, left, turn = moved.during(batch.all_shares())
        own = bearing + turn
        x, y = ranges * np.cos(own) + ahead, ranges * np.sin(own) + left
        cos, sin = np.cos(moved.yaw)[:, None], np.sin(moved.yaw)[:, None]
        x, y = cos * x - sin * y + moved.x[:, None], sin * x + cos * y + moved.y[:, None]
        bearing = np.where(valid, np.arctan2(y, x), own + moved.yaw[:, None])
        ranges = np.hypot(x, y)
    beam = grid.beam(bearing)
    beam[np.arange(batch.width) >= batch.beams[:, None]] = -1
    return beam, ranges


def expected(batch: SweepBatch, grid: Grid, ranges: Float64, moved: Shift) -> Float64:
    """What sensors would see that stand beside a station, of what the station sees.

    Parameters
    ----------
    batch : S sweeps of up to B beams
    grid : C bearings at the station
    ranges : (S, C) what the station of each sweep sees [m]; inf: nothing, NaN: not known
    moved : (S,) where the sensor was, seen from the station

    Returns
    -------
    (S, B) ranges [m]: the nearest where several fall on one beam, NaN where none does
    """
    bearing = np.broadcast_to(grid.bearings(), ranges.shape)
    finite = np.isfinite(ranges)
    distance = np.where(finite, ranges, 0.0)
    x = distance * np.cos(bearing) - moved.x[:, None]
    y = distance * np.sin(bearing) - moved.y[:, None]
    turned = np.where(finite, np.arctan2(y, x), bearing) - moved.yaw[:, None]
    beam = _beam_of(batch, turned)
    if moved.way is not None:
        # The beam that looked there was taken later, from elsewhere.
        ahead, left, turn = moved.during(batch.shares(np.arange(len(batch))[:, None], beam))
        cos, sin = np.cos(moved.yaw)[:, None], np.sin(moved.yaw)[:, None]
        x, y = cos * x + sin * y - ahead, cos * y - sin * x - left
        turned = np.where(finite, np.arctan2(y, x), bearing - moved.yaw[:, None]) - turn
        beam = np.where(beam < 0, -1, _beam_of(batch, turned))
    seen = np.full((len(batch), batch.width), np.inf)
    known = np.zeros(seen.shape, bool)
    row, column = np.nonzero((beam >= 0) & ~np.isnan(ranges))
    known[row, beam[row, column]] = True
    row, column = np.nonzero((beam >= 0) & finite)
    np.minimum.at(seen, (row, beam[row, column]), np.maximum(np.hypot(x, y), NEAREST)[row, column])
    return np.where(known, seen, np.nan)


def _beam_of(batch: SweepBatch, bearing: Float64) -> Int32:
    """(S, C) the beams of sweeps that look along bearings (S, C) of their own [rad], -1 for none."""
    bearings = batch.beams - (batch.closure == Closure.SHARED)
    return beam_at(
        batch.angle_min[:, None],
        batch.angle_increment[:, None],
        batch.beams[:, None],
        np.where(batch.closure == Closure.OPEN, 0, bearings)[:, None],
        bearing,
    )
