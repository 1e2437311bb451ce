"""Findings that align sweeps: drawn drives with one fault each, of which the truth is known."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.errors import OptionError
from lidarcli.logs.base import OpenOptions
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.reading.deep import DeepFindings, deep_findings
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.ros.messages import ROS1, Outgoing, bag_writer
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, relative, simulate_odometry
from lidarcli.simulation.scene import Entity, Odometry, Scene, SceneMount, SceneSensor
from lidarcli.simulation.writers import ROS1_BYTES, outgoing, write_log
from lidarcli.sweeps.findings import Finding, transform_lines
from lidarcli.sweeps.types import TURN, Float64, RawSweeps
from tests.fake_log import FakeLog
from tests.pipeline.drawn import ROOM, SENSOR, Drive, round_about, scene_of, standing, straight, sweeps_of
from tests.places import REAL_LOGS, needs_real_logs
from tests.pose.pose_messages import SECOND

WHEELS = Odometry(noise=0.01, yaw_noise=np.deg2rad(0.3))
"""Odometry of wheels, which drifts."""
TURNING = SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.01, time_increment=0.09 / 359)
"""A sensor whose sweeps take 0.09 of 0.1 s."""

Place = tuple[float, float, float]


def deep(log: Path, **options: Any) -> DeepFindings:
    """The findings of a log; each is one line and can be told as JSON."""
    found = deep_findings(Source(str(log), "run"), OpenOptions(), None, PoseOptions(**options))
    assert all("\n" not in one.message and one.as_dict()["id"] == one.id for one in found.findings)
    return found


def ids(found: DeepFindings) -> list[tuple[str, str]]:
    """Rules and levels of the findings."""
    return [(one.id, one.level) for one in found.findings]


def only(found: DeepFindings, which: str, level: str = "warning") -> Finding:
    """The one finding."""
    assert ids(found) == [(which, level)]
    return found.findings[0]


def drive(path: Path, scene: Scene, change: Callable[[RawSweeps], RawSweeps] | None = None) -> Path:
    """Write the log of a drive."""
    sweeps = [sweep if change is None else change(sweep) for sweep in sweeps_of(scene)]
    write_log(path, sweeps, poses=simulate_odometry(scene, scene.sweeps))
    return path


def assert_mounted(found: Finding, place: Place, distance: float = 0.02, yaw: float = 1.0) -> None:
    """The place that was found is the true one [m, degrees]."""
    told = found.evidence
    assert math.hypot(told["x"] - place[0], told["y"] - place[1]) < distance
    assert abs(math.remainder(told["yaw"] - place[2], TURN)) < math.radians(yaw)


# --- mounts ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "mount", [(-0.13, 0.0, 0.0), (0.2, 0.1, 0.1), (0.05, -0.06, -0.05), (0.0, 0.0, 0.05), (0.2, 0.0, 0.5 * np.pi)]
)
@pytest.mark.parametrize("odometry", [Odometry(), WHEELS], ids=["true poses", "wheels"])
def test_a_mount_that_is_not_told_is_found(tmp_path: Path, mount: Place, odometry: Odometry) -> None:
    found = deep(drive(tmp_path / "run.mcap", scene_of(odometry=odometry, mount=SceneMount(mount, in_log=False))))
    finding = only(found, "mount")
    assert_mounted(finding, mount)
    (told,) = found.mounts
    assert (told.frame, told.parent) == ("laser", "base_link")
    assert (told.x, told.y, told.yaw) == tuple(finding.evidence[name] for name in ("x", "y", "yaw"))
    assert finding.message.startswith("laser sits at x ")
    cause = "; or its first beam is elsewhere (angle_min)" if mount[2] > 1.0 else ""
    assert finding.message.endswith(f"in base_link; tf says x 0.00 m, y 0.00 m, yaw 0.0 degrees{cause}")
    assert finding.evidence["cells"] < finding.evidence["cells_told"]
    assert finding.fix is not None
    assert finding.fix.kind == "transform"
    assert finding.fix.text == transform_lines("base_link", "laser", told.x, told.y, told.yaw)


@pytest.mark.slow
def test_a_transform_that_is_pasted_ends_its_finding(tmp_path: Path) -> None:
    scene = scene_of(odometry=WHEELS, mount=SceneMount((0.2, 0.1, 0.1), in_log=False))
    fix = only(deep(drive(tmp_path / "run.mcap", scene)), "mount").fix
    assert fix is not None
    x, y, yaw = (float(word) for word in re.findall(r"--(?:x|y|yaw) (\S+)", fix.text.splitlines()[0]))
    poses = simulate_odometry(scene, scene.sweeps)
    assert poses is not None
    write_log(tmp_path / "told.mcap", sweeps_of(scene), poses=replace(poses, mount=(x, y, yaw)))
    assert deep(tmp_path / "told.mcap") == DeepFindings()


@pytest.mark.slow
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (-0.13, 0.05, 0.3)])
@pytest.mark.parametrize("odometry", [Odometry(), WHEELS], ids=["true poses", "wheels"])
@pytest.mark.parametrize("sensor", [SENSOR, TURNING], ids=["at once", "turning"])
def test_a_mount_that_is_told_is_not(tmp_path: Path, mount: Place, odometry: Odometry, sensor: SceneSensor) -> None:
    scene = scene_of(sensor=sensor, odometry=odometry, mount=SceneMount(mount))
    assert deep(drive(tmp_path / "run.mcap", scene)) == DeepFindings()


@pytest.mark.slow
def test_a_straight_drive_does_not_tell_a_mount(tmp_path: Path) -> None:
    scene = scene_of(straight, odometry=Odometry(), mount=SceneMount((0.3, 0.1, 0.0), in_log=False))
    found = deep(drive(tmp_path / "run.mcap", scene))
    finding = only(found, "mount", "hint")
    assert finding.message == ("mount of laser: cannot be told: the poses turn by 0 degrees, and 120 are needed")
    assert finding.fix is None
    assert found.mounts == ()


def oval(rng: np.random.Generator, room: Float64) -> Callable[[Float64], Float64]:
    """A way round the middle of a room, with a swaying heading."""
    a, b = rng.uniform(1.0, room[0] - 1.2), rng.uniform(0.9, room[1] - 1.2)
    turn, sway, begin = (rng.choice([-1, 1]) * rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.4), rng.uniform(0.0, TURN))

    def way(seconds: Float64) -> Float64:
        at = turn * seconds + begin
        heading = np.arctan2(np.sign(turn) * b * np.cos(at), -np.sign(turn) * a * np.sin(at))
        return np.column_stack([a * np.cos(at), b * np.sin(at), heading + sway * np.sin(1.3 * seconds)])

    return way


def furnished(rng: np.random.Generator) -> tuple[Float64, tuple[Entity, ...]]:
    """Half the sides of a room, and what is in it."""
    room = np.array([rng.uniform(3.0, 6.0), rng.uniform(2.5, 5.0)])
    (x, y), shown = room, rng.uniform(0.1, 0.3, 4)
    corners = [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]
    things = [make.cylinder(rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), shown[0])]
    things += [make.cylinder(rng.uniform(-x, x), y - 0.2, radius) for radius in shown[1:]]
    return room, (make.wall(corners), *things)


@pytest.mark.whole
def test_stated_deviations_cover_the_truth(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    off, deviations = [], []
    for number in range(48):
        mount = tuple(rng.uniform(-0.3, 0.3, 3).tolist())
        room, things = furnished(rng)
        degrees = int(rng.choice([360, 270, 180]))
        sensor = SceneSensor(
            beams=degrees,
            angle_min=-np.deg2rad(degrees) / 2.0,
            angle_increment=np.deg2rad(1.0),
            noise=rng.uniform(0.005, 0.02),
        )
        odometry = Odometry(noise=rng.uniform(0.0, 0.015), yaw_noise=np.deg2rad(rng.uniform(0.0, 0.5)))
        scene = Scene(
            "drawn",
            sensor,
            things,
            Drive(oval(rng, room)),  # type: ignore[arg-type]
            odometry,
            sweeps=int(rng.uniform(200, 400)),
            mount=SceneMount(mount, in_log=False),
        )
        log = drive(tmp_path / f"{number}.mcap", scene)
        for finding in deep(log).findings:
            if finding.id != "mount" or finding.level == "hint":
                continue
            told = finding.evidence
            apart = [told[name] - true for name, true in zip(("x", "y", "yaw"), mount, strict=True)]
            off.append([*apart[:2], math.remainder(apart[2], TURN)])
            deviations.append([told[f"sd_{name}"] for name in ("x", "y", "yaw")])
    shares = np.abs(np.array(off)) / np.array(deviations)
    assert len(shares) >= 40
    assert (shares < 2.0).mean() >= 0.95
    # Deviations that are much too large cover anything.
    assert np.sqrt((shares**2).mean()) > 0.5
    assert np.median(np.abs(np.array(off)), axis=0)[:2].max() < 0.02


# --- a second laser -------------------------------------------------------------------------------------------


def two_lasers(path: Path, scene: Scene, second: Place, told: Place | None = None, sensor: SceneSensor = SENSOR) -> Path:
    """Write a ROS 1 bag of two lasers, of which the log tells where the second is, or nothing."""
    rear = replace(sensor, topic="/scan_rear", frame_id="rear")
    other = replace(scene, sensor=rear, mount=SceneMount(second))
    sweeps = sorted([*sweeps_of(scene), *sweeps_of(other)], key=lambda one: (one.stamp_ns[0], one.topic))
    poses = simulate_odometry(scene, scene.sweeps)
    messages = list(outgoing(sweeps, poses, ROS1_BYTES))
    if told is not None:
        assert poses is not None
        data = ROS1_BYTES.mounting(replace(poses, laser_frame="rear", mount=told))
        messages.insert(1, Outgoing("/tf_static", messages[0].type, START_NS, START_NS, data))
    with bag_writer(path, "none") as writer:
        known: dict[str, Any] = {}
        for message in messages:
            if message.topic not in known:
                known[message.topic] = writer.add_connection(message.topic, message.type, typestore=ROS1)
            writer.write(known[message.topic], message.record_ns, message.data)
    return path


HALF = SceneSensor(beams=181, angle_min=-0.5 * np.pi, angle_increment=np.pi / 180, noise=0.01)
WIDE = SceneSensor(beams=271, angle_min=-0.75 * np.pi, angle_increment=np.pi / 180, noise=0.01)
BEHIND = (-0.5, 0.1, 3.0)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", [WIDE, HALF], ids=["overlapping", "apart"])
@pytest.mark.parametrize("odometry", [Odometry(), WHEELS, None], ids=["true poses", "wheels", "no poses"])
def test_a_second_laser_of_a_driving_robot_is_found(tmp_path: Path, sensor: SceneSensor, odometry: Odometry | None) -> None:
    scene = scene_of(sensor=sensor, odometry=odometry, mount=SceneMount((0.2, 0.0, 0.0)))
    found = deep(two_lasers(tmp_path / "run.bag", scene, BEHIND, sensor=sensor))
    true = relative(np.array([BEHIND]), np.array([[0.2, 0.0, 0.0]]))[0]
    assert_mounted(only(found, "lasers", "hint"), tuple(true.tolist()))
    (mount,) = found.mounts
    assert (mount.frame, mount.parent) == ("rear", "laser")


@pytest.mark.slow
def test_a_second_laser_whose_transform_is_right_is_not_told(tmp_path: Path) -> None:
    scene = scene_of(sensor=WIDE, odometry=WHEELS, mount=SceneMount((0.2, 0.0, 0.0)))
    assert ids(deep(two_lasers(tmp_path / "run.bag", scene, BEHIND, BEHIND, WIDE))) == []


@pytest.mark.slow
def test_a_second_laser_whose_transform_is_wrong_is_told(tmp_path: Path) -> None:
    scene = scene_of(sensor=WIDE, odometry=WHEELS, mount=SceneMount((0.2, 0.0, 0.0)))
    found = deep(two_lasers(tmp_path / "run.bag", scene, BEHIND, (-0.5, 0.0, np.pi), WIDE))
    finding = only(found, "lasers")
    assert_mounted(finding, tuple(relative(np.array([BEHIND]), np.array([[0.2, 0.0, 0.0]]))[0].tolist()))
    assert "tf says x -0.70 m, y 0.00 m, yaw 180.0 degrees" in finding.message
    (mount,) = found.mounts
    assert (mount.frame, mount.parent) == ("rear", "base_link")
    assert mount.x == pytest.approx(BEHIND[0], abs=0.02)
    assert mount.y == pytest.approx(BEHIND[1], abs=0.02)
    assert mount.yaw == pytest.approx(BEHIND[2], abs=0.02)


CORNER = (
    make.wall([[-4.0, -3.0], [5.0, -3.0], [5.0, 1.0], [1.5, 1.0], [1.5, 3.0], [-4.0, 3.0], [-4.0, -3.0]]),
    make.box(-2.0, 2.0, 0.8, 0.4, 0.5),
    make.cylinder(2.5, -1.5, 0.25),
    make.box(-1.5, -2.2, 0.6, 0.6),
)
"""A room with a corner, that looks like itself from no other side."""


@pytest.mark.slow
@pytest.mark.parametrize("second", [BEHIND, (-0.6, 0.3, -2.0), (0.0, 0.4, 0.02)])
def test_a_second_laser_that_stands_is_found_where_both_see_alike(tmp_path: Path, second: Place) -> None:
    scene = replace(scene_of(standing, sensor=SENSOR), entities=CORNER, sweeps=40)
    found = deep(two_lasers(tmp_path / "run.bag", scene, second))
    assert_mounted(only(found, "lasers", "hint"), second)


NARROW = SceneSensor(beams=91, angle_min=-0.25 * np.pi, angle_increment=np.pi / 180, noise=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "why"), [(WIDE, "what they see fits in two places"), (NARROW, "they see")], ids=["two sides", "apart"]
)
def test_a_second_laser_that_stands_and_cannot_be_placed_is_a_hint(tmp_path: Path, sensor: SceneSensor, why: str) -> None:
    scene = replace(scene_of(standing, sensor=sensor), sweeps=40)
    found = deep(two_lasers(tmp_path / "run.bag", scene, BEHIND, sensor=sensor))
    assert only(found, "lasers", "hint").message.startswith(f"/scan_rear beside /scan: cannot be told: {why}")
    assert found.mounts == ()


# --- poses ----------------------------------------------------------------------------------------------------


def mirrored(sweep: RawSweeps) -> RawSweeps:
    """Beams that run the other way than the header tells."""
    return replace(sweep, ranges=sweep.ranges[:, ::-1].copy())


@pytest.mark.slow
def test_mirrored_sweeps_are_told(tmp_path: Path) -> None:
    sensor = SceneSensor(beams=360, angle_min=-np.pi + np.pi / 360, angle_increment=TURN / 360, noise=0.01)
    found = deep(drive(tmp_path / "run.mcap", scene_of(sensor=sensor, odometry=WHEELS), mirrored))
    finding = only(found, "mirror", "error")
    assert finding.evidence["correlation"] < -0.9


@pytest.mark.slow
@pytest.mark.parametrize(("beam", "share"), [("middle", 0.5), ("last", 1.0)])
@pytest.mark.parametrize("odometry", [Odometry(), WHEELS], ids=["true poses", "wheels"])
def test_stamps_of_another_beam_are_told(tmp_path: Path, beam: str, share: float, odometry: Odometry) -> None:
    def later(sweep: RawSweeps) -> RawSweeps:
        return replace(sweep, stamp_ns=sweep.stamp_ns + round(share * 0.09 * SECOND))

    def way(seconds: Float64) -> Float64:
        turn = 0.8 * seconds
        return np.column_stack([1.5 * np.cos(turn), 1.2 * np.sin(turn), turn + 0.5 * np.pi + np.sin(2.0 * seconds)])

    found = deep(drive(tmp_path / "run.mcap", scene_of(way, TURNING, odometry=odometry), later))
    finding = only(found, "stamp")
    assert f"those of the {beam} beam" in finding.message
    assert finding.evidence["delay"] == pytest.approx(-0.09 * share, abs=0.01)
    assert finding.fix is not None
    assert finding.fix.text == f"--pose-delay {-0.09 * share:.3f}"
    assert ids(deep(tmp_path / "run.mcap", delay=-0.09 * share)) == []


@pytest.mark.slow
def test_a_delay_is_no_other_finding(tmp_path: Path) -> None:
    scene = scene_of(odometry=replace(WHEELS, delay=0.25))
    assert deep(drive(tmp_path / "run.mcap", scene)) == DeepFindings()


# --- the robot's own body -------------------------------------------------------------------------------------


def with_body(sweep: RawSweeps) -> RawSweeps:
    """Posts of the robot in two places."""
    ranges = sweep.ranges.copy()
    ranges[:, 40:52] = 0.3
    ranges[:, 300:306] = 0.55
    return replace(sweep, ranges=ranges)


@pytest.mark.slow
def test_the_body_of_a_robot_that_drives_is_told(tmp_path: Path) -> None:
    found = deep(drive(tmp_path / "run.mcap", scene_of(odometry=WHEELS), with_body))
    finding = only(found, "body")
    assert finding.evidence["beams"] == 18
    assert len(found.masks.masks) == 2
    assert finding.fix is not None
    assert finding.fix.kind == "mask"


@pytest.mark.slow
def test_a_mask_that_is_written_ends_its_finding(tmp_path: Path) -> None:
    log, mask = drive(tmp_path / "run.mcap", scene_of(odometry=WHEELS), with_body), tmp_path / "robot.toml"
    found = {each["id"]: each["fix"] for each in lidarcli.info(log, deep=True)[0]["findings"]}
    assert {*found} == {"too_close", "body"}
    mask.write_text(found["body"]["text"])
    assert "body" not in [each["id"] for each in lidarcli.info(log, deep=True, mask=mask)[0]["findings"]]


@pytest.mark.slow
def test_of_a_parked_robot_it_cannot_be_told(tmp_path: Path) -> None:
    found = deep(drive(tmp_path / "run.mcap", replace(scene_of(standing), sweeps=60), with_body))
    finding = only(found, "body", "hint")
    assert finding.message == "/scan: cannot be told: nothing moves (12 beams below 0.45 m)"
    assert found.masks.masks == ()


@pytest.mark.slow
def test_furniture_beside_a_parked_robot_is_none(tmp_path: Path) -> None:
    things = (*ROOM, make.box(0.9, 0.2, 0.5, 0.5), make.box(-0.2, -0.8, 0.8, 0.3, 0.2))
    scene = replace(scene_of(standing), entities=things, sweeps=60)
    assert deep(drive(tmp_path / "run.mcap", scene)) == DeepFindings()


@pytest.mark.slow
def test_people_around_a_robot_are_none(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)

    def with_people(sweep: RawSweeps) -> RawSweeps:
        ranges = sweep.ranges.copy()
        for beam in (20, 100, 190, 270):
            begin = beam + int(rng.integers(-4, 5))
            ranges[:, begin : begin + 12] = rng.uniform(0.4, 0.9)
        return replace(sweep, ranges=ranges)

    for way in (standing, round_about):
        scene = replace(scene_of(way, odometry=None if way is standing else WHEELS), sweeps=150)
        found = deep(drive(tmp_path / f"{way.__name__}.mcap", scene, with_people))
        assert "body" not in [one.id for one in found.findings]
        assert found.masks.masks == ()


# --- beams that flicker ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 1.0], ids=["flickers", "is lost"])
def test_a_sector_that_flickers_or_is_lost_is_told(tmp_path: Path, share: float) -> None:
    rng = np.random.default_rng(5)

    def lossy(sweep: RawSweeps) -> RawSweeps:
        ranges = sweep.ranges.copy()
        # 75 to 105 degrees.
        part = ranges[:, 255:286]
        part[rng.random(part.shape) < share] = np.inf
        return replace(sweep, ranges=ranges)

    finding = only(deep(drive(tmp_path / "run.mcap", scene_of(odometry=WHEELS), lossy)), "flicker")
    assert finding.evidence["sectors"] == [90]
    if share < 1.0:
        assert finding.evidence["changes"] == pytest.approx(2.0 * share * (1.0 - share), abs=0.03)


# --- logs that tell nothing -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["corridor.bag", "drive.db3", "hall", "people.csv.gz", "reflectors.mcap", "room.mcap", "room_empty.mcap"]
)
def test_samples_have_no_finding(name: str) -> None:
    assert deep(Path("samples") / name) == DeepFindings()


def test_a_log_without_sweeps_has_no_finding(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_log(log, [])
    assert deep(log) == DeepFindings()


def test_a_pipe_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidarcli.pipeline.inspecting.open_source", lambda *_: FakeLog(size=None))
    with pytest.raises(OptionError, match="--deep reads a log twice"):
        inspect_log(Source("-", "run"), deep=True)


# --- real logs ------------------------------------------------------------------------------------------------


@needs_real_logs
@pytest.mark.slow
def test_the_mount_of_a_real_car_is_found() -> None:
    """Its launch file says 0.12 m behind the markers of the motion capture."""
    found = deep(REAL_LOGS / "datmo" / "overtake_ego.bag")
    (finding,) = [one for one in found.findings if one.id == "mount"]
    assert finding.evidence["x"] == pytest.approx(-0.12, abs=0.02)
    assert finding.evidence["sd_x"] < 0.02
    assert finding.message.endswith("without a mount it is taken to be at x 0.00 m, y 0.00 m, yaw 0.0 degrees")


@needs_real_logs
@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["comprobo24/test-bag", "comprobo24/drive_square", "my_gazebo_tutorials/20_53_49", "hrp_mpc_lidar/mylaserdata2.bag"],
)
def test_real_logs_without_a_fault_of_these_have_none(name: str) -> None:
    assert deep(REAL_LOGS / name) == DeepFindings()


@needs_real_logs
@pytest.mark.slow
def test_three_lasers_and_the_body_of_a_real_robot_are_told() -> None:
    found = deep(REAL_LOGS / "leg_tracker" / "negative_2.bag")
    assert ids(found) == [("lasers", "hint"), ("lasers", "hint"), *(("body", "warning") for _ in range(3))]
    beams = [one.evidence["beams"] for one in found.findings if one.id == "body"]
    assert beams == pytest.approx([29, 57, 27], abs=2)


@needs_real_logs
@pytest.mark.slow
def test_a_real_sensor_that_stood_has_a_hint() -> None:
    finding = only(deep(REAL_LOGS / "sick" / "rms_1xxx_lms_1xx_movement_off.bag"), "body", "hint")
    assert finding.message == "/sick_lms_1xx/scan: cannot be told: nothing moves (108 beams below 0.45 m)"
