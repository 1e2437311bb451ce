"""Intensities from a log to the gate of a pipeline."""

from __future__ import annotations

import json
from pathlib import Path

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
