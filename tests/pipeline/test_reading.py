"""Reading ahead: the same batches, and no thread that outlives the log."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import LogBatcher, ReadOptions
from lidarcli.pipeline.inputs.search import log_name
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading import one_log
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.sweeps.types import SweepBatch
from tests.places import SAMPLES

OPTIONS = ReadOptions(batch_size=8)


@pytest.fixture(params=["room.mcap", "corridor.bag", "drive.db3", "people.csv.gz"])
def source(request: pytest.FixtureRequest) -> Source:
    path = SAMPLES / request.param
    return Source(str(path), log_name(path))


@pytest.fixture
def ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_log, "WORTH_A_THREAD", 0)


def readers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("read")]


def read(source: Source) -> tuple[list[SweepBatch], list[int]]:
    positions: list[int] = []
    with open_source(source, OpenOptions()) as log, Reading(log, OPTIONS, PoseOptions()) as reading:
        batches = list(reading.batches(positions.append))
    return batches, positions


def test_small_files_need_no_thread(source: Source) -> None:
    with open_source(source, OpenOptions()) as log, Reading(log, OPTIONS, PoseOptions()) as reading:
        next(iter(reading.batches(None)))
        assert readers() == []


def test_the_same_batches_at_the_same_places(source: Source, monkeypatch: pytest.MonkeyPatch) -> None:
    expected, places = read(source)
    monkeypatch.setattr(one_log, "WORTH_A_THREAD", 0)
    found, positions = read(source)
    assert positions == places
    assert len(found) == len(expected) > one_log.AHEAD
    for one, other in zip(found, expected, strict=True):
        assert one.topic == other.topic
        assert one.ranges.tobytes() == other.ranges.tobytes()
        assert np.array_equal(one.status, other.status)
        assert (one.poses is None) == (other.poses is None)


@pytest.mark.usefixtures("ahead")
def test_no_thread_is_left_when_a_run_breaks_off(source: Source) -> None:
    def break_off() -> None:
        with open_source(source, OpenOptions()) as log, Reading(log, OPTIONS, PoseOptions()) as reading:
            for _ in reading.batches(None):
                assert len(readers()) == 1
                raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        break_off()
    assert readers() == []


@pytest.mark.usefixtures("ahead")
def test_what_goes_wrong_is_raised_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    flush = LogBatcher.flush

    def breaks(self: LogBatcher) -> Iterator[SweepBatch]:
        for number, batch in enumerate(flush(self)):
            if number == 3:
                raise MemoryError("too much")
            yield batch

    monkeypatch.setattr(LogBatcher, "flush", breaks)
    source = Source(str(SAMPLES / "room.mcap"), "room")
    seen: list[SweepBatch] = []
    with (
        open_source(source, OpenOptions()) as log,
        Reading(log, OPTIONS, PoseOptions()) as reading,
        pytest.raises(MemoryError, match="too much"),
    ):
        seen.extend(reading.batches(None))
    assert len(seen) == 3
