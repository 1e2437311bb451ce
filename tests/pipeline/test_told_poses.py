"""Told poses of drawn logs that fit the sweeps or contradict them: the verdict, its note, and the tables that follow."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.parameters import TrackParameters
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.simulation.generate import START_NS, relative
from lidarcli.sweeps.findings import Fix
from lidarcli.sweeps.types import Float64
from tests.pipeline.drawn import (
    SWEEPS,
    away,
    checked,
    round_about,
    scene_of,
    stamps,
    standing,
    straight,
    told,
    write,
    write_two_mounts,
)

SECONDS = np.arange(SWEEPS) * 0.1
TRUE = round_about(SECONDS)
QUARTER = 250_000_000


@dataclass(frozen=True)
class Outcome:
    """The tables and notes of a run of `track`."""

    notes: list[str]
    poses: dict[str, Any]
    """What the metadata tell of the sensor frame."""
    path: Float64
    """(S, 3) pose of each sweep."""
    agents: int
    """Objects in set A: nothing moves in the room."""

    def verdict(self) -> tuple[str, float | None, float | None, float | None]:
        """Verdict, share of the steps that fit, delay and drift, as the metadata tell them."""
        keys = ("pose_verdict", "pose_fit", "pose_delay", "pose_drift")
        assert all(set(self.poses[key]) == {"/scan"} for key in keys)
        return tuple(self.poses[key]["/scan"] for key in keys)


def tracked(log: Path, poses: PoseOptions | None = None) -> Outcome:
    """Track the objects of a log; every table tells the same of the poses."""
    folder = log.parent / f"{log.stem}-tables"
    options = DetectOptions(poses=poses or PoseOptions(), tracking=TrackOptions(TrackParameters()))
    summary = detect_to_files(Source(str(log), "run"), folder, options)
    assert summary.exit_code == 0
    assert all("\n" not in note for note in summary.notes)
    tables = {name: pq.read_table(folder / f"run.{name}.parquet") for name in ("objects", "sweeps", "tracks")}
    (described,) = {table.schema.metadata[b"lidarcli.source"] for table in tables.values()}
    columns = [tables["sweeps"][name].to_numpy(zero_copy_only=False) for name in ("pose_x", "pose_y", "pose_yaw")]
    path = np.column_stack([np.array(column, float) for column in columns])
    agents = tables["objects"]["set"].to_pylist().count("A")
    return Outcome(summary.notes, json.loads(described)["poses"]["laser"], path, agents)


def moved(first: int, after: int, way: float) -> Float64:
    """The true poses, of which some are told elsewhere."""
    poses = TRUE.copy()
    poses[first:after, 0] += way
    return poses


def reset() -> Float64:
    """Odometry that begins anew midway."""
    return np.vstack([TRUE[:100], relative(TRUE[100:], TRUE[[100]])])


def drifting() -> Float64:
    """Poses that drift by 3 % of the way and 0.6 degrees a second."""
    number = np.arange(SWEEPS)
    return np.column_stack([1.03 * TRUE[:, 0] + 0.002 * number, 1.03 * TRUE[:, 1], TRUE[:, 2] + 0.001 * number])


@pytest.mark.parametrize("origin", [[0.0, 0.0, 0.0], [500_000.0, 4_000_000.0, 0.0]], ids=["honest", "UTM"])
def test_poses_with_which_the_sweeps_agree_are_taken_as_they_are(tmp_path: Path, origin: list[float]) -> None:
    run = tracked(write(tmp_path / "run.mcap", told(TRUE + origin)))
    verdict, fit, delay, drift = run.verdict()
    assert (verdict, fit, delay) == ("told", 1.0, 0.0)
    assert drift == pytest.approx(0.0, abs=0.01)
    assert (run.poses["topic"], run.poses["world"]) == ("/odom", "odom")
    assert run.poses["pose_agreement"]["/scan"] > 0.95
    assert run.poses["pose_again"]["/scan"] > 0.5
    (note,) = [line for line in run.notes if "agree over the run" in line]
    assert note.startswith("poses from /odom (odom > laser): 97% of the hits agree over the run")
    assert run.agents == 0
    assert away(run.path, round_about).max() < 1e-6


@pytest.mark.parametrize(
    ("poses", "note"),
    [
        pytest.param(drifting(), "poses from /odom drift (67% agree where seen again)", id="drifting 3 %"),
        pytest.param(reset(), "poses from /odom jump by up to 1.5 m", id="reset"),
        pytest.param(moved(100, 115, 3.0), "poses from /odom jump by up to 3.0 m", id="jump for 1.5 s"),
        pytest.param(moved(100, SWEEPS, 1e9), "poses from /odom jump by up to 1,000,000,000.0 m", id="jump of 1e9 m"),
        pytest.param(moved(100, SWEEPS, 0.3), "poses from /odom drift (", id="small step"),
    ],
)
def test_poses_that_drift_or_jump_are_replaced_in_their_world(tmp_path: Path, poses: Float64, note: str) -> None:
    log = write(tmp_path / "run.mcap", told(poses))
    run = tracked(log)
    verdict, fit, delay, _ = run.verdict()
    assert (verdict, delay, run.poses["world"]) == ("matched", 0.0, "odom")
    assert fit is not None
    assert fit > 0.95
    (finding,) = [line for line in run.notes if line.startswith(note)]
    assert ": the path is matched from the sweeps" in finding
    assert run.agents == 0
    assert away(run.path, round_about).max() < 0.02
    (found,) = [each for each in inspect_log(Source(str(log), "run")).findings if each.id == "drift"]
    assert found.message == finding
    assert {"near", "matched", "steps"} <= set(found.evidence)


@pytest.mark.parametrize("late", [0.25, -0.25])
def test_late_and_early_poses_are_taken_at_the_time_that_fits(tmp_path: Path, late: float) -> None:
    poses = told(round_about(np.arange(-5, SWEEPS + 5) * 0.1), stamps(SWEEPS + 10) - 500_000_000)
    log = write(tmp_path / "run.mcap", replace(poses, stamp_ns=poses.stamp_ns + round(late * 1e9)))
    run = tracked(log)
    verdict, fit, delay, _ = run.verdict()
    assert verdict == "corrected"
    assert fit is not None
    assert fit > 0.98
    assert delay == pytest.approx(late, abs=0.011)
    (note,) = [line for line in run.notes if "if corrected" in line]
    assert note == f"poses from /odom fit if corrected: {abs(delay):.2f} s {'late' if late > 0 else 'early'}"
    assert run.agents == 0
    # The last pose of the log holds for 0.1 s, and after that nothing is known.
    assert np.isnan(run.path[:, 0]).sum() <= 2
    assert away(run.path, round_about)[:-3].max() < 0.02
    # The robot drives through the edge of a cylinder.
    near, finding = inspect_log(Source(str(log), "run")).findings
    assert near.id == "too_close"
    assert (finding.id, finding.message, finding.evidence["delay"]) == ("delay", note, delay)
    assert finding.fix == Fix("option", f"--pose-delay {delay:.2f}")


def test_a_second_static_transform_of_another_log_is_corrected(tmp_path: Path) -> None:
    run = tracked(write_two_mounts(tmp_path / "run.bag", told(TRUE, tf=True), (0.0, 0.0, 0.5 * np.pi)))
    verdict, fit, delay, _ = run.verdict()
    assert (verdict, delay) == ("corrected", 0.0)
    assert fit is not None
    assert fit > 0.98
    assert any("fit if corrected: sensor turned by -90 degrees" in line for line in run.notes)
    assert run.agents == 0
    assert np.nanmax(away(run.path, round_about)) < 0.02


def of_another_run() -> Float64:
    """Poses of a robot that drove in a circle."""
    turn = SECONDS / 1.8
    return np.column_stack([np.cos(turn), np.sin(turn), turn + 0.5 * np.pi])


@pytest.mark.parametrize(
    ("poses", "cause"),
    [
        pytest.param(
            lambda: told(TRUE * [1000.0, 1000.0, 1.0]), r"told steps are (99\d|1,?00\d) times those seen", id="mm"
        ),
        pytest.param(lambda: told(TRUE * [1.0, 1.0, -1.0]), "the sensor turns the other way", id="sign of yaw"),
        pytest.param(lambda: told(of_another_run()), "", id="another run"),
        pytest.param(lambda: told(TRUE * [0.5, 0.5, 1.0]), "told steps are 0.5 times those seen", id="half the speed"),
        pytest.param(lambda: told(0.0 * TRUE), "told steps are 0 times those seen", id="frozen"),
    ],
)
def test_poses_that_contradict_the_sweeps_are_replaced(tmp_path: Path, poses: Callable[[], Any], cause: str) -> None:
    run = tracked(write(tmp_path / "run.mcap", poses()))
    verdict, fit, delay, _ = run.verdict()
    assert (verdict, delay, run.poses["topic"]) == ("matched", 0.0, "/scan")
    assert fit is not None
    assert run.poses["world"] == "match"
    (note,) = [line for line in run.notes if ": the path is matched from the sweeps" in line]
    assert run.agents == 0
    assert np.isfinite(run.path).all()
    assert away(run.path, round_about).max() < 0.05
    assert re.search(cause, note)


def test_poses_of_another_run_that_were_named_are_taken_with_a_note(tmp_path: Path) -> None:
    log, path = write(tmp_path / "run.mcap", None), tmp_path / "other.tum"
    half = 0.5 * of_another_run()[:, 2]
    rows = zip(SECONDS, of_another_run(), np.sin(half), np.cos(half), strict=True)
    path.write_text("".join(f"{START_NS / 1e9 + t:.1f} {x} {y} 0 0 0 {sin} {cos}\n" for t, (x, y, _), sin, cos in rows))
    run = tracked(log, PoseOptions(file=str(path)))
    verdict, fit, delay, _ = run.verdict()
    assert (verdict, delay) == ("told", 0.0)
    assert fit is not None
    assert fit < 0.2
    (note,) = [line for line in run.notes if "fit the sweeps" in line]
    assert note.startswith("poses from other.tum do not fit the sweeps (")
    assert note.endswith(": they are taken because they were named")
    np.testing.assert_allclose(run.path[:, :2], of_another_run()[:, :2], atol=1e-6)


def test_a_standing_sensor_that_is_told_to_move_stands(tmp_path: Path) -> None:
    run = tracked(write(tmp_path / "run.mcap", told(straight(SECONDS)), scene_of(standing)))
    assert run.poses["pose_verdict"] == {"/scan": "none"}
    assert any(line.endswith(": no poses: the sensor stands") for line in run.notes)
    assert run.agents == 0
    assert np.isnan(run.path).all()


@pytest.mark.parametrize("shift", [0.5, 4.0])
def test_poses_that_fit_half_of_the_time_do_not_spoil_the_matched_path(tmp_path: Path, shift: float) -> None:
    """The heading is told wrong from the middle on."""
    poses = TRUE.copy()
    poses[100:, 2] += shift
    run = tracked(write(tmp_path / "run.mcap", told(poses)))
    verdict, _, delay, _ = run.verdict()
    assert (verdict, delay) == ("matched", 0.0)
    assert run.agents == 0
    assert np.nanmax(away(run.path, round_about)) < 0.05


@pytest.mark.parametrize("options", [PoseOptions("/odom"), PoseOptions(delay=0.0)])
def test_named_poses_that_are_late_stay_late(tmp_path: Path, options: PoseOptions) -> None:
    late = told(TRUE, stamps() + QUARTER)
    run = tracked(write(tmp_path / "run.mcap", late), options)
    verdict, _, delay, _ = run.verdict()
    assert (verdict, run.poses["world"]) == ("told", "odom")
    assert delay == pytest.approx(0.25, abs=0.011)
    (note,) = [line for line in run.notes if "if corrected" in line]
    assert note.endswith(": taken as they are, because they were named")
    at = late.at(stamps())
    # The poses that come after the last sweep are not in the log.
    known = np.isfinite(run.path[:, 0]) & (np.arange(SWEEPS) < SWEEPS - 1)
    np.testing.assert_allclose(run.path[known, :2], at[known, :2], atol=1e-9)


def test_a_delay_that_was_named_is_judged_and_taken(tmp_path: Path) -> None:
    log = write(tmp_path / "run.mcap", told(TRUE, stamps() + QUARTER))
    run = tracked(log, PoseOptions(delay=0.25))
    assert run.verdict()[0] == "told"
    # The last pose of the log holds for 0.1 s.
    assert np.nanmax(away(run.path, round_about)) < 0.05
    (path,) = checked(log, delay_ns=QUARTER, named="they were named").values()
    assert path.chain is not None
    assert path.chain.correction is not None
    assert path.chain.correction.delay_ns == QUARTER


def test_a_moving_sensor_without_poses_is_matched(tmp_path: Path) -> None:
    log = write(tmp_path / "run.mcap", None)
    run = tracked(log)
    assert run.poses["pose_verdict"] == {"/scan": "matched"}
    assert (run.poses["topic"], run.poses["world"]) == ("/scan", "match")
    assert "pose_fit" not in run.poses
    assert run.agents == 0
    assert np.isfinite(run.path).all()
    assert away(run.path, round_about).max() < 0.05
    (path,) = checked(log).values()
    assert path.still.shape == (SWEEPS,)
    assert not path.still.any()


def test_a_standing_sensor_without_poses_stands(tmp_path: Path) -> None:
    log = write(tmp_path / "run.mcap", None, scene_of(standing))
    run = tracked(log)
    assert run.poses == {"pose_verdict": {"/scan": "none"}}
    assert np.isnan(run.path).all()
    assert run.agents == 0
    (path,) = checked(log).values()
    assert path.still.all()
    assert path.chain is None
