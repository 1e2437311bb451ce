"""Points of sweeps in zones, and how many beams of a sweep reach a zone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.masks import Circle, Masks, Polygon
from lidarcli.sweeps import TURN, Bool, Float32, Float64, Int32, Status, SweepBatch, SweepPoses
from lidarcli.zone import Line, inside

Shape = Circle | Polygon | Line
SAMPLES = 64
"""Places of a zone at which is asked whether a sweep sees them."""
_STEP = 0.7548776662466927, 0.5698402909980532
"""Steps of a sequence that fills a square evenly (powers of the plastic number)."""
_FLAT = 1e-9


class Inside(NamedTuple):
    """Points of a batch that are in an area, by sweep and beam."""

    row: NDArray[np.intp]
    """(K,) sweep, ascending."""
    beam: NDArray[np.intp]
    x: Float64
    y: Float64
    """(K,) in the frame of the zone [m]."""

    def of(self, some: NDArray[np.intp] | Bool) -> Inside:
        """Return some of the points."""
        return Inside(self.row[some], self.beam[some], self.x[some], self.y[some])

    def with_(self, more: Inside) -> Inside:
        """Return these points and more of them, in the order of sweeps and beams."""
        row, beam = np.concatenate([self.row, more.row]), np.concatenate([self.beam, more.beam])
        order = np.lexsort((beam, row))
        both = Inside(row, beam, np.concatenate([self.x, more.x]), np.concatenate([self.y, more.y]))
        return both.of(order)


def bounds(shape: Shape) -> tuple[float, float, float]:
    """Return a circle around a shape: its centre and radius [m]."""
    if isinstance(shape, Circle):
        return shape.x, shape.y, shape.radius
    corners = np.array(shape.corners if isinstance(shape, Polygon) else (shape.first, shape.second))
    x, y = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return float(x), float(y), float(np.hypot(*(corners - (x, y)).T).max())


def samples(shape: Shape) -> Float64:
    """Return (SAMPLES, 2) places that are spread evenly over a shape [m]; NaN where it has no area that holds any."""
    if isinstance(shape, Line):
        share = (np.arange(SAMPLES)[:, None] + 0.5) / SAMPLES
        along: Float64 = np.array(shape.first) + share * np.subtract(shape.second, shape.first)
        return along
    if isinstance(shape, Circle):
        low, size = np.array([shape.x, shape.y]) - shape.radius, np.full(2, 2.0 * shape.radius)
    else:
        corners = np.array(shape.corners)
        low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    found = np.empty((0, 2))
    # A thin zone in a corner of its box takes more of the sequence.
    for count in (1 << 10, 1 << 14, 1 << 18):
        places: Float64 = low + size * ((0.5 + np.arange(1, count + 1)[:, None] * np.array(_STEP)) % 1.0)
        found = places[inside(shape, *places.T)]
        if len(found) >= SAMPLES:
            return found[:SAMPLES]
    few: Float64 = np.resize(found if len(found) else np.nan, (SAMPLES, 2))
    return few


def candidates(batch: SweepBatch, ranges: Float32, place: SweepPoses, shape: Circle | Polygon) -> Inside:
    """Return the points of sweeps (S, B) that are inside of a shape.

    Parameters
    ----------
    ranges : (S, B) [m], NaN where a beam does not count
    place : poses of the sensor in the frame of the zone; a sweep without one has no points
    """
    x, y, radius = bounds(shape)
    way = 0.0 if place.way is None else np.abs(place.way[:, :2]).sum(axis=1)
    far = np.hypot(x - place.x, y - place.y) + way
    # Single precision rounds ranges by less than this.
    reach = radius + 1e-3
    rows = np.flatnonzero(np.isfinite(far))
    some = ranges if len(rows) == len(ranges) else ranges[rows]
    farthest, nearest = ((edge[rows, None]).astype(np.float32) for edge in (far + reach, far - 2.0 * way - reach))
    with np.errstate(invalid="ignore"):
        row, beam = np.nonzero((some <= farthest) & (some >= nearest))
    row = rows[row]
    bearing = batch.angle_min[row] + batch.angle_increment[row] * beam
    r = ranges[row, beam].astype(np.float64)
    share = None if place.way is None else batch.shares(row, beam)
    at_x, at_y = r * np.cos(bearing), r * np.sin(bearing)
    found_x, found_y, _ = place.to_world(row, at_x, at_y, np.zeros(len(row)), share)
    within = inside(shape, found_x, found_y)
    return Inside(row[within], beam[within], found_x[within], found_y[within])


def seen(batch: SweepBatch, place: SweepPoses, places: Float64) -> Bool:
    """Return which places (S, P) sweeps see: in view, within the limits of the sensor, and not behind a point.

    A beam without a return sees all the way; one that is masked or has no usable value sees nothing.

    Parameters
    ----------
    place : poses of the sensor in the frame of the places
    places : (P, 2) [m], or (S, P, 2) of each sweep
    """
    return _seen(batch, *_from_sensor(place, places))[0]


def _seen(batch: SweepBatch, bearing: Float64, distance: Float64) -> tuple[Bool, Bool]:
    """Return which places sweeps see, and which of the rest lie behind beams without a usable value."""
    step = batch.angle_increment[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        after = np.where(step < 0.0, -1.0, 1.0) * (bearing - batch.angle_min[:, None])
        at = np.rint(after % TURN / np.abs(step))
        # Half a step before the first beam is the first beam.
        at = np.where(np.rint((after % TURN - TURN) / np.abs(step)) == 0.0, 0.0, at)
        known = np.isfinite(at) & (at < batch.beams[:, None])
    column = np.where(known, at, 0).astype(np.intp)
    if not batch.width:
        return np.zeros(known.shape, np.bool_), np.zeros(known.shape, np.bool_)
    row = np.arange(len(batch))[:, None]
    status, ranges = batch.status[row, column], batch.ranges[row, column]
    farthest = np.where(batch.range_max > batch.range_min, batch.range_max, np.inf)[:, None]
    with np.errstate(invalid="ignore"):
        clear: Bool = (status == Status.NO_RETURN) & (distance <= farthest)
        clear |= (status == Status.VALID) & (distance <= ranges + 1e-3)
        clear &= known & (distance >= batch.range_min[:, None])
    return clear, known & (status != Status.VALID) & (status != Status.NO_RETURN)


def reach(batch: SweepBatch, place: SweepPoses, places: Float64, masks: Masks) -> Int32:
    """Return how many beams of each sweep (S,) could end at some places: from the first to the last that sees one of them.

    `masks` hide places, too, with a mount for each frame that they name; the rest as of `seen`. Where most beams that could
    see any are lost, none counts.
    """
    bearing, distance = _from_sensor(place, places)
    clear, lost = _seen(batch, bearing, distance)
    clear &= (2 * np.count_nonzero(lost, axis=1) <= np.count_nonzero(clear | lost, axis=1))[:, None]
    if masks.masks:
        clear &= ~masks.hide(batch, bearing, distance)
    # From one of them to both sides: only around the sensor do they spread over more than half a turn.
    begin = bearing[np.arange(len(batch)), clear.argmax(axis=1)]
    with np.errstate(divide="ignore", invalid="ignore"):
        side = np.where(clear, (bearing - begin[:, None] + 0.5 * TURN) % TURN - 0.5 * TURN, 0.0)
        beams = np.rint(np.ptp(side, axis=1) / np.abs(batch.angle_increment)) + 1.0
    return np.where(clear.any(axis=1), np.fmin(beams, batch.beams), 0.0).astype(np.int32)


def _from_sensor(place: SweepPoses, places: Float64) -> tuple[Float64, Float64]:
    """Return bearing [rad] and distance [m] of places from the sensors (S, P)."""
    dx, dy = places[..., 0] - place.x[:, None], places[..., 1] - place.y[:, None]
    turned = np.arctan2(dy, dx) - place.yaw[:, None]
    return np.where(place.upside_down[:, None], -turned, turned), np.hypot(dx, dy)


def distance_to(shape: Circle | Polygon, x: Float64, y: Float64) -> Float64:
    """Return how far points (N,) are from a shape, 0 inside [m]."""
    if isinstance(shape, Circle):
        return np.maximum(np.hypot(x - shape.x, y - shape.y) - shape.radius, 0.0)
    nearest = np.full(x.shape, np.inf)
    first_x, first_y = shape.corners[-1]
    for second_x, second_y in shape.corners:
        nearest = np.minimum(nearest, distance_to_line(Line((first_x, first_y), (second_x, second_y)), x, y))
        first_x, first_y = second_x, second_y
    return np.where(inside(shape, x, y), 0.0, nearest)


def distance_to_line(line: Line, x: Float64, y: Float64) -> Float64:
    """Return how far points (N,) are from a line [m]."""
    (first_x, first_y), (second_x, second_y) = line.first, line.second
    dx, dy = second_x - first_x, second_y - first_y
    length = max(math.hypot(dx, dy), _FLAT)
    along = np.clip(((x - first_x) * dx + (y - first_y) * dy) / length**2, 0.0, 1.0)
    away: Float64 = np.hypot(x - first_x - along * dx, y - first_y - along * dy)
    return away
