"""Zones as a sensor sees them: outlines, and frames that mounts and poses lead to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.sweeps.masks import Circle, Mount, Polygon, mounted
from lidarcli.sweeps.types import SweepPoses
from lidarcli.sweeps.zone import ROUND, Line, outline, placed

AHEAD = Polygon(((1.0, 0.0), (2.0, 0.0), (2.0, 1.0)))
MOUNTED = Mount("laser", "base_link", 0.2, -0.1, math.pi / 2)


def corners_of(shape: Circle | Polygon | Line, *mounts: Mount | None) -> list[list[list[float]]]:
    """The corners for a sensor that is in one place after the other."""
    known = [mount for mount in mounts if mount is not None]
    x, y, yaw = (np.array([getattr(mount, name) for mount in known]) for name in ("x", "y", "yaw"))
    found = placed(shape, SweepPoses(x, y, yaw, np.array([mount.upside_down for mount in known])))
    return (np.round(found, 9) + 0.0).tolist()


def test_outlines() -> None:
    circle = outline(Circle(1.0, -2.0, 0.5))
    assert circle.shape == (ROUND, 2)
    assert np.hypot(circle[:, 0] - 1.0, circle[:, 1] + 2.0) == pytest.approx(0.5)
    assert outline(AHEAD).tolist() == [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]
    assert outline(Line((0.0, 1.0), (2.0, 3.0))).tolist() == [[0.0, 1.0], [2.0, 3.0]]


def test_a_sensor_that_looks_to_the_left_of_the_robot() -> None:
    # (1, 0) of the robot is 0.8 m ahead of the laser and 0.1 m to the left; x of the laser is the robot's left.
    assert corners_of(AHEAD, MOUNTED) == [[[0.1, -0.8], [0.1, -1.8], [1.1, -1.8]]]


def test_a_sensor_that_hangs_head_down() -> None:
    hanging = Mount("laser", "base_link", 0.2, 0.0, 0.0, upside_down=True)
    assert corners_of(Line((1.0, 0.5), (1.0, -0.5)), hanging) == [[[0.8, -0.5], [0.8, 0.5]]]


def test_mounts_lead_on_from_frame_to_frame() -> None:
    on = Mount("base_link", "cart", 1.0, 0.0, math.pi)
    # (x, y) of the cart is (1 - x, -y) of the robot.
    here = mounted([MOUNTED, on], "laser", "/cart")
    assert corners_of(Line((0.0, 0.0), (1.0, -1.0)), here) == [[[0.1, -0.8], [1.1, 0.2]]]


def test_the_sensor_moves_in_the_world() -> None:
    line = Line((5.0, 2.0), (5.0, 3.0))
    poses = Mount("laser", "world", 4.0, 2.0, -math.pi / 2), Mount("laser", "world", 5.0, 2.0, 0.0)
    assert corners_of(line, *poses) == [[[0.0, 1.0], [-1.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]]


def test_a_pose_that_is_not_known_gives_no_corners() -> None:
    unknown = SweepPoses(*(np.full(1, np.nan) for _ in range(3)), np.zeros(1, bool))
    assert np.isnan(placed(AHEAD, unknown)).all()


def test_what_mounts_do_not_lead_to() -> None:
    assert mounted([MOUNTED], "laser", "gripper") is None
    assert mounted([], "laser", "base_link") is None
    here = mounted([], "laser", "")
    assert here is not None
    assert corners_of(AHEAD, here) == [[[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]]
