"""Poses some time from the header stamps: `--pose-delay`, and the delay that `info` finds."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from lidarcli.poses.delay import LEAST_SWEEPS, SWEEPS, DelaySample

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.reading import pose_sources
from lidarcli.pipeline.reading.pose_sources import MOST_DELAY, find_poses
from lidarcli.poses import delay as module
from lidarcli.simulate.generate import simulate_blocks, simulate_odometry
from lidarcli.simulate.load import load_scene
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import Float64
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs
from tests.poses.pose_messages import SECOND

COUNT = 150


def written(path: Path, late: float, count: int = COUNT) -> Path:
    """The drive of the samples; its poses have stamps that are `late` [s]."""
    scene = load_scene(SAMPLES / "drive.toml")
    poses = simulate_odometry(scene, count, seed=0)
    assert poses is not None
    shifted = replace(poses, stamp_ns=poses.stamp_ns + round(late * SECOND))
    write_log(path, [block.raw for block in simulate_blocks(scene, count, 0)], poses=shifted)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `right.mcap`, and `late.mcap` whose poses are told 0.2 s too late."""
    folder = tmp_path_factory.mktemp("delay")
    written(folder / "right.mcap", 0.0)
    written(folder / "late.mcap", 0.2)
    return folder


def poses_of(path: Path, pose_delay: float = 0.0) -> Float64:
    """(S, 3) x, y, yaw of every sweep."""
    parts = [batch.poses for batch in lidarcli.read(path, pose_delay=pose_delay)]
    return np.concatenate([np.column_stack([part.x, part.y, part.yaw]) for part in parts if part is not None])


def sample_of(path: Path, size: int = 1024) -> DelaySample:
    """What batches of `size` sweeps of a log leave in the sample."""
    with open_log(str(path)) as log:
        found = find_poses(log)
        assert found is not None
        way = found.sources.way("laser")
        assert way is not None
        sample = DelaySample(way)
        for batch in read_batches(log, ReadOptions(batch_size=size), ReadReport()):
            sample.add(batch)
    return sample


def test_the_pose_is_that_at_the_stamp_and_the_delay(folder: Path) -> None:
    right, late = poses_of(folder / "right.mcap"), poses_of(folder / "late.mcap", 0.2)
    # The last pose of the late ones comes after the end of the log.
    np.testing.assert_allclose(late[:-1], right[:-1], atol=1e-9)
    assert np.isnan(late[-1]).all()
    # The sweeps come 0.2 s apart, and so do the poses: the delay moves them by one sweep.
    np.testing.assert_allclose(poses_of(folder / "right.mcap", -0.2)[1:], right[:-1], atol=1e-9)
    assert np.isnan(poses_of(folder / "right.mcap", -0.2)[0]).all()


def test_the_delay_is_a_parameter_only_where_there_is_one(folder: Path, tmp_path: Path) -> None:
    for options, told in (((), None), (("--pose-delay", "0"), None), (("--pose-delay", "-0.25"), -0.25)):
        command = ["-q", "detect", str(folder / "right.mcap"), "-o", str(tmp_path), "--overwrite", *options]
        assert run(command) == 0
        metadata = pq.read_schema(tmp_path / "right.objects.parquet").metadata
        assert json.loads(metadata[b"lidarcli.parameters"]).get("pose_delay") == told


def test_detect_and_learn_take_the_delay(folder: Path, tmp_path: Path) -> None:
    right = lidarcli.detect(folder / "right.mcap")
    late = lidarcli.detect(folder / "late.mcap", pose_delay=0.2)
    for name in ("world_x", "world_y"):
        kept = right["sweep"].to_numpy() < COUNT - 1
        np.testing.assert_allclose(late[name].to_numpy()[kept], right[name].to_numpy()[kept], atol=1e-9)
    (one,) = lidarcli.learn(folder / "right.mcap")
    (other,) = lidarcli.learn(folder / "late.mcap", pose_delay=0.2)
    same = min(len(other), len(one)) - 1
    np.testing.assert_allclose(other.poses.x[:same], one.poses.x[:same], atol=1e-9)
    file = tmp_path / "route.parquet"
    command = ["-q", "background", "build", str(folder / "late.mcap"), "-o", str(file), "--pose-delay", "0.2"]
    assert run(command) == 0
    assert json.loads(pq.read_schema(file).metadata[b"lidarcli.parameters"])["pose_delay"] == 0.2
    # Who reads and says nothing gets the poses as the log tells them.
    told, as_told = (next(lidarcli.read(folder / "late.mcap", **some)) for some in ({}, {"pose_delay": 0.0}))
    np.testing.assert_array_equal(told.poses.x, as_told.poses.x)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pose-delay", "3601"), "--pose-delay: 3601 s is not within 3,600 s"),
        (("--pose-delay", "-4000"), "--pose-delay: -4000 s is not within 3,600 s"),
        (
            ("--pose-delay", "0.1", "--pose", "none"),
            "--pose-delay is for poses, and --pose none leaves them out",
        ),
    ],
)
@pytest.mark.parametrize("command", [("detect",), ("background", "build")])
def test_a_delay_that_cannot_be_is_refused(
    folder: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    command: tuple[str, ...],
    options: tuple[str, ...],
    message: str,
) -> None:
    output = str(tmp_path / "out.parquet")
    assert run([*command, str(folder / "right.mcap"), "-o", output, *options]) == 2
    assert capfd.readouterr().err == f"lidarcli: {message}\n"
    assert list(tmp_path.iterdir()) == []


def test_a_delay_that_is_no_number_is_refused_in_python(folder: Path) -> None:
    for delay, words in (
        (float("nan"), "nan is not a finite number"),
        (float("inf"), "inf is not a finite number"),
        (MOST_DELAY + 1, "is not within 3,600 s"),
    ):
        with pytest.raises(OptionError, match=words):
            next(iter(lidarcli.read(folder / "right.mcap", pose_delay=delay)))


def test_a_delay_without_poses_is_noted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["detect", str(SAMPLES / "room.mcap"), "-o", str(tmp_path), "--pose-delay", "0.1", "--end", "1"]
    assert run(command) == 0
    assert (
        "  note     no poses in this log: --pose-delay changes nothing" in capfd.readouterr().err.splitlines()
    )


@pytest.mark.parametrize("late", [-0.3, -0.13, 0.05, 0.07, 0.15, 0.18, 0.3])
def test_the_delay_that_makes_the_world_sharpest_is_found(late: float, tmp_path: Path) -> None:
    best = sample_of(written(tmp_path / "run.mcap", late)).best()
    assert best is not None
    delay, saved = best
    # Poses are drawn by a straight line between two that are 0.2 s apart.
    assert delay == pytest.approx(late, abs=0.0101)
    assert 0.1 < saved < 0.7


def test_poses_that_fit_are_left_alone(folder: Path) -> None:
    assert sample_of(folder / "right.mcap").best() is None


@pytest.mark.parametrize("size", [1, 7, 64])
def test_the_batch_size_makes_no_difference(size: int, folder: Path) -> None:
    whole, parts = sample_of(folder / "late.mcap"), sample_of(folder / "late.mcap", size)
    assert parts.best() == whole.best()
    np.testing.assert_array_equal(np.concatenate(parts._stamps), np.concatenate(whole._stamps))


def test_a_sensor_that_stands_tells_nothing(folder: Path, tmp_path: Path) -> None:
    short = sample_of(written(tmp_path / "short.mcap", 0.2, count=LEAST_SWEEPS - 1))
    assert 10 < short._count < LEAST_SWEEPS
    assert short.best() is None
    moving = sample_of(folder / "late.mcap")
    parked = DelaySample(moving.way)
    with open_log(str(folder / "late.mcap")) as log:
        for batch in read_batches(log, ReadOptions(), ReadReport()):
            still = replace(batch, stamp_ns=np.full(len(batch), batch.stamp_ns[5]))
            for _ in range(3):
                parked.add(still)
    assert parked._count == 1
    assert parked.best() is None


def test_the_sample_is_bounded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidarcli.poses.delay.SWEEPS", 30)
    sample = sample_of(folder / "late.mcap", 7)
    assert sample._count == 30 < COUNT < SWEEPS
    points = [len(x) for _, x, _, _ in sample._points]
    assert sum(points) <= 30 * 2 * 120


def test_info_tells_of_the_delay(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(folder / "late.mcap")]) == 0
    (note,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith("  note")]
    best = sample_of(folder / "late.mcap").best()
    assert best is not None
    assert note == (
        f"  note        poses {best[0]:.2f} s after the header stamps of /scan fit better: its points fill {best[1]:.0%} "
        f"fewer cells of the world (--pose-delay {best[0]:.2f})"
    )
    assert inspect_log(Source(str(folder / "right.mcap"), "right")).notes == ()


@pytest.mark.slow
@needs_real_logs
@pytest.mark.parametrize(
    ("log", "delay"),
    [
        ("comprobo24/drive_square", {"/scan": "-0.36"}),
        ("ros_behaviors_fsm/teleop", {"/scan": "-0.35"}),
        ("my_gazebo_tutorials/20_53_49", {}),
        ("datmo/parallel.bag", {}),
    ],
)
def test_delays_of_real_logs(log: str, delay: dict[str, str]) -> None:
    """The driver of the first two stamps a sweep when it has arrived, and corrects that on /stable_scan."""
    notes = inspect_log(Source(str(REAL_LOGS / log), "log")).notes
    told = [note for note in notes if "--pose-delay" in note]
    assert [note.rpartition(" ")[2] for note in told] == [f"{value})" for value in delay.values()]
    assert all(f" of {topic} " in note for topic, note in zip(delay, told, strict=True))


def test_every_constant_is_documented_with_its_value() -> None:
    page = (ROOT / "docs" / "poses.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)\.(\w+)` \| ([\d.]+) \|", page, re.MULTILINE)
    modules = {"pose_sources": pose_sources, "delay": module}
    assert {(room, name) for room, name, _ in rows} >= {
        ("delay", name) for name in vars(module) if name.isupper() and name != "SECOND_NS"
    }
    for room, name, value in rows:
        assert getattr(modules[room], name) == float(value)


def test_ranges_beyond_all_sensors_are_left_out(folder: Path) -> None:
    """A driver may write anything that a float holds."""
    sample = DelaySample(sample_of(folder / "late.mcap").way)
    for batch in lidarcli.read(folder / "late.mcap", pose="none"):
        ranges = batch.ranges.copy()
        ranges[:, ::2] = np.finfo(np.float32).max
        sample.add(replace(batch, ranges=ranges, status=np.zeros_like(batch.status)))
    best = sample.best()
    assert best is not None
    assert best[0] == pytest.approx(0.2, abs=0.0101)
