"""Pose messages as arrays: those of ROS by column, those of foxglove one by one, plane poses of text logs."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from lidarcli.foxglove import POSE, SCAN, TRANSFORM, classes
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP, stamp_of
from lidarcli.logs.planar import RECORD
from lidarcli.ros.cursor import BadMessageError, Cursor
from lidarcli.sweeps import Float64, Int64, UInt8

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
    """Decode plane poses made by `logs.planar`."""
    size = RECORD.itemsize
    found: dict[bytes, list[int]] = {}
    for index, data in enumerate(messages):
        found.setdefault(data[size:], []).append(index)
    for names, some in found.items():
        parent, _, child = names.decode().partition("\0")
        records = np.frombuffer(b"".join(messages[index][:size] for index in some), RECORD)
        numbers = np.zeros((len(some), 7))
        numbers[:, 0], numbers[:, 1] = records["x"], records["y"]
        # The sine of infinity is none; poses that are not finite are counted where all are.
        with np.errstate(invalid="ignore"):
            numbers[:, 5], numbers[:, 6] = np.sin(0.5 * records["yaw"]), np.cos(0.5 * records["yaw"])
        yield PoseRows(parent, child, np.array(some, np.intp), records["stamp_ns"].astype(np.int64), numbers)


TOO_MANY = f"more than {MAX_TRANSFORMS} transforms declared"

_NUMBERS = 56
"""Bytes of a position and a quaternion."""


@dataclass(frozen=True, slots=True)
class _Entry:
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
            alike = _alike(matrix, walker.fixed)
            yield from _read(matrix[alike], rows[alike], walker)
            rows, matrix = rows[~alike], matrix[~alike]


def _alike(matrix: UInt8, fixed: list[tuple[int, int]]) -> NDArray[np.bool_]:
    """Return the messages with the layout of the first one."""
    if not fixed or len(matrix) == 1:
        return np.ones(len(matrix), bool)
    columns = np.concatenate([np.arange(start, stop) for start, stop in fixed])
    alike: NDArray[np.bool_] = (matrix[:, columns] == matrix[0, columns]).all(axis=1)
    return alike


def _read(matrix: UInt8, rows: NDArray[np.intp], walker: _Walker) -> Iterator[PoseRows]:
    order = walker.order
    for entry in walker.entries:
        words = matrix[:, entry.stamp : entry.stamp + 8].copy().view(f"{order}u4")
        seconds = words[:, 0].astype(np.int64)
        if walker.encoding == "cdr":
            seconds = words[:, 0].astype(np.uint32).view(np.int32).astype(np.int64)
        numbers = matrix[:, entry.numbers : entry.numbers + _NUMBERS].copy().view(f"{order}f8")
        yield PoseRows(
            parent=entry.parent,
            child=entry.child,
            row=rows,
            stamp_ns=seconds * 1_000_000_000 + words[:, 1],
            numbers=numbers.astype(np.float64),
        )


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
        yield PoseRows(
            parent=parent,
            child=child,
            row=np.array([row[0] for row in rows], np.intp),
            stamp_ns=np.array([row[1] for row in rows], np.int64),
            numbers=np.array([row[2] for row in rows], np.float64),
        )


_OF_SCAN = [
    (name, re.compile(rb'"%s"\s*:\s*("(?:[^"\\]|\\.)*"|\{(?:[^{}]|\{[^{}]*\})*\}|\d[\d.]*)' % spelled))
    for name, spelled in (("timestamp", b"timestamp"), ("frame_id", b"frame(?:_i|I)d"), ("pose", b"pose"))
]
"""Fields of a scan beside its ranges, which take long to read."""


def _json(kind: str, data: bytes) -> _Pose:
    try:
        if kind == SCAN:
            told = {name: json.loads(found[1]) for name, one in _OF_SCAN if (found := one.search(data))}
            fields = {"pose": {"position": {}, "orientation": {}}} | told
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
    stamp_ns = int(fields.timestamp.seconds) * 1_000_000_000 + int(fields.timestamp.nanos)
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
