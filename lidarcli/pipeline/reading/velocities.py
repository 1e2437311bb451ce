"""Velocities and polygons that a log tells on a topic, for zones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from lidarcli.logs.base import Log, Message, ReadReport
from lidarcli.masks import same_name
from lidarcli.pose.messages import ODOMETRY, frame_name
from lidarcli.ros.cursor import BadMessageError, Cursor
from lidarcli.sweeps import Float64, Int64

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
POLYGON = "geometry_msgs/msg/PolygonStamped"
VELOCITY_TYPES = frozenset({TWIST, TWIST_STAMPED, ODOMETRY})

_POSE = (7 + 36) * 8
"""Bytes of a pose with its covariance."""
_TWIST = 6 * 8
"""Bytes of a twist: linear x, y, z and angular x, y, z."""
_CORNER = 3 * 4
"""Bytes of a corner: x, y, z."""
NOT_FINITE = "a number that is not finite"
FEW_CORNERS = "fewer than three corners"

Told = TypeVar("Told")


class ToldPolygon(NamedTuple):
    """A polygon that a message tells."""

    stamp_ns: int
    frame_id: str
    corners: Float64
    """(C, 2) [m]."""


def velocities(log: Log, topic: str, report: ReadReport) -> tuple[Int64, Float64] | None:
    """Read the velocities of a topic: Twist, TwistStamped, or the twist of an Odometry.

    Returns
    -------
    Their stamps (N,) [ns] in order, those of headers where they are not 0, else of the recording; and (N, 3) ahead, left
    [m/s], turning [rad/s]. None where the log has no message of this topic. Those that cannot be read are counted in
    `report.refused`.
    """
    told = _told(log, topic, VELOCITY_TYPES, report, _velocity)
    if told is None:
        return None
    stamps = np.array([stamp_ns for stamp_ns, _ in told], np.int64)
    found = np.array([velocity for _, velocity in told], np.float64).reshape(-1, 3)
    order = np.argsort(stamps, kind="stable")
    return stamps[order], found[order]


def polygons(log: Log, topic: str, report: ReadReport) -> list[ToldPolygon] | None:
    """Read the polygons (PolygonStamped) of a topic in order of their stamps; the rest as of `velocities`."""
    told = _told(log, topic, frozenset({POLYGON}), report, _polygon)
    return None if told is None else sorted(told, key=lambda each: each.stamp_ns)


def _told(
    log: Log, topic: str, types: frozenset[str], report: ReadReport, decode: Callable[[Message], Told]
) -> list[Told] | None:
    """Decode every message of a topic; None where there is none."""
    messages = _of_topic(log, topic, types, report)
    told: list[Told] | None = None
    for message in messages:
        told = [] if told is None else told
        try:
            told.append(decode(message))
        except BadMessageError as err:
            report.refused[message.topic, str(err)] += 1
    return told


def _of_topic(log: Log, topic: str, types: frozenset[str], report: ReadReport) -> Iterator[Message]:
    """Yield the messages of a topic, without a pass over a log that is known to have none."""
    listed = log.topics()
    if listed is not None:
        types = types & {each.type for each in listed if same_name(each.name, topic)}
    if types:
        for message in log.messages(types, report):
            if same_name(message.topic, topic):
                yield message


def _cursor(message: Message) -> Cursor:
    if message.encoding not in {"cdr", "ros1"}:
        raise BadMessageError(f"{message.encoding} cannot be read")
    return Cursor(message.data, message.encoding)


def _velocity(message: Message) -> tuple[int, tuple[float, float, float]]:
    cursor = _cursor(message)
    stamp_ns = 0
    if message.type != TWIST:
        stamp_ns = cursor.stamp_ns()
        cursor.text()
    if message.type == ODOMETRY:
        cursor.text()
        cursor.align(8)
        cursor.skip(_POSE)
    cursor.align(8)
    start = cursor.skip(_TWIST)
    numbers = np.frombuffer(message.data, f"{cursor.order}f8", 6, start)
    if not np.isfinite(numbers).all():
        raise BadMessageError(NOT_FINITE)
    return stamp_ns or message.record_ns, (float(numbers[0]), float(numbers[1]), float(numbers[5]))


def _polygon(message: Message) -> ToldPolygon:
    cursor = _cursor(message)
    stamp_ns = cursor.stamp_ns()
    frame = frame_name(cursor.text())
    count = cursor.word()
    start = cursor.skip(count * _CORNER)
    numbers = np.frombuffer(message.data, f"{cursor.order}f4", 3 * count, start).reshape(count, 3)
    corners = numbers[:, :2].astype(np.float64)
    if not np.isfinite(corners).all():
        raise BadMessageError(NOT_FINITE)
    if count < 3:
        raise BadMessageError(FEW_CORNERS)
    return ToldPolygon(stamp_ns or message.record_ns, frame, corners)
