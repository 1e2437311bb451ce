"""Poses that a text log tells, as messages: plane, in radians, with the names of their frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lidarcli.logs.base import Message
from lidarcli.sweeps import Float64, Int64

ENCODING = "planar"
RECORD = np.dtype([("stamp_ns", "<i8"), ("x", "<f8"), ("y", "<f8"), ("yaw", "<f8")])
"""How the data of a message begins; behind it stand the frame in which, a NUL, and the frame that is told of."""

ROBOT = "base_link"
"""The frame of the robot, in which lasers are mounted."""
ODOMETRY_TYPE, POSE_TYPE, MOUNT_TYPE = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "tf2_msgs/msg/TFMessage",
)
ODOMETRY, MOUNTS = "/odom", "/tf_static"
"""Topics of all text logs: where the robot was by its wheels, and where its lasers are mounted."""


def pose_messages(
    topic: str, kind: str, stamps: Int64, parent: str, child: str, poses: Float64
) -> Sequence[Message]:
    """Messages of the type `kind` with poses (K, 3) x, y [m], yaw [rad] of `child` in `parent`."""
    records = np.empty(len(stamps), RECORD)
    records["stamp_ns"] = stamps
    records["x"], records["y"], records["yaw"] = poses.T
    data, size = records.tobytes(), RECORD.itemsize
    names = f"{parent}\0{child}".encode()
    return [
        Message(topic, kind, ENCODING, stamp, data[at * size : (at + 1) * size] + names)
        for at, stamp in enumerate(stamps.tolist())
    ]


def in_order(told: Sequence[tuple[int, Message]]) -> Iterator[Message]:
    """Messages by the lines that tell them."""
    for _, message in sorted(told, key=lambda one: one[0]):
        yield message
