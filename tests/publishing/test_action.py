"""The steps of action.yml, run in bash as a runner would, with the lidarcli at hand in the place of an installed one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.places import ROOT, SAMPLES
from tests.publishing.files import misfits, read_yaml

PATH = ROOT / "action.yml"
ACTION = read_yaml(PATH)
STEPS = {step["id"]: step for step in ACTION["runs"]["steps"] if "id" in step}
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


def executable(path: Path, script: str) -> Path:
    path.write_text(f"#!/bin/sh\n{script}\n", "utf-8")
    path.chmod(0o755)
    return path


@dataclass
class Runner:
    """What a runner keeps between the steps of one action: its inputs, and what steps have put out."""

    folder: Path
    inputs: dict[str, str]
    outputs: dict[str, dict[str, str]]
    said: str = ""

    def value(self, text: str) -> str:
        """An expression of action.yml, evaluated."""

        def replaced(found: re.Match[str]) -> str:
            place = found[1].split(".")
            if place[0] == "inputs":
                return self.inputs[place[1]]
            if place[0] == "steps":
                return self.outputs[place[1]].get(place[3], "")
            return {"github.action_path": str(ROOT), "runner.temp": str(self.folder)}[found[1]]

        return re.sub(r"\$\{\{ ([\w.-]+) \}\}", replaced, text)

    def run(self, name: str) -> int:
        """Run a step as `shell: bash` does; its exit code."""
        step, told = STEPS[name], self.folder / f"{name}.output"
        told.touch()
        files = {"GITHUB_OUTPUT": told, "GITHUB_STEP_SUMMARY": self.folder / "summary.md", "RUNNER_TEMP": self.folder}
        environment = os.environ | {key: str(path) for key, path in files.items()}
        environment |= {key: self.value(text) for key, text in step["env"].items()}
        command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        ran = subprocess.run(
            command,
            cwd=self.folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        self.said += ran.stdout
        self.outputs[name] = dict(line.split("=", 1) for line in told.read_text("utf-8").splitlines())
        return ran.returncode

    def run_all(self) -> int:
        """Run what follows the installation, up to the first step that fails."""
        return next((code for name in ("objects", "report", "verdict") if (code := self.run(name))), 0)


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    shutil.copy(SAMPLES / "room.mcap", tmp_path / "the room.mcap")
    shim = executable(tmp_path / "lidarcli-at-hand", f'exec "{sys.executable}" -m lidarcli "$@"')
    inputs = {name: str(said.get("default", "")) for name, said in ACTION["inputs"].items()}
    return Runner(tmp_path, inputs | {"logs": "the room.mcap\n"}, {"install": {"lidarcli": str(shim)}})


def test_it_fits_the_schema_of_actions() -> None:
    assert misfits(PATH, "vendor.github-actions") == ""


def test_inputs_reach_scripts_as_environment_alone() -> None:
    scripts = [step["run"] for step in ACTION["runs"]["steps"] if "run" in step]
    assert [script for script in scripts if "${{" in script] == []
    assert all(step["shell"] == "bash" for step in ACTION["runs"]["steps"] if "run" in step)
    used = set(re.findall(r"\$\{\{ inputs\.([\w-]+) \}\}", PATH.read_text("utf-8")))
    assert used == set(ACTION["inputs"])


@pytest.mark.parametrize("name", ["objects", "report"])
def test_no_name_of_a_file_or_topic_is_a_command_of_the_runner(name: str) -> None:
    before, after = STEPS[name]["run"].split("|| code=$?")
    assert before.rindex('echo "::stop-commands::$token"') < before.rindex('"$LIDARCLI"')
    assert after.lstrip().startswith('echo "::$token::"')


@needs_bash
@pytest.mark.whole
def test_a_run_whose_checks_hold(runner: Runner) -> None:
    runner.inputs |= {
        "checks": "sweeps == 20\n\nobjects_per_sweep.mean between 4 and 6\n",
        "args": "--every 5 --min-beams '4'",
    }
    assert runner.run_all() == 0, runner.said
    tables = {path.name for path in (runner.folder / "lidarcli-tables").iterdir()}
    assert tables == {"the room.objects.parquet", "the room.sweeps.parquet"}
    summary = (runner.folder / "summary.md").read_text("utf-8")
    assert summary.startswith("## lidarcli report: the room\n")
    assert "sweeps == 20" in summary
    report = Path(runner.value(ACTION["outputs"]["report"]["value"]))
    assert report == runner.folder / "lidarcli-report" / "report.html"
    assert report.read_text("utf-8").startswith("<!doctype html>")
    (kept,) = [step["with"] for step in ACTION["runs"]["steps"] if "upload-artifact" in step.get("uses", "")]
    assert Path(runner.value(kept["path"])).parent == report.parent
    assert {path.name for path in report.parent.glob("report.*")} == {"report.md", "report.html", "report.xml"}
    suite = ET.fromstring(Path(runner.value(ACTION["outputs"]["junit"]["value"])).read_bytes())
    assert [suite.attrib[name] for name in ("tests", "failures", "errors")] == ["3", "0", "0"]


@needs_bash
@pytest.mark.parametrize(
    ("inputs", "code"),
    [
        ({"command": "simulate"}, 2),
        ({"command": "zones"}, 2),
        ({"command": "detect", "zones": "z.toml"}, 2),
        ({"command": "diff"}, 2),
        ({"command": "zones", "zones": "$(touch planted)"}, 3),
        ({"command": "diff", "before": "; touch planted"}, 3),
        ({"checks-file": "`touch planted`"}, 3),
        ({"command": "detect; touch planted"}, 2),
        ({"logs": "$(touch planted)\n`touch planted`\n; touch planted"}, 3),
        ({"args": "--topic $(touch planted) ; touch planted"}, 3),
        ({"args": "--topic 'not closed"}, 1),
        ({"logs": "--version"}, 3),
        ({"tables": "$(touch planted)", "args": "--no-such-option"}, 2),
    ],
)
def test_inputs_are_no_commands(runner: Runner, inputs: dict[str, str], code: int) -> None:
    runner.inputs |= inputs
    assert runner.run_all() == code, runner.said
    assert not (runner.folder / "planted").exists()


@needs_bash
@pytest.mark.whole
def test_who_came_close(runner: Runner) -> None:
    (runner.folder / "stop zone.toml").write_text(
        '[[zone]]\nname = "stop"\ncircle = {x = 0, y = 0, radius = 2.0}\n', "utf-8"
    )
    (runner.folder / "checks.toml").write_text('checks = ["zones.stop.nearest > 1.5"]\n', "utf-8")
    runner.inputs |= {"command": "zones", "zones": "stop zone.toml", "checks-file": "checks.toml"}
    assert runner.run_all() == 0, runner.said
    runner.inputs |= {"checks": "zones.stop.events == 0", "tables": "again"}
    assert runner.run_all() == 1
    assert "::error title=lidarcli%3A check failed::zones.stop.events == 0" in runner.said
    suite = ET.fromstring(Path(runner.value(ACTION["outputs"]["junit"]["value"])).read_bytes())
    assert [suite.attrib[name] for name in ("tests", "failures", "errors")] == ["3", "1", "0"]


@needs_bash
@pytest.mark.whole
def test_what_changed(runner: Runner) -> None:
    shutil.copy(SAMPLES / "room_empty.mcap", runner.folder / "before.mcap")
    runner.inputs |= {"command": "diff", "before": "before.mcap", "checks": "gone == 0\nnew <= 5", "args": "--every 2"}
    assert runner.run_all() == 0, runner.said
    assert "gone == 0" in (runner.folder / "summary.md").read_text("utf-8")
    runner.inputs |= {"checks": "new == 0", "tables": "again"}
    assert runner.run_all() == 1


@needs_bash
@pytest.mark.whole
@pytest.mark.parametrize("command", ["detect", "zones", "diff"])
def test_damage_is_accepted_where_that_is_said(runner: Runner, command: str) -> None:
    (runner.folder / "cut.csv.gz").write_bytes((SAMPLES / "people.csv.gz").read_bytes()[:-60_000])
    shutil.copy(SAMPLES / "people.csv.gz", runner.folder)
    (runner.folder / "z.toml").write_text('[[zone]]\nname = "z"\ncircle = {x = 0, y = 0, radius = 1.0}\n', "utf-8")
    own = {"detect": {}, "zones": {"zones": "z.toml"}, "diff": {"before": "people.csv.gz"}}
    runner.inputs |= {"command": command, "logs": "cut.csv.gz", **own[command]}
    runner.inputs["checks"] = {"detect": "sweeps > 1", "zones": "zones.z.events == 0", "diff": "gone == 0"}[command]
    assert runner.run_all() == 3, runner.said
    runner.inputs |= {"accept-damage": "true", "tables": "again"}
    assert runner.run_all() == 0, runner.said
    # A name that is mistyped is no damage.
    runner.inputs |= {"logs": "cut.csv.gz\nmistyped.mcap", "tables": "once more"}
    assert runner.run_all() == 3


@needs_bash
def test_what_a_log_is_called_is_no_command_of_the_runner(runner: Runner) -> None:
    (runner.folder / "the room.mcap").rename(runner.folder / "::error::planted.mcap")
    runner.inputs["logs"] = "::error::planted.mcap"
    assert runner.run("objects") == 0
    lines = runner.said.splitlines()
    assert re.fullmatch(r"::stop-commands::lidarcli-\d+", lines[0])
    assert any(line.startswith("::error::planted.mcap: 100 sweeps") for line in lines[1:-1])
    assert lines[-1] == f"::{lines[0].removeprefix('::stop-commands::')}::"
