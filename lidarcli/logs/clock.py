"""Statistics of header and record times of a log, in bounded memory, and findings on odd ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.findings import Finding, Sensor
from lidarcli.sweeps import Float64, Int64, RawSweeps
from lidarcli.times import SECOND_NS, Instant

SECOND = 1e-9
_KEPT = 1 << 16
"""Values a `Sample` keeps at most."""
FASTEST = 1000.0
"""No sensor sweeps faster [Hz]."""
SOME = 3
"""Fewest odd sweeps worth a note, in short logs."""
SET_BACK = 1.0
"""Overtaking messages are never this late [s]."""
LEAP = 3600.0
"""No pause between two sweeps is this long [s]."""
RUNS = 3
"""Most runs between large steps that are told apart."""
SAME_NS = 1
"""Equal stamps of text differ by at most this [ns]."""
OFTEN = 0.05
"""Share of repeated or decreasing stamps above which they are no accident."""
LONG = 1.5
"""A step this many times the median one has left out a sweep."""


@dataclass(frozen=True, slots=True)
class ClockInfo:
    """Statistics of the times of sweeps. Seconds and hertz, stamps in nanoseconds; None where unknown."""

    start_ns: int | None
    """Earliest header stamp (record time where the headers have none)."""
    end_ns: int | None
    """Latest header stamp."""
    rate: float | None
    """Sweeps per second, from the median step of the stamps."""
    backward: int
    """Steps back in time from one sweep to the next."""
    largest_backward: float
    """Largest step back [s]."""
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
    """Largest step ahead [s]."""
    copies: int = 0
    """Length of each run of equal stamps; 0 where the lengths differ."""
    runs: tuple[Run, ...] = ()
    """Runs between steps that nobody waits for; at most `RUNS` + 1."""
    long_steps: float = 0.0
    """Share of the steps ahead that are `LONG` times the median one."""

    @property
    def span(self) -> float:
        """Time from the earliest to the latest stamp [s]."""
        return 0.0 if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) * SECOND

    @property
    def monotonic(self) -> bool:
        """True if no stamp steps back."""
        return self.backward == 0

    def findings(self, sensor: Sensor, alike: bool, alone: bool) -> list[Finding]:
        """Return findings on odd times, with a remedy where there is one.

        Parameters
        ----------
        alike : sweeps with the stamp of the one before are that one
        alone : no sweeps of other frames are between these
        """
        found = [each for each in (self._odd_steps(sensor, alike, alone),) if each is not None]
        if self.recorded:
            every = self.recorded == self.sweeps
            some = "no sweep" if every else f"{self.recorded:,} of {self.sweeps:,} sweeps"
            found.append(
                sensor.finding(
                    "clock",
                    "warning",
                    f"{some} of {sensor.name} {'has a' if every else 'have no'} stamp: the times at which they were "
                    "recorded are taken for them",
                    {"zero_stamps": self.recorded, "sweeps": self.sweeps},
                    {"zero_stamps": 1},
                )
            )
        return found

    def _odd_steps(self, sensor: Sensor, alike: bool, alone: bool) -> Finding | None:
        """Return the finding on the steps of the stamps, by the first rule that holds."""
        name = sensor.name
        often = max(OFTEN * self.sweeps, SOME)
        both = "two sensors share the topic"
        repeats = {"repeated": self.repeated, "sweeps": self.sweeps}
        back = {"backward": self.backward, "largest": self.largest_backward, "sweeps": self.sweeps}
        if self.repeated > often and alike:
            option = f"--every {self.copies}" if self.copies > 1 and alone else ""
            return sensor.finding(
                "duplicate",
                "warning",
                f"{self.repeated:,} of {self.sweeps:,} sweeps of {name} have stamp and ranges of the sweep before"
                + (f": {option} takes each once" if option else ""),
                repeats,
                {"repeated": often},
                option,
            )
        if self.repeated > often:
            return sensor.finding(
                "clock",
                "error",
                f"{self.repeated:,} of {self.sweeps:,} sweeps of {name} have the stamp of the sweep before, and other "
                f"ranges: stamps are too coarse to tell speeds, or {both}",
                repeats,
                {"repeated": often},
            )
        if self.rate is not None and self.rate > FASTEST:
            return sensor.finding(
                "clock",
                "error",
                f"stamps of {name} are {1e9 / self.rate:,.0f} ns apart: probably milliseconds or microseconds that were "
                "written as nanoseconds; until they are mended in the log, all speeds are wrong",
                {"rate": self.rate},
                {"rate": FASTEST},
            )
        if self.backward > often:
            return sensor.finding(
                "clock",
                "error",
                f"stamps of {name} go back {self.backward:,} times, by at most {_long(self.largest_backward)}: messages "
                f"are out of order (sort them by their stamps), or {both}",
                back,
                {"backward": often},
            )
        if (astray := self._astray()) is not None:
            side = "ahead of" if astray > 0 else "behind"
            return sensor.finding(
                "clock",
                "warning",
                f"one stamp of {name} is {_long(abs(astray))} {side} those around it",
                {"astray": astray},
                {"astray": SET_BACK},
            )
        if self.largest_backward >= SET_BACK:
            return sensor.finding(
                "clock",
                "warning",
                f"stamps of {name} go back {self.times_back(_long(self.largest_backward))}: {self._several()}",
                back,
                {"largest": SET_BACK},
            )
        if self.largest_forward > LEAP:
            return sensor.finding(
                "clock",
                "warning",
                f"stamps of {name} leap ahead by {_long(self.largest_forward)}: {self._several()}",
                {"largest": self.largest_forward},
                {"largest": LEAP},
            )
        return None

    def times_back(self, most: str) -> str:
        """Return the number of steps back and the largest one as words."""
        return f"once, by {most}" if self.backward == 1 else f"{self.backward:,} times, by at most {most}"

    def _astray(self) -> float | None:
        """Return how far one sweep is ahead of its neighbours [s]; None unless it is the only odd one."""
        if len(self.runs) != 3 or self.runs[1].sweeps > 1:
            return None
        before, one, after = self.runs
        ahead = (one.low_ns - before.high_ns) * SECOND
        goes_on = before.high_ns <= after.low_ns <= before.high_ns + LEAP * SECOND_NS
        return ahead if goes_on else None

    def _several(self) -> str:
        """Return the cause of a leap, and the options that read only one side of it where the times allow it."""
        why = "the clock was set, or the log holds several runs"
        if len(self.runs) != 2:
            return why
        early, late = sorted(self.runs, key=lambda run: run.low_ns)
        cut = late.low_ns - late.low_ns % SECOND_NS
        if cut <= early.high_ns:
            return why
        first, second = ("--end", "--start") if self.runs[0] is early else ("--start", "--end")
        return f"{why}; {first} {Instant(cut)} takes what was before, {second} {Instant(cut)} what came after"


@dataclass(frozen=True, slots=True)
class Run:
    """Sweeps that follow each other without a leap of their stamps."""

    low_ns: int
    """The earliest stamp."""
    high_ns: int
    """The latest."""
    sweeps: int


def _long(seconds: float) -> str:
    """Return a time as text in a suitable unit.

    >>> _long(0.25), _long(3600.0), _long(31_536_000.0), _long(9000.0)
    ('0.25 s', '60 min', '365 days', '2.5 h')
    """
    for unit, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds > 2 * unit:
            return f"{f'{seconds / unit:,.1f}'.removesuffix('.0')} {name}"
    return f"{f'{seconds:.3f}'.rstrip('0').removesuffix('.')} s"


class Sample:
    """A sample of values for a median: all of them, or every 2nd, 4th, ... of many."""

    def __init__(self, kept: int = _KEPT) -> None:
        self._kept = kept
        self._stride = 1
        self._skip = 0
        self._parts: list[NDArray[Any]] = []
        self._count = 0

    def add(self, values: Int64 | Float64) -> None:
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
        """Return the median of the sample; None when it is empty."""
        return float(np.median(np.concatenate(self._parts))) if self._count else None

    def share_above(self, value: float) -> float:
        """Return the share of the sample that is greater than a value; 0 when it is empty."""
        return float(np.mean(np.concatenate(self._parts) > value)) if self._count else 0.0


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
        self._copies: int | None = None
        """As `ClockInfo.copies`; None while unknown."""
        self._since = 0
        """Number of the sweep at which the current run of equal stamps begins."""
        self._runs: list[Run] = []

    @property
    def sweeps(self) -> int:
        """Number of sweeps taken so far."""
        return self._sweeps

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
        if self._last is None:
            self._since = int(number[0])
        apart = np.diff(np.concatenate([[self._number], number]))[len(stamps) - len(steps) :]
        self._number = int(number[-1])
        same = (np.abs(steps) <= SAME_NS * apart) & has_stamp[len(stamps) - len(steps) :]
        self._repeated += int(np.count_nonzero(same))
        self._count_copies(number[len(stamps) - len(steps) :][~same])
        self._part(stamps, steps)
        low, high = int(stamps.min()), int(stamps.max())
        self._start = low if self._start is None else min(self._start, low)
        self._end = high if self._end is None else max(self._end, high)
        self._last = int(stamps[-1])

    def _count_copies(self, fresh: Int64) -> None:
        """Take the numbers of sweeps whose stamp differs from the one before."""
        if not len(fresh) or self._copies == 0:
            return
        lengths = np.diff(np.concatenate([[self._since], fresh]))
        copies = int(lengths[0]) if self._copies is None else self._copies
        # `--every` counts from the first sweep of the log on.
        self._copies = copies if self._since % copies == 0 and (lengths == copies).all() else 0
        self._since = int(fresh[-1])

    def _part(self, stamps: Int64, steps: Int64) -> None:
        """Split the stamps into runs where they leap."""
        leaps = np.flatnonzero((steps <= -SET_BACK * SECOND_NS) | (steps > LEAP * SECOND_NS))
        starts = (leaps[: RUNS + 1] + len(stamps) - len(steps)).tolist()
        for first, end in zip([0, *starts], [*starts, len(stamps)], strict=True):
            if first == end or len(self._runs) > RUNS:
                continue
            part = stamps[first:end]
            run = Run(int(part.min()), int(part.max()), len(part))
            if self._runs and first not in starts:
                last = self._runs.pop()
                run = Run(
                    min(last.low_ns, run.low_ns), max(last.high_ns, run.high_ns), last.sweeps + run.sweeps
                )
            self._runs.append(run)

    def info(self) -> ClockInfo:
        """Return the state of the clocks so far."""
        step = self._steps.median()
        offset = self._offsets.median()
        copies = self._copies or 0
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
            copies=copies if self._number < self._since + copies else 0,
            runs=tuple(self._runs),
            long_steps=0.0 if step is None else self._steps.share_above(LONG * step),
        )
