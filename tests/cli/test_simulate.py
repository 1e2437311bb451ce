"""`lidarcli simulate`: a log, its truth, and what `detect` makes of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.places import SAMPLES

Run = Callable[..., Any]

ROOM = SAMPLES / "room.toml"


def test_log_and_truth(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.bag"
    ran = lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--compression", "lz4", "--seed", "3")
    assert (ran.code, ran.out) == (0, "")
    names = ["room.bag", "room.truth.parquet", "room.truth-beams.parquet"]
    wrote = f"  wrote    {tmp_path}/room.{{bag,truth.parquet,truth-beams.parquet}}"
    assert ran.err.splitlines() == [f"{ROOM}: 5 sweeps", wrote]
    assert set(pq.read_table(tmp_path / names[1])["sweep"].to_pylist()) == set(range(5))
    info = lidarcli("info", log).out
    assert "  format      ros1 bag, compression lz4\n" in info
    assert "    sweeps    5\n" in info


def test_what_is_refused(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.mcap"
    both = lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--duration", "1")
    assert both.code == 2
    absent = lidarcli("simulate", tmp_path / "absent.toml", "-o", log)
    line = f"lidarcli: {tmp_path / 'absent.toml'}: cannot read the scene: No such file or directory\n"
    assert (absent.code, absent.err) == (3, line)
    log.write_text("mine")
    taken = lidarcli("simulate", ROOM, "-o", log)
    assert (taken.code, taken.err) == (
        5,
        f"lidarcli: {log} exists; use --overwrite to replace it, or -o to write elsewhere\n",
    )
    assert log.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--sweeps", "99999999999999999999"),
            "--sweeps must be at least 0 and at most 10,000,000, not 99999999999999999999",
        ),
        (("--duration", "1e300"), "--duration must be at least 0 and at most 400,000,000 seconds, not 1e+300"),
        (
            ("--duration", "2e6"),
            "--duration 2e+06: 20,000,000 sweeps at 10 per second are more than a log may have (10,000,000)",
        ),
        (("--seed", str(1 << 63)), f"--seed must be at least 0 and at most {(1 << 63) - 1}, not {1 << 63}"),
    ],
)
def test_a_log_has_bounds(tmp_path: Path, lidarcli: Run, options: tuple[str, str], message: str) -> None:
    ran = lidarcli("simulate", ROOM, "-o", tmp_path / "room.mcap", *options)
    assert (ran.code, ran.out, ran.err) == (2, "", f"lidarcli: {message}\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("container", ["mcap", "bag", "csv"])
def test_a_scene_at_its_bounds(tmp_path: Path, lidarcli: Run, container: str) -> None:
    scene = tmp_path / "far.toml"
    scene.write_text(
        "[sensor]\nnoise = 1e6\nrate = 0.001\nrange_max = 1e6\nmixed_pixels = 1\n"
        "[robot]\nspeed = 1e6\nwaypoints = [[-1e6, 1e6], [1e6, -1e6]]\n[robot.odometry]\nnoise = 1e6\nyaw_noise = 1e6\n"
        "[[wall]]\npoints = [[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6]]\nclosed = true\n"
        "[[person]]\nx = 1e6\ny = -1e6\nvelocity = [1e6, 1e6]\nyaw_rate = 1e6\nstride = 1e6\n"
        "[[cylinder]]\nx = 1\ny = 1\nradius = 1e-300\n[[box]]\nx = 0\ny = 0\nlength = 1e-300\nwidth = 1e6\n"
    )
    ran = lidarcli("-q", "simulate", scene, "-o", tmp_path / f"far.{container}", "--sweeps", "5")
    assert (ran.code, ran.err) == (0, "")
    found = lidarcli("-q", "detect", tmp_path / f"far.{container}", "-o", "-")
    assert (found.code, found.err) == (0, "")
    long = lidarcli("simulate", scene, "-o", tmp_path / "long.mcap", "--sweeps", "400001")
    assert (long.code, long.err) == (
        2,
        f"lidarcli: {scene}: 400,001 sweeps at 0.001 per second take longer than a log may (400,000,000 seconds)\n",
    )
