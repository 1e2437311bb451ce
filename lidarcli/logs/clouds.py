"""Sweeps made of point clouds: a slice of heights seen from above, and in each direction the nearest point.

Clouds are `sensor_msgs/PointCloud2` and `foxglove.PointCloud`, read by column as they lie in their messages.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import counted
from lidarcli.logs.base import MAX_MESSAGE, Message, OpenOptions, ReadReport, Slice
from lidarcli.logs.blocks import as_singles, given_geometry, pad_intensities
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP
from lidarcli.ros.cursor import MAX_NAME, NAME_LONG, BadMessageError, Cursor
from lidarcli.ros.foxglove import CLOUD, NUMBER_KINDS, classes
from lidarcli.sweeps.range_rules import FARTHEST, NEAREST
from lidarcli.sweeps.types import TURN, Float32, Float64, Int64, RawSweeps

Floats = NDArray[np.floating]

NO_COORDINATES = "no x and y as float32 or float64"
OUTSIDE = "a field that is no part of its point"
LONG = f"a message of more than {MAX_MESSAGE >> 20} MiB"
TOO_FEW = "more points declared than the message holds"

_INTENSITIES = ("intensity", "intensities", "reflectivity")
"""Names of the intensity field, the preferred one first."""


class BadCloudError(ValueError):
    """A message that cannot be a cloud; the text is the cause."""


class PointField(NamedTuple):
    """Field of a point."""

    offset: int
    """Bytes from where the point begins."""
    kind: str
    """As numpy spells it, without byte order: `f4`, `u2` ..."""

    @property
    def end(self) -> int:
        """Bytes from where the point begins to where it ends."""
        return self.offset + int(self.kind[1:])


@dataclass(frozen=True, slots=True)
class CloudLayout:
    """Memory layout of N points: rows (one if unorganised) of columns."""

    rows: int
    columns: int
    row_step: int
    point_step: int
    order: str
    x: PointField
    y: PointField
    z: PointField | None
    """None where all points lie in the plane of the sensor."""
    intensity: PointField | None

    @classmethod
    def of(
        cls, shape: tuple[int, int], steps: tuple[int, int], order: str, fields: Mapping[str, PointField], size: int
    ) -> CloudLayout:
        """Check the declared layout against `size` bytes of points, and return it.

        Parameters
        ----------
        shape : rows and columns
        steps : bytes from row to row, and from point to point

        Raises
        ------
        BadCloudError
            There are no coordinates, or the points do not fit into the bytes.
        """
        x, y, z = (one if (one := fields.get(axis)) and one.kind in ("f4", "f8") else None for axis in "xyz")
        if x is None or y is None or (z is None and "z" in fields):
            raise BadCloudError(NO_COORDINATES)
        intensity = next((fields[name] for name in _INTENSITIES if name in fields), None)
        (rows, columns), (row_step, point_step) = shape, steps
        # Coordinates that share bytes would let a message declare more points than it can hold.
        if sum(axis.end - axis.offset for axis in (x, y, z) if axis is not None) > point_step:
            raise BadCloudError(OUTSIDE)
        if any(field.end > point_step for field in (x, y, z, intensity) if field is not None):
            raise BadCloudError(OUTSIDE)
        if not rows or not columns:
            return cls(0, 0, 0, point_step, order, x, y, z, intensity)
        width = columns * point_step
        # Some writers leave the step from row to row at zero, or count it otherwise: then rows follow each other.
        if row_step < width or (rows - 1) * row_step + width > size:
            row_step = width
        if (rows - 1) * row_step + width > size:
            raise BadCloudError(TOO_FEW)
        return cls(rows, columns, row_step, point_step, order, x, y, z, intensity)

    def __len__(self) -> int:
        return self.rows * self.columns


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """The points of one message, as they lie in it."""

    frame_id: str
    stamp_ns: int
    data: bytes
    start: int
    layout: CloudLayout
    pose: Float64 | None = None
    """(7,) x, y, z and quaternion x, y, z, w of the points' origin in the frame; None where they are one."""

    def column(self, field: PointField | None, chosen: NDArray[np.intp] | None = None) -> Floats:
        """Return (N,) one field of all points as float32, or float64 where it has more digits; zeros if missing.

        With `chosen` (K,) it is that of these points alone.
        """
        layout = self.layout
        if field is None or not len(layout):
            return np.zeros(len(layout) if chosen is None else len(chosen), np.float32)
        lying = np.ndarray(
            (layout.rows, layout.columns),
            np.dtype(layout.order + field.kind),
            self.data,
            self.start + field.offset,
            (layout.row_step, layout.point_step),
        )
        kind = np.float64 if field.kind == "f8" else np.float32
        if chosen is None:
            return np.ravel(lying.astype(kind))
        row, column = np.divmod(chosen, layout.columns)
        return lying[row, column].astype(kind)


MANY_FIELDS = "more than 1,000 fields declared"

_KINDS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Types of numbers as numpy spells them, by their number in PointField."""


def _pointcloud2(cursor: Cursor) -> Cloud:
    stamp_ns = cursor.stamp_ns()
    frame_id = cursor.text()
    rows, columns = cursor.word(), cursor.word()
    count = cursor.word()
    if count > 1000:
        raise BadCloudError(MANY_FIELDS)
    fields: dict[str, PointField] = {}
    for _ in range(count):
        name = cursor.text()
        offset, kind = cursor.word(), cursor.byte()
        cursor.word()  # how many numbers there are: the first counts
        if 0 < kind < len(_KINDS):
            fields.setdefault(name, PointField(offset, _KINDS[kind]))
    order = ">" if cursor.byte() else "<"
    point_step, row_step = cursor.word(), cursor.word()
    size = cursor.word()
    start = cursor.skip(size)
    layout = CloudLayout.of((rows, columns), (row_step, point_step), order, fields, size)
    return Cloud(frame_id, stamp_ns, cursor.data, start, layout)


NOT_CLOUD = "not a foxglove.PointCloud"
NOT_FINITE = "its pose is not finite"


def _json(data: bytes) -> Cloud:
    try:
        message = json.loads(data)
    except (ValueError, RecursionError):
        raise BadCloudError(NOT_JSON) from None
    try:
        stamp, pose = message.get("timestamp") or {}, message.get("pose") or {}
        place, turn = pose.get("position") or {}, pose.get("orientation") or {}
        return _cloud(
            str(message.get("frame_id", "")),
            int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nsec", 0)),
            [float(place.get(axis, 0.0)) for axis in "xyz"] + [float(turn.get(axis, 0.0)) for axis in "xyzw"],
            int(message["point_stride"]),
            [(str(each["name"]), int(each.get("offset", 0)), int(each["type"])) for each in message["fields"]],
            base64.b64decode(message.get("data") or "", validate=True),
        )
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as err:
        raise err if isinstance(err, BadCloudError) else BadCloudError(NOT_CLOUD) from None


def _protobuf(data: bytes) -> Cloud:
    # Most logs hold no protobuf and need not wait for the import.
    from google.protobuf.message import DecodeError

    try:
        message = classes()[CLOUD].FromString(data)
    except DecodeError:
        raise BadCloudError(NOT_PROTOBUF) from None
    place, turn = message.pose.position, message.pose.orientation
    return _cloud(
        message.frame_id,
        int(message.timestamp.seconds) * 1_000_000_000 + int(message.timestamp.nanos),
        [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w],
        message.point_stride,
        ((each.name, each.offset, each.type) for each in message.fields),
        message.data,
    )


def _cloud(
    frame_id: str, stamp_ns: int, pose: list[float], point_step: int, named: Iterable[tuple[str, int, int]], data: bytes
) -> Cloud:
    if not -(2**63) <= stamp_ns < 2**63:
        raise BadCloudError(STAMP)
    if len(frame_id) > MAX_NAME:
        raise BadCloudError(NAME_LONG)
    fields: dict[str, PointField] = {}
    for name, offset, kind in named:
        if 0 < kind < len(NUMBER_KINDS) and offset >= 0:
            fields.setdefault(name, PointField(offset, NUMBER_KINDS[kind]))
    columns = len(data) // point_step if point_step > 0 else 0
    layout = CloudLayout.of((1, columns), (len(data), point_step), "<", fields, len(data))
    return Cloud(frame_id, stamp_ns, data, 0, layout, _pose(pose))


def _pose(numbers: list[float]) -> Float64 | None:
    """Return the pose with a unit quaternion; None for the identity. A quaternion of zeros counts as no rotation."""
    pose = np.array(numbers)
    length = math.hypot(*numbers[3:])
    if not np.isfinite(pose).all() or not np.isfinite(length):
        raise BadCloudError(NOT_FINITE)
    pose[3:] = pose[3:] / length if length > 0 else [0.0, 0.0, 0.0, 1.0]
    return None if not pose[:6].any() else pose


def decode(message: Message) -> Cloud:
    """Return the cloud of a message: a PointCloud2 in `cdr` or `ros1`, a foxglove.PointCloud in `json` or `protobuf`.

    Raises
    ------
    BadCloudError
        It is cut off or no such message, has no coordinates, or declares more points than it holds.
    """
    data, encoding = message.data, message.encoding
    if len(data) > MAX_MESSAGE:
        raise BadCloudError(LONG)
    if encoding in ("json", "protobuf"):
        return _json(data) if encoding == "json" else _protobuf(data)
    if encoding not in ("cdr", "ros1"):
        raise BadCloudError(f"the encoding '{encoding}' is not read")
    try:
        return _pointcloud2(Cursor(data, encoding))
    except BadMessageError as err:
        raise BadCloudError(str(err)) from None


@dataclass(frozen=True, slots=True)
class Bins:
    """The beams of a sweep that is made of a cloud."""

    first: float
    step: float
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


ROWS = 64


class Levelled(NamedTuple):
    """Level view of K clouds: points are turned by `rotation`, then moved by `offset`."""

    frame_id: str
    """Frame of the sweeps: x and y are seen from its origin."""
    rotation: Float64
    """(K, 3, 3); NaN where the position of the robot in a fixed frame is unknown."""
    offset: Float64
    """(K, 3) [m]; the third is the height that heights count from."""


class CloudScan(NamedTuple):
    """Ranges and intensities of the bins of a cloud."""

    ranges: Float32
    """(B,) range of the nearest point [m]; +inf without one."""
    intensities: Float32 | None
    """(B,) how strong its return was, NaN without a point; None where the cloud has none."""


class Levels(Protocol):
    """Interface to what is level."""

    def of(self, frame_id: str, stamp_ns: Int64) -> Levelled | None:
        """Return the level view of the clouds of one frame at times (K,); None if they are level."""

    def words(self, frame_id: str) -> str:
        """Return what heights are counted from, for people: `above base_link`."""


def slice_cloud(cloud: Cloud, part: Slice, bins: Bins, turn: Float64, move: Float64) -> CloudScan:
    """Return the nearest point of each bin.

    Parameters
    ----------
    turn, move : (3, 3) and (3,), how the points come to where they are seen from above; the third row makes their height
    """
    layout = cloud.layout
    axes = (layout.x, layout.y, layout.z)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        if cloud.pose is not None:
            turn, move = turn @ _matrix(cloud.pose[3:]), turn @ cloud.pose[:3] + move
        # Most points are at other heights: of these only the coordinates that make the height are read.
        height = _along(
            turn[2], move[2], [cloud.column(axis) if share else None for axis, share in zip(axes, turn[2], strict=True)]
        )
        kept = np.flatnonzero((height >= height.dtype.type(part.low)) & (height <= height.dtype.type(part.high)))
        x, y, z = (cloud.column(axis, kept if len(kept) < len(layout) else None) for axis in axes)
        if move[:2].any() and not (real := (x != 0) | (y != 0) | (z != 0)).all():
            # Drivers write zeros where there was no return; moved from there they would be an object.
            kept, x, y, z = kept[real], x[real], y[real], z[real]
        ahead, left = _along(turn[0], move[0], (x, y, z)), _along(turn[1], move[1], (x, y, z))
        near, far = part.limits or (0.0, FARTHEST)
        which, point = bins.nearest(ahead, left, max(near, NEAREST), min(far, FARTHEST))
    ranges = np.full(bins.count, np.inf, np.float32)
    ranges[which] = np.hypot(ahead[point].astype(np.float64), left[point].astype(np.float64))
    if layout.intensity is None:
        return CloudScan(ranges, None)
    intensities = np.full(bins.count, np.nan, np.float32)
    intensities[which] = as_singles(cloud.column(layout.intensity, kept[point]))
    return CloudScan(ranges, intensities)


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
    _clouds: int = 0
    _is_filled: bool = False
    """True once a cloud has had a point."""

    def take(self, message: Message) -> Iterator[RawSweeps]:
        """Take a message; the sweeps that it completes a block of."""
        try:
            self._waiting.append((message.record_ns, decode(message)))
        except BadCloudError as err:
            self.report.refused[(self.topic, str(err))] += 1
            return
        self._bytes += len(message.data)
        if len(self._waiting) >= ROWS or self._bytes >= 16 << 20:
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
        if self._clouds and not self._is_filled:
            lines.append(f"{self.topic}: no cloud has a point between these heights")
        return lines

    def _block(self, frame_id: str, clouds: list[tuple[int, Cloud]]) -> Iterator[RawSweeps]:
        count = len(clouds)
        record_ns = np.array([record for record, _ in clouds], np.int64)
        stamp_ns = np.array([cloud.stamp_ns for _, cloud in clouds], np.int64)
        level = self.levels.of(frame_id, np.where(stamp_ns == 0, record_ns, stamp_ns))
        turns = np.broadcast_to(np.eye(3), (count, 3, 3)) if level is None else level.rotation
        moves = np.zeros((count, 3)) if level is None else level.offset
        known = ~np.isnan(turns).any(axis=(1, 2))
        self._from_nowhere += int(np.count_nonzero(~known))
        if not known.any():
            return
        if not known.all():
            count = int(np.count_nonzero(known))
            clouds = [clouds[row] for row in np.flatnonzero(known)]
            turns, moves, stamp_ns, record_ns = turns[known], moves[known], stamp_ns[known], record_ns[known]
        scans = [
            slice_cloud(cloud, self.part, self.bins, turn, move)
            for (_, cloud), turn, move in zip(clouds, turns, moves, strict=True)
        ]
        ranges = np.stack([each.ranges for each in scans])
        strengths = [np.empty(0, np.float32) if each.intensities is None else each.intensities for each in scans]
        self._clouds += count
        self._is_filled |= bool(np.isfinite(ranges).any())
        if len(self._frames) < 4:
            self._frames[frame_id] = None
        near, far = self.part.limits or (0.0, np.inf)
        yield RawSweeps(
            topic=self.topic,
            frame_ids=(frame_id if level is None else level.frame_id,),
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
