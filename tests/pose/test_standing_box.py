"""A robot drives around a box that stands still: in the world frame the box stays where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.simulation import simulate
from lidarcli.sweeps import Float64

X, Y, YAW = 0.3, 0.2, np.deg2rad(30.0)
LENGTH, WIDTH = 0.8, 0.5
NEAR = 0.03
"""[m]"""
SCENE = f"""
[scene]
name = "box"
sweeps = 150

[sensor]
beams = 1081
angle_min = -180.0
angle_max = 180.0
noise = 0.003
lost = 0.003
rate = 5.0

[robot]
super_ellipse = {{ a = 2.6, b = 1.9, exponent = 4.0 }}
speed = 0.5

[robot.odometry]
noise = 0.0
yaw_noise = 0.0

[[wall]]
points = [[-4.5, -3.5], [4.5, -3.5], [4.5, 3.5], [-4.5, 3.5]]
closed = true

[[box]]
x = {X}
y = {Y}
length = {LENGTH}
width = {WIDTH}
yaw = 30.0
"""


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of the sweeps and of the objects of the drive."""
    folder = tmp_path_factory.mktemp("drive")
    (folder / "box.toml").write_text(SCENE, encoding="utf-8")
    simulate(folder / "box.toml", folder / "box.bag")
    assert run(["-q", "detect", str(folder / "box.bag"), "-o", str(folder)]) == 0
    sweeps, objects = (pq.read_table(folder / f"box.{name}.parquet").to_pylist() for name in ("sweeps", "objects"))
    return sweeps, objects


def incidence(sweep: dict[str, Any]) -> float:
    """The flatter of the angles at which the sensor looks at the middle of the two near faces; 90° if it sees but one."""
    dx, dy = sweep["pose_x"] - X, sweep["pose_y"] - Y
    along = abs(np.cos(YAW) * dx + np.sin(YAW) * dy)
    across = abs(np.cos(YAW) * dy - np.sin(YAW) * dx)
    angles = np.arctan2(across, along - LENGTH / 2), np.arctan2(along, across - WIDTH / 2)
    return float(np.rad2deg(min(max(angles), np.pi / 2)))


def corners() -> Float64:
    """(4, 2) the true corners of the box in the world."""
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * (LENGTH / 2, WIDTH / 2)
    turn = np.array([[np.cos(YAW), -np.sin(YAW)], [np.sin(YAW), np.cos(YAW)]])
    return signs @ turn.T + (X, Y)


def test_the_box_is_all_there_is(tables: tuple[list[dict[str, Any]], list[dict[str, Any]]]) -> None:
    sweeps, objects = tables
    assert [row["sweep"] for row in objects] == [row["sweep"] for row in sweeps] == list(range(150))


def test_its_centre_stays_where_two_faces_show(tables: tuple[list[dict[str, Any]], list[dict[str, Any]]]) -> None:
    sweeps, objects = tables
    misses = [
        np.hypot(row["world_x"] - X, row["world_y"] - Y)
        for sweep, row in zip(sweeps, objects, strict=True)
        if incidence(sweep) < 80.0
    ]
    assert len(misses) > 70
    assert max(misses) < NEAR
    assert np.median(misses) < 0.01


def test_its_near_corner_stays_wherever_two_faces_are_found(
    tables: tuple[list[dict[str, Any]], list[dict[str, Any]]],
) -> None:
    sweeps, objects = tables
    misses = []
    for sweep, row in zip(sweeps, objects, strict=True):
        inner = [vertex for vertex in row["vertices"] if vertex["kind"] == "corner"]
        if len(row["faces"]) != 2 or len(inner) != 1:
            continue
        bearing = sweep["pose_yaw"] + inner[0]["theta"]
        place = np.array([sweep["pose_x"], sweep["pose_y"]])
        place += inner[0]["r"] * np.array([np.cos(bearing), np.sin(bearing)])
        misses.append(np.hypot(*(corners() - place).T).min())
    assert len(misses) > 110
    assert max(misses) < NEAR


def test_its_direction_stays(tables: tuple[list[dict[str, Any]], list[dict[str, Any]]]) -> None:
    sweeps, objects = tables
    turns = [
        abs(np.sin(row["world_yaw"] - YAW)) for sweep, row in zip(sweeps, objects, strict=True) if incidence(sweep) < 75.0
    ]
    assert max(turns) < np.deg2rad(1.0)
