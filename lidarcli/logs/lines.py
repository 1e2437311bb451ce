"""The grammar of robots' text logs: each line is a keyword and fields, and holds a sweep, a pose, or facts about a sensor.

A format (`carmen`, `aria`, `player`) declares its kinds of lines and decodes each by column. Everything else stands here,
once for all: cells, counts, damage, equal times, facts that later lines rely on, blocks of sweeps, messages of poses.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import MAX_BEAMS, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import TOO_MANY, as_singles, given_geometries, keep_sound
from lidarcli.logs.numbers import Cells, not_a_number, say
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, PlanarPoses
from lidarcli.logs.text import TextBlock, TextLog
from lidarcli.sweeps import Bool, Float32, Float64, Int64, RawSweeps

_ODD_BLANKS = re.compile(rb"[\t\f\v]|  | \n|\n ")
_TO_BLANKS = bytes.maketrans(b"\t\f\v", b"   ")
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_MOST_DIGITS = 7
"""Digits of the largest count that is believed."""
POSE = 3
"""Numbers of a pose: x, y, yaw."""

WITHOUT_TIMES = "no time in the log: all stamps are 0"
TELL_BEARINGS = "(tell --angle-min and --angle-increment, or --fov)"
"""Advice for logs without bearings."""
CUT = "cut off"
"""Cause of damage for the last line of a log that ends within it."""


def cells_of(text: bytes) -> Cells:
    """Return the cells of lines whose fields are separated by any blanks."""
    if _ODD_BLANKS.search(text) or text[:1] == b" ":
        text = text.translate(_TO_BLANKS)
        while b"  " in text:
            text = text.replace(b"  ", b" ")
        text = text.replace(b" \n", b"\n").replace(b"\n ", b"\n").removeprefix(b" ")
    return Cells(text, b" ")


@lru_cache(1024)
def is_number(cell: bytes) -> bool:
    """Tell whether a cell is a decimal number.

    >>> is_number(b"12.5"), is_number(b"nohost")
    (True, False)
    """
    return _NUMBER.fullmatch(cell) is not None


def count_in(cell: bytes) -> int | None:
    """Return the count in a cell; None for anything but a few digits.

    >>> count_in(b"181"), count_in(b"-1")
    (181, None)
    """
    return int(cell) if cell.isdigit() and len(cell) <= _MOST_DIGITS else None


def left_over(cells: int, beams: int) -> str:
    """Return the cause for a line with `cells` more cells than it can have behind its ranges."""
    return f"{cells} field{'' if cells == 1 else 's'} left over behind the {beams} ranges it declares"


@dataclass(frozen=True, eq=False, slots=True)
class Declared:
    """Numbers of ranges that some lines (R,) declare, and the lines that cannot be sweeps."""

    beams: Int64
    after: Int64
    """(R,) First cell behind the ranges."""
    causes: dict[int, str]
    """Index of each line that is no sweep → the reason."""
    refused: set[int]
    """Indices of lines that declare more ranges than any sensor has."""

    @property
    def sound(self) -> Bool:
        """(R,) True for the lines that can be sweeps."""
        good = np.ones(len(self.beams), np.bool_)
        good[[*self.causes, *self.refused]] = False
        return good


@dataclass(slots=True)
class LineBlock:
    """The lines of a block of text while they are decoded."""

    cells: Cells
    line: int
    """Number of the first line."""
    cut: int
    """Row of the last line where it has no line end; -1 otherwise."""
    bad: list[tuple[int, str]] = field(default_factory=list)
    """Row and cause of each line that is no message, until these are reported."""

    @classmethod
    def of(cls, block: TextBlock) -> Self:
        """Find the cells of a block."""
        cells = cells_of(block.text)
        return cls(cells, block.line, len(cells.count) - 1 if block.cut else -1)

    def by_keyword(self) -> dict[bytes, list[int]]:
        """Return the rows of each first cell, in the order of first appearance."""
        rows: dict[bytes, list[int]] = {}
        for row, word in enumerate(self.cells.column(np.arange(len(self.cells.count)), 0)):
            rows.setdefault(word, []).append(row)
        return rows

    def report_bad(self, report: ReadReport) -> None:
        """Report the lines that are no messages, in their order."""
        for row, cause in sorted(self.bad):
            report.add_damage(f"line {self.line + row}", cause)
        self.bad.clear()

    def declared(self, rows: Int64, at: int, width: int) -> Declared:
        """Read cell `at` of some lines: the number of ranges, of `width` cells each, that follow it."""
        count = self.cells.count[rows]
        beams = np.zeros(len(rows), np.int64)
        causes = dict.fromkeys(np.flatnonzero(count <= at).tolist(), CUT)
        for index, cell in enumerate(self.cells.spans(rows, np.minimum(at, count - 1), 1)):
            if index in causes:
                continue
            if (number := count_in(cell)) is None:
                causes[index] = f"{say(cell)} is no number of ranges"
            else:
                beams[index] = number
        after = at + 1 + width * beams
        for index in np.flatnonzero(after > count).tolist():
            causes.setdefault(index, f"it declares {beams[index]} ranges and has fewer")
        return Declared(beams, after, causes, {*np.flatnonzero(beams > MAX_BEAMS).tolist()})

    def flat(self, rows: Int64, first: int, count: Int64, scale: float) -> NDArray[np.floating]:
        """Parse `count` cells of each row from cell `first` on; rows with a cell that is no number are bad.

        Numbers are float32, or float64 where they will be scaled.
        """
        found = self.cells.numbers(rows, first, count, np.float32 if scale == 1.0 else np.float64)
        self.bad += [(int(rows[at]), not_a_number(cell)) for at, cell in found.bad.items()]
        return found.values

    def numbers(self, rows: Int64, first: int | Int64, width: int, what: str = "") -> tuple[Int64, Float64]:
        """Parse `width` cells from cell `first` on; rows with a cell that is no number are bad.

        Returns
        -------
        (K,) indices of the other rows, and their numbers (K, width)
        """
        found = self.cells.numbers(rows, first, np.full(len(rows), width), np.float64)
        good = np.ones(len(rows), np.bool_)
        for at, cell in found.bad.items():
            self.bad.append((int(rows[at]), what + not_a_number(cell)))
            good[at] = False
        return np.flatnonzero(good), found.values.reshape(-1, width)[good]

    def poses(self, rows: Int64, first: int) -> tuple[Int64, Float64]:
        """Parse three cells from cell `first` on as x, y, yaw; rows without them are bad.

        Returns
        -------
        (K,) indices of the other rows, and their poses (K, 3)
        """
        short = self.cells.count[rows] < first + POSE
        self.bad += [(row, "it has less numbers than a pose") for row in rows[short].tolist()]
        whole = np.flatnonzero(~short)
        good, values = self.numbers(rows[whole], first, POSE, "its pose: ")
        return whole[good], values


Kind = TypeVar("Kind", bound=Hashable)


@dataclass(frozen=True, eq=False, slots=True)
class Found(Generic[Kind]):
    """R lines of one kind in a block, in the order of the log."""

    kind: Kind
    rows: Int64
    """(R,) Lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) Times; of equal ones that follow each other each is a nanosecond after the one before it."""

    def of(self, some: slice | Int64 | Bool) -> Self:
        """Return some of the lines."""
        arrays = {each.name: getattr(self, each.name)[some] for each in fields(self) if each.name != "kind"}
        return type(self)(self.kind, **arrays)


@dataclass(frozen=True, eq=False, slots=True)
class Framed(Found[Kind]):
    """R sweeps of one kind whose number of ranges is known."""

    beams: Int64
    """(R,) Ranges."""
    after: Int64
    """(R,) First cell behind the ranges."""


@dataclass(slots=True)
class DistinctTimes:
    """Separates equal times that follow each other in a log, for each kind of message apart."""

    _last: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    """Kind → last time of the log, and the number of messages that had it."""

    def of(self, kind: bytes, stamps: Int64) -> Int64:
        """Return the times of the next messages of a kind; of equal ones each is a nanosecond after the one before."""
        if not len(stamps):
            return stamps
        last, times = self._last.get(kind, (None, 0))
        again = np.empty(len(stamps), np.bool_)
        again[0] = int(stamps[0]) == last
        again[1:] = stamps[1:] == stamps[:-1]
        index = np.arange(1, len(stamps) + 1)
        run = index - np.maximum.accumulate(np.where(again, 0, index))
        # Equal times at the beginning of the block continue the run of the block before it.
        run += np.where(np.logical_and.accumulate(again), times - 1, 0)
        self._last[kind] = int(stamps[-1]), int(run[-1]) + 1
        return stamps + run


class LineState:
    """Facts about sensors by name and line; each holds for the lines after it, until the next one of its name."""

    def __init__(self) -> None:
        self._facts: dict[Hashable, tuple[list[int], list[Sequence[float]]]] = {}
        """Name → lines and values: those of the last block, and of earlier blocks the last one."""
        self._fresh: set[Hashable] = set()
        """Names in the last block."""

    def add(self, first_line: int, facts: Iterable[tuple[int, Hashable, Sequence[float]]]) -> None:
        """Take row, name and values of the facts in a block, in the order of lines; a name always has as many values."""
        for name in self._fresh:
            lines, values = self._facts[name]
            self._facts[name] = lines[-1:], values[-1:]
        self._fresh.clear()
        for row, name, value in facts:
            lines, values = self._facts.setdefault(name, ([], []))
            lines.append(first_line + row)
            values.append(value)
            self._fresh.add(name)

    def at(self, name: Hashable, lines: Int64, width: int) -> Float64:
        """Return the `width` values that hold at each line (R, width); NaN before the first fact."""
        if name not in self._facts:
            return np.full((len(lines), width), np.nan)
        places, values = self._facts[name]
        index = np.searchsorted(np.array(places, np.int64), lines) - 1
        known = np.array(values, np.float64).reshape(-1, width)
        return np.where(index[:, None] < 0, np.nan, known[np.maximum(index, 0)])

    def last(self, name: Hashable) -> Sequence[float] | None:
        """Return the latest values; None without any."""
        return self._facts[name][1][-1] if name in self._facts else None


Part = TypeVar("Part", bound=Found[Any])


@dataclass
class Grammar(ABC, Generic[Part]):
    """One pass over the lines of a log, block after block; a format fills in its kinds of lines."""

    options: OpenOptions
    report: ReadReport
    topics: Collection[str] | None = None
    """Wanted topics of sweeps; None for all."""
    types: Collection[str] | None = None
    """Wanted types of poses; None in a pass for sweeps."""
    state: LineState = field(default_factory=LineState, init=False)
    distinct: DistinctTimes = field(default_factory=DistinctTimes, init=False)
    first_ns: dict[str, int] = field(default_factory=dict, init=False)
    """Frame of each sensor → stamp of its first sweep, in a pass for poses."""

    @abstractmethod
    def read(self, lines: LineBlock) -> list[Part]:
        """Find the wanted messages of a block and their times; keep its facts in `state`."""

    @abstractmethod
    def frame(self, found: Part) -> str | None:
        """Return the frame of the sensor whose sweeps these lines hold; None for other lines."""

    @abstractmethod
    def sweeps_of(self, lines: LineBlock, found: Part) -> Iterator[RawSweeps]:
        """Decode sweeps; nothing for other lines."""

    @abstractmethod
    def poses_of(self, lines: LineBlock, found: Part) -> Iterator[PlanarPoses]:
        """Decode the poses in some lines."""

    @abstractmethod
    def mount(self, frame: str) -> tuple[str, Sequence[float]] | None:
        """Return the frame of a sensor's robot, and x, y [m], yaw [rad] in it; None where the log says nothing."""

    def sweeps(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, topic by topic."""
        lines, found = self._read(block)
        for part in found:
            yield from self.sweeps_of(lines, part)
        lines.report_bad(self.report)

    def messages(self, block: TextBlock) -> Iterator[Message]:
        """Yield the poses of a block, in the order of its lines."""
        lines, found = self._read(block)
        messages: list[tuple[int, Message]] = []
        for part in found:
            if (frame := self.frame(part)) is not None:
                self.first_ns.setdefault(frame, int(part.stamp_ns[0]))
            for poses in self.poses_of(lines, part):
                if poses.type in (self.types or ()):
                    messages += zip(poses.rows.tolist(), poses.messages(), strict=True)
        lines.report_bad(self.report)
        for _, message in sorted(messages, key=lambda one: one[0]):
            yield message

    def mounts(self) -> Iterator[Message]:
        """Yield the mounts of the sensors that had sweeps, once the whole log is read."""
        for frame, stamp_ns in self.first_ns.items() if MOUNT_TYPE in (self.types or ()) else ():
            if (mount := self.mount(frame)) is not None:
                row, stamp = np.zeros(1, np.int64), np.array([stamp_ns])
                pose = np.array([mount[1]])
                yield from PlanarPoses(MOUNTS, MOUNT_TYPE, mount[0], frame, row, stamp, pose).messages()

    def _read(self, block: TextBlock) -> tuple[LineBlock, list[Part]]:
        lines = LineBlock.of(block)
        found = [part for part in self.read(lines) if len(part.rows)]
        lines.report_bad(self.report)
        return lines, found

    def note(self, text: str) -> None:
        """Add a note to the report, once."""
        if text not in self.report.notes:
            self.report.notes.append(text)

    def refuse(self, topic: str, cause: str, count: int) -> None:
        """Count sweeps that are whole and cannot be read."""
        if count:
            self.report.refused[(topic, cause)] += count

    def refuse_many(self, topic: str, declared: Declared) -> None:
        """Count sweeps that declare more ranges than any sensor has."""
        self.refuse(topic, TOO_MANY, len(declared.refused))

    def bearings(self, first: Float64, step: Float64, beams: Int64) -> tuple[Float64, Float64]:
        """Replace first bearings and steps (S,) [rad] of a log by those that the user gives."""
        options = self.options
        if gives_geometry(options):
            first, step = given_geometries(options, beams)
        if options.angle_increment is not None:
            step = np.full(len(beams), options.angle_increment)
        if options.angle_min is not None:
            first = np.full(len(beams), options.angle_min)
        return first, step

    def block(
        self,
        topic: str,
        frame: str,
        found: Framed[Any],
        bearings: tuple[Float64, Float64],
        limits: tuple[Float32, Float32],
        ranges: Float32,
        good: Bool,
        intensities: Float32 | None = None,
    ) -> RawSweeps | None:
        """Make a block of sweeps.

        Parameters
        ----------
        found : the S sweeps
        bearings : first bearings and steps (S,) [rad]
        limits : least and greatest range (S,) [m]
        ranges, intensities : (S, B), padded with NaN
        good : (S,) False for sweeps that are left out

        Returns
        -------
        The sweeps that are sound, or None without any.
        """
        most = self.options.range_max
        count = len(found.rows)
        block = RawSweeps(
            topic=topic,
            frame_ids=(frame,),
            frame=np.zeros(count, np.int32),
            stamp_ns=found.stamp_ns,
            record_ns=found.stamp_ns,
            angle_min=bearings[0],
            angle_increment=bearings[1],
            range_min=limits[0],
            range_max=limits[1] if most is None else as_singles(np.full(count, most)),
            beams=found.beams.astype(np.int32),
            ranges=ranges,
            intensities=intensities,
        )
        return keep_sound(block, good, self.report)


class LineLog(TextLog):
    """A log that a grammar reads."""

    format: ClassVar[str]
    grammar: ClassVar[type[Grammar[Any]]]
    _counted: dict[tuple[str, str], int | None] | None = None

    def topics(self) -> list[Topic] | None:
        """Return the topics by the keywords of all lines, which are read once for it; None for a stream."""
        if self._counted is None:
            self._counted = self._indexed(self._count)
        if self._counted is None:
            return None
        return [Topic(name, kind, self.format, count) for (name, kind), count in self._counted.items()]

    @abstractmethod
    def _count(self, blocks: Iterable[TextBlock]) -> dict[tuple[str, str], int | None]:
        """Return name and type of each topic → its messages, where they can be counted."""

    def _grammar(self, report: ReadReport, topics: Collection[str] | None, types: Collection[str] | None) -> Grammar[Any]:
        """Start a pass over the log."""
        return self.grammar(self._options, report, topics, types)

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        grammar = self._grammar(report, topics, None)
        for block in blocks:
            yield from grammar.sweeps(block)

    def _poses(self, blocks: Iterator[TextBlock], types: Collection[str], report: ReadReport) -> Iterator[Message]:
        grammar = self._grammar(report, None, types)
        for block in blocks:
            yield from grammar.messages(block)
        yield from grammar.mounts()


def gives_geometry(options: OpenOptions) -> bool:
    """Tell whether the user gives all bearings."""
    return options.fov is not None or (options.angle_min is not None and options.angle_increment is not None)


def full_steps(view: Float64, resolution: Float64, beams: Int64, rounded: float) -> Float64:
    """Return steps (S,) [rad] with all their digits: a view has more than a rounded step.

    Parameters
    ----------
    view, resolution : (S,) view and step in a log [rad]; a step of 0 is unknown
    beams : (S,) ranges of each sweep
    rounded : greatest error of a rounded step [rad]

    Returns
    -------
    The part of the view for each beam, where the view is that of the ranges, or of one more; else the step of the log.
    """
    gaps = np.maximum(beams - 1, 1)
    steps = np.where(resolution == 0.0, view / gaps, resolution)
    parts = np.stack([view / gaps, view / np.maximum(beams, 1)])
    off = np.abs(parts - resolution)
    nearest = np.take_along_axis(parts, np.argmin(off, axis=0)[None], axis=0)[0]
    return np.where(off.min(axis=0) < rounded, nearest, steps)
