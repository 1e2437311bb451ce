"""`lidarcli match`: files, messages, exit codes."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.tabular.schemas import MATCHES
from tests.pipeline.tracks_tables import ROOM, turned, write_tracks
from tests.tabular.writing import shortest

Run = Callable[..., Any]


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, Path]:
    """The room on two days, the second time seen from elsewhere; one box was moved by 1 m."""
    later = turned([{**ROOM[0], "x": 1.0}, *ROOM[1:]], 0.5, 1.0, 0.0)
    return (
        write_tracks(tmp_path / "monday.tracks.parquet", "monday", ROOM),
        write_tracks(tmp_path / "tuesday.tracks.parquet", "tuesday", later),
    )


def test_a_table_and_what_is_said(runs: tuple[Path, Path], tmp_path: Path, lidarcli: Run) -> None:
    out = tmp_path / "new" / "things.parquet"
    ran = lidarcli("match", *runs, "-o", out)
    assert (ran.code, ran.out) == (0, "")
    assert ran.err.splitlines() == [
        "monday /scan: 5 things, 0 known, 0 of them moved by more than 0.3 m",
        "tuesday /scan: 5 things, 5 known, 1 of them moved by more than 0.3 m; "
        "lies at -0.88, 0.48 m, turned by -28.6 deg",
        "  note     matched by constellation: the frame of the places is the sensor's own, which need not be the "
        "same place",
        f"  wrote    {out}",
    ]
    table = pq.read_table(out)
    assert table.schema.equals(MATCHES)
    assert table["moved"].to_pylist()[1] == pytest.approx(1.0)
    again = tmp_path / "again.parquet"
    assert lidarcli("match", *runs, "-o", again).code == 0
    assert again.read_bytes() == out.read_bytes()


def test_other_formats(runs: tuple[Path, Path], tmp_path: Path, lidarcli: Run) -> None:
    files = {suffix: tmp_path / f"things{suffix}" for suffix in (".csv", ".ndjson", ".arrow")}
    for file in files.values():
        assert lidarcli("match", *runs, "-o", file).code == 0
    lines = list(csv.DictReader(files[".csv"].read_text().splitlines()))
    objects = [json.loads(line) for line in files[".ndjson"].read_text().splitlines()]
    with pa.ipc.open_stream(files[".arrow"]) as stream:
        arrow = shortest(stream.read_all())
    assert [line["log"] for line in lines[:2]] == ["monday", "tuesday"]
    assert objects == arrow
    assert (lines[0]["moved"], objects[0]["moved"]) == ("", None)
    assert float(lines[1]["moved"]) == pytest.approx(1.0)


def test_exit_codes(runs: tuple[Path, Path], tmp_path: Path, lidarcli: Run) -> None:
    out = tmp_path / "things.parquet"
    ran = lidarcli("match", runs[0], "-o", out)
    assert ran.code == 2
    assert ran.err == (
        f"lidarcli: {runs[0]}: one run has nothing to be matched with; give the tracks of two or more\n"
    )
    assert lidarcli("match", *runs, "-o", tmp_path / "things.txt").code == 2
    assert lidarcli("match", *runs).code == 2
    assert lidarcli("match", *runs, "--by", "luck", "-o", out).code == 2
    assert lidarcli("match", runs[0], tmp_path / "none.tracks.parquet", "-o", out).code == 3
    assert not out.exists()
    out.write_bytes(b"mine")
    assert lidarcli("match", *runs, "-o", out).code == 5
    assert lidarcli("match", *runs, "-o", runs[0], "--overwrite").code == 5
    assert out.read_bytes() == b"mine"
    assert lidarcli("match", *runs, "-o", out, "--overwrite").code == 0


def test_by_position(runs: tuple[Path, Path], tmp_path: Path, lidarcli: Run) -> None:
    out = tmp_path / "things.parquet"
    ran = lidarcli("match", *runs, "--by", "position", "-o", out)
    assert ran.code == 0
    assert "matched by position, in the frame the sensor's own" in ran.err
    assert max(pq.read_table(out)["moved"].drop_null().to_pylist()) > 1.5
