"""The steps of the tracking against their references, and the compiled ones against their source."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lidarcli import compiled
from tests.places import ROOT

HERE = Path(__file__).parent
HOSTILE = 120
"""Hostile logs that the source goes through as well."""


def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run Python with some variables of the environment."""
    environment = os.environ | {"PYTEST_ADDOPTS": "", **variables}
    return subprocess.run(
        [sys.executable, "-m", *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_every_step_agrees_with_its_reference() -> None:
    # Compiled modules do not show their steps, so these tests run on the source, in a process of their own.
    folder = HERE.relative_to(ROOT) / "steps"
    done = run("pytest", "-q", "-p", "no:cacheprovider", str(folder), LIDARCLI_COMPILED="no", LIDARCLI_BOUNDS="1")
    assert done.returncode == 0, done.stdout
    written = sum(
        len(re.findall(r"^def test_", path.read_text(), re.MULTILINE)) for path in (HERE / "steps").glob("test_*.py")
    )
    counts = {kind: int(number) for number, kind in re.findall(r"(\d+) (\w+)", done.stdout.splitlines()[-1])}
    assert counts["passed"] + counts.get("xfailed", 0) >= written > 30
    assert "skipped" not in counts


def digests(core: str) -> list[str]:
    """What is told of all logs, a line each."""
    done = run("tests.formalism.tracking.digests", str(HOSTILE), "scenes", LIDARCLI_COMPILED=core)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.slow
@pytest.mark.skipif(not compiled.is_there(), reason="the core was not compiled")
def test_the_compiled_tracking_agrees_with_its_source() -> None:
    one, other = digests("yes"), digests("no")
    assert len(one) == HOSTILE + 5
    assert one == other
