"""`make bench` measures what it says; its figures are not judged here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.bench import run
from tests.places import ROOT
from tests.waiting import HANG

BENCH = ROOT / "benchmarks" / "bench.py"


@pytest.mark.whole
def test_the_benchmark_runs(tmp_path: Path) -> None:
    target = tmp_path / "bench.json"
    arguments = ["--sweeps", "50", "--repeats", "1", "--json", str(target)]
    done = subprocess.run(
        [sys.executable, str(BENCH), *arguments], capture_output=True, text=True, timeout=HANG, check=False
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(target.read_text(encoding="utf-8"))
    assert figures["robust"]["sweeps"] == 50
    assert figures["long"]["sweeps"] == 10 * figures["short"]["sweeps"]
    assert figures["objects_per_sweep"] > 5
    assert figures["ratio"]["detect"] > 1
    assert 20 < figures["robust"]["peak_mb"] < 300
    assert figures["on_cores"] > 0
    assert figures["track"]["sweeps"] == figures["moving"]["sweeps"] == 50
    assert figures["tracking"] == pytest.approx(
        figures["track"]["seconds"][0] / figures["moving"]["seconds"][0]
    )
    assert figures["plain_tracking"] > 0
    more = figures["matched"]["cpu_seconds"][0] - figures["unposed"]["cpu_seconds"][0]
    assert figures["matching_us"] == pytest.approx(1e6 * more / 50)
    assert 4 < figures["moving_per_sweep"] < 8
    assert "lidarcli --help" in done.stdout


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="needs a system that can pin")
def test_a_pinned_process_has_one_core() -> None:
    command = [sys.executable, "-c", "import os; print(len(os.sched_getaffinity(0)))"]
    assert run(*command, pinned=True).output == "1\n"
    assert run(*command).output == f"{len(os.sched_getaffinity(0))}\n"


@pytest.mark.whole
def test_the_full_benchmark_runs(tmp_path: Path) -> None:
    target = tmp_path / "full.json"
    arguments = ["--sweeps", "50", "--repeats", "1", "--longest", "0", "--json", str(target)]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.full", *arguments],
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(target.read_text(encoding="utf-8"))
    assert len(figures["cases"]) == 14
    assert figures["cases"]["CSV"]["sweeps"] == 10
    assert all(case["ratio"] > 1 for case in figures["cases"].values())
    assert set(figures["references_us"]) >= {"iterate 361", "read and decompress", "loop", "dbscan"}
    assert figures["references_us"]["dbscan"] > figures["references_us"]["read and decompress"]
    assert "| ROS 1 bag | 50 |" in done.stdout
