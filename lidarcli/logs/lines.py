"""What the readers of text logs with one message per line share: cells, times that stay apart, and declared counts."""

from __future__ import annotations

import re
from collections.abc import Collection, Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, OpenOptions, ReadReport
from lidarcli.logs.blocks import TOO_MANY, given_geometries
from lidarcli.logs.numbers import Cells, Numbers, not_a_number, say
from lidarcli.sweeps import Float64, Int64

_ODD_BLANKS = re.compile(rb"[\t\f\v]|  | \n|\n ")
_TO_BLANKS = bytes.maketrans(b"\t\f\v", b"   ")
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MOST_DIGITS = 7
"""A count of more digits than this is none."""

WITHOUT_TIMES = "no time in the log: all stamps are 0"

CUT = "cut off"
"""Why the last line of a log is no message."""


def cells_of(text: bytes) -> Cells:
    """The cells of lines whose fields stand apart by any blanks."""
    if _ODD_BLANKS.search(text) or text[:1] == b" ":
        text = text.translate(_TO_BLANKS)
        while b"  " in text:
            text = text.replace(b"  ", b" ")
        text = text.replace(b" \n", b"\n").replace(b"\n ", b"\n").removeprefix(b" ")
    return Cells(text, b" ")


@lru_cache(1024)
def is_number(cell: bytes) -> bool:
    """Whether a cell is a decimal number.

    >>> is_number(b"12.5"), is_number(b"nohost")
    (True, False)
    """
    return _NUMBER.fullmatch(cell) is not None


@dataclass(slots=True)
class Apart:
    """Keeps times apart that follow each other in a log and are the same, each kind of message by itself."""

    _last: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    """Kind → the last time of the log, and how many messages had it."""

    def of(self, kind: bytes, stamps: Int64) -> Int64:
        """The times of the next messages of a kind; of equal ones each is a nanosecond after the one before it."""
        if not len(stamps):
            return stamps
        last, times = self._last.get(kind, (None, 0))
        again = np.empty(len(stamps), np.bool_)
        again[0] = int(stamps[0]) == last
        again[1:] = stamps[1:] == stamps[:-1]
        index = np.arange(1, len(stamps) + 1)
        run = index - np.maximum.accumulate(np.where(again, 0, index))
        # What begins the block goes on with the run of the block before it.
        run += np.where(np.logical_and.accumulate(again), times - 1, 0)
        self._last[kind] = int(stamps[-1]), int(run[-1]) + 1
        return stamps + run


@dataclass(frozen=True, eq=False, slots=True)
class Declared:
    """How many ranges each of some lines (R,) says it has, and which of them are no sweeps."""

    beams: Int64
    after: Int64
    """(R,) the first cell behind the ranges."""
    causes: dict[int, str]
    """Line → why it is none."""
    refused: set[int]
    """Lines that declare more ranges than any sensor has."""


def declared(cells: Cells, rows: Int64, at: int, width: int) -> Declared:
    """Read the number of ranges, each of `width` cells, in cell `at` of each of `rows`; the ranges stand behind it."""
    count = cells.count[rows]
    beams = np.zeros(len(rows), np.int64)
    causes = dict.fromkeys(np.flatnonzero(count <= at).tolist(), CUT)
    for row, cell in enumerate(cells.spans(rows, np.minimum(at, count - 1), 1)):
        if row in causes:
            continue
        if cell.isdigit() and len(cell) <= MOST_DIGITS:
            beams[row] = int(cell)
        else:
            causes[row] = f"{say(cell)} is no number of ranges"
    after = at + 1 + width * beams
    refused = {*np.flatnonzero(beams > MAX_BEAMS).tolist()}
    for row in np.flatnonzero(after > count).tolist():
        causes.setdefault(row, f"it declares {beams[row]} ranges and has fewer")
    return Declared(beams, after, causes, refused)


def left_over(fields: int, beams: int) -> str:
    """Why a line is no sweep that holds more than the ranges it declares, and what may stand behind them."""
    return f"{fields} field{'' if fields == 1 else 's'} left over behind the {beams} ranges it declares"


def report_lines(report: ReadReport, first_line: int, bad: Iterable[tuple[int, str]]) -> None:
    """Tell lines that are no messages, by their rows in a block that begins at `first_line`, in their order."""
    for row, cause in sorted(bad):
        report.add_damage(f"line {first_line + row}", cause)


def refuse(report: ReadReport, topic: str, refused: Collection[int]) -> None:
    """Count sweeps that declare more ranges than any sensor has."""
    if refused:
        report.refused[(topic, TOO_MANY)] += len(refused)


def sound_rows(
    numbers: Numbers, rows: Int64, width: int, bad: list[tuple[int, str]], what: str = ""
) -> tuple[Int64, Float64]:
    """Which of some lines hold `width` numbers each, and these (K, width); the others are told in `bad`."""
    good = np.ones(len(rows), np.bool_)
    for at, cell in numbers.bad.items():
        bad.append((int(rows[at]), what + not_a_number(cell)))
        good[at] = False
    return np.flatnonzero(good), numbers.values.reshape(-1, width)[good]


Name = TypeVar("Name", bound=Hashable)


class Told(Generic[Name]):
    """Values by name and line. Of each block of lines all are kept until the next one, of those before it the last."""

    def __init__(self) -> None:
        self._told: dict[Name, tuple[list[int], list[Sequence[float]]]] = {}
        self._fresh: set[Name] = set()
        """What the last block has told."""

    def add(self, first_line: int, values: Iterable[tuple[int, Name, Sequence[float]]]) -> None:
        """Take row, name and values of what a block tells, in the order of its lines; a name has as many values always."""
        for name in self._fresh:
            lines, known = self._told[name]
            self._told[name] = lines[-1:], known[-1:]
        self._fresh.clear()
        for row, name, value in values:
            lines, known = self._told.setdefault(name, ([], []))
            lines.append(first_line + row)
            known.append(value)
            self._fresh.add(name)

    def at(self, name: Name, lines: Int64, width: int) -> Float64:
        """The values at each line (R, width), NaN where none has been told yet."""
        told = self._told.get(name)
        if told is None:
            return np.full((len(lines), width), np.nan)
        index = np.searchsorted(np.array(told[0], np.int64), lines) - 1
        known = np.array(told[1], np.float64).reshape(-1, width)
        return np.where(index[:, None] < 0, np.nan, known[np.maximum(index, 0)])

    def last(self, name: Name) -> Sequence[float] | None:
        """The values told last; None where nothing was."""
        told = self._told.get(name)
        return None if told is None else told[1][-1]


TELL_BEARINGS = "(tell --angle-min and --angle-increment, or --fov)"
"""The way out where a log does not tell bearings."""


def tells_geometry(options: OpenOptions) -> bool:
    """Whether options tell the whole geometry."""
    return options.fov is not None or (options.angle_min is not None and options.angle_increment is not None)


def as_told(options: OpenOptions, first: Float64, step: Float64, beams: Int64) -> tuple[Float64, Float64]:
    """What options tell in the place of the first bearings and steps [rad] that a log tells (S,)."""
    if tells_geometry(options):
        first, step = given_geometries(options, beams)
    if options.angle_increment is not None:
        step = np.full(len(beams), options.angle_increment)
    if options.angle_min is not None:
        first = np.full(len(beams), options.angle_min)
    return first, step


def full_steps(view: Float64, resolution: Float64, beams: Int64, rounded: float) -> Float64:
    """Steps [rad] with all the digits that a line lets know: where a step is rounded, the view says more.

    Where the view is that of the ranges, or of one more, its part for each beam is taken; else the step as it is told.
    `rounded`: by how much the last decimal of a step may be off [rad].
    """
    gaps = np.maximum(beams - 1, 1)
    steps = np.where(resolution == 0.0, view / gaps, resolution)
    parts = np.stack([view / gaps, view / np.maximum(beams, 1)])
    off = np.abs(parts - resolution)
    nearest = np.take_along_axis(parts, np.argmin(off, axis=0)[None], axis=0)[0]
    return np.where(off.min(axis=0) < rounded, nearest, steps)
