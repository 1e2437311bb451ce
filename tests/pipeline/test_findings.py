"""Findings of `info`: each fault alone gives its finding and no other, and a sound log gives none."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.cli.info import as_json
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.simulation.generate import START_NS, SimulatedPoses, simulate_blocks
from lidarcli.simulation.scene import SceneSensor
from lidarcli.simulation.writers import ROS1_BYTES, outgoing, write_log
from lidarcli.sweeps.finding_rules import LOG_RULES, REPEATED_TOPIC, STAMP, SWEEP_RULES
from lidarcli.sweeps.findings import Finding, Fix
from lidarcli.sweeps.types import TURN, RawSweeps, concatenate
from tests.pipeline import drawn
from tests.pipeline.drawn import (
    SWEEPS,
    driven,
    round_about,
    scene_of,
    stamps,
    standing,
    told,
    write_messages,
    write_two_mounts,
)
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs

Change = Callable[[RawSweeps], RawSweeps]
SECOND = 1_000_000_000


@cache
def sound() -> RawSweeps:
    """60 sweeps of a parked sensor whose headers tell how long beams and sweeps take."""
    sensor = SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.01, time_increment=0.1 / 360)
    scene = replace(scene_of(standing, sensor), sweeps=60)
    return concatenate([block.raw for block in simulate_blocks(scene, 60, 0)])


def findings_of(path: Path) -> tuple[Finding, ...]:
    return inspect_log(Source(str(path), path.name)).findings


def some(share: float) -> Any:
    """(60, 360) True for a share of the beams."""
    return np.random.default_rng(5).random((60, 360)) < share


def filled(share: float, value: float) -> Change:
    """Give a value to a share of the beams."""
    return lambda raw: replace(raw, ranges=np.where(some(share), np.float32(value), raw.ranges))


def scaled(**factors: float) -> Change:
    """Multiply columns."""
    return lambda raw: replace(
        raw, **{name: (getattr(raw, name) * factor).astype(getattr(raw, name).dtype) for name, factor in factors.items()}
    )


def rows(*index: Any) -> Change:
    """Take some rows."""
    return lambda raw: raw.rows(np.concatenate(index))


def cut_short(raw: RawSweeps) -> RawSweeps:
    return replace(raw, beams=np.where(np.arange(60) % 7 == 3, 200, 360).astype(np.int32))


def repeated(raw: RawSweeps) -> RawSweeps:
    return replace(raw, ranges=raw.ranges[np.arange(60) // 2 * 2])


def beyond(raw: RawSweeps) -> RawSweeps:
    return replace(raw, range_max=np.full(60, 4.0, np.float32))


def recorded_later(raw: RawSweeps) -> RawSweeps:
    return replace(raw, record_ns=raw.record_ns + 2 * SECOND)


def motor(raw: RawSweeps) -> RawSweeps:
    """A motor whose speed varies: fewer beams, further apart, over the same turn."""
    beams = np.random.default_rng(3).integers(340, 361, 60).astype(np.int32)
    return replace(raw, beams=beams, angle_increment=TURN / beams)


EVERY = np.arange(60)
FAULTS: dict[str, tuple[str, str, Change, str]] = {
    "cut short": ("geometry", "warning", cut_short, "/scan: 200 to 360 beams see 199 to 359 deg: some sweeps are"),
    "motor": ("geometry", "hint", motor, "/scan: 340 to 360 beams by sweep: slam_toolbox takes only as many as the first"),
    "turns": (
        "geometry",
        "error",
        scaled(angle_increment=1.6),
        "/scan sees 574 deg (60 of 60 sweeps): angle_increment is too",
    ),
    "degrees": ("units", "error", scaled(angle_increment=14.0), "/scan sees 5,026 deg (60 of"),
    "beyond": ("limits", "warning", beyond, "/scan: 43.6% of the beams are beyond the greatest range of 4 m that the log"),
    "nan": ("no_return", "hint", filled(0.2, np.nan), "/scan: 20% of the beams are NaN (--no-return nan)"),
    "zero": ("no_return", "hint", filled(0.2, 0.0), "/scan: 20% of the beams are 0"),
    "range_max": ("no_return", "hint", filled(0.2, 12.0), "/scan: 20% of the beams are range_max"),
    "near": ("too_close", "warning", filled(0.05, 0.05), "/scan: 5% of the beams are below range_min"),
    "lost": ("gaps", "warning", rows(EVERY[EVERY % 5 != 3]), "/scan: 26% of the steps are over 1.5 times the median"),
    "thinned": ("gaps", "warning", rows(EVERY[::5]), "/scan: a sweep every 0.500 s, by scan_time every 0.100 s: 4 of 5"),
    "another clock": ("clock", "hint", recorded_later, "/scan: recorded 2.0 s after the stamps"),
    "time_increment": ("rolling", "warning", scaled(time_increment=0.5), "/scan: a sweep takes 0.050 s by time_increment,"),
    "microseconds": ("rolling", "warning", scaled(time_increment=0.001, scan_time=0.001), "/scan: a sweep takes 0.0001 s"),
    "doubled": ("duplicate", "hint", repeated, "/scan: 30 of 60 sweeps repeat the ranges before them"),
    "no frame": ("frames", "hint", lambda raw: replace(raw, frame_ids=("",)), "/scan: the sweeps name no frame"),
    "slash": ("frames", "hint", lambda raw: replace(raw, frame_ids=("/l",)), "/scan: tf2 takes no frame whose name begins"),
    "no limits": ("limits", "warning", scaled(range_max=0.0), "/scan: range_max is not above range_min (60 of 60 sweeps)"),
    "milliseconds": (
        "rolling",
        "warning",
        scaled(time_increment=1000.0),
        "/scan: a sweep takes 99.722 s by time_increment",
    ),
}
"""Name of a fault → the rule that finds it, its level, the change of a sound log, and how its message begins."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_sweeps_gives_its_finding_and_no_other(tmp_path: Path, fault: str) -> None:
    rule, level, change, message = FAULTS[fault]
    write_log(tmp_path / "run.mcap", [change(sound())])
    (found,) = findings_of(tmp_path / "run.mcap")
    assert (found.id, found.level, found.topic) == (rule, level, "/scan")
    assert found.message.startswith(message)


def honest(raw: RawSweeps) -> RawSweeps:
    """Headers that tell nothing of time."""
    zero = np.zeros(len(raw), np.float32)
    return replace(raw, time_increment=zero, scan_time=zero)


def nothing_ahead(raw: RawSweeps) -> RawSweeps:
    """Two thirds of the beams meet nothing, as REP 117 has it."""
    return replace(raw, ranges=np.where(np.arange(360) < 240, np.float32(np.inf), raw.ranges))


SOUND: dict[str, Change] = {
    "as it is": lambda raw: raw,
    "no times": honest,
    "no return is inf": nothing_ahead,
    "some NaN": filled(0.05, np.nan),
    "some near": filled(0.005, 0.05),
    "one lost": rows(EVERY[EVERY != 30]),
    "clockwise": scaled(angle_increment=-1.0),
}


@pytest.mark.parametrize("kind", SOUND)
def test_a_sound_log_has_none(tmp_path: Path, kind: str) -> None:
    write_log(tmp_path / "run.mcap", [SOUND[kind](sound())])
    assert findings_of(tmp_path / "run.mcap") == ()


def test_samples_have_none() -> None:
    for path in sorted(SAMPLES.iterdir()):
        if path.suffix in (".mcap", ".bag", ".db3", ".gz") or path.is_dir():
            assert findings_of(path) == (), path


def test_the_end_that_the_header_tells(tmp_path: Path) -> None:
    """`angle_max` is two steps off in the messages themselves."""
    messages = list(outgoing([sound()], None, ROS1_BYTES))
    # Sequence number, stamp, length and name of the frame, angle_min.
    place = 16 + len("laser") + 4
    last = np.float32(-math.pi + 361 * TURN / 360).tobytes()
    changed = [each._replace(data=each.data[:place] + last + each.data[place + 4 :]) for each in messages]
    (found,) = findings_of(write_messages(tmp_path / "run.bag", changed))
    assert (found.id, found.level, found.evidence["sweeps"]) == ("geometry", "warning", 60)
    assert found.message == (
        "angle_max of /scan is 181.00 deg, by angle_increment 179.00 deg: that is used (60 of 60 sweeps)"
    )


@pytest.mark.parametrize(("late", "words"), [(0.05, "0.05 s later"), (-0.3, "0.30 s earlier"), (0.0, "")])
def test_a_topic_that_repeats_another(tmp_path: Path, late: float, words: str) -> None:
    raw = sound()
    again = replace(
        raw.rows(slice(0, 50)),
        topic="/again",
        stamp_ns=raw.stamp_ns[:50] + round(late * SECOND),
        record_ns=raw.record_ns[:50] + SECOND // 20,
    )
    write_log(tmp_path / "run.mcap", [raw, again])
    (found,) = findings_of(tmp_path / "run.mcap")
    assert (found.id, found.topic, found.fix) == ("duplicate", "/again", Fix("option", "--topic /scan"))
    assert found.message == "/again repeats /scan: 50 of 50 sweeps" + (f", stamps {words}" if words else "")


def test_topics_of_their_own_repeat_nothing(tmp_path: Path) -> None:
    raw = sound()
    write_log(tmp_path / "run.mcap", [raw, replace(raw, topic="/other", ranges=raw.ranges + np.float32(0.001))])
    assert findings_of(tmp_path / "run.mcap") == ()


def of_drive(path: Path) -> list[Finding]:
    """Findings of a log of the robot that goes round about, which comes close to a pillar."""
    return [each for each in findings_of(path) if each.id != "too_close"]


def halved(raw: RawSweeps) -> RawSweeps:
    """Steps of half the angle: a driver that takes a whole turn for half of one."""
    return replace(raw, angle_increment=raw.angle_increment / 2)


def all_halved(raw: RawSweeps) -> RawSweeps:
    return replace(halved(raw), angle_min=raw.angle_min / 2)


def from_ahead(raw: RawSweeps) -> RawSweeps:
    return replace(halved(raw), angle_min=raw.angle_min * 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
@pytest.mark.parametrize(("change", "first"), [(halved, -math.pi), (all_halved, -math.pi), (from_ahead, 0.0)])
def test_steps_of_half_a_turn_in_place_of_a_whole_one_are_told_and_mended(
    tmp_path: Path, change: Change, first: float, suffix: str
) -> None:
    path, out = tmp_path / f"run{suffix}", tmp_path / f"mended{suffix}"
    write_log(path, [change(concatenate(driven()))])
    (found,) = of_drive(path)
    assert (found.id, found.level, found.mend) == ("geometry", "error", "angles")
    assert found.evidence["meet"] == pytest.approx(0.913)
    assert found.message == "/scan: its half turn ends where it begins: angle_increment is half of what it should be"
    lidarcli.clean(path, out, remove="none", mend="angles")
    assert of_drive(out) == []
    (batch,) = lidarcli.read(out, pose="none")
    assert batch.angle_increment == pytest.approx(np.full(SWEEPS, TURN / 360))
    assert batch.angle_min == pytest.approx(np.full(SWEEPS, first))


@pytest.mark.parametrize("way", [round_about, standing])
def test_half_a_turn_that_is_one_has_no_finding(tmp_path: Path, way: Any) -> None:
    sensor = SceneSensor(beams=181, angle_min=-math.pi / 2, angle_increment=TURN / 360, noise=0.01)
    path = tmp_path / "run.mcap"
    write_log(path, [block.raw for block in simulate_blocks(scene_of(way, sensor), SWEEPS, 0)])
    assert of_drive(path) == []
    # Whether half of a turn that never changes is a whole one cannot be told.
    write_log(tmp_path / "parked.mcap", [halved(sound())])
    assert not any("meet" in each.evidence for each in findings_of(tmp_path / "parked.mcap"))


def rolled(raw: RawSweeps) -> RawSweeps:
    """The first beam is a quarter of a turn elsewhere."""
    return replace(raw, ranges=np.roll(raw.ranges, 90, axis=1))


@pytest.mark.slow
@pytest.mark.parametrize(("late", "ids"), [(0.0, ["mount"]), (0.3, ["delay", "mount"])])
def test_beams_that_begin_elsewhere_are_a_mount_or_a_first_beam(tmp_path: Path, late: float, ids: list[str]) -> None:
    poses = told(round_about(np.arange(SWEEPS) * 0.1), stamps() + round(late * SECOND))
    write_log(tmp_path / "run.mcap", [rolled(concatenate(driven()))], poses=poses)
    found = of_drive(tmp_path / "run.mcap")
    assert [each.id for each in found] == ids
    words = "sensor turned by -90 degrees: its mount, or its first beam is elsewhere (angle_min)"
    assert found[-1].message == f"poses from /odom fit if corrected: {words}"
    assert math.degrees(found[-1].evidence["yaw"]) == pytest.approx(-90.0, abs=1.0)


def test_findings_as_json(tmp_path: Path) -> None:
    raw = filled(0.99, np.nan)(sound())
    write_log(tmp_path / "run.mcap", [replace(raw, range_max=np.full(60, np.inf, np.float32))])
    info = inspect_log(Source(str(tmp_path / "run.mcap"), "run"))
    (entry,) = json.loads(as_json([info]), parse_constant=pytest.fail)
    (found,) = entry["findings"]
    assert found | {"evidence": None, "message": None} == {
        "id": "no_return",
        "level": "warning",
        "topic": "/scan",
        "frame": "laser",
        "message": None,
        "evidence": None,
        "threshold": {"share": 0.95},
        "fix": None,
        "mend": "",
    }
    assert entry["notes"] == []
    assert lidarcli.info(tmp_path / "run.mcap")[0]["findings"] == entry["findings"]


def jumping(poses: SimulatedPoses) -> SimulatedPoses:
    moved = poses.poses.copy()
    moved[120:, 0] += 3.0
    return replace(poses, poses=moved)


def turning(poses: SimulatedPoses) -> SimulatedPoses:
    """From one pose on, the robot and its way are turned."""
    moved, turn = poses.poses.copy(), 1.5
    x, y = (moved[120:, :2] - moved[119, :2]).T
    moved[120:, 0] = moved[119, 0] + math.cos(turn) * x - math.sin(turn) * y
    moved[120:, 1] = moved[119, 1] + math.sin(turn) * x + math.cos(turn) * y
    moved[120:, 2] += turn
    return replace(poses, poses=moved)


POSES: dict[str, tuple[str, Callable[[SimulatedPoses], SimulatedPoses], str]] = {
    "jump": ("drift", jumping, "poses from /tf jump by up to 3.0 m: the path is matched from the sweeps"),
    "turn": ("drift", turning, "poses from /tf jump by up to 89 degrees: the path is matched from the sweeps"),
    "no transform": (
        "frames",
        lambda poses: replace(poses, laser_frame="lidar"),
        "no transform leads to frame laser: the sensor laser is taken to be at base_link: its mount is not in the log",
    ),
}


@cache
def clear() -> list[RawSweeps]:
    """The sweeps of a drive without ranges below range_min: the robot goes through the edge of a cylinder."""
    return [
        replace(raw, ranges=np.where(raw.ranges < raw.range_min[:, None], np.float32(np.inf), raw.ranges))
        for raw in driven()
    ]


def drive() -> SimulatedPoses:
    return told(round_about(np.arange(SWEEPS) * 0.1), tf=True)


@pytest.mark.slow
@pytest.mark.parametrize("fault", POSES)
def test_a_fault_of_poses_gives_its_finding_and_no_other(tmp_path: Path, fault: str) -> None:
    rule, change, message = POSES[fault]
    write_log(tmp_path / "run.mcap", clear(), poses=change(drive()))
    (found,) = findings_of(tmp_path / "run.mcap")
    assert (found.id, found.level, found.message) == (rule, "warning", message)


@pytest.mark.slow
@pytest.mark.parametrize("late", [-0.5, -0.27, -0.1, 0.1, 0.31, 0.5])
def test_a_delay_is_found(tmp_path: Path, late: float) -> None:
    poses = told(round_about(np.arange(-10, SWEEPS + 10) * 0.1), stamps(SWEEPS + 20) - SECOND)
    write_log(tmp_path / "run.mcap", clear(), poses=replace(poses, stamp_ns=poses.stamp_ns + round(late * SECOND)))
    (found,) = findings_of(tmp_path / "run.mcap")
    assert (found.id, found.level) == ("delay", "warning")
    assert found.evidence["delay"] == pytest.approx(late, abs=0.0101)
    assert found.fix == Fix("option", f"--pose-delay {found.evidence['delay']:.2f}")


@pytest.mark.slow
def test_a_frame_that_is_mounted_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn, "driven", clear)
    path = write_two_mounts(tmp_path / "run.bag", drive(), (0.01, 0.0, 0.0))
    (found,) = findings_of(path)
    assert (found.id, found.message) == ("frames", "/tf_static: laser is told at two places in base_link: the last counts")


@pytest.mark.slow
def test_a_frame_with_two_parents(tmp_path: Path) -> None:
    poses = drive()
    messages = list(outgoing(clear(), poses, ROS1_BYTES))
    data = ROS1_BYTES.link(START_NS, "mast", "laser", (0.0, 0.0, 0.0))
    messages.append(messages[0]._replace(data=data, record_ns=messages[-1].record_ns))
    (found,) = findings_of(write_messages(tmp_path / "run.bag", messages))
    assert (found.id, found.message) == ("frames", "frame laser has 2 parents: base_link, mast; tf2 takes mast, told last")


@pytest.mark.slow
def test_quaternions_that_are_none(tmp_path: Path) -> None:
    def stretched(data: bytes) -> bytes:
        # Header, child and position; then the quaternion.
        place = 4 + 8 + 4 + len("odom") + 4 + len("base_link") + 24
        turn = np.frombuffer(data[place : place + 32], "<f8") * 1.2
        return data[:place] + turn.tobytes() + data[place + 32 :]

    poses = told(round_about(np.arange(SWEEPS) * 0.1))
    messages = [
        each._replace(data=stretched(each.data)) if each.topic == "/odom" else each
        for each in outgoing(clear(), poses, ROS1_BYTES)
    ]
    (found,) = findings_of(write_messages(tmp_path / "run.bag", messages))
    assert (found.id, found.message) == ("frames", "/odom: quaternions of odom > base_link are up to 0.2 off length 1")


@pytest.mark.slow
def test_sound_poses_have_none(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", clear(), poses=drive())
    assert findings_of(tmp_path / "run.mcap") == ()


REAL = {
    "comprobo24/drive_square/drive_square_0.db3": "gaps duplicate frames delay",
    "comprobo24/test-bag/test-bag_0.db3": "gaps*2 duplicate frames drift delay",
    "datmo/overtake_ego.bag": "rolling frames",
    "datmo/parallel.bag": "rolling frames drift mount",
    "hrp_mpc_lidar/mylaserdata2.bag": "frames",
    "leg_tracker/demo_stationary_simple_environment.bag": "",
    "leg_tracker/negative_2.bag": "no_return*3 too_close*3 rolling*3 body*3",
    "leg_tracker/positive_1_extracted.bag": "no_return too_close gaps clock rolling pace",
    "leg_tracker/positive_1_raw.bag": "no_return too_close rolling",
    "leg_tracker/positive_2_extracted.bag": "no_return too_close gaps clock rolling pace",
    "leg_tracker/positive_3_extracted.bag": "no_return too_close gaps clock rolling pace",
    "leg_tracker/positive_3_raw.bag": "no_return too_close rolling",
    "leg_tracker/positive_6_extracted.bag": "no_return too_close gaps clock rolling pace",
    "my_gazebo_tutorials/20_46_08/rosbag2_2024_11_22-20_46_08_0.db3": "clock",
    "my_gazebo_tutorials/20_53_49/rosbag2_2024_11_22-20_53_49_0.db3": "clock",
    "obstacle_detector/scans_demo.bag": "no_return*2 too_close*2",
    "pr2/mylaserdata.bag": "no_return",
    "real_clients/irs_a1scan.db3": "intensity",
    "robots_ii/mylaserdata_20151128.bag": "no_return frames drift",
    "robots_ii/src_mylaserdata_20151128.bag": "no_return duplicate observed frames drift",
    "ros2_selfdriving/circular_bag_framed_0522/circular_bag_framed_0.db3": "gaps clock",
    "ros2_selfdriving/full_bag_nav/full_bag_nav_0.db3": "clock",
    "ros2_selfdriving/full_bag_nav/scan.csv": "clock",
    "ros_behaviors_fsm/teleop/teleop_0.db3": "gaps*2 duplicate frames delay",
    "ros_behaviors_fsm/wall_follower/wall_follower_0.db3": "gaps*2 duplicate frames delay",
    "scan_tools/laser_scan_matcher_demo.bag": "frames",
    "scan_tools/laser_scan_matcher_demo_ros2branch_20230219.bag": "",
    "sick/rms_1xxx_lms_1xx_movement_off.bag": "too_close",
    "turtlebot/topics.bag": "frames",
}
"""Public recording → rules of its findings, and how many; each was held against the messages (docs/info.md)."""


@pytest.mark.slow
@needs_real_logs
@pytest.mark.parametrize("path", REAL)
def test_what_public_recordings_have(path: str) -> None:
    found = Counter(each.id for each in findings_of(REAL_LOGS / path))
    assert " ".join(rule if n == 1 else f"{rule}*{n}" for rule, n in found.items()) == REAL[path]


def test_json_has_no_nan() -> None:
    found = Finding("drift", "warning", "/scan", "laser", "no step", {"share": math.nan, "steps": 0, "ends": [1, 2]})
    assert found.as_dict()["evidence"] == {"share": None, "steps": 0, "ends": [1, 2]}


def test_only_some_topics_are_compared(tmp_path: Path) -> None:
    raw = sound().rows(slice(0, 12))
    write_log(tmp_path / "run.mcap", [replace(raw, topic=f"/scan_{k:02}") for k in range(20)])
    found = [each.topic for each in findings_of(tmp_path / "run.mcap")]
    assert found == [f"/scan_{k:02}" for k in range(1, 16)]


# --- fixes ----------------------------------------------------------------------------------------------------


def in_turns(raw: RawSweeps) -> RawSweeps:
    return replace(raw, ranges=np.where(np.arange(60)[:, None] % 2, raw.ranges[:, ::-1] + np.float32(0.7), raw.ranges))


def twice(raw: RawSweeps) -> RawSweeps:
    return raw.rows(np.arange(60) // 2)


FIXES: dict[str, tuple[Change, str]] = {
    "degrees": (scaled(angle_increment=14.0), "units --degrees"),
    "wide": (scaled(angle_increment=10.0), "geometry --degrees"),
    "millimetres": (scaled(ranges=1000.0, range_max=1000.0), "units --range-unit mm"),
    "centimetres": (scaled(ranges=100.0, range_max=100.0), "units --range-unit cm"),
    "nan": (filled(0.2, np.nan), "no_return --no-return inf,zero,max,above,pile,nan"),
    "pile": (filled(0.3, 11.5), "no_return --no-return inf,zero,max,above"),
    "beyond": (beyond, "limits --range 0 6"),
    "in turns": (in_turns, "frames --every 2"),
    "twice": (twice, "duplicate --every 2"),
    "time_increment": (scaled(time_increment=0.5), "rolling --no-deskew"),
    "codes": (lambda raw: filled(0.05, 0.004)(scaled(range_min=0.0)(raw)), "codes --range 0.02 12"),
}
"""Fault → its change of a sound log, and the rule that finds it with its fix."""


@pytest.mark.slow
@pytest.mark.parametrize("fault", FIXES)
@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_a_fault_is_gone_with_its_fix(fault: str, suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change, words = FIXES[fault]
    path = tmp_path / f"run{suffix}"
    write_log(path, [change(sound())])
    [found] = [each for each in findings_of(path) if each.fix is not None]
    assert found.fix is not None
    assert (f"{found.id} {found.fix.text}", found.fix.kind) == (words, "option")
    # info reads every sweep; other commands tell the same in a note.
    command = ["info"] if "--every" not in words else ["detect", "-o", str(tmp_path / "tables")]
    assert run([*command, str(path), *found.fix.text.split()]) == 0
    told = capsys.readouterr()
    assert " ".join(found.message.split()) not in " ".join((told.out + told.err).split())
    assert f"fix: {found.fix.text}" not in told.out


def test_every_fix_of_a_rule_is_tried() -> None:
    tried = {words.split()[1] for _, words in FIXES.values()}
    # Other tests try these on logs of their own.
    tried |= {"--topic", "--pose-delay"}
    declared = {rule.fix.split()[0] for rule in (*SWEEP_RULES, *LOG_RULES, REPEATED_TOPIC, STAMP) if rule.fix}
    assert declared - tried == {"{0.unit_option}", "{0.every}"}
