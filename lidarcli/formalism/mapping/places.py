"""Verdict by place: what all sweeps say of the cells of the map that a body covers.

One sweep cannot tell a short wall from a cupboard. Where the place of the sensor is known, what is static at one place is
one object or one piece of building in all sweeps, whatever parts of it they see. Votes add up in any order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lidarcli.formalism.detection import NOISE, OBJECT, WALL, Detection
from lidarcli.formalism.mapping import rays
from lidarcli.formalism.mapping.grid import CellLayers
from lidarcli.sweeps.types import Bool, Float32, Float64, Int64, SweepBatch

CELL, FARTHEST, REACH = 0.1, 15.0, 150.0
"""[m] Side of a cell; greatest range of a beam that votes, as farther ones miss their cells where the pose is turned a
little; greatest distance of the sensor from where its world begins: farther sweeps do not vote."""
MAX_STOPS = 16
"""Greatest number of places where a sensor without poses stood that are remembered."""
WORLDS = MAX_STOPS + 1
"""Worlds of one sensor: the first is that of its poses."""
MAX_SENSORS = 64
"""Most sensors of one topic or robot that are distinguished; sweeps of further frames do not vote."""
BUILDING_VOTE = -2.0
"""[log-odds] Vote of a beam on a surface that is no body, because it is too wide."""
GAIN, PRIOR = 1.75, -0.5
"""Factor by which the looks of many sweeps together tell more than one, and [log-odds] of a place before any vote."""
SURFACE_STEP = 0.3
"""[m] Greatest difference of the ranges of neighbours on one surface."""
SAME_RANGE, SAME_RANGE_GROWTH = 0.03, 0.01
"""[m], [m/m] Greatest change of a range that is the same, and its growth with the range."""
STANDING_SHARE = 0.8
"""Share of the beams with a range in two sweeps that measure the same if the sensor is static."""
UNIT = 12.0
"""Votes of one log-odds: whole numbers have the same sum in any order."""
MARGIN = FARTHEST + 1.0
"""[m] Greatest distance of a cell from the path of the sensor during a sweep: beams end within it, with those around."""


@dataclass(slots=True)
class _Votes(CellLayers):
    """Votes of the cells of one world."""

    LAYERS: ClassVar[tuple[str, ...]] = ("votes",)

    votes: Int64 = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(H, W) sum of the votes and their number, as of `rays.cast`."""

    def take(self, sweeps: SweepsInWorld, rows: Int64, vote: Int64) -> None:
        """Take the votes of some sweeps."""
        begin = sweeps.poses[rows, :2]
        path = np.concatenate([begin, begin + sweeps.way[rows, :2]])
        left, low = np.floor((path.min(axis=0) - MARGIN) / self.resolution).astype(np.int64).tolist()
        right, high = np.ceil((path.max(axis=0) + MARGIN) / self.resolution).astype(np.int64).tolist()
        self.reach(left, low, right, high)
        building = round(BUILDING_VOTE * UNIT)
        rays.cast(sweeps.ends, rows, vote, building, self.votes, self.resolution, self.column, self.row)


class SweepsInWorld:
    """The sweeps of a batch in their worlds, (S,) as of `Places.add`."""

    def __init__(self, batch: SweepBatch, detection: Detection, worlds: Int64) -> None:
        self.batch = batch
        self.poses: Float64 = np.zeros((len(batch), 4))
        """(S, 4) x, y, yaw and side of the sensor; where it is known by none but itself, it is the origin."""
        self.way: Float64 = np.zeros((len(batch), 3))
        """(S, 3) its path in x, y, yaw during the sweep."""
        self.poses[:, 3] = 1.0
        at, poses = (worlds >= 0) & (worlds % WORLDS == 0), batch.poses
        if poses is not None:
            side = np.where(poses.upside_down, -1.0, 1.0)
            self.poses[at] = np.column_stack([poses.x, poses.y, poses.yaw, side])[at]
            if poses.way is not None:
                self.way[at] = poses.way[at]
        self.ends = rays.Ends(batch, detection, self.poses, self.way, FARTHEST, SURFACE_STEP)


class StaticSensor:
    """A fold over the sweeps of a topic that says whether the sensor is static, by the beams that measure the same
    again."""

    def __init__(self) -> None:
        self._before: Float32 = np.empty(0, np.float32)

    def see(self, batch: SweepBatch) -> Bool:
        """Return (S,) True where the sensor was static since the sweep before, and for the first sweep."""
        ranges = batch.ranges
        # Padding depends on the batch and has no ranges, nor has the sweep before the first one.
        last = np.full((1, batch.width), np.nan, ranges.dtype)
        shared = min(batch.width, len(self._before))
        last[0, :shared] = self._before[:shared]
        self._before = ranges[-1].copy()
        before = np.concatenate([last, ranges[:-1]])
        change = np.abs(ranges - before)
        # Comparisons with NaN are false.
        same = np.count_nonzero(change < SAME_RANGE + SAME_RANGE_GROWTH * before, axis=1)
        stood: Bool = same >= STANDING_SHARE * np.count_nonzero(change >= 0.0, axis=1)
        return stood


@dataclass(slots=True)
class _Sensor:
    """The place of one sensor of a topic, and the origin of its world."""

    first: int
    """Number of the first of its worlds."""
    standing: StaticSensor = field(default_factory=StaticSensor)
    stops: int = 1
    begin: tuple[float, float] | None = None

    def worlds(self, batch: SweepBatch) -> Int64:
        """Return (S,) the world of each sweep among those of the sensor, -1 for none."""
        stood = self.standing.see(batch) if batch.still is None else batch.still
        stops = self.stops + np.cumsum(~stood)
        if len(batch):
            self.stops = int(stops[-1])
        worlds = np.where(stood & (stops <= MAX_STOPS), stops, -1)
        poses = batch.poses
        if poses is None:
            return worlds
        known = np.isfinite(poses.x) & np.isfinite(poses.y) & np.isfinite(poses.yaw)
        if batch.fits is not None:
            known &= batch.fits
        if poses.way is not None:
            known &= (np.abs(poses.way) < FARTHEST).all(axis=1)
        if known.any() and self.begin is None:
            at = int(np.argmax(known))
            self.begin = float(poses.x[at]), float(poses.y[at])
        if self.begin is not None:
            x, y = self.begin
            with np.errstate(invalid="ignore"):
                far = np.maximum(np.abs(poses.x - x), np.abs(poses.y - y)) > REACH
            return np.where(known, np.where(far, -1, 0), worlds)
        return worlds


class Places:
    """Places of one topic, or of all of a robot: a fold over their sweeps in bounded memory; batches of any size give the
    same.
    """

    def __init__(self) -> None:
        self._grounds: dict[int, _Votes] = {}
        """Cells by world: of each sensor that of its poses, and one for every stop where it has none."""
        self._sensors: dict[tuple[str, str, int], _Sensor] = {}
        """By topic, frame and run of the log: the world of each run is its own."""
        self._shared: dict[object, int] = {}
        """Number of the world of the poses of a robot, by its sensors, the run, and the square in which they begin."""

    def add(self, batch: SweepBatch, detection: Detection) -> Int64:
        """Take the votes of S sweeps; return (S,) their worlds, which `read` asks for, -1 where the sensor's place is not
        known.
        """
        worlds = self._worlds(batch)
        thing = np.clip(np.nan_to_num(detection.thing, nan=0.5), 1e-9, 1.0 - 1e-9)
        vote = np.rint(UNIT * np.log(thing / (1.0 - thing))).astype(np.int64)
        sweeps = SweepsInWorld(batch, detection, worlds)
        for world, rows in _by_world(worlds):
            if world not in self._grounds:
                self._grounds[world] = _Votes(CELL, MAX_CELLS)
            self._grounds[world].take(sweeps, rows, vote)
        return worlds

    def judged(self, batch: SweepBatch, detection: Detection, worlds: Int64, least: float) -> Detection:
        """Return the bodies by their places in all sweeps so far; what is less likely than `least` an object is wall.

        `worlds` (S,) as `add` returned them.
        """
        found = np.zeros((len(detection), 2), np.int64)
        sweeps = SweepsInWorld(batch, detection, worlds)
        for world, rows in _by_world(worlds):
            ground = self._grounds[world]
            rays.poll(sweeps.ends, rows, ground.votes, ground.resolution, ground.column, ground.row, found)
        total, count = found.T
        known = (count > 0) & ~np.isnan(detection.thing)
        place = np.where(known, PRIOR + GAIN * total / (UNIT * np.maximum(count, 1)), np.nan)
        thing = np.where(known, 1.0 / (1.0 + np.exp(-place)), detection.thing)
        kind, shape = detection.set.copy(), detection.shape.copy()
        refused = (kind == OBJECT) & (thing < least)
        kind[refused], shape[refused] = NOISE, WALL
        return replace(detection, thing=thing, set=kind, shape=shape, place=place)

    def _worlds(self, batch: SweepBatch) -> Int64:
        """Return (S,) the world of each sweep, -1 for none."""
        found = np.full(len(batch), -1)
        for name, rows, mine in batch.by_frame():
            key = batch.topic, name, batch.run
            if key not in self._sensors and len(self._sensors) == MAX_SENSORS:
                continue
            sensor = self._sensors.setdefault(key, _Sensor(WORLDS * len(self._sensors)))
            worlds = sensor.worlds(mine)
            found[rows] = np.where(worlds >= 0, sensor.first + worlds, -1)
            if sensor.begin is not None and key[:2] in batch.robot:
                square = tuple(round(at / REACH) for at in sensor.begin)
                found[rows[worlds == 0]] = self._shared.setdefault((batch.robot, batch.run, square), sensor.first)
        return found


MAX_CELLS = math.ceil((3.0 * REACH + 2.0 * (FARTHEST + MARGIN)) / CELL + 2.0) ** 2
"""Cells of the space that the sweeps of one world can reach, whose sensors begin in one square of side `REACH`."""


def _by_world(worlds: Int64) -> list[tuple[int, Int64]]:
    """Return the worlds of some sweeps, and the rows of each."""
    return [(world, np.flatnonzero(worlds == world)) for world in np.flatnonzero(np.bincount(worlds[worlds >= 0])).tolist()]
