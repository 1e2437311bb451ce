"""`foxglove.PoseInFrame` and `foxglove.FrameTransform`, in JSON and in protobuf, message by message."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from google.protobuf.message import DecodeError

from lidarcli.foxglove import TRANSFORM, classes
from lidarcli.logs.foxglove import NOT_JSON, NOT_PROTOBUF, STAMP
from lidarcli.poses.rows import BadPoseError, PoseRows, frame_name

NOT_POSE = "not what its type says"

_Pose = tuple[str, str, int, list[float]]


def decode(kind: str, encoding: str, messages: Sequence[bytes], refused: Counter[str]) -> Iterator[PoseRows]:
    """The poses of messages of one type; what cannot be a pose is counted in `refused` by its cause.

    Parameters
    ----------
    kind : `foxglove.PoseInFrame` or `foxglove.FrameTransform`
    encoding : `json` or `protobuf`
    """
    found: dict[tuple[str, str], list[tuple[int, int, list[float]]]] = {}
    for index, data in enumerate(messages):
        try:
            parent, child, stamp_ns, numbers = _json(kind, data) if encoding == "json" else _proto(kind, data)
        except BadPoseError as err:
            refused[str(err)] += 1
            continue
        found.setdefault((frame_name(parent), frame_name(child)), []).append((index, stamp_ns, numbers))
    for (parent, child), rows in found.items():
        yield PoseRows(
            parent=parent,
            child=child,
            row=np.array([row[0] for row in rows], np.intp),
            stamp_ns=np.array([row[1] for row in rows], np.int64),
            numbers=np.array([row[2] for row in rows], np.float64),
        )


def _json(kind: str, data: bytes) -> _Pose:
    try:
        fields = json.loads(data)
    except (ValueError, RecursionError):
        raise BadPoseError(NOT_JSON) from None
    try:
        stamp = fields.get("timestamp") or {}
        stamp_ns = int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nsec", 0))
        if kind == TRANSFORM:
            place, turn = fields["translation"], fields["rotation"]
            names = str(fields.get("parent_frame_id", "")), str(fields.get("child_frame_id", ""))
        else:
            place, turn = fields["pose"]["position"], fields["pose"]["orientation"]
            names = str(fields.get("frame_id", "")), ""
        # A missing number is 0, as in protobuf.
        numbers = [float(place.get(axis, 0.0)) for axis in "xyz"] + [
            float(turn.get(axis, 0.0)) for axis in "xyzw"
        ]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise BadPoseError(NOT_POSE) from None
    return *names, _checked(stamp_ns), numbers


def _proto(kind: str, data: bytes) -> _Pose:
    try:
        fields = classes()[kind].FromString(data)
    except DecodeError:
        raise BadPoseError(NOT_PROTOBUF) from None
    stamp_ns = int(fields.timestamp.seconds) * 1_000_000_000 + int(fields.timestamp.nanos)
    if kind == TRANSFORM:
        place, turn, names = (
            fields.translation,
            fields.rotation,
            (fields.parent_frame_id, fields.child_frame_id),
        )
    else:
        place, turn, names = fields.pose.position, fields.pose.orientation, (fields.frame_id, "")
    return *names, _checked(stamp_ns), [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _checked(stamp_ns: int) -> int:
    if not -(2**63) <= stamp_ns < 2**63:
        raise BadPoseError(STAMP)
    return stamp_ns
