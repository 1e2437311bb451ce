"""Statistics of header and record times of a log, in bounded memory, and times in place of those that are none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import moment
from lidarcli.options.times import SECOND_NS, Instant
from lidarcli.sweeps.finding_rules import LEAP, LONG, SET_BACK
from lidarcli.sweeps.types import Bool, Float64, Int64, RawSweeps
from lidarcli.system.records import dataclass, replace

SECOND = 1e-9
_KEPT = 1 << 16
TOLD = 3
"""Most runs that are reported one by one, in addition to the last."""
NO_STAMPS = "stamps are 0, tracks cannot tell what moves"
SAME_NS = 1
"""Equal stamps of text differ by at most this [ns]."""
AROUND = 8
"""Number of sweeps around a stamp with which it is compared."""
HELD = 1024
"""Most sweeps of a topic that wait for sound stamps; fewer of many beams."""
MAX_TOPICS = 1000
"""Topics beyond this are taken as they are: a log may have a new one in every message."""


@dataclass(frozen=True, slots=True)
class ClockInfo:
    """Statistics of the times of sweeps. Seconds and hertz, stamps in nanoseconds; None where unknown."""

    start_ns: int | None
    """Earliest header stamp (record time where the headers have none)."""
    end_ns: int | None
    rate: float | None
    """Sweeps per second, from the median step of the stamps."""
    backward: int
    largest_backward: float
    zero_stamps: int
    offset: float | None
    """Median of record time - header stamp."""
    sweeps: int = 0
    recorded: int = 0
    """Sweeps without a stamp that were recorded at a time which is known."""
    repeated: int = 0
    """Sweeps with the stamp of the one before them."""
    largest_forward: float = 0.0
    copies: int = 0
    """Length of each run of equal stamps; 0 where the lengths differ."""
    leaps: tuple[int, ...] = ()
    """Stamps after the first two leaps ahead."""
    astray: tuple[float, ...] = ()
    """Lead of stamps over those around them, if other times are taken in their place [s]."""
    long_steps: float = 0.0
    """Share of the steps ahead that are `LONG` times the median one."""
    starts: tuple[tuple[int, int, int], ...] = ()
    """Runs of the log, the first `TOLD` and the last: number, and number and stamp of the first sweep."""

    @property
    def span(self) -> float:
        """Time from the earliest to the latest stamp [s]."""
        return 0.0 if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) * SECOND

    @property
    def monotonic(self) -> bool:
        """True if no stamp steps back."""
        return self.backward == 0

    def times_back(self, most: str) -> str:
        """Return the number of steps back and the largest one as words."""
        return f"once, by {most}" if self.backward == 1 else f"{self.backward:,} times, by at most {most}"

    @property
    def runs_shown(self) -> str:
        """The runs of the log, in words."""
        return ", ".join(f"run {run:,} from sweep {sweep:,} ({moment(stamp_ns)})" for run, sweep, stamp_ns in self.starts)

    @property
    def leap_remedy(self) -> str:
        """The cause of a leap, and the options that read only one side of it where the times allow it."""
        why = "the clock was set, or the log holds several runs"
        if len(self.leaps) != 1 or self.backward:
            return why
        cut = Instant(self.leaps[0] - self.leaps[0] % SECOND_NS)
        return f"{why}; --end {cut} takes what was before, --start {cut} what came after"


def in_words(seconds: float) -> str:
    """Return a time as text in a suitable unit.

    >>> in_words(0.25), in_words(3600.0), in_words(31_536_000.0), in_words(9000.0)
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


class StampMender:
    """Gives the sweeps of a log, in its order within each topic, times that fit where a stamp is none.

    A header may have no stamp, or one of another clock: of the time before a simulation began, or the clock was set.
    """

    def __init__(self) -> None:
        self._topics: dict[str, _Mending] = {}

    def take(self, block: RawSweeps) -> Iterator[RawSweeps]:
        """Take sweeps; yield those that are known to be sound or mended."""
        if block.topic in self._topics or len(self._topics) < MAX_TOPICS:
            yield from self._topics.setdefault(block.topic, _Mending()).take(block)
        else:
            yield block

    def flush(self) -> Iterator[RawSweeps]:
        """Yield the sweeps that are left."""
        for topic in self._topics.values():
            yield from topic.settle()


def mended(blocks: Iterable[RawSweeps]) -> Iterator[RawSweeps]:
    """Yield the sweeps of a log, mended as by `StampMender`."""
    mender = StampMender()
    for block in blocks:
        yield from mender.take(block)
    yield from mender.flush()


def restarts(times: Int64) -> list[int]:
    """Return the rows (N,) of restarts: all but one of `AROUND` times on each side are `SET_BACK` from the other side.

    >>> restarts(np.concatenate([np.arange(20), np.arange(20)]) * SECOND_NS)
    [20]
    """
    back = -round(SET_BACK * SECOND_NS)
    rows = np.flatnonzero(np.diff(times) <= back) + 1
    # `HELD` rows are looked at; more than two steps back around one are disorder.
    rows = rows[(rows >= AROUND) & (rows <= len(times) - AROUND)][:HELD]
    around = times[rows[:, None] + np.arange(-AROUND, AROUND)]
    before, after = np.sort(around.reshape(-1, 2, AROUND), axis=2).swapaxes(0, 1)
    apart = after[:, -2] - before[:, 1] <= back
    found: list[int] = []
    for row in rows[apart & (np.count_nonzero(np.diff(around) <= back, axis=1) <= 2)].tolist():
        if not found or row >= found[-1] + AROUND:
            found.append(row)
    return found


class _Mending:
    """Sweeps of one topic, of which those around a stamp that is no time, or of another run, wait for more."""

    def __init__(self) -> None:
        self._waiting: list[RawSweeps] = []
        self._restarts: Counter[int] = Counter()
        """Frame → times that its clock was restarted."""
        self._frames: dict[str, int] = {}
        self._sound = np.zeros((3, 0), np.int64)
        """Time, record time and frame of the last sound sweeps of each frame."""

    def take(self, block: RawSweeps) -> Iterator[RawSweeps]:
        """Add a block; yield what is known to be sound or mended."""
        self._waiting.append(block)
        times, records, codes = self._rows()
        odd = (np.abs(np.diff(times, prepend=times[:1]) * SECOND) > LEAP) | ((times == 0) & (records != 0))
        order = np.argsort(codes, kind="stable")
        odd[order[1:]] |= (np.diff(times[order]) * SECOND <= -SET_BACK) & (np.diff(codes[order]) == 0)
        enough = AROUND * len(self._frames)
        sure = np.count_nonzero(~odd) >= enough and not odd[-enough:].any()
        size = sum(len(each) * (HELD + each.ranges.shape[1]) for each in self._waiting)
        if sure or not odd.any() or size > HELD**2:
            yield from self.settle(bool(odd.any()))

    def settle(self, mends: bool = True) -> Iterator[RawSweeps]:
        """Yield the waiting sweeps, mended."""
        rows, place = self._rows(), self._sound.shape[1]
        odd = np.zeros(rows.shape[1], np.bool_)
        run = np.full(len(odd), max(self._restarts.values(), default=0) + 1)
        new = np.bincount(rows[2, place:], minlength=len(self._frames)) > 0
        # A log may have a frame in every sweep: those without new ones wait as they are.
        kept = [np.flatnonzero(~new[rows[2, :place]])]
        for code in np.flatnonzero(new).tolist():
            of_frame = np.flatnonzero(rows[2] == code)
            times, records, _ = rows[:, of_frame]
            bad = (times == 0) & (records != 0) if mends else odd[of_frame]
            if mends:
                bad[~bad] = _astray(times[~bad])
                bad &= of_frame >= place
            if not bad.all():
                rows[0, of_frame] = _fitting(times, records, bad)
                odd[of_frame] = bad
                begin = 0
                for begin in restarts(rows[0, of_frame]) if mends else ():
                    self._restarts[code] += 1
                    run[of_frame[begin] :] = np.maximum(run[of_frame[begin] :], self._restarts[code] + 1)
                kept.append(of_frame[begin:][~bad[begin:]][-AROUND:])
        for block in self._waiting:
            rows_of_block = slice(place, place := place + len(block))
            sweeps = replace(block, mended_ns=rows[0, rows_of_block]) if odd[rows_of_block].any() else block
            for number in dict.fromkeys(run[rows_of_block].tolist()):
                in_run = run[rows_of_block] == number
                yield replace(sweeps if in_run.all() else sweeps.rows(in_run), run=number)
        self._sound, self._waiting = rows[:, np.sort(np.concatenate(kept))], []

    def _rows(self) -> Int64:
        """Return stamps, record times and frames (3, S) of the last sound sweeps and those that wait."""
        parts = [self._sound]
        for block in self._waiting:
            for name in block.frame_ids if len(self._frames) < 64 else ():
                self._frames.setdefault(name, len(self._frames))
            codes = np.array([self._frames.get(name, 0) for name in block.frame_ids], np.int64)
            parts.append(np.stack([block.stamp_ns, block.record_ns, codes[block.frame]]))
        return np.concatenate(parts, axis=1)


def _fitting(times: Int64, records: Int64, odd: Bool) -> Int64:
    """Return times (S,) with others that fit in place of the `odd` ones."""
    times, good = times.copy(), np.flatnonzero(~odd)
    for row in np.flatnonzero(odd).tolist():
        at = int(np.searchsorted(good, row))
        near = good[max(at - AROUND, 0) : max(at, AROUND)]
        if records[row] not in (0, times[row]):
            times[row] = records[row] - _middle(records[near] - times[near])
        elif len(near) > 1:
            nearest = good[max(at - 1, 0)]
            times[row] = times[nearest] + _middle(np.diff(times[near])) * (row - nearest)
    return times


def _astray(times: Int64) -> Bool:
    """Return True (S,) for few times that are far from those around them, which are near each other."""
    width = min(AROUND + 1, len(times))
    if width < 3:
        return np.zeros(len(times), np.bool_)
    first = np.clip(np.arange(len(times)) - AROUND // 2, 0, len(times) - width)
    around = times[first[:, None] + np.arange(width)] * SECOND
    alike = np.abs(around - times[:, None] * SECOND) <= LEAP
    usual = np.abs(around - np.sort(around, axis=1)[:, width // 2, None]) <= LEAP
    few: Bool = (3 * np.count_nonzero(alike, axis=1) <= width) & (2 * np.count_nonzero(usual, axis=1) > width)
    return few


def _middle(values: Int64) -> np.int64:
    """Return the median, exactly."""
    middle: np.int64 = np.sort(values)[len(values) // 2]
    return middle


class Clock:
    """Folds blocks of sweeps of one topic and frame, in log order, into `ClockInfo`."""

    def __init__(self) -> None:
        self.sweeps = 0
        """Sweeps taken so far."""
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
        self._since = 0
        """Number of the sweep at which the current run of equal stamps begins."""
        self._leaps: list[int] = []
        self._astray: list[float] = []
        self._starts: list[tuple[int, int, int]] = []

    def add(self, block: RawSweeps, sweep: Int64 | None = None) -> None:
        """Take the times of a block; `sweep` (S,) numbers its sweeps in the log, where some are left out."""
        if not len(block):
            return
        self.sweeps += len(block)
        has_stamp = block.stamp_ns != 0
        self._zero += int(np.count_nonzero(~has_stamp))
        self._recorded += int(np.count_nonzero(~has_stamp & (block.record_ns != 0)))
        stamps = block.time_ns
        if block.mended_ns is not None and len(self._astray) < _KEPT:
            odd = (stamps != block.stamp_ns) & (has_stamp | (block.record_ns == 0))
            self._astray += ((block.stamp_ns[odd] - stamps[odd].astype(np.float64)) * SECOND).tolist()
            has_stamp &= ~odd
        self._offsets.add((block.record_ns - block.stamp_ns)[has_stamp])
        before = stamps[:1] if self._last is None else np.array([self._last])
        steps = np.diff(np.concatenate([before, stamps]))[self._last is None :]
        self._steps.add(steps[steps > 0])
        self._backward += int(np.count_nonzero(steps < 0))
        self._largest = max(self._largest, -int(steps.min(initial=0)))
        self._forward = max(self._forward, int(steps.max(initial=0)))
        number = np.arange(self._number + 1, self._number + 1 + len(block)) if sweep is None else sweep
        if self._last is None:
            self._since = int(number[0])
        if not self._starts or block.run != self._starts[-1][0]:
            self._starts[TOLD:] = [(block.run, int(number[0]), int(stamps[0]))]
        apart = np.diff(np.concatenate([[self._number], number]))[len(stamps) - len(steps) :]
        self._number = int(number[-1])
        same = (np.abs(steps) <= SAME_NS * apart) & has_stamp[len(stamps) - len(steps) :]
        self._repeated += int(np.count_nonzero(same))
        self._count_copies(number[len(stamps) - len(steps) :][~same])
        self._leaps = [*self._leaps, *stamps[len(stamps) - len(steps) :][steps > LEAP * SECOND_NS].tolist()][:2]
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
            sweeps=self.sweeps,
            recorded=self._recorded,
            repeated=self._repeated,
            largest_forward=self._forward * SECOND,
            copies=copies if self._number < self._since + copies else 0,
            leaps=tuple(self._leaps),
            astray=tuple(self._astray),
            long_steps=0.0 if step is None else self._steps.share_above(LONG * step),
            starts=tuple(self._starts),
        )
