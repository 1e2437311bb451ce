"""Mutated logs of every container, a bounded number of them; `make fuzz` runs as many as one likes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tools.fuzz.containers import CONTAINERS
from tools.fuzz.run import ROOT, Case, Plan, fuzz

CASES = 240
"""Of each group: less than ten seconds."""
GROUPS = {
    group: tuple(name for name in CONTAINERS if name.split("-")[0] in group.split("/"))
    for group in ("mcap", "bag", "db3/ros2", "csv")
}


def test_every_container_is_in_a_group() -> None:
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(CONTAINERS)


@pytest.mark.parametrize("group", GROUPS)
def test_any_mutation_ends_in_tables_or_one_line(group: str) -> None:
    """No error but the project's own, no hang, no memory beyond the bound, no file left (tools/fuzz/judge.py)."""
    names = GROUPS[group]
    done, failures = fuzz(Plan(names, seed=1, cases=CASES // len(names)))
    assert failures == []
    assert done == CASES // len(names) * len(names)


def test_a_case_is_the_same_every_time(tmp_path: Path) -> None:
    for container in CONTAINERS:
        logs = [Case(container, 5, 3).write(tmp_path / f"{container}-{turn}") for turn in (1, 2)]
        first, second = (
            [(file.name, file.read_bytes()) for file in sorted(log.parent.rglob("*")) if file.is_file()]
            for log in logs
        )
        assert first == second


SABOTAGE = """
import os, sys
from tools.fuzz import judge, run
def sabotaged(log, scratch):
    number = sabotaged.count = sabotaged.count + 1
    if number == 2:
        {act}
    return []
sabotaged.count = 0
judge.judge = sabotaged
run.run_cases(*__import__("json").loads(sys.argv[1]))
"""


@pytest.mark.parametrize(
    ("act", "problem"),
    [
        ("os.kill(os.getpid(), 9)", "killed the process, exit code -9"),
        ("__import__('time').sleep(99)", "hangs: nothing"),
    ],
)
def test_a_case_that_kills_or_hangs_is_named_and_the_rest_goes_on(
    act: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tools.fuzz import run

    monkeypatch.setattr(run, "SILENCE", 8.0)
    monkeypatch.setattr(run, "CHILD", ("-c", SABOTAGE.format(act=act)))
    done, failures = fuzz(Plan(("db3",), seed=1, cases=5))
    assert done == 5
    # Two cases into a child, each of its followers begins anew.
    assert [failure.case.number for failure in failures] == [1, 3]
    assert all(failure.problem.startswith(problem) for failure in failures)


def test_the_command_counts_and_ends_well() -> None:
    command = [sys.executable, "-m", "tools.fuzz", "csv-ros2", "bag-lz4", "--cases", "2", "--seed", "3"]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert (ran.returncode, ran.stdout) == (0, "seed 3, 2 containers\n4 cases, 0 failures\n")
