"""The steps of detection and tracking against their slow references."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.places import ROOT

HERE = Path(__file__).parent


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "bounds"), [("oracles", ""), ("tracking/steps", "1")])
def test_every_step_agrees_with_its_reference(folder: str, bounds: str) -> None:
    # Compiled modules do not show their steps, so these tests run on the source, in a process of their own.
    variables = {"LIDARCLI_COMPILED": "no", "LIDARCLI_BOUNDS": bounds, "PYTEST_ADDOPTS": ""}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(HERE / folder)]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    written = sum(
        len(re.findall(r"^def test_", path.read_text(), re.MULTILINE)) for path in (HERE / folder).glob("test_*.py")
    )
    counts = {kind: int(number) for number, kind in re.findall(r"(\d+) (\w+)", done.stdout.splitlines()[-1])}
    # What is parametrised counts more than once.
    assert counts["passed"] + counts.get("xfailed", 0) >= written > 30
    assert "skipped" not in counts
