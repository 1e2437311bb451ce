"""Message bytes of ROS 1 and ROS 2: LaserScan built in bulk, poses through the type store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np

from lidarcli.simulate.definitions import ODOMETRY, ROS1, ROS2, SCAN, TF
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import RawSweeps

_GEOMETRY = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)


@dataclass(frozen=True, slots=True)
class Encoding:
    """How sweeps and poses become bytes in a log."""

    name: str
    """`cdr`, `ros1`, `json` or `protobuf`."""
    scan_type: str
    odometry_type: str
    tf_type: str
    scans: Callable[[RawSweeps], list[bytes]]
    odometry: Callable[[SimulatedPoses, int], bytes]
    transform: Callable[[SimulatedPoses, int], bytes]
    """Pose of the robot in the odometry frame."""
    mounting: Callable[[SimulatedPoses], bytes]
    """Pose of the laser on the robot."""


def cdr_scans(raw: RawSweeps) -> list[bytes]:
    """LaserScan messages as ROS 2 serialises them (little endian), one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        text = len(frame) + 1
        # Strings end with a zero; what follows is aligned to four bytes.
        return [
            ("magic", "<u4"),
            ("seconds", "<i4"),
            ("nanoseconds", "<u4"),
            ("text", "<u4"),
            ("frame", f"S{text + -text % 4}"),
        ]

    return _bulk(raw, layout, lambda message, frame: _set(message, magic=0x00000100, text=len(frame) + 1))


def ros1_scans(raw: RawSweeps) -> list[bytes]:
    """LaserScan messages as ROS 1 serialises them, one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        named = [("seq", "<u4"), ("seconds", "<u4"), ("nanoseconds", "<u4"), ("text", "<u4")]
        return [*named, ("frame", f"S{len(frame)}")] if frame else named

    return _bulk(raw, layout, lambda message, frame: _set(message, text=len(frame)))


def _set(message: np.ndarray[Any, Any], **values: object) -> None:
    for name, value in values.items():
        message[name] = value


def _bulk(
    raw: RawSweeps,
    layout: Callable[[bytes], list[tuple[str, str]]],
    finish: Callable[[np.ndarray[Any, Any], bytes], None],
) -> list[bytes]:
    """Build all messages of one frame and beam count at once, and return them in the order of the sweeps."""
    out: list[bytes] = [b""] * len(raw)
    groups, member = np.unique(np.column_stack([raw.frame, raw.beams]), axis=0, return_inverse=True)
    for number, (frame_number, beams) in enumerate(groups):
        rows = np.flatnonzero(member.reshape(-1) == number)
        frame = raw.frame_ids[frame_number].encode()
        fields: list[Any] = [*layout(frame), *((name, "<f4") for name in _GEOMETRY), ("count", "<u4")]
        fields += [("ranges", "<f4", (int(beams),)), ("intensities", "<u4")]
        message = np.zeros(len(rows), np.dtype(fields))
        seconds, nanoseconds = np.divmod(raw.stamp_ns[rows], 1_000_000_000)
        finish(message, frame)
        angle_max = raw.angle_min[rows] + (beams - 1) * raw.angle_increment[rows]
        _set(message, seconds=seconds, nanoseconds=nanoseconds, count=beams, angle_max=angle_max)
        _set(message, angle_min=raw.angle_min[rows], angle_increment=raw.angle_increment[rows])
        _set(message, range_min=raw.range_min[rows], range_max=raw.range_max[rows])
        for name in ("time_increment", "scan_time"):
            told = getattr(raw, name)
            if told is not None:
                message[name] = told[rows]
        message["ranges"] = raw.ranges[rows, :beams]
        if frame:
            message["frame"] = frame
        data, size = message.tobytes(), message.itemsize
        for place, row in enumerate(rows.tolist()):
            out[row] = data[place * size : (place + 1) * size]
    return out


def _ros(name: str, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> Encoding:
    """The encoding of one generation of ROS."""
    types = store.types

    def header(stamp_ns: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        return types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, frame)

    def vector(x: float, y: float, z: float) -> Any:
        return types["geometry_msgs/msg/Vector3"](x, y, z)

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

    def stamped(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        transform = types["geometry_msgs/msg/Transform"](vector(pose[0], pose[1], 0.0), turn(pose[2]))
        entry = types["geometry_msgs/msg/TransformStamped"](header(stamp_ns, parent), child, transform)
        return bytes(serialize(types[TF]([entry]), TF))

    def transform(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        frames = rows.odometry.frame_id, rows.odometry.child_frame_id
        return stamped(int(rows.stamp_ns[row]), *frames, (x, y, yaw))

    def mounting(rows: SimulatedPoses) -> bytes:
        return stamped(int(rows.stamp_ns[0]), rows.odometry.child_frame_id, rows.laser_frame, rows.mount)

    scans = ros1_scans if ros1 else cdr_scans
    return Encoding(name, SCAN, ODOMETRY, TF, scans, odometry, transform, mounting)


CDR = _ros("cdr", ROS2, ROS2.serialize_cdr, ros1=False)
ROS1_BYTES = _ros("ros1", ROS1, ROS1.serialize_ros1, ros1=True)
