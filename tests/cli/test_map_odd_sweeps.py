"""`lidarcli map`: damaged logs, logs without poses, and odd sweeps and poses."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.maps import read_map
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import RawSweeps
from tests.cli.maps import COUNTED, DRIVE, Run, fields, names, occupied, ply, still
from tests.places import ROOT
from tests.sweeping import raw_sweeps


def test_logs_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    blind = tmp_path / "blind.mcap"
    write_log(blind, [raw_sweeps(np.full((20, 360), np.inf))])
    ran = lidarcli("map", blind, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {blind}: no poses: ")
    assert "no path of frame laser: the sweeps of /scan cannot be matched" in ran.err
    assert names(tmp_path) == ["blind.mcap"]
    blind.unlink()
    ran = lidarcli("map", DRIVE, "--pose", "none", "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.parquet")
    assert (ran.code, ran.err) == (
        3,
        f"lidarcli: {DRIVE}: no poses: --pose none leaves them out; find its path with --pose match, or give "
        "--poses FILE.tum\n",
    )
    assert names(tmp_path) == []
    ran = lidarcli("map", DRIVE, "--pose", "/nowhere", "-o", tmp_path / "m.yaml")
    assert (ran.code, ran.err) == (
        4,
        f"lidarcli: {DRIVE}: no topic /nowhere with poses in this log (it has /odom, /tf, /tf_static)\n",
    )
    assert names(tmp_path) == []


def test_a_log_without_poses_beside_a_good_one(lidarcli: Run, tmp_path: Path) -> None:
    blind = tmp_path / "blind.mcap"
    write_log(blind, [raw_sweeps(np.full((20, 360), np.inf))])
    ran = lidarcli("map", blind, DRIVE, "-o", tmp_path / "m.yaml")
    assert ran.code == 3
    assert any(line.startswith(f"lidarcli: {blind}: no poses: ") for line in ran.err.splitlines())
    assert COUNTED[1] in ran.err.splitlines()
    assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / "alone.yaml").code == 0
    assert (tmp_path / "m.pgm").read_bytes() == (tmp_path / "alone.pgm").read_bytes()
    ran = lidarcli("-q", "map", DRIVE, tmp_path / "missing.mcap", "-o", tmp_path / "n.yaml")
    assert (ran.code, ran.err) == (3, f"lidarcli: {tmp_path / 'missing.mcap'}: no such file or folder\n")
    assert (tmp_path / "n.pgm").read_bytes() == (tmp_path / "alone.pgm").read_bytes()


def test_a_damaged_log_is_mapped_as_far_as_it_can_be_read(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    log = tmp_path / "cut.mcap"
    data = (walk / "walk.mcap").read_bytes()
    log.write_bytes(data[: len(data) * 9 // 10])
    ran = lidarcli("map", log, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.parquet")
    assert ran.code == 3
    assert ran.err.startswith(f"lidarcli: {log}: ")
    assert ran.err.splitlines()[-1] == f"  wrote    {tmp_path / 'm.parquet'}"
    assert len(occupied(tmp_path / "m.yaml")) > 100
    metadata = pq.read_schema(tmp_path / "m.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"])[0].startswith("cut.mcap: ")


@pytest.mark.parametrize("kind", ["nothing", "zero"])
@pytest.mark.parametrize("suffix", ["mcap", "yaml", "png", "ply"])
def test_sweeps_that_see_nothing(lidarcli: Run, tmp_path: Path, kind: str, suffix: str) -> None:
    """A map without a cell is a map that is there."""
    ranges = np.full((5, 90 if kind == "nothing" else 0), np.nan, np.float32)
    log, path = still(tmp_path, ranges)
    out = tmp_path / f"m.{suffix}"
    ran = lidarcli("map", log, "--poses", path, "-o", out)
    counted = "map of 2 sweeps in world: 0.1 x 0.1 m, 0 cells of 0.05 m occupied, 0 free"
    assert (ran.code, counted in ran.err.splitlines(), out.exists()) == (0, True, True)
    if suffix == "yaml":
        assert read_map(out).occupied == 0


@pytest.mark.parametrize("beams", [1, 2])
def test_sweeps_of_few_beams(lidarcli: Run, tmp_path: Path, beams: int) -> None:
    log, path = still(tmp_path, np.full((5, beams), 2.02, np.float32), angle_min=0.0)
    thresholds = ("--min-move", 0, "--min-hits", 1, "--occupied-ratio", 0)
    ran = lidarcli("map", log, "--poses", path, "-o", tmp_path / "m.yaml", *thresholds)
    assert ran.code == 0
    ahead, behind = {*range(40, 45)}, {*range(-41, -36)}
    assert {i for i, _ in occupied(tmp_path / "m.yaml")} == ahead | (behind if beams == 2 else set())


@pytest.mark.parametrize("step", [np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-45])
def test_odd_times_of_beams_change_nothing(lidarcli: Run, tmp_path: Path, step: float) -> None:
    blocks = raw_sweeps(np.full((9, 90), 3.0, np.float32))
    for name, time in (("odd", step), ("none", 0.0)):
        told = {"time_increment": np.full(9, time, np.float32), "scan_time": np.full(9, time, np.float32)}
        values = {each: getattr(blocks, each) for each in fields()} | told
        write_log(tmp_path / f"{name}.mcap", [RawSweeps(**values)])
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.3 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, 11)]
    (tmp_path / "p.tum").write_text("".join(lines))
    for name in ("odd", "none"):
        words = ("-q", "map", tmp_path / f"{name}.mcap", "--poses", tmp_path / "p.tum")
        assert lidarcli(*words, "-o", tmp_path / name / "m.yaml", "-o", tmp_path / name / "m.ply").code == 0
    for name in ("m.pgm", "m.ply"):
        assert (tmp_path / "odd" / name).read_bytes() == (tmp_path / "none" / name).read_bytes()


def test_deskewing_sharpens(lidarcli: Run, tmp_path: Path) -> None:
    """A sensor that goes 2 m/s and takes 0.1 s for a turn: without deskewing beams are up to 0.2 m off."""
    beams, count = 360, 30
    bearing = -np.pi + 2 * np.pi / beams * np.arange(beams)
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.2 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, count + 2)]
    (tmp_path / "p.tum").write_text("".join(lines))
    rows = []
    for k in range(count):
        x = 0.2 * (k + np.arange(beams) / (beams - 1) * 0.999)
        with np.errstate(divide="ignore"):
            # A wall at x = 9.52 before, and one at x = -3.02 behind.
            distance = np.where(np.cos(bearing) > 0, 9.52 - x, -3.02 - x) / np.cos(bearing)
        rows.append(np.where(distance < 15, distance, np.inf))
    block = raw_sweeps(np.array(rows, np.float32), range_max=20.0)
    told = {"time_increment": np.full(count, 0.0999 / (beams - 1), np.float32)}
    write_log(tmp_path / "run.mcap", [RawSweeps(**{name: getattr(block, name) for name in fields()} | told)])
    spread = {}
    for name, options in {"sharp": (), "skewed": ("--no-deskew",)}.items():
        out = tmp_path / f"{name}.ply"
        words = ("-q", "map", tmp_path / "run.mcap", "--poses", tmp_path / "p.tum", "--pose-delay", 0, "-o", out)
        assert lidarcli(*words, *options).code == 0
        x = ply(out)[:, 0]
        spread[name] = float(np.abs(x[x > 5] - 9.52).max())
    assert spread["sharp"] < 0.005
    assert spread["skewed"] > 0.05


BEYOND = """
import numpy as np
from lidarcli.formalism.mapping.grid import Counts, TooLargeError, placed
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.sweeps import SweepPoses
from tests.sweeping import raw_sweeps, round_room
batch = normalise(raw_sweeps(round_room(1, 90)), np.arange(1), RangeRules())
for far in (1e12, 1e13, 1e15, 1.98e15, -1.98e15, 1e17, 1e25, 1e300):
    for resolution in (0.05, 0.001):
        poses = SweepPoses(np.array([far]), np.array([far]), np.zeros(1), np.zeros(1, bool))
        try:
            Counts(resolution, 10**9).add(placed(batch, poses, np.ones((1, 90), np.uint8)))
        except TooLargeError:
            pass
"""


@pytest.mark.slow
def test_no_cell_outside_is_counted() -> None:
    """Chains of tf may add up to more than the 1e12 m of a single pose. Compiled, such a cell is somebody else's memory."""
    checked = {**os.environ, "LIDARCLI_COMPILED": "no", "LIDARCLI_BOUNDS": "1"}
    command = [sys.executable, "-W", "ignore", "-c", BEYOND]
    ran = subprocess.run(command, cwd=ROOT, env=checked, capture_output=True, text=True, check=False)
    assert ran.stderr == ""
