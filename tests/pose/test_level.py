"""What is level for a sensor's points: by the tree of frames, for sensors that lean, hang head down or look ahead."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.logs.clouds import Levelled
from lidarcli.pose.sources import TreeLevels
from lidarcli.pose.tracks import Motion, Tracks, multiply, planar, rotate
from lidarcli.sweeps import Float64
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
    tracks = Tracks()
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


def test_the_floor_goes_before_the_robot() -> None:
    found = levels(fixed("base_footprint", "base_link", at((0, 0, 0.2))), fixed("base_link", "lidar", at((0, 0, 0.5))))
    assert seen(found.of("lidar", STAMP), (1.0, 0.0, 0.0)) == pytest.approx([1.0, 0.0, 0.7])
    assert found.words("lidar") == "above base_footprint, level by /tf_static"


@pytest.mark.parametrize("order", [1, -1])
def test_the_base_of_another_robot_is_not_that_of_the_sensor(order: int) -> None:
    robots = [
        moving("map", "one/base_link", at((0, 0, 0)), at((1, 0, 0))),
        moving("map", "two/base_footprint", at((5, 5, 3)), at((6, 5, 3))),
    ]
    told = [message for robot in robots[::order] for message in robot]
    found = levels(*told, fixed("one/base_link", "one/lidar", at((0, 0, 0.4))))
    level = found.of("one/lidar", np.array([SECOND // 2]))
    assert seen(level, (1.0, 0.0, 0.0)) == pytest.approx([1.0, 0.0, 0.4])
    assert found.words("one/lidar").startswith("above one/base_link, level by ")


def test_a_robot_of_another_name_is_what_the_sensor_is_fixed_to() -> None:
    found = levels(
        *moving("odom", "hull", at((0, 0, 7)), at((9, 0, 7))),
        fixed("hull", "mast", at((0, 0, 1))),
        fixed("mast", "lidar", at((0, 0, 1))),
    )
    assert seen(found.of("lidar", np.array([SECOND // 2])), (1.0, 0.0, 0.0)) == pytest.approx([1.0, 0.0, 2.0])
    assert found.words("lidar").startswith("above hull, level by ")


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
    pose = planar(Motion(np.array([[0.5, -0.2, 1.1]]), mount))
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


def test_a_camera_without_a_robot() -> None:
    found = levels()
    level = found.of("camera_depth_optical_frame", STAMP)
    assert level is not None
    assert level.frame_id == "camera_depth_optical_frame"
    assert seen(level, (1.0, 0.5, 3.0)) == [3.0, -1.0, -0.5]
    assert "taken for level" in found.words("camera_depth_optical_frame")


def test_points_in_the_world_are_seen_from_the_robot() -> None:
    found = levels(*moving("map", "base_link", at((2, 1, 0.3)), at((4, 1, 0.3))))
    level = found.of("map", np.array([0, SECOND]))
    assert level is not None
    assert level.frame_id == "base_link"
    assert seen(level, (5.0, 1.0, 0.8), 0) == pytest.approx([3.0, 0.0, 0.5])
    assert seen(level, (5.0, 1.0, 0.8), 1) == pytest.approx([1.0, 0.0, 0.5])


@pytest.mark.parametrize("world", ["odom", "camera_init"])
def test_points_in_the_world_are_seen_from_what_alone_moves_there(world: str) -> None:
    told = [*moving(world, "body", at((2, 1, 0.3)), at((4, 1, 0.3))), *moving("body", "wheel", at((0, 0, 0)))]
    found = levels(*told)
    level = found.of(world, np.array([0]))
    assert level is not None
    assert level.frame_id == "body"
    assert seen(level, (5.0, 1.0, 0.8)) == pytest.approx([3.0, 0.0, 0.5])
    assert found.words(world) == "above body, level by /tf"
    several = levels(*told, *moving(world, "other", at((2, 1, 0.3)), at((4, 1, 0.3))))
    assert several.of(world, np.array([0])) is None


@pytest.mark.parametrize("base", ["base_link", "body"])
def test_points_in_the_map_are_seen_from_the_robot_beyond_its_odometry(base: str) -> None:
    found = levels(
        *moving("map", "odom", at((1, 0, 0)), at((1, 0, 0))), *moving("odom", base, at((1, 1, 0.3)), at((3, 1, 0.3)))
    )
    level = found.of("map", np.array([0]))
    assert level is not None
    assert level.frame_id == base
    assert seen(level, (5.0, 1.0, 0.8)) == pytest.approx([3.0, 0.0, 0.5])


def test_points_in_the_world_are_seen_from_nowhere_while_the_robot_is_not_there() -> None:
    found = levels(*moving("map", "base_link", at((2, 1, 0.3)), at((4, 1, 0.3))))
    level = found.of("map", np.array([0, 5 * SECOND]))
    assert level is not None
    assert np.isnan(level.rotation).any(axis=(1, 2)).tolist() == [False, True]


def test_a_mount_holds_before_and_after_it_is_told() -> None:
    mount = [tf(second * SECOND, "base_link", "lidar", at((0, 0, 0.8), turn(PITCH, 0.3))) for second in (3, 4)]
    found = levels(*mount)
    level = found.of("lidar", np.array([0, 3 * SECOND, 9 * SECOND]))
    assert level is not None
    assert level.offset[:, 2].tolist() == [0.8] * 3
    assert np.ptp(level.rotation, axis=0).max() == 0.0


def test_a_camera_looks_ahead_also_before_the_robot_is_in_the_world() -> None:
    found = levels(
        fixed("base_link", "camera_link", at((0.2, 0.0, 0.6))),
        fixed("camera_link", "camera_optical_frame", at((0.0, 0.05, 0.0), OPTICAL)),
        *(tf(second * SECOND, "odom", "base_link", at((0, 0, 0))) for second in (7, 8)),
    )
    level = found.of("camera_optical_frame", np.array([0, 7 * SECOND]))
    assert level is not None
    assert level.frame_id == "camera_link"
    for row in (0, 1):
        assert seen(level, (1.0, 0.5, 3.0), row) == pytest.approx([3.0, -0.95, 0.1])


def test_nothing_is_known() -> None:
    found = levels()
    assert found.of("lidar", STAMP) is None
    assert found.words("lidar") == "along z of frame lidar, which is taken for level: no transform leads to the robot"
    assert found.of("map", STAMP) is None
    assert "no sensor's" in found.words("map")
