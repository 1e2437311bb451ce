"""`make bench` measures what it says; its figures are not judged here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.bench import (
    CASES,
    COLUMNS,
    COMMANDS,
    MORE,
    REAL_LOGS,
    ROOM,
    Case,
    Run,
    chosen,
    figures_of,
    row,
    run,
    wanted,
)
from benchmarks.make_log import BLOCK, to_and_fro
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.sweeps import concatenate
from tests.places import ROOT, SAMPLES, needs_real_logs
from tests.waiting import HANG


def bench(*options: str, target: Path, code: int = 0) -> tuple[subprocess.CompletedProcess[str], Any]:
    """Run the benchmark with few sweeps, and return what it said and its cases."""
    tiny = ("--sweeps", "50", "--repeats", "1", "--json", str(target))
    command = [sys.executable, str(ROOT / "benchmarks" / "bench.py"), *tiny, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
    assert done.returncode == code, done.stderr
    return done, json.loads(target.read_text(encoding="utf-8"))["cases"]


@pytest.mark.whole
def test_all_cases_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(REAL_LOGS, raising=False)
    done, cases = bench("--all", target=tmp_path / "bench.json")
    assert list(cases) == [case.name for case in CASES + MORE if not case.log.recorded]
    assert f"{REAL_LOGS} names no folder" in done.stderr
    for name, sweeps in {
        "room, iterate": 50,
        "room, read": 50,
        "room, dbscan": 50,
        "1081 beams, iterate": 25,
        "CSV, detect": 10,
        "long, track": 500,
        "short, figure": 100,
    }.items():
        assert cases[name]["sweeps"] == sweeps
        assert f"\n| {name} | {cases[name]['seconds']:.2f} " in done.stdout
    # The first two tell their own times, without the start of Python.
    assert max(cases["room, read"]["us"], cases["room, iterate"]["us"]) < cases["room, detect"]["us"]
    assert cases["room, dbscan"]["us"] > cases["room, read"]["us"]
    assert cases["plain, detect, not compiled"]["us"] > cases["moving, detect"]["us"]
    assert cases["room, detect"]["objects"] == cases["ROS 1 bag, detect"]["objects"] == 6
    assert 80 < cases["room, detect"]["bytes_per_object"] < 300
    assert all(10 < case["peak_mb"] < 300 for case in cases.values())
    assert "sweeps" not in cases["lidarcli --help"]
    assert done.stdout.count("read and decode") == 2


@pytest.mark.whole
@needs_real_logs
def test_recordings_are_measured(tmp_path: Path) -> None:
    done, cases = bench("--only", "people", target=tmp_path / "bench.json")
    people = ["people, iterate", "people, detect", "people, track"]
    assert list(cases) == ["room, iterate", "room, detect", *people]
    assert [cases[name]["sweeps"] for name in people] == [18, 18, 18]
    assert cases["people, detect"]["objects"] > 4
    assert cases["people, detect"]["wanted"]["x"] == pytest.approx(1.15 * cases["room, detect"]["x"])
    assert "no folder" not in done.stderr


@pytest.mark.whole
def test_what_is_not_as_wanted_ends_with_code_1(tmp_path: Path) -> None:
    # The start of Python alone takes longer than the loop over so few messages.
    done, cases = bench("--assert", "--only", "room, detect", target=tmp_path / "bench.json", code=1)
    figures = cases["room, detect"]
    assert f"room, detect: x {figures['x']:.3g} is above 2.6\n" in done.stderr
    assert f"| **{figures['x']:.2f} > 2.6** |" in done.stdout
    bench("--assert", "--only", "short, info", target=tmp_path / "info.json")


def test_ratios_are_medians_of_rounds_per_sweep() -> None:
    others = [Run(second, 0.5 * second, 20.0, "", 1000) for second in (1.0, 2.0, 4.0)]
    runs = [Run(second, second, 30.0 + second, "", 100) for second in (0.3, 0.4, 1.6)]
    assert figures_of(runs, others) == pytest.approx(
        {
            "seconds": 0.4,
            "peak_mb": 31.6,
            "sweeps": 100,
            "per_second": 250,
            "us": 4000,
            "cpu_us": 4000,
            "x": 3.0,
            "cpu_x": 6.0,
            "cpu_us_more": 3000,
        }
    )


def test_a_case_comes_after_those_that_it_needs() -> None:
    done: set[str] = set()
    for case in CASES + MORE:
        assert case.command.split()[0] in COMMANDS
        assert done.issuperset(case.needs), case.name
        assert case.name not in done
        assert set(case.most) <= set(COLUMNS)
        done.add(case.name)


def test_chosen_cases_bring_those_that_they_need() -> None:
    assert [case.name for case in chosen(CASES, "report")] == ["short, figure", "short, track", "short, report"]
    assert chosen(CASES, "nothing of the kind") == []


def test_a_row_says_what_is_wanted() -> None:
    case = Case(ROOM, "detect", "room, iterate", {"x": 2.0, "cpu_x": (1.5, "room, iterate")})
    results = {"room, iterate": {"cpu_x": 2.0}, "room, detect": {"x": 2.5, "cpu_x": 2.5, "objects": 6.0}}
    assert wanted(case, results) == {"x": 2.0, "cpu_x": 3.0}
    assert row(case, results) == "| room, detect |  |  |  |  |  | **2.50 > 2** | 2.50 ≤ 3 |  | 6.0 |  | room, iterate |"


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="needs a system that can pin")
def test_a_pinned_process_has_one_core() -> None:
    command = [sys.executable, "-c", "import os; print(len(os.sched_getaffinity(0)))"]
    assert run(*command, pinned=True).output == "1\n"
    assert run(*command).output == f"{len(os.sched_getaffinity(0))}\n"


def test_a_recording_is_repeated_without_a_jump() -> None:
    recording = SAMPLES / "room.mcap"
    with open_log(str(recording)) as log:
        once = concatenate(list(log.scans(None, ReadReport())))
    blocks = list(to_and_fro(recording, BLOCK + 10))
    assert [len(block) for block in blocks] == [BLOCK, 10]
    longer = concatenate(blocks)
    way = [*range(100), *range(98, 0, -1)]
    order = np.array([way[n % len(way)] for n in range(len(longer))])
    np.testing.assert_array_equal(longer.ranges, once.ranges[order])
    assert np.unique(np.diff(longer.stamp_ns)).tolist() == [100_000_000]
    np.testing.assert_array_equal(longer.record_ns, longer.stamp_ns)
