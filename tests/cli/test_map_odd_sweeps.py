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

from lidarcli.simulation.writers import write_log
from tests.cli.maps import COUNTED, DRIVE, Run, names, occupied
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
    assert ran.err.splitlines()[-1] == f"  wrote    {tmp_path}/m.{{yaml,pgm,parquet}}"
    assert len(occupied(tmp_path / "m.yaml")) > 100
    metadata = pq.read_schema(tmp_path / "m.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"])[0].startswith("cut.mcap: ")


BEYOND = """
import numpy as np
from lidarcli.formalism.mapping.grid import Counts, TooLargeError, placed
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepPoses
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
