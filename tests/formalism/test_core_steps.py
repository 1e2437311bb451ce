"""The steps of the core against their slow references, and that no module goes without a test."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lidarcli import formalism
from tests.places import ROOT

HERE = Path(__file__).parent
PACKAGE = Path(formalism.__file__).parent


@pytest.mark.slow
def test_every_step_agrees_with_its_reference() -> None:
    # Compiled modules do not show their steps, so these tests run on the source, in a process of their own.
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/formalism/oracles"],
        cwd=ROOT,
        env=os.environ | {"LIDARCLI_COMPILED": "no", "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    written = sum(
        len(re.findall(r"^def test_", path.read_text(), re.MULTILINE)) for path in (HERE / "oracles").glob("test_*.py")
    )
    counts = {kind: int(number) for number, kind in re.findall(r"(\d+) (\w+)", done.stdout.splitlines()[-1])}
    # What is parametrised counts more than once.
    assert counts["passed"] + counts.get("xfailed", 0) >= written > 30
    assert "skipped" not in counts


def modules() -> list[str]:
    """Every module of the formalism, as it is imported."""
    names = []
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.name != "__init__.py":
            names.append(".".join(["lidarcli.formalism", *path.relative_to(PACKAGE).with_suffix("").parts]))
    return names


def names_in(text: str) -> set[str]:
    """Modules that a file imports, by their full names."""
    found = set(re.findall(r"^\s*(?:from|import) (lidarcli\.formalism[\w.]*)", text, re.MULTILINE))
    for package, names in re.findall(r"^\s*from (lidarcli\.formalism[\w.]*) import (\([^)]*\)|[^\n]*)", text, re.MULTILINE):
        found |= {f"{package}.{name}" for name in re.findall(r"\w+", re.sub(r" as \w+", "", names))}
    return found


@pytest.mark.parametrize("module", modules())
def test_every_module_is_imported_by_a_test(module: str) -> None:
    # The helpers of tests may import it for them; zones and differences are tested beside their files and commands.
    tests = (path for room in ("formalism", "zones", "diff") for path in (HERE.parent / room).rglob("*.py"))
    assert any(module in names_in(path.read_text()) for path in tests)
