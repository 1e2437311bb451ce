"""Releases are built for the platforms and Pythons they should, and nothing is published but a tag that was tried."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tests.places import ROOT
from tests.publishing.files import PROJECT, WORKFLOWS, misfits, read_yaml, steps

PYTHONS = [
    version[1] for classifier in PROJECT["project"]["classifiers"] if (version := re.search(r":: (3\.\d+)$", classifier))
]


@pytest.fixture(scope="module")
def release() -> Any:
    return read_yaml(WORKFLOWS / "release.yml")["jobs"]


@pytest.fixture(scope="module")
def ci() -> Any:
    return read_yaml(WORKFLOWS / "ci.yml")["jobs"]


@pytest.mark.parametrize("path", sorted(WORKFLOWS.iterdir()), ids=lambda path: path.name)
def test_a_workflow_fits_the_schema_of_workflows(path: Path) -> None:
    assert misfits(path, "vendor.github-workflows") == ""
    assert misfits(path, "custom.github-workflows-require-timeout") == ""


def test_new_versions_of_actions_are_proposed() -> None:
    assert misfits(WORKFLOWS.parent / "dependabot.yml", "vendor.dependabot") == ""
    (watched,) = read_yaml(WORKFLOWS.parent / "dependabot.yml")["updates"]
    assert (watched["package-ecosystem"], watched["directory"]) == ("github-actions", "/")


def test_one_runner_of_its_own_kind_for_every_platform(release: Any) -> None:
    built = {each["wheels"]: each["runner"] for each in release["wheels"]["strategy"]["matrix"]["include"]}
    assert set(built) == {"linux-x86_64", "linux-aarch64", "macos-x86_64", "macos-arm64", "windows-amd64"}
    assert len(set(built.values())) == len(built)


def test_every_python_that_is_claimed_has_wheels_and_tests(ci: Any) -> None:
    assert PYTHONS == ["3.11", "3.12", "3.13", "3.14"]
    tags = " ".join(f"cp{version.replace('.', '')}-*" for version in PYTHONS)
    assert PROJECT["tool"]["cibuildwheel"]["build"] == tags
    assert PROJECT["project"]["requires-python"] == f">={PYTHONS[0]}"
    for job in ("unix", "windows"):
        assert ci[job]["strategy"]["matrix"]["python"] == PYTHONS


def test_wheels_are_compiled_and_tried() -> None:
    options = PROJECT["tool"]["cibuildwheel"]
    assert options["environment"] == {"LIDARCLI_BUILD": "required"}
    assert options["test-command"] == "python -P {project}/tools/smoke.py"


def test_only_a_tag_is_published_and_only_when_all_was_tried(release: Any) -> None:
    assert list(release) == ["wheels", "sdist", "publish", "release"]
    for name, needs in {"publish": ["wheels", "sdist"], "release": ["publish"]}.items():
        assert release[name]["if"] == "github.event_name == 'push' && github.ref_type == 'tag'"
        assert release[name]["needs"] == needs
    assert all("if" not in release[name] for name in ("wheels", "sdist"))


def test_only_the_jobs_that_publish_may_write(release: Any, ci: Any) -> None:
    rights = {name: job["permissions"] for name, job in (release | ci).items() if "permissions" in job}
    assert rights == {
        "publish": {"id-token": "write"},
        "release": {"attestations": "write", "contents": "write", "id-token": "write"},
    }
    for name in ("release.yml", "ci.yml"):
        assert read_yaml(WORKFLOWS / name)["permissions"] == {"contents": "read"}


def test_what_goes_to_pypi_are_distributions_alone(release: Any) -> None:
    uploaded = [step["with"]["name"] for step in steps(release) if "upload-" in step.get("uses", "")]
    assert uploaded == ["dist-${{ matrix.wheels }}", "dist-sdist", "sbom"]
    taken = {
        name: [step["with"] for step in release[name]["steps"] if "download-" in step.get("uses", "")]
        for name in ("publish", "release")
    }
    distributions = {"pattern": "dist-*", "path": "dist", "merge-multiple": True}
    assert taken == {"publish": [distributions], "release": [distributions, {"name": "sbom", "path": "dist"}]}


def test_what_publishes_is_named_by_its_content(release: Any) -> None:
    """A tag or a branch may be moved by somebody else."""
    (used,) = [step["uses"] for step in steps(release) if "pypi-publish" in step.get("uses", "")]
    assert re.fullmatch(r"pypa/gh-action-pypi-publish@[0-9a-f]{40}", used)


def test_the_release_is_of_what_was_attested(release: Any) -> None:
    names = [step.get("uses", step.get("name")).partition("@")[0] for step in release["release"]["steps"]]
    sums, attest, made = (
        names.index("Sums, for whoever packs it again"),
        names.index("actions/attest-build-provenance"),
        names.index("Release"),
    )
    assert sums < attest < made == len(names) - 1
    attested = release["release"]["steps"][attest]["with"]
    assert attested == {"subject-path": "dist/*"}
    assert release["release"]["steps"][made]["run"].endswith("dist/*\n")


def test_no_script_of_a_workflow_holds_an_expression(release: Any, ci: Any) -> None:
    # A tag or a title may be called anything; as environment it is text, in a script it would be read as commands.
    scripts = [step["run"] for step in [*steps(release), *steps(ci)] if "run" in step]
    assert len(scripts) > 10
    assert [script for script in scripts if "${{" in script] == []


def test_one_version_of_each_action_everywhere() -> None:
    paths = [*WORKFLOWS.iterdir(), ROOT / "action.yml", ROOT / "docs" / "ci.md"]
    used = {found for path in paths for found in re.findall(r"uses: ([\w/-]+)@(\S+)", path.read_text("utf-8"))}
    assert len(used) == len({name for name, _ in used}) > 7


def test_the_tests_that_windows_runs_are_there(ci: Any) -> None:
    (line,) = [step["run"] for step in ci["windows"]["steps"] if "pytest" in step.get("run", "")]
    rooms = [word for word in line.split() if word.startswith("tests/")]
    assert len(rooms) == 5
    assert [room for room in rooms if not (ROOT / room).exists()] == []
    asked = re.compile(r"^import (resource|fcntl|pty|termios|pwd|grp)|mkfifo|/dev/full|SIGKILL", re.MULTILINE)
    files = [path for room in rooms for path in ((ROOT / room).rglob("*.py") if (ROOT / room).is_dir() else [ROOT / room])]
    assert [path for path in files if asked.search(path.read_text("utf-8"))] == []
