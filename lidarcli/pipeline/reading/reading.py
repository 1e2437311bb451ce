"""Reading the sweeps of one log for whatever is done with them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.choice import TopicChoice, nothing_read
from lidarcli.pipeline.inputs.sliced import made_of_clouds
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.reading.delays import first_delays
from lidarcli.pipeline.reading.pose_options import PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.pipeline.reading.summary import RunSummary, damage_lines
from lidarcli.sweeps import Int64, SweepBatch
from lidarcli.threads import Beside
from lidarcli.times import Instant

if TYPE_CHECKING:
    from lidarcli.poses.motion import Motion

AHEAD = 2
"""Batches that are read before they are asked for."""
WORTH_A_THREAD = 4 << 20
"""Bytes of a file whose reading outweighs a thread for it."""

GEOMETRY = ("angle_min", "angle_increment", "fov", "range_max", "range_scale")
"""What of `OpenOptions` a log of text may lack."""
_AS_IT_IS = OpenOptions()

Progress = Callable[[int], None]
"""Called with the position in the source [bytes]."""


def reading_as_dict(read: ReadOptions, opening: OpenOptions, poses: PoseOptions) -> dict[str, Any]:
    """What of a log is read and how, as plain values, for the tables' metadata."""
    rules = read.rules
    told = {name: value for name in GEOMETRY if (value := getattr(opening, name)) != getattr(_AS_IT_IS, name)}
    part = opening.slice
    return {
        "topics": sorted(read.topics) if read.topics else None,
        "start": _plain(read.start),
        "end": _plain(read.end),
        "every": read.every,
        "range": list(rules.limits) if rules.limits else None,
        "no_return": [*sorted(rules.no_return), *sorted(rules.markers)],
        **({"csv": told} if told else {}),
        **({} if part is None else {"slice": [part.low, part.high], "bins": part.bins}),
        **({"echo": opening.echo} if opening.echo != _AS_IT_IS.echo else {}),
        **poses.as_dict(),
    }


def _plain(time: float | Instant | None) -> float | str | None:
    return str(time) if isinstance(time, Instant) else time


def describe_source(source: Source, log: Log) -> dict[str, Any]:
    """What the tables' metadata says of the source: nothing that depends on where it lay."""
    name = source.name if source.is_stdin or source.is_pattern else source.file_name
    return {"name": name, "size": log.size, "format": log.format}


class Reading:
    """The sweeps of one log with their poses, counted: opens topics, remembers damage, judges what is missing.

    Poses without a `delay` are those at the header stamps; where it is said what for (`delays.TRACKS`), batches then also
    have `true_poses` if others fit better.
    A file is read ahead by a thread of its own, which has gone when this context is left; until then the log is its alone.
    """

    def __init__(self, log: Log, options: ReadOptions, poses: PoseOptions, purpose: str = "") -> None:
        self._log = log
        self._report = ReadReport()
        self.summary = RunSummary()
        """What has been counted so far."""
        self._read = options
        topics = log.topics()
        self._choice = choice = TopicChoice(options.topics, topics)
        self.first = choice.first
        """The topic that comes first in the tables, where that is known before reading."""
        self.date: str | None = None
        """Day of the first sweep that was read (UTC, YYYY-MM-DD); None before it."""
        self._expected: int | None = None
        self._started = time.perf_counter()
        if topics is not None:
            if (error := choice.error()) is not None:
                raise nothing_read(self._damage(), error, choice.wanted)
            self.summary.missing_topics = choice.missing
            chosen = set(choice.chosen)
            counts = [topic.messages for topic in topics if topic.name in chosen]
            known = [count for count in counts if count is not None]
            if len(known) == len(counts):
                self._expected = sum(known) // options.every
        self._posing = Posing.of(log, poses, options.topics, options.rules)
        # A pipe is read only once.
        wanted = purpose and poses.delay is None and poses.source != MATCH and log.size is not None
        if wanted and self._posing.found is not None:
            self._posing.purpose = purpose
            self._posing.delays = first_delays(
                log, self._posing.found.sources, choice, options.rules, poses.deskew
            )
        self._position = 0
        self._thread: Beside | None = None

    def batches(self, progress: Progress | None) -> Iterator[SweepBatch]:
        """Every batch with its poses."""
        for batch, position in self._read_ahead():
            self._position = position
            if self.date is None and len(batch):
                self.date = str(np.datetime64(int(batch.stamp_ns[0]), "ns").astype("datetime64[D]"))
            self.summary.add_sweeps(batch)
            yield batch
            if progress is not None:
                progress(position)

    def motions(self, batch: SweepBatch) -> Iterator[tuple[str, Int64, Motion, str]]:
        """As `Posing.motions`: the poses of a batch in space."""
        return self._posing.motions(batch)

    def _read_ahead(self) -> Iterator[tuple[SweepBatch, int]]:
        """Every batch and where in the source its reading stood [bytes]."""
        batches = self._read_now()
        # What a pipe has to offer is wanted at once, and reading one cannot be broken off.
        if self._log.size is None or self._log.size < WORTH_A_THREAD:
            yield from batches
            return
        try:
            self._thread = Beside("read")
        except RuntimeError:
            # The system has no thread to give; it goes without.
            yield from batches
            return
        waiting = deque(self._thread.submit(next, batches, None) for _ in range(AHEAD))
        while (batch := waiting.popleft().result()) is not None:
            waiting.append(self._thread.submit(next, batches, None))
            yield batch

    def _read_now(self) -> Iterator[tuple[SweepBatch, int]]:
        for batch in read_batches(self._log, self._read, self._report, self._choice):
            yield self._posing.attach(batch), self._log.position

    def leave_out(self, topics: Collection[str]) -> None:
        """As `Posing.leave_out`."""
        self._posing.leave_out(topics)

    def ahead(self) -> int | None:
        """Sweeps still to come, as far as the index or else the file's size tells; None where nothing does."""
        done, position, size = self.summary.sweeps, self._position, self._log.size
        if self._expected is not None:
            return max(0, self._expected - done)
        return done * max(0, size - position) // position if size is not None and position else None

    def close(self) -> RunSummary:
        """The counts, or the error of a log that turned out to have no LaserScan."""
        summary = self.summary
        summary.close(self._report, self._posing)
        summary.seconds = time.perf_counter() - self._started
        if not self._choice.is_listed:
            self._judge_topics()
        return summary

    def describe(self, source: Source) -> dict[str, Any]:
        """What the tables' metadata says of the source, its poses, and from where on [m] a pile of ranges is no return."""
        told = {
            "poses": self._posing.described(),
            "made_of_clouds": made_of_clouds(self._log),
            "no_return_from": dict(sorted(self._report.no_return.items())),
        }
        told = {name: what for name, what in told.items() if what}
        return describe_source(source, self._log) | told

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._thread is not None:
            self._thread.close()

    def _damage(self) -> list[str]:
        """The damage of a log that lists nothing to read: reading meets it on its way past all that is not wanted."""
        for _ in self._log.scans(frozenset(self._choice.wanted) or None, self._report):
            pass
        return damage_lines(self._report)

    def _judge_topics(self) -> None:
        """A log without an index shows its topics only in the end, those of refused messages too."""
        for topic, _ in self._report.refused:
            self._choice.takes(topic)
        if (error := self._choice.error()) is not None:
            raise nothing_read(self.summary.damage, error, self._choice.wanted)
        self.summary.missing_topics = self._choice.missing
