"""Poses as they are: late, and of a laser that does not sit where the robot is."""

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Mount, Odometry, Scene, Sensor

ROUTE = plan_route([Waypoint(0, 0, 0.5), Waypoint(3, 0, 0.5), Waypoint(3, 3, 0.5)])
SCENE = Scene("", Sensor(), (make.wall([[9, -30], [9, 30]]),), ROUTE, Odometry())


@pytest.mark.parametrize("delay", [0.0, 0.15, -0.15])
def test_late_stamps_tell_where_the_robot_was(delay):
    rows = simulate_odometry(replace(SCENE, odometry=Odometry(delay=delay)), 100)
    assert rows is not None
    true = (rows.stamp_ns - START_NS) / 1e9 - delay
    np.testing.assert_allclose(rows.poses, ROUTE.poses(true), atol=1e-9)
    np.testing.assert_allclose(rows.speed, ROUTE.speeds(true), atol=1e-6)
    # Every sweep has a pose before and after it, as far as the robot can know.
    assert rows.stamp_ns[0] <= START_NS
    assert rows.stamp_ns[-1] >= START_NS + 9_900_000_000
    assert len(rows) == 100 + (2 if delay else 0)


def test_a_mounted_laser_sees_from_its_own_place():
    mount = Mount((0.3, -0.1, np.pi / 2))
    scene = replace(SCENE, mount=mount)
    seconds = np.array([0.0, 2.0, 30.0])
    # The robot heads along +x at first, and along +y, from (3, 3), at the end.
    poses = scene.sensor_poses(seconds)
    np.testing.assert_allclose(poses[0], [0.3, -0.1, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(poses[2], [3.1, 3.3, np.pi], atol=1e-9)
    raw, _, _ = simulate_sweep_arrays(scene, 1)
    # The wall at x = 9 lies to the right of a laser that looks along +y.
    assert raw.ranges[0, 90] == pytest.approx(9 - 0.3, rel=1e-6)


def test_the_log_tells_the_mount_or_not():
    told, kept = (simulate_odometry(replace(SCENE, mount=Mount((0.3, -0.1, 0.2), told)), 3) for told in (True, False))
    assert told is not None
    assert kept is not None
    assert told.mount == (0.3, -0.1, 0.2)
    assert kept.mount == (0.0, 0.0, 0.0)
    assert np.array_equal(told.poses, kept.poses)
