"""Messages of the foxglove schemas, as JSON and as protobuf."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import cos, sin
from typing import Any

from lidarcli.foxglove import POSE, SCAN, TRANSFORM, classes
from lidarcli.simulate.decimals import number_or_word
from lidarcli.simulate.messages import Encoding
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import RawSweeps


def json_bytes(_: str, message: dict[str, Any]) -> bytes:
    """A message as JSON, in which numbers that are not finite are words."""
    for name in ("ranges", "intensities"):
        if name in message:
            message[name] = [number_or_word(value) for value in message[name]]
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()


def protobuf_bytes(name: str, message: dict[str, Any]) -> bytes:
    """A message of the published schemas."""
    stamp = message.pop("timestamp")
    filled = classes()[name](**message)
    filled.timestamp.seconds, filled.timestamp.nanos = stamp["sec"], stamp["nsec"]
    data: bytes = filled.SerializeToString(deterministic=True)
    return data


def stamp_of(stamp_ns: int) -> dict[str, int]:
    """A time as messages tell it."""
    return {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}


def _vector(x: float, y: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": 0.0}


def _turn(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": sin(yaw / 2), "w": cos(yaw / 2)}


def standing() -> dict[str, dict[str, float]]:
    """The pose that changes nothing."""
    return {"position": _vector(0.0, 0.0), "orientation": _turn(0.0)}


def _encoding(name: str, pack: Callable[[str, dict[str, Any]], bytes]) -> Encoding:
    """The encoding that packs messages, given as plain dictionaries, in one way."""

    def scans(raw: RawSweeps) -> list[bytes]:
        last = raw.angle_min + (raw.beams - 1) * raw.angle_increment
        return [
            pack(
                SCAN,
                {
                    "timestamp": stamp_of(int(raw.stamp_ns[row])),
                    "frame_id": raw.frame_ids[raw.frame[row]],
                    "pose": standing(),
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
        stamp = stamp_of(int(rows.stamp_ns[row]))
        return pack(POSE, {"timestamp": stamp, "frame_id": rows.odometry.frame_id, "pose": pose})

    def frame_transform(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        return pack(
            TRANSFORM,
            {
                "timestamp": stamp_of(stamp_ns),
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


JSON = _encoding("json", json_bytes)
PROTOBUF = _encoding("protobuf", protobuf_bytes)
