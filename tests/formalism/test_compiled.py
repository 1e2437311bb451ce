"""The compiled core gives the same bits as its source run as plain Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lidarcli.system import compiled
from tests.places import REAL_LOGS, ROOT, SAMPLES, needs_real_logs


def run_core(*arguments: str, core: str, bounds: str = "") -> str:
    """Run Python with the compiled core or without, and return what it prints."""
    variables = {"LIDARCLI_COMPILED": core, "LIDARCLI_BOUNDS": bounds}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _compare(*logs: Path) -> None:
    one, other = (
        run_core("-m", "tests.formalism.digests", *map(str, logs), core=core).splitlines() for core in ("yes", "no")
    )
    assert len(one) == len(other) > 1000
    assert one == other


@pytest.mark.slow
@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
def test_the_compiled_core_agrees_with_its_source() -> None:
    _compare(SAMPLES / "room.mcap", SAMPLES / "corridor.bag")


@pytest.mark.slow
@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
@needs_real_logs
def test_the_compiled_core_agrees_with_its_source_on_real_logs() -> None:
    _compare(*(min((REAL_LOGS / log).glob("*.bag"), key=_size) for log in ("turtlebot", "leg_tracker", "pr2")))


@pytest.mark.slow
@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
def test_the_compiled_tracking_agrees_with_its_source() -> None:
    # The source goes through so many hostile logs as well.
    some = ("-m", "tests.formalism.tracking.digests", "60", "scenes")
    one, other = (run_core(*some, core=core).splitlines() for core in ("yes", "no"))
    assert len(one) == 60 + 5
    assert one == other


def _size(path: Path) -> int:
    return path.stat().st_size


@pytest.mark.parametrize("core", ["yes", "no"])
def test_the_core_is_left_out_where_that_is_asked_for(core: str) -> None:
    suffix = run_core("-c", "from lidarcli.formalism import core; print(core.__file__)", core=core).strip()
    assert suffix.endswith(".py") == (core == "no" or not compiled.is_there())
