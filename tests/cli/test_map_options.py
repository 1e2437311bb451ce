"""`lidarcli map`: what the options change in the map and the cloud."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.mapping.grid import OCCUPIED
from lidarcli.maps.grids import read_map
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from tests.cli.maps import DRIVE, GHOST, Run, fields, near, occupied, ply
from tests.sweeping import room_sweeps


def test_free_no_return(lidarcli: Run, tmp_path: Path) -> None:
    sweeps = room_sweeps(count=4)
    ranges = sweeps.ranges.copy()
    ranges[:, 90:180] = np.inf
    log = tmp_path / "half.mcap"
    write_log(log, [RawSweeps(**{name: getattr(sweeps, name) for name in fields()} | {"ranges": ranges})])
    (tmp_path / "p.tum").write_text("1700000000 0 0 0 0 0 0 1\n1700000001 0.01 0 0 0 0 0 1\n")
    free = {}
    for name, options in {"none": (), "two": ("--free-no-return", 2)}.items():
        ran = lidarcli(
            *("map", log, "--poses", tmp_path / "p.tum", "-o", tmp_path / f"{name}.yaml", "--min-move", 0, *options)
        )
        assert ran.code == 0
        free[name] = read_map(tmp_path / f"{name}.yaml").free
    # A quarter of a disc with a radius of 2 m, without the cells in which the beams end.
    assert free["two"] - free["none"] == pytest.approx(np.pi * 1.95**2 / 4 / 0.05**2, rel=0.03)


def test_voxel(lidarcli: Run, tmp_path: Path) -> None:
    counts = {}
    for size in (0, 0.05, 0.2):
        out = tmp_path / f"{size}.ply"
        assert lidarcli("-q", "map", DRIVE, "-o", out, "--voxel", size).code == 0
        points = ply(out)
        counts[size] = len(points)
        if size:
            assert len(np.unique(np.floor(points / size), axis=0)) == len(points)
    assert counts[0] > counts[0.05] > counts[0.2] > 100


def test_agents(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    """Who came and stays is a ghost in the map, unless agents are left out; what has always stood stays."""
    words = ("-q", "map", walk / "walk.mcap", "--min-move", 0, "-o")
    assert lidarcli(*words, tmp_path / "with.yaml", "-o", tmp_path / "with.parquet").code == 0
    assert lidarcli(*words, tmp_path / "out.yaml", "-o", tmp_path / "out.parquet", "--without", "agents").code == 0
    ghost, gone = occupied(tmp_path / "with.yaml"), occupied(tmp_path / "out.yaml")
    assert (near(ghost, *GHOST) > 8, near(gone, *GHOST)) == (True, 0)
    assert near(ghost, -2, -1.5, 0.5) == near(gone, -2, -1.5, 0.5) > 20
    assert read_map(tmp_path / "out.yaml").cells[round((1.5 + 3.1) / 0.05), round(5.1 / 0.05)] != OCCUPIED
    sets = {}
    for name in ("with", "out"):
        table = pq.read_table(tmp_path / f"{name}.parquet")
        sets[name] = Counter(table["set"].to_pylist())
    assert {*sets["with"]} == {"O", "A", "S"}
    assert sets["with"]["A"] > 1000
    assert sets["out"] == {"O": sets["with"]["O"], "S": sets["with"]["S"]}
