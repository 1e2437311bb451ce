"""`benchmarks.bench` counts instructions of a sweep, tells what is too much, and says what it cannot measure."""

from __future__ import annotations

from pathlib import Path
from subprocess import run

import numpy as np
import pytest

from benchmarks import bench
from benchmarks.bench import COUNTED, MOVING, PEOPLE, ROOM, TEN, Case, built, count, counted, possible, table
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.simulation.run import simulate

START, SWEEP = 2_000_000, {"iterate": 50_000, "detect": 300_000}


@pytest.fixture
def valgrind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs that are names, and a process whose instructions are known."""

    def taken(*words: str) -> int:
        log = next(Path(word) for word in words if word.endswith(".mcap"))
        command = next(word for word in words if word in SWEEP)
        return START + SWEEP[command] * int(log.stem.split()[-1])

    monkeypatch.setattr(bench, "run", lambda *words: None)
    monkeypatch.setattr(bench, "instructions_of", taken)


@pytest.mark.usefixtures("valgrind")
def test_instructions_of_a_sweep_leave_out_the_start(tmp_path: Path) -> None:
    cases = [counted(ROOM, "iterate"), counted(ROOM, "detect", 5)]
    found = count(cases, tmp_path)
    assert found[cases[0].name] == {"instructions": 50.0}
    assert found[cases[1].name] == {"instructions": 300.0, "instructions_x": 6.0}
    *_, last = table(cases, found)
    assert last == "| room, detect | 300.0 | **6.00 > 5** |"


@pytest.mark.usefixtures("valgrind")
def test_those_of_a_log_of_given_length_are_of_the_process(tmp_path: Path) -> None:
    assert count([counted(TEN, "detect", beside="detect")], tmp_path)["ten, detect, instructions"] == {
        "instructions": 5000.0
    }


def test_what_cannot_be_measured_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench.shutil, "which", lambda name: None)
    monkeypatch.delenv(bench.REAL_LOGS, raising=False)
    monkeypatch.setitem(bench.NEEDED, "small", "no_such_package")
    cases = [Case(ROOM, "small"), Case(PEOPLE, "detect"), Case(ROOM, "floor"), Case(MOVING, "detect")]
    assert possible([*cases, Case(MOVING, "detect", how=COUNTED)], tmp_path) == cases[-1:]
    assert capsys.readouterr().err.splitlines() == [
        "left out, as LIDARCLI_REAL_LOGS names no folder of recordings: people, detect",
        "left out, as there is no C compiler, or no libzstd.so.1: room, floor",
        "left out, as there is no package no_such_package: room, small",
        "left out, as there is no valgrind: moving, detect, instructions",
    ]


def test_the_program_in_c_touches_each_beam(tmp_path: Path) -> None:
    if not built(tmp_path / "floor"):
        pytest.skip("no C compiler, or no libzstd.so.1")
    log = tmp_path / "log.mcap"
    simulate(Path("samples/room.toml"), log, sweeps=30)
    with open_log(str(log)) as source:
        ranges = np.concatenate([block.ranges for block in source.scans(None, ReadReport())])
    sweeps, total = run([tmp_path / "floor", log], capture_output=True, text=True, check=True).stdout.split()
    assert int(sweeps) == len(ranges) == 30
    assert float(total) == pytest.approx(float(ranges[np.isfinite(ranges)].sum()), rel=1e-4)
