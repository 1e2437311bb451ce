"""`lidarcli map`: what the options change in the map and the cloud."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.mapping.grid import OCCUPIED
from lidarcli.maps import read_map
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps import RawSweeps
from tests.cli.maps import DRIVE, GHOST, Run, fields, near, occupied, ply
from tests.sweeping import room_sweeps


def points_of(path: Path) -> Any:
    table = pq.read_table(path)
    return table["sweep"].to_numpy(), np.column_stack([table["x"].to_numpy(), table["y"].to_numpy()])


@pytest.mark.slow
def test_start_end_every_range_min_move(lidarcli: Run, tmp_path: Path) -> None:
    def sweeps(*options: object) -> tuple[list[int], Any]:
        out = tmp_path / "m.parquet"
        assert lidarcli("-q", "map", DRIVE, "-o", out, "--overwrite", *options).code == 0
        index, points = points_of(out)
        return sorted(set(index.tolist())), points

    whole, points = sweeps()
    assert (whole[0], len(whole)) == (0, 75)
    every, _ = sweeps("--min-move", 0, "--start", 1, "--end", 3)
    assert every == list(range(5, 15))
    third, _ = sweeps("--min-move", 0, "--every", 3, "--end", 3)
    assert third == [0, 3, 6, 9, 12]
    coarse, _ = sweeps("--min-move", 1)
    assert len(coarse) < len(whole)
    _, close = sweeps("--range", "0.1", "3")
    assert 0 < len(close) < len(points)


@pytest.mark.slow
def test_min_hits_and_ratio(lidarcli: Run, tmp_path: Path) -> None:
    found = {}
    for name, options in {
        "default": (),
        "two": ("--min-hits", 2),
        "one": ("--min-hits", 1),
        "nine": ("--min-hits", 9),
        "share": ("--occupied-ratio", 0.8),
        "any": ("--occupied-ratio", 0),
        "all": ("--occupied-ratio", 1),
    }.items():
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.yaml", *options).code == 0
        found[name] = occupied(tmp_path / f"{name}.yaml")
    assert found["two"] == found["default"]
    assert found["nine"] < found["two"] < found["one"]
    assert found["share"] < found["default"] < found["any"]
    # More than all of them never hit.
    assert found["all"] == set()
    ran = lidarcli("map", DRIVE, "-o", tmp_path / "none.yaml", "--min-hits", 76)
    assert (
        "  note     no cell is occupied: 75 sweeps were used, and a cell has to be hit by 76 (--min-hits, --min-move)"
        in ran.err.splitlines()
    )
    # Four hits by default where every sweep counts.
    for name, options in {"a": ("--min-move", 0), "b": ("--min-move", 0, "--min-hits", 4)}.items():
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.yaml", *options).code == 0
    assert (tmp_path / "a.pgm").read_bytes() == (tmp_path / "b.pgm").read_bytes()


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
