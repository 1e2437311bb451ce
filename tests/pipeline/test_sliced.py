"""Logs of point clouds from end to end: the same objects as from LaserScan, and words for who needs them."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import LASERSCAN, POINTCLOUD2, OpenOptions, ReadReport, Slice, Topic
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.inputs.sources import SlicedLog
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.simulation import simulate
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Status
from tests.fake_log import FakeLog
from tests.logs.cloud_messages import message, pointcloud2
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.pose.pose_messages import tf
from tests.sweeping import raw_sweeps

SICK = REAL_LOGS / "sick" / "rms_1xxx_lms_1xx_movement_off.bag"
PART = Slice(0.3, 1.0, 4)
POINTS = [[2.0, 0.0, 0.0], [1.0, 0.0, -0.4]]


def sliced(log: FakeLog, part: Slice = PART) -> SlicedLog:
    """A log that is read with `--slice`."""
    return SlicedLog(log, OpenOptions(slice=part), part)


def clouds(count: int = 3, topic: str = "/points") -> list[object]:
    return [message(pointcloud2(POINTS, stamp_ns=at), topic=topic) for at in range(1, count + 1)]


def test_clouds_are_level_by_the_transforms_of_the_log() -> None:
    mount = tf(0, "base_link", "lidar", (0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 1.0), "/tf_static")
    topics = [Topic("/points", POINTCLOUD2, "cdr", 3), Topic("/tf_static", "tf2_msgs/msg/TFMessage", "cdr", 1)]
    fake = FakeLog(topics=topics, messages=[*clouds(), mount])
    log = sliced(fake)
    report = ReadReport()
    (block,) = log.scans(None, report)
    # At 0.6 m the points ahead are in the slice; the nearer one, at 0.2 m, is below it.
    assert block.ranges.tolist() == [[np.inf, np.inf, 2.0, np.inf]] * 3
    assert report.notes[0] == "/points: sweeps of the points from 0.3 to 1 m above base_link, level by /tf_static"
    assert [(topic.name, topic.is_scan) for topic in log.topics() or ()] == [("/points", True), ("/tf_static", False)]
    # The transforms are read once, for heights and for poses.
    log.poses()
    assert fake.passes == 2


def test_a_leaning_sensor_is_worth_a_note_only_where_its_sweeps_lean_with_it() -> None:
    leaning = (0.0, 0.0, 0.6, 0.0, float(np.sin(0.2)), 0.0, float(np.cos(0.2)))
    told = [
        tf(0, "odom", "base_link", (0.0, 0.0, 0.0)),
        tf(10, "odom", "base_link", (0.0, 0.0, 0.0)),
        tf(0, "base_link", "lidar", leaning, "/tf_static"),
    ]
    topics = [Topic("/points", POINTCLOUD2, "cdr", 3), Topic("/tf", "tf2_msgs/msg/TFMessage", "cdr", 2)]
    log = sliced(FakeLog(topics=topics, messages=[*clouds(), *told]))
    posing = PoseAttacher.of(log, PoseOptions(), TopicChoice(None, log.topics()), ReadOptions())
    (block,) = log.scans(None, ReadReport())
    posing.attach(normalise(block, np.arange(3), RangeRules()))
    assert posing.notes() == [
        "poses from /tf and /tf_static (odom > base_link > lidar): unchecked: the sensor hardly moves"
    ]


def test_scans_and_clouds_of_one_log() -> None:
    topics = [
        Topic("/scan", LASERSCAN, "cdr", 5),
        Topic("/points", POINTCLOUD2, "cdr", 3),
        Topic("/far", POINTCLOUD2, "cdr", 2),
    ]
    fake = FakeLog([raw_sweeps(np.ones((5, 8)))], topics, [*clouds(), *clouds(2, "/far")], damage="cut")
    log = sliced(fake)
    report = ReadReport()
    assert [(block.topic, len(block)) for block in log.scans(None, report)] == [("/scan", 5), ("/points", 3), ("/far", 2)]
    assert [part.cause for part in report.damage] == ["cut"]
    assert [block.topic for block in log.scans({"/far"}, ReadReport())] == ["/far"]
    assert [block.topic for block in log.scans({"/scan"}, ReadReport())] == ["/scan"]


def test_who_reads_no_further_is_told_what_was_lost_so_far() -> None:
    topics = [Topic("/points", POINTCLOUD2, "cdr", 66), Topic("/far", POINTCLOUD2, "cdr", 1)]
    log = sliced(FakeLog(topics=topics, messages=[message(b"\0\1"), *clouds(64), *clouds(1, "/far")]))
    report = ReadReport()
    blocks = log.scans(None, report)
    assert len(next(blocks)) == 64
    del blocks
    assert report.refused == {("/points", "not plain CDR (unknown encapsulation)"): 1}


def test_a_slice_of_a_log_without_clouds_says_so() -> None:
    log = sliced(FakeLog([raw_sweeps(np.ones((2, 8)))], [Topic("/scan", LASERSCAN, "cdr", 2)]))
    report = ReadReport()
    assert [len(block) for block in log.scans(None, report)] == [2]
    assert report.notes == ["no point cloud in this log: --slice changes nothing"]


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of clouds alone."""
    path = tmp_path_factory.mktemp("clouds") / "people.mcap"
    simulate(SAMPLES / "people.toml", path, sweeps=20, clouds=True)
    return path


def test_a_log_of_clouds_alone_says_what_to_type(people: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["detect", str(people), "-o", str(people.parent / "none")]) == 4
    assert capfd.readouterr().err == (
        f"lidarcli: {people}: no LaserScan topic in this log (its topics: /scan sensor_msgs/msg/PointCloud2); to read the "
        "point clouds of /scan as sweeps, add --slice ZMIN ZMAX (heights in metres)\n"
    )
    assert run(["detect", str(people), "--topic", "scan"]) == 4
    assert "add --slice ZMIN ZMAX" in capfd.readouterr().err
    with pytest.raises(NoScanError, match="add --slice"):
        lidarcli.detect(people)


def test_tables_tell_what_they_were_made_of(people: Path, tmp_path: Path) -> None:
    view = ["--bins", "1081", "--fov", "270", "--degrees"]
    assert run(["detect", str(people), "-o", str(tmp_path), "--slice", "-0.1", "0.1", *view, "-q"]) == 0
    (path,) = tmp_path.glob("*.objects.parquet")
    metadata = {key.decode(): value for key, value in pq.read_schema(path).metadata.items()}
    parameters, source = json.loads(metadata["lidarcli.parameters"]), json.loads(metadata["lidarcli.source"])
    assert (parameters["slice"], parameters["bins"]) == ([-0.1, 0.1], 1081)
    assert source["made_of_clouds"] == {"/scan": POINTCLOUD2}


def test_info_tells_of_clouds(people: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(people), "--slice", "-0.1", "0.1"]) == 0
    out = capfd.readouterr().out
    assert "    made of   point clouds (sensor_msgs/msg/PointCloud2)\n" in out
    assert run(["info", str(people), "--slice", "-0.1", "0.1", "--format", "json"]) == 0
    (told,) = json.loads(capfd.readouterr().out)
    assert [scan["made_of"] for scan in told["scans"]] == [POINTCLOUD2]
    assert run(["info", str(people)]) == 4
    assert "/scan  sensor_msgs/msg/PointCloud2  20" in capfd.readouterr().out


def test_an_overlay_reads_the_log_as_its_tables_were_made(people: Path, tmp_path: Path) -> None:
    told = ["--slice", "-0.1", "0.1", "--bins", "300", "--range", "0.1", "20"]
    assert run(["detect", str(people), "-o", str(tmp_path), "-q", *told]) == 0
    (objects,) = tmp_path.glob("*.objects.parquet")
    overlay = tmp_path / "overlay.mcap"
    assert run(["overlay", str(people), "-q", "--with-log", "--objects", str(objects), "-o", str(overlay)]) == 0
    made = lidarcli.read(people, slice=(-0.1, 0.1), bins=300, range=(0.1, 20.0))
    copied = lidarcli.read(overlay)
    shown, known = (np.concatenate([batch.ranges for batch in batches]) for batches in (copied, made))
    assert shown.shape == (20, 300)
    np.testing.assert_array_equal(shown, known)


def test_a_pipe_of_clouds(
    people: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = lidarcli.detect(people, slice=(-0.1, 0.1))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(people.read_bytes())))
    assert run(["detect", "-", "-o", str(tmp_path), "--slice", "-0.1", "0.1"]) == 0
    assert "a pipe is read only once: of its topics the point clouds alone" in capfd.readouterr().err
    (path,) = tmp_path.glob("*.objects.parquet")
    assert pq.read_table(path).num_rows == whole.num_rows > 20


@pytest.mark.parametrize("command", ["detect", "info"])
def test_a_pipe_without_clouds(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    simulate(SAMPLES / "people.toml", tmp_path / "flat.mcap", sweeps=5)
    data = (tmp_path / "flat.mcap").read_bytes()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    monkeypatch.chdir(tmp_path)
    assert run([command, "-", "--slice", "0", "1"]) == 4
    assert capfd.readouterr().err == (
        "lidarcli: standard input: no point cloud in it, and --slice reads of a pipe nothing else; leave it out for "
        "LaserScan\n"
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"slice": (1.0, 0.5)}, "--slice: 1 to 0.5 m are no heights"),
        ({"slice": (float("nan"), 0.5)}, "--slice: nan is not a finite number"),
        ({"bins": 5}, "--bins is for point clouds"),
        ({"slice": (0, 1), "fov": 6.3}, "--fov: with --slice the view is more than nothing, and one turn at most"),
        ({"slice": (0, 1), "angle_increment": 0.01}, "--angle-increment: with --slice give --angle-min, too"),
        (
            {"slice": (0, 1), "bins": 7, "angle_min": 0.0, "angle_increment": -1.0},
            "--angle-increment: 7 beams \\(--bins\\) so far apart are more than one turn",
        ),
        ({"slice": (0, 1), "bins": 1}, "--bins: 1 is not from 2 to 100,000"),
        ({"slice": (0.3, 1.0), "range_unit": "mm"}, "--range-unit is for LaserScan"),
    ],
)
def test_what_has_no_meaning_is_refused(people: Path, options: dict[str, object], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        list(lidarcli.read(people, **options))  # type: ignore[arg-type]


@needs_real_logs
def test_the_clouds_of_a_real_sensor_are_its_sweeps() -> None:
    """A SICK LMS1xx wrote each sweep as LaserScan and as PointCloud2."""
    view = {"bins": 541, "fov": 270.0, "degrees": True}
    made = list(lidarcli.read(SICK, topic="/cloud", slice=(-0.1, 0.1), **view))  # type: ignore[arg-type]
    told = list(lidarcli.read(SICK, topic="/sick_lms_1xx/scan", range=(0, 1e6)))
    assert sum(map(len, made)) == sum(map(len, told)) == 89
    for one, other in zip(made, told, strict=True):
        assert one.stamp_ns.tolist() == other.stamp_ns.tolist()
        np.testing.assert_array_equal(one.status, other.status)
        valid = one.status == Status.VALID
        np.testing.assert_allclose(one.ranges[valid], other.ranges[valid], atol=1e-6)
        np.testing.assert_allclose(one.bearings, other.bearings, atol=1e-7)
        assert valid.mean() > 0.9
