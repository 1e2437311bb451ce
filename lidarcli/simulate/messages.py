"""Message bytes of ROS 1 and ROS 2: sweeps in bulk, poses through the type store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np

from lidarcli.ros.messages import ODOMETRY, ROS1, ROS2, SCAN, TF, cdr_scans, ros1_scans
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import RawSweeps


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
