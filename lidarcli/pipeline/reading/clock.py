"""The state of a log's clocks, from header and record times, in bounded memory for any length of log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import Int64, RawSweeps

SECOND = 1e-9
_KEPT = 1 << 19
"""Values a `Sample` keeps at most."""


@dataclass(frozen=True, slots=True)
class ClockInfo:
    """What the times of a run of sweeps say. Seconds and hertz, stamps in nanoseconds; None where unknown."""

    start_ns: int | None
    """Earliest header stamp (record time where the headers have none)."""
    end_ns: int | None
    """Latest."""
    rate: float | None
    """Sweeps per second, from the median step of the stamps."""
    backward: int
    """Steps back in time from one sweep to the next."""
    largest_backward: float
    """The largest of them."""
    zero_stamps: int
    """Headers without a stamp."""
    offset: float | None
    """Median of record time - header stamp."""

    @property
    def span(self) -> float:
        """From the earliest to the latest stamp."""
        return 0.0 if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) * SECOND

    @property
    def monotonic(self) -> bool:
        """Whether the stamps never step back."""
        return self.backward == 0


class Sample:
    """Values for a median: all of them, or every 2nd, 4th, ... once there are too many."""

    def __init__(self, kept: int = _KEPT) -> None:
        self._kept = kept
        self._stride = 1
        self._skip = 0
        self._parts: list[Int64] = []
        self._count = 0

    def add(self, values: Int64) -> None:
        """Take values in order."""
        picked = values[self._skip :: self._stride]
        self._skip = (self._skip - len(values)) % self._stride
        self._parts.append(picked)
        self._count += len(picked)
        while self._count > self._kept:
            joined = np.concatenate(self._parts)
            # The next value of the sparser sample continues the pattern of the one that is kept.
            if self._count % 2:
                self._skip += self._stride
            self._parts = [joined[::2].copy()]
            self._count = len(self._parts[0])
            self._stride *= 2

    def median(self) -> float | None:
        """Median of the sample; None when it is empty."""
        return float(np.median(np.concatenate(self._parts))) if self._count else None


class Clock:
    """Folds blocks of sweeps of one topic and frame, in log order, into `ClockInfo`."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._start: int | None = None
        self._end: int | None = None
        self._steps = Sample()
        self._offsets = Sample()
        self._backward = 0
        self._largest = 0
        self._zero = 0

    def add(self, block: RawSweeps) -> None:
        """Take the times of a block."""
        if not len(block):
            return
        has_stamp = block.stamp_ns != 0
        self._zero += int(np.count_nonzero(~has_stamp))
        self._offsets.add((block.record_ns - block.stamp_ns)[has_stamp])
        stamps = block.time_ns
        before = stamps[:1] if self._last is None else np.array([self._last])
        steps = np.diff(np.concatenate([before, stamps]))[self._last is None :]
        self._steps.add(steps[steps > 0])
        self._backward += int(np.count_nonzero(steps < 0))
        self._largest = max(self._largest, -int(steps.min(initial=0)))
        low, high = int(stamps.min()), int(stamps.max())
        self._start = low if self._start is None else min(self._start, low)
        self._end = high if self._end is None else max(self._end, high)
        self._last = int(stamps[-1])

    def info(self) -> ClockInfo:
        """The state of the clocks so far."""
        step = self._steps.median()
        offset = self._offsets.median()
        return ClockInfo(
            start_ns=self._start,
            end_ns=self._end,
            rate=1.0 / (step * SECOND) if step else None,
            backward=self._backward,
            largest_backward=self._largest * SECOND,
            zero_stamps=self._zero,
            offset=None if offset is None else offset * SECOND,
        )
