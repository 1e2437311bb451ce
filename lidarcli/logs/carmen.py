"""CARMEN logs (`.log`, `.clf`, `.gfs`, also packed with gzip): sweeps, poses, and the parameters that describe lasers.

Writers of many years differ: some declare more ranges than they write, leave out fields behind the ranges, or end lines
early. A line is read only where its fields leave no doubt which of them are ranges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import unreadable
from lidarcli.logs.base import LASERSCAN, MAX_BEAMS, PLANAR, PLANAR_POSE, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import (
    TOO_MANY,
    as_singles,
    given_geometries,
    given_geometry,
    keep_sound,
    limits_in_metres,
    pad,
    split_rows,
)
from lidarcli.logs.cells import Cells, S, not_a_number, pad_cells, shown, to_ns
from lidarcli.logs.text import TextBlock, TextLog, TextSource
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int64, RawSweeps

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

_ODD_BLANKS = re.compile(rb"[\t\f\v]|  | \n|\n ")
_TO_BLANKS = bytes.maketrans(b"\t\f\v", b"   ")
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_MAX_DIGITS = 7
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
    return int(cell) if cell.isdigit() and len(cell) <= _MAX_DIGITS else None


@dataclass(slots=True)
class LineBlock:
    """The lines of a block of text while they are decoded."""

    cells: Cells
    line: int
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


@dataclass(frozen=True, eq=False, slots=True)
class CarmenLines:
    """R lines with one first word, in the order of the log; those of poses have no ranges."""

    word: bytes
    rows: Int64
    """(R,) Lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) Times; of equal ones that follow each other each is a nanosecond after the one before it."""
    beams: Int64
    after: Int64
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
            fit = [at for at in range(len(lines.rows)) if at not in causes]
            misfits = self._unlike_most(laser, lines.of(np.array(fit, np.int64)))
            causes |= {fit[at]: cause for at, cause in misfits.items()}
        return causes

    def _unlike_most(self, laser: Laser, lines: CarmenLines) -> dict[int, str]:
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


def _times_at(cells: Cells, rows: Int64, count: Int64, after: Int64, usual: int | None) -> tuple[Int64, Int64]:
    """Return the cell of each line with its time, and the cells between `after` and it: 0 and -1 where it has no time."""
    # The name of the host, which is no number, follows the time: some writers leave out the time behind it, old ones also
    # some fields before it. Without a host the time is where the `usual` number of fields puts it.
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


ROBOT = "base_link"
ODOMETRY, MOUNTS = "/odom", "/tf_static"
"""Topics of the robot's pose by its wheels, and of the mounts of its lasers."""


CORRECTED, TRUE = "/corrected", "/truepos"
TYPES = {
    ODOMETRY: "nav_msgs/msg/Odometry",
    CORRECTED: "geometry_msgs/msg/PoseStamped",
    TRUE: "geometry_msgs/msg/PoseStamped",
    MOUNTS: "tf2_msgs/msg/TFMessage",
}
"""Topic → its type. Poses are taken from the odometry unless the user asks for others."""
MAX_RANGE = 80.0
"""Greatest range [m] of a sweep whose line has none: SICK lasers write greater ones for no return.

The parameters `robot_front_laser_max` and `robot_rear_laser_max` are no such limit: they are the range up to which programs
of the robot used returns, and lines also hold what was measured beyond. A range of just this value is cut off.
"""
_GEOMETRY = 2
"""Cell with the first bearing; view, step and greatest range follow."""
_ROUNDED = 6e-7
"""Greatest error [rad] of a step with six decimals."""

_PARAMETERS = {
    (frame, what): pattern.format(name).encode()
    for frame, name in {FRONT: "front", REAR: "rear"}.items()
    for what, pattern in {
        "fov": "laser_{}_laser_fov",
        "resolution": "laser_{}_laser_resolution",
        "max": "robot_{}_laser_max",
        "forward": "robot_{}laser_offset",
        "side": "robot_{}laser_side_offset",
        "angular": "robot_{}laser_angular_offset",
    }.items()
}
"""Frame and quantity → name of the parameter. Views and steps are degrees, offsets metres and radians."""
_KNOWN = frozenset(_PARAMETERS.values())
_STARTS_NUMBER = re.compile(rb"[-+.\d]")

_STEPS = {181: 1.0, 180: 1.0, 361: 0.5, 360: 0.5, 401: 0.25, 400: 0.25}
"""Ranges → degrees from beam to beam of the SICK lasers that wrote logs without geometry."""
_WITHOUT_LAST = [beams for beams in _STEPS if beams % 2 == 0]
_FIRST = {401: -50.0, 400: -50.0}
"""Ranges → first bearing [degrees]; -90 for all others."""
_SLACK = 1.5
"""Greatest difference between the number of ranges and that of view and step."""

_FARTHEST = 2.0
"""Greatest distance of a laser from the middle of its robot [m]."""
_SAME = 1e-6
"""Greatest difference [m, rad] between poses of laser and robot that are one pose."""
_ALIKE = 0.01
"""Greatest change of a laser's place on its robot [m, rad]; with a greater one its pose has been corrected."""
_LONGEST_WORD = 17


class CarmenLog(TextLog):
    """A CARMEN log."""

    format = "carmen"
    _topics: list[Topic] | None = None
    _posed = False

    def topics(self) -> list[Topic] | None:
        """Return the topics by the first words of all lines, which are read once for it; None for a stream."""
        if self._topics is None and not self._once:
            with unreadable(self.path), Path(self.path).open("rb") as file:
                self._topics = self._count(TextSource(file, self.size).blocks())
        return self._topics

    def _count(self, blocks: Iterator[TextBlock]) -> list[Topic]:
        counts = dict.fromkeys((*LASERS, ODOM, TRUEPOS), 0)
        with_pose: set[bytes] = set()
        unsure = {word for word, laser in LASERS.items() if laser.posed}
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:_LONGEST_WORD].split(None, 1)
                if not first or first[0] not in counts:
                    continue
                counts[first[0]] += 1
                if first[0] in unsure and has_pose(line, LASERS[first[0]]):
                    with_pose.add(first[0])
                    unsure.discard(first[0])
        self._posed = bool(with_pose)
        posed = sum(counts[word] for word in with_pose)
        scans = [Topic(each.topic, LASERSCAN, self.format, counts[word]) for word, each in LASERS.items() if counts[word]]
        poses = {ODOMETRY: posed or counts[ODOM], CORRECTED: posed, TRUE: counts[TRUEPOS]}
        topics = [*scans, *(Topic(name, TYPES[name], self.format, count) for name, count in poses.items() if count)]
        return [*topics, Topic(MOUNTS, TYPES[MOUNTS], self.format)] if scans and poses[ODOMETRY] else topics

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        decoder = _Decoder(
            self._options, report, {word for word, one in LASERS.items() if topics is None or one.topic in topics}
        )
        for block in blocks:
            yield from decoder.sweeps(block)

    def _poses(self, blocks: Iterator[TextBlock], types: Collection[str], report: ReadReport) -> Iterator[Message]:
        # Where sweeps hold the robot's poses, other lines of odometry are skipped.
        self.topics()
        decoder = _Decoder(self._options, report, {*LASERS, TRUEPOS, *([] if self._posed else [ODOM])})
        for block in blocks:
            yield from decoder.poses(block, types)
        if TYPES[MOUNTS] in types:
            yield from decoder.mounts()


def planar_messages(topic: str, parent: str, child: str, stamp_ns: Int64, poses: NDArray[np.floating]) -> list[Message]:
    """Return poses (K, 3) of a child frame in its parent, x, y [m], yaw [rad], as messages."""
    records = np.empty(len(stamp_ns), PLANAR_POSE)
    records["stamp_ns"] = stamp_ns
    records["x"], records["y"], records["yaw"] = poses.T
    names = f"{parent}\0{child}".encode()
    times = zip(records, stamp_ns.tolist(), strict=True)
    return [Message(topic, TYPES[topic], PLANAR, stamp, pose.tobytes() + names) for pose, stamp in times]


class _Parameters:
    """Values of parameters; each holds for the lines after it, until the next one of its name."""

    def __init__(self) -> None:
        self._values: dict[bytes, tuple[list[int], list[float]]] = {}
        """Name → lines and values: those of the last block, and of earlier blocks the last one."""

    def add(self, first_line: int, parameters: list[tuple[int, bytes, bytes]]) -> None:
        """Take row, name and value of the parameters of a block; those without a number count for nothing."""
        for lines, values in self._values.values():
            del lines[:-1], values[:-1]
        for row, name, value in parameters:
            if name in _KNOWN and _STARTS_NUMBER.match(value) and is_number(value):
                lines, values = self._values.setdefault(name, ([], []))
                lines.append(first_line + row)
                values.append(float(value))

    def at(self, frame: str, what: str, lines: Int64) -> Float64:
        """(R,) Value of a parameter at each line; NaN before the first one."""
        places, values = self._values.get(_PARAMETERS.get((frame, what), b""), ([], []))
        return np.array([np.nan, *values])[np.searchsorted(np.array(places, np.int64), lines)]

    def last(self, frame: str, what: str) -> float | None:
        """Return the latest value of a parameter; None without any."""
        _, values = self._values.get(_PARAMETERS.get((frame, what), b""), ([], []))
        return values[-1] if values else None


@dataclass
class _Decoder:
    """Decodes the lines of a log in one pass, block after block."""

    options: OpenOptions
    report: ReadReport
    wanted: set[bytes]
    parameters: _Parameters = field(default_factory=_Parameters)
    first_ns: dict[str, int] = field(default_factory=dict)
    """Frame of each laser → stamp of its first sweep, in a pass for poses."""
    _noted: set[str] = field(default_factory=set)
    _mounts: dict[str, tuple[Float64, float]] = field(default_factory=dict)
    """Frame of a laser → its place on the robot by the first poses of both, and the greatest change since [m, rad]."""

    def __post_init__(self) -> None:
        self._framing = Framing(self.report)

    def _read(self, block: TextBlock) -> tuple[LineBlock, list[CarmenLines]]:
        """Find the wanted messages of a block; keep the parameters of lasers."""
        lines = LineBlock.of(block)
        messages, parameters = self._framing.read(lines, self.wanted)
        self.parameters.add(lines.line, parameters)
        lines.report_bad(self.report)
        return lines, [some for some in messages if len(some.rows)]

    def sweeps(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, topic by topic."""
        lines, messages = self._read(block)
        for some in messages:
            for part in split_rows(some.beams):
                sweeps = self._decode(lines, some.of(part))
                lines.report_bad(self.report)
                if sweeps is not None:
                    yield sweeps

    def _decode(self, lines: LineBlock, messages: CarmenLines) -> RawSweeps | None:
        laser, rows, beams, scale = LASERS[messages.word], messages.rows, messages.beams, self.options.range_scale
        number = np.float32 if scale == 1.0 else np.float64
        values = lines.cells.numbers(rows, laser.count + 1, laser.width * beams, number)
        bad = values.bad
        if laser.geometry:
            declared = lines.cells.numbers(rows, _GEOMETRY, np.full(len(rows), 4), np.float64)
            bad = bad | declared.bad
            first, step, most = _of_lines(declared.values.reshape(-1, 4), beams)
        else:
            first, step = self._of_parameters(laser, rows + lines.line, beams)
            most = np.full(len(rows), MAX_RANGE)
        lines.bad = [(int(rows[at]), not_a_number(cell)) for at, cell in bad.items()]
        good = np.ones(len(rows), np.bool_)
        good[list(bad)] = False
        ranges = pad(values.values[:: laser.width], beams, scale)
        if not laser.geometry:
            cut = self.parameters.at(laser.frame, "max", rows + lines.line)
            ranges[ranges == as_singles(cut * scale)[:, None]] = np.inf
        options = self.options
        options.used.add("range_max")
        if given_geometry(options, 2) is not None:
            first, step = given_geometries(options, beams)
        if options.angle_increment is not None:
            step = np.full(len(beams), options.angle_increment)
        if options.angle_min is not None:
            first = np.full(len(beams), options.angle_min)
        limits = limits_in_metres(np.zeros(len(rows)), most, scale)
        block = RawSweeps(
            topic=laser.topic,
            frame_ids=(laser.frame,),
            frame=np.zeros(len(rows), np.int32),
            stamp_ns=messages.stamp_ns,
            record_ns=messages.stamp_ns,
            angle_min=first,
            angle_increment=step,
            range_min=limits[0],
            range_max=limits[1] if options.range_max is None else as_singles(np.full(len(rows), options.range_max)),
            beams=beams.astype(np.int32),
            ranges=ranges,
            intensities=_remissions(lines.cells, laser, messages, values.values),
        )
        return keep_sound(block, good, self.report)

    def _of_parameters(self, laser: Laser, lines: Int64, beams: Int64) -> tuple[Float64, Float64]:
        """Return first bearings and steps of sweeps whose lines have none."""
        fov, resolution = (self.parameters.at(laser.frame, what, lines) for what in ("fov", "resolution"))
        first, step, guessed = bearings_of(beams, fov, resolution)
        if guessed.any() and laser.topic not in self._noted and given_geometry(self.options, 2) is None:
            self._noted.add(laser.topic)
            row = int(np.argmax(guessed))
            degrees = np.degrees([first[row], step[row]])
            self.report.notes.append(
                f"{laser.topic}: {beams[row]} beams taken from {degrees[0]:g} degrees by {degrees[1]:.4g}: no bearings "
                "(--angle-min, --angle-increment)"
            )
        return first, step

    def poses(self, block: TextBlock, types: Collection[str]) -> Iterator[Message]:
        """Yield the poses of a block of the given types, in the order of its lines."""
        lines, found = self._read(block)
        messages: list[tuple[int, Message]] = []
        for some in found:
            if some.word in LASERS:
                self.first_ns.setdefault(LASERS[some.word].frame, int(some.stamp_ns[0]))
            for rows, poses in self._poses_of(lines, some):
                if poses and poses[0].type in types:
                    messages += zip(rows.tolist(), poses, strict=True)
        lines.report_bad(self.report)
        for _, message in sorted(messages, key=lambda one: one[0]):
            yield message

    def _poses_of(self, lines: LineBlock, messages: CarmenLines) -> Iterator[tuple[Int64, list[Message]]]:
        """Decode the poses of robot and laser."""

        def read(some: CarmenLines, count: int) -> tuple[CarmenLines, Float64]:
            parsed = lines.cells.numbers(some.rows, some.after, np.full(len(some.rows), count), np.float64)
            lines.bad += [(int(some.rows[at]), "its pose: " + not_a_number(cell)) for at, cell in parsed.bad.items()]
            lines.report_bad(self.report)
            good = np.delete(np.arange(len(some.rows)), list(parsed.bad))
            return some.of(good), parsed.values.reshape(-1, count)[good]

        def track(topic: str, parent: str, child: str, some: CarmenLines, poses: Float64) -> tuple[Int64, list[Message]]:
            return some.rows, planar_messages(topic, parent, child, some.stamp_ns, poses)

        if messages.word in (ODOM, TRUEPOS):
            topic, world = (ODOMETRY, "odom") if messages.word == ODOM else (TRUE, "world")
            yield track(topic, world, ROBOT, *read(messages.of(messages.behind >= POSE), POSE))
            return
        laser = LASERS[messages.word]
        if not laser.posed:
            return
        # Remissions and their number stand before the poses; old writers have left them out.
        if laser.geometry:
            count = _remission_counts(lines.cells, messages)
            skip = np.where((count >= 0) & (count + 1 + 2 * POSE <= messages.behind), count + 1, 0)
            messages = replace(messages, after=messages.after + skip, behind=messages.behind - skip)
        both = messages.behind >= 2 * POSE
        whole, poses = read(messages.of(both), 2 * POSE)
        if len(poses):
            self._compare(laser.frame, poses)
            yield track(CORRECTED, "map", laser.frame, whole, poses[:, :POSE])
            yield track(ODOMETRY, "odom", ROBOT, whole, poses[:, POSE:])
        whole, poses = read(messages.of((messages.behind >= POSE) & ~both), POSE)
        if len(poses):
            # In logs of old writers no other line says where the robot was.
            yield track(ODOMETRY, "odom", laser.frame, whole, poses)

    def _compare(self, frame: str, poses: Float64) -> None:
        """Keep the place of a laser on its robot by poses (K, 6) of both, and how much it changes."""
        poses = poses[(np.abs(poses) < 1e9).all(axis=1)]
        if not len(poses):
            return
        dx, dy = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
        cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
        turn = wrapped(poses[:, 2] - poses[:, 5])
        mounts = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn])
        first, spread = self._mounts.get(frame, (mounts[0], 0.0))
        off = mounts - first
        off[:, 2] = wrapped(off[:, 2])
        far = float(np.abs(mounts[:, :2]).max()) > _FARTHEST
        self._mounts[frame] = first, np.inf if far else max(spread, float(np.abs(off).max()))

    def mounts(self) -> Iterator[Message]:
        """Yield the mounts of the lasers that had sweeps, once the whole log is read."""
        for frame, stamp_ns in self.first_ns.items():
            if (pose := self._mount(frame)) is not None:
                yield from planar_messages(MOUNTS, ROBOT, frame, np.array([stamp_ns]), np.array([pose]))

    def _mount(self, frame: str) -> Sequence[float] | None:
        """Return x, y [m] and yaw [rad] of a laser by parameters, else by the poses of laser and robot."""
        offsets = [self.parameters.last(frame, what) for what in ("forward", "side", "angular")]
        pose: list[float] | None = None
        if any(offset is not None for offset in offsets):
            pose = [offset or 0.0 for offset in offsets]
            # A rear laser looks backwards, unless its angle is given and says so itself.
            if frame == REAR and abs(pose[2]) < 0.5 * np.pi:
                pose[2] += np.pi
        place, spread = self._mounts.get(frame, (np.zeros(3), np.inf))
        # Where lines have one pose for both, whoever wrote them took no notice of the parameters.
        same = frame == FRONT and float(np.abs(place).max()) <= _SAME
        if spread <= _ALIKE and (pose is None or same):
            pose = list(place)
        return pose


def wrapped(angle: Float64) -> Float64:
    """Return angles [rad] between -π and π.

    >>> wrapped(np.array([6.0])).round(3).tolist()
    [-0.283]
    """
    within: Float64 = (angle + np.pi) % TURN - np.pi
    return within


def _remission_counts(cells: Cells, messages: CarmenLines) -> Int64:
    """(R,) Count in the cell behind the ranges of each message; -1 where there is none."""
    counts = [count_in(cell) for cell in cells.spans(messages.rows, messages.after, np.minimum(messages.behind, 1))]
    return np.array([-1 if count is None else count for count in counts], np.int64)


def _remissions(cells: Cells, laser: Laser, messages: CarmenLines, ranges: NDArray[np.floating]) -> Float32 | None:
    """(S, B) Remissions, which follow each of the `ranges`, or all of them with their number first; None without any."""
    beams = messages.beams
    if laser.pairs:
        return pad(ranges[1::2], beams, 1.0) if len(ranges) else None
    if not laser.geometry:
        return None
    count = _remission_counts(cells, messages)
    count = np.where(count < messages.behind, np.clip(count, 0, beams), 0)
    if not count.any():
        return None
    return pad_cells(cells, messages.rows, messages.after + 1, count, int(beams.max()))


def _of_lines(geometry: Float64, beams: Int64) -> tuple[Float64, Float64, Float64]:
    """Return first bearings, steps [rad] and greatest ranges [m] by lines (S, 4): first bearing, view, step, range."""
    # The view has all the digits that a rounded step lacks: its part for each beam is the step where it is that of the
    # ranges, or of one more. Bearings are guessed where view and step are zero.
    first, view, step, most = geometry.T
    nothing = (view == 0.0) & (step == 0.0)
    gaps = np.maximum(beams - 1, 1)
    parts = np.stack([view / gaps, view / np.maximum(beams, 1)])
    off = np.abs(parts - step)
    nearest = np.take_along_axis(parts, np.argmin(off, axis=0)[None], axis=0)[0]
    step = np.where(off.min(axis=0) < _ROUNDED, nearest, np.where(step == 0.0, view / gaps, step))
    if nothing.any():
        none = np.full(len(beams), np.nan)
        guessed_first, guessed_step, _ = bearings_of(beams, none, none)
        first, step = np.where(nothing, guessed_first, first), np.where(nothing, guessed_step, step)
    with np.errstate(invalid="ignore"):
        return first, step, np.where(most > 0, most, MAX_RANGE)


def bearings_of(beams: Int64, fov: Float64, resolution: Float64) -> tuple[Float64, Float64, Bool]:
    """Return first bearings and steps of sweeps whose lines have none.

    Parameters
    ----------
    beams : (R,) ranges of each sweep
    fov, resolution : (R,) view and step by parameters [degrees]; NaN without

    Returns
    -------
    first, step : (R,) [rad]
    guessed : (R,) True where parameters say nothing, or contradict the number of ranges
    """
    gaps = np.maximum(beams - 1, 1)
    with np.errstate(all="ignore"):
        fov, resolution = np.where(fov > 0, fov, np.nan), np.where(resolution > 0, resolution, np.nan)
        steps = fov / resolution
    fits = ~(np.abs(steps - beams + 0.5) >= _SLACK)
    by_step = np.isfinite(resolution) & fits
    by_view = np.isfinite(fov) & fits
    # 180 beams of a degree are those of half a turn without its last one.
    half = np.abs(beams * resolution - 180.0) < 1e-6
    view = np.where(by_view, fov, np.where(half, 180.0, gaps * resolution))
    distinct, inverse = np.unique(beams, return_inverse=True)
    guesses = [(_STEPS.get(count, 180.0 / max(count - 1, 1)), _FIRST.get(count, -90.0)) for count in distinct.tolist()]
    guessed_step, guessed_first = np.array(guesses, np.float64).reshape(-1, 2)[inverse.ravel()].T
    known = by_step | by_view
    step = np.where(by_step, resolution, view / np.where(np.isin(beams, _WITHOUT_LAST), beams, gaps))
    step = np.where(known, step, guessed_step)
    first = np.where(known, -0.5 * view, guessed_first)
    return np.radians(first), np.radians(step), ~known
