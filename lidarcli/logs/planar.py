"""Poses of text logs as messages: in the plane, in radians, with the names of their frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.logs.base import Message
from lidarcli.sweeps import TURN, Float64, Int64

ENCODING = "planar"
RECORD = np.dtype([("stamp_ns", "<i8"), ("x", "<f8"), ("y", "<f8"), ("yaw", "<f8")])
"""Start of the data of a message; parent frame, NUL and child frame follow."""

ROBOT = "base_link"
"""Frame of the robot, in which lasers are mounted."""
ODOMETRY_TYPE, POSE_TYPE, MOUNT_TYPE = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage")
ODOMETRY, MOUNTS = "/odom", "/tf_static"
"""Topics of the robot's pose by its wheels, and of the mounts of its lasers."""


@dataclass(frozen=True, eq=False, slots=True)
class PlanarPoses:
    """K poses of one topic."""

    topic: str
    type: str
    parent: str
    """Frame in which the poses are."""
    child: str
    """Frame whose poses they are."""
    rows: Int64
    """(K,) Lines of the block that hold them."""
    stamp_ns: Int64
    """(K,) Times."""
    poses: Float64
    """(K, 3) x, y [m], yaw [rad]."""

    def messages(self) -> list[Message]:
        """Return a message for each pose."""
        records = np.empty(len(self.stamp_ns), RECORD)
        records["stamp_ns"] = self.stamp_ns
        records["x"], records["y"], records["yaw"] = self.poses.T
        data, size = records.tobytes(), RECORD.itemsize
        names = f"{self.parent}\0{self.child}".encode()
        return [
            Message(self.topic, self.type, ENCODING, stamp, data[at * size : (at + 1) * size] + names)
            for at, stamp in enumerate(self.stamp_ns.tolist())
        ]


def wrapped(angle: Float64) -> Float64:
    """Return angles [rad] between -π and π.

    >>> wrapped(np.array([6.0])).round(3).tolist()
    [-0.283]
    """
    within: Float64 = (angle + np.pi) % TURN - np.pi
    return within
