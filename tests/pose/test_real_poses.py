"""Poses of real robots against the topics they come from, read by rosbags; `LIDARCLI_REAL_LOGS` names the folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import lidarcli
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.sweeps.types import Float64
from tests.places import REAL_LOGS, needs_real_logs
from tests.pose.pose_messages import ROS2

pytestmark = [needs_real_logs, pytest.mark.slow]

GAZEBO = REAL_LOGS / "my_gazebo_tutorials"
CAR = REAL_LOGS / "datmo" / "parallel.bag"


def told(path: Path, topic: str) -> Iterator[Any]:
    """The messages of a topic."""
    with AnyReader([path], default_typestore=ROS2) as reader:
        connections = [one for one in reader.connections if one.topic == topic]
        for connection, _, data in reader.messages(connections):
            yield reader.deserialize(data, connection.msgtype)


def row(
    stamp: Any, position: Any, turn: Any, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[int, float, float, float]:
    """Stamp [ns], x, y of a point that is mounted there without a turn, yaw."""
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    first = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    second = (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))
    return (
        stamp.sec * 10**9 + stamp.nanosec,
        position.x + float(np.dot(first, mount)),
        position.y + float(np.dot(second, mount)),
        float(np.arctan2(second[0], first[0])),
    )


def between(rows: list[tuple[int, float, float, float]], stamp_ns: Any) -> Float64:
    """(S, 3) the poses at the stamps: linear in x, y and in the unwrapped yaw; held for two steps, then NaN."""
    found = {one[0]: one[1:] for one in rows}
    stamps = np.array(sorted(found), np.int64)
    values = np.array([found[stamp] for stamp in stamps.tolist()])
    values[:, 2] = np.unwrap(values[:, 2])
    at = (stamp_ns - stamps[0]) / 1e9
    grid = (stamps - stamps[0]) / 1e9
    hold = min(2 * grid[-1] / (len(rows) - 1), 0.1)
    at = np.where((at >= -hold) & (at <= grid[-1] + hold), np.clip(at, 0.0, grid[-1]), at)
    return np.column_stack([np.interp(at, grid, column, np.nan, np.nan) for column in values.T])


def posed(path: Path, pose: str | None = None) -> tuple[Any, Float64]:
    """Stamps of the sweeps, and their poses."""
    batches = list(lidarcli.read(path, pose=pose))
    poses = [batch.poses.at_stamp() for batch in batches if batch.poses is not None]
    rows = [np.column_stack([one.x, one.y, one.yaw]) for one in poses]
    return np.concatenate([batch.stamp_ns for batch in batches]), np.concatenate(rows)


def agree(found: Float64, expected: Float64, tolerance: float = 1e-6) -> None:
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    known = ~np.isnan(expected[:, 0])
    np.testing.assert_allclose(found[known, :2], expected[known, :2], atol=tolerance)
    turn = found[known, 2] - expected[known, 2]
    np.testing.assert_allclose(np.arctan2(np.sin(turn), np.cos(turn)), 0, atol=tolerance)


@pytest.mark.parametrize("day", ["20_53_49", "20_46_08"])
@pytest.mark.parametrize("topic", [None, "/odom"])
def test_gazebo(day: str, topic: str | None) -> None:
    (path,) = (GAZEBO / day).glob("*.db3")
    stamps, found = posed(path, topic)
    # The scanner stands on base_link, which stands on base_footprint, both without a turn.
    links = [link for message in told(path, "/tf_static") for link in message.transforms]
    steps = [link.transform.translation for link in links if link.child_frame_id in ("base_link", "base_scan")]
    mount = (sum(step.x for step in steps), sum(step.y for step in steps), sum(step.z for step in steps))
    if topic is None:
        moving = (link for message in told(path, "/tf") for link in message.transforms)
        rows = [
            row(link.header.stamp, link.transform.translation, link.transform.rotation, mount)
            for link in moving
            if link.child_frame_id == "base_footprint"
        ]
    else:
        poses = ((one.header.stamp, one.pose.pose) for one in told(path, topic))
        rows = [row(stamp, pose.position, pose.orientation, mount) for stamp, pose in poses]
    agree(found, between(rows, stamps), tolerance=1e-5)
    assert np.count_nonzero(~np.isnan(found[:, 0])) > 110


@pytest.mark.parametrize("topic", [None, "/ego_pose", "/red_pose"])
def test_motion_capture(topic: str | None) -> None:
    stamps, found = posed(CAR, topic)
    rows = [row(one.header.stamp, one.pose.position, one.pose.orientation) for one in told(CAR, topic or "/ego_pose")]
    there = between(rows, stamps)
    if topic is None:
        # The laser is behind the middle of the car, as its launch file says and the log does not.
        away = np.hypot(found[:, 0] - there[:, 0], found[:, 1] - there[:, 1])
        assert away == pytest.approx(np.full(len(away), 0.171), abs=2e-3)
        return
    agree(found, there, tolerance=1e-3)
    # The first sweep was taken 12 ms before the first of 120 poses a second.
    assert np.count_nonzero(np.isnan(found[:, 0])) == 0
    np.testing.assert_allclose(found[0], found[1], atol=1e-3)


def test_what_is_said_of_motion_capture(tmp_path: Path) -> None:
    summary = detect_to_files(Source(str(CAR), "car"), tmp_path, DetectOptions())
    assert summary.notes == [
        "poses from /ego_pose (map > laser): 77% of the hits agree over the run; the sensor laser is taken to be at the "
        "pose itself; also available: /red_pose (--pose TOPIC)",
        "poses from /ego_pose drift: 80% of the hits agree, 74% where seen again; no path fits better",
        "poses from /ego_pose fit if corrected: sensor moved by -0.17, 0.02 m",
    ]


def test_a_chain_of_moving_links(tmp_path: Path) -> None:
    log = REAL_LOGS / "robots_ii" / "mylaserdata_20151128.bag"
    summary = detect_to_files(Source(str(log), "stage"), tmp_path, DetectOptions())
    assert summary.notes == [
        "poses from /tf (robot_0/odom > robot_0/base_footprint > robot_0/base_link > robot_0/base_laser_link): "
        "58% of the hits agree over the run",
        "poses from /tf drift: 61% of the hits agree, 56% where seen again; no path fits better",
    ]
