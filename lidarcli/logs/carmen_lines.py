"""The lines of CARMEN logs: their kinds, the number of ranges in each, and where its time is.

Writers of many years differ: some declare more ranges than they write, leave out fields behind the ranges, or end lines
early. A line is read only where its fields leave no doubt which of them are ranges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Self

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.blocks import TOO_MANY
from lidarcli.logs.numbers import Cells, not_a_number, shown
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import TURN, Bool, Float64, Int64

FRONT, REAR = "front_laser", "rear_laser"


@dataclass(frozen=True, slots=True)
class Laser:
    """A kind of sweep."""

    topic: str
    frame: str
    geometry: bool = False
    """True where seven fields before the number of ranges describe the sensor: type, first angle, view, step, ..."""
    pairs: bool = False
    """True where a remission follows each range."""
    posed: bool = False
    """True where poses of laser and robot follow the ranges."""

    @property
    def count(self) -> int:
        """Cell with the number of ranges, which follow it."""
        return 8 if self.geometry else 1

    @property
    def width(self) -> int:
        """Cells of each range."""
        return 2 if self.pairs else 1


LASERS: dict[bytes, Laser] = {
    b"FLASER": Laser("/front_laser", FRONT, posed=True),
    b"RLASER": Laser("/rear_laser", REAR, posed=True),
    b"LASER3": Laser("/laser3", "laser3"),
    b"LASER4": Laser("/laser4", "laser4"),
    b"REMISSIONFLASER": Laser("/front_laser_remission", FRONT, pairs=True, posed=True),
    b"RAWLASER1": Laser("/raw_laser1", FRONT, geometry=True),
    b"RAWLASER2": Laser("/raw_laser2", REAR, geometry=True),
    b"RAWLASER3": Laser("/raw_laser3", "laser3", geometry=True),
    b"RAWLASER4": Laser("/raw_laser4", "laser4", geometry=True),
    b"ROBOTLASER1": Laser("/robot_laser1", FRONT, geometry=True, posed=True),
    b"ROBOTLASER2": Laser("/robot_laser2", REAR, geometry=True, posed=True),
}
"""First word → kind of sweep. A sensor that is written in two ways has two topics in one frame."""
ODOM, TRUEPOS, PARAM = b"ODOM", b"TRUEPOS", b"PARAM"
POSE = 3
"""Numbers of a pose: x, y, yaw."""

_ODD_BLANKS = re.compile(rb"[\t\f\v]|  | \n|\n ")
_TO_BLANKS = bytes.maketrans(b"\t\f\v", b"   ")
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_MOST_DIGITS = 7
"""Digits of the largest count that is believed."""
_WORD = re.compile(rb"[A-Za-z_]\w{0,63}")
"""First word of a message of another program, which is skipped."""
_LONGEST_HEAD = 1024
"""Bytes at the start of a line in which the number of ranges stands."""
_NO_TIME = "no time at its end"
_CUT = "cut off"
_UNTIMED_LOG = "no time in the log: all stamps are 0"

_TAIL = 3
"""Fields at the end of a whole line: ipc_timestamp, ipc_hostname and logger_timestamp."""
_POSED = (0, POSE, 2 * POSE)
"""Fields behind the ranges: none, the pose of the laser, or also that of the robot."""
_WHOLE = 11
"""Fields behind ranges and remissions of a line with geometry: both poses, and how the robot moved."""
_SHORTER = (*_POSED, 7, 8, 9, 10, _WHOLE)
"""Numbers of such fields in lines of old writers, behind a number of remissions."""
_BARE = (*_POSED, _WHOLE)
"""Numbers of such fields in lines without a number of remissions."""
_SAMPLE = 20
"""Lines that show how a writer spells numbers."""


@lru_cache(1024)
def is_number(cell: bytes) -> bool:
    """Return whether a cell is a decimal number.

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
        """Find the cells of a block, which are separated by any blanks."""
        text = block.text
        if _ODD_BLANKS.search(text) or text[:1] == b" ":
            text = text.translate(_TO_BLANKS)
            while b"  " in text:
                text = text.replace(b"  ", b" ")
            text = text.replace(b" \n", b"\n").replace(b"\n ", b"\n").removeprefix(b" ")
        cells = Cells(text, b" ")
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

    def poses(self, rows: Int64, first: Int64, width: int) -> tuple[Int64, Float64]:
        """Parse `width` cells from cell `first` (R,) on; rows with a cell that is no number are bad.

        Returns
        -------
        (K,) indices of the other rows, and their numbers (K, width)
        """
        parsed = self.cells.numbers(rows, first, np.full(len(rows), width), np.float64)
        self.bad += [(int(rows[at]), "its pose: " + not_a_number(cell)) for at, cell in parsed.bad.items()]
        good = np.delete(np.arange(len(rows)), list(parsed.bad))
        return good, parsed.values.reshape(-1, width)[good]


@dataclass(frozen=True, eq=False, slots=True)
class CarmenLines:
    """R lines with one first word, in the order of the log; those of poses have no ranges."""

    word: bytes
    rows: Int64
    """(R,) Lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) Times; of equal ones that follow each other each is a nanosecond after the one before it."""
    beams: Int64
    """(R,) Ranges."""
    after: Int64
    """(R,) First cell behind the ranges."""
    behind: Int64
    """(R,) Cells from the last range to the time; -1 where a line has no time."""
    rest: Int64
    """(R,) Cells from the time on."""

    def of(self, some: slice | Int64 | Bool) -> Self:
        """Return some of the lines."""
        arrays = {each.name: getattr(self, each.name)[some] for each in fields(self) if each.name != "word"}
        return type(self)(self.word, **arrays)


@dataclass(slots=True)
class Framing:
    """Finds ranges and times of the lines of one log, block after block."""

    report: ReadReport
    _endings: dict[str, Counter[tuple[int, int]]] = field(default_factory=dict)
    """Topic → numbers of lines so far, by their ranges and the fields behind these."""
    _timed: bool = False
    """True once a sweep has had a time."""
    _last: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    """First word → last time of its lines, and the number of lines that had it."""

    def read(self, lines: LineBlock, wanted: Collection[bytes]) -> tuple[list[CarmenLines], list[tuple[int, bytes, bytes]]]:
        """Return the wanted messages of a block, and its parameters: row, name and value."""
        cells = lines.cells
        messages: list[CarmenLines] = []
        parameters: list[tuple[int, bytes, bytes]] = []
        for word, some in lines.by_keyword().items():
            rows = np.array(some, np.int64)
            if word in wanted:
                messages.append(self._framed(word, rows, lines))
            elif word == PARAM:
                whole = rows[cells.count[rows] > 2]
                names, values = cells.column(whole, 1), cells.column(whole, 2)
                parameters += zip(whole.tolist(), names, values, strict=True)
            elif word and word[:1] != b"#":
                if not _WORD.fullmatch(word):
                    lines.bad += [(row, f"{shown(word)} is no message") for row in some]
                elif some[-1] == lines.cut and cells.count[some[-1]] == 1:
                    lines.bad.append((lines.cut, _CUT))
        return messages, parameters

    def _framed(self, word: bytes, rows: Int64, lines: LineBlock) -> CarmenLines:
        """Return the messages with one first word; lines that are none are bad."""
        cells, laser = lines.cells, LASERS.get(word)
        count = cells.count[rows]
        beams = np.zeros(len(rows), np.int64)
        causes: dict[int, str] = {}
        if laser is not None:
            beams, causes = _declared(cells, rows, laser)
        after = np.ones(len(rows), np.int64) if laser is None else laser.count + 1 + laser.width * beams
        refused = np.flatnonzero(beams > MAX_BEAMS).tolist()
        usual = None if laser is not None and laser.geometry else 6 if laser is None or laser.posed else 0
        time, behind = _times_at(cells, rows, count, after, usual)
        timeless = np.zeros(len(rows), np.bool_)
        if laser is not None:
            whole = np.ones(len(rows), np.bool_)
            whole[[*causes, *refused]] = False
            self._timed = self._timed or bool((whole & (behind >= 0)).any())
            if not self._timed:
                timeless = whole & _lacks_time_alone(cells, rows, after, laser)
                behind = np.where(timeless, count - after, behind)
        stamps, wrong = to_ns(cells.spans(rows, np.minimum(time, count - 1), 1), S)
        rest = np.where(timeless, 0, count - time)
        framed = CarmenLines(word, rows, np.where(timeless, 0, stamps), beams, after, behind, rest)
        if laser is not None:
            some = np.flatnonzero(whole & (behind >= 0))
            causes |= {int(some[at]): cause for at, cause in self._misfits(cells, laser, framed.of(some)).items()}
            if refused:
                self.report.refused[(laser.topic, TOO_MANY)] += len(refused)
        for at in np.flatnonzero(behind < 0).tolist():
            causes.setdefault(at, _NO_TIME)
        if len(rows) and rows[-1] == lines.cut and not _is_whole(cells, rows[-1:], count[-1:], after[-1:]):
            causes[len(rows) - 1] = _CUT
        for at in np.flatnonzero(wrong & ~timeless).tolist():
            causes.setdefault(at, _NO_TIME)
        if timeless.any() and _UNTIMED_LOG not in self.report.notes:
            self.report.notes.append(_UNTIMED_LOG)
        lines.bad += [(int(rows[at]), cause) for at, cause in causes.items() if at not in refused]
        good = np.ones(len(rows), np.bool_)
        good[[*causes, *refused]] = False
        framed = framed.of(good)
        return replace(framed, stamp_ns=self._distinct(word, framed.stamp_ns))

    def _distinct(self, word: bytes, stamps: Int64) -> Int64:
        """Return times of which each equal one is a nanosecond after the one before it, also across blocks."""
        if not len(stamps):
            return stamps
        last, times = self._last.get(word, (None, 0))
        again = np.concatenate([[int(stamps[0]) == last], stamps[1:] == stamps[:-1]])
        index = np.arange(1, len(stamps) + 1)
        run = index - np.maximum.accumulate(np.where(again, 0, index))
        # Equal times at the beginning of the block continue the run of the block before it.
        run += np.where(np.logical_and.accumulate(again), times - 1, 0)
        self._last[word] = int(stamps[-1]), int(run[-1]) + 1
        return stamps + run

    def _misfits(self, cells: Cells, laser: Laser, lines: CarmenLines) -> dict[int, str]:
        """Return the index of each sweep whose number of ranges must be wrong, and the reason."""
        causes: dict[int, str] = {}
        for at, (behind, beams, rest) in enumerate(
            zip(lines.behind.tolist(), lines.beams.tolist(), lines.rest.tolist(), strict=True)
        ):
            cause = ""
            if laser.geometry:
                cause = _misfit_with_geometry(cells, laser, lines, at)
            elif behind not in (_POSED if laser.posed else (0,)):
                cause = _misfit(behind - (_POSED[-1] if laser.posed else 0), beams)
            if not cause and rest > _TAIL:
                cause = _left_over(rest - _TAIL, beams)
            if cause:
                causes[at] = cause
        if laser.posed and not laser.geometry:
            for others in (self._unlike_most, _poses_among_ranges):
                fit = [at for at in range(len(lines.rows)) if at not in causes]
                misfits = others(cells, laser, lines.of(np.array(fit, np.int64)))
                causes |= {fit[at]: cause for at, cause in misfits.items()}
        return causes

    def _unlike_most(self, _: Cells, laser: Laser, lines: CarmenLines) -> dict[int, str]:
        """Return the lines with other fields behind the ranges than most of their kind that declare as many."""
        endings = self._endings.setdefault(laser.topic, Counter())
        kinds = list(zip(lines.beams.tolist(), lines.behind.tolist(), strict=True))
        endings.update(kinds)
        usual = {beams: max(_POSED, key=lambda behind: (endings[beams, behind], behind)) for beams, _ in set(kinds)}
        return {
            at: _misfit(behind - usual[beams], beams) for at, (beams, behind) in enumerate(kinds) if behind != usual[beams]
        }


def _declared(cells: Cells, rows: Int64, laser: Laser) -> tuple[Int64, dict[int, str]]:
    """Return the number of ranges (R,) that each line declares, and the reason for each line that cannot be so."""
    count = cells.count[rows]
    beams = np.zeros(len(rows), np.int64)
    causes = dict.fromkeys(np.flatnonzero(count <= laser.count).tolist(), _CUT)
    for index, cell in enumerate(cells.spans(rows, np.minimum(laser.count, count - 1), 1)):
        if index in causes:
            continue
        if (number := count_in(cell)) is None:
            causes[index] = f"{shown(cell)} is no number of ranges"
        else:
            beams[index] = number
    for index in np.flatnonzero(laser.count + 1 + laser.width * beams > count).tolist():
        causes.setdefault(index, f"it declares {beams[index]} ranges and has fewer")
    return beams, causes


def _left_over(cells: int, beams: int) -> str:
    """Return the cause for a line with `cells` more cells than it can have behind its ranges."""
    return f"{cells} field{'' if cells == 1 else 's'} left over behind the {beams} ranges it declares"


def _misfit(more: int, beams: int) -> str:
    """Return the cause for a line with `more` fields than usual, or fewer, behind its ranges."""
    if more > 0:
        return _left_over(more, beams)
    return f"it declares {beams} ranges, but {'one field is' if more == -1 else f'{-more} fields are'} missing"


def _misfit_with_geometry(cells: Cells, laser: Laser, lines: CarmenLines, at: int) -> str:
    """Return why a line with geometry cannot have the ranges that it declares; '' where it can."""
    beams, behind = int(lines.beams[at]), int(lines.behind[at])
    row, after = lines.rows[at : at + 1], int(lines.after[at])
    whole, shorter, bare = (_WHOLE, _SHORTER, _BARE) if laser.posed else (0, (0,), (0,))
    remissions = count_in(cells.spans(row, after, 1)[0]) if behind else None
    poses = -1 if remissions is None else behind - 1 - remissions
    if poses == whole:
        return ""
    # A number of remissions among the ranges, from which on all is as it should be, says how many there are.
    ranges = cells.spans(row, laser.count + 1, beams)[0].split(cells.separator) if beams else []
    for index in range(beams - 1, -1, -1):
        if count_in(ranges[index]) == beams + behind - whole - 1 - index:
            return f"it declares {beams} ranges and has {index}"
    return "" if poses in shorter or behind in bare else _left_over(behind, beams)


def _poses_among_ranges(cells: Cells, laser: Laser, lines: CarmenLines) -> dict[int, str]:
    """Return lines that all have poses in place of their last ranges: they declare more than they have."""
    causes: dict[int, str] = {}
    for behind in _POSED[:-1]:
        alike = lines.behind == behind
        some = np.flatnonzero(alike & (lines.after > laser.count + 2 * POSE))
        if len(some) and len(some) == np.count_nonzero(alike):
            part = lines.of(some)
            if _are_poses(cells, part.rows, part.after + behind, laser.count + 1):
                for at, beams in zip(some.tolist(), part.beams.tolist(), strict=True):
                    causes[at] = f"it declares {beams} ranges, but the last ones are poses"
    return causes


def _are_poses(cells: Cells, rows: Int64, end: Int64, first: int) -> bool:
    """Return whether the six cells before `end` of all rows are two poses: equal ones, or spelled unlike the ranges."""
    both = 2 * POSE
    numbers = cells.numbers(rows, end - both, np.full(len(rows), both), np.float64)
    if numbers.bad:
        return False
    table = numbers.values.reshape(-1, both)
    same = (table[:, :POSE] == table[:, POSE:]).all()
    # Three equal numbers are ranges as well.
    if same and (table[:, :1] != table[:, 1:POSE]).any():
        return True
    rows, end = rows[:_SAMPLE], end[:_SAMPLE]
    ranges, poses = (
        {len(cell.partition(b".")[2]) for part in parts for cell in part.split(cells.separator)}
        for parts in (cells.spans(rows, first, end - both - first), cells.spans(rows, end - both, both))
    )
    return len(ranges) == len(poses) == 1 and ranges != poses


def _times_at(cells: Cells, rows: Int64, count: Int64, after: Int64, usual: int | None) -> tuple[Int64, Int64]:
    """Find the cell of each line that holds its time, and the number of cells between `after` and it.

    The name of the host, which is no number, follows the time: some writers leave out the time behind it, old ones also
    some fields before it. Without a host the time is where the `usual` number of fields puts it. The number is -1, and
    the cell 0, where a line has no time.
    """
    left = count - after
    most = count - 1
    second, third = cells.spans(rows, most, 1), cells.spans(rows, np.maximum(most - 1, 0), 1)
    time = np.empty(len(rows), np.int64)
    for at, (end, before) in enumerate(zip(second, third, strict=True)):
        if not is_number(before) and left[at] >= _TAIL:
            time[at] = count[at] - _TAIL
        elif not is_number(end) and left[at] >= _TAIL - 1:
            time[at] = count[at] - _TAIL + 1
        elif usual is None:
            time[at] = count[at] - _TAIL
        else:
            time[at] = after[at] + usual if left[at] > usual else -1
    behind = np.where((time >= after) & (time < count), time - after, -1)
    return np.where(behind < 0, 0, time), behind


def _lacks_time_alone(cells: Cells, rows: Int64, after: Int64, laser: Laser) -> Bool:
    """(R,) True for sweeps that end with poses, or with ranges where they have no poses."""
    lacks = np.zeros(len(rows), np.bool_)
    if laser.geometry:
        return lacks
    left = cells.count[rows] - after
    for at in np.flatnonzero(np.isin(left, _POSED if laser.posed else (0,))).tolist():
        text = cells.spans(rows[at : at + 1], after[at : at + 1], left[at : at + 1])[0]
        numbers = text.split(b" ") if left[at] else []
        lacks[at] = all(map(is_number, numbers)) and all(abs(float(yaw)) <= TURN for yaw in numbers[2::3])
    return lacks


def _is_whole(cells: Cells, rows: Int64, count: Int64, after: Int64) -> bool:
    """Return whether a line without a line end has a time behind its host: all before these is whole then."""
    if count[0] - after[0] < _TAIL:
        return False
    host, logger = cells.spans(rows, count - 2, 1)[0], cells.spans(rows, count - 1, 1)[0]
    return not is_number(host) and is_number(logger)


def has_pose(line: bytes, laser: Laser) -> bool:
    """Return whether there is room for a pose between the ranges of a line and its end."""
    head = line[:_LONGEST_HEAD].split(None, laser.count + 1)[laser.count : laser.count + 1]
    beams = count_in(head[0]) if head else None
    return beams is not None and len(line.split()) >= laser.count + 1 + laser.width * beams + POSE + _TAIL
