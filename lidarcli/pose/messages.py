"""Messages as arrays: poses by column or one by one, velocities and polygons."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from lidarcli.logs.base import PLANAR, PLANAR_POSE, Log, Message, ReadReport
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP, stamp_of
from lidarcli.options.times import SECOND_NS
from lidarcli.ros.cursor import BadMessageError, Cursor
from lidarcli.ros.foxglove import POSE, SCAN, TRANSFORM, classes
from lidarcli.sweeps.masks import same_name
from lidarcli.sweeps.types import Float64, Int64, UInt8

TRANSFORMS = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage", "foxglove.FrameTransform"})
"""Types that are links of the tree of frames."""
ODOMETRY = "nav_msgs/msg/Odometry"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
MAX_TRANSFORMS = 10_000
"""Most transforms of one message that are believed."""


class BadPoseError(ValueError):
    """A message that cannot be a pose; the text is the cause."""


@dataclass(frozen=True, eq=False, slots=True)
class PoseRows:
    """Poses of one frame in another, from some messages of one topic."""

    parent: str
    child: str
    """Empty where the message does not name it (PoseStamped)."""
    row: NDArray[np.intp]
    """(K,) the message, among those that were handed in."""
    stamp_ns: Int64
    """(K,) header stamps."""
    numbers: Float64
    """(K, 7) x, y, z and the quaternion's x, y, z, w."""


def frame_name(name: str) -> str:
    """Return a frame in one spelling: `/odom` and `odom` are one.

    >>> frame_name("/robot_0/odom")
    'robot_0/odom'
    """
    return name.strip("/")


def decode_planar(messages: Sequence[bytes]) -> Iterator[PoseRows]:
    """Decode plane poses of text logs."""
    size = PLANAR_POSE.itemsize
    found: dict[bytes, list[int]] = {}
    for index, data in enumerate(messages):
        found.setdefault(data[size:], []).append(index)
    for names, some in found.items():
        parent, _, child = names.decode().partition("\0")
        records = np.frombuffer(b"".join(messages[index][:size] for index in some), PLANAR_POSE)
        numbers = np.zeros((len(some), 7))
        numbers[:, 0], numbers[:, 1] = records["x"], records["y"]
        # The sine of infinity is none; poses that are not finite are counted where all are.
        with np.errstate(invalid="ignore"):
            numbers[:, 5], numbers[:, 6] = np.sin(0.5 * records["yaw"]), np.cos(0.5 * records["yaw"])
        yield PoseRows(parent, child, np.array(some, np.intp), records["stamp_ns"].astype(np.int64), numbers)


TOO_MANY = f"more than {MAX_TRANSFORMS} transforms declared"
_NUMBERS = 56
"""Bytes of a position and a quaternion."""


class _Entry(NamedTuple):
    """Position of one pose in a message."""

    stamp: int
    numbers: int
    parent: str
    child: str


@dataclass(slots=True)
class _Walker:
    """Walks through one message and notes positions."""

    data: bytes
    kind: str
    encoding: str
    order: str = "<"
    fixed: list[tuple[int, int]] = field(default_factory=list)
    """Byte ranges that decide where all others stand."""
    entries: list[_Entry] = field(default_factory=list)

    def walk(self) -> None:
        """Find every pose of the message."""
        cursor = Cursor(self.data, self.encoding)
        self.order = cursor.order
        if cursor.at:
            self.fixed.append((0, 2))
        count = 1
        if self.kind in TRANSFORMS:
            start = cursor.at
            count = cursor.word()
            self.fixed.append((start, cursor.at))
            if count > MAX_TRANSFORMS:
                raise BadMessageError(TOO_MANY)
        for _ in range(count):
            self._entry(cursor)

    def _entry(self, cursor: Cursor) -> None:
        if self.encoding == "ros1":
            cursor.skip(4)  # the sequence number
        cursor.align(4)
        stamp = cursor.skip(8)
        parent = self._name(cursor)
        child = self._name(cursor) if self.kind in TRANSFORMS or self.kind == ODOMETRY else ""
        cursor.align(8)
        numbers = cursor.skip(_NUMBERS)
        self.entries.append(_Entry(stamp, numbers, frame_name(parent), frame_name(child)))

    def _name(self, cursor: Cursor) -> str:
        cursor.align(4)
        start = cursor.at
        text = cursor.text()
        self.fixed.append((start, cursor.at))
        return text


def decode_ros(kind: str, encoding: str, messages: Sequence[bytes], refused: Counter[str]) -> Iterator[PoseRows]:
    """Decode ROS messages of one type; causes of refused ones are counted in `refused`.

    Parameters
    ----------
    kind : message type as `ros_type` spells it
    encoding : `cdr` or `ros1`
    """
    lengths = np.array([*map(len, messages)], np.intp)
    for length in dict.fromkeys(lengths.tolist()):
        rows = np.flatnonzero(lengths == length)
        joined = b"".join(map(messages.__getitem__, rows.tolist()))
        matrix = np.frombuffer(joined, np.uint8).reshape(len(rows), length)
        while len(rows):
            walker = _Walker(messages[rows[0]], kind, encoding)
            try:
                walker.walk()
            except BadMessageError as err:
                refused[str(err)] += 1
                rows, matrix = rows[1:], matrix[1:]
                continue
            # The messages with the layout of the first one.
            columns = np.concatenate([np.arange(*span) for span in [(0, 0), *walker.fixed]])
            alike = (matrix[:, columns] == matrix[0, columns]).all(axis=1)
            yield from _read(matrix[alike], rows[alike], walker)
            rows, matrix = rows[~alike], matrix[~alike]


def _read(matrix: UInt8, rows: NDArray[np.intp], walker: _Walker) -> Iterator[PoseRows]:
    order = walker.order
    for entry in walker.entries:
        words = matrix[:, entry.stamp : entry.stamp + 8].copy().view(f"{order}u4")
        seconds = words[:, 0].astype(np.int64)
        if walker.encoding == "cdr":
            seconds = words[:, 0].astype(np.uint32).view(np.int32).astype(np.int64)
        numbers = matrix[:, entry.numbers : entry.numbers + _NUMBERS].copy().view(f"{order}f8")
        stamp_ns = seconds * SECOND_NS + words[:, 1]
        yield PoseRows(entry.parent, entry.child, rows, stamp_ns, numbers.astype(np.float64))


NOT_POSE = "not what its type says"
_Pose = tuple[str, str, int, list[float]]


def decode_foxglove(kind: str, encoding: str, messages: Sequence[bytes], refused: Counter[str]) -> Iterator[PoseRows]:
    """Decode foxglove messages of one type; causes of refused ones are counted in `refused`.

    Parameters
    ----------
    kind : `foxglove.PoseInFrame`, `foxglove.FrameTransform`, or `foxglove.LaserScan` for its pose
    encoding : `json` or `protobuf`
    """
    found: dict[tuple[str, str], list[tuple[int, int, list[float]]]] = {}
    for index, data in enumerate(messages):
        try:
            parent, child, stamp_ns, numbers = _json(kind, data) if encoding == "json" else _proto(kind, data)
        except BadPoseError as err:
            # Who reads the sweeps counts what is no scan.
            refused[str(err)] += kind != SCAN
            continue
        if kind == SCAN and not any(numbers[3:]):
            numbers[6] = 1.0
        found.setdefault((frame_name(parent), frame_name(child)), []).append((index, stamp_ns, numbers))
    for (parent, child), rows in found.items():
        row, stamp, poses = zip(*rows, strict=True)
        yield PoseRows(parent, child, np.array(row, np.intp), np.array(stamp, np.int64), np.array(poses, np.float64))


_OF_SCAN = [
    (name, re.compile(rb'"%s"\s*:\s*("(?:[^"\\]|\\.)*"|\{(?:[^{}]|\{[^{}]*\})*\}|\d[\d.]*)' % spelled))
    for name, spelled in (("timestamp", b"timestamp"), ("frame_id", b"frame(?:_i|I)d"), ("pose", b"pose"))
]
"""Fields of a scan other than its ranges, which take long to read."""


def _json(kind: str, data: bytes) -> _Pose:
    try:
        if kind == SCAN:
            named = {name: json.loads(found[1]) for name, one in _OF_SCAN if (found := one.search(data))}
            fields = {"pose": {"position": {}, "orientation": {}}} | named
        else:
            fields = json.loads(data)
    except (ValueError, RecursionError):
        raise BadPoseError(NOT_JSON) from None
    try:
        stamp_ns = stamp_of(fields.get("timestamp"), data)
        if kind == TRANSFORM:
            place, turn = fields["translation"], fields["rotation"]
            names = str(fields.get("parent_frame_id", "")), str(fields.get("child_frame_id", ""))
        else:
            place, turn = fields["pose"]["position"], fields["pose"]["orientation"]
            names = str(fields.get("frame_id", "")), ""
        # A missing number is 0, as in protobuf.
        numbers = [float(place.get(axis, 0.0)) for axis in "xyz"] + [float(turn.get(axis, 0.0)) for axis in "xyzw"]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise BadPoseError(NOT_POSE) from None
    return *names, _checked(stamp_ns), numbers


def _proto(kind: str, data: bytes) -> _Pose:
    try:
        # A scan begins with the fields of such a pose; what follows is left.
        fields = classes()[POSE if kind == SCAN else kind].FromString(data)
    except DecodeError:
        raise BadPoseError(NOT_PROTOBUF) from None
    stamp_ns = int(fields.timestamp.seconds) * SECOND_NS + int(fields.timestamp.nanos)
    if kind == TRANSFORM:
        place, turn = fields.translation, fields.rotation
        names = fields.parent_frame_id, fields.child_frame_id
    else:
        place, turn, names = fields.pose.position, fields.pose.orientation, (fields.frame_id, "")
    return *names, _checked(stamp_ns), [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _checked(stamp_ns: int) -> int:
    if not -(2**63) <= stamp_ns < 2**63:
        raise BadPoseError(STAMP)
    return stamp_ns


TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
POLYGON = "geometry_msgs/msg/PolygonStamped"
VELOCITY_TYPES = frozenset({TWIST, TWIST_STAMPED, ODOMETRY})
_POSE, _TWIST, _CORNER = (7 + 36) * 8, 6 * 8, 3 * 4
"""Bytes of a pose with its covariance, of a twist (linear x, y, z and angular x, y, z), and of a corner (x, y, z)."""
NOT_FINITE = "a number that is not finite"
FEW_CORNERS = "fewer than three corners"
Decoded = TypeVar("Decoded")


class StampedPolygon(NamedTuple):
    """A polygon of a message."""

    stamp_ns: int
    frame_id: str
    corners: Float64
    """(C, 2) [m]."""


def velocities(log: Log, topic: str, report: ReadReport) -> tuple[Int64, Float64] | None:
    """Read the velocities of a topic: Twist, TwistStamped, or the twist of an Odometry.

    Returns
    -------
    Their stamps (N,) [ns] in order, those of headers where they are not 0, else of the recording; and (N, 3) ahead, left
    [m/s], turning [rad/s]. None where the log has no message of this topic. Those that cannot be read are counted in
    `report.refused`.
    """
    decoded = messages_of(log, topic, VELOCITY_TYPES, report, _velocity)
    if decoded is None:
        return None
    stamps = np.array([stamp_ns for stamp_ns, _ in decoded], np.int64)
    found = np.array([velocity for _, velocity in decoded], np.float64).reshape(-1, 3)
    order = np.argsort(stamps, kind="stable")
    return stamps[order], found[order]


def polygons(log: Log, topic: str, report: ReadReport) -> list[StampedPolygon] | None:
    """Read the polygons (PolygonStamped) of a topic in order of their stamps; the rest as of `velocities`."""
    decoded = messages_of(log, topic, frozenset({POLYGON}), report, _polygon)
    return None if decoded is None else sorted(decoded, key=lambda each: each.stamp_ns)


def messages_of(
    log: Log, topic: str, types: frozenset[str], report: ReadReport, decode: Callable[[Message, Cursor], Decoded]
) -> list[Decoded] | None:
    """Decode every message of a topic; None where there is none, without a pass where the log is known to have none."""
    if (listed := log.topics()) is not None:
        types = types & {each.type for each in listed if same_name(each.name, topic)}
    decoded: list[Decoded] | None = None
    for message in log.messages(types, report) if types else ():
        if not same_name(message.topic, topic):
            continue
        decoded = [] if decoded is None else decoded
        try:
            if message.encoding not in {"cdr", "ros1"}:
                raise BadMessageError(f"{message.encoding} cannot be read")
            decoded.append(decode(message, Cursor(message.data, message.encoding)))
        except BadMessageError as err:
            report.refused[message.topic, str(err)] += 1
    return decoded


def _velocity(message: Message, cursor: Cursor) -> tuple[int, tuple[float, float, float]]:
    stamp_ns = 0
    if message.type != TWIST:
        stamp_ns = cursor.stamp_ns()
        cursor.text()
    if message.type == ODOMETRY:
        cursor.text()
        cursor.align(8)
        cursor.skip(_POSE)
    cursor.align(8)
    start = cursor.skip(_TWIST)
    numbers = np.frombuffer(message.data, f"{cursor.order}f8", 6, start)
    if not np.isfinite(numbers).all():
        raise BadMessageError(NOT_FINITE)
    return stamp_ns or message.record_ns, (float(numbers[0]), float(numbers[1]), float(numbers[5]))


def _polygon(message: Message, cursor: Cursor) -> StampedPolygon:
    stamp_ns = cursor.stamp_ns()
    frame = frame_name(cursor.text())
    count = cursor.word()
    start = cursor.skip(count * _CORNER)
    numbers = np.frombuffer(message.data, f"{cursor.order}f4", 3 * count, start).reshape(count, 3)
    corners = numbers[:, :2].astype(np.float64)
    if not np.isfinite(corners).all():
        raise BadMessageError(NOT_FINITE)
    if count < 3:
        raise BadMessageError(FEW_CORNERS)
    return StampedPolygon(stamp_ns or message.record_ns, frame, corners)


ENCODING = "its encoding is not read"


def _decode(kind: str, encoding: str, data: Sequence[bytes], refused: Counter[str]) -> Iterable[PoseRows]:
    if encoding in ("cdr", "ros1") and not kind.startswith("foxglove."):
        return decode_ros(kind, encoding, data, refused)
    if encoding in ("json", "protobuf") and kind.startswith("foxglove."):
        return decode_foxglove(kind, encoding, data, refused)
    if encoding == PLANAR:
        return decode_planar(data)
    refused[ENCODING] += len(data)
    return ()
