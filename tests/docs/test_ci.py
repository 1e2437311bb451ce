"""The pipelines of docs/ci.md do what they say."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from tests.places import ROOT

PAGE = (ROOT / "docs" / "ci.md").read_text("utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def pipeline(name: str) -> Any:
    """The YAML block that begins with the name of its file."""
    (text,) = [block for block in blocks("yaml") if block.startswith(f"# {name}\n")]
    return YAML(typ="safe").load(text)


def shell(script: str, folder: Path) -> str:
    """What a script prints; it has to succeed."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "GITHUB_STEP_SUMMARY": str(folder / "summary.md")}
    command = ["bash", "-e", "-o", "pipefail", "-c", script]
    ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, f"{script}\n{ran.stderr}"
    return ran.stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "samples").symlink_to(ROOT / "samples")
    (zones,) = blocks("toml stop.toml")
    (tmp_path / "stop.toml").write_text(zones, "utf-8")
    return tmp_path


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the tables of the room lie."""
    path = tmp_path_factory.mktemp("ci")
    (path / "samples").symlink_to(ROOT / "samples")
    shell("lidarcli -q detect samples/room.mcap -o tables", path)
    return path


@pytest.mark.slow
def test_github(folder: Path) -> None:
    job = pipeline(".github/workflows/steps.yml")["jobs"]["lidar"]
    steps = [step["run"] for step in job["steps"] if "run" in step]
    assert steps[0] == "pip install ."
    printed = [shell(step, folder) for step in steps[1:]]
    assert "::notice title=lidarcli%3A check passed::zones.stop.events == 0: found 0" in printed[1].splitlines()
    assert (folder / "summary.md").read_text("utf-8").startswith("## lidarcli report: zones in people\n")
    assert {path.name for path in folder.glob("report.*")} == {"report.md", "report.xml", "report.html"}


def test_the_action_knows_the_inputs_of_the_example() -> None:
    known = YAML(typ="safe").load((ROOT / "action.yml").read_text("utf-8"))["inputs"]
    jobs = pipeline(".github/workflows/lidar.yml")["jobs"].values()
    given = [step["with"] for job in jobs for step in job["steps"] if step["uses"].startswith("lidarcli/")]
    assert [one["command"] for one in given] == ["zones", "diff"]
    assert all(one.keys() <= known.keys() for one in given)
    assert len({one["artifact"] for one in given}) == len(given)


@pytest.mark.slow
def test_gitlab(folder: Path) -> None:
    job = pipeline(".gitlab-ci.yml")["lidar"]
    assert job["script"][0] == "pip install ."
    for step in job["script"][1:]:
        shell(step, folder)
    for name in (*job["artifacts"]["paths"], *job["artifacts"]["reports"]["junit"]):
        assert (folder / name).stat().st_size > 0


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("jq") is None, reason="needs jq")
def test_jq(tables: Path) -> None:
    (block,) = blocks("bash")
    mean, standing, wide = (shell(line, tables) for line in block.strip().splitlines())
    assert 4 < float(mean) < 6
    assert {len(line.split("\t")) for line in standing.splitlines()} == {3}
    assert all(float(line.split(",")[2]) > 0.8 for line in wide.splitlines())
    assert len(wide.splitlines()) >= 50
