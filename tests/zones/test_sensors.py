"""Several sensors, mounts, masks and shapes that topics tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import NoScanError, OptionError
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS
from lidarcli.simulation.scene import Course, Scene
from lidarcli.sweeps.types import TURN, RawSweeps
from tests.cli.maps import Run
from tests.sweeping import STEP, raw_sweeps
from tests.zones.runs import (
    SENSOR,
    column,
    polygon_at,
    rows,
    scans,
    scene_of,
    sound,
    sweeps_of,
    times_of,
    transform_at,
    twists,
    walker,
    watched,
    where,
    write_bag,
    zone_file,
)

FRONT, REAR = (0.4, 0.0, 0.0), (-0.4, 0.1, 3.0)
"""Places of two lasers on a robot: x, y, yaw."""
TWO_MOUNTS = "".join(
    f'[[mount]]\nframe = "{name}"\nparent = "base_link"\nx = {x}\ny = {y}\nyaw = {np.degrees(yaw)}\n'
    for name, (x, y, yaw) in (("front", FRONT), ("rear", REAR))
)


def sensor_at(place: tuple[float, float, float], name: str, scene: Scene, seed: int) -> list[RawSweeps]:
    """The sweeps of a scene from one of two lasers; those of the rear one come 30 ms later."""
    here = Course(np.array([place[:2]]), 0.0, place[2])
    sensor = replace(scene.sensor, topic=f"/scan_{name}", frame_id=name)
    blocks = sweeps_of(replace(scene, path=here, sensor=sensor), seed)
    late = 30_000_000 if name == "rear" else 0
    return [replace(block, stamp_ns=block.stamp_ns + late, record_ns=block.record_ns + late) for block in blocks]


def two(path: Path, scene: Scene, *more: Any, rear_until: int | None = None) -> Path:
    """A log of two lasers, of which the rear one falls silent after some sweeps."""
    front, rear = (
        sensor_at(place, name, scene, seed) for seed, (place, name) in enumerate([(FRONT, "front"), (REAR, "rear")])
    )
    if rear_until is not None:
        rear = [block.rows(np.arange(min(rear_until, len(block)))) for block in rear]
    return write_bag(path, scans(front), scans(rear), *more)


def points_by_hand(log: Path, x: float, y: float, radius: float) -> dict[str, list[int]]:
    """Topic → points of each sweep in a circle of the robot."""
    found: dict[str, list[int]] = {}
    for batch in lidarcli.read(log):
        place = FRONT if batch.topic == "/scan_front" else REAR
        bearing = batch.bearings + place[2]
        px, py = place[0] + batch.ranges * np.cos(bearing), place[1] + batch.ranges * np.sin(bearing)
        found.setdefault(batch.topic, []).extend(np.sum(np.hypot(px - x, py - y) < radius, axis=1).tolist())
    return found


ROBOT_CIRCLE = """
[[zone]]
name = "near"
frame = "robot"
circle = { x = 0.0, y = 1.5, radius = 0.8 }
"""


@pytest.mark.parametrize("told_by", ["file", "tf"])
def test_points_of_two_lasers_are_added(told_by: str, tmp_path: Path) -> None:
    scene = scene_of(make.cylinder(0.0, 1.5, 0.3), sweeps=20)
    links = [transform_at(START_NS, "base_link", name, place) for name, place in (("front", FRONT), ("rear", REAR))]
    log = two(tmp_path / "two.bag", scene, links if told_by == "tf" else [])
    tables = watched(log, (TWO_MOUNTS if told_by == "file" else "") + ROBOT_CIRCLE, no_objects=True)
    own = points_by_hand(log, 0.0, 1.5, 0.8)
    front, rear = np.array(own["/scan_front"]), np.array(own["/scan_rear"])
    assert min(front.min(), rear.min()) > 10
    # The front one comes first; the rear one is then 70 ms old.
    expected = front + np.concatenate([[0], rear[:-1]])
    assert column(tables.zones, "points", topic="/scan_front") == expected.tolist()
    assert column(tables.zones, "points", topic="/scan_rear") == (front + rear).tolist()
    (event,) = tables.events.to_pylist()
    assert (event["points"], event["cut"], event["sweeps"]) == (max(expected.max(), (front + rear).max()), True, 40)
    assert event["x"] ** 2 + (event["y"] - 1.5) ** 2 == pytest.approx(0.3**2, abs=0.02)


def test_a_mount_that_is_told_twice_is_noted(lidarcli: Run, tmp_path: Path) -> None:
    links = [transform_at(START_NS + at, "base_link", "laser", (float(at), 0.0, 0.0)) for at in (0, 3)]
    log = write_bag(tmp_path / "run.bag", scans(sweeps_of(scene_of(sweeps=3))), links)
    ran = lidarcli("zones", log, "--zones", zone_file(tmp_path, ROBOT_CIRCLE), "--no-objects")
    assert ran.err.count("note     /tf_static: laser is told at two places in base_link: the last counts") == 1


@pytest.mark.parametrize("named", ["by their frames", "by their namespaces"])
@pytest.mark.parametrize("frame", ["robot", "base_link"])
def test_each_of_two_robots_has_the_zone(named: str, frame: str, tmp_path: Path) -> None:
    """Both see a cylinder in it by some beams: those of two robots are never added."""
    messages: list[Any] = []
    for robot in ("r1", "r2"):
        prefix = f"{robot}/" if named == "by their frames" else ""
        sensor = replace(SENSOR, topic=f"/{robot}/scan", frame_id=f"{prefix}laser")
        messages.append(scans(sweeps_of(scene_of(make.cylinder(0.0, 1.5, 0.3), sensor=sensor, sweeps=5))))
        link = transform_at(START_NS, f"{prefix}base_link", f"{prefix}laser", (0.0, 0.0, 0.0))
        messages.append([link if prefix else link._replace(topic=f"/{robot}/tf_static")])
    log = write_bag(tmp_path / "two.bag", *messages)
    zone = ROBOT_CIRCLE.replace('"robot"', f'"{frame}"')
    if frame == "base_link" and named == "by their frames":
        with pytest.raises(NoScanError, match="nothing leads from frame r1/laser to base_link"):
            watched(log, zone, no_objects=True)
        return
    tables = watched(log, zone, no_objects=True)
    points_of = {topic: column(tables.zones, "points", topic=topic) for topic in ("/r1/scan", "/r2/scan")}
    assert [event["points"] for event in tables.events.to_pylist()] == [max(each) for each in points_of.values()]
    assert np.ptp([*points_of.values()]) < 10


def test_two_lasers_of_which_nothing_tells_the_mount(tmp_path: Path) -> None:
    log = two(tmp_path / "two.bag", scene_of(sweeps=3))
    with pytest.raises(NoScanError) as refused:
        watched(log, ROBOT_CIRCLE, no_objects=True)
    assert '[[mount]] frame = "front" parent = "base_link"' in str(refused.value)
    with pytest.raises(NoScanError, match="nothing leads from frame front to arm"):
        watched(log, ROBOT_CIRCLE.replace('"robot"', '"arm"'), no_objects=True)


@pytest.mark.parametrize("frame", ["robot", "sensor"])
def test_one_of_two_lasers_falls_silent(frame: str, tmp_path: Path) -> None:
    scene = scene_of(make.cylinder(0.0, 1.5, 0.3), sweeps=50)
    log = two(tmp_path / "two.bag", scene, rear_until=10)
    zones = TWO_MOUNTS + ROBOT_CIRCLE.replace('"robot"', f'"{frame}"')
    tables = watched(log, zones, no_objects=True)
    (stale,) = rows(tables.events, kind="stale")
    assert (stale["topic"], stale["cut"], stale["points"], stale["nearest"]) == ("/scan_rear", True, None, None)
    # Its last sweep is that of 0.93 s, and counts for 2 s; the last one of the other laser is that of 4.9 s.
    assert (stale["t"], stale["duration"]) == (pytest.approx(2.93), pytest.approx(4.9 - 2.93))
    assert (stale["first_sweep"], stale["last_sweep"], stale["sweeps"]) == (9, 9, 0)
    if frame == "robot":
        own = points_by_hand(log, 0.0, 1.5, 0.8)
        front, rear = own["/scan_front"], own["/scan_rear"]
        assert column(tables.zones, "points", topic="/scan_front") == [
            front[k] + (rear[min(k, 10) - 1] if 0 < k < 30 else 0) for k in range(50)
        ]


@pytest.mark.slow
def test_an_agent_that_both_lasers_see_counts_once(tmp_path: Path) -> None:
    scene = scene_of(walker((3.0, 2.5), (-3.0, 2.2)), walker((-2.5, -3.0), (2.5, -3.2)), sweeps=75)
    log = two(tmp_path / "two.bag", scene)
    tables = watched(
        log,
        TWO_MOUNTS
        + """
[[zone]]
name = "left"
frame = "robot"
polygon = [[1.5, 1.0], [1.5, 4.0], [-1.5, 4.0], [-1.5, 1.0]]
[[zone]]
name = "all"
frame = "robot"
circle = { x = 0, y = 0, radius = 6 }
[[zone]]
name = "line"
frame = "robot"
line = [[0.0, 1.0], [0.0, 4.0]]
""",
    )
    (visit,) = rows(tables.events, zone="left", kind="visit")
    place = where(scene.entities[1], scene)
    inside = np.flatnonzero(np.abs(place[:, 0]) < 1.5)
    # The front one sees him first; it goes on until the other one, 30 ms later, has seen him leave.
    assert visit["t"] == pytest.approx(inside[0] / 10.0, abs=0.14)
    assert visit["t"] + visit["duration"] == pytest.approx(inside[-1] / 10.0 + 0.1, abs=0.17)
    (crossing,) = rows(tables.events, kind="crossing")
    # He goes towards -x, and the left of the way from (0, 1) to (0, 4) is -x.
    assert crossing["direction"] == "in"
    assert {event["cut"] for event in rows(tables.events, zone="all", kind="visit")} == {True}
    assert not visit["cut"]
    assert max(column(tables.zones, "agents", zone="left")) == 1
    assert max(column(tables.zones, "agents", zone="all")) == 2
    assert len(rows(tables.events, zone="all", kind="visit")) == 2
    assert max(column(tables.zones, "things", zone="left")) == 1


# What is in view.


def test_sweeps_that_turn_the_other_way_and_change_their_beams(tmp_path: Path) -> None:
    """Clockwise sweeps, of a sensor whose beam count changes, and of one that hangs head down see the same."""
    scene = scene_of(make.cylinder(2.0, 1.0, 0.4), sensor=replace(SENSOR, noise=0.0), sweeps=6)
    block = sweeps_of(scene)[0]
    backwards = replace(
        block,
        ranges=block.ranges[:, ::-1].copy(),
        angle_min=block.angle_min + 719 * block.angle_increment,
        angle_increment=-block.angle_increment,
    )
    # Every other beam of every other sweep.
    mixed = block.ranges.copy()
    mixed[::2, :360] = mixed[::2, ::2]
    mixed[::2, 360:] = np.nan
    few = np.arange(6) % 2 == 0
    changing = replace(
        block,
        ranges=mixed,
        beams=np.where(few, 360, 720).astype(np.int32),
        angle_increment=np.where(few, 2.0, 1.0) * block.angle_increment,
    )
    hanging = replace(block, ranges=block.ranges[:, (-np.arange(720)) % 720].copy())
    mount = '[[mount]]\nframe = "laser"\nparent = "base_link"\nupside_down = {}\n'
    zone = '[[zone]]\nname = "z"\nframe = "robot"\npolygon = [[1.4, 0.5], [2.5, 0.5], [2.5, 1.5], [1.4, 1.5]]\n'
    found = {}
    for name, blocks, head_down in (
        ("plain", block, "false"),
        ("backwards", backwards, "false"),
        ("changing", changing, "false"),
        ("hanging", hanging, "true"),
    ):
        log = write_bag(tmp_path / f"{name}.bag", scans([blocks]))
        found[name] = watched(log, mount.format(head_down) + zone, no_objects=True)
    plain = found["plain"]
    assert column(plain.zones, "points")[0] > 20
    for name in ("backwards", "hanging"):
        for each in ("points", "observed"):
            assert column(found[name].zones, each) == pytest.approx(column(plain.zones, each), abs=0.02), name
        (event,), (expected,) = found[name].events.to_pylist(), plain.events.to_pylist()
        for each in ("nearest", "x", "y"):
            assert event[each] == pytest.approx(expected[each], abs=1e-4), name
        side = -1.0 if name == "hanging" else 1.0
        assert event["bearing"] == pytest.approx(side * expected["bearing"], abs=1e-4)
    few_points, all_points = (np.array(column(found[name].zones, "points")) for name in ("changing", "plain"))
    assert few_points[1::2].tolist() == all_points[1::2].tolist()
    assert np.abs(few_points[::2] - all_points[::2] / 2).max() <= 1


def body(count: int = 30) -> RawSweeps:
    """A round room of 4 m, and a mast of the robot at 0.3 m behind."""
    ranges = np.full((count, 360), 4.0, np.float32)
    ranges[:, :8] = 0.3
    return raw_sweeps(ranges, stamp_ns=START_NS + STEP * np.arange(count))


MAST = "[[mask]]\ncircle = { x = -0.3, y = 0.0, radius = 0.1 }\n"
STOP = '[[zone]]\nname = "stop"\ncircle = { x = 0.0, y = 0.0, radius = 0.5 }\n'


def test_the_body_of_the_robot_with_and_without_a_mask(tmp_path: Path) -> None:
    log = write_bag(tmp_path / "a.bag", scans([body()]))
    bare = watched(log, STOP, no_objects=True)
    (event,) = bare.events.to_pylist()
    assert (event["points"], event["cut"], event["nearest"]) == (8, True, pytest.approx(0.3))
    assert set(column(bare.zones, "masked")) == {0}
    apart = zone_file(tmp_path, MAST, "mask.toml")
    for masked in (
        watched(log, STOP + MAST, no_objects=True),
        watched(log, STOP, no_objects=True, mask=str(apart)),
        watched(log, STOP, mask=str(apart)),
    ):
        assert masked.events.num_rows == 0
        assert set(column(masked.zones, "points")) == {0}
        assert set(column(masked.zones, "masked")) == {8}
        assert set(column(masked.zones, "nearest")) == {None}


def test_masks_of_the_robot_are_in_its_frame(tmp_path: Path) -> None:
    log = write_bag(tmp_path / "a.bag", scans([body()]))
    mount = '[[mount]]\nframe = "laser"\nparent = "base_link"\nx = 0.2\nyaw = 180\n'
    # The mast is at 0.3 m behind the laser, which looks back: 0.5 m ahead.
    mask = '[[mask]]\nframe = "{}"\ncircle = {{ x = {}, y = 0.0, radius = 0.1 }}\n'
    for frame, x, masked in (("base_link", 0.5, 8), ("robot", 0.5, 8), ("base_link", -0.3, 0)):
        tables = watched(log, mount + mask.format(frame, x) + STOP, no_objects=True)
        assert set(column(tables.zones, "masked")) == {masked}, (frame, x)


NAV2 = """
monitor:
  ros__parameters:
    base_frame_id: "laser"
    cmd_vel_in_topic: "cmd_vel"
    observation_sources: ["scan"]
    scan: {{ type: "scan", topic: "/scan", source_timeout: 1.0{source} }}
    polygons: ["stop"]
    stop:
      type: "{type}"
      action_type: "stop"
      min_points: 4
{shape}
"""


def cases(slow: str, fast: str) -> str:
    return f"""
      velocity_polygons: ["slow", "fast"]
      slow:
        points: "{slow}"
        linear_min: 0.0
        linear_max: 0.3
        theta_min: -1.0
        theta_max: 1.0
      fast:
        points: "{fast}"
        linear_min: 0.3
        linear_max: 1.5
        theta_min: -1.0
        theta_max: 1.0
"""


def square(size: float) -> str:
    return str([[size, size], [size, -size], [-size, -size], [-size, size]])


def test_a_velocity_polygon_by_what_the_log_tells(tmp_path: Path) -> None:
    """A post at 1 m: within the polygon of fast driving, from 1 s to 2 s; then a velocity that none covers."""
    ranges = np.full((40, 360), 4.0, np.float32)
    ranges[:, 175:185] = 1.0
    stamps = START_NS + STEP * np.arange(40)
    log = write_bag(
        tmp_path / "a.bag",
        scans([raw_sweeps(ranges, stamp_ns=stamps)]),
        twists(stamps[:10] - 1000, (0.1, 0.0, 0.0)),
        twists(stamps[10:20] - 1000, (1.0, 0.0, 0.0)),
        twists(stamps[20:30] - 1000, (0.2, 0.0, 0.0)),
        twists(stamps[30:] - 1000, (-1.0, 0.0, 0.0)),
    )
    text = NAV2.format(source="", type="velocity_polygon", shape=cases(square(0.5), square(1.2)))
    tables = lidarcli.zones(log, zones=str(zone_file(tmp_path, text, "nav2.yaml")), no_objects=True)
    assert column(tables.zones, "points") == [0] * 10 + [10] * 10 + [0] * 20
    (event,) = tables.events.to_pylist()
    assert (event["polygon"], event["first_sweep"], event["last_sweep"]) == ("fast", 10, 19)
    assert event["speed"] == pytest.approx(1.0)


TOLD = """      polygon_sub_topic: "/shape"
"""


def test_a_shape_that_a_topic_tells(tmp_path: Path) -> None:
    ranges = np.full((30, 360), 4.0, np.float32)
    ranges[:, 175:185] = 1.0
    stamps = START_NS + STEP * np.arange(30)

    def corners(size: float) -> list[tuple[float, float]]:
        return [(size, size), (size, -size), (-size, -size), (-size, size)]

    shapes = [
        polygon_at(int(stamps[at]) - 1000, "laser", corners(size), "/shape")
        for at, size in ((5, 0.5), (10, 1.2), (20, 0.5))
    ]
    sweeps = scans([raw_sweeps(ranges, stamp_ns=stamps)])
    log = write_bag(tmp_path / "a.bag", sweeps, shapes)
    text = NAV2.format(source="", type="polygon", shape=TOLD)
    file = str(zone_file(tmp_path, text, "nav2.yaml"))
    tables = lidarcli.zones(log, zones=file, no_objects=True)
    assert column(tables.zones, "points") == [0] * 10 + [10] * 10 + [0] * 10
    assert tables.events.to_pylist()[0]["polygon"] is None
    # Polygons that shake are no trouble.
    rng = np.random.default_rng(1)
    many = [polygon_at(int(at) - 1000, "laser", corners(0.9 + 0.05 * float(rng.random())), "/shape") for at in stamps]
    shaking = lidarcli.zones(write_bag(tmp_path / "b.bag", sweeps, many), zones=file, no_objects=True)
    assert set(column(shaking.zones, "points")) == {0}
    assert set(column(shaking.zones, "observed")) == {True}
    bare = write_bag(tmp_path / "c.bag", sweeps)
    with pytest.raises(NoScanError, match=r"zone 'stop' .* /shape: give --footprint"):
        lidarcli.zones(bare, zones=file, no_objects=True)
    given = lidarcli.zones(bare, zones=file, no_objects=True, footprint=square(1.2))
    assert set(column(given.zones, "points")) == {10}
    points = lidarcli.zones(bare, zones=file, no_objects=True, footprint=corners(1.2))
    assert points.zones.equals(given.zones)
    with pytest.raises(OptionError, match=r"its corners lie on one line$"):
        lidarcli.zones(bare, zones=file, no_objects=True, footprint=[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])


# Odd logs.


def test_sweeps_that_are_left_out_are_not_missed(tmp_path: Path) -> None:
    """Of every 30 sweeps of a sensor at 10 Hz one is taken: they are 3 s apart."""
    ranges = np.full((600, 90), 4.0, np.float32)
    ranges[100:400, 40:50] = 1.0
    stamps = START_NS + STEP * np.concatenate([np.arange(500), 600 + np.arange(100)])
    log = write_bag(tmp_path / "a.bag", scans([raw_sweeps(ranges, stamp_ns=stamps)]))
    zone = STOP.replace("0.5", "1.5")
    for every in (1, 30):
        events = watched(log, zone, no_objects=True, every=every).events
        (occupied,) = rows(events, kind="occupied")
        assert occupied["duration"] == pytest.approx(30.0, abs=0.11 if every == 1 else 3.01)
        (stale,) = rows(events, kind="stale")
        assert stale["t"] + stale["duration"] == pytest.approx(60.0, abs=0.01 if every == 1 else 1.01)


def test_a_clock_that_is_set_back(tmp_path: Path) -> None:
    ranges = np.full((60, 360), 4.0, np.float32)
    ranges[20:30, 175:185] = 1.0
    ranges[45:50, 175:185] = 1.0
    stamps = START_NS + STEP * np.concatenate([np.arange(40), np.arange(20) + 10])
    block = raw_sweeps(ranges, stamp_ns=stamps, record_ns=START_NS + STEP * np.arange(60))
    log = write_bag(tmp_path / "a.bag", scans([block]))
    tables = watched(log, STOP.replace("0.5", "1.5"), no_objects=True)
    assert column(tables.zones, "sweep") == [*range(60)]
    for event in tables.events.to_pylist():
        assert event["duration"] >= 0.0
        assert event["end"] >= event["start"]


def test_sweeps_without_beams_or_values(tmp_path: Path) -> None:
    ranges = np.full((9, 360), 4.0, np.float32)
    ranges[3] = np.nan
    ranges[4] = np.inf
    beams = np.full(9, 360, np.int32)
    beams[5] = 0
    beams[6] = 1
    log = write_bag(tmp_path / "a.bag", scans([raw_sweeps(ranges, beams=beams, stamp_ns=START_NS + STEP * np.arange(9))]))
    tables = watched(log, STOP.replace("0.5", "4.5"), no_objects=True)
    points = column(tables.zones, "points")
    assert points == [360, 360, 360, 0, 0, 0, 1, 360, 360]
    assert column(tables.zones, "observed") == [True] * 3 + [False] * 4 + [True] * 2
    (event,) = tables.events.to_pylist()
    assert (event["sweeps"], event["cut"]) == (5, True), "hold is 0.5 s"


@pytest.mark.slow
def test_two_frames_on_one_topic_are_two_sensors(tmp_path: Path) -> None:
    """What both see of a walker is one visit and one crossing, as on two topics, and only copies of agents change."""
    scene = scene_of(walker((-3.0, 1.5), (3.0, 1.5)), sweeps=80)
    apart = [sensor_at(place, name, scene, seed) for seed, (place, name) in enumerate([(FRONT, "front"), (REAR, "rear")])]
    both = [[replace(block, topic="/scan") for block in blocks] for blocks in apart]
    links = [transform_at(START_NS, "base_link", name, place) for name, place in (("front", FRONT), ("rear", REAR))]
    zones = ROBOT_CIRCLE + '[[zone]]\nname = "door"\nframe = "robot"\nline = [[0.0, 0.5], [0.0, 2.5]]\n'
    told = {}
    for name, sensors in (("two", apart), ("one", both)):
        log = write_bag(tmp_path / f"{name}.bag", *map(scans, sensors), links)
        found = watched(log, zones)
        (visit,), (crossing,) = (rows(found.events, kind=kind) for kind in ("visit", "crossing"))
        copied = lidarcli.clean(log, tmp_path / f"{name}.clean.bag").to_pandas()
        told[name] = (
            [(visit["start"], visit["end"]), (crossing["start"], crossing["direction"])],
            sum(column(found.zones, "points", zone="near")),
            copied[["agents", "margin"]].sum().tolist(),
        )
    assert told["one"] == told["two"]
    assert told["one"][2][0] > 500


@pytest.mark.parametrize(("turns", "until", "noted"), [(0.05, 20, True), (0.05, 95, False), (0.0, 20, False)])
def test_a_link_that_is_held_though_it_moved_is_noted(
    turns: float, until: int, noted: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = scene_of(sweeps=100, sensor=replace(SENSOR, beams=36, angle_increment=TURN / 36))
    links = [transform_at(START_NS + k * STEP, "base_link", "laser", (0.0, 0.0, turns * k), "/tf") for k in range(until)]
    log = write_bag(tmp_path / "held.bag", scans(sweeps_of(scene)), links)
    assert run(["zones", str(log), "--zones", str(zone_file(tmp_path, ROBOT_CIRCLE)), "--no-objects"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    note = "sweeps are up to 8.0 s beyond the transforms of base_link > laser, which moved: it is held there"
    assert (note in told) == ("beyond the transforms" in told) == noted


ROUND = [(1.5 * np.cos(a), 1.5 * np.sin(a)) for a in np.linspace(0.0, 2 * np.pi, 100, endpoint=False)]
POINTS = "[" + ", ".join(f"[{x:.6f}, {y:.6f}]" for x, y in ROUND) + "]"
FORMS = f"""
monitor:
  ros__parameters:
    base_frame_id: base_link
    cmd_vel_in_topic: /cmd_vel
    polygons: [circle, polygon, parts, told]
    circle: {{type: circle, radius: 1.5, action_type: stop}}
    polygon: {{type: polygon, points: "{POINTS}", action_type: stop}}
    told: {{type: polygon, polygon_sub_topic: /shape, action_type: stop}}
    parts:
      type: velocity_polygon
      action_type: stop
      velocity_polygons: [slow, fast]
      slow: {{points: "{POINTS}", linear_min: 0.0, linear_max: 0.5, theta_min: -1.0, theta_max: 1.0}}
      fast: {{points: "{POINTS}", linear_min: 0.5, linear_max: 2.0, theta_min: -1.0, theta_max: 1.0}}
    observation_sources: [scan]
    scan: {{type: scan, topic: /scan}}
"""
SAME = ("kind", "first_sweep", "last_sweep", "sweeps", "start", "end", "points", "agents", "set", "track", "cut")


def test_events_are_the_same_in_every_form(tmp_path: Path) -> None:
    """The velocity, and with it the part, and the told shape change in every second sweep of a batch."""
    scene = scene_of(walker((-4.0, 0.8), (4.0, 0.8)), walker((4.0, -1.0), (-4.0, -1.0)), sweeps=70)
    stamps = times_of(scene)
    links = [transform_at(int(stamps[0]), "base_link", scene.sensor.frame_id, (0.0, 0.0, 0.0))]
    speeds = [twists([at], (0.2 + 0.6 * (k % 2), 0.0, 0.0))[0] for k, at in enumerate(stamps - 1)]
    # The same shape from another corner on is another shape to the reader.
    shapes = [
        polygon_at(int(at), "base_link", [*ROUND[k % 3 :], *ROUND[: k % 3]], "/shape") for k, at in enumerate(stamps - 1)
    ]
    log = write_bag(tmp_path / "a.bag", links, scans(sweeps_of(scene)), speeds, shapes)
    tables = sound(lidarcli.zones(log, zones=str(zone_file(tmp_path, FORMS, "forms.yaml"))))
    found: dict[str, list[dict[str, Any]]] = {
        name: rows(tables.events, zone=name) for name in ("circle", "polygon", "parts", "told")
    }
    expected = found["circle"]
    assert {event["set"] for event in expected} == {"A"}
    assert {event["track"] for event in expected if event["kind"] == "visit"} == {1, 2}
    assert max(event["agents"] for event in expected) == 2
    for name, told in found.items():
        assert [[e[key] for key in SAME] for e in told] == [[e[key] for key in SAME] for e in expected], name
        for one, other in zip(told, expected, strict=True):
            assert [one[key] for key in ("nearest", "bearing", "x", "y")] == pytest.approx(
                [other[key] for key in ("nearest", "bearing", "x", "y")], abs=0.01
            )
    for each in ("points", "things", "agents", "active"):
        assert column(tables.zones, each, zone="parts") == column(tables.zones, each, zone="polygon")
        assert column(tables.zones, each, zone="told") == column(tables.zones, each, zone="polygon")
