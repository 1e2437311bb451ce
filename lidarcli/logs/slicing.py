"""Sweeps made of point clouds: a slice of heights seen from above, and in each direction the nearest point."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from lidarcli.display import counted
from lidarcli.logs.base import Message, OpenOptions, ReadReport, Slice
from lidarcli.logs.blocks import as_singles, given_geometry, pad_intensities
from lidarcli.logs.clouds import BadCloudError, Cloud, Floats, decode
from lidarcli.range_rules import FARTHEST, NEAREST
from lidarcli.sweeps import TURN, Float32, Float64, Int64, RawSweeps

MANY_HOLES = 0.05
"""Share of empty bins between two similar ones above which a note is due."""
WIDE = np.deg2rad(45.0)
SOME_CLOUDS = 10
"""Width [rad] of an unseen part of the view, and number of clouds, above which a note is due."""


@dataclass(frozen=True, slots=True)
class Bins:
    """The beams of a sweep that is made of a cloud."""

    first: float
    """Bearing of the first one [rad]."""
    step: float
    """Step between bearings [rad]."""
    count: int

    @classmethod
    def of(cls, options: OpenOptions, count: int) -> Bins:
        """Return the view of the options, else a full turn that begins behind the sensor."""
        first, step = given_geometry(options, count) or (-np.pi, TURN / count)
        return cls(first if options.angle_min is None else options.angle_min, step, count)

    def nearest(self, x: Floats, y: Floats, near: float, far: float) -> tuple[Int64, Int64]:
        """Return bins with a point, and the nearest of the points (N,) at x, y [m] from `near` to `far` in each."""
        square = x * x + y * y
        # NaN and what overflows is no point.
        kept = np.flatnonzero((square >= near * near) & (square <= far * far))
        if len(kept) < len(x):
            x, y, square = x[kept], y[kept], square[kept]
        step = abs(self.step)
        # A point belongs to the bin whose bearing is nearest: bins begin half a step before it.
        turned = np.arctan2(y, x)
        turned -= (self.first + np.pi) % TURN - np.pi
        if self.step < 0:
            turned = -turned
        turned += 0.5 * step
        turned[turned < 0.0] += TURN
        # What is a whole turn on is the first bin again, also where a bearing has been rounded up to it.
        turned[turned >= TURN] -= turned.dtype.type(TURN)
        places = np.maximum(turned, 0.0) / step
        inside = places < self.count
        if not inside.all():
            kept, places, square = kept[inside], places[inside], square[inside]
        at = places.astype(np.int64)
        # Of positive numbers the bits are in the order of their values: the point follows its distance in one word.
        words = square.astype(np.float32).view(np.uint32).astype(np.uint64) << np.uint64(32)
        words |= np.arange(len(words), dtype=np.uint64)
        best = np.full(self.count, _NONE)
        np.minimum.at(best, at, words)
        bins = np.flatnonzero(best != _NONE)
        return bins, kept[(best[bins] & np.uint64(0xFFFFFFFF)).astype(np.int64)]


_NONE = np.uint64(0xFFFFFFFFFFFFFFFF)


@dataclass(slots=True)
class Fill:
    """Statistics of filled bins, over all clouds of a topic."""

    bins: Bins
    clouds: int = 0
    _hit: Int64 = field(init=False)
    """(B,) clouds that had a point there."""
    _between: int = 0
    """Empty bins between two at about the same range."""
    _filled: int = 0
    """Filled bins."""

    def __post_init__(self) -> None:
        """Begin at zero."""
        self._hit = np.zeros(self.bins.count, np.int64)

    def add(self, ranges: Float32) -> None:
        """Take some sweeps."""
        filled = np.isfinite(ranges)
        self.clouds += len(ranges)
        self._hit += np.count_nonzero(filled, axis=0)
        self._filled += int(np.count_nonzero(filled))
        if ranges.shape[1] > 2:
            before, after = ranges[:, :-2], ranges[:, 2:]
            with np.errstate(invalid="ignore"):
                near = np.abs(before - after) < 0.1 * before
            self._between += int(np.count_nonzero(near & ~filled[:, 1:-1]))

    def notes(self) -> list[str]:
        """Return notes on a wrong view, and on bins too narrow for the sensor."""
        if not self._filled:
            return ["no cloud has a point between these heights"] if self.clouds else []
        notes = []
        holes = self._between / (self._between + self._filled)
        if holes > MANY_HOLES:
            fitting = self.bins.count // int(np.ceil(1.0 / (1.0 - holes)))
            notes.append(
                f"{holes:.0%} of the bins are empty between two that are not: the sensor has fewer columns than --bins "
                f"{self.bins.count}; try --bins {max(fitting, 2)}"
            )
        if self.clouds >= SOME_CLOUDS and (blind := self._blind()) is not None:
            first, last = np.degrees(blind)
            notes.append(
                f"no cloud has a point from {first:.0f} to {last:.0f} degrees: if the sensor does not look there, "
                f"--angle-min {last - 360:.0f} --fov {360 - (last - first):.0f} --degrees say so"
            )
        return notes

    def _blind(self) -> tuple[float, float] | None:
        """Return the widest gap of bearings never hit in a full turn [rad], if it is wide."""
        bins = self.bins
        if abs(bins.count * abs(bins.step) - TURN) > 1e-6:
            return None
        hit = np.flatnonzero(self._hit)
        gaps = np.diff(hit, append=hit[0] + bins.count)
        widest = int(np.argmax(gaps))
        if gaps[widest] * abs(bins.step) < WIDE:
            return None
        edges = bins.first + bins.step * (hit[widest] + np.array([0, gaps[widest]]))
        low, high = np.sort(edges)
        turns = TURN * np.floor((low + np.pi) / TURN)
        return float(low - turns), float(high - turns)


ROWS = 64
WAITING_BYTES = 16 << 20
"""Clouds are sliced when this many, or this many bytes of them, have been gathered."""

_MOST_FRAMES = 4
"""Frames of one topic of which notes speak."""


class Levelled(NamedTuple):
    """Level view of K clouds: points are turned by `rotation`, then moved by `offset`."""

    frame_id: str
    """Frame of the sweeps: x and y are seen from its origin."""
    rotation: Float64
    """(K, 3, 3); NaN where the position of the robot in a fixed frame is unknown."""
    offset: Float64
    """(K, 3) [m]; the third is the height that heights count from."""


class Seen(NamedTuple):
    """Ranges and intensities of the bins of a cloud."""

    ranges: Float32
    """(B,) range of the nearest point [m]; +inf without one."""
    intensities: Float32 | None
    """(B,) how strong its return was, NaN without a point; None where the cloud does not tell."""


class Levels(Protocol):
    """Interface to what is level."""

    def of(self, frame_id: str, stamp_ns: Int64) -> Levelled | None:
        """Return the level view of the clouds of one frame at times (K,); None if they are level."""

    def words(self, frame_id: str) -> str:
        """Return what heights are counted from, for people: `above base_link`."""


def slice_cloud(cloud: Cloud, part: Slice, bins: Bins, turn: Float64, move: Float64) -> Seen:
    """Return the nearest point of each bin.

    Parameters
    ----------
    turn, move : (3, 3) and (3,), how the points come to where they are seen from above; the third row tells their height
    """
    layout = cloud.layout
    axes = (layout.x, layout.y, layout.z)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if cloud.pose is not None:
            turn, move = turn @ _matrix(cloud.pose[3:]), turn @ cloud.pose[:3] + move
        # Most points are at other heights: of these no more is looked at than what tells the height.
        height = _along(
            turn[2], move[2], [cloud.column(axis) if share else None for axis, share in zip(axes, turn[2], strict=True)]
        )
        kept = np.flatnonzero((height >= _like(part.low, height)) & (height <= _like(part.high, height)))
        x, y, z = (cloud.column(axis, kept if len(kept) < len(layout) else None) for axis in axes)
        if move[:2].any() and not (real := (x != 0) | (y != 0) | (z != 0)).all():
            # Drivers write zeros where there was no return; moved from there they would be a thing.
            kept, x, y, z = kept[real], x[real], y[real], z[real]
        ahead, left = _along(turn[0], move[0], (x, y, z)), _along(turn[1], move[1], (x, y, z))
        near, far = part.limits or (0.0, FARTHEST)
        which, point = bins.nearest(ahead, left, max(near, NEAREST), min(far, FARTHEST))
    ranges = np.full(bins.count, np.inf, np.float32)
    ranges[which] = np.hypot(ahead[point].astype(np.float64), left[point].astype(np.float64))
    if layout.intensity is None:
        return Seen(ranges, None)
    intensities = np.full(bins.count, np.nan, np.float32)
    intensities[which] = as_singles(cloud.column(layout.intensity, kept[point]))
    return Seen(ranges, intensities)


def _like(limit: float, values: Floats) -> np.floating:
    """Return a limit in the precision of the values."""
    return values.dtype.type(limit)


def _along(row: Float64, move: float, axes: Iterable[Floats | None]) -> Floats:
    """Return one coordinate of moved points; terms without effect are skipped."""
    parts = [
        values if share == 1.0 else values * share
        for share, values in zip(row.tolist(), axes, strict=True)
        if share != 0.0 and values is not None
    ]
    # A row of a rotation is never all zero.
    found: Floats = parts[0]
    for part in parts[1:]:
        found = found + part
    # With the digits of the points: a number of numpy's own would make all of them float64.
    return found + float(move) if move else found


def _matrix(turn: Float64) -> Float64:
    """Return (3, 3) the rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = turn.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(slots=True)
class Slicer:
    """Makes sweeps of the clouds of one topic, in log order."""

    topic: str
    part: Slice
    bins: Bins
    levels: Levels
    report: ReadReport
    _waiting: list[tuple[int, Cloud]] = field(default_factory=list)
    _bytes: int = 0
    _frames: dict[str, None] = field(default_factory=dict)
    _from_nowhere: int = 0
    """Clouds without a known position of the robot."""
    _fill: Fill = field(init=False)

    def __post_init__(self) -> None:
        """Begin to count."""
        self._fill = Fill(self.bins)

    def take(self, message: Message) -> Iterator[RawSweeps]:
        """Take a message; the sweeps that it completes a block of."""
        try:
            self._waiting.append((message.record_ns, decode(message)))
        except BadCloudError as err:
            self.report.refused[(self.topic, str(err))] += 1
            return
        self._bytes += len(message.data)
        if len(self._waiting) >= ROWS or self._bytes >= WAITING_BYTES:
            yield from self.flush()

    def flush(self) -> Iterator[RawSweeps]:
        """Yield the sweeps of the clouds that wait, a block for each frame that follows another."""
        waiting, self._waiting, self._bytes = self._waiting, [], 0
        first = 0
        for last in range(1, len(waiting) + 1):
            frame_id = waiting[first][1].frame_id
            if last == len(waiting) or waiting[last][1].frame_id != frame_id:
                yield from self._block(frame_id, waiting[first:last])
                first = last

    def notes(self) -> list[str]:
        """Return notes on these sweeps."""
        part = self.part
        lines = [
            f"{self.topic}: sweeps of the points from {part.low:g} to {part.high:g} m {self.levels.words(frame_id)}"
            for frame_id in self._frames
        ]
        if self._from_nowhere:
            left_out = counted(self._from_nowhere, "cloud")
            lines.append(f"{self.topic}: {left_out} left out: no transform tells where the robot was then")
        return lines + [f"{self.topic}: {note}" for note in self._fill.notes()]

    def _block(self, frame_id: str, clouds: list[tuple[int, Cloud]]) -> Iterator[RawSweeps]:
        count = len(clouds)
        record_ns = np.array([record for record, _ in clouds], np.int64)
        stamp_ns = np.array([cloud.stamp_ns for _, cloud in clouds], np.int64)
        told = self.levels.of(frame_id, np.where(stamp_ns == 0, record_ns, stamp_ns))
        turns = np.broadcast_to(np.eye(3), (count, 3, 3)) if told is None else told.rotation
        moves = np.zeros((count, 3)) if told is None else told.offset
        known = ~np.isnan(turns).any(axis=(1, 2))
        self._from_nowhere += int(np.count_nonzero(~known))
        if not known.any():
            return
        if not known.all():
            count = int(np.count_nonzero(known))
            clouds = [clouds[row] for row in np.flatnonzero(known)]
            turns, moves, stamp_ns, record_ns = turns[known], moves[known], stamp_ns[known], record_ns[known]
        seen = [
            slice_cloud(cloud, self.part, self.bins, turn, move)
            for (_, cloud), turn, move in zip(clouds, turns, moves, strict=True)
        ]
        ranges = np.stack([each.ranges for each in seen])
        strengths = [np.empty(0, np.float32) if each.intensities is None else each.intensities for each in seen]
        self._fill.add(ranges)
        if len(self._frames) < _MOST_FRAMES:
            self._frames[frame_id] = None
        near, far = self.part.limits or (0.0, np.inf)
        yield RawSweeps(
            topic=self.topic,
            frame_ids=(frame_id if told is None else told.frame_id,),
            frame=np.zeros(count, np.int32),
            stamp_ns=stamp_ns,
            record_ns=record_ns,
            angle_min=np.full(count, self.bins.first),
            angle_increment=np.full(count, self.bins.step),
            range_min=np.full(count, near, np.float32),
            range_max=np.full(count, far, np.float32),
            beams=np.full(count, self.bins.count, np.int32),
            ranges=ranges,
            intensities=pad_intensities(strengths, self.bins.count),
        )
