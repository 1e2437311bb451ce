"""The clock of a topic: rate, jumps, and the offset to the record times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.logs.clock import Clock, Sample
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


def test_sample_is_every_nth_value_whatever_the_pieces() -> None:
    values = np.arange(1000)
    for size in (1, 7, 64, 1000):
        sample = Sample(kept=100)
        for first in range(0, 1000, size):
            sample.add(values[first : first + size])
        assert np.concatenate(sample._parts).tolist() == values[:: sample._stride].tolist()
        assert sample._count <= 100
        assert sample.median() == pytest.approx(499.5, abs=8)
    assert Sample().median() is None
