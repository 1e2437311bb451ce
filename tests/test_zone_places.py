"""Zones as a sensor sees them: outlines, and frames that mounts and poses lead to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.masks import Circle, Mount, Polygon
from lidarcli.zone import ROBOT, ROUND, SENSOR, WORLD, Line, Zone, outline, placed

AHEAD = Polygon(((1.0, 0.0), (2.0, 0.0), (2.0, 1.0)))
MOUNTED = Mount("laser", "base_link", 0.2, -0.1, math.pi / 2)


def corners_of(
    zone: Zone, *mounts: Mount, robot: str = "", pose: Mount | None = None
) -> list[list[float]] | None:
    found = placed(zone, mounts, "laser", robot, pose)
    return None if found is None else (np.round(found, 9) + 0.0).tolist()


def test_outlines() -> None:
    circle = outline(Circle(1.0, -2.0, 0.5))
    assert circle.shape == (ROUND, 2)
    assert np.hypot(circle[:, 0] - 1.0, circle[:, 1] + 2.0) == pytest.approx(0.5)
    assert outline(AHEAD).tolist() == [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]
    assert outline(Line((0.0, 1.0), (2.0, 3.0))).tolist() == [[0.0, 1.0], [2.0, 3.0]]


def test_a_zone_of_the_sensor_stays_where_it_is() -> None:
    assert corners_of(Zone("z", AHEAD, SENSOR), MOUNTED) == [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]


@pytest.mark.parametrize(("frame", "robot"), [(ROBOT, "base_link"), ("base_link", ""), ("/base_link", "odd")])
def test_a_sensor_that_looks_to_the_left_of_the_robot(frame: str, robot: str) -> None:
    # (1, 0) of the robot is 0.8 m ahead of the laser and 0.1 m to the left; x of the laser is the robot's left.
    assert corners_of(Zone("z", AHEAD, frame), MOUNTED, robot=robot) == [
        [0.1, -0.8],
        [0.1, -1.8],
        [1.1, -1.8],
    ]


def test_a_sensor_that_hangs_head_down() -> None:
    hanging = Mount("laser", "base_link", 0.2, 0.0, 0.0, upside_down=True)
    line = Zone("z", Line((1.0, 0.5), (1.0, -0.5)), ROBOT)
    assert corners_of(line, hanging, robot="base_link") == [[0.8, -0.5], [0.8, 0.5]]


def test_mounts_lead_on_from_frame_to_frame() -> None:
    on = Mount("base_link", "cart", 1.0, 0.0, math.pi)
    # Through the mast first: (x, y) of the cart is (1 - x, -y) of the robot.
    line = Zone("z", Line((0.0, 0.0), (1.0, -1.0)), "cart")
    assert corners_of(line, MOUNTED, on) == [[0.1, -0.8], [1.1, 0.2]]


def test_a_zone_in_the_world_comes_through_the_pose() -> None:
    zone = Zone("z", Line((5.0, 2.0), (5.0, 3.0)), WORLD)
    pose = Mount("laser", WORLD, 4.0, 2.0, -math.pi / 2)
    assert corners_of(zone, pose=pose) == [[0.0, 1.0], [-1.0, 1.0]]
    assert corners_of(zone) is None


def test_what_nothing_places() -> None:
    assert corners_of(Zone("z", AHEAD, ROBOT)) is None
    assert corners_of(Zone("z", AHEAD, "gripper"), MOUNTED) is None
    assert corners_of(Zone("z", None, SENSOR)) is None
    assert corners_of(Zone("z", AHEAD, ROBOT), Mount("laser", "robot", 1.0, 0.0, 0.0)) == [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 1.0],
    ]
