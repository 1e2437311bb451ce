"""Marker messages built in bulk are those that a type store builds one by one, byte for byte."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lidarcli.overlays.markers import LAST_SECOND, MARKER_TYPE, Kind, Markers, marker_arrays, transforms
from lidarcli.ros.messages import ROS1, ROS2, TF

MESSAGES = 6
STAMPS = 1_700_000_000_000_000_007 + 100_000_000 * np.arange(MESSAGES)
FRAMES = ("", "l", "la", "lid", "base", "laser", "front_laser_link", "straße")


def some(kind: Kind, count: int, seed: int, length: int = 0) -> Markers:
    """Markers of one kind; message 3 has none."""
    rng = np.random.default_rng(seed)
    is_line, is_label = kind in (Kind.OUTLINE, Kind.PATH), kind is Kind.LABEL
    letters = rng.integers(65, 91, (count, length), np.uint8)
    return Markers(
        kind,
        np.sort(rng.choice([0, 1, 2, 4, 5], count)),
        rng.integers(-100, 100, count).astype(np.int32),
        rng.normal(size=(count, 3)),
        rng.uniform(-np.pi, np.pi, count),
        rng.uniform(0.1, 1, (count, 3)),
        rng.uniform(0.1, 1, (count, 4)).astype(np.float32),
        rng.normal(size=(count, length, 2)) if is_line else None,
        letters.view(f"S{length}").reshape(-1) if is_label else None,
    )


def all_kinds() -> list[Markers]:
    """Every kind, outlines and labels of several lengths, so that markers begin at every alignment."""
    return [
        *(some(Kind.OUTLINE, 7, points, points) for points in (2, 3, 5)),
        some(Kind.CUBE, 9, 20),
        some(Kind.CYLINDER, 6, 21),
        *(some(Kind.LABEL, 5, 30 + length, length) for length in (1, 6, 7, 8, 9)),
        some(Kind.ARROW, 4, 40),
        *(some(Kind.PATH, 5, 50 + points, points) for points in (2, 31)),
    ]


def built(frame: str, groups: list[Markers], cdr: bool) -> list[Any]:
    """The messages as objects; each is asserted to have the bytes that the type store makes of it."""
    messages = []
    for data in marker_arrays(STAMPS, frame, groups, cdr=cdr):
        message: Any = ROS2.deserialize_cdr(data, MARKER_TYPE) if cdr else ROS1.deserialize_ros1(data, MARKER_TYPE)
        again = ROS2.serialize_cdr(message, MARKER_TYPE) if cdr else ROS1.serialize_ros1(message, MARKER_TYPE)
        assert bytes(again) == data
        messages.append(message)
    return messages


@pytest.mark.parametrize("cdr", [True, False], ids=["ros2", "ros1"])
@pytest.mark.parametrize("frame", FRAMES)
def test_a_type_store_builds_the_same_bytes(frame: str, cdr: bool) -> None:
    groups = all_kinds()
    messages = built(frame, groups, cdr)
    assert len(messages) == MESSAGES
    for number, message in enumerate(messages):
        first, *others = message.markers
        assert (first.action, first.ns, first.header.frame_id) == (3, "", frame)
        expected = [(group, row) for group in groups for row in np.flatnonzero(group.message == number)]
        assert len(others) == len(expected)
        for marker, (group, row) in zip(others, expected, strict=True):
            assert (marker.type, marker.ns.encode()) == group.kind.value
            assert (marker.action, marker.id) == (0, group.id[row])
            stamp = marker.header.stamp
            assert stamp.sec * 1_000_000_000 + stamp.nanosec == STAMPS[number]
            position, turn, scale = marker.pose.position, marker.pose.orientation, marker.scale
            assert [position.x, position.y, position.z] == group.position[row].tolist()
            assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(group.yaw[row])
            assert [scale.x, scale.y, scale.z] == group.scale[row].tolist()
            colour = [marker.color.r, marker.color.g, marker.color.b, marker.color.a]
            assert colour == pytest.approx(group.colour[row].tolist())
            if group.points is not None:
                assert [(point.x, point.y) for point in marker.points] == [
                    tuple(point) for point in group.points[row].tolist()
                ]
                assert all(point.z == 0 for point in marker.points)
            assert marker.text == ("" if group.text is None else group.text[row].decode())


@pytest.mark.parametrize("cdr", [True, False], ids=["ros2", "ros1"])
def test_a_message_without_objects_only_deletes(cdr: bool) -> None:
    for message in built("laser", [], cdr):
        (only,) = message.markers
        assert (only.action, only.ns) == (3, "")
        turn = only.pose.orientation
        assert (turn.x, turn.y, turn.z, turn.w) == (0, 0, 0, 1)
        assert only.color.a == only.scale.x == 1


@pytest.mark.parametrize(
    ("stamp", "told"), [(-5, (0, 0)), (0, (0, 0)), (1 << 62, (LAST_SECOND, 0))], ids=["before", "0", "after"]
)
def test_a_stamp_that_ros_cannot_hold_becomes_the_nearest(stamp: int, told: tuple[int, int]) -> None:
    (data,) = marker_arrays(np.array([stamp]), "laser", [], cdr=True)
    message: Any = ROS2.deserialize_cdr(data, MARKER_TYPE)
    found = message.markers[0].header.stamp
    assert (found.sec, found.nanosec) == told


@pytest.mark.parametrize("cdr", [True, False], ids=["ros2", "ros1"])
@pytest.mark.parametrize(("world", "frame"), [("map", "laser"), ("odom", "a"), ("", "")])
def test_transforms_are_those_of_a_type_store(world: str, frame: str, cdr: bool) -> None:
    pose = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, -2.0]])
    hangs = np.array([False, True])
    found = transforms(STAMPS[:2], world, frame, pose, hangs, cdr=cdr)
    for number, data in enumerate(found):
        message: Any = ROS2.deserialize_cdr(data, TF) if cdr else ROS1.deserialize_ros1(data, TF)
        again = ROS2.serialize_cdr(message, TF) if cdr else ROS1.serialize_ros1(message, TF)
        assert bytes(again) == data
        (only,) = message.transforms
        assert (only.header.frame_id, only.child_frame_id) == (world, frame)
        moved, turn = only.transform.translation, only.transform.rotation
        assert (moved.x, moved.y, moved.z) == (*pose[number, :2], 0)
        x, y, z, w = turn.x, turn.y, turn.z, turn.w
        assert x * x + y * y + z * z + w * w == pytest.approx(1)
        # The x axis points along the yaw; the z axis up, or down where the sensor hangs.
        yaw = pose[number, 2]
        assert [1 - 2 * (y * y + z * z), 2 * (x * y + z * w)] == pytest.approx([np.cos(yaw), np.sin(yaw)])
        assert 1 - 2 * (x * x + y * y) == pytest.approx(-1 if hangs[number] else 1)
