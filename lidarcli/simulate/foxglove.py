"""Messages of the foxglove schemas, as JSON and as protobuf."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import cos, isfinite, sin
from typing import Any

from google.protobuf import descriptor_pb2, timestamp_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from lidarcli.simulate.messages import Encoding
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import RawSweeps

SCAN = "foxglove.LaserScan"
POSE = "foxglove.PoseInFrame"
TRANSFORM = "foxglove.FrameTransform"

_STAMP = "google.protobuf.Timestamp"
_FIELDS: dict[str, tuple[tuple[str, str], ...]] = {
    "foxglove.Vector3": (("x", "double"), ("y", "double"), ("z", "double")),
    "foxglove.Quaternion": (("x", "double"), ("y", "double"), ("z", "double"), ("w", "double")),
    "foxglove.Pose": (("position", "foxglove.Vector3"), ("orientation", "foxglove.Quaternion")),
    SCAN: (
        ("timestamp", _STAMP),
        ("frame_id", "string"),
        ("pose", "foxglove.Pose"),
        ("start_angle", "double"),
        ("end_angle", "double"),
        ("ranges", "double[]"),
        ("intensities", "double[]"),
    ),
    POSE: (("timestamp", _STAMP), ("frame_id", "string"), ("pose", "foxglove.Pose")),
    TRANSFORM: (
        ("timestamp", _STAMP),
        ("parent_frame_id", "string"),
        ("child_frame_id", "string"),
        ("translation", "foxglove.Vector3"),
        ("rotation", "foxglove.Quaternion"),
    ),
}
"""Message type → its fields; their protobuf numbers count from 1."""


def json_schema(name: str) -> str:
    """The JSON schema of a message type."""

    def of(kind: str) -> dict[str, Any]:
        if kind.endswith("[]"):
            return {"type": "array", "items": of(kind[:-2])}
        if kind == _STAMP:
            parts = {part: {"type": "integer", "minimum": 0} for part in ("sec", "nsec")}
            return {"type": "object", "title": "time", "properties": parts}
        if kind in _FIELDS:
            return {"type": "object", "properties": {field: of(inner) for field, inner in _FIELDS[kind]}}
        return {"type": {"double": "number", "string": "string"}[kind]}

    return json.dumps({"title": name, **of(name)})


def _descriptor_set() -> descriptor_pb2.FileDescriptorSet:
    """All message types and what they import, as an MCAP schema holds them."""
    file = descriptor_pb2.FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3")
    file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
    field_type = descriptor_pb2.FieldDescriptorProto
    for name, fields in _FIELDS.items():
        message = file.message_type.add(name=name.partition(".")[2])
        for number, (field_name, kind) in enumerate(fields, 1):
            field = message.field.add(name=field_name, number=number, label=field_type.LABEL_OPTIONAL)
            if kind.endswith("[]"):
                field.label, kind = field_type.LABEL_REPEATED, kind[:-2]
            if "." in kind:
                field.type, field.type_name = field_type.TYPE_MESSAGE, f".{kind}"
            else:
                field.type = field_type.TYPE_DOUBLE if kind == "double" else field_type.TYPE_STRING
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    return descriptor_pb2.FileDescriptorSet(file=[stamp, file])


DESCRIPTORS = _descriptor_set()


def _classes() -> dict[str, Any]:
    pool = DescriptorPool()
    for file in DESCRIPTORS.file:
        pool.Add(file)
    return {name: GetMessageClass(pool.FindMessageTypeByName(name)) for name in _FIELDS}


_CLASSES = _classes()


_WORDS = {"inf": "Infinity", "-inf": "-Infinity", "nan": "NaN"}


def _json_bytes(_: str, message: dict[str, Any]) -> bytes:
    """JSON has no infinity and no NaN: they are words, as in the JSON mapping of protobuf."""
    for name in ("ranges", "intensities"):
        if name in message:
            message[name] = [value if isfinite(value) else _WORDS[repr(value)] for value in message[name]]
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()


def _protobuf_bytes(name: str, message: dict[str, Any]) -> bytes:
    stamp = message.pop("timestamp")
    filled = _CLASSES[name](**message)
    filled.timestamp.seconds, filled.timestamp.nanos = stamp["sec"], stamp["nsec"]
    data: bytes = filled.SerializeToString(deterministic=True)
    return data


def _stamp(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}


def _vector(x: float, y: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": 0.0}


def _turn(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": sin(yaw / 2), "w": cos(yaw / 2)}


def _encoding(name: str, pack: Callable[[str, dict[str, Any]], bytes]) -> Encoding:
    """The encoding that packs messages, given as plain dictionaries, in one way."""

    def scans(raw: RawSweeps) -> list[bytes]:
        last = raw.angle_min + (raw.beams - 1) * raw.angle_increment
        return [
            pack(
                SCAN,
                {
                    "timestamp": _stamp(int(raw.stamp_ns[row])),
                    "frame_id": raw.frame_ids[raw.frame[row]],
                    "pose": {"position": _vector(0.0, 0.0), "orientation": _turn(0.0)},
                    "start_angle": float(raw.angle_min[row]),
                    "end_angle": float(last[row]),
                    "ranges": raw.ranges[row, : raw.beams[row]].tolist(),
                    "intensities": []
                    if raw.intensities is None
                    else raw.intensities[row, : raw.beams[row]].tolist(),
                },
            )
            for row in range(len(raw))
        ]

    def odometry(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        pose = {"position": _vector(x, y), "orientation": _turn(yaw)}
        stamp = _stamp(int(rows.stamp_ns[row]))
        return pack(POSE, {"timestamp": stamp, "frame_id": rows.odometry.frame_id, "pose": pose})

    def frame_transform(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        return pack(
            TRANSFORM,
            {
                "timestamp": _stamp(stamp_ns),
                "parent_frame_id": parent,
                "child_frame_id": child,
                "translation": _vector(pose[0], pose[1]),
                "rotation": _turn(pose[2]),
            },
        )

    def transform(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        frames = rows.odometry.frame_id, rows.odometry.child_frame_id
        return frame_transform(int(rows.stamp_ns[row]), *frames, (x, y, yaw))

    def mounting(rows: SimulatedPoses) -> bytes:
        frames = rows.odometry.child_frame_id, rows.laser_frame
        return frame_transform(int(rows.stamp_ns[0]), *frames, rows.mount)

    return Encoding(name, SCAN, POSE, TRANSFORM, scans, odometry, transform, mounting)


JSON = _encoding("json", _json_bytes)
PROTOBUF = _encoding("protobuf", _protobuf_bytes)
