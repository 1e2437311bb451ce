"""Messages of simulated sweeps and poses as bytes: LaserScan or point clouds, in ROS 1, ROS 2 and the foxglove schemas."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, sin
from typing import Any

import numpy as np

from lidarcli import foxglove
from lidarcli.ros.messages import ODOMETRY, ROS1, ROS2, SCAN, TF, cdr_scans, ros1_scans
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.sweeps import RawSweeps


@dataclass(frozen=True, slots=True)
class Encoding:
    """An encoding of sweeps and poses as bytes."""

    name: str
    """`cdr`, `ros1`, `json` or `protobuf`."""
    scan_type: str
    odometry_type: str
    tf_type: str
    scans: Callable[[RawSweeps], list[bytes]]
    odometry: Callable[[SimulatedPoses, int], bytes]
    link: Callable[[int, str, str, tuple[float, float, float]], bytes]
    """Encodes a transform, by its stamp [ns], the parent and child frames, and x, y, yaw."""

    def transform(self, rows: SimulatedPoses, row: int) -> bytes:
        """Encode a pose of the robot in the odometry frame."""
        x, y, yaw = rows.poses[row].tolist()
        frames = rows.odometry.frame_id, rows.odometry.child_frame_id
        return self.link(int(rows.stamp_ns[row]), *frames, (x, y, yaw))

    def mounting(self, rows: SimulatedPoses) -> bytes:
        """Encode the pose of the laser on the robot."""
        return self.link(int(rows.stamp_ns[0]), rows.odometry.child_frame_id, rows.laser_frame, rows.mount)


def _ros(name: str, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> Encoding:
    """Return the encoding of one generation of ROS."""
    types = store.types

    def header(stamp_ns: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        return types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, frame)

    vector = types["geometry_msgs/msg/Vector3"]

    def turn(yaw: float) -> Any:
        return types["geometry_msgs/msg/Quaternion"](0.0, 0.0, sin(yaw / 2), cos(yaw / 2))

    def odometry(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x, y, 0.0), turn(yaw))
        twist = types["geometry_msgs/msg/Twist"](
            vector(float(rows.speed[row]), 0.0, 0.0), vector(0.0, 0.0, float(rows.yaw_rate[row]))
        )
        message = types[ODOMETRY](
            header(int(rows.stamp_ns[row]), rows.odometry.frame_id),
            rows.odometry.child_frame_id,
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )
        return bytes(serialize(message, ODOMETRY))

    def link(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        transform = types["geometry_msgs/msg/Transform"](vector(pose[0], pose[1], 0.0), turn(pose[2]))
        entry = types["geometry_msgs/msg/TransformStamped"](header(stamp_ns, parent), child, transform)
        return bytes(serialize(types[TF]([entry]), TF))

    return Encoding(name, SCAN, ODOMETRY, TF, ros1_scans if ros1 else cdr_scans, odometry, link)


CDR = _ros("cdr", ROS2, ROS2.serialize_cdr, ros1=False)
ROS1_BYTES = _ros("ros1", ROS1, ROS1.serialize_ros1, ros1=True)


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


POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
FLOOR, CEILING = -0.5, 2.0
"""Heights of what lies below and above the sensor [m]."""
NEAR = 0.6
"""Floor and ceiling are seen at so much of the range of what is behind them."""

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")])
_FLOAT32, _UINT16 = 7, 4
"""Types of numbers in PointField."""


def as_clouds(encoding: Encoding) -> Encoding:
    """Return the encoding that writes a point cloud for each sweep."""
    if encoding in (CDR, ROS1_BYTES):
        is_ros1 = encoding is ROS1_BYTES
        serialize = ROS1.serialize_ros1 if is_ros1 else ROS2.serialize_cdr
        return replace(
            encoding,
            scan_type=POINTCLOUD2,
            scans=lambda raw: _ros_clouds(raw, ROS1 if is_ros1 else ROS2, serialize, is_ros1),
        )
    return replace(encoding, scan_type=foxglove.CLOUD, scans=lambda raw: _foxglove_clouds(raw, encoding))


def _points(raw: RawSweeps, row: int) -> np.ndarray[tuple[int, int], np.dtype[Any]]:
    """Return (3, B) points of one sweep: on the floor, at the height of the sensor, at the ceiling; NaN without a range."""
    beams = int(raw.beams[row])
    bearing = raw.angle_min[row] + raw.angle_increment[row] * np.arange(beams)
    ranges = raw.ranges[row, :beams].astype(np.float64)
    ranges[~np.isfinite(ranges) | (ranges <= 0)] = np.nan
    points = np.zeros((3, beams), _POINT)
    for ring, (share, height) in enumerate(((NEAR, FLOOR), (1.0, 0.0), (NEAR, CEILING))):
        points["x"][ring] = share * ranges * np.cos(bearing)
        points["y"][ring] = share * ranges * np.sin(bearing)
        points["z"][ring] = np.where(np.isnan(ranges), np.nan, height)
        points["ring"][ring] = ring
        if raw.intensities is not None:
            points["intensity"][ring] = raw.intensities[row, :beams]
    return points


def _fields(floats: int, integers: int) -> list[tuple[str, int, int]]:
    """Return name, offset and type of the fields of a point."""
    kinds = (("x", floats), ("y", floats), ("z", floats), ("intensity", floats), ("ring", integers))
    offsets = {name: int(place[1]) for name, place in (_POINT.fields or {}).items()}
    return [(name, offsets[name], kind) for name, kind in kinds]


def _ros_clouds(raw: RawSweeps, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> list[bytes]:
    types = store.types
    fields = [types["sensor_msgs/msg/PointField"](*each, 1) for each in _fields(_FLOAT32, _UINT16)]
    messages = []
    for row in range(len(raw)):
        points = _points(raw, row)
        stamp = types["builtin_interfaces/msg/Time"](*divmod(int(raw.stamp_ns[row]), 10**9))
        header = types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, raw.frame_ids[raw.frame[row]])
        height, width = points.shape
        step = points.itemsize
        message = types[POINTCLOUD2](
            header, height, width, fields, False, step, step * width, points.reshape(-1).view(np.uint8), False
        )
        messages.append(bytes(serialize(message, POINTCLOUD2)))
    return messages


def _foxglove_clouds(raw: RawSweeps, encoding: Encoding) -> list[bytes]:
    pack = json_bytes if encoding is JSON else protobuf_bytes
    kinds = foxglove.NUMBER_KINDS
    fields = [
        {"name": name, "offset": offset, "type": kind}
        for name, offset, kind in _fields(kinds.index("f4"), kinds.index("u2"))
    ]
    clouds = []
    for row in range(len(raw)):
        points = _points(raw, row).tobytes()
        message = {
            "timestamp": stamp_of(int(raw.stamp_ns[row])),
            "frame_id": raw.frame_ids[raw.frame[row]],
            "pose": standing(),
            "point_stride": _POINT.itemsize,
            "fields": fields,
            "data": base64.b64encode(points).decode() if encoding is JSON else points,
        }
        clouds.append(pack(foxglove.CLOUD, message))
    return clouds


RULE = "=" * 80

LASERSCAN_IDL = f"""\
{RULE}
IDL: sensor_msgs/msg/LaserScan
module sensor_msgs {{
  module msg {{
    struct LaserScan {{
      std_msgs::msg::Header header;
      float angle_min;
      float angle_max;
      float angle_increment;
      float time_increment;
      float scan_time;
      float range_min;
      float range_max;
      sequence<float> ranges;
      sequence<float> intensities;
    }};
  }};
}};

{RULE}
IDL: std_msgs/msg/Header
module std_msgs {{
  module msg {{
    struct Header {{
      builtin_interfaces::msg::Time stamp;
      string frame_id;
    }};
  }};
}};

{RULE}
IDL: builtin_interfaces/msg/Time
module builtin_interfaces {{
  module msg {{
    struct Time {{
      int32 sec;
      uint32 nanosec;
    }};
  }};
}};
"""
