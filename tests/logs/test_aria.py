"""ARIA logs as the loggers of its versions write them, and as other programs do."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.aria import sensor_of
from lidarcli.logs.base import MAX_BEAMS, POSE_TYPES, OpenOptions, ReadReport
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.simulation import simulate
from lidarcli.sweeps import Status
from tests.logs.robots import Opener, only, pose_of
from tests.logs.watched import AriaLog
from tests.places import SAMPLES

VERSION_4 = """LaserOdometryLog
#Created by ArLaserLogger
version: 4
sick1pose: 100 50 90.00
sick1conf: -90.00 90.00 5
sick1name: lms2xx_1
scan1pose: 100 50 300 90.00
scan1conf: -90.00 90.00 5
scan1name: lms2xx_1
locationTypes: robot robotGlobal
"""
"""What stands at the beginning; the laser looks to the left of the robot."""
RANGES = [1000.0, 2000.0, 0.0, 4000.0, 5000.0]
"""Of the five beams, the middle one without a return."""


def scan(scan_id: int = 0, time: str = "12.050", points: str = "", robot: str = "1000 2000 45.00") -> str:
    return (
        f"logTime: {time}\nvelocities: 10.00 0.00 0.00\nscanId: {scan_id}\nrobot: {robot}\n"
        f"robotGlobal: 5000 6000 90.00\nscan1: {points or from_laser(RANGES)}\n"
    )


def pairs(points: np.ndarray) -> str:
    """Points as ARIA writes them: whole millimetres."""
    return "".join(f"{x:.0f} {y:.0f}  " for x, y in points.tolist())


def from_laser(ranges: Sequence[float], first: float = -90.0, last: float = 90.0) -> str:
    """The points of a sweep in the frame of the laser."""
    angles = np.radians(np.linspace(first, last, len(ranges)))
    return pairs(np.array(ranges)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


log_of = Opener(AriaLog)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    """Every log is closed in the end."""
    yield
    log_of.close()


def test_points_of_version_4_become_ranges(tmp_path: Path) -> None:
    log = log_of(tmp_path, VERSION_4 + scan() + "# End of log\n")
    block = only(log)
    assert (block.topic, block.frame_ids, log.format) == ("/scan1", ("laser1",), "aria")
    assert block.ranges.tolist() == [pytest.approx([1.0, 2.0, 0.0, 4.0, 5.0], abs=1e-3)]
    assert np.degrees([block.angle_min[0], block.angle_increment[0]]).tolist() == pytest.approx([-90, 45])
    assert (block.stamp_ns.tolist(), block.range_max.tolist()) == ([12_050_000_000], [np.inf])
    assert {topic.name: topic.messages for topic in log.topics() or []} == {
        "/scan1": 1,
        "/odom": 1,
        "/corrected": 1,
        "/tf_static": 1,
    }
    assert log.report.notes == []
    log.close()
    [batch] = lidarcli.read(tmp_path / "run.log")
    assert batch.status[0].tolist() == [Status.VALID, Status.VALID, Status.NO_RETURN, Status.VALID, Status.VALID]


def test_ranges_of_old_versions(tmp_path: Path) -> None:
    """Millimetres; times as other programs write them are decimal numbers."""
    text = "LaserOdometryLog\n#Created by hand\nversion: 1\nsick1pose: 0 0 0\nsick1conf: -90 90 181\n"
    text += f"#scan0\ntime: 1.5\nrobot: 0 0 0 10 0\nrobot_id: 0\nsick1: {' '.join(map(str, range(181)))}\n"
    block = only(log_of(tmp_path, text))
    assert (block.topic, block.stamp_ns.tolist()) == ("/sick1", [1_500_000_000])
    assert block.ranges[0].tolist() == pytest.approx([mm / 1000 for mm in range(181)])
    assert np.degrees([block.angle_min[0], block.angle_increment[0]]).tolist() == pytest.approx([-90, 1])


@pytest.mark.parametrize(
    ("version", "by", "time", "expected_ns"),
    [
        (2, "ARIA's ArSickLogger", "12.5", 12_005_000_000),
        (3, "ARIA's ArLaserLogger", "12.50", 12_050_000_000),
        (3, "ARIA's ArLaserLogger", "12.500", 12_500_000_000),
        (4, "ArLaserLogger", "12.050", 12_050_000_000),
        (3, "hand", "12.5", 12_500_000_000),
        (1, "Master", "12:30:01", 45_001_000_000_000),
    ],
)
def test_milliseconds_of_aria_before_version_4_have_no_leading_zeros(
    version: int, by: str, time: str, expected_ns: int, tmp_path: Path
) -> None:
    text = VERSION_4.replace("version: 4", f"version: {version}").replace("by ArLaserLogger", f"by {by}")
    block = only(log_of(tmp_path, text + scan(time=time).replace("logTime", "time")))
    assert block.stamp_ns.tolist() == [expected_ns]


MANY = np.linspace(500, 4000, 181)
WIDE = VERSION_4.replace("90.00 5", "90.00 181")
ANGLES = np.radians(np.arange(-90, 91))


def seen(turn: float, x: float, y: float) -> str:
    """The points of `MANY` ranges, turned and moved."""
    ends = np.column_stack([MANY * np.cos(ANGLES + turn) + x, MANY * np.sin(ANGLES + turn) + y])
    return pairs(ends)


@pytest.mark.parametrize(
    ("version", "points", "note"),
    [
        (4, seen(0, 0, 0), ""),
        (3, seen(np.pi / 2, 0, 0), ""),
        (3, seen(0, 0, 0), ""),
        (4, seen(np.pi / 2, 0, 0), ""),
        (4, seen(np.pi / 2, 100, 50), "/scan1: points are told from the robot on, not from the laser"),
    ],
)
def test_bearings_tell_in_whose_frame_points_are(version: int, points: str, note: str, tmp_path: Path) -> None:
    """The laser is at 0.1, 0.05 m and looks to the left; documentation and loggers of ARIA say different things."""
    text = WIDE.replace("version: 4", f"version: {version}")
    log = log_of(tmp_path, text + scan(points=points) + scan(time="13.0", points=points))
    block = only(log)
    np.testing.assert_allclose(block.ranges, np.tile(MANY / 1000, (2, 1)), atol=1e-3)
    assert log.report.notes == ([note] if note else [])


@pytest.mark.parametrize("conf", ["90.00 -90.00 181", "-90.00 90.00 181"])
def test_a_sweep_may_begin_on_the_left(conf: str, tmp_path: Path) -> None:
    """Whether the line with the angles says so or not: where the points are decides."""
    ends = np.column_stack([MANY * np.cos(-ANGLES), MANY * np.sin(-ANGLES)])
    text = WIDE.replace("-90.00 90.00 181", conf)
    block = only(log_of(tmp_path, text + scan(points=pairs(ends))))
    np.testing.assert_allclose(block.ranges[0], MANY / 1000, atol=1e-3)
    assert np.degrees([block.angle_min[0], block.angle_increment[0]]).tolist() == pytest.approx([90, -1])


def test_a_full_circle_that_begins_backwards(tmp_path: Path) -> None:
    """ARIA has no angle of -180 degrees: it writes 180."""
    angles = np.radians(np.arange(-180, 180))
    ranges = np.linspace(500, 4000, 360)
    ends = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
    text = WIDE.replace("-90.00 90.00 181", "180.00 179.00 360")
    block = only(log_of(tmp_path, text + scan(points=pairs(ends))))
    np.testing.assert_allclose(block.ranges[0], ranges / 1000, atol=1e-3)
    assert np.degrees([block.angle_min[0], block.angle_increment[0]]).tolist() == pytest.approx([-180, 1])


def test_points_in_no_order_go_where_their_bearings_say(tmp_path: Path) -> None:
    ends = np.column_stack([MANY * np.cos(ANGLES), MANY * np.sin(ANGLES)])
    shuffled = np.random.default_rng(1).permutation(len(ends))
    log = log_of(tmp_path, WIDE + scan(points=pairs(ends[shuffled])))
    np.testing.assert_allclose(only(log).ranges[0], MANY / 1000, atol=1e-3)
    assert log.report.notes == ["/scan1: points do not lie in the order of the beams; each is put where its bearing says"]


def test_beams_that_are_left_out_stay_holes(tmp_path: Path) -> None:
    """Fewer points than beams: each goes where its bearing says; what is beside the view is told."""
    ends = np.column_stack([MANY * np.cos(ANGLES), MANY * np.sin(ANGLES)])
    some = np.delete(ends, [0, 7, 8, 180], axis=0)
    log = log_of(tmp_path, WIDE + scan(points=pairs(ends)) + scan(time="13", points=pairs(some)))
    block = only(log)
    assert np.flatnonzero(block.ranges[1] == 0).tolist() == [0, 7, 8, 180]
    np.testing.assert_allclose(block.ranges[1][9:180], MANY[9:180] / 1000, atol=1e-3)
    log = log_of(tmp_path, WIDE + scan(points=pairs(np.vstack([some, [[-1000, 0]]]))))
    assert sum(map(len, log.scans())) == 1
    assert [(part.place, part.cause) for part in log.report.damage] == [
        ("line 16", "1 points are beside the view of the laser")
    ]


def test_every_laser_is_a_topic(tmp_path: Path) -> None:
    """One laser that is written in two ways has two topics and one frame."""
    text = VERSION_4 + "scan2pose: -100 0 200 180.00\nscan2conf: -45.00 45.00 3\nurg1conf: -45 45 3\n"
    text += scan() + "scan2: 1000 -1000  2000 0  0 0  \nsick1: 1000 2000 0 4000 5000\nurg1: 7 8 9\nscanner: 5\n"
    log = log_of(tmp_path, text)
    blocks = {block.topic: block for block in log.scans()}
    assert {topic: block.frame_ids[0] for topic, block in blocks.items()} == {
        "/scan1": "laser1",
        "/scan2": "laser2",
        "/sick1": "laser1",
        "/urg1": "urg1",
    }
    assert blocks["/scan2"].ranges[0].tolist() == pytest.approx([np.sqrt(2), 2.0, 0.0], abs=1e-6)
    assert blocks["/urg1"].ranges[0].tolist() == pytest.approx([0.007, 0.008, 0.009])
    assert log.report.damage == []
    assert sensor_of(b"reflector1:") is None


def test_wrapping_and_blanks_change_nothing(tmp_path: Path) -> None:
    text = VERSION_4 + scan() + scan(1, "13.000")
    block = only(log_of(tmp_path, text))
    variants: list[bytes] = [
        text.replace("\n", "\r\n").encode(),
        text.replace(" ", "\t").encode(),
        text.replace("\n", "  \n\n").encode(),
        b"\xef\xbb\xbf" + text.encode(),
        gzip.compress(text.encode(), mtime=0),
        text.replace("logTime", "time").encode(),
    ]
    for variant in variants:
        log = log_of(tmp_path, variant, "any.txt")
        with open_log(tmp_path / "any.txt") as opened:
            assert opened.format == "aria"
        found = only(log)
        assert np.array_equal(found.ranges, block.ranges)
        assert found.stamp_ns.tolist() == block.stamp_ns.tolist() == [12_050_000_000, 13_000_000_000]
        with open_log(io.BytesIO(variant)) as opened:
            assert sum(map(len, opened.scans(None, ReadReport()))) == 2
            assert opened.topics() is None


def test_bad_lines_are_left_out_and_counted(tmp_path: Path) -> None:
    """Each by its number and its cause; tags of other things are passed over."""
    bad = {
        "scan1: 1000 x  0 0  0 0  0 0  0 0": "'x' is not a number",
        "scan1: 1000 0  0": "a point has one number only",
        "scan1conf: -90 90": "three numbers are expected here",
        "1000 2000 3000": "'1000' is no tag",
        "\x01scan1: 5": "'?scan1:' is no tag",
        "logTime: late": "'late' is no time",
        "scan1: 1 0  0 0  0 0  0 0  0 0": "its time is none",
    }
    others = '\n# remark\nreflector1: 0 0 0\ncairn: GoalWithHeading "" ICON_GOALWITHHEADING "goal1"\nloop: start 1\n'
    log = log_of(tmp_path, VERSION_4 + others + scan() + "".join(f"{line}\n" for line in bad) + scan(1, "13.0"))
    assert sum(map(len, log.scans())) == 2
    first = 1 + (VERSION_4 + others + scan()).count("\n")
    assert {part.place: part.cause for part in log.report.damage} == {
        f"line {first + at}": cause for at, cause in enumerate(bad.values())
    }
    assert run(["info", str(tmp_path / "run.log")]) == 3


def test_a_last_line_that_is_cut_is_no_sweep(tmp_path: Path) -> None:
    whole = VERSION_4 + scan() + scan(1, "13.000")
    for cut in range(whole.rindex("scan1:"), len(whole)):
        log = log_of(tmp_path, whole[:cut])
        found = sum(map(len, log.scans()))
        assert (found, len(log.report.damage)) == (1, int(not whole[:cut].endswith("\n"))), cut


def test_counts_of_a_hostile_line_take_no_memory(tmp_path: Path) -> None:
    many, few = "more than 400000 beams declared", "far fewer points than the laser has beams"
    unknown = "no angles of scan1 before it (tell --angle-min and --angle-increment, or --fov)"
    for samples, cause in (
        ("1e9", many),
        (str(MAX_BEAMS + 1), many),
        (str(MAX_BEAMS), few),
        ("999999999999", unknown),
        ("0", unknown),
        ("nan", unknown),
    ):
        log = log_of(tmp_path, VERSION_4.replace("90.00 5", f"90.00 {samples}") + scan())
        assert list(log.scans()) == []
        assert (log.report.damage, log.report.refused) == ([], {("/scan1", cause): 1}), samples


def test_angles_beyond_all_numbers_are_refused(tmp_path: Path) -> None:
    log = log_of(tmp_path, VERSION_4.replace("90.00 5", "inf 5") + scan())
    assert list(log.scans()) == []
    assert log.report.refused == {("/scan1", "angle_increment is not finite"): 1}


def test_a_laser_of_one_beam(tmp_path: Path) -> None:
    text = VERSION_4.replace("-90.00 90.00 5", "0.00 0.00 1")
    assert only(log_of(tmp_path, text + scan(points="1000 0"))).ranges.tolist() == [[1.0]]
    log = log_of(tmp_path, text + scan(points="1000 0  1000 10"))
    assert [block.ranges.tolist() for block in log.scans()] == [[[0.0]]]
    assert [part.cause for part in log.report.damage] == ["2 points are beside the view of the laser"]


def test_without_angles_options_tell_them(tmp_path: Path) -> None:
    text = "LaserOdometryLog\nversion: 1\ntime: 1.0\nsick1: 1000 2000 3000\n"
    log = log_of(tmp_path, text)
    assert list(log.scans()) == []
    cause = "no angles of sick1 before it (tell --angle-min and --angle-increment, or --fov)"
    assert log.report.refused == {("/sick1", cause): 1}
    block = only(log_of(tmp_path, text, options=OpenOptions(fov=2.0, range_max=2.5)))
    assert (block.angle_min[0], block.angle_increment[0], block.range_max[0]) == (-1.0, 1.0, 2.5)


def test_a_log_without_times_is_read_with_a_note(tmp_path: Path) -> None:
    text = "LaserOdometryLog\nversion: 1\nsick1conf: -90 90 2\n" + "robot: 0 0 0\nsick1: 1000 2000\n" * 3
    log = log_of(tmp_path, text)
    assert only(log).stamp_ns.tolist() == [0, 1, 2]
    assert log.report.notes == ["no time in the log: all stamps are 0"]
    assert [message.record_ns for message in log.messages(POSE_TYPES)] == [0, 1, 2]


def test_blocks_of_lines_make_no_difference(tmp_path: Path) -> None:
    """A time, a pose and a sweep may stand in three blocks of text."""
    points = seen(0, 0, 0)
    text = WIDE + "".join(scan(at, f"{at}.000", points, f"{at} 0 0") for at in range(1500))
    log = log_of(tmp_path, text)
    block = only(log)
    assert block.stamp_ns.tolist() == [at * 1_000_000_000 for at in range(1500)]
    assert (block.ranges == block.ranges[0]).all()
    stamps = [message.record_ns for message in log.messages(POSE_TYPES) if message.topic == "/odom"]
    assert stamps == block.stamp_ns.tolist()


@pytest.mark.parametrize("text", ["LaserOdometryLogs\nversion: 4\n", "LaserOdometryLog,1\n", "version: 4\nscan1: 1 2\n"])
def test_other_texts_are_no_aria_logs(text: str, tmp_path: Path) -> None:
    path = tmp_path / "run.2d"
    path.write_text(text)
    with pytest.raises(UnreadableError):
        open_log(path)


# Poses.


def test_odometry_is_taken_unasked_with_the_mount_of_the_laser(tmp_path: Path) -> None:
    """Millimetres and degrees; the laser is 0.1 m ahead, 0.05 m to the left, and looks there."""
    path = tmp_path / "run.2d"
    path.write_text(VERSION_4 + scan(time="10.000", robot="1000 2000 0.00") + scan(time="12.000", robot="3000 2000 0.00"))
    assert pose_of(path, "laser1", 11) == pytest.approx([2.1, 2.05, np.pi / 2])
    corrected = pose_of(path, "laser1", 11, "corrected")
    assert corrected[:2] == pytest.approx([4.95, 6.1])
    assert abs(corrected[2]) == pytest.approx(np.pi)


def test_each_laser_is_where_the_robot_was_at_its_own_pose(tmp_path: Path) -> None:
    """Several lasers of one time, each behind the pose of the robot at its sweep."""
    second = "scanId: 1\nrobot: 1500 2000 0.00\nscan2: 1000 0  0 1000  \n"
    text = VERSION_4 + "scan2conf: 0 90 2\n" + scan(robot="1000 2000 0.00") + second
    log = log_of(tmp_path, text)
    stamps = {block.topic: block.stamp_ns.tolist() for block in log.scans()}
    assert stamps == {"/scan1": [12_050_000_000], "/scan2": [12_050_000_001]}
    log.close()
    assert pose_of(tmp_path / "run.log", "laser2", 12.050000001)[0] == pytest.approx(1.5)


def test_a_pose_that_is_none_is_left_out(tmp_path: Path) -> None:
    text = VERSION_4 + scan() + scan(1, "13.0", robot="1000 a 0") + scan(2, "14.0", robot="1000")
    log = log_of(tmp_path, text.replace("robotGlobal: 5000 6000 90.00", "robotGlobal: "))
    assert [message.topic for message in log.messages(POSE_TYPES)] == ["/odom", "/tf_static"]
    assert [part.cause for part in log.report.damage] == [
        "its pose: 'a' is not a number",
        "it has less numbers than a pose",
    ]


def test_a_simulated_drive_is_that_of_an_mcap(tmp_path: Path) -> None:
    """Objects, and where they are in the world."""
    tables = []
    for name in ("run.mcap", "run.2d"):
        simulate(SAMPLES / "drive.toml", tmp_path / name, sweeps=20, overwrite=True)
        tables.append(lidarcli.detect(tmp_path / name).to_pandas())
    mcap, aria = tables
    assert len(mcap) == len(aria) > 20
    assert mcap["world_x"].notna().all()
    numbers = [name for name in mcap.select_dtypes("number").columns if name != "sweep"]
    np.testing.assert_allclose(mcap[numbers], aria[numbers], atol=1e-6)


def test_whole_millimetres_move_objects_by_no_more(tmp_path: Path, rounded: Callable[[str], str]) -> None:
    """The same drive, rounded as ARIA rounds it."""
    simulate(SAMPLES / "drive.toml", tmp_path / "run.mcap", sweeps=5)
    simulate(SAMPLES / "drive.toml", tmp_path / "run.2d", sweeps=5, overwrite=True)
    path = tmp_path / "run.2d"
    path.write_text(rounded(path.read_text()))
    with open_log(path) as log:
        [block] = log.scans(None, ReadReport())
    with open_log(tmp_path / "run.mcap") as log:
        [exact] = log.scans(["/scan"], ReadReport())
    there = np.isfinite(exact.ranges)
    np.testing.assert_allclose(block.ranges[there], exact.ranges[there], atol=1e-3)
    assert (block.ranges[np.isposinf(exact.ranges)] == 0).all()


@pytest.fixture
def rounded() -> Callable[[str], str]:
    """Points of a log in whole millimetres."""

    def rounding(text: str) -> str:
        lines = []
        for line in text.splitlines():
            if line.startswith("scan1: "):
                line = "scan1: " + " ".join(f"{float(number):.0f}" for number in line.split()[1:])
            lines.append(line)
        return "\n".join(lines) + "\n"

    return rounding


def test_a_search_finds_aria_logs(tmp_path: Path) -> None:
    for name in ("a.2d", "b.2D.gz", "c.log"):
        (tmp_path / name).write_text(VERSION_4 + scan())
    assert [found.name for found in find_logs([str(tmp_path)])] == ["a", "b"]


def test_a_laser_whose_tag_is_spelled_in_two_ways_loses_no_line(tmp_path: Path) -> None:
    log = log_of(
        tmp_path,
        "LaserOdometryLog\nsick1conf: 0 90 2\ntime: 1\nsick1: 1000 2000\ntime: 2\nsick: 3000 4000\n"
        "time: 3\nsick1: 5000 6000\n",
    )
    block = only(log)
    assert block.ranges.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert block.stamp_ns.tolist() == [1_000_000_000, 2_000_000_000, 3_000_000_000]
