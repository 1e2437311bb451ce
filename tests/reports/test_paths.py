"""Paths of tracks in the sensor frame: where a thing was, as the sensor of a later sweep would have seen it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lidarcli.reports.columns import Run
from lidarcli.reports.ground import Ground, Paths, ground_of
from lidarcli.sweeps.types import SweepPoses
from tests.reports.runs import crossing, run_of, sweep, thing, track


def driving(upside_down: bool = False, far: float = 0.0) -> Run:
    """Five sweeps of a sensor that drives and turns past a box that stands (track 7); in sweep 2 it is hidden."""
    k = np.arange(5.0)
    poses = SweepPoses(far + 0.3 * k, 0.1 * k, 0.2 * k, np.full(5, upside_down))
    sweeps, objects = [], []
    for index in range(5):
        x, y, yaw = float(poses.x[index]), float(poses.y[index]), float(poses.yaw[index])
        sweeps.append(sweep(index, pose_x=x, pose_y=y, pose_yaw=yaw))
        dx, dy = far + 3.0 - x, 1.0 - y
        box_x = np.cos(yaw) * dx + np.sin(yaw) * dy
        box_y = (np.cos(yaw) * dy - np.sin(yaw) * dx) * (-1 if upside_down else 1)
        world = poses.to_world(np.array([index]), np.array([box_x]), np.array([box_y]), np.zeros(1))
        assert (world[0][0], world[1][0]) == pytest.approx((far + 3.0, 1.0))
        place = {"box_x": box_x, "box_y": box_y, "world_x": world[0][0], "world_y": world[1][0]}
        if index != 2:
            objects.append(thing(index, 1, track=7, vx=1.0, vy=0.0, moving=index == 4, **place))
    return run_of(sweeps, objects, [track(7, 0, 4)])


def paths_of(run: Run) -> Paths:
    assert run.trajectories is not None
    return Paths(run.sweeps, run.objects, run.trajectories, "/scan")


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("far", [0.0, 5e6])
def test_a_thing_that_stands_is_one_point_for_a_driving_sensor(upside_down: bool, far: float) -> None:
    run = driving(upside_down, far)
    found = paths_of(run)
    box = {name: run.objects.numbers(name) for name in ("box_x", "box_y")}
    for index, row in ((0, 0), (1, 1), (3, 2), (4, 3)):
        (path,) = found.up_to(index)
        assert (path.number, path.seen, path.is_agent) == (7, True, False)
        seen = np.arange(index + 1) != 2
        assert np.isnan(path.x[~seen]).all(), "no line leads to where it was hidden"
        assert path.x[seen] == pytest.approx(np.full(seen.sum(), box["box_x"][row]), abs=1e-6)
        assert path.y[seen] == pytest.approx(np.full(seen.sum(), box["box_y"][row]), abs=1e-6)
        r, theta = (run.objects.numbers(name)[row] for name in ("r_min", "theta_min"))
        assert path.mark == pytest.approx((r * np.cos(theta), r * np.sin(theta))), "the mark stands on a point"
    # The velocity is along x over ground; the sensor has turned by 0.8 rad, which upside down is the other way.
    (last,) = found.up_to(4)
    side = -1 if upside_down else 1
    assert last.velocity == pytest.approx((np.cos(0.8), -side * np.sin(0.8)))
    assert found.up_to(3)[0].velocity == (0.0, 0.0)


def test_a_hidden_thing_is_where_it_was_last_seen() -> None:
    (path,) = paths_of(driving()).up_to(2)
    assert (path.seen, len(path.x), path.velocity) == (False, 3, (0.0, 0.0))
    assert path.mark == (path.x[-1], path.y[-1])
    dx, dy = 3.0 - 0.6, 1.0 - 0.2
    assert (path.x[-1], path.y[-1]) == pytest.approx(
        (np.cos(0.4) * dx + np.sin(0.4) * dy, np.cos(0.4) * dy - np.sin(0.4) * dx)
    )


def test_sweeps_without_a_pose_are_left_out() -> None:
    run = driving()
    table = run.sweeps.table.to_pylist()
    table[1] |= {"pose_x": None, "pose_y": None, "pose_yaw": None}
    objects = run.objects.table.to_pylist()
    objects[1] |= {"world_x": None, "world_y": None}
    found = paths_of(run_of(table, objects, [track(7, 0, 4)]))
    assert found.up_to(1) == ()
    assert len(found.up_to(4)[0].x) == 5


def test_paths_of_a_crossing() -> None:
    found = paths_of(run_of(**crossing()))
    assert found.are_there
    assert (found.stamp_of(9) is None, found.stamp_of(10) is None) == (False, True)
    pallet, person, robot = found.up_to(6)
    assert [(one.number, one.is_agent, one.label) for one in (pallet, person, robot)] == [
        (1, False, "pallet"),
        (2, True, ""),
        (3, True, ""),
    ]
    # Two legs are one path, between them.
    assert person.x == pytest.approx(np.full(7, 3.0))
    assert person.y == pytest.approx(-0.5 + 0.1 * np.arange(7))
    assert person.velocity == (0.0, 1.0)
    assert robot.x == pytest.approx([1.25, 1.3])
    # Only the last seconds of it.
    assert [len(one.y) for one in found.up_to(6, seconds=0.3)] == [4, 4, 2]
    # The person has left after sweep 7.
    assert [one.number for one in found.up_to(8)] == [1, 3]
    run = run_of(**crossing())
    assert run.trajectories is not None
    assert not Paths(run.sweeps, run.objects, run.trajectories, "/other").are_there


def test_without_poses_the_sensor_stands() -> None:
    run = run_of([sweep(0)], [thing(0, 1)])
    zero: Any = np.zeros(1, np.int64)
    found = ground_of(run.sweeps, zero, run.objects, zero, zero)
    assert isinstance(found, Ground)
    assert (found.posed, found.x.tolist(), found.y.tolist()) == (False, [2.1], [0.0])
    assert [float(value[0]) for value in found.to_sensor(0, found.x, found.y)] == [2.1, 0.0]
