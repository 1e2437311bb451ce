"""`foxglove.PointCloud` in JSON and in protobuf."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable

import numpy as np

from lidarcli.foxglove import CLOUD, NUMBER_KINDS, classes
from lidarcli.logs.clouds.cloud import BadCloudError, Cloud, Layout, PointField
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP
from lidarcli.ros.cursor import MAX_NAME, NAME_LONG
from lidarcli.sweeps import Float64

NOT_CLOUD = "not a foxglove.PointCloud"
NOT_FINITE = "its pose is not finite"


def decode(data: bytes, encoding: str) -> Cloud:
    """One message, `json` or `protobuf`.

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
    frame_id: str,
    stamp_ns: int,
    pose: list[float],
    point_step: int,
    named: Iterable[tuple[str, int, int]],
    data: bytes,
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
    """The pose with a quaternion of length 1; None where it changes nothing. A turn of zeros is none."""
    pose = np.array(numbers)
    length = math.hypot(*numbers[3:])
    if not np.isfinite(pose).all() or not np.isfinite(length):
        raise BadCloudError(NOT_FINITE)
    pose[3:] = pose[3:] / length if length > 0 else [0.0, 0.0, 0.0, 1.0]
    return None if not pose[:6].any() else pose
