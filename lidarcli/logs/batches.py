"""Batches of equal size from the blocks of a log: numbering, `--start/--end/--every`, normalising."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from datetime import UTC
from itertools import chain
from numbers import Integral
from time import monotonic
from zlib import crc32

import numpy as np

from lidarcli.display.texts import counted, stamp
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.blocks import split_rows
from lidarcli.logs.clock import MAX_TOPICS
from lidarcli.logs.log_stats import MAX_COMPARED_TOPICS, LogStats, repeated_topics
from lidarcli.logs.piles import NoReturnDetector
from lidarcli.logs.registry import TopicChoice
from lidarcli.logs.scan_checks import ScanChecks, Went
from lidarcli.options.times import Instant, Time, TimeOfDay, TimeZone, as_time, window
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Bool, Int64, RawSweeps, SweepBatch, concatenate
from lidarcli.system.records import dataclass, field, replace

MAX_EVERY = 1_000_000
LONGEST = 0
"""Run of `ReadOptions` that stands for the longest one, where the odometry restarts in each."""
LATENCY = 0.25
"""Sweeps of a pipe, once their rules for ranges are known, wait no longer for their batch [s]."""
BATCH_VALUES = 3 << 17
"""Most ranges of one batch, padding included: its arrays should stay in the caches, and more take more memory."""
SAMPLED = 16
"""One of so many sweeps identifies a recording: two with the same ranges in all of these are one."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options for reading sweeps: topics, time window, thinning, range rules."""

    topics: Collection[str] | None = None
    """Names of LaserScan topics, with or without the leading slash; none means all."""
    start: Time | None = None
    """Seconds from the first sweep of the same topic and frame, or a moment, or its text; what is before is left out."""
    end: Time | None = None
    run: int | None = None
    """Only sweeps of this run of the log are read, counted from 1, or `LONGEST`; None: of all."""
    every: int = 1
    """Only sweeps whose index is a multiple of this are read, counted per topic."""
    batch_size: int = 768
    rules: RangeRules = field(default_factory=RangeRules)
    time_zone: TimeZone = UTC
    """Time zone of times without one, and of those that people read."""

    def __post_init__(self) -> None:
        """Refuse values without a meaning (`OptionError`)."""
        if not isinstance(self.every, Integral) or not 1 <= self.every <= MAX_EVERY:
            raise OptionError(f"--every: {self.every} is no whole number from 1 to {MAX_EVERY:,}")
        for name in ("start", "end"):
            if (value := getattr(self, name)) is not None:
                try:
                    object.__setattr__(self, name, as_time(value, self.time_zone))
                except OptionError as err:
                    raise OptionError(f"--{name}: {err}") from None
        if not _in_order(self.start, self.end):
            raise OptionError(f"--start {_words(self.start, '')} is not before --end {_words(self.end, '')}")


def _in_order(start: Time | None, end: Time | None) -> bool:
    """Return False for a window that cannot hold anything; times of different kinds cannot be compared here."""
    if start is None or end is None or type(start) is not type(end):
        return True
    if isinstance(start, TimeOfDay):
        return start != end
    return start < end  # type: ignore[operator]


def refuse_run(run: int | None, runs: int) -> None:
    """Refuse a run beyond those of a log (`NoScanError`)."""
    if run and 0 < runs < run:
        raise NoScanError(f"--run {run}: the log holds {counted(runs, 'run')}")


def read_batches(
    log: Log, options: ReadOptions, report: ReadReport, choice: TopicChoice | None = None
) -> Iterator[SweepBatch]:
    """Yield the sweeps of a log as batches; parameters and errors as of `LogBatcher`."""
    with closing(LogBatcher(log, options, report, choice)) as batcher:
        yield from batcher.batches()


class LogBatcher:
    """Cuts the sweeps of a log into batches of `batch_size` sweeps per topic or of `BATCH_VALUES` ranges, in log order.

    A sweep's index counts all sweeps of its topic, also those that are left out. The last batches have what is left.

    Parameters
    ----------
    report : takes what reading meets; the doubts when this is closed
    choice : the topics, where the caller judges which of them are missing; by default all those of `options`
    went : whether sensors move, by poses

    Raises
    ------
    NoScanError
        A topic is not there: at once where the log knows its topics, in the end of a stream otherwise.
    """

    def __init__(
        self,
        log: Log,
        options: ReadOptions,
        report: ReadReport,
        choice: TopicChoice | None = None,
        went: Went | None = None,
    ) -> None:
        self._is_strict = choice is None
        if choice is None:
            choice = TopicChoice(options.topics, log.topics())
            if choice.is_listed and (error := choice.error(every=True)) is not None:
                raise error
        self._log = log
        self._choice = choice
        self._options = options
        self._report = report
        self._detector = NoReturnDetector(options.rules, report)
        self.checks = ScanChecks([topic.name for topic in log.topics() or () if topic.sliced], went)
        self._batchers: dict[str, _TopicBatcher] = {}
        self._window: tuple[float | Instant | None, float | Instant | None] | None = None
        """Start and end, once the first sweep is there, which names the day."""
        self._copies: dict[tuple[str, str], LogStats] = {}
        self._compares = choice.is_listed and len(choice.chosen) > 1
        self._passed_on = monotonic()
        self._beyond: Counter[str] = Counter()

    def batches(self) -> Iterator[SweepBatch]:
        """Return the batches of the whole log."""
        blocks = self._log.scans(self._choice.asked, self._report)
        # Not a loop: nothing of this file stands between the log and who pulls.
        return chain(chain.from_iterable(map(self.take, blocks)), self.flush())

    def take(self, block: RawSweeps) -> Iterator[SweepBatch]:
        """Take sweeps; yield the batches that they complete."""
        if not self._choice.takes(block.topic):
            return
        if block.topic not in self._batchers and len(self._batchers) == MAX_TOPICS:
            self._beyond[block.topic] += len(block)
            return
        if self._window is None and len(block):
            self._window = window(self._options.start, self._options.end, int(block.time_ns[0]))
        batcher = self._batchers.setdefault(block.topic, _TopicBatcher(self._options, self.checks))
        batcher.window = self._window or (None, None)
        for sweeps, rules in self._detector.take(block):
            yield from self._judged(sweeps, rules)
        if self._log.size is None and monotonic() - self._passed_on > LATENCY:
            for topic in self._batchers.values():
                yield from topic.batches(final=True)
            self._passed_on = monotonic()

    def flush(self) -> Iterator[SweepBatch]:
        """Yield the batches that are left."""
        for sweeps, rules in self._detector.flush():
            yield from self._judged(sweeps, rules)
        refuse_run(self._options.run, max((topic.run for topic in self._batchers.values()), default=0))
        for name, topic in self._batchers.items():
            yield from topic.batches(final=True)
            if (note := topic.empty_window(name)) is not None:
                self._report.notes.append(note)
        if beyond := self._beyond:
            self._report.add_damage(
                "topics",
                f"{beyond.total():,} sweeps of {len(beyond):,} LaserScan topics are not read: the log has more than "
                f"{MAX_TOPICS:,}; name some of them with --topic",
            )
        known = self._report.damage or self._report.refused
        if self._is_strict and not known and (error := self._choice.error()) is not None:
            raise error

    def recording(self) -> dict[str, str]:
        """Return by topic what is the same for one recording, whatever is read of it: number and checksum of its sweeps."""
        return {name: str(topic.met) for name, topic in sorted(self._batchers.items())}

    def _judged(self, sweeps: RawSweeps, rules: RangeRules) -> Iterator[SweepBatch]:
        key = sweeps.topic, ""
        if self._compares and (key in self._copies or len(self._copies) < MAX_COMPARED_TOPICS):
            self._copies.setdefault(key, LogStats()).add_hashes(sweeps)
        yield from self._batchers[sweeps.topic].take(sweeps, rules)

    def close(self) -> None:
        """Report what looks wrong in the sweeps so far, also where no more of them are wanted."""
        self.checks.report_to(self._report)
        self.report_repeats()

    def report_repeats(self) -> None:
        """Report topics whose sweeps are those of another one."""
        for found in repeated_topics(self._copies):
            fix = "" if found.fix is None else f"; {found.fix.text} reads them once"
            self._report.add_doubts(found.topic, [replace(found, message=found.message + fix)])


def _words(time: Time | None, unit: str = " s") -> str:
    return f"{time:g}{unit}" if isinstance(time, int | float) else str(time)


class Checksum:
    """Number and checksum of the sweeps of a topic, before any is left out."""

    def __init__(self) -> None:
        self.count = self._sum = 0

    def add(self, block: RawSweeps) -> None:
        """Take the next sweeps."""
        for row in range(-self.count % SAMPLED, len(block), SAMPLED):
            self._sum = crc32(block.ranges[row, : block.beams[row]].tobytes(), self._sum)
            self._sum = crc32(block.stamp_ns[row : row + 1].tobytes(), self._sum)
        self.count += len(block)

    def __str__(self) -> str:
        return f"{self.count} {self._sum:08x}"


class _TopicBatcher:
    """Sweeps of one topic that wait for their batch."""

    window: tuple[float | Instant | None, float | Instant | None]
    """Start and end."""

    def __init__(self, options: ReadOptions, doubts: ScanChecks) -> None:
        self._options = options
        self._rules = options.rules
        self.run = 1
        """Run of the last sweeps."""
        self._doubts = doubts
        self.met = Checksum()
        self._begin_ns: int | None = None
        """Stamp of the topic's first sweep, also of one that is left out."""
        self._first_ns: dict[str, int] = {}
        self._span = np.zeros((0, 2), np.int64)
        """Earliest and latest time, by date and since the first sweep of the frame [ns]."""
        self._taken = 0
        self._blocks: list[RawSweeps] = []
        self._sweeps: list[Int64] = []

    def take(self, block: RawSweeps, rules: RangeRules) -> Iterator[SweepBatch]:
        """Number and filter a block; yield the batches that it completes, and those to which other rules apply."""
        if (rules, block.run) != (self._rules, self.run):
            yield from self.batches(final=True)
            self._rules, self.run = rules, block.run
        if self._begin_ns is None and len(block):
            self._begin_ns = int(block.rows(slice(0, 1)).time_ns[0])
        sweep = np.arange(self.met.count, self.met.count + len(block), dtype=np.int64)
        self.met.add(block)
        keep = self._kept(block, sweep)
        if not keep.all():
            block, sweep = block.rows(keep), sweep[keep]
        self._taken += len(block)
        if len(block):
            self._blocks.append(block)
            self._sweeps.append(sweep)
            yield from self.batches()

    def _kept(self, block: RawSweeps, sweep: Int64) -> Bool:
        if self._options.run not in (None, LONGEST, block.run):
            return np.zeros(len(sweep), np.bool_)
        keep: Bool = sweep % self._options.every == 0
        start, end = self.window
        if start is None and end is None:
            return keep
        time_ns = block.time_ns
        first = np.zeros(len(block.frame_ids), np.int64)
        codes, rows = np.unique(block.frame, return_index=True)
        for code, row in zip(codes.tolist(), rows.tolist(), strict=True):
            first[code] = self._first_ns.setdefault(block.frame_ids[code], int(time_ns[row]))
        since_ns = time_ns - first[block.frame]
        span = np.concatenate([self._span, np.column_stack([time_ns, since_ns])])
        self._span = np.stack([span.min(axis=0), span.max(axis=0)])
        for time, is_start in ((start, True), (end, False)):
            if time is not None:
                late = time_ns >= time.ns if isinstance(time, Instant) else since_ns / 1e9 >= time
                keep &= late if is_start else ~late
        return keep

    def empty_window(self, topic: str) -> str | None:
        """Return a note if no sweep lies between the wanted start and end although the topic has sweeps.

        So does a time of day beyond the last sweep: nobody knows whether one before the first was meant.
        """
        start, end = self._options.start, self._options.end
        if (start is None and end is None) or not len(self._span):
            return None
        last = self.window[1]
        if self._taken and not (isinstance(end, TimeOfDay) and isinstance(last, Instant) and last.ns > self._span[1, 0]):
            return None
        window = [*([f"from {_words(start)} on"] if start is not None else [])]
        window += [f"before {_words(end)}"] if end is not None else []
        if isinstance(start or end, Instant | TimeOfDay):
            there = " and ".join(stamp(time, self._options.time_zone) for time in self._span[:, 0].tolist())
        else:
            there = "{:.1f} and {:.1f} s, counted from the first one".format(*self._span[:, 1] / 1e9)
        if self._taken:
            return f"{topic} has no sweep at {_words(end)} or later: its sweeps lie between {there}"
        return f"no sweep of {topic} {' and '.join(window)}: its sweeps lie between {there}"

    def batches(self, final: bool = False) -> Iterator[SweepBatch]:
        """Yield the full batches of the waiting sweeps; finally, all of them."""
        if not self._blocks:
            return
        size = self._options.batch_size
        beams = np.concatenate([block.beams for block in self._blocks])
        parts = list(split_rows(beams, size, BATCH_VALUES))
        # The last run may grow with the next block, unless it is full already.
        if not final and parts[-1].stop - parts[-1].start < size:
            parts.pop()
        for part in parts:
            block, sweep = self._cut(part.stop - part.start)
            batch = normalise(block, sweep, self._rules, self._begin_ns)
            yield replace(batch, observed=batch.observed & ~self._doubts.add(block, batch))

    def _cut(self, rows: int) -> tuple[RawSweeps, Int64]:
        """Remove and return the first `rows` waiting sweeps, as wide as the widest of them."""
        blocks: list[RawSweeps] = []
        sweeps: list[Int64] = []
        while rows:
            block, sweep = self._blocks[0], self._sweeps[0]
            head = slice(0, min(rows, len(block)))
            width = int(block.beams[head].max())
            blocks.append(block.rows(head).narrowed(width))
            sweeps.append(sweep[head])
            rows -= head.stop
            if head.stop == len(block):
                del self._blocks[0], self._sweeps[0]
            else:
                self._blocks[0], self._sweeps[0] = block.rows(slice(head.stop, None)), sweep[head.stop :]
        return concatenate(blocks), np.concatenate(sweeps)
