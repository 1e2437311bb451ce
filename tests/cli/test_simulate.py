"""`lidarcli simulate`: a log, its truth, and what `detect` makes of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

Run = Callable[..., Any]

ROOM = Path(__file__).parents[2] / "samples" / "room.toml"


def test_log_and_truth(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.bag"
    ran = lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--compression", "lz4", "--seed", "3")
    assert (ran.code, ran.out) == (0, "")
    names = ["room.bag", "room.truth.parquet", "room.truth-beams.parquet"]
    assert ran.err.splitlines() == [f"{ROOM}: 5 sweeps", *(f"  wrote    {tmp_path / name}" for name in names)]
    assert set(pq.read_table(tmp_path / names[1])["sweep"].to_pylist()) == set(range(5))
    info = lidarcli("info", log).out
    assert "  format      ros1 bag, compression lz4\n" in info
    assert "    sweeps    5\n" in info


def test_duration(tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("simulate", ROOM, "-o", tmp_path / "room.mcap", "--duration", "0.7")
    assert (ran.code, ran.err.splitlines()[0]) == (0, f"{ROOM}: 7 sweeps")


def test_what_is_refused(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.mcap"
    both = lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--duration", "1")
    assert (both.code, both.err.splitlines()[-1]) == (2, "Error: --sweeps and --duration exclude each other")
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
