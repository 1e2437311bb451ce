"""What is level for a sensor's points: by the tree of frames, for sensors that lean, hang head down or look ahead."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.logs.clouds import Levelled
from lidarcli.pose.frames import TreeLevels
from lidarcli.pose.tracks import PoseMotion, PoseTracks, multiply, planar, rotate
from lidarcli.sweeps.types import Float64
from tests.pose.pose_messages import SECOND, Pose, tf

LEFT, PITCH, ROLL = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
STAMP = np.array([5 * SECOND])
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""The turn of a camera's optical frame: z ahead, x to the right, y down."""


def turn(axis: tuple[float, ...], angle: float) -> tuple[float, ...]:
    """A quaternion about an axis [rad]."""
    return (*(np.sin(angle / 2) * np.array(axis)), np.cos(angle / 2))


def at(place: tuple[float, float, float], rotation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """A pose in space."""
    return (*place, *rotation)


def levels(*messages: Message) -> TreeLevels:
    """Of a log with these transforms."""
    tracks = PoseTracks()
    tracks.add(messages)
    return TreeLevels(tracks.finish())


def fixed(parent: str, child: str, pose: Pose) -> Message:
    """A mount."""
    return tf(0, parent, child, pose, "/tf_static")


def moving(parent: str, child: str, *poses: Pose) -> list[Message]:
    """Poses, a second apart."""
    return [tf(second * SECOND, parent, child, pose) for second, pose in enumerate(poses)]


def seen(levelled: Levelled | None, point: tuple[float, float, float], row: int = 0) -> list[float]:
    """Where a point of the sensor comes to: ahead, left, height."""
    assert levelled is not None
    found: list[float] = (levelled.rotation[row] @ point + levelled.offset[row]).tolist()
    return found


def test_heights_count_from_the_robot() -> None:
    found = levels(fixed("base_link", "lidar", at((0.3, 0.0, 0.8))))
    level = found.of("/lidar", STAMP)
    assert level is not None
    assert level.frame_id == "/lidar"
    assert seen(level, (2.0, 1.0, -0.5)) == pytest.approx([2.0, 1.0, 0.3])
    assert found.words("lidar") == "above base_link, level by /tf_static"


@pytest.mark.parametrize("pitch", [-0.4, 0.3])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("roll", [0.2, np.pi - 0.1])
def test_a_leaning_sensor_sees_the_world_as_its_pose_does(pitch: float, yaw: float, roll: float) -> None:
    rotations = [np.array([turn(LEFT, yaw)]), np.array([turn(PITCH, pitch)]), np.array([turn(ROLL, roll)])]
    mount: Float64 = multiply(multiply(rotations[0], rotations[1]), rotations[2])
    found = levels(fixed("base_link", "lidar", at((0.5, -0.2, 1.1), tuple(mount[0]))))
    point = np.array([[3.0, 1.0, -0.4]])
    on_robot = rotate(mount, point)[0] + [0.5, -0.2, 1.1]
    ahead, left, height = seen(found.of("lidar", STAMP), tuple(point[0]))
    pose = planar(PoseMotion(np.array([[0.5, -0.2, 1.1]]), mount))
    x, y, _ = pose.to_world(np.array([0]), np.array([ahead]), np.array([left]), np.zeros(1))
    assert [x[0], y[0], height] == pytest.approx(on_robot.tolist())


def test_a_robot_that_leans_in_the_world() -> None:
    up = (*turn(PITCH, -0.2),)
    found = levels(
        *moving("odom", "base_link", at((0, 0, 1.0)), at((4, 0, 1.0), up)), fixed("base_link", "lidar", at((0, 0, 0.5)))
    )
    level = found.of("lidar", np.array([0, SECOND, 60 * SECOND]))
    assert seen(level, (10.0, 0.0, 0.0), 0) == pytest.approx([10.0, 0.0, 0.5])
    # Ten metres up the slope, and half a metre along what is then above the robot.
    rise = 10 * np.sin(0.2) + 0.5 * np.cos(0.2)
    assert seen(level, (10.0, 0.0, 0.0), 1) == pytest.approx([10 * np.cos(0.2), 0.0, rise])
    # Outside of what is known of the world the robot itself is level.
    assert seen(level, (10.0, 0.0, 0.0), 2) == pytest.approx([10.0, 0.0, 0.5])


def test_a_camera_looks_ahead() -> None:
    found = levels(
        fixed("base_link", "camera_link", at((0.2, 0.0, 0.6))),
        fixed("camera_link", "camera_optical_frame", at((0.0, 0.05, 0.0), OPTICAL)),
    )
    level = found.of("camera_optical_frame", STAMP)
    assert level is not None
    assert level.frame_id == "camera_link"
    # Three metres ahead, one to the right, half a metre down.
    assert seen(level, (1.0, 0.5, 3.0)) == pytest.approx([3.0, -0.95, 0.1])


def test_points_in_the_world_are_seen_from_the_robot() -> None:
    found = levels(*moving("map", "base_link", at((2, 1, 0.3)), at((4, 1, 0.3))))
    level = found.of("map", np.array([0, SECOND]))
    assert level is not None
    assert level.frame_id == "base_link"
    assert seen(level, (5.0, 1.0, 0.8), 0) == pytest.approx([3.0, 0.0, 0.5])
    assert seen(level, (5.0, 1.0, 0.8), 1) == pytest.approx([1.0, 0.0, 0.5])


def test_nothing_is_known() -> None:
    found = levels()
    assert found.of("lidar", STAMP) is None
    assert found.words("lidar") == "along z of frame lidar, which is taken for level: no transform leads to the robot"
    assert found.of("map", STAMP) is None
    assert "no sensor's" in found.words("map")
