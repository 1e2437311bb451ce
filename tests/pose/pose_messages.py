"""Pose messages as ROS writes them, made by rosbags, and logs that hold them."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lidarcli.logs.base import Message

TF = "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
SECOND = 1_000_000_000

ROS2 = get_typestore(Stores.ROS2_HUMBLE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
for _store in (ROS1, ROS2):
    for _name in {TF, OLD_TF} - set(_store.types):
        _store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", _name))

Pose = tuple[float, ...]
"""x, y, yaw, or x, y, z and a quaternion x, y, z, w."""


def numbers(pose: Pose) -> list[float]:
    """x, y, z and the quaternion of a pose."""
    if len(pose) == 7:
        return list(pose)
    x, y, yaw = pose
    return [x, y, 0.0, 0.0, 0.0, sin(yaw / 2), cos(yaw / 2)]


def told_of_drive(topic: str, world: str) -> dict[str, Any]:
    """What metadata tell of the poses of the sample drive, which fit its sweeps as they are told."""
    measured = {"pose_agreement": 0.96, "pose_again": 0.95, "pose_drift": 0.0}
    facts = {name: pytest.approx(value, abs=0.02) for name, value in measured.items()}
    chain = "odom > base_link > laser" if world == "odom" else f"{world} > laser"
    facts |= {"pose_verdict": "told", "pose_chain": chain, "pose_fit": 1.0, "pose_delay": 0.0, "beam_order": "once"}
    return {"topic": topic, "world": world, **{name: {"/scan": value} for name, value in facts.items()}}


class Maker:
    """Builds messages in one serialisation."""

    def __init__(self, encoding: str, big_endian: bool = False) -> None:
        self.encoding = encoding
        self.store = ROS1 if encoding == "ros1" else ROS2
        self.big_endian = big_endian

    def _new(self, name: str, *values: Any) -> Any:
        return self.store.types[name](*values)

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._new("builtin_interfaces/msg/Time", stamp_ns // SECOND, stamp_ns % SECOND)
        return self._new("std_msgs/msg/Header", *([7] if self.encoding == "ros1" else []), stamp, frame)

    def _pose(self, pose: Pose) -> Any:
        values = numbers(pose)
        return self._new(
            "geometry_msgs/msg/Pose",
            self._new("geometry_msgs/msg/Point", *values[:3]),
            self._new("geometry_msgs/msg/Quaternion", *values[3:]),
        )

    def bytes_of(self, message: Any, name: str) -> bytes:
        if self.encoding == "ros1":
            return bytes(self.store.serialize_ros1(message, name))
        return bytes(self.store.serialize_cdr(message, name, little_endian=not self.big_endian))

    def transforms(self, *links: tuple[int, str, str, Pose], name: str = TF) -> bytes:
        """A TFMessage of links (stamp, parent, child, pose)."""
        entries = []
        for stamp_ns, parent, child, pose in links:
            values = numbers(pose)
            transform = self._new(
                "geometry_msgs/msg/Transform",
                self._new("geometry_msgs/msg/Vector3", *values[:3]),
                self._new("geometry_msgs/msg/Quaternion", *values[3:]),
            )
            entries.append(self._new("geometry_msgs/msg/TransformStamped", self.header(stamp_ns, parent), child, transform))
        return self.bytes_of(self._new(name, entries), name)

    def odometry(self, stamp_ns: int, parent: str, child: str, pose: Pose) -> bytes:
        """An Odometry."""
        vector = self._new("geometry_msgs/msg/Vector3", 0.5, 0.0, 0.0)
        twist = self._new("geometry_msgs/msg/Twist", vector, vector)
        message = self._new(
            ODOMETRY,
            self.header(stamp_ns, parent),
            child,
            self._new("geometry_msgs/msg/PoseWithCovariance", self._pose(pose), np.arange(36.0)),
            self._new("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
        )
        return self.bytes_of(message, ODOMETRY)

    def pose(self, stamp_ns: int, parent: str, pose: Pose, covariance: bool = False) -> bytes:
        """A PoseStamped, or a PoseWithCovarianceStamped."""
        name = WITH_COVARIANCE if covariance else POSE
        here = self._pose(pose)
        if covariance:
            here = self._new("geometry_msgs/msg/PoseWithCovariance", here, np.zeros(36))
        return self.bytes_of(self._new(name, self.header(stamp_ns, parent), here), name)


CDR = Maker("cdr")


def message(topic: str, kind: str, data: bytes, record_ns: int = 0, encoding: str = "cdr") -> Message:
    """A message as a log hands it out."""
    return Message(topic, kind, encoding, record_ns, data)


def tf(stamp_ns: int, parent: str, child: str, pose: Pose, topic: str = "/tf") -> Message:
    """A message of one link, recorded at its stamp."""
    return message(topic, TF, CDR.transforms((stamp_ns, parent, child, pose)), stamp_ns)


def odometry(stamp_ns: int, parent: str, child: str, pose: Pose, topic: str = "/odom") -> Message:
    """An Odometry, recorded at its stamp."""
    return message(topic, ODOMETRY, CDR.odometry(stamp_ns, parent, child, pose), stamp_ns)


def pose_stamped(stamp_ns: int, parent: str, pose: Pose, topic: str = "/pose", covariance: bool = False) -> Message:
    """A PoseStamped, or a PoseWithCovarianceStamped, recorded at its stamp."""
    kind = WITH_COVARIANCE if covariance else POSE
    return message(topic, kind, CDR.pose(stamp_ns, parent, pose, covariance), stamp_ns)
