"""Player logs as the writelog driver writes them, in its file versions 0.3 and 0.1."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import MAX_BEAMS, POSE_TYPES, OpenOptions, ReadReport
from lidarcli.pipeline.reading.posing import PoseOptions, find_poses
from lidarcli.simulation import simulate
from lidarcli.sweeps import Status
from tests.logs.robots import Opener, only, pose_of
from tests.logs.watched import PlayerLog
from tests.places import SAMPLES

HEADER = "## Player version 3.0.2 \n## File version 0.3.0 \n## Format: \n## - Messages are newline-separated\n"
ROBOT = "16777343 6665"
CONFIG = "-1.570796 1.570796 0.785398 0.100000 8.000000 0.000000 10.000000"


def laser(stamp: str = "1000000012.500", ranges: Sequence[float] = (1.0, 2.0, 3.0), robot: str = ROBOT) -> str:
    numbers = "".join(f"{value:.3f} {at:2d} " for at, value in enumerate(ranges))
    view = f"-1.5708 +1.5708 +{np.pi / max(len(ranges) - 1, 1):.8f} +08.0000"
    return f"{stamp} {robot} laser 00 001 001 0007 {view} {len(ranges):04d} {numbers}\n"


def odometry(stamp: str, x: float, y: float, yaw: float, robot: str = ROBOT, index: str = "00") -> str:
    pose = f"{x:+07.3f} {y:+07.3f} {yaw:+.6f}"
    return f"{stamp} {robot} position2d {index} 001 001 {pose} +00.100 +00.000 +00.000 0\n"


log_of = Opener(PlayerLog)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    """Every log is closed in the end."""
    yield
    log_of.close()


HEAD = f"1000000012.500 {ROBOT}"
RANGES = "1.000 2.000 8.000 4.000 5.000"
PAIRS = "1.000 10 2.000 20 8.000  0 4.000  7 5.000  9"
TRIPLES = "1.000 -1.571 10 2.000 -0.785 20 8.000 0.000  0 4.000 0.785  7 5.000 1.571  9"
PLACE = "+00.100 +00.200 +00.300 +00.000 +00.000 +00.500 +00.150 +00.150 +00.150"
PART = PLACE[:47]
LINES = {
    "laser 1:1": f"{HEAD} laser 00 001 001 0001 -1.5708 +1.5708 +0.78539816 +08.0000 0005 {PAIRS} ",
    "laser 1:2": f"{HEAD} laser 01 001 002 0001 +01.000 +02.000 +00.500 -1.5708 +1.5708 +0.78539816 +08.0000 0005 {PAIRS} ",
    "laser 1:3": f"{HEAD} laser 00 001 003 0001 +08.0000 0005 {TRIPLES} ",
    "laser of version 0.1": f"1000000012.500 fly 6665 laser 00 0999999999.123 -1.5708 +1.5708 +0.78539816 0005 {PAIRS} ",
    "ranger 1:1": f"{HEAD} ranger 00 004 005 {CONFIG} \n{HEAD} ranger 00 001 001 0005 {RANGES} ",
    "ranger 1:2 bare": f"{HEAD} ranger 00 004 005 {CONFIG} \n{HEAD} ranger 00 001 002 0005 {RANGES} 0 ",
    "ranger 1:2 configured": f"{HEAD} ranger 00 001 002 0005 {RANGES} 0 {CONFIG} ",
    "ranger 1:2 marked": f"{HEAD} ranger 00 001 002 0005 {RANGES} 0 1 {CONFIG} ",
    "ranger 1:2 whole": f"{HEAD} ranger 00 001 002 0005 {RANGES} 1 {PLACE} 0001 {PART} 0002 .1 .1 .1 .1 .1 .1 {CONFIG} ",
}
"""Each kind of sweep, and what it needs."""
TOPICS = {"laser 1:2": "/laser1"}


@pytest.mark.parametrize("kind", LINES)
def test_every_kind_of_sweep_is_read(kind: str, tmp_path: Path) -> None:
    log = log_of(tmp_path, f"{HEADER}{LINES[kind]}\n")
    block = only(log)
    assert block.topic == TOPICS.get(kind, f"/{kind.split()[0]}0")
    assert block.frame_ids == (block.topic[1:],)
    assert block.ranges.tolist() == [[1.0, 2.0, 8.0, 4.0, 5.0]]
    assert (block.stamp_ns.tolist(), block.beams.tolist()) == ([1_000_000_012_500_000_000], [5])
    assert block.angle_min[0] == pytest.approx(-np.pi / 2, abs=1e-3 if "1:3" in kind else 1e-5)
    assert block.angle_increment[0] == pytest.approx(np.pi / 4, abs=1e-3 if "1:3" in kind else 1e-6)
    assert block.range_max[0] == (np.inf if "0.1" in kind else 8.0)
    assert block.range_min[0] == np.float32(0.1 if "ranger" in kind else 0.0)
    [topic] = [topic for topic in log.topics() or [] if topic.name == block.topic]
    assert (topic.messages, topic.encoding, log.format) == (1, "player", "player")


@pytest.mark.parametrize(
    ("line", "intensities"),
    [
        ("laser 00 001 001 0001 -1.0 1.0 1.0 8.0 0003 1.0 7 2.0 0 3.0 255", [7.0, 0.0, 255.0]),
        ("laser 00 001 003 0001 +08.0000 0003 1.0 0.0 4 2.0 0.5 5 3.0 1.0 6", [4.0, 5.0, 6.0]),
    ],
)
def test_a_laser_tells_how_strong_returns_were(line: str, intensities: list[float], tmp_path: Path) -> None:
    block = only(log_of(tmp_path, f"{HEAD} {line}\n"))
    assert block.ranges.tolist() == [[1.0, 2.0, 3.0]]
    assert block.intensities is not None
    assert block.intensities.tolist() == [intensities]


def test_numbers_beyond_all_others_are_infinite_or_refused(tmp_path: Path) -> None:
    """Intensities and ranges beyond float32 are infinite; a bearing beyond float64 belongs to no even sweep."""
    line = f"{HEAD} laser 00 001 003 0001 +08.0000 0003 1e60 0.0 1e50 2.0 0.5 5 3.0 {{}} 6\n"
    log = log_of(tmp_path, line.format("1.0") + line.format("-1e400") + line.format("1e308"))
    [block] = log.scans()
    assert block.ranges.tolist() == [[np.inf, 2.0, 3.0]]
    assert block.intensities is not None
    assert block.intensities.tolist() == [[np.inf, 5.0, 6.0]]
    assert log.report.refused == {("/laser0", "beams that are not evenly spread"): 2}


def test_beams_that_are_not_evenly_spread_are_refused(tmp_path: Path) -> None:
    even = f"{HEAD} laser 00 001 003 0001 +08.0000 0003 1.0 0.0 0 2.0 0.5 0 3.0 {{}} 0\n"
    log = log_of(tmp_path, even.format("1.0") + even.format("2.0"))
    assert sum(map(len, log.scans())) == 1
    assert (log.report.damage, log.report.refused) == ([], {("/laser0", "beams that are not evenly spread"): 1})


def test_steps_of_a_configuration_have_more_digits_than_are_written(tmp_path: Path) -> None:
    """Four decimals of a step are not enough for 1081 beams: the view says more."""
    head = f"{HEAD} ranger 00 001 002 1081 {'1.0 ' * 1081}0 -2.3562 2.3562 0.0044 0.1 30.0 0.0 40.0 \n"
    assert only(log_of(tmp_path, head)).angle_increment[0] == pytest.approx(2 * 2.3562 / 1080, abs=1e-12)


def test_a_configuration_counts_for_what_comes_after_it(tmp_path: Path) -> None:
    def told(most: float) -> str:
        return f"{HEAD} ranger 00 004 004 -1.0 1.0 1.0 0.0 {most} 0.0 10.0\n"

    sweep = f"{HEAD} ranger 00 001 001 0003 1.0 1.0 1.0 \n"
    log = log_of(tmp_path, sweep + told(5) + sweep + told(6) + sweep)
    assert [most for block in log.scans() for most in block.range_max] == [5.0, 6.0]
    cause = "no geometry in the log (tell --angle-min and --angle-increment, or --fov)"
    assert (log.report.damage, log.report.refused) == ([], {("/ranger0", cause): 1})
    log = log_of(tmp_path, f"{HEAD} ranger 00 004 005 0.0 0.0 0.0 0.0 0.0 0.0 0.0 \n{sweep}")
    assert (list(log.scans()), log.report.refused) == ([], {("/ranger0", cause): 1})
    block = only(log_of(tmp_path, sweep, options=OpenOptions(fov=2.0, range_max=4.0)))
    assert (block.angle_min[0], block.angle_increment[0], block.range_max[0]) == (-1.0, 1.0, 4.0)


def test_what_is_beyond_the_greatest_range_is_no_return(tmp_path: Path) -> None:
    log_of(tmp_path, laser(ranges=[7.9, 8.0, 8.1, 0.0])).close()
    [batch] = lidarcli.read(tmp_path / "run.log")
    assert batch.status.tolist() == [[Status.VALID, *[Status.NO_RETURN] * 3]]


def test_other_robots_have_names_of_their_own(tmp_path: Path) -> None:
    text = HEADER + laser() + laser(robot="16777343 6666") + laser(robot="33554559 6666")
    text += odometry("1000000012.5", 1, 2, 0, "16777343 6666") + laser("1000000013.5")
    log = log_of(tmp_path, text)
    counts = {block.topic: len(block) for block in log.scans()}
    assert counts == {"/laser0": 2, "/6666/laser0": 1, "/33554559_6666/laser0": 1}
    assert {topic.name: topic.messages for topic in log.topics() or []} == {**counts, "/6666/position2d0": 1}
    assert [block.frame_ids for block in log.scans(["/6666/laser0"])] == [("6666/laser0",)]


def test_wrapping_and_blanks_change_nothing(tmp_path: Path) -> None:
    text = HEADER + laser() + odometry("1000000012.5", 1, 2, 0) + laser("1000000013.5")
    block = only(log_of(tmp_path, text))
    variants = [
        text.replace("\n", "\r\n").encode(),
        text.replace(" ", "\t").encode(),
        text.replace("\n", "  \n\n").replace(" laser", "   laser").encode(),
        b"\xef\xbb\xbf" + text.encode(),
        gzip.compress(text.encode(), mtime=0),
        text.removeprefix(HEADER).encode(),
        text.replace(" \n", "\n").encode(),
        text.rstrip().encode(),
    ]
    for variant in variants:
        log = log_of(tmp_path, variant, "any.txt")
        with open_log(tmp_path / "any.txt") as opened:
            assert opened.format == "player"
        found = only(log)
        assert np.array_equal(found.ranges, block.ranges)
        assert found.stamp_ns.tolist() == block.stamp_ns.tolist() == [1_000_000_012_500_000_000, 1_000_000_013_500_000_000]
        with open_log(io.BytesIO(variant)) as opened:
            assert sum(map(len, opened.scans(None, ReadReport()))) == 2
            assert opened.topics() is None


def test_bad_lines_are_left_out_and_counted(tmp_path: Path) -> None:
    """Each by its number and its cause; what other devices log is passed over."""
    geometry = "-1.5708 +1.5708 +0.78539816 +08.0000"
    bad = {
        f"{HEAD} laser 00 001 001 0001 {geometry} 0002 1.0 0 x 0": "'x' is not a number",
        f"{HEAD} laser 00 001 001 0001 {geometry} 0005 1.0 0 2.0 0": "it declares 5 ranges and has fewer",
        f"{HEAD} laser 00 001 001 0001 {geometry} 0001 1.0 0 2.0 0": "2 fields left over behind the 1 ranges it declares",
        f"{HEAD} ranger 00 001 001 0002 1.0 2.0 3.0": "1 field left over behind the 2 ranges it declares",
        f"{HEAD} laser 00 001 001 0001 {geometry} many 1.0 0": "'many' is no number of ranges",
        f"{HEAD} laser 00 001 001 0001": "cut off",
        f"{HEAD} laser 00 001 001 0001 one +1.5708 +0.7 +08.0 0001 1.0 0": "'one' is not a number",
        f"{HEAD} ranger 00 001 002 0001 1.0 1 2 3": "what stands behind its ranges is no geometry",
        "late 16777343 6665 laser 00 001 001 0001": "'late' begins no message",
        "1000000012.5 LASER": "'1000000012.5' begins no message",
    }
    others = f"# remark\n\n{HEAD} sonar 00 001 001 2 1.0 1.0\n{HEAD} laser 00 001 009 1\n{HEAD} power 00 001 001\n"
    others += "1053653857.290 fly 6665 sync 00 1053653857.290 \n"
    text = others + laser() + "".join(f"{line}\n" for line in bad) + laser("1000000013.5")
    log = log_of(tmp_path, text)
    assert sum(map(len, log.scans())) == 2
    assert {part.place: part.cause for part in log.report.damage} == {
        f"line {8 + at}": cause for at, cause in enumerate(bad.values())
    }
    assert run(["info", str(tmp_path / "run.log")]) == 3


def test_more_ranges_than_any_sensor_has_are_refused(tmp_path: Path) -> None:
    many = f"{HEAD} laser 00 001 001 0001 -1.5 +1.5 +0.7 +08.0 {{}} 1.0 0\n"
    log = log_of(tmp_path, laser() + many.format(MAX_BEAMS + 1) + many.format(10**30))
    assert sum(map(len, log.scans())) == 1
    assert log.report.refused == {("/laser0", "more than 400000 beams declared"): 1}
    assert len(log.report.damage) == 1


def test_a_last_line_that_is_cut_is_no_sweep(tmp_path: Path) -> None:
    """Unless all of its ranges are there: the intensity behind the last one may be cut."""
    whole = laser() + laser("1000000013.5")
    for cut in range(len(laser()) + 1, len(whole)):
        log = log_of(tmp_path, whole[:cut])
        found = sum(map(len, log.scans()))
        assert (found, len(log.report.damage)) == ((2, 0) if whole[:cut].rstrip().endswith("3.000  2") else (1, 1))
    ranger = f"{HEAD} ranger 00 004 005 {CONFIG}\n{HEAD} ranger 00 001 001 0002 1.0 2.0"
    log = log_of(tmp_path, ranger)
    assert (sum(map(len, log.scans())), [part.cause for part in log.report.damage]) == (0, ["cut off"])


def test_equal_times_stay_apart(tmp_path: Path) -> None:
    """Devices of another kind between them make no difference."""
    text = (laser("7.000") + odometry("7.000", 0, 0, 0)) * 3 + laser("6.000")
    log = log_of(tmp_path, text)
    assert only(log).stamp_ns.tolist() == [7_000_000_000, 7_000_000_001, 7_000_000_002, 6_000_000_000]
    assert [message.record_ns for message in log.messages(POSE_TYPES)] == [7_000_000_000 + at for at in range(3)]


@pytest.mark.parametrize(
    "text",
    [
        "2026-11-22 10:00:00 INFO started\n",
        "12.5 1.0 2.0 3.0 4.0 5.0 6.0\n",
        "1000000012.500 16777343 6665 laser\n",
        "time,r0,r1,r2\n",
    ],
)
def test_other_texts_are_no_player_logs(text: str, tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.write_text(text)
    try:
        with open_log(path) as log:
            assert log.format != "player"
    except UnreadableError:
        pass


# Poses.


NORTH = odometry("0000000010.000", 1, 2, np.pi / 2) + odometry("0000000012.000", 1, 4, np.pi / 2)


def test_odometry_is_taken_unasked_with_the_mount_of_the_laser(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    mount = f"0000000000.000 {ROBOT} laser 00 004 001  +0.250  +0.500   0.100   0.150   0.150\n"
    path.write_text(HEADER + mount + NORTH + laser("0000000011.000"))
    assert pose_of(path, "laser0", 11) == pytest.approx([0.5, 3.25, np.pi / 2 + 0.1], abs=1e-5)
    path.write_text(HEADER + NORTH + laser("0000000011.000"))
    assert pose_of(path, "laser0", 11) == pytest.approx([1.0, 3.0, np.pi / 2], abs=1e-5)


def test_a_ranger_is_mounted_by_six_numbers(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    sweep = f"0000000011.000 {ROBOT} ranger 00 001 002 0002 1.0 1.0 0 -1.0 1.0 2.0 0.0 8.0 0.0 10.0\n"
    mount = f"0000000000.000 {ROBOT} ranger 00 004 001 +00.250 +00.000 +00.300 {{}} +00.100 .1 .1 .1 0000 0000\n"
    path.write_text(NORTH + mount.format("+00.000 +00.000") + sweep)
    assert pose_of(path, "ranger0", 11) == pytest.approx([1.0, 3.25, np.pi / 2 + 0.1], abs=1e-5)
    path.write_text(NORTH + mount.format("+03.142 +00.000") + sweep)
    assert pose_of(path, "ranger0", 11) == pytest.approx([1.0, 3.0, np.pi / 2], abs=1e-5)
    log = log_of(tmp_path, path.read_bytes())
    assert sum(message.topic == "/tf_static" for message in log.messages(POSE_TYPES)) == 0
    assert log.report.notes == ["ranger0: mounted with a tilt, which is not read: its place is left out"]


def test_a_pose_beside_a_sweep_is_that_of_the_laser(tmp_path: Path) -> None:
    """Taken where nothing else tells, or on request; that of a ranger may be its mount and must be asked for."""
    sweeps = "".join(
        f"{10 + x} {ROBOT} laser 00 001 002 0001 {x} 5.0 0.0 -1.0 +1.0 +2.0 +08.0 0002 1.0 0 1.0 0\n" for x in (0, 2)
    )
    path = tmp_path / "run.log"
    path.write_text(HEADER + sweeps.replace("10 16", "10.0 16").replace("12 16", "12.0 16"))
    assert pose_of(path, "laser0", 11) == pytest.approx([1.0, 5.0, 0.0])
    path.write_text(HEADER + NORTH + sweeps)
    assert pose_of(path, "laser0", 11)[0:2] == pytest.approx([1.0, 3.0])
    assert pose_of(path, "laser0", 11, "laser0/pose") == pytest.approx([1.0, 5.0, 0.0])
    whole = LINES["ranger 1:2 whole"]
    path.write_text(HEADER + f"{whole}\n{whole.replace('12.500', '13.500')}\n")
    with open_log(path) as log:
        found = find_poses(log, PoseOptions(source=None))
        assert found is None or found.sources.chain("ranger0") is None
    assert pose_of(path, "ranger0", 1_000_000_013, "ranger0/geometry") == pytest.approx([0.1, 0.2, 0.5])


def test_odometry_of_version_0_1(tmp_path: Path) -> None:
    old = "10.000 fly 6665 position 00 0999999998.000 {} -00.910 -1.501 -0.005 +0.000 +0.000\n"
    sweep = LINES["laser of version 0.1"].replace("1000000012.500", "11.000")
    path = tmp_path / "run.log"
    path.write_text(old.format("+01.200") + f"{sweep}\n" + old.format("+01.400").replace("10.000", "12.000"))
    assert pose_of(path, "laser0", 11) == pytest.approx([1.3, -0.91, -1.501])


def test_a_pose_that_is_none_is_left_out(tmp_path: Path) -> None:
    text = odometry("10.0", 0, 0, 0) + f"11.0 {ROBOT} position2d 00 001 001 1.0 a 0.0\n"
    text += f"12.0 {ROBOT} position2d 00 001 001 1.0\n"
    log = log_of(tmp_path, text)
    assert len(list(log.messages(POSE_TYPES))) == 1
    assert [(part.place, part.cause) for part in log.report.damage] == [
        ("line 2", "its pose: 'a' is not a number"),
        ("line 3", "it has less numbers than a pose"),
    ]


@pytest.mark.parametrize("scene", ["drive", "room"])
def test_a_simulated_scene_is_that_of_an_mcap(scene: str, tmp_path: Path) -> None:
    """Objects, and where they are in the world."""
    tables = []
    for name, container in (("run.mcap", None), ("run.log", "player")):
        simulate(SAMPLES / f"{scene}.toml", tmp_path / name, sweeps=20, overwrite=True, container=container)
        tables.append(lidarcli.detect(tmp_path / name).to_pandas())
    mcap, player = tables
    assert len(mcap) == len(player) > 20
    assert mcap["stamp"].tolist() == player["stamp"].tolist()
    assert mcap["world_x"].notna().any() == (scene == "drive")
    numbers = [name for name in mcap.select_dtypes("number").columns if name != "sweep"]
    np.testing.assert_allclose(mcap[numbers], player[numbers], atol=1e-6)
