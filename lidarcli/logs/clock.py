"""The state of a log's clocks, from header and record times, in bounded memory; and what is odd about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import Int64, RawSweeps

SECOND = 1e-9
_KEPT = 1 << 16
"""Values a `Sample` keeps at most."""
FASTEST = 1000.0
"""[Hz] No sensor sweeps faster."""
SOME = 3
"""Sweeps of which that is no accident either, where there are few."""
SET_BACK = 1.0
"""[s] Messages that overtake each other are not so late."""
LEAP = 3600.0
"""[s] From one sweep to the next nobody waits so long."""
SAME_NS = 1
"""[ns] Stamps of text that are equal lie so far apart at most."""
OFTEN = 0.05
"""Share of the sweeps from which on it is no accident that a stamp goes back, or is that of the sweep before."""


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
    sweeps: int = 0
    recorded: int = 0
    """Sweeps without a stamp that were recorded at a time which is known."""
    repeated: int = 0
    """Sweeps with the stamp of the one before them."""
    largest_forward: float = 0.0
    """The largest step ahead."""

    @property
    def span(self) -> float:
        """From the earliest to the latest stamp."""
        return 0.0 if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) * SECOND

    @property
    def monotonic(self) -> bool:
        """Whether the stamps never step back."""
        return self.backward == 0

    def doubts(self, name: str, alike: bool) -> list[str]:
        """What is odd, a line each with the way out; `alike`: sweeps with the stamp of the one before are that one."""
        lines = []
        often = max(OFTEN * self.sweeps, SOME)
        both = "two sensors share the topic: record a topic for each"
        several = "the clock was set, or the log holds several runs: --start and --end take one of them"
        if self.repeated > often and alike:
            lines.append(
                f"{self.repeated:,} of {self.sweeps:,} sweeps of {name} are there twice, with stamp and ranges of the "
                "sweep before: --every 2 takes each once"
            )
        elif self.repeated > often:
            lines.append(
                f"{self.repeated:,} of {self.sweeps:,} sweeps of {name} have the stamp of the sweep before, and other "
                f"ranges: stamps are too coarse to tell speeds, or {both}"
            )
        elif self.rate is not None and self.rate > FASTEST:
            lines.append(
                f"stamps of {name} are {1e9 / self.rate:,.0f} ns apart: probably milliseconds or microseconds that were "
                "written as nanoseconds; until they are mended in the log, all speeds are wrong"
            )
        elif self.backward > often:
            lines.append(
                f"stamps of {name} go back {self.backward:,} times, by at most {_long(self.largest_backward)}: messages "
                f"are out of order (sort them by their stamps), or {both}"
            )
        elif self.largest_backward >= SET_BACK:
            times = "once" if self.backward == 1 else f"{self.backward:,} times"
            lines.append(
                f"stamps of {name} go back {times}, by at most {_long(self.largest_backward)}: {several}"
            )
        elif self.largest_forward > LEAP:
            lines.append(f"stamps of {name} leap ahead by {_long(self.largest_forward)}: {several}")
        if 0 < self.recorded < self.sweeps:
            lines.append(
                f"{self.recorded:,} of {self.sweeps:,} sweeps of {name} have no stamp: the times at which they were "
                "recorded are taken for them"
            )
        return lines


def _long(seconds: float) -> str:
    """A time in the unit that suits it.

    >>> _long(0.25), _long(3600.0), _long(31_536_000.0)
    ('0.250 s', '60.0 min', '365.0 days')
    """
    for unit, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds > 2 * unit:
            return f"{seconds / unit:,.1f} {name}"
    return f"{seconds:.3f} s"


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
        self._sweeps = 0
        self._recorded = 0
        self._repeated = 0
        self._number = -1
        self._forward = 0
        self._last: int | None = None
        self._start: int | None = None
        self._end: int | None = None
        self._steps = Sample()
        self._offsets = Sample()
        self._backward = 0
        self._largest = 0
        self._zero = 0

    def add(self, block: RawSweeps, sweep: Int64 | None = None) -> None:
        """Take the times of a block; `sweep` (S,) numbers its sweeps in the log, where some are left out."""
        if not len(block):
            return
        self._sweeps += len(block)
        has_stamp = block.stamp_ns != 0
        self._zero += int(np.count_nonzero(~has_stamp))
        self._recorded += int(np.count_nonzero(~has_stamp & (block.record_ns != 0)))
        self._offsets.add((block.record_ns - block.stamp_ns)[has_stamp])
        stamps = block.time_ns
        before = stamps[:1] if self._last is None else np.array([self._last])
        steps = np.diff(np.concatenate([before, stamps]))[self._last is None :]
        self._steps.add(steps[steps > 0])
        self._backward += int(np.count_nonzero(steps < 0))
        self._largest = max(self._largest, -int(steps.min(initial=0)))
        self._forward = max(self._forward, int(steps.max(initial=0)))
        number = np.arange(self._number + 1, self._number + 1 + len(block)) if sweep is None else sweep
        apart = np.diff(np.concatenate([[self._number], number]))[len(stamps) - len(steps) :]
        self._number = int(number[-1])
        self._repeated += int(
            np.count_nonzero((np.abs(steps) <= SAME_NS * apart) & has_stamp[len(stamps) - len(steps) :])
        )
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
            sweeps=self._sweeps,
            recorded=self._recorded,
            repeated=self._repeated,
            largest_forward=self._forward * SECOND,
        )
