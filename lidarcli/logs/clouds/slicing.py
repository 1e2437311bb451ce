"""From the points of clouds to sweeps: a slice of heights, seen from above, and in each direction the nearest point."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from lidarcli.display import counted
from lidarcli.logs.base import MAX_MESSAGE, Message, ReadReport, Slice
from lidarcli.logs.blocks import as_singles, pad_intensities
from lidarcli.logs.clouds import foxglove, pointcloud2
from lidarcli.logs.clouds.bins import Bins, Fill
from lidarcli.logs.clouds.cloud import BadCloudError, Cloud, Floats
from lidarcli.range_rules import FARTHEST, NEAREST
from lidarcli.sweeps import Float32, Float64, Int64, RawSweeps

ROWS = 64
WAITING_BYTES = 16 << 20
"""Clouds are sliced when so many, or so many bytes of them, have come together."""

LONG = f"a message of more than {MAX_MESSAGE >> 20} MiB"
_MOST_FRAMES = 4
"""Frames of one topic of which notes speak."""


class Levelled(NamedTuple):
    """How the points of K clouds come to where they are seen from above: turned by `rotation`, then moved by `offset`."""

    frame_id: str
    """Frame of the sweeps: x and y are seen from its origin."""
    rotation: Float64
    """(K, 3, 3); NaN where nobody knows where points of a fixed frame are seen from."""
    offset: Float64
    """(K, 3) [m]; the third is the height that heights count from."""


class Seen(NamedTuple):
    """What the bins of a cloud hold."""

    ranges: Float32
    """(B,) of the nearest point [m]; +inf where there is none."""
    intensities: Float32 | None
    """(B,) how strong its return was, NaN without a point; None where the cloud does not tell."""


class Levels(Protocol):
    """Knows what is level."""

    def of(self, frame_id: str, stamp_ns: Int64) -> Levelled | None:
        """For the clouds of one frame at times (K,); None where they are seen as they are."""

    def words(self, frame_id: str) -> str:
        """What heights of the points of a frame count from, for people: `above base_link`."""


def decode(message: Message) -> Cloud:
    """The cloud of a message; `BadCloudError` where it is none."""
    if len(message.data) > MAX_MESSAGE:
        raise BadCloudError(LONG)
    if message.encoding in ("cdr", "ros1"):
        return pointcloud2.decode(message.data, message.encoding)
    if message.encoding in ("json", "protobuf"):
        return foxglove.decode(message.data, message.encoding)
    raise BadCloudError(f"the encoding '{message.encoding}' is not read")


def slice_cloud(cloud: Cloud, part: Slice, bins: Bins, turn: Float64, move: Float64) -> Seen:
    """The nearest point of each bin.

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
            turn[2],
            move[2],
            [cloud.column(axis) if share else None for axis, share in zip(axes, turn[2], strict=True)],
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
    """A limit with the digits of the values: 0.1 m is that of the log."""
    return values.dtype.type(limit)


def _along(row: Float64, move: float, axes: Iterable[Floats | None]) -> Floats:
    """One coordinate of moved points; what the row leaves as it is costs nothing."""
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
    """(3, 3) the rotation of a unit quaternion x, y, z, w."""
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
    """Clouds of which nobody knows where they are seen from."""
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
        """The sweeps of the clouds that wait, a block for each frame that follows another."""
        waiting, self._waiting, self._bytes = self._waiting, [], 0
        first = 0
        for last in range(1, len(waiting) + 1):
            frame_id = waiting[first][1].frame_id
            if last == len(waiting) or waiting[last][1].frame_id != frame_id:
                yield from self._block(frame_id, waiting[first:last])
                first = last

    def notes(self) -> list[str]:
        """What a user should know of these sweeps."""
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
        strengths = [
            np.empty(0, np.float32) if each.intensities is None else each.intensities for each in seen
        ]
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
