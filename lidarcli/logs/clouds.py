"""Point clouds as they lie in messages: `sensor_msgs/PointCloud2` and `foxglove.PointCloud`, read by column."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.foxglove import CLOUD, NUMBER_KINDS, classes
from lidarcli.logs.base import MAX_MESSAGE, Message
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP
from lidarcli.ros.cursor import MAX_NAME, NAME_LONG, BadMessageError, Cursor
from lidarcli.sweeps import Float64

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
class Layout:
    """Memory layout of N points: rows (one if unorganised) of columns."""

    rows: int
    columns: int
    row_step: int
    """Bytes from row to row."""
    point_step: int
    """Bytes from point to point."""
    order: str
    """Byte order: `<` or `>`."""
    x: PointField
    y: PointField
    z: PointField | None
    """None where all points lie in the plane of the sensor."""
    intensity: PointField | None

    @classmethod
    def of(
        cls, shape: tuple[int, int], steps: tuple[int, int], order: str, fields: Mapping[str, PointField], size: int
    ) -> Layout:
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
        x, y, z = (_coordinate(fields.get(axis)) for axis in "xyz")
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


def _coordinate(field: PointField | None) -> PointField | None:
    return field if field is not None and field.kind in ("f4", "f8") else None


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """The points of one message, as they lie in it."""

    frame_id: str
    stamp_ns: int
    data: bytes
    start: int
    """Offset of the first point in `data`."""
    layout: Layout
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

_MAX_FIELDS = 1000
_KINDS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Types of numbers as numpy spells them, by their number in PointField."""


def decode_pointcloud2(data: bytes, encoding: str) -> Cloud:
    """Decode a PointCloud2 message, `cdr` or `ros1`.

    Raises
    ------
    BadCloudError
        It is cut off, has no coordinates, or declares more points than it holds.
    """
    try:
        return _pointcloud2(Cursor(data, encoding))
    except BadMessageError as err:
        raise BadCloudError(str(err)) from None


def _pointcloud2(cursor: Cursor) -> Cloud:
    stamp_ns = cursor.stamp_ns()
    frame_id = cursor.text()
    rows, columns = cursor.word(), cursor.word()
    count = cursor.word()
    if count > _MAX_FIELDS:
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
    layout = Layout.of((rows, columns), (row_step, point_step), order, fields, size)
    return Cloud(frame_id, stamp_ns, cursor.data, start, layout)


NOT_CLOUD = "not a foxglove.PointCloud"
NOT_FINITE = "its pose is not finite"


def decode_foxglove(data: bytes, encoding: str) -> Cloud:
    """Decode a foxglove.PointCloud message, `json` or `protobuf`.

    Raises
    ------
    BadCloudError
        It is cut off or no such message, has no coordinates, or declares more points than it holds.
    """
    return _json(data) if encoding == "json" else _protobuf(data)


def _json(data: bytes) -> Cloud:
    try:
        told = json.loads(data)
    except (ValueError, RecursionError):
        raise BadCloudError(NOT_JSON) from None
    try:
        stamp, pose = told.get("timestamp") or {}, told.get("pose") or {}
        place, turn = pose.get("position") or {}, pose.get("orientation") or {}
        return _cloud(
            str(told.get("frame_id", "")),
            int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nsec", 0)),
            [float(place.get(axis, 0.0)) for axis in "xyz"] + [float(turn.get(axis, 0.0)) for axis in "xyzw"],
            int(told["point_stride"]),
            [(str(each["name"]), int(each.get("offset", 0)), int(each["type"])) for each in told["fields"]],
            base64.b64decode(told.get("data") or "", validate=True),
        )
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as err:
        raise err if isinstance(err, BadCloudError) else BadCloudError(NOT_CLOUD) from None


def _protobuf(data: bytes) -> Cloud:
    # Most logs hold no protobuf and need not wait for the import.
    from google.protobuf.message import DecodeError

    try:
        told = classes()[CLOUD].FromString(data)
    except DecodeError:
        raise BadCloudError(NOT_PROTOBUF) from None
    place, turn = told.pose.position, told.pose.orientation
    return _cloud(
        told.frame_id,
        int(told.timestamp.seconds) * 1_000_000_000 + int(told.timestamp.nanos),
        [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w],
        told.point_stride,
        ((each.name, each.offset, each.type) for each in told.fields),
        told.data,
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
    layout = Layout.of((1, columns), (len(data), point_step), "<", fields, len(data))
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
    """Return the cloud of a message."""
    if len(message.data) > MAX_MESSAGE:
        raise BadCloudError(LONG)
    if message.encoding in ("cdr", "ros1"):
        return decode_pointcloud2(message.data, message.encoding)
    if message.encoding in ("json", "protobuf"):
        return decode_foxglove(message.data, message.encoding)
    raise BadCloudError(f"the encoding '{message.encoding}' is not read")
