"""The true map of a run: what stands still, as a perfect sensor sees it from where it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.maps.grids import read_map
from lidarcli.simulation import scene as make
from lidarcli.simulation import simulate, truth
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Course, Entity, Odometry, Scene, SceneMount, SceneSensor, load_scene
from lidarcli.simulation.truth import true_map

CELL = 0.05
SENSOR = SceneSensor(beams=2880, angle_min=-np.pi, angle_increment=np.pi / 1440, range_max=30.0)


def room(left: float, low: float, right: float, high: float) -> Entity:
    return make.wall([[left, low], [right, low], [right, high], [left, high], [left, low]])


def cells(grid: Occupancy, state: int) -> set[tuple[int, int]]:
    """Column and row, from the origin of the world, of all cells of a kind."""
    column, row = round(grid.x / grid.resolution), round(grid.y / grid.resolution)
    return {(column + int(i), row + int(k)) for k, i in np.argwhere(grid.cells == state)}


def block(left: int, low: int, right: int, high: int) -> set[tuple[int, int]]:
    """All cells from one to another, both included."""
    return {(i, k) for i in range(left, right + 1) for k in range(low, high + 1)}


def test_a_room_of_four_by_three_metres() -> None:
    parked = Course(np.array([[0.413, -0.287]]), yaw=0.3)
    grid = true_map(Scene("", SENSOR, (room(-1.98, -1.47, 2.02, 1.53),), parked), 3, CELL)
    inside = block(-39, -29, 39, 29)
    assert cells(grid, OCCUPIED) == block(-40, -30, 40, 30) - inside
    assert cells(grid, FREE) == inside
    assert cells(grid, UNKNOWN) == block(-41, -31, 41, 31) - block(-40, -30, 40, 30)
    assert (grid.resolution, grid.x, grid.y, grid.frame_id) == (CELL, -2.05, -1.55, "map")


def test_walls_on_the_border_of_two_cells_are_in_the_one_behind() -> None:
    parked = Course(np.array([[0.013, 0.021]]))
    grid = true_map(Scene("", SENSOR, (room(-2.0, -1.5, 2.0, 1.5),), parked), 1, CELL)
    inside = block(-40, -30, 39, 29)
    corners = {(-41, -31), (-41, 30), (40, -31), (40, 30)}
    assert cells(grid, OCCUPIED) == block(-41, -31, 40, 30) - inside - corners
    assert cells(grid, FREE) == inside


def ends(x: float, y: float, yaw: float, sensor: SceneSensor) -> list[tuple[float, float]]:
    """Where the beams end in a room of 4 x 3 m with a pillar of 0.3 m at (-1, 0.5): one beam after the other."""
    found = []
    for beam in range(sensor.beams):
        theta = yaw + sensor.angle_min + sensor.angle_increment * beam
        cos, sin = math.cos(theta), math.sin(theta)
        reach = [(2.02 - x) / cos if cos > 0 else (-1.98 - x) / cos]
        reach += [(1.53 - y) / sin if sin > 0 else (-1.47 - y) / sin]
        along = (-1 - x) * cos + (0.5 - y) * sin
        aside = (-1 - x) * sin - (0.5 - y) * cos
        if along > 0 and abs(aside) < 0.3:
            reach.append(along - math.sqrt(0.3**2 - aside**2))
        if min(reach) < sensor.range_max:
            found.append((x + min(reach) * cos, y + min(reach) * sin))
    return found


@pytest.mark.parametrize(("reach", "cell"), [(30.0, 0.05), (1.9, 0.05), (30.0, 0.013), (30.0, 0.4)])
def test_occupied_is_where_beams_end(reach: float, cell: float) -> None:
    sensor = replace(SENSOR, beams=360, angle_increment=np.pi / 180, range_max=reach)
    entities = (room(-1.98, -1.47, 2.02, 1.53), make.cylinder(-1, 0.5, 0.3))
    grid = true_map(Scene("", sensor, entities, Course(np.array([[0.31, -0.22]]), yaw=0.4)), 2, cell)
    expected = {(math.floor(x / cell), math.floor(y / cell)) for x, y in ends(0.31, -0.22, 0.4, sensor)}
    assert cells(grid, OCCUPIED) == expected


MOVING = """
[[person]]
x = 1
y = 1
velocity = [-0.3, 0.1]
[[person]]
[person.route]
waypoints = [[-1, -1], [1, -1], [1, 1]]
speed = 1
[[box]]
x = -1
y = 0
length = 0.4
width = 0.4
appears = 0.2
[[box]]
x = -1
y = 1
length = 0.4
width = 0.4
disappears = 100
[[chair]]
x = 0
y = 1
yaw_rate = 10
"""
TEXT = """
[scene]
sweeps = 9
[sensor]
beams = 720
fov = 360
time_increment = 1e-4
noise = {noise}
lost = {noise}
[robot]
speed = 0.5
waypoints = [[-1, -0.5], [1, -0.5], [1, 0.5]]
[robot.odometry]
[[wall]]
points = [[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5]]
closed = true
[[person]]
x = -1.5
y = 1.2
[[box]]
x = 1.5
y = 1.2
length = 0.4
width = 0.3
lost = {lost}
"""


def scene_file(folder: Path, text: str = TEXT, noise: float = 0.05, lost: float = 1.0) -> Path:
    path = folder / "scene.toml"
    path.write_text(text.format(noise=noise, lost=lost))
    return path


def test_what_moves_appears_or_disappears_leaves_no_cell(tmp_path: Path) -> None:
    empty = true_map(load_scene(scene_file(tmp_path)), 9, CELL)
    crowded = load_scene(scene_file(tmp_path, TEXT + MOVING))
    assert len(crowded.entities) == 8
    busy = true_map(crowded, 9, CELL)
    assert np.array_equal(busy.cells, empty.cells)
    assert (busy.x, busy.y) == (empty.x, empty.y)
    # Who stands still is there, and so is what swallows beams.
    assert {(i, k) for i, k in cells(empty, OCCUPIED) if i < -28 and 21 < k < 28}
    assert {(i, k) for i, k in cells(empty, OCCUPIED) if 25 < i < 34 and 20 <= k < 28}


CORNERS = np.array([[-2.03, -1.52], [2.04, -1.52], [2.04, 1.51], [-2.03, 1.51]])
LOOP = Course(np.array([[-1.0, -0.8], [1.0, -0.8], [1.0, 0.8], [-1.0, 0.8]]), speed=1.0)
ROUND = plan_route([Waypoint(x, y, 1.0) for x, y in LOOP.points.tolist()], loop=True)


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("path", [LOOP, ROUND], ids=["course", "route"])
def test_walls_of_a_driven_loop_are_thin(path: Any, turn: float) -> None:
    """Each beam from its own pose: where the robot turns at once, the laser ahead of its axis leaps."""
    corners = CORNERS @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    sensor = replace(SENSOR, beams=720, angle_increment=np.pi / 360, time_increment=1 / 7200)
    walls = make.wall(np.vstack([corners, corners[:1]]))
    mount = SceneMount((0.3, 0.1, 0.5))
    scene = Scene("", sensor, (walls,), path, Odometry(), mount=mount)
    found = cells(true_map(scene, 80, CELL), OCCUPIED)
    # A wall runs through a cell where the corners of the cell are on either side of it.
    through = set()
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        dx, dy = (x1 - x0, y1 - y0) / np.hypot(x1 - x0, y1 - y0)
        for i, k in block(-60, -60, 60, 60):
            x, y = np.array([0, 1, 1, 0]) + i, np.array([0, 0, 1, 1]) + k
            off = (x * CELL - x0) * dy - (y * CELL - y0) * dx
            along = (x * CELL - x0) * dx + (y * CELL - y0) * dy
            if off.min() <= 1e-6 and off.max() >= -1e-6 and along.max() > 0 and along.min() < np.hypot(x1 - x0, y1 - y0):
                through.add((i, k))
    assert found <= through
    # What is missing are tips of cells that a wall only just touches.
    assert len(found) > 0.95 * len(through)
    if not turn:
        assert found == through


def test_a_beam_without_a_return_says_nothing() -> None:
    grid = true_map(Scene("", SENSOR, (make.wall([[1.02, -0.5], [1.02, 0.5]]),)), 1, CELL)
    assert {i for i, _ in cells(grid, OCCUPIED)} == {20}
    assert min(i for i, _ in cells(grid, FREE)) == 0


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    large = Scene("", replace(SENSOR, range_max=1e5), (room(-1500, -1500, 1500, 1500),))
    with pytest.raises(OptionError) as caught:
        true_map(large, 1, CELL)
    assert str(caught.value) == (
        "--map: the true map would reach over 3,000 x 3,000 m, more than 400,000,000 cells of 0.05 m; "
        "take a coarser --map-resolution"
    )
    assert true_map(large, 1, 50.0).occupied > 0
    scene = scene_file(tmp_path)
    for options, message in [
        ({"map": tmp_path / "a.png"}, f"{tmp_path}/a.png: the suffix of a true map has to be .yaml"),
        ({"map_resolution": 0.0}, "--map-resolution must be at least 0.001 and at most 1000 m, not 0"),
        ({"map_resolution": math.nan}, "--map-resolution must be at least 0.001 and at most 1000 m, not nan"),
        ({"map_resolution": 0.1}, "--map-resolution is that of --map: name its file, too"),
        ({"map": tmp_path / "log" / "a.yaml"}, f"{tmp_path}/log/a.yaml and {tmp_path}/log are in each"),
        ({"map": tmp_path / "a.yaml", "sweeps": 0}, "--map: no beam of 0 sweeps ends at anything that stands still"),
    ]:
        with pytest.raises(OptionError) as caught:
            simulate(scene, tmp_path / "log", **options)  # type: ignore[arg-type]
        assert str(caught.value).startswith(message)
    for log in ("a.yaml", "a.pgm", "sub/../a.yaml", "a.yaml/log"):
        with pytest.raises(OptionError, match=r"in each other's way|written twice"):
            simulate(scene, tmp_path / log, container="csv", map=tmp_path / "a.yaml")
    monkeypatch.setattr(truth, "MAX_BEAMS", 720)
    with pytest.raises(OptionError, match="--map: 1,440 beams that take time are more than"):
        simulate(scene, tmp_path / "log", sweeps=2, map=tmp_path / "a.yaml")
    assert list(tmp_path.iterdir()) == [scene]


@pytest.mark.parametrize("options", [(), ("--map-resolution", "0.1")])
def test_the_command_writes_both_files(tmp_path: Path, lidarcli: Callable[..., Any], options: tuple[str, ...]) -> None:
    scene, log, file = scene_file(tmp_path), tmp_path / "log.mcap", tmp_path / "maps" / "log.map.yaml"
    ran = lidarcli("simulate", scene, "-o", log, "--sweeps", "4", "--map", file, *options)
    assert (ran.code, ran.out) == (0, "")
    assert ran.err.splitlines()[1:] == [
        f"  wrote    {tmp_path}/log.{{mcap,truth.parquet,truth-beams.parquet}}",
        f"  wrote    {file}",
    ]
    assert sorted(path.name for path in file.parent.iterdir()) == ["log.map.pgm", "log.map.yaml"]
    read, made = read_map(file), true_map(load_scene(scene), 4, 0.1 if options else 0.05)
    assert (read.resolution, read.x, read.y) == (made.resolution, made.x, made.y)
    assert np.array_equal(read.cells, made.cells)
