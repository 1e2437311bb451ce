"""Walls, maps and paths of tracks of a report: in the world and in the sensor frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN
from lidarcli.reports.columns import Run
from lidarcli.reports.html import pack_map
from lidarcli.reports.world import MAX_CELLS, Paths, PosedStream, Raw, map_of, posed_stream, walls_of
from lidarcli.sweeps.types import Float64, SweepPoses
from tests.reports.runs import array, crossing, run_of, sweep, thing, track


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
    found = posed_stream(run.sweeps, zero, run.objects, zero, zero)
    assert isinstance(found, PosedStream)
    assert (found.posed, found.x.tolist(), found.y.tolist()) == (False, [2.1], [0.0])
    assert [float(value[0]) for value in found.to_sensor(0, found.x, found.y)] == [2.1, 0.0]


STEP = np.pi / 180


def room(x: float, y: float, yaw: float, side: float = 1.0) -> Float64:
    """Ranges of 360 beams, from bearing -pi on, to the walls of 6 m x 4 m around the origin."""
    direction = yaw + side * (-np.pi + STEP * np.arange(360))
    with np.errstate(divide="ignore"):
        to_x = np.abs(np.where(np.cos(direction) > 0, 3 - x, -3 - x) / np.cos(direction))
        to_y = np.abs(np.where(np.sin(direction) > 0, 2 - y, -2 - y) / np.sin(direction))
    ranges: Float64 = np.minimum(to_x, to_y)
    return ranges


def raw_of(*ranges: Float64) -> dict[tuple[int, str], Raw]:
    count = len(ranges)
    full = (np.full(count, value) for value in (-np.pi, STEP))
    return {(0, "/scan"): Raw(np.arange(count), *full, np.full(count, 1, np.uint8), np.full(count, 360), np.array(ranges))}


def seen(poses: list[tuple[float, float, float]], side: float = 1.0, **of_thing: Any) -> Run:
    """Sweeps with these poses; in each an object between -10 and 10 degrees where `of_thing` says anything."""
    sweeps = [sweep(k, pose_x=x, pose_y=y, pose_yaw=yaw) for k, (x, y, yaw) in enumerate(poses)]
    objects = []
    for k, (x, y, yaw) in enumerate(poses):
        box_y = 0.5
        place = {
            "box_x": 2.0,
            "box_y": box_y,
            "world_x": x + 2.0 * np.cos(yaw) - side * box_y * np.sin(yaw),
            "world_y": y + 2.0 * np.sin(yaw) + side * box_y * np.cos(yaw),
        }
        edges = {"theta_i": -10 * STEP, "theta_f": 10 * STEP}
        objects += [thing(k, 1, **{**place, **edges, **of_thing})] if of_thing else []
    return run_of(sweeps, objects)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_walls_in_the_world(side: float) -> None:
    poses = [(0.2 * k - 1, 0.1 * k, 0.3 * k) for k in range(10)]
    # Far from the origin of the world, too.
    run = seen([(x + 1e6, y - 1e6, yaw) for x, y, yaw in poses], side, set="A")
    found = walls_of(run, raw_of(*(room(*pose, side=side) for pose in poses)))
    assert [*found] == ["world"]
    x, y = found["world"].x - 1e6, found["world"].y + 1e6
    off = np.minimum(np.abs(np.abs(x) - 3), np.abs(np.abs(y) - 2))
    assert off.max() < found["world"].cell
    assert (x.min(), x.max()) == pytest.approx((-3, 3), abs=0.1)
    assert (y.min(), y.max()) == pytest.approx((-2, 2), abs=0.1)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_map_of_a_run(side: float) -> None:
    poses = [(0.2 * k - 1, 0.1 * k, 0.3 * k) for k in range(10)]
    ranges = [room(*pose, side=side) for pose in poses]
    for one in ranges:
        # A person ahead, who walks along.
        one[170:191] = 0.4
    far = [(x + 1000, y - 1000, yaw) for x, y, yaw in poses]
    grid = map_of(seen(far, side, set="A"), raw_of(*ranges))
    assert grid is not None
    assert (grid.resolution, grid.frame_id) == (0.05, "world")
    row, column = np.nonzero(grid.cells == OCCUPIED)
    x, y = grid.x - 1000 + 0.05 * (column + 0.5), grid.y + 1000 + 0.05 * (row + 0.5)
    off = np.minimum(np.abs(np.abs(x) - 3), np.abs(np.abs(y) - 2))
    assert off.max() < 0.06
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((-3, 3, -2, 2), abs=0.06)
    # Inside of the 6 m x 4 m all is free, where the person was as well.
    assert grid.free * 0.05**2 == pytest.approx(24.0, rel=0.05)
    # What stands is on the map, what moves is not.
    turns = [(0.0, 0.0, 0.3 * k) for k in range(4)]
    ranges = [np.where(np.abs(np.arange(360) - 180) <= 10, 0.4, room(*turn, side=side)) for turn in turns]
    there, gone = (map_of(seen(turns, side, set=word), raw_of(*ranges)) for word in "OA")
    assert there is not None
    assert gone is not None
    assert there.occupied > gone.occupied
    # Runs of cells hold all of it.
    held = pack_map(grid)
    cells = np.full(grid.cells.shape, UNKNOWN)
    for name, value in (("free", FREE), ("occupied", OCCUPIED)):
        runs = [array(held[name][key], np.uint16).tolist() for key in ("row", "column", "length")]
        for at_row, first, length in zip(*runs, strict=True):
            cells[at_row, first : first + length] = value
    assert (cells == grid.cells).all()
    assert (held["cell"], held["origin"]) == (0.05, [grid.x, grid.y])


def test_where_there_is_no_map() -> None:
    beams = raw_of(*[room(0.0, 0.0, 0.0)] * 3)
    assert map_of(run_of([sweep(k) for k in range(3)]), beams) is None
    posed = seen([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    assert map_of(posed, {}) is None
    assert map_of(posed, {(0, "/other"): beams[0, "/scan"]}) is None
    # Ground that is too large for cells, and bearings that are none.
    assert map_of(seen([(1e12 + k, 0.0, 0.0) for k in range(3)]), beams) is None
    nothing = beams[0, "/scan"]._replace(angle_min=np.full(3, np.nan))
    grid = map_of(posed, {(0, "/scan"): nothing})
    assert grid is not None
    assert (grid.occupied, grid.free) == (0, 0)


def test_walls_of_a_sensor_that_stands() -> None:
    run = run_of([sweep(k) for k in range(5)])
    found = walls_of(run, raw_of(*[room(0.5, 0.5, 0.0)] * 5))
    assert [*found] == ["sensor"]
    assert found["sensor"].x.max() == pytest.approx(2.5, abs=0.06)
    assert 100 < len(found["sensor"].x) <= MAX_CELLS
    # With poses it stands in the world, too, until it moves.
    still = [(0.5, 0.5, 0.0)] * 5
    assert [*walls_of(seen(still), raw_of(*[room(0.5, 0.5, 0.0)] * 5))] == ["sensor", "world"]
    assert [*walls_of(seen([*still[1:], (0.5, 0.6, 0.0)]), raw_of(*[room(0.5, 0.5, 0.0)] * 5))] == ["world"]


def test_beams_on_objects_are_no_walls() -> None:
    beams = raw_of(*[room(0.0, 0.0, 0.0)] * 4)
    still = [(0.0, 0.0, 0.0)] * 4

    def ahead(run: Run) -> int:
        walls = walls_of(run, beams)["sensor"]
        return int(np.count_nonzero(np.abs(np.arctan2(walls.y, walls.x)) < 8 * STEP))

    assert ahead(seen(still)) > 10
    assert ahead(seen(still, set="S")) > 10
    assert ahead(seen(still, set="O")) == ahead(seen(still, set="A")) == 0
    # An object behind: between its edges lies the bearing where the sweep begins.
    walls = walls_of(seen(still, set="O", theta_i=170 * STEP, theta_f=190 * STEP), beams)["sensor"]
    behind = np.abs(np.abs(np.arctan2(walls.y, walls.x)) - np.pi) < 8 * STEP
    assert not behind.any()


def test_what_was_hit_once_is_no_wall() -> None:
    ranges = [room(0.0, 0.0, 0.0) for _ in range(4)]
    ranges[2][90] = 1.0
    found = walls_of(run_of([sweep(k) for k in range(4)]), raw_of(*ranges))["sensor"]
    assert np.hypot(found.x, found.y).min() > 1.9


def test_where_there_are_no_walls() -> None:
    run = run_of([sweep(0)], [thing(0, 1)], [track(1)])
    assert walls_of(run, {}) == {}
    assert walls_of(run, raw_of(np.full(360, np.nan))) == {}
    # Sweeps that the tables do not have.
    assert walls_of(run, {(0, "/other"): raw_of(room(0.0, 0.0, 0.0))[0, "/scan"]}) == {}
    # Two sensors have no common frame of their own.
    two = run_of([sweep(k, topic=topic) for topic in ("/scan", "/other") for k in range(3)])
    beams = raw_of(*[room(0.0, 0.0, 0.0)] * 3)
    assert walls_of(two, {**beams, (0, "/other"): beams[0, "/scan"]}) == {}


def test_odd_bearings() -> None:
    """Tables of other programs: nothing of it is a reason to fail, and what makes sense still counts."""
    still = [(0.0, 0.0, 0.0)] * 4
    beams = raw_of(*[room(0.0, 0.0, 0.0)] * 4)
    plain = walls_of(seen(still), beams)["sensor"]
    for odd in ({"theta_i": -1e12, "theta_f": 1e12}, {"theta_i": None, "theta_f": None}):
        walls = walls_of(seen(still, set="O", **odd), beams)["sensor"]
        assert walls.x.tolist() == plain.x.tolist()
    # An object all around leaves nothing.
    assert "sensor" not in walls_of(seen(still, set="O", theta_i=-4.0, theta_f=4.0), beams)
    raw = beams[0, "/scan"]
    for name in ("angle_min", "angle_increment"):
        for value in (np.nan, 0.0, 1e-12, 1e12):
            walls_of(seen(still, set="O"), {(0, "/scan"): raw._replace(**{name: np.full(4, value)})})
    nothing = raw._replace(angle_min=np.full(4, np.nan))
    assert walls_of(seen(still, set="O"), {(0, "/scan"): nothing}) == {}


def test_sweeps_that_run_clockwise_and_see_a_part() -> None:
    still = [(0.0, 0.0, 0.0)] * 4
    full = raw_of(*[room(0.0, 0.0, 0.0)] * 4)[0, "/scan"]
    # The beams from 89 degrees down to -90 degrees.
    part = full._replace(
        angle_min=np.full(4, 89 * STEP),
        angle_increment=np.full(4, -STEP),
        ranges=full.ranges[:, 269:89:-1],
        beams=np.full(4, 180),
    )
    edges = {"theta_i": -10 * STEP, "theta_f": 10 * STEP}
    walls = walls_of(seen(still, set="O", **edges), {(0, "/scan"): part})["sensor"]
    bearing = np.arctan2(walls.y, walls.x) / STEP
    assert (bearing.min(), bearing.max()) == pytest.approx((-90, 89), abs=1.5)
    assert np.abs(bearing).min() > 9
