"""A robot drives and turns while its sensor sweeps: things that stand stay where they are, as far as beams tell."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.mapping.grid import compare
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.truth import true_map
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import Float64, SweepBatch, concatenate
from tests.formalism.tracking.following import TrackedLog, follow
from tests.going import SENSORS, Drive, in_the_world, seen_going, told_backwards

BEAMS = 720
THINGS = ((2.8, 0.5, 0.25), (-1.2, 2.6, 0.2), (-2.5, -1.5, 0.25), (0.8, -2.6, 0.15))
"""x, y, radius of columns that stand [m]."""
SCENE = """
[scene]
name = "columns"
sweeps = 126

[sensor]
beams = {beams}
fov = 360
noise = 0.005
rate = 10.0
time_increment = {increment}
clockwise = {clockwise}

# 1 m/s and 60 degrees a second, twice around.
[robot]
super_ellipse = {{ a = 1.3, b = 0.7, exponent = 2.0 }}
speed = 1.0

[robot.odometry]

[[wall]]
points = [[-5.0, -4.5], [5.0, -4.5], [5.0, 4.5], [-5.0, 4.5]]
closed = true
""" + "".join(f"\n[[cylinder]]\nx = {x}\ny = {y}\nradius = {radius}\n" for x, y, radius in THINGS)


@dataclass(frozen=True)
class Logs:
    """Logs of one drive."""

    folder: Path

    def made(
        self, increment: float = 0.1 / BEAMS, clockwise: bool = False, unplaced: int = 0, scan_time: float | None = None
    ) -> Path:
        """The log of a sensor; of the first `unplaced` sweeps nobody tells a pose. `scan_time` is that of all headers."""
        name = f"{increment:.6f}{clockwise}{unplaced}{scan_time}"
        path = self.folder / f"{name}.mcap"
        if not path.exists():
            scene = self.folder / f"{name}.toml"
            scene.write_text(
                SCENE.format(beams=BEAMS, increment=increment, clockwise=str(clockwise).lower()), encoding="utf-8"
            )
            loaded = load_scene(scene)
            poses = simulate_odometry(loaded, loaded.sweeps, 0)
            assert poses is not None
            rows = slice(unplaced, None)
            poses = replace(
                poses,
                stamp_ns=poses.stamp_ns[rows],
                poses=poses.poses[rows],
                speed=poses.speed[rows],
                yaw_rate=poses.yaw_rate[rows],
            )
            raw = concatenate([block.raw for block in simulate_blocks(loaded, loaded.sweeps, 0)])
            if scan_time is not None:
                raw = replace(raw, scan_time=np.full(len(raw), scan_time, np.float32))
            write_log(path, [raw], poses=poses)
        return path


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Logs:
    """Logs of the drive, each made when it is first asked for."""
    return Logs(tmp_path_factory.mktemp("drives"))


def misses(table: pa.Table) -> Float64:
    """(K,) how far the box of each object of a column is from that column [m]."""
    x, y = (np.array(table[name].to_pylist(), float) for name in ("world_x", "world_y"))
    away: Float64 = np.hypot(*(values[:, None] - np.array(THINGS)[:, axis] for axis, values in enumerate((x, y))))
    nearest = away.min(axis=1)
    return nearest[nearest < 0.6]


@pytest.mark.parametrize("clockwise", [False, True])
def test_what_stands_is_found_where_it_stands(drives: Logs, clockwise: bool) -> None:
    log = drives.made(clockwise=clockwise)
    # The end of the last sweep is after the last pose, so that it is left out here.
    right, wrong = (misses(lidarcli.detect(log, end=12.45, deskew=deskew)) for deskew in (True, False))
    assert min(len(right), len(wrong)) > 4 * 115
    # Seen are 1 and 10 cm.
    assert np.median(right) < 0.015
    assert np.median(wrong) > 0.06
    assert np.quantile(right, 0.9) < 0.045
    assert np.quantile(wrong, 0.9) > 0.2
    assert np.mean(right) < 0.25 * np.mean(wrong)


@pytest.mark.parametrize("clockwise", [False, True])
def test_what_stands_is_followed_as_standing(drives: Logs, clockwise: bool) -> None:
    log = drives.made(clockwise=clockwise)
    found = lidarcli.track(log, end=12.35)
    tracks = [row for row in found.tracks.to_pylist() if row["sweeps"] > 20]
    assert sorted(row["sweeps"] for row in tracks)[0] > 115
    assert {row["set"] for row in tracks} == {"O"}
    assert len(tracks) == len(THINGS)
    for row in tracks:
        away = np.hypot(*(np.array(THINGS)[:, :2] - (row["x"], row["y"])).T)
        assert away.min() < 0.03
        assert row["length"] == pytest.approx(2 * THINGS[int(away.argmin())][2], abs=0.04)
    skewed = lidarcli.track(log, end=12.35, deskew=False).tracks.to_pylist()
    # Without it some are told to stand elsewhere.
    away = [np.hypot(*(np.array(THINGS)[:, :2] - (row["x"], row["y"])).T).min() for row in skewed if row["sweeps"] > 20]
    assert max(away) > 0.1


@pytest.mark.parametrize("command", ["detect", "track"])
def test_sweeps_that_take_no_time_are_the_same_either_way(drives: Logs, tmp_path: Path, command: str) -> None:
    log = drives.made(0.0)
    folders = [tmp_path / name for name in ("on", "off")]
    for folder, options in zip(folders, ((), ("--no-deskew",)), strict=True):
        assert run(["-q", command, str(log), "-o", str(folder), *options]) == 0
    names = sorted(path.name for path in folders[0].glob("*.parquet"))
    assert len(names) >= 2
    for name in names:
        on, off = (pq.read_table(folder / name) for folder in folders)
        assert on.replace_schema_metadata() == off.replace_schema_metadata()
        # The metadata say so only when it is off.
        told = [json.loads(table.schema.metadata[b"lidarcli.parameters"]) for table in (on, off)]
        assert told[0] == {name: value for name, value in told[1].items() if name != "deskew"}
        assert told[1]["deskew"] is False


def test_the_time_between_sweeps_moves_no_beam(drives: Logs) -> None:
    """Of a sensor whose sweeps are taken at once some drivers tell `scan_time` all the same."""
    log = drives.made(0.0, scan_time=0.1)
    found = lidarcli.track(log)
    assert set(found.objects["set"].to_pylist()) == {"O"}
    assert found.tracks.num_rows == len(THINGS)
    assert found.objects.num_rows > 4 * 115
    truth = true_map(load_scene(log.with_suffix(".toml")), 126, 0.05)
    assert compare(lidarcli.map(log), truth).f1 > 0.99


def test_detections_are_the_same_but_for_their_place_in_the_world(drives: Logs) -> None:
    on, off = (lidarcli.detect(drives.made(), deskew=deskew) for deskew in (True, False))
    world = [name for name in on.schema.names if name.startswith("world_")]
    assert on.drop(world).replace_schema_metadata() == off.drop(world).replace_schema_metadata()
    assert len(world) == 3
    assert not np.allclose(on["world_x"].to_numpy(), off["world_x"].to_numpy(), equal_nan=True, atol=0.1)


def test_sweeps_before_the_first_pose_are_no_trouble(drives: Logs) -> None:
    log = drives.made(unplaced=7)
    table = lidarcli.detect(log)
    # The first pose holds for a sweep before.
    early = np.array(table["sweep"].to_pylist()) < 6
    assert early.any()
    x = table["world_x"].to_pylist()
    assert {x[k] is None for k in np.flatnonzero(early)} == {True}
    assert None not in [x[k] for k in np.flatnonzero(~early)]
    (background,) = lidarcli.background(log)
    assert int(background.sweeps.sum()) == 126 - 6
    assert np.isfinite(background.poses.x).all()
    assert np.nanmean(background.support) > 0.9


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_background_of_the_drive_is_where_the_walls_are(drives: Logs, clockwise: bool) -> None:
    # Sweeps of one place are skewed alike, and agree with each other: only the world shows it. Seen are 5 and 65 mm.
    away = []
    for deskew in (True, False):
        (background,) = lidarcli.background(drives.made(clockwise=clockwise), deskew=deskew)
        assert background.poses.way is None
        theta = background.grid.bearings + background.poses.yaw[:, None]
        x = background.poses.x[:, None] + background.r_e * np.cos(theta)
        y = background.poses.y[:, None] + background.r_e * np.sin(theta)
        known = np.isfinite(background.r_e)
        assert known.mean() > 0.9
        away.append(away_from_all(np.column_stack([x[known], y[known]])))
    right, wrong = away
    assert np.median(right) < 0.012
    assert np.median(wrong) > 0.04
    assert np.mean(right) < 0.2 * np.mean(wrong)


# Sweeps in memory, whose sensor goes evenly: everything is known.

EVENLY = Drive((-0.4, 0.2, 0.3), (0.8, -0.6, np.radians(60)))
"""1 m/s and 60 degrees a second."""


def going(name: str, upside_down: bool = False, sweeps: int = 15) -> SweepBatch:
    columns = [make.cylinder(*thing) for thing in THINGS]
    walls = make.wall([[-5, -4.5], [5, -4.5], [5, 4.5], [-5, 4.5], [-5, -4.5]])
    return seen_going(SENSORS[name], EVENLY, walls, *columns, sweeps=sweeps, upside_down=upside_down)


def places_of(batch: SweepBatch) -> Float64:
    """(K,) how far objects are from the nearest column [m], for those of a column."""
    found = detect(batch, Parameters())
    assert batch.poses is not None
    boxes = found.box_x, found.box_y, found.box_yaw
    x, y, _ = batch.poses.to_world(found.row, *boxes, found.shares(batch))
    away = np.hypot(x[:, None] - np.array(THINGS)[:, 0], y[:, None] - np.array(THINGS)[:, 1]).min(axis=1)
    return away[away < 0.5]


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
def test_every_point_of_a_sweep_is_where_something_stands(sensor: str, upside_down: bool) -> None:
    batch = going(sensor, upside_down)
    for row in range(len(batch)):
        points = in_the_world(batch, row)
        assert away_from_all(points).max() < 1e-5
    skewed = replace(batch, poses=replace(batch.poses, way=None))  # type: ignore[type-var]
    assert np.median(away_from_all(in_the_world(skewed, 3))) > 0.02


def away_from_all(points: Float64) -> Float64:
    """(K,) how far points are from the nearest wall or column [m]."""
    x, y = points.T
    away = [np.abs(5.0 - np.abs(x)), np.abs(4.5 - np.abs(y))]
    away += [np.abs(np.hypot(x - column[0], y - column[1]) - column[2]) for column in THINGS]
    nearest: Float64 = np.min(away, axis=0)
    return nearest


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
def test_objects_of_any_sensor_are_where_they_stand(sensor: str, upside_down: bool) -> None:
    batch = going(sensor, upside_down)
    backwards = told_backwards(batch)
    for each in (batch, backwards):
        away = places_of(each)
        assert len(away) > 30
        assert np.median(away) < 0.01
        assert np.quantile(away, 0.85) < 0.05
        assert np.median(places_of(replace(each, poses=replace(each.poses, way=None)))) > 0.06  # type: ignore[type-var]


@pytest.mark.parametrize("told", ["forwards", "backwards"])
@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
def test_nothing_that_stands_moves(sensor: str, upside_down: bool, told: str) -> None:
    batch = going(sensor, upside_down, sweeps=60)
    followed = follow(batch if told == "forwards" else told_backwards(batch))
    lasting = followed.tracks.sweeps > 15
    assert not followed.tracks.moved[lasting].any()
    x, y = followed.tracks.x[lasting], followed.tracks.y[lasting]
    away = np.hypot(x[:, None] - np.array(THINGS)[:, 0], y[:, None] - np.array(THINGS)[:, 1])
    near = away.min(axis=1) < 0.5
    assert near.sum() >= 2
    assert np.median(away.min(axis=1)[near]) < 0.03
    assert spreads(followed) < 0.03


def spreads(followed: TrackedLog) -> float:
    """The greatest speed, in the middle of all, at which standing things seem to go [m/s]."""
    known = followed.columns["track"] > 0
    speed = np.hypot(followed.columns["vx"][known], followed.columns["vy"][known])
    return float(np.median(speed))


def test_what_crosses_the_seam_is_seen_at_its_middle() -> None:
    batch = going("full turn", sweeps=2)
    found = detect(batch, Parameters())
    keep = np.zeros(2, np.int64)
    seam = replace(found, row=keep, beam_i=np.array([700, 716]), beam_f=np.array([10, 3]))
    # From 700 on it is 15 beams to the middle of 30, from 716 on 3.5 of 7.
    assert seam.shares(batch).tolist() == pytest.approx([715 / 719, 719.5 / 719])
