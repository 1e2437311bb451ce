"""Zones over whole simulated logs: people, walls and robots whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.formalism.tracking.tracker import share_moving
from lidarcli.reports.zones import figures_of, zones_in
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry
from lidarcli.sweeps.types import Float64
from tests.places import REAL_LOGS, needs_real_logs
from tests.zones.runs import (
    column,
    odometry_of,
    rows,
    scans,
    scene_of,
    sound,
    sweeps_of,
    walker,
    watched,
    where,
    write_bag,
    zone_file,
)

CIRCLE = """
[[zone]]
name = "circle"
circle = { x = 3.0, y = 0.0, radius = 1.0 }
min_points = 1
hold = 0.3
"""


@pytest.fixture(scope="module")
def passed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Float64]:
    """A log of somebody who walks through a circle, and (S, 2) where he is."""
    person = walker((4.0, -3.0), (2.0, 3.5))
    scene = scene_of(person, sweeps=90)
    return write_bag(tmp_path_factory.mktemp("passed") / "a.bag", scans(sweeps_of(scene))), where(person, scene)


def test_somebody_walks_through_a_circle(passed: tuple[Path, Float64]) -> None:
    log, place = passed
    tables = watched(log, CIRCLE)
    away = np.hypot(place[:, 0] - 3.0, place[:, 1]) - 1.0
    (visit,) = rows(tables.events, kind="visit")
    assert abs(visit["first_sweep"] - np.flatnonzero(away < 0.0)[0]) <= 1
    assert abs(visit["last_sweep"] - np.flatnonzero(away <= 0.1)[-1]) <= 1
    assert (visit["set"], visit["agents"], visit["cut"], visit["points"]) == ("A", 1, False, None)
    assert visit["t"] == pytest.approx(visit["first_sweep"] * 0.1)
    assert visit["duration"] == pytest.approx((visit["last_sweep"] - visit["first_sweep"]) * 0.1)
    assert visit["sweeps"] == visit["last_sweep"] - visit["first_sweep"] + 1
    nearest = np.hypot(*place[visit["first_sweep"] : visit["last_sweep"] + 1].T).min()
    assert visit["nearest"] == pytest.approx(nearest, abs=0.1)

    # Legs reach up to 0.45 m beyond the middle of the body.
    (event,) = rows(tables.events, kind="occupied")
    begins, ends = np.flatnonzero(away < 0.45)[[0, -1]]
    assert begins <= event["first_sweep"] <= visit["first_sweep"] + 1
    assert visit["last_sweep"] - 2 <= event["last_sweep"] <= ends
    assert (event["set"], event["track"], event["agents"]) == ("A", visit["track"], 1)
    assert event["nearest"] == pytest.approx(np.hypot(event["x"], event["y"]), abs=1e-4)
    assert event["bearing"] == pytest.approx(np.arctan2(event["y"], event["x"]), abs=1e-4)

    # The rows of the table of zones are those of the events.
    table = tables.zones.to_pydict()
    assert table["sweep"] == [*range(90)]
    assert np.flatnonzero(table["active"]).tolist() == [*range(event["first_sweep"], event["last_sweep"] + 1)]
    enough = np.flatnonzero(np.array(table["points"]) >= 1)
    assert (enough[0], enough[-1]) == (event["first_sweep"], event["last_sweep"])
    assert max(table["points"]) == event["points"]
    assert min(value for value in table["nearest"] if value is not None) == pytest.approx(event["nearest"])
    inside = np.flatnonzero(table["agents"])
    assert set(inside) >= set(range(visit["first_sweep"], visit["last_sweep"] + 1))
    assert max(table["agents"]) == max(table["things"]) == 1
    assert table["masked"] == [0] * 90
    assert set(table["observed"]) == {True}


@pytest.mark.slow
def test_things_and_agents_count_alone_where_a_zone_asks_for_them(tmp_path: Path) -> None:
    scene = scene_of(walker((3.5, -3.0), (3.0, 3.5)), make.box(3.0, 0.0, 0.4, 0.4), sweeps=70)
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene)))
    zones = "".join(
        f'[[zone]]\nname = "{count}"\ncount = "{count}"\nmin_points = 1\n'
        "polygon = [[2.0, -1.0], [9.0, -1.0], [9.0, 1.0], [2.0, 1.0]]\n"
        for count in ("beams", "things", "agents")
    )
    tables = watched(log, zones)
    points = {name: np.array(column(tables.zones, "points", zone=name)) for name in ("beams", "things", "agents")}
    assert (points["beams"] > points["things"]).all(), "the wall is at 8 m"
    assert (points["things"] >= points["agents"]).all()
    assert points["things"][5] > 4, "the box"
    assert points["agents"][5] == 0
    assert points["agents"].max() > 4
    assert {event["set"] for event in rows(tables.events, zone="agents", kind="occupied")} == {"A"}
    (always,) = rows(tables.events, zone="things", kind="occupied")
    assert (always["first_sweep"], always["last_sweep"], always["cut"]) == (0, 69, True)


def driving(tmp_path: Path, sweeps: int = 120, **odometry: Any) -> tuple[Path, Float64]:
    """A robot that drives along the wall at y = 1.5 m, at 0.5 m/s from x = -3; and (S, 3) its poses."""
    path = Course(np.array([[-3.0, 0.0], [3.0, 0.0], [3.0, -5.0], [-3.0, -5.0]]), speed=0.5)
    room = (
        make.wall([[-5.0, 1.5], [-1.0, 1.5], [-0.5, 0.9], [0.0, 0.9], [0.5, 1.5], [5.0, 1.5], [5.0, -7.0]]),
        make.wall([[5.0, -7.0], [-5.0, -7.0], [-5.0, 1.5]]),
        make.box(2.0, -0.8, 0.4, 0.4),
    )
    scene = scene_of(room=room, path=path, odometry=Odometry(**odometry), sweeps=sweeps)
    log = write_bag(tmp_path / "drive.bag", scans(sweeps_of(scene), odometry_of(scene)))
    return log, path.poses(np.arange(sweeps) / 10.0)


BESIDE = """
[[zone]]
name = "left"
frame = "robot"
polygon = [[-0.3, 0.0], [0.3, 0.0], [0.3, 1.2], [-0.3, 1.2]]
[[zone]]
name = "right"
frame = "robot"
action = "stop"
polygon = [[-0.3, 0.0], [0.3, 0.0], [0.3, -0.8], [-0.3, -0.8]]
[[zone]]
name = "bulge"
frame = "world"
circle = { x = -0.25, y = 0.9, radius = 0.4 }
"""


def without(table: pa.Table, *names: str) -> list[dict[str, Any]]:
    return table.drop_columns([*names]).to_pylist()


@pytest.mark.slow
def test_a_drive_beside_a_wall(tmp_path: Path) -> None:
    log, poses = driving(tmp_path)
    tables = watched(log, BESIDE)
    (left,) = rows(tables.events, zone="left")
    assert (left["set"], left["kind"], left["track"], left["speed"]) == (
        "S",
        "occupied",
        None,
        pytest.approx(0.5, abs=0.02),
    )
    # The bulge of the wall is nearer than 1.2 m from x = -0.75 to 0.25; the zone reaches 0.3 m ahead and behind.
    ahead = np.flatnonzero((poses[:, 0] > -1.05) & (poses[:, 0] < 0.55))
    assert abs(left["first_sweep"] - ahead[0]) <= 2
    assert abs(left["last_sweep"] - ahead[-1]) <= 2
    assert left["nearest"] == pytest.approx(0.9, abs=0.02)
    assert left["bearing"] == pytest.approx(np.pi / 2, abs=0.1)
    (right,) = rows(tables.events, zone="right")
    assert (right["set"], right["action"], right["nearest"]) == ("O", "stop", pytest.approx(0.6, abs=0.02))
    world = rows(tables.events, zone="bulge")
    assert {event["set"] for event in world} == {"S"}
    assert all(np.hypot(event["x"] + 0.25, event["y"] - 0.9) < 0.4 for event in world)

    # The same from tables that detect and track have written.
    for command in ("detect", "track"):
        folder = tmp_path / command
        assert run(["-q", command, str(log), "-o", str(folder)]) == 0
        told = watched(log, BESIDE, objects=folder / "drive.objects.parquet")
        assert without(told.events, "track", "agents") == without(tables.events, "track", "agents")
        assert without(told.zones, "agents", "things") == without(tables.zones, "agents", "things")
        if command == "track":
            assert told == tables


@pytest.mark.slow
def test_a_zone_in_the_world_while_the_robot_drives(tmp_path: Path) -> None:
    log, poses = driving(tmp_path)
    told = watched(log, BESIDE, no_objects=True)
    by_name = watched(log, BESIDE.replace('"world"', '"odom"'), no_objects=True)
    assert by_name.zones == told.zones
    assert by_name.events == told.events
    points = np.array(column(told.zones, "points", zone="bulge"))
    expected = []
    for batch in lidarcli.read(log):
        pose = poses[batch.sweep]
        bearing = batch.bearings + pose[:, 2:]
        x = pose[:, :1] + batch.ranges * np.cos(bearing)
        y = pose[:, 1:2] + batch.ranges * np.sin(bearing)
        expected += np.sum(np.hypot(x + 0.25, y - 0.9) < 0.4, axis=1).tolist()
    assert np.abs(points - expected).max() <= 1, "points on the edge"
    matched = watched(log, BESIDE.replace("x = -0.25, y = 0.9", "x = 2.75, y = 0.9"), no_objects=True, pose="match")
    found = np.array(column(matched.zones, "points", zone="bulge"))
    assert np.abs(found - expected).max() <= 12, "the path that sweeps tell begins at 0"
    assert column(matched.events, "first_sweep", zone="bulge")[:1] == column(told.events, "first_sweep", zone="bulge")[:1]


@pytest.mark.slow
def test_visits_of_several_people(tmp_path: Path) -> None:
    """12 people on drawn ways through a circle, three at a time: they enter and leave by their exact paths."""
    rng = np.random.default_rng(8)
    wrong = []
    for number in range(4):
        people = []
        for side in range(3):
            # Each crosses a circle of his own.
            turn = rng.uniform(-0.6, 0.6)
            across = np.array([np.cos(turn), np.sin(turn)])
            middle = np.array([[3.5, 0.0], [-1.8, 3.0], [-1.8, -3.0]][side]) + rng.uniform(-0.3, 0.3, 2)
            away = np.array([-across[1], across[0]]) if side == 0 else across
            begin, end = middle - 2.2 * away, middle + 2.2 * away
            people.append(walker(tuple(begin), tuple(end), speed=float(rng.uniform(0.6, 1.3))))
        scene = scene_of(*people, sweeps=90)
        log = write_bag(tmp_path / f"{number}.bag", scans(sweeps_of(scene, number)))
        centres = [[3.5, 0.0], [-1.8, 3.0], [-1.8, -3.0]]
        zones = "".join(
            f'[[zone]]\nname = "{side}"\ncircle = {{ x = {x}, y = {y}, radius = 1.1 }}\n'
            for side, (x, y) in enumerate(centres)
        )
        tables = watched(log, zones)
        for side, (person, centre) in enumerate(zip(people, centres, strict=True)):
            away_from = np.hypot(*(where(person, scene) - centre).T) - 1.1
            begins, ends = np.flatnonzero(away_from < 0.0)[0], np.flatnonzero(away_from <= 0.1)[-1]
            found = [
                (event["first_sweep"], event["last_sweep"]) for event in rows(tables.events, zone=str(side), kind="visit")
            ]
            if len(found) != 1 or max(abs(found[0][0] - begins), abs(found[0][1] - ends)) > 1:
                wrong.append((number, side, found, (int(begins), int(ends))))
    assert wrong == []


@pytest.mark.slow
def test_a_visit_goes_on_while_its_agent_is_hidden(tmp_path: Path) -> None:
    person = walker((4.0, -3.0), (4.0, 3.0))
    scene = scene_of(person, make.box(2.0, 0.0, 0.1, 0.3), sweeps=65)
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene)))
    zone = CIRCLE.replace("x = 3.0", "x = 4.0").replace("radius = 1.0", "radius = 1.2") + 'count = "agents"\n'
    tables = watched(log, zone)
    (visit,) = rows(tables.events, kind="visit")
    away = np.abs(where(person, scene)[:, 1]) - 1.2
    assert abs(visit["first_sweep"] - np.flatnonzero(away < 0.0)[0]) <= 1
    assert abs(visit["last_sweep"] - np.flatnonzero(away <= 0.1)[-1]) <= 1
    points, agents = (np.array(column(tables.zones, name)) for name in ("points", "agents"))
    during = slice(visit["first_sweep"], visit["last_sweep"] + 1)
    behind = points[during] == 0
    assert np.count_nonzero(behind) >= 2, "behind the box"
    assert agents[during].tolist() == (~behind).astype(int).tolist()
    assert visit["sweeps"] == np.count_nonzero(~behind)
    # A step counts as hidden that begins or ends out of sight.
    dark = np.count_nonzero(behind[1:] | behind[:-1])
    assert visit["hidden"] == pytest.approx(dark * visit["duration"] / (len(behind) - 1))
    figures = figures_of(zones_in({0: tables}))
    assert figures["zones.circle.dwell.max"] == pytest.approx(visit["duration"] - visit["hidden"])
    assert set(column(tables.zones, "observed")) == {True}, "in part, while the agent is behind the box"


@pytest.mark.slow
def test_visits_and_crossings_need_sweeps_that_see_the_agent(tmp_path: Path) -> None:
    """A wide box hides two metres of the way, with a circle and a line; a circle before it ends in the shadow."""
    person = walker((4.0, -3.0), (4.0, 3.0))
    scene = scene_of(person, make.box(2.0, 0.0, 0.1, 1.0), sweeps=65)
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene)))
    tables = watched(
        log,
        """
        [[zone]]
        name = "shadow"
        circle = { x = 4.0, y = 0.0, radius = 0.2 }
        [[zone]]
        name = "edge"
        circle = { x = 4.0, y = -0.9, radius = 0.8 }
        [[zone]]
        name = "line"
        line = [[3.0, 0.0], [5.0, 0.0]]
        """,
    )
    place = where(person, scene)
    # The edges of the box lie before y = -1 and y = 1 of the way; legs are up to half a metre apart.
    assert set(column(tables.zones, "agents", zone="shadow")) == {0}
    assert rows(tables.events, zone="shadow") == []
    (visit,) = rows(tables.events, zone="edge", kind="visit")
    away = np.abs(place[:, 1] + 0.9) - 0.8
    assert abs(visit["first_sweep"] - np.flatnonzero(away < 0.0)[0]) <= 1
    # It ends where the agent is seen last, at the edge of the shadow.
    assert abs(visit["last_sweep"] - np.flatnonzero(place[:, 1] < -0.9)[-1]) <= 3
    assert rows(tables.events, zone="line") == []


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--pose", "none")], ids=["told", "none"])
def test_a_crowd_is_no_fault_of_the_poses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...]
) -> None:
    """Many tracks move before a sensor at rest, which is no reason to doubt its poses."""
    people = [walker((1.5 + k, -5.0 + k), (1.5 + k, 5.0)) for k in range(5)]
    scene = scene_of(*people, sweeps=70, odometry=Odometry())
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
    assert run(["track", str(log), *more, "-o", str(tmp_path)]) == 0
    tracks = pq.read_table(tmp_path / "a.tracks.parquet").to_pydict()
    assert share_moving(tracks["sweeps"], [kind == "A" for kind in tracks["set"]]) is not None
    assert "do not trust" not in "".join(capsys.readouterr())


NAV2 = """
monitor:
  ros__parameters:
    base_frame_id: base_laser_link
    observation_sources: [scan]
    scan: {type: scan, topic: /scan}
    polygons: [half, once, twice, thrice]
    half: {type: circle, radius: 0.5, action_type: stop, min_points: 4}
    once: {type: circle, radius: 1.0, action_type: stop, min_points: 4}
    twice: {type: circle, radius: 1.0, action_type: stop, min_points: 4,
      trigger_consecutive_points: 2, release_consecutive_points: 2}
    thrice: {type: circle, radius: 1.0, action_type: stop, min_points: 4,
      release_consecutive_points: 3}
"""


@needs_real_logs
@pytest.mark.slow
def test_a_robot_that_a_person_walks_around(tmp_path: Path) -> None:
    """Figures that were counted independently."""
    log, zones = REAL_LOGS / "comprobo24" / "test-bag", zone_file(tmp_path, NAV2, "nav2.yaml")
    tables = sound(lidarcli.zones(log, zones=str(zones), topic=["/scan"], no_objects=True, pose="none"))
    first, second = rows(tables.events, zone="half")
    assert (first["t"], first["duration"]) == (pytest.approx(26.194, abs=1e-3), pytest.approx(3.343, abs=1e-3))
    assert (first["points"], first["nearest"]) == (26, pytest.approx(0.324))
    assert (second["t"], second["points"], second["nearest"]) == (pytest.approx(32.462, abs=1e-3), 5, pytest.approx(0.494))
    assert [len(rows(tables.events, zone=name)) for name in ("once", "twice", "thrice")] == [7, 3, 2]
