"""The way of a sensor from its sweeps alone: each is laid onto the map of those before it, by kiss-icp.

The library brings the map of cells and the robust point-to-point registration (extra `odometry`). Here is what a sweep in
the plane needs around them: walls are filled up between the beams before they enter the map, so that a point finds its
wall and not the beam that happened to hit it; beams that were sent one after another are moved to the header stamp; and
a sweep that fits nowhere gets no pose, and stays out of the map.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.errors import OptionError
from lidarcli.poses.tracks import SECOND_NS, Track, gathered
from lidarcli.sweeps import TURN, Float64, Int64, SweepBatch

TYPE = "kiss-icp"
"""Type of the track of a matched path."""

SPACINGS = 4.0
"""Side of the map's cells in distances from beam to beam at the median range of the first sweep, …"""
CELL = (0.2, 1.0)
"""[m] … and its limits: below, the noise of ranges fills cells with points; above, rooms lose their shape."""
POINTS = 20
"""Points of a cell; they are 1/√20 of its side apart, 4.5 cm, which is more than ranges err."""
GRAIN = 0.25
"""Distance of the points that are laid onto the map, and that are filled in between beams, in sides of a cell."""
FARTHEST = 100.0
"""[m] Longer ranges do not count, and the map reaches no farther, which bounds it."""

REACH_UNKNOWN, REACH, REACH_FINE = 5.0, 1.5, 0.15
"""In sides of a cell: the library's `kernel` k, where a point r away counts (k / (k + r²))², and a third of how far a point
looks for its match. Where the motion is not known; at first; and in the end, when a person beside a wall must not count any
more: 0.15 led to half the error of 0.25 on nearly all loops."""
STEPS = 500
STEP = 1e-4
"""Most steps of a registration, and the step [m], [rad] that is its last: the library's own."""
DIGITS = 9
"""Poses are told to the nanometre: TBB cuts sums by the number of cores, also for one thread, and the bits below differ."""

STRAIGHT = 0.05
"""[m] A beam is this near the line through its two neighbours where a wall is filled up between beams."""
LONGEST_FILL = 1.5
"""[m] Nothing is filled up between beams farther apart: the wall is seen at too flat an angle."""

LEAST = 20
"""Fewer points than these lie on any map, as one beam does."""
FIT = 0.6
"""A sweep fits where this share of its points lies on what is known: right poses had 0.66 or more on simulated and real
logs, another corridor that was laid onto the map half."""
FARTHEST_STEP, WIDEST_STEP = 5.0, np.pi / 2
"""[m], [rad] Nothing that carries a 2D LiDAR goes farther, or turns more, between two sweeps."""
PATIENCE = 10
"""After so many sweeps in a row that fit nowhere the map begins anew, at the last known pose."""
HORIZON = 1.0
"""[s] A velocity is believed for so long: after a gap in time the sensor is looked for where it was last."""
_SMALL = 1e-9


class _Planar(NamedTuple):
    """A pose, or a velocity per second, in the plane: x, y [m], yaw [rad]."""

    x: float
    y: float
    yaw: float

    def then(self, step: _Planar) -> _Planar:
        """Return the pose after a step in its own frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return _Planar(
            self.x + cos * step.x - sin * step.y,
            self.y + sin * step.x + cos * step.y,
            _wrapped(self.yaw + step.yaw),
        )

    def to(self, other: _Planar) -> _Planar:
        """Return the step from this pose to another, in its own frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y = other.x - self.x, other.y - self.y
        return _Planar(cos * x + sin * y, cos * y - sin * x, _wrapped(other.yaw - self.yaw))

    def matrix(self) -> Float64:
        """Return the (4, 4) matrix that the library takes."""
        found = np.eye(4)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        found[:2, :2] = (cos, -sin), (sin, cos)
        found[:2, 3] = self.x, self.y
        return found

    def __bool__(self) -> bool:
        """Return True for any motion."""
        return any(self)


_HERE = _Planar(0.0, 0.0, 0.0)


class _Points(NamedTuple):
    """The valid beams of a sweep, in its frame."""

    x: Float64
    y: Float64
    """(K,) [m]"""
    late: Float64
    """(K,) how long after the header stamp each was sent [s]."""
    wall: Int64
    """Points that lie on one wall with the next one."""

    def moved(self, velocity: _Planar) -> tuple[Float64, Float64]:
        """Return (K,) x, y as seen from where the sensor was at the header stamp."""
        if not velocity or not self.late.any():
            return self.x, self.y
        turn = velocity.yaw * self.late
        small = np.abs(turn) < _SMALL
        by = np.where(small, 1.0, turn)
        cos, sin = np.cos(turn), np.sin(turn)
        ahead = np.where(small, 1.0, sin / by) * self.late
        aside = np.where(small, 0.0, (1.0 - cos) / by) * self.late
        x = cos * self.x - sin * self.y + velocity.x * ahead - velocity.y * aside
        y = sin * self.x + cos * self.y + velocity.x * aside + velocity.y * ahead
        return x, y


class Matching:
    """The way of one sensor: a fold over its batches, in log order, whatever the cut of the batches.

    A sweep has no pose where it has fewer than `LEAST` valid beams, repeats the stamp before, or fits nowhere: then too
    few of its points lie on the map, or it is `FARTHEST_STEP` or `WIDEST_STEP` away from where it should be. Such sweeps do
    not change the map. After `PATIENCE` that fit nowhere the map begins anew at the last known pose: the way stays in one
    piece, and what was driven unseen is missing from it.

    Raises
    ------
    OptionError
        kiss-icp is not installed.
    """

    def __init__(self) -> None:
        try:
            from kiss_icp.mapping import VoxelHashMap
            from kiss_icp.registration import Registration
            from kiss_icp.voxelization import voxel_down_sample
        except ImportError:
            raise OptionError(
                "--pose match: needs kiss-icp, which is not installed: pip install 'lidarcli[odometry]'"
            ) from None
        self.unplaced = 0
        """Sweeps without a pose."""
        self.restarts = 0
        """Times that the map began anew: the way is not to be trusted across them."""
        self._new_map: Any = VoxelHashMap
        self._thin: Any = voxel_down_sample
        # One thread: sums of several depend on who is first.
        self._registration: Any = Registration(STEPS, STEP, max_num_threads=1)
        self._map: Any = None
        self._cell = 0.0
        self._reach = 0.0
        """Greatest range, and reach of the map [m]."""
        self._pose = _HERE
        """Of the last sweep that has one, taken at …"""
        self._pose_ns = 0
        self._velocity: _Planar | None = None
        """Per second, in the frame of that sweep; None where it is not known."""
        self._first: _Points | None = None
        """The sweep at which the map begins, while it is all there is of it."""
        self._known = np.zeros(0, np.int64)
        """Cells on and around the points of the sweep before."""
        self._misses = 0
        self._latest_ns: int | None = None
        self._found: list[tuple[Int64, Int64, Float64]] = []
        """(K,) stamps, (K,) record times and (K, 3) poses of each batch."""

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps of one topic and frame."""
        if not len(batch):
            return
        duration = np.zeros(len(batch)) if batch.duration is None else batch.duration
        kept, poses = [], []
        for row in range(len(batch)):
            stamp_ns = int(batch.stamp_ns[row])
            if stamp_ns == self._latest_ns:
                self.unplaced += 1
                continue
            self._latest_ns = stamp_ns
            pose = self._place(self._points(batch, row, float(duration[row])), stamp_ns)
            if pose is None:
                self.unplaced += 1
                continue
            kept.append(row)
            poses.append(pose)
        if kept:
            self._found.append((batch.stamp_ns[kept], batch.record_ns[kept], np.array(poses, np.float64)))

    def track(self, topic: str, frame: str) -> Track | None:
        """Return the way so far, from the frame of the first sweep; None where no sweep has a pose."""
        if not self._found:
            return None
        stamps, record_ns, poses = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        half, flat = 0.5 * poses[:, 2], np.zeros(len(poses))
        numbers = np.column_stack([poses[:, :2], flat, flat, flat, np.sin(half), np.cos(half)])
        return gathered((topic, TYPE, MATCH, frame), stamps, numbers, record_ns, Counter())

    def _points(self, batch: SweepBatch, row: int, duration: float) -> _Points:
        """The valid beams of a sweep that takes `duration` [s]; the first one that there is sets the scale of all."""
        beams, step = int(batch.beams[row]), float(batch.angle_increment[row])
        ranges = batch.ranges[row, :beams].astype(np.float64)
        if not self._cell:
            self._scale(ranges, step, float(batch.range_max[row]))
        with np.errstate(invalid="ignore"):
            ranges[~(ranges < (self._reach or FARTHEST))] = np.nan
        beam = np.flatnonzero(~np.isnan(ranges))
        bearing, near = batch.angle_min[row] + step * beam, ranges[beam]
        late = np.asarray(duration / max(beams - 1, 1) * beam, np.float64)
        # In 1/r the line through two neighbours is at the beam between them the mean over the cosine.
        between = 2.0 * math.cos(step) / (1.0 / ranges[:-2] + 1.0 / ranges[2:])
        straight = np.zeros(beams, bool)
        with np.errstate(invalid="ignore"):
            straight[1:-1] = np.abs(between - ranges[1:-1]) < STRAIGHT
        wall = np.flatnonzero(straight[beam[:-1]] & straight[beam[1:]] & (np.diff(beam) == 1))
        return _Points(near * np.cos(bearing), near * np.sin(bearing), late, wall)

    def _scale(self, ranges: Float64, step: float, range_max: float) -> None:
        """Choose the cells of the map by the first sweep that can be laid onto one."""
        near = ranges[ranges < FARTHEST]
        if len(near) < LEAST:
            return
        spacing = float(np.median(near)) * min(abs(step), TURN)
        self._cell = float(np.clip(SPACINGS * spacing, *CELL))
        told = math.isfinite(range_max) and range_max > float(near.max())
        self._reach = min(range_max, FARTHEST) if told else FARTHEST
        self._map = self._new_map(self._cell, self._reach, POINTS)

    def _place(self, points: _Points, stamp_ns: int) -> _Planar | None:
        """Match a sweep, add it to the map and return its pose; None without one."""
        if len(points.x) < LEAST or self._map is None:
            return None
        if self._map.empty():
            return self._begin(points, stamp_ns)
        seconds = (stamp_ns - self._pose_ns) / SECOND_NS
        follows = 0.0 < seconds <= HORIZON
        velocity = self._velocity or _HERE
        guess = self._pose.then(_driven(velocity, seconds)) if follows else self._pose
        reach = REACH if follows and self._velocity is not None else REACH_UNKNOWN
        pose, velocity = self._aligned(points, guess, reach, velocity, seconds if follows else 0.0)
        first = self._first
        if follows and first is not None and first.late.any() and self._fits(points, velocity, pose):
            # Now that the motion is known the sweep before can be laid down as if taken in an instant.
            self._map.clear()
            self._enter(first, velocity, self._pose)
            pose, velocity = self._aligned(points, pose, REACH, velocity, seconds)
        step = guess.to(pose)
        near = math.hypot(step.x, step.y) <= FARTHEST_STEP and abs(step.yaw) <= WIDEST_STEP
        if not (near and self._fits(points, velocity, pose)):
            self._misses += 1
            if self._misses < PATIENCE:
                return None
            self.restarts += 1
            self._map.clear()
            return self._begin(points, stamp_ns)
        self._enter(points, velocity, pose)
        self._pose, self._pose_ns, self._misses, self._first = pose, stamp_ns, 0, None
        self._velocity = velocity if follows else None
        return pose

    def _begin(self, points: _Points, stamp_ns: int) -> _Planar:
        """Begin a map with one sweep, at the last known pose."""
        self._enter(points, _HERE, self._pose)
        self._first, self._velocity, self._pose_ns, self._misses = points, None, stamp_ns, 0
        return self._pose

    def _aligned(
        self, points: _Points, guess: _Planar, reach: float, velocity: _Planar, seconds: float
    ) -> tuple[_Planar, _Planar]:
        """Return the pose of a sweep on the map and its velocity, where `seconds` since the last one are told.

        First the scale of the weights is that of `reach`; then, with the velocity that comes of it, that of
        `REACH_FINE`, and once more for sweeps that take time.
        """
        pose = guess
        rounds = (reach, REACH_FINE, REACH_FINE) if points.late.any() else (reach, REACH_FINE)
        for scale in rounds:
            kernel = scale * self._cell
            found = self._registration.align_points_to_map(
                self._thinned(*points.moved(velocity)), self._map, pose.matrix(), 3.0 * kernel, kernel
            )
            # A rotation out of the plane is nothing but rounding.
            numbers = float(found[0, 3]), float(found[1, 3]), math.atan2(found[1, 0], found[0, 0])
            if not all(map(math.isfinite, numbers)):
                return guess, velocity
            pose = _Planar(*(round(number, DIGITS) for number in numbers))
            if seconds > 0:
                velocity = _velocity(self._pose.to(pose), seconds)
        return pose, velocity

    def _fits(self, points: _Points, velocity: _Planar, pose: _Planar) -> bool:
        """Return True if enough points lie on the sweep before, or else on the map."""
        thin = self._thinned(*points.moved(velocity))
        if not len(thin):
            return False
        x, y = _turned(thin[:, 0], thin[:, 1], pose)
        cells = _cells(x, y, self._cell)
        if float(np.isin(cells, self._known).mean()) >= FIT:
            return True
        cloud = self._map.point_cloud()
        return float(np.isin(cells, _around(cloud[:, 0], cloud[:, 1], self._cell)).mean()) >= FIT

    def _enter(self, points: _Points, velocity: _Planar, pose: _Planar) -> None:
        """Put a sweep into the map, walls filled up between its beams."""
        x, y = points.moved(velocity)
        filled = self._thinned(*_filled(x, y, points.wall, GRAIN * self._cell))
        self._map.update(filled, pose.matrix())
        self._known = _around(*_turned(filled[:, 0], filled[:, 1], pose), self._cell)

    def _thinned(self, x: Float64, y: Float64) -> Float64:
        """Return (K, 3) one of the points for each square of a grain's side."""
        points: Float64 = self._thin(np.column_stack([x, y, np.zeros(len(x))]), GRAIN * self._cell)
        return points


def _wrapped(angle: float) -> float:
    """Return a direction within ±π [rad]."""
    return math.remainder(angle, TURN)


def _driven(velocity: _Planar, seconds: float) -> _Planar:
    """Return the step that a constant velocity makes: along an arc."""
    turn = velocity.yaw * seconds
    ahead, aside = 1.0, 0.0
    if abs(turn) > _SMALL:
        ahead, aside = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn
    x, y = velocity.x * seconds, velocity.y * seconds
    return _Planar(x * ahead - y * aside, x * aside + y * ahead, turn)


def _velocity(step: _Planar, seconds: float) -> _Planar:
    """Return the constant velocity that makes a step: the inverse of `_driven`."""
    half = 0.5 * step.yaw
    along = half / math.tan(half) if abs(half) > _SMALL else 1.0
    x, y = along * step.x + half * step.y, along * step.y - half * step.x
    return _Planar(x / seconds, y / seconds, step.yaw / seconds)


def _turned(x: Float64, y: Float64, pose: _Planar) -> tuple[Float64, Float64]:
    """Return points (K,) of the frame at a pose in the world."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return pose.x + cos * x - sin * y, pose.y + sin * x + cos * y


def _filled(x: Float64, y: Float64, wall: Int64, step: float) -> tuple[Float64, Float64]:
    """Return the points, and more in between on the walls, `step` [m] apart."""
    across, along = x[wall + 1] - x[wall], y[wall + 1] - y[wall]
    gap = np.hypot(across, along)
    more = np.where(gap <= LONGEST_FILL, np.ceil(gap / step) - 1.0, 0.0).clip(0.0).astype(np.int64)
    which = np.repeat(np.arange(len(wall)), more)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(more) - more, more)
    share = (nth + 1) / (more[which] + 1)
    return (
        np.concatenate([x, x[wall][which] + share * across[which]]),
        np.concatenate([y, y[wall][which] + share * along[which]]),
    )


def _cells(x: Float64, y: Float64, side: float) -> Int64:
    """Return a number for the square of half a cell in which each point lies."""
    column, line = (np.floor(value / (0.5 * side)).astype(np.int64) for value in (x, y))
    numbers: Int64 = column * np.int64(1 << 32) + line
    return numbers


def _around(x: Float64, y: Float64, side: float) -> Int64:
    """Return the squares of the points and the eight around each."""
    cells = np.unique(_cells(x, y, side))
    beside = [column * (1 << 32) + line for column in (-1, 0, 1) for line in (-1, 0, 1)]
    return np.unique(cells[:, None] + np.array(beside, np.int64))
