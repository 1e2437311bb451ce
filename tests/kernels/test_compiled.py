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

COMPARING = Path(__file__).with_name("comparing.py")
REAL = Path(os.environ.get("LIDARCLI_REAL_LOGS", ""))


def _compare(*logs: Path) -> dict[str, int]:
    done = subprocess.run(
        [sys.executable, str(COMPARING), *map(str, logs)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    calls: dict[str, int] = json.loads(done.stdout)
    return calls


@pytest.mark.skipif(not kernels.PAIRS, reason="the kernels were not built")
def test_every_kernel_agrees_with_what_it_stands_for() -> None:
    calls = _compare(*sorted(Path("samples").glob("*.mcap")))
    assert calls.keys() == kernels.PAIRS.keys()
    assert min(calls.values()) > 80


@pytest.mark.skipif(not kernels.PAIRS, reason="the kernels were not built")
@pytest.mark.skipif(
    "LIDARCLI_REAL_LOGS" not in os.environ, reason="LIDARCLI_REAL_LOGS names no folder of real logs"
)
@pytest.mark.parametrize("log", ["turtlebot", "leg_tracker", "pr2"])
def test_every_kernel_agrees_on_real_logs(log: str) -> None:
    smallest = min((REAL / log).glob("*.bag"), key=lambda path: path.stat().st_size)
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
