"""Contents of zones: points of sweeps, what a moving shape will meet, episodes, and visits and crossings by agents."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps.masks import Circle, Masks, Polygon
from lidarcli.sweeps.types import (
    TURN,
    Bool,
    Closure,
    Float32,
    Float64,
    Int32,
    Int64,
    Status,
    SweepBatch,
    SweepPoses,
    UInt64,
)
from lidarcli.sweeps.zone import Line, inside

Shape = Circle | Polygon | Line
SAMPLES = 64
"""Places of a zone at which is asked whether a sweep observes them: a bit each of a number."""
HIDES = 0.3
"""Least width of lost beams side by side behind which somebody may stand [m]; narrower are those that dark objects lose."""
AHEAD = 3.0
"""Length of the way that a robot would have driven, on which is told what was ahead [m]."""
HALF_WIDTH = 0.3
"""Half of its width where no footprint says it [m]."""
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
    return np.resize(found if len(found) else np.nan, (SAMPLES, 2))


def candidates(batch: SweepBatch, ranges: Float32, place: SweepPoses, shape: Circle | Polygon) -> Inside:
    """Return the points of sweeps (S, B) inside of a shape, of ranges [m] that are NaN where a beam does not count.

    `place`: poses of the sensor in the frame of the zone; a sweep without one has no points.
    """
    x, y, radius = bounds(shape)
    travelled = 0.0 if place.way is None else np.abs(place.way[:, :2]).sum(axis=1)
    far = np.hypot(x - place.x, y - place.y) + travelled
    # Single precision rounds ranges by less than this.
    reach = radius + 1e-3
    rows = np.flatnonzero(np.isfinite(far))
    some = ranges if len(rows) == len(ranges) else ranges[rows]
    farthest, nearest = ((edge[rows, None]).astype(np.float32) for edge in (far + reach, far - 2.0 * travelled - reach))
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


def on_the_way(points: Inside, velocity: Float64, half_width: float) -> tuple[Bool, Float64]:
    """Return which points (K,) are on the way of the robot, an arc, and how far along it they are [m].

    Parameters
    ----------
    points : in the frame of the robot
    velocity : (S, 3) of the robot in each sweep: ahead, left [m/s], turning [rad/s]
    """
    vx, vy, turning = velocity[points.row].T
    speed = np.hypot(vx, vy)
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead, left = (vx * points.x + vy * points.y) / speed, (vx * points.y - vy * points.x) / speed
        bend = np.where(turning < 0.0, -1.0, 1.0)
        # Of a straight line the radius is far beyond all that a sensor sees.
        radius = speed / np.maximum(np.abs(turning), 1e-6 * speed)
        across = radius - bend * left
        along = radius * np.arctan2(ahead, across)
        away = np.abs(np.hypot(ahead, across) - radius)
        return (along > 0.0) & (along < AHEAD) & (away < half_width), along


def seen(batch: SweepBatch, place: SweepPoses, places: Float64) -> Bool:
    """Return which places (S, P) sweeps see: in view, within the limits of the sensor, and not behind a point.

    A beam without a return observes all the path; one that is masked or has no usable value observes nothing. The places
    are (P, 2) [m], or (S, P, 2) of each sweep, in the frame of the poses."""
    return _seen(batch, *_from_sensor(place, places))[0]


def _seen(batch: SweepBatch, bearing: Float64, distance: Float64) -> tuple[Bool, Bool, Float64]:
    """Return which places sweeps see, which of the rest are within the limits, and how wide their lost beams are [m].

    The width is that of all lost beams side by side at the place, and 0 where the beam to it is not lost. The limits of a
    sweep that has no range, or of which most beams are lost, are not believed: all that is in view is within them.
    """
    step = batch.angle_increment[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        after = np.where(step < 0.0, -1.0, 1.0) * (bearing - batch.angle_min[:, None])
        at = np.rint(after % TURN / np.abs(step))
        # Half a step before the first beam is the first beam.
        at = np.where(np.rint((after % TURN - TURN) / np.abs(step)) == 0.0, 0.0, at)
        known = np.isfinite(at) & (at < batch.beams[:, None])
    column = np.where(known, at, 0).astype(np.intp)
    if not batch.width:
        return np.zeros(known.shape, np.bool_), np.zeros(known.shape, np.bool_), np.zeros(known.shape)
    row = np.arange(len(batch))[:, None]
    status, ranges = batch.status[row, column], batch.ranges[row, column]
    farthest = np.where(batch.range_max > batch.range_min, batch.range_max, np.inf)[:, None]
    with np.errstate(invalid="ignore"):
        within = known & (distance >= batch.range_min[:, None]) & (distance <= farthest)
        clear: Bool = within & (status == Status.NO_RETURN)
        clear |= known & (status == Status.VALID) & (distance <= ranges + 1e-3) & (distance >= batch.range_min[:, None])
        in_a_row = _in_a_row(batch)
        width = np.where(known, in_a_row[row, column] * np.abs(step) * distance, 0.0)
    believed = (batch.status == Status.VALID).any(axis=1) & (2 * np.count_nonzero(in_a_row, axis=1) <= batch.beams)
    return clear, (within | (known & ~believed[:, None])) & ~clear, width


def _in_a_row(batch: SweepBatch) -> Int32:
    """Return of each beam (S, B) that is lost how many are so side by side, itself among them; 0 of others."""
    lost = np.zeros((len(batch), batch.width + 1), np.bool_)
    lost[:, :-1] = ~np.isin(batch.status, (Status.VALID, Status.NO_RETURN, Status.PADDING))
    counts = np.zeros(lost.shape, np.int32)
    begin, end = np.flatnonzero(np.diff(lost.ravel(), prepend=False)).reshape(-1, 2).T
    counts[lost] = np.repeat(end - begin, end - begin)
    last = np.maximum(batch.beams - 1, 0)
    around = (batch.closure != Closure.OPEN) & lost[:, 0] & lost[np.arange(len(batch)), last] & (counts[:, 0] <= last)
    for row in np.flatnonzero(around).tolist():
        first, final = counts[row, 0], counts[row, last[row]]
        counts[row, :first] = counts[row, last[row] + 1 - final : last[row] + 1] = first + final
    return counts[:, :-1]


class ZoneSight(NamedTuple):
    """What sweeps (S,) see of places."""

    beams: Int32
    """(S,) beams that could end at some of them: from the first to the last that observes one; 0 where most are lost."""
    seen: UInt64
    lost: UInt64
    """(S,) a bit for each place that they see, and for each that too many lost beams side by side keep from them."""


def sight(batch: SweepBatch, place: SweepPoses, places: Float64, masks: Masks) -> ZoneSight:
    """Return what sweeps see of places.

    `masks` hide places, too, with a mount for each frame that they name; the rest as of `observed`. A sweep that shows
    nothing has lost all that is in view; nothing is lost behind the robot itself, as masks tell."""
    bearing, distance = _from_sensor(place, places)
    clear, rest, width = _seen(batch, bearing, distance)
    shows = batch.observed[:, None]
    lost = (rest & (width >= HIDES)) | (~shows & (rest | clear))
    enough = 2 * np.count_nonzero(width, axis=1) <= np.count_nonzero(clear | (width > 0.0), axis=1)
    clear &= shows
    if masks.masks:
        clear &= ~masks.hide(batch, bearing, distance)
        lost &= ~masks.hide(batch, bearing, distance, beyond=True)
    bits = [np.packbits(each, axis=1, bitorder="little").view(np.uint64)[:, 0] for each in (clear, lost)]
    clear &= enough[:, None]
    # From one of them to both sides: only around the sensor do they spread over more than half a turn.
    begin = bearing[np.arange(len(batch)), clear.argmax(axis=1)]
    with np.errstate(divide="ignore", invalid="ignore"):
        side = np.where(clear, (bearing - begin[:, None] + 0.5 * TURN) % TURN - 0.5 * TURN, 0.0)
        beams = np.rint(np.ptp(side, axis=1) / np.abs(batch.angle_increment)) + 1.0
    return ZoneSight(np.where(clear.any(axis=1), np.fmin(beams, batch.beams), 0.0).astype(np.int32), *bits)


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
    return np.hypot(x - first_x - along * dx, y - first_y - along * dy)


# Points that a moving shape will meet: the steps of the Collision Monitor's action `approach`.

_ROUNDING = 1e-6
"""Share of its reach by which the bounding circle of a shape is wider, for no rounding to leave a point out."""


def times(time_before_collision: float, time_step: float) -> Float64:
    """Return the times (K,) [s] that are tested, 0 the first; each is the sum of the steps before it."""
    tested: list[float] = []
    time = 0.0
    while time <= time_before_collision:
        tested.append(time)
        time += time_step
    return np.array(tested)


def collision_steps(
    shape: Circle | Polygon,
    points: Inside,
    velocity: Float64,
    time_before_collision: float,
    time_step: float,
    point_velocity: Float64 | None = None,
) -> Int32:
    """Count the points that are inside of a shape at each tested time (S, K), while it moves with the robot.

    The robot moves by a step before each test, the first one too, and its velocity turns with it; so does
    `getCollisionTime`, hence a contact counts that lies up to one step beyond the time that it is given for. Shape and
    points (N,) are in the frame of the robot before it moves [m]; `velocity` (S, 3) is ahead, left [m/s], turning [rad/s],
    and where one is NaN nothing is met; `point_velocity` (N, 2) is that of each point [m/s]; they stand by default.
    """
    steps = len(times(time_before_collision, time_step))
    counts = np.zeros((len(velocity), steps), np.int32)
    for step, met in enumerate(_met(shape, points, velocity, steps, time_step, point_velocity)):
        counts[:, step] = np.bincount(points.row[met], minlength=len(velocity))
    return counts


def meeting(
    shape: Circle | Polygon,
    points: Inside,
    velocity: Float64,
    step: NDArray[np.intp],
    time_step: float,
    point_velocity: Float64 | None = None,
) -> NDArray[np.intp]:
    """Return the points that are inside of a shape at one tested time of each sweep, `step` (S,): -1 for none.

    The other parameters are those of `collision_steps`; the points come by index, in ascending order.
    """
    moves = _met(shape, points, velocity, int(step.max(initial=-1)) + 1, time_step, point_velocity)
    met = [inside_now[step[points.row[inside_now]] == number] for number, inside_now in enumerate(moves)]
    return np.sort(np.concatenate(met)) if met else np.zeros(0, np.intp)


def _met(
    shape: Circle | Polygon, points: Inside, velocity: Float64, steps: int, time_step: float, point_velocity: Float64 | None
) -> Iterator[NDArray[np.intp]]:
    """Yield the points that are inside of the shape after each step, by index."""
    row, _, x, y = points
    reach = _reach(shape)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])[row]
    if point_velocity is not None:
        speed = speed + np.hypot(point_velocity[:, 0], point_velocity[:, 1])
    near = np.flatnonzero(np.hypot(x, y) <= reach + speed * (time_step * steps * (1.0 + _ROUNDING)))
    x, y, row = x[near], y[near], row[near]
    if point_velocity is not None:
        point_velocity = point_velocity[near]
    ahead, left, turning = velocity.T
    at_x, at_y, yaw = np.zeros((3, len(velocity)))
    turn = turning * time_step
    cos_turn, sin_turn = np.cos(turn), np.sin(turn)
    for step in range(steps):
        at_x, at_y, yaw = at_x + ahead * time_step, at_y + left * time_step, yaw + turn
        ahead, left = ahead * cos_turn - left * sin_turn, ahead * sin_turn + left * cos_turn
        now_x, now_y = x - at_x[row], y - at_y[row]
        if point_velocity is not None:
            now_x += point_velocity[:, 0] * (time_step * (step + 1))
            now_y += point_velocity[:, 1] * (time_step * (step + 1))
        close = np.flatnonzero(now_x * now_x + now_y * now_y <= reach * reach)
        now_x, now_y, rows = now_x[close], now_y[close], row[close]
        cos, sin = np.cos(yaw)[rows], np.sin(yaw)[rows]
        yield near[close[inside(shape, now_x * cos + now_y * sin, -now_x * sin + now_y * cos)]]


def _reach(shape: Circle | Polygon) -> float:
    """Return the radius about the robot beyond which nothing is inside [m]."""
    if isinstance(shape, Circle):
        reach = float(np.hypot(shape.x, shape.y)) + shape.radius
    else:
        reach = float(np.hypot(*np.array(shape.corners).T).max())
    return reach * (1.0 + _ROUNDING)


# Episodes of a zone: from the sweep in which it is occupied long enough to the last one before it is free.


class Episode(NamedTuple):
    """One time in which a zone is occupied, by index of its sweeps."""

    first: int
    """The sweep that completes the trigger."""
    last: int
    """The last one with enough points."""
    cut: bool
    """True where it goes on at an end of the log."""


def episodes(
    enough: Bool, time_ns: Int64, *, trigger: int, release: int, hold_ns: int, longest_gap_ns: int
) -> list[Episode]:
    """Return the episodes of sweeps (S,) in the order of time.

    An episode begins with the sweep that is the `trigger`-th in a row with enough points. It ends as soon as `release`
    sweeps in a row have fewer and `hold_ns` have passed since the last one with enough. Nobody knows what was in a gap
    between two sweeps that is longer than `longest_gap_ns`: an episode ends before it, and all counts begin again.
    """
    found: list[Episode] = []
    if not len(enough):
        return found
    breaks = np.diff(time_ns) > longest_gap_ns
    edges = np.flatnonzero((np.diff(enough.astype(np.int8)) != 0) | breaks) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(enough)]])
    first = last = -1
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if begin and breaks[begin - 1] and first >= 0:
            found.append(Episode(first, last, first == trigger - 1))
            first = -1
        if enough[begin]:
            if first < 0 and end - begin >= trigger:
                first = begin + trigger - 1
            last = end - 1
        elif first >= 0 and (time_ns[begin:end] - time_ns[last] >= hold_ns)[release - 1 :].any():
            found.append(Episode(first, last, first == trigger - 1))
            first = -1
    if first >= 0:
        found.append(Episode(first, last, cut=True))
    return found


# Visits of zones and crossings of lines by agents.

MARGIN = 0.1
"""A visit ends so far outside of the zone [m]."""
CLEAR = 0.2
"""An agent has crossed a line when it was so far away from it on both sides [m]."""


class TrackPath(NamedTuple):
    """The smoothed path of one track, in the order of time."""

    time_ns: Int64
    """(N,) stamps of its sweeps."""
    x: Float64
    y: Float64
    """(N,) [m]; NaN where its place in the frame is not known."""
    steps: Bool
    """(N,) True where sweeps observed it all the path from the place before."""


class Visit(NamedTuple):
    """One visit of an area, by index into the path."""

    first: int
    last: int
    cut: bool
    """True where the path begins or ends in the area."""


class Crossing(NamedTuple):
    """One crossing of a line: the index into the path after it, and its direction."""

    after: int
    inwards: bool


def visits(shapes: Sequence[Circle | Polygon], which: Int64, path: TrackPath) -> list[Visit]:
    """Return the visits of an area: from the first sweep inside to the last that is no farther than `MARGIN` outside.

    `which`: (N,) index of the shape that the area has at each sweep of the path, -1 for none.
    """
    within, left = np.zeros(len(path.x), np.bool_), np.ones(len(path.x), np.bool_)
    for number in np.unique(which[which >= 0]).tolist():
        mine = np.flatnonzero(which == number)
        x, y = path.x[mine], path.y[mine]
        with np.errstate(invalid="ignore"):
            within[mine] = inside(shapes[number], x, y)
            # A place that is not known ends a visit.
            left[mine] = ~(distance_to(shapes[number], x, y) <= MARGIN)
    found = []
    at, count = 0, len(within)
    while at < count and within[at:].any():
        first = at + int(within[at:].argmax())
        gone = left[first:]
        last = first + int(gone.argmax()) - 1 if gone.any() else count - 1
        found.append(Visit(first, last, first == 0 or last == count - 1))
        at = last + 1
    return found


def crossings(line: Line, path: TrackPath) -> tuple[list[Crossing], ...]:
    """Return the crossings of a line that sweeps observed; those where the path was clear of it on one side alone; those
    that no sweep observed.

    A crossing is a path through the line, between its ends, from `CLEAR` away on one side to as far on the other; it goes
    in where it arrives to the left of the path from the first end to the second.
    """
    (first_x, first_y), (second_x, second_y) = line.first, line.second
    length = np.hypot(second_x - first_x, second_y - first_y)
    ahead_x, ahead_y = (second_x - first_x) / length, (second_y - first_y) / length
    dx, dy = path.x - first_x, path.y - first_y
    left, along = ahead_x * dy - ahead_y * dx, ahead_x * dx + ahead_y * dy
    known = np.flatnonzero(np.isfinite(left))
    found: list[Crossing] = []
    one_sided: list[Crossing] = []
    unseen: list[Crossing] = []
    side, passed, after = 0, 0, -1
    begun, hidden = False, False
    """True once the path was clear of the line; where no sweep observed it go through."""
    for before, here in zip([-1, *known[:-1].tolist()], known.tolist(), strict=True):
        if before >= 0 and (left[before] > 0.0) != (left[here] > 0.0):
            share = left[before] / (left[before] - left[here])
            if 0.0 <= along[before] + share * (along[here] - along[before]) <= length:
                passed += 1 if left[here] > 0.0 else -1
                after = here
                hidden |= not path.steps[before + 1 : here + 1].all()
        if abs(left[here]) >= CLEAR:
            now = 1 if left[here] > 0.0 else -1
            if passed * now > 0 and (not begun or side == -now):
                kind = one_sided if not begun else unseen if hidden else found
                kind.append(Crossing(after, now > 0))
            side, passed, begun, hidden = now, 0, True, False
    if passed:
        one_sided.append(Crossing(after, passed > 0))
    return found, one_sided, unseen
