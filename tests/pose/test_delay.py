"""Poses some time from the header stamps: `--pose-delay`, and the delay that is found without it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import Float64
from tests.places import SAMPLES
from tests.pose.pose_messages import SECOND

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


def test_the_pose_is_that_at_the_stamp_and_the_delay(folder: Path) -> None:
    right, late = poses_of(folder / "right.mcap"), poses_of(folder / "late.mcap", 0.2)
    # The last pose of the late ones comes after the end of the log.
    np.testing.assert_allclose(late[:-1], right[:-1], atol=1e-9)
    assert np.isnan(late[-1]).all()
    # The sweeps come 0.2 s apart, and so do the poses: the delay moves them by one sweep.
    np.testing.assert_allclose(poses_of(folder / "right.mcap", -0.2)[1:], right[:-1], atol=1e-9)
    assert np.isnan(poses_of(folder / "right.mcap", -0.2)[0]).all()


def test_detect_and_learn_take_the_delay(folder: Path, tmp_path: Path) -> None:
    right = lidarcli.detect(folder / "right.mcap")
    late = lidarcli.detect(folder / "late.mcap", pose_delay=0.2)
    for name in ("world_x", "world_y"):
        kept = right["sweep"].to_numpy() < COUNT - 1
        np.testing.assert_allclose(late[name].to_numpy()[kept], right[name].to_numpy()[kept], atol=1e-9)
    (one,) = lidarcli.background(folder / "right.mcap")
    (other,) = lidarcli.background(folder / "late.mcap", pose_delay=0.2)
    same = min(len(other), len(one)) - 1
    np.testing.assert_allclose(other.poses.x[:same], one.poses.x[:same], atol=1e-9)
    file = tmp_path / "route.parquet"
    command = ["-q", "background", "build", str(folder / "late.mcap"), "-o", str(file), "--pose-delay", "0.2"]
    assert run(command) == 0
    assert json.loads(pq.read_schema(file).metadata[b"lidarcli.parameters"])["pose_delay"] == 0.2
    # Who says nothing gets the poses by the delay that fits, and who says 0 gets them as the log tells them.
    found, by_delay = (
        np.concatenate([batch.poses.x for batch in lidarcli.read(folder / "late.mcap", **some)])
        for some in ({}, {"pose_delay": 0.2})
    )
    np.testing.assert_allclose(found[:-1], by_delay[:-1], atol=0.01)
    as_told = next(lidarcli.read(folder / "late.mcap", pose_delay=0.0))
    np.testing.assert_allclose(as_told.poses.x[1:], by_delay[:-1], atol=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pose-delay", "3601"), "3601 s is not within 3,600 s"),
        (("--pose-delay", "-4000"), "-4000 s is not within 3,600 s"),
        (("--pose-delay", "0.1", "--pose", "none"), "--pose none leaves them out"),
    ],
)
@pytest.mark.parametrize("command", ["detect", "background build"])
def test_a_delay_that_cannot_be_is_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, options: tuple[str, ...], message: str
) -> None:
    output = str(tmp_path / "out.parquet")
    assert run([*command.split(), str(folder / "right.mcap"), "-o", output, *options]) == 2
    assert message in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_delay_without_poses_is_noted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["detect", str(SAMPLES / "room.mcap"), "-o", str(tmp_path), "--pose-delay", "0.1", "--end", "1"]
    assert run(command) == 0
    assert "  note     no poses in this log: --pose-delay changes nothing" in capfd.readouterr().err.splitlines()
