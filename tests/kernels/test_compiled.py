"""The compiled kernels: optional, and with the results of the functions they stand for, bit for bit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import lidarcli.formalism
import lidarcli.tables.rows  # noqa: F401  (all that is compiled is known once these are imported)
from lidarcli import kernels
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs

COMPARING = "tests.kernels.comparing"


def _compare(*logs: Path) -> dict[str, int]:
    command = [sys.executable, "-m", COMPARING, *map(str, logs)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    calls: dict[str, int] = json.loads(done.stdout)
    return calls


@pytest.mark.slow
@pytest.mark.skipif(not kernels.PAIRS, reason="the kernels were not built")
def test_every_kernel_agrees_with_what_it_stands_for() -> None:
    calls = _compare(*sorted(SAMPLES.glob("*.mcap")))
    assert calls.keys() == kernels.PAIRS.keys()
    assert min(calls.values()) > 80


@pytest.mark.slow
@pytest.mark.skipif(not kernels.PAIRS, reason="the kernels were not built")
@needs_real_logs
@pytest.mark.parametrize("log", ["turtlebot", "leg_tracker", "pr2"])
def test_every_kernel_agrees_on_real_logs(log: str) -> None:
    smallest = min((REAL_LOGS / log).glob("*.bag"), key=lambda path: path.stat().st_size)
    assert _compare(smallest).keys() == kernels.PAIRS.keys()


def test_without_kernels_nothing_is_replaced() -> None:
    program = "from lidarcli import formalism, kernels; formalism.detect; print(len(kernels.PAIRS))"
    ran = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"LIDARCLI_COMPILED": "no"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout == "0\n"
