"""Sweeps in the schemas of foxglove, as JSON and as protobuf, which the package only reads."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import cos, sin
from pathlib import Path
from typing import Any

from mcap.well_known import MessageEncoding, SchemaEncoding

from lidarcli.ros import foxglove
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.simulation.writers import Encoding, McapEncoding, cloud_fields, cloud_points, write_mcap
from lidarcli.sweeps.types import RawSweeps

_JSON_TYPES: dict[str, dict[str, Any]] = {
    "double": {"type": "number"},
    "string": {"type": "string"},
    "fixed32": {"type": "integer", "minimum": 0},
    "bytes": {"type": "string", "contentEncoding": "base64"},
    foxglove.STAMP: {
        "type": "object",
        "title": "time",
        "properties": {part: {"type": "integer", "minimum": 0} for part in ("sec", "nsec")},
    },
    foxglove.NUMBER: {"type": "integer", "minimum": 0, "maximum": len(foxglove.NUMBER_KINDS) - 1},
}


def json_schema(name: str) -> str:
    """The JSON schema of a message type."""

    def of(kind: str) -> dict[str, Any]:
        if kind.endswith("[]"):
            return {"type": "array", "items": of(kind[:-2])}
        if kind in foxglove.FIELDS:
            return {"type": "object", "properties": {field: of(inner) for field, inner in foxglove.FIELDS[kind]}}
        return _JSON_TYPES[kind]

    return json.dumps({"title": name, **of(name)})


def number_or_word(value: float) -> float | str:
    """Return a float as JSON has it: a word, as in the JSON mapping of protobuf, for what is no number there."""
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def json_bytes(_: str, message: dict[str, Any]) -> bytes:
    """Encode a message as JSON; numbers that are not finite become words."""
    for name in ("ranges", "intensities"):
        if name in message:
            message[name] = [number_or_word(value) for value in message[name]]
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()


def protobuf_bytes(name: str, message: dict[str, Any]) -> bytes:
    """Encode a message of the published schemas as protobuf."""
    stamp = message.pop("timestamp")
    filled = foxglove.classes()[name](**message)
    filled.timestamp.seconds, filled.timestamp.nanos = stamp["sec"], stamp["nsec"]
    data: bytes = filled.SerializeToString(deterministic=True)
    return data


def stamp_of(stamp_ns: int) -> dict[str, int]:
    """Return a time as a foxglove timestamp."""
    return {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}


def _vector(x: float, y: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": 0.0}


def _quaternion(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": sin(yaw / 2), "w": cos(yaw / 2)}


def standing() -> dict[str, dict[str, float]]:
    """Return the identity pose."""
    return {"position": _vector(0.0, 0.0), "orientation": _quaternion(0.0)}


def _foxglove(name: str, pack: Callable[[str, dict[str, Any]], bytes]) -> Encoding:
    """Return the encoding that packs messages, given as plain dictionaries, in one way."""

    def scans(raw: RawSweeps) -> list[bytes]:
        last = raw.angle_min + (raw.beams - 1) * raw.angle_increment
        return [pack(foxglove.SCAN, sweep(raw, row, float(last[row]))) for row in range(len(raw))]

    def sweep(raw: RawSweeps, row: int, last: float) -> dict[str, Any]:
        beams = raw.beams[row]
        return {
            "timestamp": stamp_of(int(raw.stamp_ns[row])),
            "frame_id": raw.frame_ids[raw.frame[row]],
            "pose": standing(),
            "start_angle": float(raw.angle_min[row]),
            "end_angle": last,
            "ranges": raw.ranges[row, :beams].tolist(),
            "intensities": [] if raw.intensities is None else raw.intensities[row, :beams].tolist(),
        }

    def odometry(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        pose = {"position": _vector(x, y), "orientation": _quaternion(yaw)}
        stamp = stamp_of(int(rows.stamp_ns[row]))
        return pack(foxglove.POSE, {"timestamp": stamp, "frame_id": rows.odometry.frame_id, "pose": pose})

    def link(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        frames = {"parent_frame_id": parent, "child_frame_id": child}
        motion = {"translation": _vector(pose[0], pose[1]), "rotation": _quaternion(pose[2])}
        return pack(foxglove.TRANSFORM, {"timestamp": stamp_of(stamp_ns), **frames, **motion})

    return Encoding(name, foxglove.SCAN, foxglove.POSE, foxglove.TRANSFORM, scans, odometry, link)


JSON = _foxglove("json", json_bytes)
PROTOBUF = _foxglove("protobuf", protobuf_bytes)


def _json_schema(name: str) -> tuple[str, str, bytes]:
    return name, SchemaEncoding.JSONSchema, json_schema(name).encode()


def _protobuf_schema(name: str) -> tuple[str, str, bytes]:
    return name, SchemaEncoding.Protobuf, foxglove.descriptors().SerializeToString(deterministic=True)


def _foxglove_clouds(raw: RawSweeps, encoding: Encoding) -> list[bytes]:
    pack = json_bytes if encoding is JSON else protobuf_bytes
    kinds = foxglove.NUMBER_KINDS
    fields = [
        {"name": name, "offset": offset, "type": kind}
        for name, offset, kind in cloud_fields(kinds.index("f4"), kinds.index("u2"))
    ]
    clouds = []
    for row in range(len(raw)):
        points = cloud_points(raw, row).tobytes()
        message = {
            "timestamp": stamp_of(int(raw.stamp_ns[row])),
            "frame_id": raw.frame_ids[raw.frame[row]],
            "pose": standing(),
            "point_stride": cloud_points(raw, row).itemsize,
            "fields": fields,
            "data": base64.b64encode(points).decode() if encoding is JSON else points,
        }
        clouds.append(pack(foxglove.CLOUD, message))
    return clouds


ENCODINGS = {
    "json": McapEncoding(JSON, MessageEncoding.JSON, "", _json_schema),
    "protobuf": McapEncoding(PROTOBUF, MessageEncoding.Protobuf, "", _protobuf_schema),
}


def write_foxglove(path: Path, blocks: Iterable[RawSweeps], encoding: str, *, clouds: bool = False, **options: Any) -> None:
    """Write an MCAP of `json` or `protobuf`."""
    how = ENCODINGS[encoding]
    if clouds:
        inner = how.messages
        scans = lambda raw: _foxglove_clouds(raw, inner)  # noqa: E731
        how = how._replace(messages=replace(inner, scan_type=foxglove.CLOUD, scans=scans))
    write_mcap(path, blocks, encoding=how, **options)
