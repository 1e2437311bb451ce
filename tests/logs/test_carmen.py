"""CARMEN logs as the logger of CARMEN writes them, and as old and other writers do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import lidarcli
from lidarcli.cli.commands import run
from lidarcli.errors import UnreadableError
from lidarcli.logs.base import POSE_TYPES
from lidarcli.logs.carmen_lines import LASERS
from lidarcli.logs.registry import open_log
from lidarcli.pipeline.reading.found_poses import find_poses
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.pose.tracks import planar
from lidarcli.sweeps.types import RawSweeps, Status, concatenate
from tests.logs.watched import CarmenLog
from tests.places import SAMPLES
from tests.text_logs import simulate

HEADER = "# CARMEN Logfile\n# file format is one message per line\n"
GEOMETRY = "0 -1.570796 3.141593 0.785398 81.920000 0.010000 0"
RANGES = "5 1.000 2.000 81.910 4.000 5.000"
POSES = "1.100000 2.000000 0.000000 1.000000 2.000000 0.000000"
MOTION = "0.5 0.1 0.3 0.2 1000.0"


def flaser(stamp: str = "12.5", ranges: Sequence[float] = (1.0, 2.0, 3.0), poses: str = POSES) -> str:
    numbers = " ".join(f"{value:.3f}" for value in ranges)
    return f"FLASER {len(ranges)} {numbers} {poses} {stamp} nohost 3.25\n"


def log_of(folder: Path, text: str | bytes, name: str = "run.log") -> CarmenLog:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    OPENED.append(CarmenLog(path))
    return OPENED[-1]


OPENED: list[CarmenLog] = []


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    """Every log is closed in the end."""
    yield
    while OPENED:
        OPENED.pop().close()


def only(log: CarmenLog) -> RawSweeps:
    """All sweeps of a log with one topic, and nothing that was lost."""
    block = concatenate(list(log.scans()))
    assert (log.report.damage, log.report.refused) == ([], {})
    return block


LINES = {
    "FLASER": f"FLASER {RANGES} {POSES}",
    "RLASER": f"RLASER {RANGES} {POSES}",
    "LASER3": f"LASER3 {RANGES}",
    "LASER4": f"LASER4 {RANGES}",
    "REMISSIONFLASER": f"REMISSIONFLASER 5 1.000 10 2.000 20 81.910 0 4.000 7.5 5.000 9 {POSES}",
    "RAWLASER1": f"RAWLASER1 {GEOMETRY} {RANGES} 0",
    "RAWLASER2": f"RAWLASER2 {GEOMETRY} {RANGES} 5 7 7 7 7 7",
    "RAWLASER3": f"RAWLASER3 {GEOMETRY} {RANGES} 0",
    "RAWLASER4": f"RAWLASER4 {GEOMETRY} {RANGES} 2 7 7",
    "ROBOTLASER1": f"ROBOTLASER1 {GEOMETRY} {RANGES} 0 {POSES} {MOTION}",
    "ROBOTLASER2": f"ROBOTLASER2 {GEOMETRY} {RANGES} 5 1 2 3 4 5 {POSES} {MOTION}",
}
"""Each kind of sweep, up to its time."""


def test_every_kind_of_sweep_is_a_topic_of_its_own(tmp_path: Path) -> None:
    assert {*LINES} == {word.decode() for word in LASERS}
    text = HEADER + "".join(f"{line} 976052857.3 nohost 0.275\n" for line in LINES.values())
    log = log_of(tmp_path, text)
    blocks = {block.topic: block for block in log.scans()}
    assert log.report.damage == []
    assert {topic: block.frame_ids[0] for topic, block in blocks.items()} == {
        "/front_laser": "front_laser",
        "/rear_laser": "rear_laser",
        "/laser3": "laser3",
        "/laser4": "laser4",
        "/front_laser_remission": "front_laser",
        "/raw_laser1": "front_laser",
        "/raw_laser2": "rear_laser",
        "/raw_laser3": "laser3",
        "/raw_laser4": "laser4",
        "/robot_laser1": "front_laser",
        "/robot_laser2": "rear_laser",
    }
    topics = {topic.name: topic for topic in log.topics() or []}
    for topic, block in blocks.items():
        assert block.ranges.tolist() == [[1.0, 2.0, pytest.approx(81.91), 4.0, 5.0]]
        assert (block.stamp_ns.tolist(), block.beams.tolist()) == ([976_052_857_300_000_000], [5])
        assert (topics[topic].messages, topics[topic].encoding) == (1, "carmen")
        told = topic.startswith(("/raw", "/robot"))
        assert block.range_max.tolist() == [np.float32(81.92) if told else 80.0]
        # Both come to half a turn ahead: told, and guessed of five ranges.
        assert block.angle_min[0] == pytest.approx(-np.pi / 2, abs=1e-6)
        assert block.angle_increment[0] == pytest.approx(np.pi / 4, abs=1e-6)


@pytest.mark.parametrize(
    ("beams", "first", "step"),
    [
        (180, -90, 1),
        (181, -90, 1),
        (360, -90, 0.5),
        (361, -90, 0.5),
        (400, -50, 0.25),
        (401, -50, 0.25),
        (91, -90, 2),
        (1, -90, 180),
    ],
)
def test_geometry_is_guessed_by_the_number_of_ranges(beams: int, first: float, step: float, tmp_path: Path) -> None:
    log = log_of(tmp_path, flaser(ranges=[1.0] * beams) * 2)
    block = only(log)
    assert np.degrees(block.angle_min).tolist() == pytest.approx([first] * 2)
    assert np.degrees(block.angle_increment).tolist() == pytest.approx([step] * 2)
    [note] = log.report.notes
    assert note.startswith(f"/front_laser: {beams} beams taken from {first} degrees by ")


@pytest.mark.parametrize(
    ("parameters", "beams", "first", "step"),
    [
        ({"fov": 180, "resolution": 1}, 180, -90, 1),
        ({"fov": 180, "resolution": 1}, 181, -90, 1),
        ({"resolution": 0.5}, 361, -90, 0.5),
        ({"resolution": 0.5}, 360, -90, 0.5),
        ({"resolution": 0.25}, 1081, -135, 0.25),
        ({"fov": 270}, 1081, -135, 0.25),
        ({"fov": 180}, 180, -90, 1),
        ({"fov": 360, "resolution": 1}, 360, -180, 1),
        # Parameters of another sensor do not make this number of ranges.
        ({"fov": 180, "resolution": 1}, 361, -90, 0.5),
        ({"fov": -180, "resolution": 0}, 361, -90, 0.5),
    ],
)
def test_parameters_tell_the_geometry(
    parameters: dict[str, float], beams: int, first: float, step: float, tmp_path: Path
) -> None:
    lines = [f"PARAM laser_rear_laser_{name} {value} 0.1 nohost 0.1\n" for name, value in parameters.items()]
    sweep = flaser(ranges=[1.0] * beams).replace("FLASER", "RLASER")
    block = only(log_of(tmp_path, "".join(lines) + sweep))
    assert np.degrees(block.angle_min[0]) == pytest.approx(first)
    assert np.degrees(block.angle_increment[0]) == pytest.approx(step)


def test_a_parameter_counts_for_what_comes_after_it(tmp_path: Path) -> None:
    """Also within a block of lines, and without a number it counts for nothing."""

    def sweep(stamp: str) -> str:
        return flaser(stamp, ranges=[20.5, 30.0])

    text = sweep("12") + "PARAM robot_front_laser_max 20.5 nohost 0\n" + sweep("13")
    text += "PARAM robot_front_laser_max off nohost 0\nPARAM robot_front_laser_max\n" + sweep("14")
    text += "PARAM robot_front_laser_max 30 nohost 0\n" + sweep("15")
    inf = float("inf")
    assert only(log_of(tmp_path, text)).ranges.tolist() == [[20.5, 30.0], [inf, 30.0], [inf, 30.0], [20.5, inf]]


def test_what_is_cut_off_and_what_is_beyond_the_greatest_range_is_no_return(tmp_path: Path) -> None:
    """The parameter says where programs of the robot stop using ranges: the sensor sees what is beyond."""
    text = "PARAM robot_front_laser_max 50 nohost 0\n" + flaser(ranges=[49.9, 50.0, 50.1, 81.91, 0.0])
    log_of(tmp_path, text).close()
    [batch] = lidarcli.read(tmp_path / "run.log")
    assert batch.status.tolist() == [[Status.VALID, Status.NO_RETURN, Status.VALID, *[Status.NO_RETURN] * 2]]
    assert batch.range_max.tolist() == [80.0]


def test_steps_have_more_digits_than_six_decimals(tmp_path: Path) -> None:
    """Of a view and a step as printf writes them the view says more."""
    for view, beams in ((3.141593, 181), (3.141593, 180), (4.712389, 1081)):
        step = round(view / (beams - beams % 2), 6)
        head = f"RAWLASER1 2 {-view / 2:f} {view:f} {step:f} 30 0.01 0 {beams} {'1.0 ' * beams}0 1.5 nohost 1.5\n"
        block = only(log_of(tmp_path, head))
        assert block.angle_increment[0] == pytest.approx(view / (beams - beams % 2), abs=1e-15)
    nothing = only(log_of(tmp_path, f"RAWLASER1 2 0 0 0 0 0.01 0 181 {'1.0 ' * 181}0 1.5 nohost 1.5\n"))
    assert np.degrees([nothing.angle_min[0], nothing.angle_increment[0]]).tolist() == pytest.approx([-90, 1])
    assert nothing.range_max[0] == 80.0


@pytest.mark.parametrize(
    "line",
    [
        f"FLASER {RANGES} {POSES} 12.5 nohost",
        f"FLASER {RANGES} {POSES} 12.5",
        f"FLASER {RANGES} {POSES} 12.5 17 3.5",
        f"FLASER {RANGES} 1.1 2.0 0.0 12.5 nohost 3.5",
        f"FLASER {RANGES} 12.5 nohost 3.5",
        f"LASER3 {RANGES} 12.5",
        f"RAWLASER1 {GEOMETRY} {RANGES} 12.5 nohost 3.5",
        f"RAWLASER1 {GEOMETRY} {RANGES} 0 12.5 nohost",
        f"ROBOTLASER1 {GEOMETRY} {RANGES} 0 {POSES} 0.5 0.1 0.3 0.2 12.5 nohost 3.5",
        f"ROBOTLASER1 {GEOMETRY} {RANGES} {POSES} {MOTION} 12.5 nohost 3.5",
        f"ROBOTLASER1 {GEOMETRY} {RANGES} {POSES} 12.5 nohost 3.5",
        f"ROBOTLASER1 {GEOMETRY} {RANGES} 0 0 0 0 0 0 12.5 nohost 3.5",
    ],
)
def test_old_writers_leave_fields_out(line: str, tmp_path: Path) -> None:
    log = log_of(tmp_path, f"{line}\n")
    block = only(log)
    assert block.ranges[0].tolist() == [1.0, 2.0, pytest.approx(81.91), 4.0, 5.0]
    assert block.stamp_ns.tolist() == [12_500_000_000]
    told = {message.topic for message in log.messages(POSE_TYPES)}
    assert log.report.damage == []
    if POSES in line or "0 0 0 0 0 0" in line:
        assert told == {"/odom", "/corrected", "/tf_static"}
    else:
        assert told == ({"/odom"} if "1.1" in line else set())


def test_times_may_begin_at_zero_repeat_and_go_back(tmp_path: Path) -> None:
    stamps = ["0.000000", "0.000000", "0.000000", "1.5", "0.7", "0.7"]
    log = log_of(tmp_path, "".join(map(flaser, stamps)))
    expected = [0, 1, 2, 1_500_000_000, 700_000_000, 700_000_001]
    assert only(log).stamp_ns.tolist() == expected
    poses = [message for message in log.messages(POSE_TYPES) if message.topic == "/odom"]
    assert [message.record_ns for message in poses] == expected


def test_equal_times_stay_apart_from_block_to_block(tmp_path: Path) -> None:
    block = only(log_of(tmp_path, flaser("7") * 30_000))
    assert block.stamp_ns.tolist() == list(range(7_000_000_000, 7_000_030_000))


def test_bad_lines_are_left_out_and_counted(tmp_path: Path) -> None:
    """Each by its number and its cause; what other programs log is passed over."""
    bad = {
        "FLASER 3 1.0 x 3.0 0 0 0 0 0 0 1.0 nohost 1.0": "'x' is not a number",
        "FLASER 5 1.0 2.0": "it declares 5 ranges and has fewer",
        "FLASER -3 1.0 2.0 3.0 0 0 0 0 0 0 1.0 nohost 1.0": "'-3' is no number of ranges",
        "FLASER": "cut off",
        "FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0": "no time at its end",
        "FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 late nohost 1.0": "no time at its end",
        "RAWLASER1 0 -1.5 one 0.1 80 0.01 0 2 1.0 2.0 0 1.0 nohost 1.0": "'one' is not a number",
        "1.0 2.0 3.0": "'1.0' is no message",
        "\x01\x02FLASER 3": "'??FLASER' is no message",
    }
    others = "SYNC tag 1 h 1\nGLOBALPOS 1 2 3 4 5 6 h 1\nNMEAGGA 1\nIMU 0 0\n# remark\n\nSCANMARK\nVISION_X 1\n"
    text = others + flaser() + "".join(f"{line}\n" for line in bad) + flaser("13")
    log = log_of(tmp_path, text)
    assert sum(map(len, log.scans())) == 2
    assert {part.place: part.cause for part in log.report.damage} == {
        f"line {10 + at}": cause for at, cause in enumerate(bad.values())
    }
    assert run(["info", str(tmp_path / "run.log")]) == 3


@pytest.mark.parametrize("end", ["\n", ""])
def test_more_ranges_than_any_sensor_has_are_refused(end: str, tmp_path: Path) -> None:
    log = log_of(tmp_path, f"{flaser()}FLASER 500000 1.0{end}")
    assert sum(map(len, log.scans())) == 1
    assert (log.report.damage, [*log.report.refused.values()]) == ([], [1])


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        (f"FLASER 5 1 2 3 4 {POSES}", "it declares 5 ranges, but one field is missing"),
        (f"FLASER 5 1 2 {POSES}", "3 missing"),
        (f"FLASER 3 1 2 3 4 5 {POSES}", "2 fields left over behind the 3 ranges it declares"),
        (f"RLASER 180 {'2.5 ' * 361}{POSES}", "181 fields left over behind the 180 ranges it declares"),
        ("LASER3 2 1 2 3", "1 field left over behind the 2 ranges it declares"),
        (f"REMISSIONFLASER 2 1.0 7 2.0 9 3.0 7 {POSES}", "2 fields left over behind the 2 ranges it declares"),
        (f"RAWLASER1 {GEOMETRY} 4 1.0 2.0 3.0 4.0 5.0 0", "2 fields left over behind the 4 ranges it declares"),
        (f"ROBOTLASER1 {GEOMETRY} 4 1.0 2.0 3.0 4.0 5.0 0 {POSES} {MOTION}", "13 fields left over"),
    ],
)
@pytest.mark.parametrize("end", ["12.5 nohost 3.5", "12.5 nohost"])
def test_a_number_of_ranges_that_is_none_of_the_line_is_damage(line: str, cause: str, end: str, tmp_path: Path) -> None:
    if cause == "3 missing":
        line, cause = (line.replace("FLASER 5", "FLASER 5 3"), "it declares 5 ranges, but 2 fields are missing")
    log = log_of(tmp_path, f"{flaser()}{line} {end}\n")
    assert sum(map(len, log.scans())) == 1
    [part] = log.report.damage
    assert part.place == "line 2"
    assert part.cause.startswith(cause)


@pytest.mark.parametrize(
    ("declared", "has", "behind"),
    [
        (181, 180, "0 1.5 2.5 0.1 1.5 2.5 0.1 0.5 0.0 0.1 0.2 1000.0"),
        (181, 180, "0 0 0 0 0 0 0 0.5 0.0 0.1 0.2 1000.0"),
        (183, 181, "0 1.5 2.5 0.1 1.5 2.5 0.1 0.5 0.0 0.1 0.2 1000.0"),
        (182, 181, "0 0 0 0 0 0 0 0 0 0 0 0"),
        (187, 181, "0 1.5 2.5 0.1 1.5 2.5 0.1 0.5 0.0 0.1 0.2 1000.0"),
        (361, 180, f"180 {'7.5 ' * 180}1.5 2.5 0.1 1.5 2.5 0.1 0.5 0.0 0.1 0.2 1000.0"),
    ],
)
def test_a_number_of_remissions_tells_how_many_ranges_there_are(
    declared: int, has: int, behind: str, tmp_path: Path
) -> None:
    """However many fields that leaves: old writers have left some out, but never that one alone."""
    for word, rest in (("ROBOTLASER1", behind), ("RAWLASER1", "0")):
        line = f"{word} {GEOMETRY} {{}} {'2.125 ' * has}{rest} 12.5 nohost 3.5\n"
        log = log_of(tmp_path, line.format(has) + line.format(declared if rest == behind else has + 1))
        assert sum(map(len, log.scans())) == 1
        counts = (declared if rest == behind else has + 1, has)
        [part] = log.report.damage
        assert (part.place, part.cause) == ("line 2", "it declares {} ranges and has {}".format(*counts))


@pytest.mark.parametrize(
    ("fields", "cause"),
    [(3, "it declares 9 ranges, but 3 fields are missing"), (0, "it declares 9 ranges, but 6 fields are missing")],
)
def test_a_line_that_differs_from_most_of_its_laser_is_damage(fields: int, cause: str, tmp_path: Path) -> None:
    """What is missing are ranges, not poses; lines with another number of ranges say nothing of it."""
    lines = [flaser(f"{at}", ranges=[1.5] * 9) for at in range(10, 20)]
    lines[0] = f"FLASER 9 {'1.500 ' * (3 + fields)}{POSES} 10 nohost 0\n"
    lines[5] = f"FLASER 4 {'1.500 ' * (fields - 2)}{POSES} 15 nohost 0\n" if fields else lines[5]
    log = log_of(tmp_path, "".join(lines))
    assert sum(map(len, log.scans())) == 9
    assert [(part.place, part.cause) for part in log.report.damage] == [("line 1", cause)]
    # And the other way about.
    old = f"FLASER 9 {'1.500 ' * 9}{' '.join(POSES.split()[:fields])} {{}} nohost 0\n".replace("  ", " ")
    log = log_of(tmp_path, "".join(map(old.format, range(10, 20))) + flaser("20", [1.5] * 9))
    assert sum(map(len, log.scans())) == 10
    [part] = log.report.damage
    assert part.cause == f"{6 - fields} fields left over behind the 9 ranges it declares"


@pytest.mark.parametrize("poses", [f" {POSES}", " 1.0 2.0 0.5", ""])
def test_a_log_without_times_is_read_in_its_order(poses: str, tmp_path: Path) -> None:
    """With one note; where some lines have times, the others are damaged."""
    text = "".join(f"FLASER 3 1.0 2.0 {k}.5{poses}\n" for k in range(1, 9))
    log = log_of(tmp_path, text)
    block = only(log)
    assert block.stamp_ns.tolist() == [*range(8)]
    assert block.ranges[:, 2].tolist() == [k + 0.5 for k in range(1, 9)]
    assert sum("no time" in note for note in log.report.notes) == 1
    timed = log_of(tmp_path, flaser() + text, "timed.log")
    assert sum(map(len, timed.scans())) == 1
    assert {part.cause for part in timed.report.damage} == {"no time at its end"}


def test_a_last_line_that_is_cut_is_no_sweep(tmp_path: Path) -> None:
    """Unless all that belongs to it is there."""
    whole = flaser("12.5") + flaser("13.5")
    for cut in range(len(flaser()) + 1, len(whole)):
        log = log_of(tmp_path, whole[:cut])
        found = sum(map(len, log.scans()))
        sure = whole[:cut].endswith(("nohost 3", "nohost 3.", "nohost 3.2", "nohost 3.25"))
        assert (found, len(log.report.damage)) == ((2, 0) if sure else (1, 1)), whole[:cut][-30:]


@pytest.mark.parametrize(
    "text",
    [
        "2026-11-22 10:00:00 INFO started\n",
        "PARAM,value\n1,2\n",
        "ODOMETER 1 2 3\n",
        "FLASERX 1 2\n",
        "# a remark\ntime,r0,r1,r2\n",
    ],
)
def test_other_texts_are_no_carmen_logs(text: str, tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.write_text(text)
    with pytest.raises(UnreadableError):
        open_log(path)


def pose_of(path: Path, frame: str, at: float, source: str | None = None) -> list[float]:
    """x, y and yaw of a sensor frame at a time."""
    with open_log(path) as log:
        found = find_poses(log, PoseOptions(source=source))
        assert found is not None
        way = found.sources.chain(frame)
        assert way is not None
        here = planar(way.at(np.array([round(at * 1e9)])))
    return [float(here.x[0]), float(here.y[0]), float(here.yaw[0])]


def moving(laser: str, word: str = "FLASER") -> str:
    """Two sweeps of a robot that goes 1 m to the north, where the laser is said to be at `laser` from there."""
    dx, dy = map(float, laser.split())
    return "".join(
        f"{word} 2 1.0 1.0 {1 + dx} {2 + y + dy} 1.570796 1.0 {2.0 + y} 1.570796 {10 + y} nohost 0\n" for y in (0, 1)
    )


def test_odometry_is_taken_unasked_with_the_mount_of_the_parameters(tmp_path: Path) -> None:
    """The corrected path leads elsewhere."""
    text = "PARAM robot_frontlaser_offset 0.25 nohost 0\nPARAM robot_frontlaser_side_offset 0.5 nohost 0\n"
    path = tmp_path / "run.gfs"
    path.write_text(text + moving("5 7"))
    assert pose_of(path, "front_laser", 10.5) == pytest.approx([0.5, 2.75, np.pi / 2], abs=1e-6)
    assert pose_of(path, "front_laser", 10.5, "odom") == pytest.approx([0.5, 2.75, np.pi / 2], abs=1e-6)
    assert pose_of(path, "front_laser", 10.5, "/corrected") == pytest.approx([6.0, 9.5, np.pi / 2], abs=1e-6)


def test_the_mount_is_found_by_poses_that_keep_their_distance(tmp_path: Path) -> None:
    """As long as it is one that a robot has."""
    path = tmp_path / "run.log"
    path.write_text(moving("0 0.3"))
    assert pose_of(path, "front_laser", 10.5) == pytest.approx([1.0, 2.8, np.pi / 2], abs=1e-6)
    path.write_text(moving("5 7"))
    assert pose_of(path, "front_laser", 10.5) == pytest.approx([1.0, 2.5, np.pi / 2], abs=1e-6)


def test_poses_that_are_one_tell_that_no_mount_was_used(tmp_path: Path) -> None:
    """Whatever a parameter says of it; of a rear laser they would hide where it looks."""
    same = "1.5 2.5 0.500000 1.5 2.5 0.500000"
    path = tmp_path / "run.log"
    lines = "".join(flaser(f"{stamp}", poses=same) for stamp in (10, 11, 12))
    path.write_text("PARAM robot_frontlaser_offset -0.04 nohost 0\n" + lines)
    assert pose_of(path, "front_laser", 10.5) == pytest.approx([1.5, 2.5, 0.5], abs=1e-6)
    path.write_text("PARAM robot_rearlaser_offset -0.04 nohost 0\n" + lines.replace("FLASER", "RLASER"))
    assert pose_of(path, "rear_laser", 10.5)[2] == pytest.approx(0.5 - np.pi, abs=1e-6)


def test_a_rear_laser_looks_backwards(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    text = "PARAM robot_rearlaser_offset -0.4 nohost 0\n" + moving("0 0", "RLASER")
    path.write_text(text)
    assert pose_of(path, "rear_laser", 10.5) == pytest.approx([1.0, 2.1, -np.pi / 2], abs=1e-6)
    path.write_text(f"PARAM robot_rearlaser_angular_offset 3.1 nohost 0\n{text}")
    assert pose_of(path, "rear_laser", 10.5)[2] == pytest.approx(np.pi / 2 + 3.1 - 2 * np.pi, abs=1e-6)


def test_lines_of_odometry_tell_where_no_sweep_does(tmp_path: Path) -> None:
    odom = "".join(f"ODOM {x} 0 0 1 0 0 {10 + x} nohost 0\n" for x in (0.0, 1.0))
    true = "".join(f"TRUEPOS {x} 9 0 {x} 0 0 {10 + x} nohost 0\n" for x in (0.0, 1.0))
    path = tmp_path / "run.log"
    path.write_text(f"{odom}{true}LASER3 2 1.0 1.0 10.5 nohost 0\n")
    assert pose_of(path, "laser3", 10.5) == pytest.approx([0.5, 0, 0])
    assert pose_of(path, "laser3", 10.5, "truepos") == pytest.approx([0.5, 9, 0])
    path.write_text(odom + moving("0 0"))
    assert pose_of(path, "front_laser", 10.5)[1] == pytest.approx(2.5)
    path.write_text(odom + "FLASER 2 1.0 1.0 10.5 nohost 0\n")
    assert pose_of(path, "front_laser", 10.5) == pytest.approx([0.5, 0, 0])


def test_a_pose_that_is_no_number_is_left_out(tmp_path: Path) -> None:
    log = log_of(tmp_path, moving("0 0") + flaser("12", poses="0 0 0 0 a 0"))
    assert sum(message.topic == "/odom" for message in log.messages(POSE_TYPES)) == 2
    assert [part.cause for part in log.report.damage] == ["its pose: 'a' is not a number"]
    assert sum(map(len, log.scans())) == 3


@pytest.mark.parametrize("scene", ["drive", "room"])
def test_a_simulated_scene_is_that_of_an_mcap(scene: str, tmp_path: Path) -> None:
    """Objects, and where they are in the world, as far as the last digits of angles let them."""
    tables = []
    for name in ("run.mcap", "run.log"):
        simulate(SAMPLES / f"{scene}.toml", tmp_path / name, sweeps=20)
        tables.append(lidarcli.detect(tmp_path / name).to_pandas())
    mcap, carmen = tables
    assert len(mcap) == len(carmen) > 20
    assert mcap["stamp"].tolist() == carmen["stamp"].tolist()
    numbers = [name for name in mcap.select_dtypes("number").columns if name != "sweep"]
    assert len(numbers) > 10
    np.testing.assert_allclose(mcap[numbers], carmen[numbers], atol=1e-6)
    words = (tmp_path / "run.log").read_text()
    assert ("\nFLASER " in words, "\nRAWLASER1 " in words) == ((scene == "drive"), (scene == "room"))
