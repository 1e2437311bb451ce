"""What the core's files, compiled or not, ask of a test run."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from lidarcli.system import compiled

ROOT = Path(__file__).parent
CORE = sorted(ROOT.glob("lidarcli/**/*.pxd"))
OF_SOURCE = [ROOT / "tests/formalism/oracles", ROOT / "tests/formalism/tracking/steps"]
"""Tests of steps that compiled modules do not show. A run that names only such tests takes the source."""

named = [path for word in sys.argv[1:] if (path := Path(word.split("::")[0]).resolve()).exists()]
if named and all(any(path.is_relative_to(folder) for folder in OF_SOURCE) for path in named):
    os.environ["LIDARCLI_COMPILED"] = "no"
    compiled.use_source()

if compiled.is_there() and compiled.is_wanted():
    # Doctests are collected from files; a module that was compiled from one would be imported in its place.
    collect_ignore_glob = [str(path.with_suffix(".py")) for path in CORE]
    for path in CORE:
        for built in path.parent.glob(f"{path.stem}.*.so"):
            newest = max(path.stat().st_mtime, path.with_suffix(".py").stat().st_mtime)
            if built.stat().st_mtime < newest:
                raise SystemExit(f"{built.name} is older than its source: make compile")
else:
    # Where it could not be compiled, what commands say about that is nothing that their tests expect.
    os.environ.setdefault("LIDARCLI_COMPILED", "no")


class OfSource(pytest.File):
    """A file of tests that is named beside others: the compiled core, which they need, does not show what it tests."""

    def collect(self) -> list[pytest.Item]:
        """Skip the file."""
        pytest.skip("its steps are compiled: name it alone, or set LIDARCLI_COMPILED=no")


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(
    file_path: Path, parent: pytest.Collector
) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Skip tests of steps where the core is compiled."""
    found = yield
    if found and os.environ.get("LIDARCLI_COMPILED") != "no" and any(map(file_path.is_relative_to, OF_SOURCE)):
        return [OfSource.from_parent(parent, path=file_path)] if file_path.name.startswith("test_") else []
    return found
