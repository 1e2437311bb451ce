"""Objects, walls and tracks in the world, and in the sensor frame of a sweep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidarcli.formalism.mapping.grid import CLEAR, HIT, SKIPPED, Beams, Counts, MotionFilter, Occupancy, TooLargeError
from lidarcli.options.choices import MAP_RESOLUTION, MIN_MOVE, OCCUPIED_RATIO
from lidarcli.reports.columns import Rows, Run, rows_of
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepPoses, UInt8, record

MAX_CELLS = 4_000
"""Most cells of walls that are drawn, those that were hit most."""
MIN_HITS = 2
"""Least number of beams that ended in a cell of a wall."""
COLUMNS = {
    "objects": (
        *("topic", "sweep", "set", "track", "label"),
        *("box_x", "box_y", "world_x", "world_y"),
        *("r_min", "theta_min"),
    ),
    "sweeps": ("topic", "sweep", "stamp", "pose_x", "pose_y", "pose_yaw"),
    "trajectories": ("topic", "sweep", "t", "track", "x", "y", "vx", "vy", "seen"),
}
"""Table → columns that `Paths` needs."""


@record
class PosedStream:
    """K objects and S sweeps of one stream, seen from above. Without any pose the sensor is taken as stationary."""

    x: Float64
    """(K,) centre of the object over ground [m], from an origin nearby; NaN where it is not known."""
    y: Float64
    pose_x: Float64
    """(S,) position of the sensor [m]; NaN where no pose is known, all zero where no sweep has one."""
    pose_y: Float64
    pose_yaw: Float64
    """(S,) direction of the x axis of the sensor [rad]."""
    side: float
    """-1 where the sensor hangs head down, so that its left is to the right, else 1."""
    posed: bool
    """True if the log has poses of the sensor."""
    origin: tuple[float, float] = (0.0, 0.0)
    """Origin of all positions in the world frame [m]."""

    def to_sensor(self, sweep: int, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return points over ground in the sensor frame of a sweep [m]."""
        return self.turned(sweep, x - self.pose_x[sweep], y - self.pose_y[sweep])

    def from_sensor(self, sweep: Int64, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return points of the sensor frames of sweeps over ground [m]; NaN without a pose."""
        cos, sin = np.cos(self.pose_yaw[sweep]), np.sin(self.pose_yaw[sweep])
        return (self.pose_x[sweep] + cos * x - self.side * sin * y, self.pose_y[sweep] + sin * x + self.side * cos * y)

    def turned(self, sweep: int, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return directions over ground, such as velocities, in the sensor frame of a sweep."""
        cos, sin = np.cos(self.pose_yaw[sweep]), np.sin(self.pose_yaw[sweep])
        return cos * x + sin * y, self.side * (cos * y - sin * x)


def posed_stream(sweeps: Rows, rows: Int64, objects: Rows, members: Int64, sweep: Int64) -> PosedStream:
    """Return S sweeps and K objects of one stream, by their poses.

    Parameters
    ----------
    sweeps, rows : the sweeps table, and (S,) which of its rows
    objects, members : the objects table, and (K,) which of its rows
    sweep : (K,) to which of the S sweeps each of these objects belongs
    """
    pose_x, pose_y, pose_yaw = (sweeps.numbers(name)[rows] for name in ("pose_x", "pose_y", "pose_yaw"))
    x, y = objects.numbers("box_x")[members], objects.numbers("box_y")[members]
    there = np.flatnonzero(np.isfinite(pose_x))
    if not len(there):
        zero = np.zeros(len(rows))
        return PosedStream(x, y, zero, zero, zero, 1.0, posed=False)
    # Far from the origin of the world a difference of two places is still exact to the millimetre.
    x0, y0 = pose_x[there[0]], pose_y[there[0]]
    pose_x, pose_y = pose_x - x0, pose_y - y0
    world_x, world_y = objects.numbers("world_x")[members] - x0, objects.numbers("world_y")[members] - y0
    # The tables do not say whether the sensor is upside down, but the boxes in both frames do.
    turn = pose_yaw[sweep]
    left = np.cos(turn) * (world_y - pose_y[sweep]) - np.sin(turn) * (world_x - pose_x[sweep])
    upright = np.nansum(np.abs(left - y)) <= np.nansum(np.abs(left + y))
    return PosedStream(
        world_x, world_y, pose_x, pose_y, pose_yaw, 1.0 if upright else -1.0, posed=True, origin=(float(x0), float(y0))
    )


class Raw(NamedTuple):
    """Ranges of K sweeps of one topic, sorted by index."""

    sweep: Int64
    """(K,)"""
    angle_min: Float64
    angle_increment: Float64
    closure: UInt8
    beams: Int64
    ranges: Float64
    """(K, B) metres; NaN without a range and beyond `beams`."""

    def rows(self, index: Int64) -> Raw:
        """Return some of the sweeps."""
        return Raw._make(column[index] for column in self)

    @property
    def bearings(self) -> Float64:
        """Return (K, B) the bearing of each beam [rad]."""
        found: Float64 = self.angle_min[:, None] + self.angle_increment[:, None] * np.arange(self.ranges.shape[1])
        return found


@record
class Walls:
    """Square cells of walls in a frame."""

    cell: float
    """[m]"""
    x: Float64
    """(N,) their centres [m]."""
    y: Float64


def walls_of(run: Run, raw: Mapping[tuple[int, str], Raw]) -> dict[str, Walls]:
    """Return the walls by frame (`sensor`, `world`): of one log, and in the sensor frame only of one static sensor."""
    if len(run.sources) != 1:
        return {}
    points = [each for (_, topic), sweeps in raw.items() for each in _points(run, topic, sweeps)]
    found = {}
    for frame in ("sensor", "world"):
        parts = [(x, y) for name, x, y in points if name == frame and (frame == "world" or len(raw) == 1)]
        walls = _cells(*(np.concatenate(column) for column in zip(*parts, strict=True))) if parts else None
        if walls is not None:
            found[frame] = walls
    return found


@record
class _WorldSweeps:
    """Raw sweeps of one topic that the tables know, with their objects."""

    raw: Raw
    rows: Int64
    """(S,) their rows in the sweeps table."""
    stream: PosedStream
    members: Int64
    """(K,) rows of their objects ..."""
    sweep: Int64
    """(K,) ... each of one of these sweeps."""


def _placed(run: Run, topic: str, raw: Raw) -> _WorldSweeps | None:
    """Find raw sweeps in the tables; None where none of them is there."""
    rows, there = rows_of(run.sweeps, topic, raw.sweep)
    if not len(rows):
        return None
    raw = raw.rows(there)
    members, sweep = rows_of(run.objects, topic, raw.sweep)
    members, sweep = (column[run.is_object[members]] for column in (members, sweep))
    return _WorldSweeps(raw, rows, posed_stream(run.sweeps, rows, run.objects, members, sweep), members, sweep)


def _points(run: Run, topic: str, raw: Raw) -> Iterator[tuple[str, Float64, Float64]]:
    """Yield frame, x and y of the ends of beams that lie on no object."""
    found = _placed(run, topic, raw)
    if found is None:
        return
    raw, stream = found.raw, found.stream
    theta = raw.bearings
    hit = np.isfinite(raw.ranges) & np.isfinite(theta)
    hit &= ~_on_objects(run, raw, found.members, found.sweep)
    x, y = raw.ranges[hit] * np.cos(theta[hit]), raw.ranges[hit] * np.sin(theta[hit])
    there = np.isfinite(stream.pose_x)
    extent = max(float(np.ptp(stream.pose_x[there])), float(np.ptp(stream.pose_y[there])))
    if not stream.posed or (extent <= 0.05 and np.ptp(np.unwrap(stream.pose_yaw[there])) <= 0.02):
        yield "sensor", x, y
    if stream.posed:
        world_x, world_y = stream.from_sensor(np.nonzero(hit)[0], x, y)
        known = np.isfinite(world_x) & np.isfinite(world_y)
        yield "world", stream.origin[0] + world_x[known], stream.origin[1] + world_y[known]


def map_of(run: Run, raw: Mapping[tuple[int, str], Raw]) -> Occupancy | None:
    """Return the map of one log, of the raw sweeps and the poses of its tables, without what moves.

    None where no sweep has both, or where it would be too large.
    """
    from lidarcli.reports.figures import round_up

    if len(run.sources) != 1:
        return None
    parts = [part for (_, topic), sweeps in raw.items() for part in _beams(run, topic, sweeps)]
    if not parts:
        return None
    ends = np.concatenate([part.end.reshape(2, -1) for part in parts], axis=1)
    side = float(np.nanmax(np.nanmax(ends, axis=1) - np.nanmin(ends, axis=1))) if np.isfinite(ends).any() else 0.0
    counts = Counts(max(round_up(max(side, 1e-3) / 600), MAP_RESOLUTION), 600**2)
    try:
        for part in parts:
            counts.add(part)
    except TooLargeError:
        return None
    return counts.occupancy(min(counts.sweeps, MIN_HITS), OCCUPIED_RATIO, "world")


def _beams(run: Run, topic: str, raw: Raw) -> Iterator[Beams]:
    """Yield the beams of the sweeps that a map counts, in the world."""
    found = _placed(run, topic, raw)
    if found is None or not found.stream.posed:
        return
    at = found.stream
    x, y = at.origin[0] + at.pose_x, at.origin[1] + at.pose_y
    poses = SweepPoses(x, y, at.pose_yaw, np.full(len(x), at.side < 0))
    taken = MotionFilter(MIN_MOVE).take(poses, run.sweeps.integers("stamp")[found.rows])
    if not len(taken):
        return
    moving = run.objects.are("set", "A")[found.members]
    on_agent = _on_objects(run, found.raw, found.members[moving], found.sweep[moving])[taken]
    raw = found.raw.rows(taken)
    theta = raw.bearings
    there = np.isfinite(raw.ranges) & np.isfinite(theta)
    r, theta = np.where(there, raw.ranges, 0.0), np.where(there, theta, 0.0)
    sweep = np.broadcast_to(taken[:, None], r.shape)
    end = np.stack(at.from_sensor(sweep, r * np.cos(theta), r * np.sin(theta)))
    end += np.reshape(at.origin, (2, 1, 1))
    end[:, ~there] = np.nan
    use = np.where(there, np.where(on_agent, CLEAR, HIT), SKIPPED).astype(np.uint8)
    where = np.column_stack([x, y, at.pose_yaw, np.full(len(x), at.side)])[taken]
    yield Beams(end, use, raw.beams.astype(np.int32), where, np.zeros((len(taken), 3)))


def _on_objects(run: Run, raw: Raw, members: Int64, sweep: Int64) -> Bool:
    """Return (K, B) beams between the edges of an object."""
    angle_min, step = raw.angle_min[sweep], raw.angle_increment[sweep]
    first, last = (run.objects.numbers(name)[members] for name in ("theta_i", "theta_f"))
    # What another program has written may be anything.
    known = (np.abs(step) > 1e-6) & (np.abs([first, last, angle_min]).max(axis=0) < 100.0)
    sweep, step, angle_min = sweep[known], step[known], angle_min[known]
    first, last = first[known], last[known]
    marked = np.zeros(raw.ranges.shape, bool)
    beams = raw.ranges.shape[1]
    # From beam to beam of a full turn, which may go past its end; the sweep is the beginning of the turn.
    turn = np.maximum(np.round(TURN / np.abs(step)), 1).astype(np.int64)
    begin = np.round((np.where(step > 0, first, last) - angle_min) / step).astype(np.int64) % turn
    end = begin + np.round(np.abs((last - first) / step)).astype(np.int64) + 1
    for low, high in ((begin, end), (np.zeros_like(begin), end - turn)):
        size = np.maximum(np.minimum(high, beams) - low, 0)
        inside = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        marked[np.repeat(sweep, size), np.repeat(low, size) + inside] = True
    return marked


def _cells(x: Float64, y: Float64) -> Walls | None:
    """Return the cells that enough of these points lie in."""
    from lidarcli.reports.figures import round_up

    if not len(x):
        return None
    x0, y0 = float(x.min()), float(y.min())
    cell = max(round_up(max(float(np.ptp(x)), float(np.ptp(y)), 1e-3) / 160), 0.05)
    ix, iy = np.floor((x - x0) / cell).astype(np.int64), np.floor((y - y0) / cell).astype(np.int64)
    width = int(iy.max()) + 1
    place, hits = np.unique(ix * width + iy, return_counts=True)
    enough = np.flatnonzero(hits >= max(MIN_HITS, 0.05 * np.percentile(hits, 90)))
    kept = np.sort(enough[np.argsort(-hits[enough], kind="stable")[:MAX_CELLS]])
    return Walls(cell, x0 + (place[kept] // width + 0.5) * cell, y0 + (place[kept] % width + 0.5) * cell)


@dataclass(frozen=True, slots=True)
class TrackPath:
    """One track up to a sweep, in the sensor frame of that sweep."""

    number: int
    is_agent: bool
    label: str
    seen: bool
    """True if the track is visible in this sweep; else it is hidden, and visible again later."""
    x: Float64
    """(N,) positions [m] by its trajectory, the last one in this sweep; NaN where it was hidden before."""
    y: Float64
    velocity: tuple[float, float]
    """Velocity over ground [m/s]; zero while the track is stationary or hidden."""
    point: tuple[float, float] | None = None
    """Its nearest point in this sweep [m]; None where no beam of it is known."""
    zone: str = ""
    """Name of an occupied zone in which most points are on it."""

    @property
    def mark(self) -> tuple[float, float]:
        """Place of its mark [m]: on its nearest point, or where it would be."""
        return self.point or (float(self.x[-1]), float(self.y[-1]))


class Paths:
    """The tracks of one topic: rows of an objects, a sweeps and a trajectories table with `COLUMNS`."""

    def __init__(self, sweeps: Rows, objects: Rows, trajectories: Rows, topic: str) -> None:
        self._sweeps = np.unique(sweeps.integers("sweep")[sweeps.are("topic", topic)])
        rows, _ = rows_of(sweeps, topic, self._sweeps)
        self._stamps = sweeps.integers("stamp")[rows]
        members, at = rows_of(objects, topic, self._sweeps)
        tracked = ~np.isnan(objects.numbers("track")[members])
        members, self._seen_at = members[tracked], at[tracked]
        self._stream = posed_stream(sweeps, rows, objects, members, self._seen_at)
        self._seen_track = objects.numbers("track")[members].astype(np.int64)
        self._agent = objects.are("set", "A")[members]
        self._nearest = np.stack([objects.numbers(name)[members] for name in ("r_min", "theta_min")], axis=1)
        self._labels = objects.texts("label", members)
        self._rows, self._at = rows_of(trajectories, topic, self._sweeps)
        names = ("track", "t", "x", "y", "vx", "vy")
        self._track, self._seconds, x, y, *self._velocity = (trajectories.numbers(name)[self._rows] for name in names)
        self._x, self._y = (place - origin for place, origin in zip((x, y), self._stream.origin, strict=True))
        self._hidden = trajectories.are("seen", "hidden")[self._rows]

    @property
    def are_there(self) -> bool:
        """True if there is any track of the topic."""
        return len(self._track) > 0

    def stamp_of(self, sweep: int) -> int | None:
        """Return the stamp of a sweep [ns]; None where the tables do not hold it."""
        return int(self._stamps[np.searchsorted(self._sweeps, sweep)]) if sweep in self._sweeps else None

    def up_to(self, sweep: int, seconds: float = np.inf) -> tuple[TrackPath, ...]:
        """Return the tracks that go on in this sweep, by number, from `seconds` before; none without a pose."""
        now = int(np.searchsorted(self._sweeps, sweep))
        x, y = self._stream.to_sensor(now, self._x, self._y)
        here = np.flatnonzero((self._at == now) & np.isfinite(x) & np.isfinite(y))
        here = here[np.argsort(self._track[here])]
        if not len(here):
            return ()
        past = (self._at <= now) & (self._seconds >= self._seconds[here[0]] - seconds) & np.isfinite(x)
        return tuple(self._path(row, now, x, y, past) for row in here.tolist())

    def _path(self, row: int, now: int, x: Float64, y: Float64, past: Bool) -> TrackPath:
        number, is_seen = int(self._track[row]), not self._hidden[row]
        own = np.flatnonzero(past & (self._track == number))
        known = np.flatnonzero((self._seen_track == number) & (self._seen_at <= now))
        last = int(known[-1]) if len(known) else -1
        vx, vy = self._stream.turned(now, *(each[row] for each in self._velocity))
        dark = self._hidden[own] & (own != row)
        nearest = min(map(tuple, self._nearest[known[self._seen_at[known] == now]].tolist()), default=None)
        return TrackPath(
            number=number,
            is_agent=last >= 0 and bool(self._agent[last]),
            label=self._labels[last] if last >= 0 else "",
            seen=is_seen,
            x=np.where(dark, np.nan, x[own]),
            y=np.where(dark, np.nan, y[own]),
            velocity=(float(vx), float(vy)) if is_seen else (0.0, 0.0),
            point=None if nearest is None else (nearest[0] * np.cos(nearest[1]), nearest[0] * np.sin(nearest[1])),
        )
