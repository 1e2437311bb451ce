"""Runs within a log: where the clock starts anew, and where stamps are only in disorder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.errors import NoScanError
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.clock import mended, restarts
from lidarcli.sweeps.types import Int64, RawSweeps
from tests.fake_log import FakeLog
from tests.pipeline.in_memory import block

STEP, FIRST = 100_000_000, 1_700_000_000_000_000_000


def numbered(seconds: list[float]) -> RawSweeps:
    """Sweeps with these stamps since some moment [s], recorded one after the other."""
    stamps = FIRST + np.rint(np.array(seconds) * 1e9).astype(np.int64)
    return replace(block(sweeps=len(stamps)), stamp_ns=stamps, record_ns=FIRST + STEP * np.arange(len(stamps)))


def runs_of(raw: RawSweeps, cut: int = 1000) -> list[int]:
    """The run of each sweep."""
    blocks = mended(raw.rows(slice(k, k + cut)) for k in range(0, len(raw), cut))
    return [each.run for each in blocks for _ in range(len(each))]


TENTHS = [*(0.1 * np.arange(60))]


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize("clock", [0.0, 3.0 - 1.7e9, 5000.0], ids=["stamps", "simulated", "later"])
def test_a_clock_that_starts_anew_begins_a_run(cut: int, clock: float) -> None:
    raw = numbered([*TENTHS, *TENTHS[:30], *TENTHS])
    raw.stamp_ns[:] += np.int64(clock) * 1_000_000_000
    assert runs_of(raw, cut) == [1] * 60 + [2] * 30 + [3] * 60


@pytest.mark.parametrize(
    "seconds",
    [
        pytest.param([*TENTHS[:30], 1.0, *TENTHS[31:]], id="one late stamp"),
        pytest.param([*TENTHS[:30], 50.0, *TENTHS[31:]], id="one early stamp"),
        pytest.param([*TENTHS[:30], *TENTHS[24:]], id="set back by little"),
        pytest.param([*TENTHS, *TENTHS[:7]], id="too few to tell"),
        pytest.param([*np.column_stack([TENTHS, np.array(TENTHS) - 20.0]).ravel()], id="two clocks in turns"),
        pytest.param([*np.random.default_rng(1).permutation(TENTHS)], id="shuffled"),
        pytest.param([*TENTHS, *(60.0 + np.array(TENTHS))], id="a pause"),
    ],
)
def test_disorder_is_no_run(seconds: list[float]) -> None:
    assert set(runs_of(numbered(seconds))) == {1}


def test_a_sweep_that_comes_late_belongs_to_the_run_it_is_in() -> None:
    assert runs_of(numbered([*TENTHS[:-1], *TENTHS[:1], TENTHS[-1], *TENTHS[1:]])) == [1] * 59 + [2] * 61


def test_sensors_of_one_topic_start_anew_together() -> None:
    raw = numbered([*np.repeat(TENTHS, 2), *np.repeat(TENTHS, 2)])
    frame = (np.arange(len(raw)) % 2).astype(np.int32)
    two = replace(raw, frame_ids=("front", "rear"), frame=frame)
    two.stamp_ns[frame == 1] += 500 * STEP
    assert runs_of(two) == runs_of(two, 5) == [1] * 120 + [2] * 120


def starts(times: list[float]) -> list[int]:
    return restarts((np.array(times) * 1e9).astype(np.int64))


def test_disorder_without_end_is_bounded() -> None:
    assert starts([*TENTHS, *TENTHS, *TENTHS]) == [60, 120]
    many = np.random.default_rng(1).permutation(100_000).astype(np.int64) * STEP
    assert restarts(many) == []


def indices(**options: int) -> Int64:
    log = FakeLog([numbered([*TENTHS, *TENTHS])])
    return np.concatenate([batch.sweep for batch in read_batches(log, ReadOptions(**options), ReadReport())])


def test_one_run_is_read() -> None:
    assert indices().tolist() == [*range(120)]
    assert indices(run=1).tolist() == [*range(60)]
    # Sweeps are counted from the begin of the log, times from that of the run.
    assert indices(run=2, every=7).tolist() == [*range(63, 120, 7)]
    assert indices(run=2, start=1, end=2).tolist() == [*range(70, 80)]
    with pytest.raises(NoScanError, match=r"^--run 3: the log holds 2 runs$"):
        indices(run=3)


def test_no_batch_has_sweeps_of_two_runs() -> None:
    for size in (1, 7, 500):
        batches = read_batches(FakeLog([numbered([*TENTHS, *TENTHS])]), ReadOptions(batch_size=size), ReadReport())
        assert [batch.run for batch in batches for _ in batch.sweep] == [1] * 60 + [2] * 60
