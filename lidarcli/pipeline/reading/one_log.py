"""Reading one log: its sweeps with their poses, the counts of the run, and the metadata of tables on it."""

from __future__ import annotations

import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC
from functools import partial
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

import numpy as np

from lidarcli.display.texts import Routine, Unused
from lidarcli.errors import NoScanError, OptionError, UnreadableError
from lidarcli.formalism.detection import SETS, Detection
from lidarcli.logs.base import MAX_BEAMS, Log, OpenOptions, ReadReport, Slice
from lidarcli.logs.batches import LONGEST, LogBatcher, ReadOptions
from lidarcli.logs.registry import TopicChoice, nothing_read
from lidarcli.options.choices import ECHOES, KEEP, NO_RETURN_WORDS
from lidarcli.options.times import Time, TimeZone
from lidarcli.pipeline.inputs.masks import AUTO, masks_of, plain
from lidarcli.pipeline.inputs.sources import Source, made_of_clouds, open_source, parts_of
from lidarcli.pipeline.reading.masking import MaskRules, masking_of
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.range_rules import RangeRules, count_statuses
from lidarcli.sweeps.types import STATUSES, SweepBatch
from lidarcli.system.machine import Threads
from lidarcli.system.records import dataclass, field, replace

if TYPE_CHECKING:
    from lidarcli.formalism.tracking.results import TrackedBatch


@dataclass(slots=True)
class RunSummary:
    """Counts and notes of one run over one log."""

    sweeps: int = 0
    objects: int = 0
    agents: int = 0
    things: int | None = None
    """Number of tracks; None where nothing was followed."""
    moved: int = 0
    """Tracks of agents."""
    people: int = 0
    """People that they are counted as."""
    followed: list[tuple[Any, ...]] = field(default_factory=list)
    """The agents: topic and `tracking.OF_AGENTS`."""
    first_ns: int | None = None
    time_zone: TimeZone = UTC
    """Time zone of what people read."""
    by_status: Counter[str] = field(default_factory=Counter)
    """`valid`, `no_return`, `too_close`, `invalid`, `masked` → beams."""
    by_set: Counter[str] = field(default_factory=lambda: Counter(dict.fromkeys(SETS, 0)))
    """`O`, `A`, `S` (Def. 4) → beams."""
    topics: set[str] = field(default_factory=set)
    missing_topics: tuple[str, ...] = ()
    """Topics that were requested and are not there, while others are."""
    dropped: list[tuple[str, str, int]] = field(default_factory=list)
    """(topic, cause, messages) that could not be a sweep."""
    damage: list[str] = field(default_factory=list)
    """One line per loss, the dropped messages included."""
    notes: list[str] = field(default_factory=list)
    """Notes for the user, the doubts included; those that are a `display.Routine` are for `--verbose`."""
    doubts: list[str] = field(default_factory=list)
    """Notes on the rules for ranges, and on sweeps that look wrong."""
    repeated: tuple[str, ...] = ()
    """Topics whose sweeps are those of others: what is said of them is routine."""
    outputs: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def beams(self) -> int:
        """Beams of all sweeps."""
        return self.by_status.total()

    @property
    def warnings(self) -> list[str]:
        """What the Python functions warn of: the damage, and options that change nothing."""
        return [*self.damage, *(note for note in self.notes if isinstance(note, Unused))]

    @property
    def exit_code(self) -> int:
        """3 where some of the log could not be read, 4 where a topic was not there, else 0."""
        if self.damage:
            return UnreadableError.exit_code
        return NoScanError.exit_code if self.missing_topics else 0

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values; of objects only where they were looked for (docs/ci.md)."""
        found: dict[str, Any] = {"objects": self.objects + self.agents, "on_agents": self.agents}
        found |= {"tracks": self.things, "moving": self.moved, "people": self.people, "sets": dict(self.by_set)}
        return {
            "sweeps": self.sweeps,
            "topics": sorted(self.topics),
            "missing_topics": [*self.missing_topics],
            "beams": dict(self.by_status),
            **(found if self.by_set.total() == self.beams else {}),
            "damage": self.damage,
            "notes": self.notes,
            "routine": [note for note in self.notes if isinstance(note, Routine)],
            "written": self.outputs,
        }

    def add_sweeps(self, batch: SweepBatch) -> None:
        """Count the sweeps of one batch."""
        self.sweeps += len(batch)
        self.topics.add(batch.topic)
        self.first_ns = batch.first_ns if self.first_ns is None else min(self.first_ns, batch.first_ns)
        for status, count in zip(STATUSES, count_statuses(batch.status).sum(axis=1).tolist(), strict=False):
            self.by_status[status] += count

    def add_sets(self, found: Detection | TrackedBatch) -> None:
        """Count the objects and agents of one batch, and the beams of each set."""
        self.objects += int(found.objects.sum())
        self.agents += int(found.agents.sum())
        for letter, beams in zip("OAS", (found.object_beams, found.agent_beams, found.noise_beams), strict=True):
            self.by_set[letter] += int(beams.sum())

    def add_things(self, things: int, moved: int, people: int) -> None:
        """Count the tracks of one topic."""
        self.things = (self.things or 0) + things
        self.moved += moved
        self.people += people

    def add_found(self, other: RunSummary) -> None:
        """Add the counts of objects and tracks of another summary."""
        self.objects += other.objects
        self.agents += other.agents
        self.by_set.update(other.by_set)
        if other.things is not None:
            self.add_things(other.things, other.moved, other.people)

    def close(self, report: ReadReport, posing: PoseAttacher) -> None:
        """Take over the damage and the notes of reading sweeps and poses."""
        report = posing.together(report)
        self.dropped = [(topic, cause, count) for (topic, cause), count in sorted(report.refused.items())]
        self.damage = damage_lines(report)
        self.repeated = tuple(one.topic for one in report.findings() if one.id == "duplicate" and "same" in one.evidence)
        self.doubts = self.graded(report.doubted())
        self.notes = [*report.notes, *self.doubts, *self.graded(posing.notes())]

    def graded(self, notes: Iterable[str]) -> list[str]:
        """Return notes, those on a topic that repeats another one as routine."""
        names = re.compile("|".join(rf"(?<!\S){re.escape(topic)}(?![^\s:,]| repeats)" for topic in self.repeated) or "(?!)")
        return [Routine(note) if names.search(note) else note for note in notes]


def damage_lines(report: ReadReport) -> list[str]:
    """Return a line per damaged part and per kind of refused message, and one for those that are not shown."""
    lines = [f"{part.place}: {part.cause}" for part in report.damage]
    if report.damage_more:
        lines.append(f"and {report.damage_more} more damaged parts")
    refused = sorted(report.refused.items())
    for (topic, cause), count in refused[: ReadReport.MAX_DAMAGE]:
        lines.append(f"topic {topic}: {count:,} message{'' if count == 1 else 's'} left out: {cause}")
    if len(refused) > ReadReport.MAX_DAMAGE:
        more = sum(count for _, count in refused[ReadReport.MAX_DAMAGE :])
        lines.append(f"and {more:,} more messages left out")
    return lines


AHEAD = 2
"""Batches that are read ahead."""
WORTH_A_THREAD = 4 << 20
"""Bytes of a file from which on a thread reads ahead."""

GEOMETRY = ("columns", "angle_min", "angle_increment", "fov", "range_max", "range_scale", "angle_scale")
"""Fields of `OpenOptions` that a log of text may lack."""
_AS_IT_IS = OpenOptions()

T = TypeVar("T")
Progress = Callable[[int], None]
"""Called with the position in the source [bytes]."""


def reading_as_dict(read: ReadOptions, opening: OpenOptions, poses: PoseOptions) -> dict[str, Any]:
    """Return the options of reading as plain values, for the tables' metadata."""
    rules = read.rules
    geometry = {name: value for name in GEOMETRY if (value := getattr(opening, name)) != getattr(_AS_IT_IS, name)}
    part = opening.slice
    return {
        "topics": sorted(read.topics) if read.topics else None,
        "start": _plain(read.start),
        "end": _plain(read.end),
        **({"run": read.run} if read.run else {}),
        "every": read.every,
        "range": list(rules.limits) if rules.limits else None,
        "no_return": [*sorted(rules.no_return), *sorted(rules.markers)],
        **({} if rules.masks is None else {"mask": AUTO if rules.masks.learn else Path(rules.masks.path).name}),
        **({"csv": geometry} if geometry else {}),
        **({} if part is None else {"slice": [part.low, part.high], "bins": part.bins}),
        **({"echo": opening.echo} if opening.echo != _AS_IT_IS.echo else {}),
        **({"segments": KEEP} if opening.segments == KEEP else {}),
        **poses.as_dict(),
    }


def _plain(time: Time | None) -> float | str | None:
    return time if time is None or isinstance(time, float) else str(time)


class Reading:
    """The sweeps of an open log with their poses, counted: opens topics, remembers damage, reports missing topics.

    A file is read ahead by a thread of its own, which has ended when this context is left; until then no other thread may
    use the log. The path of the sensors of `need` is matched where the log gives none; mask and paths are those of the
    `first` reading of the same log, where there was one.
    """

    def __init__(
        self, log: Log, options: ReadOptions, poses: PoseOptions, need: Need = Need.TOLD, first: Reading | None = None
    ) -> None:
        self._log = log
        self._report = ReadReport()
        self.summary = RunSummary(time_zone=options.time_zone)
        """Counts so far."""
        topics = log.topics()
        self._choice = choice = TopicChoice(options.topics, topics)
        self.first = choice.first
        """Topic that comes first in the tables, where that is known before reading."""
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
        masking = masking_of(log, options.rules, poses, options.topics) if first is None else first.masking
        if options.rules.masks is None:
            masking = MaskRules(options.rules)
        self.masking: MaskRules = masking
        self._report.notes += masking.notes
        options = replace(options, rules=masking.rules)
        made = PoseAttacher.of(log, poses, choice, options, need=need) if first is None else first.all_runs.anew()
        self.all_runs: PoseAttacher = made
        self.posing = made
        """Poses and paths of its sensors, of the run that is read or of all."""
        if options.run == LONGEST:
            run = made.longest
            if run is not None:
                note = f"of {len(made.runs)} runs, each in its own world, run {run} is taken: the longest (--run)"
                self._report.notes.append(note)
            self.posing = made.of_run(run)
            options = replace(options, run=run)
        self._batcher = LogBatcher(log, options, self._report, choice, self.posing.went)
        self._position = 0
        self._thread: Threads | None = None

    def batches(self, progress: Progress | None = None) -> Iterator[SweepBatch]:
        """Return every batch with its poses; `progress` takes the position [bytes] once the caller is done with a batch.

        The stages follow each other, and none of them calls the next: whoever pulls is the loop around them all.
        """
        blocks = self._log.scans(self._choice.asked, self._report)
        batches = chain(chain.from_iterable(map(self._batcher.take, blocks)), self._batcher.flush())
        placed = self._read_ahead(map(self._with_position, map(self.posing.attach, batches)))
        return chain.from_iterable(map(partial(self._counted, progress), placed))

    def _with_position(self, batch: SweepBatch) -> tuple[SweepBatch, int]:
        return batch, self._log.position

    def _counted(self, progress: Progress | None, placed: tuple[SweepBatch, int]) -> Iterator[SweepBatch]:
        """Yield a batch once it is counted, and report its position afterwards."""
        batch, self._position = placed
        if self.date is None and len(batch):
            self.date = str(np.datetime64(int(batch.stamp_ns[0]), "ns").astype("datetime64[D]"))
        self.summary.add_sweeps(batch)
        yield batch
        if progress is not None:
            progress(placed[1])

    def _read_ahead(self, batches: Iterator[tuple[SweepBatch, int]]) -> Iterator[tuple[SweepBatch, int]]:
        """Return an iterator whose items a thread of its own pulls, for a file that is worth it."""
        # Sweeps of a pipe are wanted at once, and reading one cannot be broken off.
        if self._log.size is not None and self._log.size >= WORTH_A_THREAD:
            # The system may start no more threads.
            with suppress(RuntimeError):
                self._thread = Threads("read")
        return batches if self._thread is None else pulled_by(self._thread, batches)

    @property
    def is_pipe(self) -> bool:
        """True for a stream that is read as it comes, perhaps without end."""
        return self._log.size is None

    def ahead(self) -> int | None:
        """Return the number of sweeps still to come, by the index or the file's size; None where neither is known."""
        done, position, size = self.summary.sweeps, self._position, self._log.size
        if self._expected is not None:
            return max(0, self._expected - done)
        return done * max(0, size - position) // position if size is not None and position else None

    def close(self) -> RunSummary:
        """Return the counts, or raise the error of a log that turned out to have no LaserScan."""
        summary = self.summary
        self._batcher.checks.report_to(self._report)
        self._batcher.report_repeats()
        self.posing.close()
        summary.close(self._report, self.posing)
        summary.doubts += self.masking.doubts
        summary.seconds = time.perf_counter() - self._started
        if not self._choice.is_listed:
            self._judge_topics()
        return summary

    def describe(self, source: Source) -> dict[str, Any]:
        """Return the description of the source and its sweeps, poses and ranges of no return, for the tables' metadata."""
        described = {
            "recording": self._batcher.recording(),
            "parts": [{"name": part.name, "size": part.size} for part in parts_of(self._log)],
            "poses": self.posing.described(),
            "runs": {str(number): one.described() for number, one in self.posing.runs.items() if number > 1},
            "made_of_clouds": made_of_clouds(self._log),
            "segments": sorted(self._report.segments),
            "no_return_from": dict(sorted(self._report.no_return.items())),
            "mask": plain(self.masking.rules.masks or Masks()),
        }
        known = {"name": source.file_name, "size": self._log.size, "format": self._log.format}
        return known | {name: what for name, what in described.items() if what}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._thread is not None:
            self._thread.close()

    def _damage(self) -> list[str]:
        """Return the damage of a log that lists nothing to read, by reading past all that is not wanted."""
        for _ in self._log.scans(frozenset(self._choice.wanted) or None, self._report):
            pass
        return damage_lines(self._report)

    def _judge_topics(self) -> None:
        """Report missing topics of a log without an index, whose topics are known only in the end."""
        for topic, _ in self._report.refused:
            self._choice.takes(topic)
        if (error := self._choice.error()) is not None:
            raise nothing_read(self.summary.damage, error, self._choice.wanted)
        self.summary.missing_topics = self._choice.missing


class ReadingOptions(Protocol):
    """Options of a command that reads logs."""

    @property
    def read(self) -> ReadOptions: ...

    @property
    def opening(self) -> OpenOptions: ...

    @property
    def poses(self) -> PoseOptions: ...


def pulled_by(thread: Threads, items: Iterator[T]) -> Iterator[T]:
    """Yield items that a thread pulls, `AHEAD` of them before they are wanted."""
    waiting = deque(thread.submit(next, items, None) for _ in range(AHEAD))
    while (item := waiting.popleft().result()) is not None:
        waiting.append(thread.submit(next, items, None))
        yield item


def named_files(options: ReadingOptions) -> list[str]:
    """Return the files that the options name, none of which an output may replace."""
    masks = options.read.rules.masks
    return [file for file in (options.poses.file, masks and masks.path) if file]


@contextmanager
def read_log(
    source: Source, options: ReadingOptions, need: Need = Need.TOLD, first: Reading | None = None
) -> Iterator[Reading]:
    """Open a log for its sweeps, of one world; `need` and `first` as of `Reading`, errors also of `refuse_apart`."""
    read = replace(options.read, run=options.read.run or LONGEST)
    with open_source(source, options.opening) as log, Reading(log, read, options.poses, need, first) as reading:
        # A path of its own would pass for the one that the log gives.
        reading.all_runs.refuse_apart()
        yield reading


def rules_of(parameters: dict[str, Any], mask: dict[str, Any] | None = None) -> RangeRules:
    """Return the rules for ranges of a run, by the parameters and the mask in the metadata of its tables."""
    limits = parameters.get("range")
    no_return = parameters.get("no_return")
    if not isinstance(no_return, list):
        return RangeRules()
    known = isinstance(limits, list) and len(limits) == 2 and all(map(_is_number, limits))
    masks = None
    if mask:
        # Anybody may have written the metadata.
        with suppress(OptionError):
            masks = masks_of("the tables", mask)
    return RangeRules(
        no_return=frozenset(word for word in NO_RETURN_WORDS if word in no_return),
        markers=tuple(float(value) for value in no_return if _is_number(value)),
        limits=(float(limits[0]), float(limits[1])) if known and limits else None,
        masks=masks,
    )


def opening_of(parameters: dict[str, Any]) -> OpenOptions:
    """Return the options of opening a log of a run, by the parameters in the metadata of its tables."""
    geometry, echo = parameters.get("csv"), parameters.get("echo")
    geometry = geometry if isinstance(geometry, dict) else {}
    known: dict[str, Any] = {
        name: float(value) for name, value in geometry.items() if name in GEOMETRY and _is_number(value)
    }
    if echo in ECHOES:
        known["echo"] = echo
    if parameters.get("segments") == KEEP:
        known["segments"] = KEEP
    heights, bins = parameters.get("slice"), parameters.get("bins")
    are_heights = isinstance(heights, list) and len(heights) == 2 and all(map(_is_number, heights))
    if are_heights and heights and isinstance(bins, int) and 0 < bins <= MAX_BEAMS:
        known["slice"] = Slice(float(heights[0]), float(heights[1]), bins, rules_of(parameters).limits)
    return OpenOptions(**known)


def _is_number(value: object) -> bool:
    """Return whether a value of the metadata, which anybody may have written, is a number to compute with."""
    from lidarcli.tabular.reading import MAX_VALUE

    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_VALUE
