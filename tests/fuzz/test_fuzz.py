"""Every target of the fuzzer, a bounded number of cases each; `make fuzz` runs as many as one likes."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from lidarcli import cli
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from tests.places import ROOT
from tests.waiting import HANG
from tools.fuzz import commands, judge, run
from tools.fuzz.containers import CONTAINERS
from tools.fuzz.databases import KINDS
from tools.fuzz.libraries import LIBRARY_LOGS, SWEEPS, library_sample, stamp_of
from tools.fuzz.place import VICTIMS, Place, snapshot
from tools.fuzz.run import Case, Plan, fuzz
from tools.fuzz.target import Random, Target
from tools.fuzz.targets import TARGETS

pytestmark = pytest.mark.whole

GROUPS: dict[str, tuple[tuple[str, ...], int]] = {
    **{
        group: (tuple(name for name in CONTAINERS if name.split("-")[0] in group.split("/")), 6)
        for group in ("mcap", "bag/db3/ros2", "csv", "carmen", "rplidar", "jsonl", "clouds")
    },
    "libraries": (LIBRARY_LOGS, 4),
    "databases": (("db3-crafted",), len(KINDS) + 10),
    "hostile logs": (("logs-crafted",), 8),
    "geometry": (("geometry",), 50),
    "texts": (("metadata", "scenes", "checks", "numbers"), 20),
    "counts": (("counts",), 30),
    "maps": (("maps",), 40),
    "masks": (("masks",), 25),
    "diff": (("diff",), 30),
    "zones": (("zones-toml", "zones-yaml"), 15),
    "copies": (("clean",), 25),
    "copies of databases": (("clean-db3",), len(KINDS) + 5),
    "trajectories": (("trajectories",), 25),
    "tables": (("tables",), 10),
    "names of tables": (("table-names",), 7),
    "settings": (("settings",), 20),
    "links": (("links",), 35),
    "two at once": (("twice",), 1),
}
"""Targets, and cases of each: what is known to have found something, and a few more."""


def test_every_target_is_in_a_group() -> None:
    assert sorted(name for names, _ in GROUPS.values() for name in names) == sorted(TARGETS)


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a case takes is judged by `make fuzz`, on a machine that does nothing else."""
    monkeypatch.setenv("FUZZ_SECONDS", "60")
    monkeypatch.setattr(run, "WALL", HANG)


@pytest.mark.parametrize("group", GROUPS)
def test_any_mutation_ends_in_tables_or_one_line(group: str) -> None:
    """No error but the project's own, no hang, no memory beyond the bound, no file touched or left (judge.py)."""
    names, cases = GROUPS[group]
    done, failures = fuzz(Plan(names, seed=1, cases=cases))
    assert failures == []
    assert done == cases * len(names)


def test_a_case_is_the_same_every_time(tmp_path: Path) -> None:
    place = Place(tmp_path / "case")
    for target in TARGETS.values():
        found = []
        for _ in range(2):
            Case(target.name, 5, target.known + 3).write(place)
            found.append(
                {
                    f"{folder.name}/{name}": (mode, size, content)
                    for folder in (place.input, place.out, place.victims)
                    for name, (mode, size, _, content) in snapshot(folder).items()
                }
            )
        assert found[0] == found[1], target.name
        assert {f"victims/{name}" for name in VICTIMS} <= found[0].keys()


def test_cheap_targets_have_more_turns_and_every_number_once() -> None:
    names = ("twice", "db3-crafted", "tables")
    weights = {name: TARGETS[name].weight for name in names}
    plan = Plan(names, seed=1, first=7, total=2 * sum(weights.values()))
    cases = [plan.case(index) for index in range(int(plan.length))]
    for name, weight in weights.items():
        numbers = [case.number for case in cases if case.target == name]
        assert sorted(numbers) == list(range(7, 7 + 2 * weight))


@pytest.mark.parametrize("name", LIBRARY_LOGS)
def test_logs_of_libraries_are_read_whole_as_they_are(name: str, tmp_path: Path) -> None:
    sample = library_sample(name)
    for file, data in sample.files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(data)
    with open_log(tmp_path / sample.log) as log:
        sweeps = sum(len(block) for block in log.scans(None, ReadReport()))
        assert sweeps == (7 if name == "db3-by-sqlite-deleted" else SWEEPS)


@pytest.mark.parametrize("name", ["db3-by-sqlite-wal", "db3-by-sqlite-journal"])
def test_sidecars_are_as_a_killed_writer_leaves_them(name: str, tmp_path: Path) -> None:
    """SQLite itself takes the rows of the -wal, and takes back those that were not committed."""
    files = library_sample(name).files
    assert len(files) == 2
    for file, data in files.items():
        (tmp_path / file).write_bytes(data)
    stamps = "SELECT timestamp FROM messages ORDER BY id"
    database = sqlite3.connect(tmp_path / "run.db3")
    assert [stamp for (stamp,) in database.execute(stamps)] == list(map(stamp_of, range(SWEEPS)))
    database.close()
    (tmp_path / "alone.db3").write_bytes(files["run.db3"])
    database = sqlite3.connect(f"file:{tmp_path / 'alone.db3'}?immutable=1", uri=True)
    assert [stamp for (stamp,) in database.execute(stamps)] != list(map(stamp_of, range(SWEEPS)))
    database.close()


def test_a_journal_that_names_a_victim_makes_sqlite_delete_it(tmp_path: Path) -> None:
    """Otherwise the case of that name would find nothing."""
    place = Place(tmp_path / "case")
    Case("db3-crafted", 1, list(KINDS).index("super-journal thesis")).write(place)
    shutil.copytree(place.input, tmp_path / "copy")
    database = sqlite3.connect(tmp_path / "copy" / "run.db3")
    database.execute("SELECT count(*) FROM messages").fetchone()
    database.close()
    assert not (place.victims / "thesis").exists()


def _burn(_place: Place) -> None:
    end = time.process_time() + 1.0
    while time.process_time() < end:
        pass


def _keep_open(place: Place) -> None:
    _KEPT.append((place.input / "log").open())


_KEPT: list[IO[str]] = []


@pytest.mark.parametrize(
    ("act", "problem"),
    [
        (lambda place: (place.victims / "thesis").write_bytes(b""), "victims: changed thesis"),
        (lambda place: os.utime(place.victims / "folder" / "inside"), "victims: changed folder/inside"),
        (lambda place: (place.victims / "locked").chmod(0o777), "victims: changed locked"),
        (lambda place: (place.victims / "thesis.db3").unlink(), "victims: removed thesis.db3"),
        (lambda place: (place.victims / "thesis.db3-wal").touch(), "victims: made thesis.db3-wal"),
        (lambda place: (place.input / "log").write_bytes(b"y"), "input: changed log"),
        (lambda place: (place.input / "log-shm").touch(), "input: made log-shm"),
        (lambda place: (place.root / "core").touch(), "made core beside the input"),
        (lambda place: (place.scratch / "left").mkdir(), "left temporary files: left"),
        (_keep_open, "left open: "),
        # Far more than is allowed: memory of earlier tests may be given back meanwhile.
        (lambda place: b"x" * 1_200_000_000, "took "),
        (_burn, "took 1."),
    ],
)
def test_whatever_must_not_happen_is_told(
    act: Callable[[Place], object], problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = _place(tmp_path)

    def sabotaged(place: Place) -> list[str]:
        act(place)
        return []

    # Memory, too, takes its time where the machine is busy.
    monkeypatch.setattr(judge, "SECONDS", 0.9 if act is _burn else 60.0)
    problems = judge.judge(Target("sabotaged", _write, sabotaged), place)
    while _KEPT:
        _KEPT.pop().close()
    assert len(problems) == 1
    assert problems[0].startswith(problem)
    place.prepare()
    _write(place, 0, np.random.default_rng(0))
    assert judge.judge(Target("innocent", _write, lambda place: []), place) == []


@pytest.mark.parametrize(
    ("code", "said", "output", "problem"),
    [
        (70, "Traceback", "", "info in/log: exit 70: Traceback"),
        (3, "", "", "info in/log: exit 3 without a word"),
        (9, "odd", "", "info in/log: exit 9: odd"),
        (0, "\x07", "", "info in/log: says what cannot be printed: '\\x07'"),
        (0, "a" * 1100, "", "info in/log: says 1100 characters at once"),
        (0, "", ".run.parquet.part", "left .run.parquet.part"),
        (0, "", "run.parquet", "run.parquet is no whole table"),
        (0, "", "r.json", "r.json: no whole json"),
        (0, "", "r.xml", "r.xml: no whole junit"),
        (0, "", "r.md", "r.md: control characters ['\\x01']"),
    ],
)
def test_whatever_a_command_must_not_do_is_told(
    code: int, said: str, output: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = _place(tmp_path)

    def sabotaged(arguments: list[str]) -> int:
        sys.stderr.write(said)
        if output:
            (place.out / output).write_bytes(b"PAR1\x01")
        return code

    monkeypatch.setattr(cli, "run", sabotaged)
    problems = judge.judge(Target("sabotaged", _write, commands.judge_commands), place)
    assert len(problems) == 1
    assert problems[0].startswith(problem)


def _place(folder: Path) -> Place:
    place = Place(folder / "case")
    place.prepare()
    _write(place, 0, np.random.default_rng(0))
    return place


def _write(place: Place, number: int, random: Random) -> None:
    (place.input / "log").write_bytes(b"x")
    place.note(commands=[["info", "in/log"]])


SABOTAGE = """
import os, sys, time
from tools.fuzz import run, targets
from tools.fuzz.target import Target
def write(place, number, random):
    (place.input / "log").write_bytes(b"x" * (2_000_000 if number == 1 else 1))
    place.note(number=number)
def judge(place):
    if place.noted()["number"] == 1:
        {act}
    return []
targets.TARGETS["db3"] = Target("db3", write, judge)
run.run_cases(sys.argv[1])
"""
"""A child in which the case of number 1 is spoilt."""


@pytest.mark.parametrize(
    ("act", "problem"),
    [
        ("os.kill(os.getpid(), 9)", "killed the process, exit code -9"),
        ("time.sleep(99)", "hangs: nothing for 5 s"),
        ("return ['odd']", "odd"),
    ],
)
def test_a_case_that_kills_or_hangs_is_named_and_the_rest_goes_on(
    act: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "WALL", 5.0)
    monkeypatch.setattr(run, "CHILD", ("-c", SABOTAGE.format(act=act)))
    told: list[run.Failure] = []
    done, failures = fuzz(Plan(("db3",), seed=1, cases=3), told.append)
    assert done == 3
    assert failures == told
    assert [failure.case for failure in failures] == [Case("db3", 1, 1)]
    assert failures[0].problem.startswith(problem)


def test_the_peak_of_one_case_is_not_blamed_on_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """The greedy case has a large input and may be; the small one after it in the same process is innocent."""
    monkeypatch.setattr(run, "CHILD", ("-c", SABOTAGE.format(act="b'x' * place.noted()['number'] * 600_000_000")))
    assert fuzz(Plan(("db3",), seed=1, cases=4)) == (4, [])


def test_children_beside_each_other_share_the_cases() -> None:
    plan = Plan(("csv-ros2", "bag-lz4"), seed=3, cases=3)
    assert fuzz(plan, jobs=2) == (6, [])


def test_the_command_counts_and_ends_well() -> None:
    command = [sys.executable, "-m", "tools.fuzz", "csv-ros2", "bag-l*", "--cases", "2", "--seed", "3"]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=HANG)
    assert (ran.returncode, ran.stdout) == (0, "seed 3, 2 targets\n4 cases, 0 failures\n")


def test_the_command_tells_failures_and_keeps_what_caused_them(tmp_path: Path) -> None:
    """By a target that is sabotaged."""
    script = (
        "import sys; from tools.fuzz import __main__, run, targets; from tools.fuzz.target import Target\n"
        "targets.TARGETS['db3'] = Target('db3', lambda place, number, random: None, lambda place: ['odd'])\n"
        f"run.CHILD = ('-c', {SABOTAGE.format(act='return [str(7)]')!r})\n"
        "__main__.main()"
    )
    options = ["db3", "--cases", "2", "--seed", "1", "--keep", str(tmp_path)]
    ran = subprocess.run(
        [sys.executable, "-c", script, *options],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG,
    )
    told = f"\n{tmp_path}/db3-1-1/in: 7\nagain: python -m tools.fuzz db3 --seed 1 --first 1 --cases 1\n"
    assert ran.stdout == f"seed 1, 1 targets\n{told}2 cases, 1 failures\n"
    assert ran.returncode == 1
    assert (tmp_path / "db3-1-1" / "victims" / "thesis").exists()


def test_a_fuzzer_that_breaks_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """It must not look like one that found nothing."""

    def count(done: int) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr("tools.fuzz.run.COUNTED", 2)
    with pytest.raises(RuntimeError, match=r"^broken$"):
        fuzz(Plan(("checks",), 1, 0, 3, None, None), count=count)
