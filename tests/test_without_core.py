"""Where no compiler was at hand: the same tables, and one line that says why it takes so long."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.simulation.writers import write_log
from lidarcli.system import compiled
from tests.sweeping import BOX, raw_sweeps, round_room

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "LIDARCLI_COMPILED"}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as it is installed without a compiler."""
    folder = tmp_path_factory.mktemp("package")
    source = Path(lidarcli.__file__).parent
    shutil.copytree(source, folder / "lidarcli", ignore=shutil.ignore_patterns("*.so", "*.pyd", "__pycache__"))
    return folder


def run(package: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lidarcli", *arguments]
    environment = {**ENVIRONMENT, "PYTHONPATH": str(package), **variables}
    return subprocess.run(command, cwd=package, env=environment, capture_output=True, text=True, check=True)


def test_the_version_tells(package: Path) -> None:
    first, core, *_ = run(package, "--version").stdout.splitlines()
    assert first == f"lidarcli {lidarcli.__version__}"
    assert core == "  core       not compiled, about fifty times as slow (docs/performance.md)"


def test_detect_says_it_once_and_finds_the_same(package: Path, tmp_path: Path) -> None:
    logs = [str(tmp_path / f"{name}.mcap") for name in ("one", "other")]
    for log in logs:
        write_log(Path(log), [raw_sweeps(round_room(2, 180, BOX))])
    lines = run(package, "detect", *logs, "-o", str(tmp_path), "--min-thing", "0").stderr.splitlines()
    assert [line for line in lines if "compiled" in line] == [f"lidarcli: {compiled.MISSING}"]
    found = pq.read_table(tmp_path / "one.objects.parquet")
    expected = lidarcli.detect(logs[0], min_thing=0.0)
    assert found.num_rows == len(expected) == 2
    assert found["box_x"].to_pylist() == list(expected["box_x"].to_pylist())


def test_nobody_is_told_who_asked_for_it(package: Path, tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", [raw_sweeps(round_room(1, 180, BOX))])
    told = run(package, "detect", str(tmp_path / "run.mcap"), "-o", str(tmp_path), LIDARCLI_COMPILED="no").stderr
    assert "compiled" not in told
