"""Logs in several parts, read one after the other as one stream: files of a bag, and recordings that are joined."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from lidarcli.display.texts import counted
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import CLOUD_TYPES, POSE_TYPES, SCAN_TYPES, Closing, Log, Message, ReadReport, Topic
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.records import dataclass, replace

_NUMBERED = re.compile(r"(.+)_(\d{1,9})(\.[A-Za-z]\w*)?(?:\.[A-Za-z]\w*)*")
_DATE = re.compile(r"(?:^|_)\d{4}(?:-\d\d){5}$")
"""Each part of a ROS 1 bag is named by the time at which it begins."""


class Numbered(NamedTuple):
    """The name of a part, as recorders number them when they split what they record."""

    log: str
    stem: str
    """Name that all parts share: that name without a date."""
    number: int
    suffix: str
    """The first suffix, in lower case: whether a part is compressed or still active makes no difference."""


def numbered(name: str) -> Numbered | None:
    """Take the name of a part to pieces; None for other names.

    >>> numbered("hall_2024-01-01-10-00-00_0.bag")
    Numbered(log='hall_2024-01-01-10-00-00', stem='hall', number=0, suffix='.bag')
    >>> numbered("run_12")
    Numbered(log='run', stem='run', number=12, suffix='')
    """
    if (found := _NUMBERED.fullmatch(name)) is None:
        return None
    log, number, suffix = found.groups()
    return Numbered(log, _DATE.sub("", log), int(number), (suffix or "").lower())


def earlier_parts(path: Path) -> list[Path]:
    """Return the parts of a recording in the same folder that come before one, in their order."""
    last, files = numbered(path.name), [*path.parent.iterdir()] if path.parent.is_dir() else []
    named = [(name, each) for each in files if (name := numbered(each.name)) is not None]
    alike = [(name.number, each) for name, each in named if last and (name.stem, name.suffix) == (last.stem, last.suffix)]
    return [each for number, each in sorted(alike) if last and number < last.number]


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts `_2` before `_10`.

    >>> sorted(["bag_10.db3", "bag_2.db3"], key=natural)
    ['bag_2.db3', 'bag_10.db3']
    """
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a log."""

    path: str
    """As errors of opening it name it."""
    name: str
    size: int
    open: Callable[[ReadReport], AbstractContextManager[Log]]
    """Opens it for a pass, whose report takes what that meets; raises `UnreadableError`."""

    def cause(self, error: UnreadableError) -> str:
        """Return the cause of an error of opening it, without its name."""
        return str(error).removeprefix(f"{self.path}: ")


class PartedLog(Closing):
    """A `Log` in parts: each is opened for a pass and closed behind it, and one that cannot be read is damage."""

    format = ""

    def __init__(self, path: str, parts: Sequence[Part], names_parts: bool = True) -> None:
        """`names_parts`: damage is reported with the name of its part."""
        self.path = path
        self.position = 0
        self.parts = tuple(parts)
        self.size: int | None = sum(part.size for part in parts)
        self._names_parts = names_parts
        self._opening = ReadReport()
        self._topics: list[Topic] | None = None
        self._codecs: set[str] = set()

    @property
    def compression(self) -> str:
        """Compression of the parts opened so far."""
        codecs = self._codecs - {"none"} or {"none"}
        return "+".join(sorted(codecs))

    def topics(self) -> list[Topic] | None:
        """Return topics of all parts, with the sum of their messages; None where a part has no index of them."""
        if self._topics is not None:
            return list(self._topics)
        # With the encoding of the first part that has them.
        found: dict[tuple[str, str], Topic] = {}
        for part in self.parts:
            with self._open(part, ReadReport()) as (log, _):
                topics = [] if log is None else log.topics()
            if topics is None:
                return None
            for topic in topics:
                before = found.setdefault((topic.name, topic.type), replace(topic, messages=0))
                known = before.messages is not None and topic.messages is not None
                count = (before.messages or 0) + (topic.messages or 0) if known else None
                found[topic.name, topic.type] = replace(before, messages=count)
        self._topics = [*found.values()]
        return list(self._topics)

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic, part after part."""
        for _, block in self._blocks(topics, report):
            yield block

    def _blocks(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[tuple[Part, RawSweeps]]:
        for number, log, own in self.opened(report):
            for block in log.scans(topics, own):
                self._advance(number, log.position / (log.size or 1))
                yield self.parts[number], block

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order, part after part."""
        for _, log, own in self.opened(report):
            yield from log.messages(types, own)

    def opened(self, report: ReadReport) -> Iterator[tuple[int, Log, ReadReport]]:
        """Yield the parts that can be opened, each with a report of its own: one pass over the log."""
        report.add(self._opening)
        for number, part in enumerate(self.parts):
            with self._open(part, report) as (log, own):
                if log is not None:
                    yield number, log, own
            self._advance(number, 1.0)

    @contextmanager
    def _open(self, part: Part, report: ReadReport) -> Iterator[tuple[Log | None, ReadReport]]:
        """Open a part, with a report of its own; None if it cannot be read."""
        own = ReadReport(takes_degrees=report.takes_degrees)
        with ExitStack() as stack:
            log: Log | None = None
            try:
                log = stack.enter_context(part.open(report))
                self._codecs.update(log.compression.split("+"))
            except UnreadableError as err:
                report.add_damage(part.name, f"the whole file is lost: {part.cause(err)}")
            try:
                yield log, own
            finally:
                if log is not None:
                    self._codecs.update(log.compression.split("+"))
                report.add(own, f"{part.name}: " if self._names_parts else "")

    def _advance(self, number: int, share: float) -> None:
        """Set the position after a share of one part."""
        before = sum(part.size for part in self.parts[:number])
        self.position = before + int(self.parts[number].size * min(share, 1.0))


_CAT = ("carmen",)
"""Formats of text that say at their beginning what the lines behind it need."""
_CSV = "csv"

_Begun = tuple[Part, int | None]
"""A part, and when it begins [ns]; None where that is unknown."""


class JoinedLog(PartedLog):
    """Recordings that are one log: parts in the order of their first messages, whatever they are called."""

    def __init__(self, path: str, parts: Sequence[Part]) -> None:
        """Open every part, to learn when it begins.

        Raises
        ------
        UnreadableError
            No part can be read.
        OptionError
            Parts are of formats that do not go together, or one is a pipe.
        """
        begun: list[_Begun] = []
        formats: dict[str, str] = {}
        lost: list[str] = []
        for part in parts:
            try:
                with part.open(ReadReport()) as log:
                    if log.size is None:
                        raise OptionError(f"{part.path}: a pipe is read only once, and cannot be joined")
                    formats.setdefault(log.format, part.name)
                    begun.append((replace(part, size=log.size), _begin(log)))
            except UnreadableError as err:
                lost.append(f"{part.name}: {part.cause(err)}")
                begun.append((part, None))
        if not formats:
            raise UnreadableError(f"none of its parts can be read; {lost[0]}")
        _refuse_mixed(formats)
        begun = _in_order(begun)
        super().__init__(path, [part for part, _ in begun])
        self.format = "+".join(formats)
        self._opening.notes += [*_counts(self.parts), *_alike(begun)]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps as `PartedLog` does, with a note on parts that overlap."""
        ends: dict[str, tuple[int, Part]] = {}
        """Topic → time of the last sweep so far [ns], and its part."""
        begun: set[tuple[str, Part]] = set()
        for part, block in self._blocks(topics, report):
            topic = block.topic
            if len(block):
                begin, end = int(block.record_ns.min()), int(block.record_ns.max())
                last, before = ends.get(topic, (begin, part))
                if (topic, part) not in begun and begin < last:
                    seconds = (last - begin) / 1e9
                    report.notes.append(
                        f"{part.name} begins {seconds:.1f} s before {before.name} ends ({topic}): they overlap"
                    )
                begun.add((topic, part))
                if topic not in ends or end > last:
                    ends[topic] = end, part
            yield block


def _refuse_mixed(formats: Mapping[str, str]) -> None:
    """Refuse formats that are no parts of one recording; each is given with a part that has it (`OptionError`)."""
    # Bags and their like need none of what reads text.
    from lidarcli.logs.csv.layouts import PER_SWEEP

    for form, name in formats.items():
        if PER_SWEEP in form:
            raise OptionError(f"{name} holds one sweep: name the folder of such files, which is one log by itself")
        if form in _CAT:
            raise OptionError(
                f"{name} is a {form} log, which says at its beginning what holds for all of it: put its parts together "
                "with cat"
            )
        if form.startswith(_CSV) and len(formats) > 1:
            other = next(other for other in formats if other != form)
            raise OptionError(
                f"{name} is {form} and {formats[other]} is {other}: CSV is joined with CSV of the same layout alone; name "
                "the others apart"
            )


def _begin(log: Log) -> int | None:
    """Return the time at which the first sweep, else the first pose, was recorded [ns]; None without any."""
    # Poses come second, for recorders repeat what is latched, with its old time, at the beginning of every part.
    for message in log.messages(SCAN_TYPES | CLOUD_TYPES, ReadReport()):
        return message.record_ns
    for block in log.scans(None, ReadReport()):
        if len(block):
            return int(block.record_ns[0])
    for message in log.messages(POSE_TYPES, ReadReport()):
        return message.record_ns
    return None


def _in_order(begun: Sequence[_Begun]) -> list[_Begun]:
    """Return parts by the times at which they begin; one whose time is unknown stays behind the one before it."""
    times = []
    last = min((begin for _, begin in begun if begin is not None), default=0)
    for _, begin in begun:
        last = last if begin is None else begin
        times.append(last)
    return [begun[number] for number in sorted(range(len(begun)), key=times.__getitem__)]


def _counts(parts: Sequence[Part]) -> Iterator[str]:
    """Yield a note if parts are numbered, and numbers are missing or are there twice."""
    names = [numbered(part.name) for part in parts]
    stems = {name.stem if name else None for name in names}
    if None in stems or len(stems) > 1:
        return
    numbers = {name.number for name in names if name}
    if (count := max(numbers) + 1 - len(numbers)) > 0:
        first = next(number for number in range(len(numbers) + 1) if number not in numbers)
        yield f"missing by their numbers: {counted(count, 'part')}, the first is number {first}"
    if len(numbers) < len(parts):
        yield "several parts have one number: they look like parts of several recordings"


def _alike(begun: Sequence[_Begun]) -> Iterator[str]:
    """Yield a note on each pair of parts that may be one recording twice."""
    for (one, begin), (other, same) in pairwise(begun):
        if begin is not None and begin == same and one.size == other.size:
            yield f"{one.name} and {other.name} begin at the same time and are of the same size: one recording twice?"
