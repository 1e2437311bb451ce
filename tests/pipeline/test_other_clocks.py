"""Poses and sweeps whose clocks differ: by how much, who refuses them, and what mends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.simulation.writers import ROS1_BYTES, outgoing
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.types import Float64
from tests.pipeline.drawn import (
    SWEEPS,
    checked,
    driven,
    round_about,
    scene_of,
    standing,
    straight,
    sweeps_of,
    told,
    write_messages,
)
from tests.pose.pose_messages import SECOND

pytestmark = pytest.mark.usefixtures("paths_checked_once")

Run = Callable[..., Any]
SECONDS = np.arange(SWEEPS) * 0.1


def apart(
    path: Path, seconds: float, whose: str = "sweeps", *, tf: bool = True, way: Callable[[Float64], Float64] = round_about
) -> Path:
    """A log of which the stamps of sweeps or poses are late, or those of poses with the times of the recording."""
    late_ns = round(seconds * SECOND)
    sweeps = driven() if way is round_about else sweeps_of(scene_of(way))
    poses = told(way(SECONDS), tf=tf)
    if whose == "sweeps":
        messages = list(outgoing([replace(each, stamp_ns=each.stamp_ns + late_ns) for each in sweeps], poses, ROS1_BYTES))
    else:
        late = replace(poses, stamp_ns=poses.stamp_ns + late_ns)
        never = [replace(each, record_ns=each.record_ns + 10**15) for each in sweeps]
        messages = [each for each in outgoing(never, late, ROS1_BYTES) if each.topic != "/scan"]
        back_ns = late_ns if whose == "poses" else 0
        messages = [each._replace(record_ns=each.record_ns - back_ns) for each in messages]
        messages += outgoing(sweeps, None, ROS1_BYTES)
    return write_messages(path, sorted(messages, key=lambda each: each.record_ns))


def of_clocks(log: Path, delay: float | None = None) -> list[Finding]:
    """The findings on poses that are of another time; without the hint on the times of the recording."""
    found = inspect_log(Source(str(log), log.stem), poses_from=PoseOptions(delay=delay)).findings
    return [each for each in found if each.id in ("clock", "delay", "drift") and each.level != "hint"]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.7, -0.9, 1.9, -3.0, 15.0])
@pytest.mark.parametrize("whose", ["sweeps", "recorded so"])
def test_seconds_apart_are_a_delay_and_no_drift(tmp_path: Path, seconds: float, whose: str) -> None:
    """Times of the recording tell it, or the motion in both."""
    log = apart(tmp_path / "run.bag", seconds, whose)
    (path,) = checked(log).values()
    delay = -seconds if whose == "sweeps" else seconds
    assert path.verdict == "corrected"
    assert path.fit is not None
    assert path.fit.delay == pytest.approx(delay, abs=0.011)
    (found,) = of_clocks(log)
    assert (found.id, found.level, found.mend) == ("delay", "warning", "stamps")
    assert found.fix is not None
    assert found.fix.text == f"--pose-delay {path.fit.delay:.2f}"
    assert of_clocks(log, path.fit.delay) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "whose", "tf"),
    [(-40.0, "sweeps", True), (104.0, "sweeps", False), (-40.0, "poses", True), (90.0, "recorded so", False)],
)
def test_clocks_that_do_not_meet_are_a_finding_with_a_fix(tmp_path: Path, seconds: float, whose: str, tf: bool) -> None:
    log = apart(tmp_path / "run.bag", seconds, whose, tf=tf)
    (path,) = checked(log).values()
    delay = -seconds if whose == "sweeps" else seconds
    assert path.apart is not None
    assert path.facts()["pose_delay"] == pytest.approx(delay, abs=0.011)
    (found,) = of_clocks(log)
    assert (found.id, found.level, found.mend) == ("clock", "error", "clock")
    assert found.fix is not None
    assert found.fix.text == f"--pose-delay {delay:.2f}"
    side = "ahead of" if delay > 0 else "behind"
    assert f"the clock of {'/tf' if tf else '/odom'} is {abs(delay):.2f} s {side} that of the sweeps" in found.message
    assert of_clocks(log, delay) == []


@pytest.mark.slow
@pytest.mark.parametrize("word", ["clock", "stamps", "found"])
@pytest.mark.parametrize("seconds", [1.9, -40.0, -1_699_999_000.0])
def test_clean_mends_the_clock(lidarcli: Run, tmp_path: Path, seconds: float, word: str) -> None:
    """Also beyond an hour, for which there is no delay: the sensor counts from when it was switched on."""
    log, copy = apart(tmp_path / "run.bag", seconds), tmp_path / "mended.bag"
    (found,) = of_clocks(log)
    assert (found.fix is None) == (abs(seconds) > 3600.0)
    assert lidarcli("clean", log, "-o", copy, "--remove", "none", "--mend", word).code == 0
    assert of_clocks(copy) == []


@pytest.mark.slow
def test_who_needs_the_poses_refuses_them(lidarcli: Run, tmp_path: Path) -> None:
    log, zone = apart(tmp_path / "run.bag", -40.0), tmp_path / "zone.toml"
    zone.write_text('[[zone]]\nname = "door"\nframe = "world"\ncircle = { x = 9, y = 9, radius = 1 }\n')
    for words in (
        ("map", log, "-o", tmp_path / "map.yaml"),
        ("poses", log, "-o", tmp_path / "run.tum"),
        ("background", "build", log, "-o", tmp_path / "run.background.parquet"),
        ("clean", log, "-o", tmp_path / "clean.bag"),
        ("diff", log, log),
        ("zones", log, "--zones", zone, "--check", "zones.door.events == 0"),
    ):
        ran = lidarcli(*words)
        assert ran.code == 3, words
        assert "40.00 s ahead" in ran.err
        assert "--pose-delay" in ran.err
    assert sorted(each.name for each in tmp_path.iterdir()) == ["run.bag", "zone.toml"]
    ran = lidarcli("track", log, "-o", tmp_path / "tables")
    assert ran.code == 0
    assert "40.00 s ahead of that of the sweeps (--pose-delay 40.00)" in ran.err
    for options in (("--pose-delay", "40"), ("--pose", "match")):
        assert lidarcli("map", log, "-o", tmp_path / "map.yaml", "--overwrite", *options).code == 0


@pytest.mark.slow
def test_a_file_of_another_clock_is_told_by_how_much(lidarcli: Run, tmp_path: Path) -> None:
    log, half = apart(tmp_path / "run.bag", 0.0), 0.5 * round_about(SECONDS)[:, 2]
    rows = zip(SECONDS, round_about(SECONDS), np.sin(half), np.cos(half), strict=True)
    (tmp_path / "run.tum").write_text(
        "".join(f"{1_700_000_300 + t:.1f} {x} {y} 0 0 0 {sin} {cos}\n" for t, (x, y, _), sin, cos in rows)
    )
    ran = lidarcli("track", log, "-o", tmp_path / "tables", "--poses", tmp_path / "run.tum")
    assert ran.code == 3
    assert "(--pose-delay 300.00)" in ran.err


@pytest.mark.slow
def test_a_parked_sensor_needs_no_poses_but_in_their_frame(lidarcli: Run, tmp_path: Path) -> None:
    log = apart(tmp_path / "run.bag", -40.0, way=standing)
    for frame, code in (("sensor", 0), ("world", 3), ("odom", 3)):
        zone = tmp_path / f"{frame}.toml"
        zone.write_text(f'[[zone]]\nname = "door"\nframe = "{frame}"\ncircle = {{ x = 9, y = 9, radius = 1 }}\n')
        assert lidarcli("zones", log, "--zones", zone).code == code, frame


def test_no_delay_is_told_of_an_even_motion(tmp_path: Path) -> None:
    """Each delay fits the sweeps as well as any other one."""
    log = apart(tmp_path / "run.bag", 90.0, "recorded so", way=straight)
    (path,) = checked(log).values()
    assert path.apart is not None
    assert path.facts()["pose_delay"] is None
    (note,) = [each for each in path.notes if isinstance(each, Finding)]
    assert (note.fix, note.mend) == (None, "")
    assert note.message == "no sweep of /scan has a pose: those of /tf are of other times"


@pytest.mark.slow
def test_a_file_of_another_time_is_told_by_how_much(lidarcli: Run, tmp_path: Path) -> None:
    """No mend of the log helps a file."""
    log, zone = apart(tmp_path / "run.bag", 0.0, way=straight), tmp_path / "zone.toml"
    zone.write_text('[[zone]]\nname = "door"\nframe = "world"\ncircle = { x = 9, y = 9, radius = 1 }\n')
    rows = zip(SECONDS, straight(SECONDS), strict=True)
    (tmp_path / "run.tum").write_text("".join(f"{1_700_000_600 + t:.1f} {x} {y} 0 0 0 0 1\n" for t, (x, y, _) in rows))
    for words in (("zones", log, "--zones", zone), ("clean", log, "-o", tmp_path / "clean.bag")):
        ran = lidarcli(*words, "--poses", tmp_path / "run.tum")
        assert ran.code == 3
        assert "they begin 600.00 s after the sweeps; nothing written; --pose-delay may help" in ran.err
