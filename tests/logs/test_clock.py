"""The clock of a topic: rate, jumps, and the offset to the record times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from lidarcli.logs.clock import HELD, Clock, mended
from lidarcli.sweeps.types import Int64, RawSweeps, concatenate
from tests.pipeline.in_memory import block


def test_clock_that_jumps_and_stops() -> None:
    clock = Clock()
    seconds = np.array([10.0, 10.1, 9.6, 9.7, 9.8])
    stamps = (seconds * 1e9).astype(np.int64)
    first = block(sweeps=5)
    clock.add(replace(first, stamp_ns=stamps, record_ns=stamps + 7_000_000_000))
    clock.add(replace(block(sweeps=1), stamp_ns=np.array([0]), record_ns=np.array([9_900_000_000])))
    info = clock.info()
    assert (info.backward, info.zero_stamps, info.monotonic) == (1, 1, False)
    assert info.largest_backward == pytest.approx(0.5)
    assert info.rate == pytest.approx(10)
    assert info.offset == pytest.approx(7)
    assert info.span == pytest.approx(0.5)


def test_clock_does_not_depend_on_the_blocks() -> None:
    whole, parts = Clock(), Clock()
    sweeps = block(sweeps=20)
    whole.add(sweeps)
    for k in range(0, 20, 3):
        parts.add(sweeps.rows(slice(k, k + 3)))
    assert parts.info() == whole.info()


STEP, FIRST = 100_000_000, 1_700_000_000_000_000_000
FAR = {"1970": 7, "2106": (2**32 - 1) * 10**9, "negative": -5 * 10**9}


def timed(stamps: Int64, records: Int64) -> RawSweeps:
    return replace(block(sweeps=len(stamps)), stamp_ns=stamps, record_ns=records)


@pytest.mark.parametrize("cut", [1, 7, 64])
@pytest.mark.parametrize("at", [[0], [20], [59], [0, 1, 2, 31, 59], [*range(30)]])
@pytest.mark.parametrize("start", [FIRST, 3 * 10**9])
def test_a_header_without_a_stamp_has_the_time_that_fits(start: int, at: list[int], cut: int) -> None:
    """Whatever clock the stamps are of, and however late the messages were recorded."""
    late = np.random.default_rng(1).integers(0, 5_000_000, 60)
    stamps, records = start + STEP * np.arange(60), FIRST + STEP * np.arange(60) + late
    whole = stamps.copy()
    stamps[at] = 0
    raw = timed(stamps, records)
    got = np.concatenate([each.time_ns for each in mended(raw.rows(slice(k, k + cut)) for k in range(0, 60, cut))])
    assert np.abs(got - whole).max() <= 5_000_000
    assert got.tolist() == concatenate(list(mended([raw]))).time_ns.tolist()


@pytest.mark.parametrize("recorded", [True, False], ids=["recorded", "stamps alone"])
@pytest.mark.parametrize("at", [0, 20, 59])
@pytest.mark.parametrize("value", [*FAR.values(), 0])
def test_a_stamp_far_from_all_others_is_none(value: int, at: int, recorded: bool) -> None:
    stamps = FIRST + STEP * np.arange(60)
    whole = stamps.copy()
    stamps[at] = value
    (got,) = mended([timed(stamps, whole if recorded else stamps.copy())])
    assert got.time_ns.tolist() == whole.tolist()
    assert got.stamp_ns[at] == value


def test_a_clock_that_was_set_is_left_alone() -> None:
    stamps = FIRST + STEP * np.arange(60)
    stamps[:10] = STEP * np.arange(1, 11)
    for times in (stamps, np.zeros(60, np.int64), STEP * np.arange(60)):
        (got,) = mended([timed(times, FIRST + STEP * np.arange(60))] if times.any() else [timed(times, times)])
        if times is not stamps:
            assert got.time_ns[1:].tolist() == times[1:].tolist()
        else:
            assert got.mended_ns is None


def test_few_sweeps_wait_for_a_stamp() -> None:
    """A stream without any stamp is passed on while it is read."""
    given = 0

    def endless() -> Iterator[RawSweeps]:
        nonlocal given
        for k in range(0, 10**6, 50):
            given += 50
            yield timed(np.zeros(50, np.int64), FIRST + STEP * np.arange(k, k + 50))

    first = next(mended(endless()))
    assert (len(first), first.mended_ns) == (50, None)
    assert given <= 2 * HELD


def test_two_sensors_on_one_topic_have_clocks_of_their_own() -> None:
    frame = (np.arange(60) % 5 == 0).astype(np.int32)
    times = np.where(frame, 10**9, FIRST) + STEP * np.arange(60)
    stamps = times.copy()
    stamps[[0, 20, 31]] = 0
    raw = replace(timed(stamps, FIRST + STEP * np.arange(60)), frame_ids=("front", "rear"), frame=frame)
    (got,) = mended([raw])
    assert got.time_ns.tolist() == times.tolist()
