"""An unchanged place in which odometry alone drifts, and what has changed there all the same."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import lidarcli as package
from lidarcli.formalism.matching import differences
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry, super_ellipse
from tests.diff.drawn import write_run
from tests.diff.test_diff import BOXES, SCENE, rows, without

PLACE = (*SCENE, make.wall([[-1.0, -3.0], [-1.0, -1.2]]))
NEW = make.box(-3.2, 0.6, 0.6, 0.5, 0.2)
LAPS = Course(super_ellipse(2.0, 1.2, 2.0), 0.6)


def drive(path: Path, changed: bool, noise: float, yaw_noise: float, seed: int) -> str:
    """Two laps of a room by odometry that drifts; in the changed room a box is gone and another one new."""
    scene = (*without(PLACE, BOXES[3]), NEW) if changed else PLACE
    odometry = Odometry(noise=noise, yaw_noise=math.radians(yaw_noise))
    return write_run(path, scene, LAPS, sweeps=250, seed=seed, odometry=odometry)


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> str:
    return drive(tmp_path_factory.mktemp("runs") / "exact.mcap", False, 0.0, 0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(("yaw_noise", "seed"), [(2.0, 1), (3.0, 4)])
def test_drives_by_odometry_alone(
    yaw_noise: float, seed: int, exact: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing has changed in the room: walls and boxes that are off are drift, by as much as the path is off."""
    other = drive(tmp_path / "other.mcap", False, 0.05, yaw_noise, seed)
    found = package.diff(exact, other, pose="/odom")
    drifts = [row for row in rows(found, "uncertain") if row["why"] == "drift"]
    assert {row["status"] for row in found.changes.to_pylist()} <= {"known", "uncertain"}
    assert {row["kind"] for row in drifts} == {"thing", "structure"}
    assert all(0.05 <= row["moved"] < differences.MAX_DRIFT for row in drifts)
    assert any(
        line.startswith("  structure: uncertain") and "m of drift" not in line and "(drift of 0." in line
        for line in found.lines
    )
    # Without a look around them all of them are told as changes.
    monkeypatch.setattr(differences.Compared, "unless_drift", lambda _, change: change)
    assert [found.figures[status] for status in ("new", "gone", "moved")] == [0.0] * 3
    told = package.diff(exact, other, pose="/odom").figures
    assert sum(told[status] or 0.0 for status in ("new", "gone", "moved")) == len(drifts)


@pytest.mark.slow
def test_what_has_changed_is_told_in_spite_of_drift(exact: str, tmp_path: Path) -> None:
    found = package.diff(exact, drive(tmp_path / "other.mcap", True, 0.05, 2.0, 1), pose="/odom")
    ((gone,), (new,)) = rows(found, "gone"), rows(found, "new")
    assert (gone["x_a"], gone["y_a"], gone["kind"]) == (pytest.approx(0.3, abs=1.5), pytest.approx(1.9, abs=1.5), "thing")
    assert (gone["length"], new["length"]) == (pytest.approx(0.7, abs=0.05), pytest.approx(0.6, abs=0.1))
    assert rows(found, "moved") == []
