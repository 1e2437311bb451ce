"""The lines of CARMEN logs: their kinds, the number of ranges in each, and where its time is.

Writers of many years differ: some declare more ranges than they write, leave out fields behind the ranges, or end lines
early. A line is read only where its fields leave no doubt which of them are ranges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.blocks import TOO_MANY
from lidarcli.logs.lines import CUT, POSE, WITHOUT_TIMES, DistinctTimes, Framed, LineBlock, count_in, is_number, left_over
from lidarcli.logs.numbers import Cells, say
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import TURN, Bool, Int64

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

_WORD = re.compile(rb"[A-Za-z_]\w{0,63}")
"""First word of a message of another program, which is skipped."""
_LONGEST_HEAD = 1024
"""Bytes at the start of a line in which the number of ranges stands."""
_NO_TIME = "no time at its end"

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


@dataclass(frozen=True, eq=False, slots=True)
class CarmenLines(Framed[bytes]):
    """R lines with one first word; those of poses have no ranges."""

    behind: Int64
    """(R,) Cells from the last range to the time; -1 where a line has no time."""
    rest: Int64
    """(R,) Cells from the time on."""


@dataclass(slots=True)
class Framing:
    """Finds ranges and times of the lines of one log, block after block."""

    report: ReadReport
    distinct: DistinctTimes
    _seen: dict[str, Counter[tuple[int, int]]] = field(default_factory=dict)
    """Topic → numbers of lines so far, by their ranges and the fields behind these."""
    _timed: bool = False
    """True once a sweep has had a time."""

    def read(self, lines: LineBlock, wanted: Collection[bytes]) -> tuple[list[CarmenLines], list[tuple[int, bytes, bytes]]]:
        """Return the wanted messages of a block, and its parameters: row, name and value."""
        cells = lines.cells
        found: list[CarmenLines] = []
        parameters: list[tuple[int, bytes, bytes]] = []
        for word, some in lines.by_keyword().items():
            rows = np.array(some, np.int64)
            if word in wanted:
                found.append(self._framed(word, rows, lines))
            elif word == PARAM:
                whole = rows[cells.count[rows] > 2]
                names, values = cells.column(whole, 1), cells.column(whole, 2)
                parameters += zip(whole.tolist(), names, values, strict=True)
            elif word and word[:1] != b"#":
                if not _WORD.fullmatch(word):
                    lines.bad += [(row, f"{say(word)} is no message") for row in some]
                elif some[-1] == lines.cut and cells.count[some[-1]] == 1:
                    lines.bad.append((lines.cut, CUT))
        return found, parameters

    def _framed(self, word: bytes, rows: Int64, lines: LineBlock) -> CarmenLines:
        """Return the messages with one first word; lines that are none are bad."""
        cells, laser = lines.cells, LASERS.get(word)
        count = cells.count[rows]
        beams = np.zeros(len(rows), np.int64)
        after = np.ones(len(rows), np.int64)
        causes: dict[int, str] = {}
        refused: set[int] = set()
        whole = np.ones(len(rows), np.bool_)
        if laser is not None:
            told = lines.declared(rows, laser.count, laser.width)
            beams, after, causes, refused = told.beams, told.after, told.causes, told.refused
            whole = told.sound
        usual = None if laser is not None and laser.geometry else 6 if laser is None or laser.posed else 0
        time, behind = _times_at(cells, rows, count, after, usual)
        timeless = np.zeros(len(rows), np.bool_)
        if laser is not None:
            self._timed = self._timed or bool((whole & (behind >= 0)).any())
            if not self._timed:
                timeless = whole & _lacks_time_alone(cells, rows, after, laser)
                behind = np.where(timeless, count - after, behind)
        stamps, wrong = to_ns(cells.spans(rows, np.minimum(time, count - 1), 1), S)
        rest = np.where(timeless, 0, count - time)
        found = CarmenLines(word, rows, np.where(timeless, 0, stamps), beams, after, behind, rest)
        if laser is not None:
            some = np.flatnonzero(whole & (behind >= 0))
            doubts = self._doubts(cells, laser, found.of(some))
            causes |= {int(some[at]): cause for at, cause in doubts.items()}
        for at in np.flatnonzero(behind < 0).tolist():
            causes.setdefault(at, _NO_TIME)
        if len(rows) and rows[-1] == lines.cut and not _is_whole(cells, rows[-1:], count[-1:], after[-1:]):
            causes[len(rows) - 1] = CUT
        for at in np.flatnonzero(wrong & ~timeless).tolist():
            causes.setdefault(at, _NO_TIME)
        if timeless.any() and WITHOUT_TIMES not in self.report.notes:
            self.report.notes.append(WITHOUT_TIMES)
        if laser is not None and refused:
            self.report.refused[(laser.topic, TOO_MANY)] += len(refused)
        lines.bad += [(int(rows[at]), cause) for at, cause in causes.items() if at not in refused]
        good = np.ones(len(rows), np.bool_)
        good[[*causes, *refused]] = False
        found = found.of(good)
        return replace(found, stamp_ns=self.distinct.of(word, found.stamp_ns))

    def _doubts(self, cells: Cells, laser: Laser, found: CarmenLines) -> dict[int, str]:
        """Return the index of each sweep whose number of ranges must be wrong, and the reason."""
        causes: dict[int, str] = {}
        for at, (behind, beams, rest) in enumerate(
            zip(found.behind.tolist(), found.beams.tolist(), found.rest.tolist(), strict=True)
        ):
            cause = ""
            if laser.geometry:
                cause = _doubt_whole(cells, laser, found, at)
            elif behind not in (_POSED if laser.posed else (0,)):
                cause = _misfit(behind - (_POSED[-1] if laser.posed else 0), beams)
            if not cause and rest > _TAIL:
                cause = left_over(rest - _TAIL, beams)
            if cause:
                causes[at] = cause
        if laser.posed and not laser.geometry:
            for doubt in (self._doubt_others, _doubt_all):
                fit = [at for at in range(len(found.rows)) if at not in causes]
                doubts = doubt(cells, laser, found.of(np.array(fit, np.int64)))
                causes |= {fit[at]: cause for at, cause in doubts.items()}
        return causes

    def _doubt_others(self, _: Cells, laser: Laser, found: CarmenLines) -> dict[int, str]:
        """Doubt lines with other fields behind the ranges than most of their kind that declare as many."""
        seen = self._seen.setdefault(laser.topic, Counter())
        kinds = list(zip(found.beams.tolist(), found.behind.tolist(), strict=True))
        seen.update(kinds)
        usual = {beams: max(_POSED, key=lambda behind: (seen[beams, behind], behind)) for beams, _ in set(kinds)}
        return {
            at: _misfit(behind - usual[beams], beams) for at, (beams, behind) in enumerate(kinds) if behind != usual[beams]
        }


def _misfit(more: int, beams: int) -> str:
    """Return the cause for a line with `more` fields than usual, or fewer, behind its ranges."""
    if more > 0:
        return left_over(more, beams)
    return f"it declares {beams} ranges, but {'one field is' if more == -1 else f'{-more} fields are'} missing"


def _doubt_whole(cells: Cells, laser: Laser, found: CarmenLines, at: int) -> str:
    """Return why a line with geometry cannot have the ranges that it declares; '' where it can."""
    beams, behind = int(found.beams[at]), int(found.behind[at])
    row, after = found.rows[at : at + 1], int(found.after[at])
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
    return "" if poses in shorter or behind in bare else left_over(behind, beams)


def _doubt_all(cells: Cells, laser: Laser, found: CarmenLines) -> dict[int, str]:
    """Doubt lines that all have poses in place of their last ranges: they declare more than they have."""
    causes: dict[int, str] = {}
    for behind in _POSED[:-1]:
        alike = found.behind == behind
        some = np.flatnonzero(alike & (found.after > laser.count + 2 * POSE))
        if len(some) and len(some) == np.count_nonzero(alike):
            part = found.of(some)
            if _are_poses(cells, part.rows, part.after + behind, laser.count + 1):
                for at, beams in zip(some.tolist(), part.beams.tolist(), strict=True):
                    causes[at] = f"it declares {beams} ranges, but the last ones are poses"
    return causes


def _are_poses(cells: Cells, rows: Int64, end: Int64, first: int) -> bool:
    """Tell whether the six cells before `end` of all rows are two poses: equal ones, or spelled unlike the ranges."""
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
    found = np.zeros(len(rows), np.bool_)
    if laser.geometry:
        return found
    left = cells.count[rows] - after
    for at in np.flatnonzero(np.isin(left, _POSED if laser.posed else (0,))).tolist():
        text = cells.spans(rows[at : at + 1], after[at : at + 1], left[at : at + 1])[0]
        numbers = text.split(b" ") if left[at] else []
        found[at] = all(map(is_number, numbers)) and all(abs(float(yaw)) <= TURN for yaw in numbers[2::3])
    return found


def _is_whole(cells: Cells, rows: Int64, count: Int64, after: Int64) -> bool:
    """Tell whether a line without a line end has a time behind its host: all before these is whole then."""
    if count[0] - after[0] < _TAIL:
        return False
    host, logger = cells.spans(rows, count - 2, 1)[0], cells.spans(rows, count - 1, 1)[0]
    return not is_number(host) and is_number(logger)


def has_pose(line: bytes, laser: Laser) -> bool:
    """Tell whether there is room for a pose between the ranges of a line and its end."""
    head = line[:_LONGEST_HEAD].split(None, laser.count + 1)[laser.count : laser.count + 1]
    beams = count_in(head[0]) if head else None
    return beams is not None and len(line.split()) >= laser.count + 1 + laser.width * beams + POSE + _TAIL
