"""Action `approach` over whole logs: the time to collision of a robot whose way is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.pipeline.zones.frames import velocity_of
from lidarcli.pipeline.zones.summary import ZoneTables
from lidarcli.ros.messages import Outgoing
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry, Scene, SceneMount
from lidarcli.sweeps.types import Float64, SweepPoses
from tests.zones.runs import (
    SENSOR,
    column,
    odometry_of,
    rows,
    scans,
    scene_of,
    sound,
    sweeps_of,
    times_of,
    twists,
    walker,
    watched,
    write_bag,
    zone_file,
)

STEP = 0.1
APPROACH = """
[[zone]]
name = "ahead"
frame = "robot"
action = "approach"
polygon = [[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]
min_points = 2
time_before_collision = 2.0
simulation_time_step = 0.1
"""
SPEED = 0.5


def straight(sweeps: int = 72, **sensor: Any) -> tuple[Scene, Float64]:
    """A robot that drives towards a wall at x = 3, from x = -1; and (S,) the way from its front to the wall."""
    path = Course(np.array([[-1.0, 0.0], [2.65, 0.0], [2.65, -4.0], [-1.0, -4.0]]), speed=SPEED)
    room = (make.wall([[3.0, -8.0], [3.0, 3.0], [-6.0, 3.0], [-6.0, -8.0], [3.0, -8.0]]),)
    scene = scene_of(room=room, path=path, sweeps=sweeps, odometry=Odometry(), sensor=replace(SENSOR, noise=0.0, **sensor))
    return scene, 3.0 - 0.3 - path.poses(np.arange(sweeps) / 10.0)[:, 0]


def is_right(tables: ZoneTables, way: Float64, speed: float, first: int = 1) -> None:
    """Assert that times to collision are those of a way (S,) [m] at a speed [m/s], to one step."""
    ttc = np.array([np.nan if one is None else one for one in column(tables.zones, "ttc")])
    true = way / speed
    # The shape moves by a step before each test: contact after t is told as t - step to t.
    sure = np.flatnonzero(true < 2.0)
    sure = sure[sure >= first]
    assert len(sure) > 10
    assert np.isfinite(ttc[sure]).all()
    assert np.abs(ttc[sure] - true[sure]).max() <= STEP + 0.02
    assert np.isnan(ttc[true > 2.0 + STEP + 0.05]).all()
    (event,) = rows(tables.events, kind="approach")
    assert event["ttc"] == pytest.approx(np.nanmin(ttc))
    assert abs(event["first_sweep"] - np.flatnonzero(true <= 2.0 + STEP)[0]) <= 1
    assert column(tables.zones, "points")[event["first_sweep"]] >= 2
    assert (event["action"], event["kind"]) == ("approach", "approach")


@pytest.mark.parametrize("source", [pytest.param("odometry", marks=pytest.mark.slow), "cmd_vel"])
def test_straight_ahead(source: str, tmp_path: Path) -> None:
    scene, way = straight()
    if source == "odometry":
        log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
        tables = watched(log, APPROACH, no_objects=True)
    else:
        log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene)), twists(times_of(scene) - 1000, (SPEED, 0.0, 0.0)))
        tables = lidarcli.zones(log, zones=str(zone_file(tmp_path, NAV2, "nav2.yaml")), no_objects=True)
    is_right(tables, way, SPEED)
    assert rows(tables.events)[0]["speed"] == pytest.approx(SPEED, abs=0.01)


NAV2 = """
collision_monitor:
  ros__parameters:
    base_frame_id: "laser"
    cmd_vel_in_topic: "cmd_vel"
    polygons: ["ahead"]
    ahead:
      type: "polygon"
      points: "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
      action_type: "approach"
      min_points: 2
      time_before_collision: 2.0
      simulation_time_step: 0.1
    observation_sources: ["scan"]
    scan:
      type: "scan"
      topic: "/scan"
"""


def test_velocities_have_the_clock_of_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The log is recorded 100 s after its stamps; the robot stands until it drives at SPEED."""
    scene, way = straight()
    late = 100_000_000_000
    times = times_of(scene) + late - 1000
    stands = twists(times[:40], (0.0, 0.0, 0.0)) + twists(times[40:], (SPEED, 0.0, 0.0))
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), record_after_ns=late), stands)
    tables = lidarcli.zones(log, zones=str(zone_file(tmp_path, NAV2, "nav2.yaml")), no_objects=True)
    ttc = column(tables.zones, "ttc")
    assert ttc[:40] == [None] * 40
    assert way[60] / SPEED - STEP - 0.02 <= ttc[60] <= way[60] / SPEED + 0.02
    told = NAV2.replace("points: ", "footprint_topic: /foot  # ")
    told += "local_costmap: {local_costmap: {ros__parameters: {footprint_padding: 0.0, footprint: "
    told += NAV2.split("points: ")[1].split("\n")[0] + "}}}\n"
    found = lidarcli.zones(log, zones=str(zone_file(tmp_path, told, "told.yaml")), no_objects=True)
    assert column(found.zones, "ttc") == ttc
    assert run(["zones", str(log), "--zones", str(tmp_path / "told.yaml"), "--no-objects"]) == 0
    note = "the shape of zone 'ahead' is a footprint: its file has that of the costmap, the log has no /foot"
    assert note in capsys.readouterr().err


@pytest.mark.slow
def test_a_sensor_that_looks_to_the_left(tmp_path: Path) -> None:
    """A zone in the frame of a sensor that is mounted ahead, at the left, and turned moves with that sensor."""
    mount = (0.1, 0.3, np.pi / 2)
    scene, way = straight()
    scene = replace(scene, mount=SceneMount(mount))
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
    own = APPROACH.replace('"ahead"', '"own"').replace('"robot"', '"sensor"')
    # x of the sensor is the left of the robot, y of the sensor is behind.
    corners = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
    own = own.replace(corners, "[[-0.1, -0.2], [-0.5, -0.2], [-0.5, 0.4], [-0.1, 0.4]]")
    tables = watched(log, APPROACH + own, no_objects=True)
    assert column(tables.zones, "ttc", zone="own") == column(tables.zones, "ttc", zone="ahead")
    alone = watched(log, APPROACH, no_objects=True)
    is_right(alone, way, SPEED)


def test_each_zone_has_the_velocity_of_its_own_topic(tmp_path: Path) -> None:
    """One is told that the robot drives, one that it stands, and of a third topic no message can be read."""
    scene, way = straight()
    times = times_of(scene) - 1000
    bad = [Outgoing("/bad", "geometry_msgs/msg/Twist", int(times[0]), int(times[0]), b"\0")]
    log = write_bag(
        tmp_path / "a.bag",
        scans(sweeps_of(scene), odometry_of(scene)),
        twists(times, (SPEED, 0.0, 0.0)),
        twists(times, (0.0, 0.0, 0.0), "/other"),
        bad,
    )
    files = []
    for topic in ("cmd_vel", "other", "bad"):
        text = NAV2.replace('"cmd_vel"', f'"{topic}"').replace("ahead", topic).replace('"laser"', '"base_link"')
        files.append(str(zone_file(tmp_path, text, f"{topic}.yaml")))
    with pytest.warns(UserWarning, match="topic /bad: 1 message left out"):
        tables = sound(lidarcli.zones(log, zones=files, no_objects=True))
    ttc = {topic: column(tables.zones, "ttc", zone=topic) for topic in ("cmd_vel", "other", "bad")}
    assert ttc["cmd_vel"][60] == pytest.approx(way[60] / SPEED, abs=0.12)
    assert set(ttc["other"]) == {None}
    assert ttc["bad"][60] == pytest.approx(way[60] / SPEED, abs=0.12), "by the poses"


@pytest.mark.parametrize("hangs", [False, True])
def test_turning_on_the_spot(hangs: bool, tmp_path: Path) -> None:
    """A long robot turns at 0.5 rad/s, and its corner meets a pole at 1 m distance."""
    turning = 0.5
    pole = make.cylinder(0.0, 1.0, 0.02)
    count = 40
    sensor = replace(SENSOR, beams=1440, angle_increment=np.pi / 720, noise=0.0)
    seconds = np.arange(count) / 10.0
    yaw = turning * (seconds - 2.0)

    class Turn:
        parked = False

        def poses(self, seconds: Float64) -> Float64:
            return np.column_stack([0 * seconds, 0 * seconds, turning * (seconds - 2.0)])

        def speeds(self, seconds: Float64) -> Float64:
            return 0 * seconds

    scene = scene_of(pole, sensor=sensor, sweeps=count, path=Turn())
    blocks = sweeps_of(scene)
    if hangs:
        # A sensor that hangs head down has its beams in the other order.
        blocks = [replace(block, ranges=block.ranges[:, (-np.arange(1440)) % 1440].copy()) for block in blocks]
    log = write_bag(tmp_path / "a.bag", scans(blocks), twists(times_of(scene) - 1000, (0.0, 0.0, turning)))
    shape = "[[1.2, 0.1], [1.2, -0.1], [-0.1, -0.1], [-0.1, 0.1]]"
    mount = f'[[mount]]\nframe = "laser"\nparent = "base_link"\nupside_down = {str(hangs).lower()}\n'
    text = NAV2.replace("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]", shape)
    text = text.replace('"laser"', '"base_link"').replace("min_points: 2", "min_points: 1")
    files = [zone_file(tmp_path, text, "nav2.yaml"), zone_file(tmp_path, mount + OTHER)]
    tables = lidarcli.zones(log, zones=[str(file) for file in files], no_objects=True)
    # The side at 0.1 m to the left of the axis meets the pole (0.98 m ahead) at this angle.
    meets = np.pi / 2 - np.arcsin(0.1 / 0.98)
    true = (meets - yaw) / turning
    ttc = np.array([np.nan if one is None else one for one in column(tables.zones, "ttc", zone="ahead")])
    soon = np.flatnonzero((true < 1.95) & (true > 0.0))
    assert len(soon) >= 10
    assert np.abs(ttc[soon] - true[soon]).max() <= STEP + 0.03
    assert np.isnan(ttc[true > 2.2]).all()


def test_a_frame_moves_as_the_robot_that_carries_it() -> None:
    """Velocities of frames on the robot, also of those that hang head down, against a small step of it."""
    rng = np.random.default_rng(0)

    def drawn() -> SweepPoses:
        return SweepPoses(*rng.normal(size=(3, 1)), rng.random(1) < 0.5)

    def matrix(pose: SweepPoses) -> Float64:
        cos, sin = np.cos(pose.yaw[0]), np.sin(pose.yaw[0])
        side = -1.0 if pose.upside_down[0] else 1.0
        return np.array([[cos, -side * sin, pose.x[0]], [sin, side * cos, pose.y[0]], [0.0, 0.0, 1.0]])

    for _ in range(50):
        place, carried, velocity = drawn(), drawn(), rng.normal(size=3)
        frame = matrix(carried) @ np.linalg.inv(matrix(place))
        step = matrix(SweepPoses(*(velocity[:, None] * 1e-6), np.zeros(1, np.bool_)))
        moved = np.linalg.inv(frame) @ step @ frame
        expected = np.array([moved[0, 2], moved[1, 2], np.arctan2(moved[1, 0], moved[0, 0])]) / 1e-6
        assert velocity_of(velocity[None], place, carried)[0] == pytest.approx(expected, abs=1e-4)


OTHER = '[[zone]]\nname = "other"\ncircle = { x = 5, y = 5, radius = 0.1 }\n'


@pytest.mark.slow
def test_agents_come_with_their_own_velocity(tmp_path: Path) -> None:
    """Somebody walks towards a parked sensor at 1 m/s."""
    scene = scene_of(walker((6.0, 0.0), (0.8, 0.0)), sweeps=50, odometry=Odometry())
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
    tables = watched(log, APPROACH + 'count = "agents"')
    ttc = np.array([np.nan if one is None else one for one in column(tables.zones, "ttc")])
    assert {event["set"] for event in rows(tables.events, kind="approach")} == {"A"}
    # From the middle of the body to the front of the robot, at 1 m/s; a leg is up to 0.45 m ahead.
    way = 6.0 - np.arange(50) / 10.0 - 0.3
    soon = (way < 1.9) & (way > 0.8)
    assert np.isfinite(ttc[soon]).mean() > 0.9
    assert np.nanmax(np.abs(ttc[soon] - way[soon])) < 0.45
    assert np.isnan(ttc[way > 2.7]).all()
