"""What read a log does not wait for the garbage collector, which looks rarely in a run of the command line."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from pathlib import Path

import pytest

from lidarcli.errors import UnreadableError
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.over_logs import over_logs
from tests.places import SAMPLES


class Reader:
    """Refers to itself, as what reads a log does."""

    def __init__(self) -> None:
        self.itself = self


@pytest.mark.parametrize("fails", [False, True])
def test_each_log_takes_its_garbage_along(tmp_path: Path, fails: bool) -> None:
    (source,) = find_logs([str(SAMPLES / "room.mcap")])
    assert isinstance(source, Source)
    left: list[weakref.ref[Reader]] = []
    still_there = []

    def work(log: Source, *, progress: object = None) -> RunSummary:
        still_there.append(sum(each() is not None for each in left))
        left.append(weakref.ref(Reader()))
        if fails:
            raise UnreadableError("no log")
        return RunSummary()

    gc.disable()
    try:
        outcomes = [*over_logs([replace(source, name=str(number)) for number in range(5)], work)]
    finally:
        gc.enable()
    assert [outcome.exit_code for outcome in outcomes] == [3 * fails] * 5
    assert still_there == [0] * 5
