"""The release workflow builds for the platforms and Pythons it should, and publishes nothing but a tag that was tried."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from typing import Any

import pytest
from ruamel.yaml import YAML

from tools.make_docs import ROOT

PATH = ROOT / ".github" / "workflows" / "wheels.yml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


@pytest.fixture(scope="module")
def jobs() -> Any:
    return YAML(typ="safe").load(PATH.read_text("utf-8"))["jobs"]


def test_one_runner_of_its_own_kind_for_every_platform(jobs: Any) -> None:
    built = {each["wheels"]: each["runner"] for each in jobs["wheels"]["strategy"]["matrix"]["include"]}
    assert set(built) == {"linux-x86_64", "linux-aarch64", "macos-x86_64", "macos-arm64", "windows-amd64"}
    assert len(set(built.values())) == len(built)


def test_every_python_that_is_claimed_has_wheels() -> None:
    claimed = {
        classifier.rpartition(" ")[2].replace(".", "")
        for classifier in PROJECT["project"]["classifiers"]
        if re.search(r":: 3\.\d+$", classifier)
    }
    assert PROJECT["tool"]["cibuildwheel"]["build"] == " ".join(f"cp{each}-*" for each in sorted(claimed))


def test_wheels_are_compiled_and_tried() -> None:
    options = PROJECT["tool"]["cibuildwheel"]
    assert options["environment"] == {"LIDARCLI_BUILD": "required"}
    assert options["test-command"] == "python -P {project}/tools/smoke.py"


def test_only_a_tag_is_published_and_only_when_all_was_tried(jobs: Any) -> None:
    publish = jobs["publish"]
    assert publish["if"] == "github.event_name == 'push' && github.ref_type == 'tag'"
    assert publish["needs"] == [name for name in jobs if name != "publish"]
    assert publish["permissions"] == {"id-token": "write"}
    assert [name for name, job in jobs.items() if "permissions" in job] == ["publish"]
    uploaded = [
        step["with"]["name"] for job in jobs.values() for step in job["steps"] if "upload-" in str(step)
    ]
    (pattern,) = [step["with"]["pattern"] for step in publish["steps"] if "with" in step]
    assert pattern == "dist-*"
    assert uploaded == ["dist-${{ matrix.wheels }}", "dist-sdist"]


@pytest.mark.skipif(find_spec("check_jsonschema") is None, reason="check-jsonschema is not installed")
def test_the_workflow_fits_the_schema_of_workflows() -> None:
    # The schema comes with the package: nothing is fetched.
    command = [
        sys.executable,
        "-m",
        "check_jsonschema",
        "--builtin-schema",
        "vendor.github-workflows",
        str(PATH),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
