"""Intensities from a log to the gate of a pipeline."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from tests.places import SAMPLES

LOG = SAMPLES / "reflectors.mcap"


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    assert run(["-q", "track", str(LOG), "-o", str(tmp_path / "lit")]) == 0
    return tmp_path / "lit"


@pytest.mark.parametrize(
    ("check", "code"),
    [
        ("intensity.max == 3100", 0),
        ("intensity.p95 <= 800", 1),
        ("intensity.p50 between 100 and 200", 0),
        ("objects where intensity > 1000 == 120", 0),
        ("objects where intensity < 100 and shape == round >= 61", 1),
        ("objects where intensity is null == 0", 0),
    ],
)
def test_checks_of_a_report(check: str, code: int, tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "report", str(tables), "--check", check]) == code
    assert "intensity " in capfd.readouterr().out


def test_tables_of_earlier_versions_have_none(tables: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """They are read by all that read tables; a check of what is not there cannot be made."""
    path = tables / "reflectors.objects.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["intensity"]), path)
    assert run(["-q", "report", str(tables)]) == 0
    assert "intensity" not in capfd.readouterr().out
    assert run(["-q", "report", str(tables), "--check", "intensity.max <= 1e9"]) == 3
    assert "no column intensity, which a check asks for" in capfd.readouterr().err
    assert run(["-q", "report", str(tables), "--check", "objects where intensity > 1 == 0"]) == 3
    assert "no column intensity, which a check asks for; an older version" in capfd.readouterr().err
    assert run(["-q", "export", str(path), "-o", str(tmp_path / "old.csv")]) == 0
    made = tmp_path / "shown.mcap"
    assert run(["-q", "overlay", str(LOG), "--objects", str(path), "-o", str(made)]) == 0
    assert made.stat().st_size > 10_000
    picture = tmp_path / "one.png"
    tracks = str(tables / "reflectors.tracks.parquet")
    assert run(["-q", "plot", str(LOG), "--sweep", "3", "--tracks", tracks, "-o", str(picture)]) == 0


def test_a_stream_has_the_shortest_decimals(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "detect", str(LOG), "-o", "-", "--format", "csv", "--end", "0.5"]) == 0
    rows = list(csv.DictReader(io.StringIO(capfd.readouterr().out)))
    assert {row["intensity"] for row in rows} == {"60.0", "90.0", "120.0", "2800.0", "3100.0"}


def test_an_echo_that_is_none(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["detect", str(LOG), "--echo", "loudest"]) == 2
    assert "'loudest' is not one of 'first', 'last', 'strongest'" in capfd.readouterr().err


def test_an_overlay_takes_the_echo_of_its_tables(tmp_path: Path) -> None:
    log, shown = tmp_path / "run.jsonl", tmp_path / "shown.mcap"
    data = {
        "header": {"stamp": {"sec": 1_700_000_000, "nanosec": 0}, "frame_id": "laser"},
        "angle_min": -0.2,
        "angle_max": 0.2,
        "angle_increment": 0.1,
        "range_min": 0.1,
        "range_max": 9.0,
        "ranges": [{"echoes": [1.5, 2.5]}] * 5,
    }
    told = {"topic": "/scan", "sequence": 0, "log_time": "2023-11-14T22:13:20Z", "publish_time": "2023-11-14T22:13:20Z"}
    log.write_text(json.dumps(told | {"data": data}) + "\n")
    assert run(["-q", "detect", str(log), "-o", str(tmp_path), "--echo", "last"]) == 0
    tables = str(tmp_path / "run.objects.parquet")
    assert run(["-q", "overlay", str(log), "--objects", tables, "--with-log", "-o", str(shown)]) == 0
    (batch,) = lidarcli.read(shown)
    assert batch.ranges.tolist() == [[2.5] * 5]
