"""The way of a sweep from the command line to its tables leads through few files, and through none of them twice."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.system import records
from tests.places import SAMPLES

PACKAGE = f"{Path(lidarcli.__file__).parent}{os.sep}"


LOG = "pipeline/detecting"
"""Where the work on a log begins."""


@contextmanager
def chains() -> Iterator[set[tuple[str, ...]]]:
    """Collect the chains of files of the package that call each other; imports and what makes records count for nothing."""
    found: set[tuple[str, ...]] = set()

    def note(frame: FrameType | None, event: str, _argument: object) -> None:
        if event != "call" or frame is None or not frame.f_code.co_filename.startswith(PACKAGE):
            return
        files: list[str] = []
        while frame is not None:
            name = frame.f_code.co_filename
            if frame.f_code.co_name == "<module>" and name.startswith(PACKAGE):
                return
            if name.startswith(PACKAGE) and name != records.__file__ and files[-1:] != [name]:
                files.append(name)
            frame = frame.f_back
        found.add(tuple(file.removeprefix(PACKAGE).removesuffix(".py") for file in reversed(files)))

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield found
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("command", "log", "most"), [("detect", "room.mcap", 9), ("track", "people.csv.gz", 10)])
def test_the_way_of_a_sweep(command: str, log: str, most: int, tmp_path: Path) -> None:
    arguments = ["-q", command, str(SAMPLES / log), "-o", str(tmp_path), "--jobs", "1"]
    # The first run imports everything.
    assert run(arguments) == 0
    with chains() as found:
        assert run([*arguments, "--overwrite"]) == 0
    # `__main__` comes first.
    deepest = max(found, key=len)
    assert len(deepest) + 1 <= most, " > ".join(deepest)
    ways = [chain[chain.index(LOG) :] for chain in sorted(found) if LOG in chain]
    assert [way for way in ways if len({*way}) < len(way)] == []
