"""Velocities and polygons of a topic, from messages that rosbags makes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lidarcli.logs.base import ReadReport
from lidarcli.pose.messages import FEW_CORNERS, NOT_FINITE, POLYGON, TWIST, TWIST_STAMPED, polygons, velocities
from lidarcli.ros.cursor import ENCAPSULATION, SHORT
from tests.fake_log import FakeLog
from tests.pose.pose_messages import SECOND, Maker, message

BOX = [(0.5, 0.25), (0.5, -0.25), (-0.5, -0.25), (-0.5, 0.25)]


def made(maker: Maker, name: str, *values: Any) -> Any:
    return maker.store.types[name](*values)


def twist(maker: Maker, ahead: float, left: float, turning: float, stamp_ns: int | None = None) -> bytes:
    """A Twist, or with a stamp a TwistStamped."""
    vector = "geometry_msgs/msg/Vector3"
    told = made(maker, TWIST, made(maker, vector, ahead, left, 9.0), made(maker, vector, 8.0, 7.0, turning))
    if stamp_ns is None:
        return maker.bytes_of(told, TWIST)
    return maker.bytes_of(made(maker, TWIST_STAMPED, maker.header(stamp_ns, "base"), told), TWIST_STAMPED)


def polygon(maker: Maker, stamp_ns: int, frame: str, corners: list[tuple[float, float]]) -> bytes:
    points = [made(maker, "geometry_msgs/msg/Point32", x, y, 5.0) for x, y in corners]
    told = made(maker, "geometry_msgs/msg/Polygon", points)
    return maker.bytes_of(made(maker, POLYGON, maker.header(stamp_ns, frame), told), POLYGON)


@pytest.fixture(params=["cdr", "ros1", "big endian"])
def maker(request: pytest.FixtureRequest) -> Maker:
    return Maker("ros1" if request.param == "ros1" else "cdr", big_endian=request.param == "big endian")


def read(log: FakeLog, topic: str = "/cmd_vel") -> tuple[list[int], list[list[float]], dict[Any, int]]:
    report = ReadReport()
    told = velocities(log, topic, report)
    assert told is not None
    return told[0].tolist(), told[1].tolist(), dict(report.refused)


def test_a_twist_has_the_time_of_its_recording(maker: Maker) -> None:
    log = FakeLog(
        messages=[
            message("/cmd_vel", TWIST, twist(maker, 0.5, 0.1, -0.25), 3 * SECOND, maker.encoding),
            message("/other", TWIST, twist(maker, 4.0, 4.0, 4.0), 2 * SECOND, maker.encoding),
            message("/cmd_vel", TWIST, twist(maker, 1.5, 0.0, 0.75), 1 * SECOND, maker.encoding),
        ]
    )
    expected = [1 * SECOND, 3 * SECOND], [[1.5, 0.0, 0.75], [0.5, 0.1, -0.25]], {}
    assert read(log) == expected
    assert read(log, "cmd_vel") == expected, "a leading slash does not matter"


def test_a_stamped_twist_has_its_own_time_where_it_is_told(maker: Maker) -> None:
    log = FakeLog(
        messages=[
            message("/cmd_vel", TWIST_STAMPED, twist(maker, 0.5, 0.1, -0.25, stamp), 9 * SECOND, maker.encoding)
            for stamp in (0, 2 * SECOND + 7)
        ]
    )
    assert read(log) == ([2 * SECOND + 7, 9 * SECOND], [[0.5, 0.1, -0.25]] * 2, {})


def test_bad_messages_are_counted_by_cause(maker: Maker) -> None:
    sound = twist(maker, 1.0, 0.0, 0.0)
    bad = [sound[:-1], twist(maker, np.nan, 0.0, 0.0), twist(maker, 0.0, 0.0, np.inf)]
    log = FakeLog(
        messages=[
            *(message("/cmd_vel", TWIST, data, 1, maker.encoding) for data in (sound, *bad)),
            message("/cmd_vel", TWIST, b"\x09\x09\x00\x00", 1, "cdr"),
            message("/cmd_vel", TWIST, b"{}", 1, "json"),
        ]
    )
    stamps, _, refused = read(log)
    assert len(stamps) == 1
    assert refused == {
        ("/cmd_vel", SHORT): 1,
        ("/cmd_vel", NOT_FINITE): 2,
        ("/cmd_vel", ENCAPSULATION): 1,
        ("/cmd_vel", "json cannot be read"): 1,
    }
    only_bad = FakeLog(messages=[message("/cmd_vel", TWIST, b"", 1, "ros1")])
    assert read(only_bad) == ([], [], {("/cmd_vel", SHORT): 1})


def test_polygons_keep_their_frame_and_time(maker: Maker) -> None:
    log = FakeLog(
        messages=[
            message("/footprint", POLYGON, data, 5 * SECOND, maker.encoding)
            for data in (
                polygon(maker, 0, "odom", BOX),
                polygon(maker, 2 * SECOND, "/base_link", BOX[:3]),
                polygon(maker, 3 * SECOND, "odom", BOX[:2]),
                polygon(maker, 3 * SECOND, "odom", [*BOX, (np.nan, 0.0)]),
                polygon(maker, 3 * SECOND, "odom", BOX)[:-4],
            )
        ]
    )
    report = ReadReport()
    told = polygons(log, "/footprint", report)
    assert told is not None
    assert [(stamp, frame, corners.tolist()) for stamp, frame, corners in told] == [
        (2 * SECOND, "base_link", [list(corner) for corner in BOX[:3]]),
        (5 * SECOND, "odom", [list(corner) for corner in BOX]),
    ]
    assert dict(report.refused) == {("/footprint", FEW_CORNERS): 1, ("/footprint", NOT_FINITE): 1, ("/footprint", SHORT): 1}
