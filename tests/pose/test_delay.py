"""Poses some time from the header stamps: `--pose-delay`, and the delay that is found without it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.reading import path_check, posing
from lidarcli.pipeline.reading.posing import MOST_DELAY
from lidarcli.pose import fit
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import Float64
from tests.places import ROOT, SAMPLES
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
        (("--pose-delay", "3601"), "--pose-delay: 3601 s is not within 3,600 s"),
        (("--pose-delay", "-4000"), "--pose-delay: -4000 s is not within 3,600 s"),
        (("--pose-delay", "0.1", "--pose", "none"), "--pose-delay is for poses, and --pose none leaves them out"),
    ],
)
@pytest.mark.parametrize("command", ["detect", "background build"])
def test_a_delay_that_cannot_be_is_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, options: tuple[str, ...], message: str
) -> None:
    output = str(tmp_path / "out.parquet")
    assert run([*command.split(), str(folder / "right.mcap"), "-o", output, *options]) == 2
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
    assert "  note     no poses in this log: --pose-delay changes nothing" in capfd.readouterr().err.splitlines()


def test_info_tells_of_the_delay(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(folder / "late.mcap")]) == 0
    (note,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith("  warning")]
    (delay,) = re.findall(
        r"  warning  delay      poses from /tf fit the sweeps if corrected \(stamped (0\.\d\d) s later than the sweeps\): ",
        note,
    )
    assert float(delay) == pytest.approx(0.2, abs=0.02)
    (fits,) = inspect_log(Source(str(folder / "right.mcap"), "right")).notes
    assert re.fullmatch(r"poses from /tf fit the sweeps: 100% of 14\d steps", fits)


def test_the_page_tells_the_limits() -> None:
    page = (ROOT / "docs" / "poses.md").read_text(encoding="utf-8")
    assert f"| `posing.MOST_DELAY` | {posing.MOST_DELAY:.0f} | s |" in page
    for words in (
        f"A delay of up to {fit.LONGEST_DELAY:g} s is\n  found to {fit.FINE_STEP:g} s",
        f"at least {fit.ACCEPTED:.0%} of the steps agree".replace("%", " %"),
        f"Two steps agree if they end within {100 * fit.OFF_LENGTH:.0f} cm",
        f"A told step of more than {fit.JUMP_LENGTH:g} m that is faster than {fit.JUMP_SPEED:g} m/s is no motion",
        f"Each step of the path that comes out, {fit.PAIR_LENGTH:g} m or {np.degrees(fit.PAIR_TURN):.0f}° long",
        f"where less than {path_check.WELL_CORRECTED:.0%} of the steps agree".replace("%", " %"),
        f"{path_check.ENOUGH:,} sweeps and {path_check.ENOUGH_WAY:g} m of way",
        f"stays within {100 * fit.STANDING_OFF:.0f} cm and {np.degrees(fit.STANDING_TURN):g}°",
    ):
        assert words in page
