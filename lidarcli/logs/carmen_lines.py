"""The lines of a CARMEN log: which of their fields are ranges, remissions, poses and times, and which lines are damage.

A line is a word, the number of ranges, the ranges, fields that depend on the word, the time, the host and the time of
logging. Writers of many years differ: some declare more ranges than they write, leave out fields behind the ranges, or end
lines early. A line is read only where its fields leave no doubt which of them are ranges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import lru_cache

from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.blocks import TOO_MANY
from lidarcli.logs.cells import S, shown, to_ns
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps.types import TURN

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
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]\w{0,63}")
"""First word of a message of another program, which is skipped."""
_CUT, _NO_TIME = "cut off", "no time at its end"
_UNTIMED_LOG = "no time in the log: all stamps are 0"

_TAIL = 3
"""Fields at the end of a complete line: ipc_timestamp, ipc_hostname and logger_timestamp."""
_POSED = (0, POSE, 2 * POSE)
"""Fields behind the ranges: none, the pose of the laser, or also that of the robot."""
_COMPLETE = 11
"""Fields behind ranges and remissions of a line with geometry: both poses, and how the robot moved."""
_SHORTER = (*_POSED, 7, 8, 9, 10, _COMPLETE)
"""Numbers of such fields in lines of old writers, behind a number of remissions."""
_BARE = (*_POSED, _COMPLETE)
"""Numbers of such fields in lines without a number of remissions."""

VIEW = ("laser_{}_laser_fov", "laser_{}_laser_resolution")
"""Parameters with the view and the step [degrees] of a laser."""
CUT_AT = "robot_{}_laser_max"
OFFSETS = ("robot_{}laser_offset", "robot_{}laser_side_offset", "robot_{}laser_angular_offset")
"""Parameters with the place of a laser on its robot [m, m, rad]."""
_KNOWN = {
    name.format(side).encode(): (frame, name)
    for frame, side in {FRONT: "front", REAR: "rear"}.items()
    for name in (*VIEW, CUT_AT, *OFFSETS)
}
"""Name of a parameter → frame of the laser that it describes, and name without this."""
_STARTS_NUMBER = re.compile(rb"[-+.\d]")


class LineError(ValueError):
    """A line that is no message; the text is the cause."""


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
    return int(cell) if cell.isdigit() and len(cell) < 8 else None


@dataclass(slots=True)
class CarmenLine:
    """A line with a sweep or a pose."""

    number: int
    head: list[bytes]
    """Fields before the number of ranges."""
    ranges: list[bytes]
    """Ranges, with the remissions that follow each."""
    beams: int
    tail: list[bytes]
    """Fields between the ranges and the time."""
    time: bytes | None
    parameters: dict[tuple[str, str], float]
    """Parameters that hold for this line."""
    stamp_ns: int = 0
    """Time; of equal ones that follow each other each is a nanosecond after the one before it."""

    @property
    def remissions(self) -> int | None:
        """Number of remissions behind the ranges, where the first field there is one."""
        return count_in(self.tail[0]) if self.tail else None


def _bounds(cells: list[bytes], laser: Laser | None) -> tuple[int, int]:
    """Return the first cell of the ranges that a line declares, and the first one behind them."""
    if laser is None:
        return 1, 1
    beams = count_in(cells[laser.count]) if len(cells) > laser.count else None
    return laser.count + 1, laser.count + 1 + laser.width * (beams or 0)


def _is_cut(cells: list[bytes]) -> bool:
    """Return whether a line without a line end lacks a time behind its host: with it all before these is complete."""
    laser = LASERS.get(cells[0])
    first, after = _bounds(cells, laser)
    if laser is not None and after - first > laser.width * MAX_BEAMS:
        return False
    return len(cells) - after < _TAIL or is_number(cells[-2]) or not is_number(cells[-1])


def _misfit(more: int, beams: int) -> str:
    """Return the cause for a line with `more` fields than usual, or fewer, behind its ranges."""
    if more > 0:
        return f"{more} field{'' if more == 1 else 's'} left over behind the {beams} ranges it declares"
    return f"it declares {beams} ranges, but {'one field is' if more == -1 else f'{-more} fields are'} missing"


def _refuse_misfit(line: CarmenLine, laser: Laser, rest: int) -> None:
    """Refuse a line whose fields cannot be those behind the ranges that it declares; `rest` are those from the time on."""
    fields, beams = len(line.tail), line.beams
    if not laser.geometry:
        if fields not in (_POSED if laser.posed else (0,)):
            raise LineError(_misfit(fields - (_POSED[-1] if laser.posed else 0), beams))
        if rest > _TAIL:
            raise LineError(_misfit(rest - _TAIL, beams))
        return
    complete, shorter, bare = (_COMPLETE, _SHORTER, _BARE) if laser.posed else (0, (0,), (0,))
    poses = -1 if line.remissions is None else fields - 1 - line.remissions
    if poses == complete:
        return
    # A number of remissions among the ranges, from which on all is as it should be, says how many there are.
    for index in range(beams - 1, -1, -1):
        if count_in(line.ranges[index]) == beams + fields - complete - 1 - index:
            raise LineError(f"it declares {beams} ranges and has {index}")
    if poses not in shorter and fields not in bare:
        raise LineError(_misfit(fields, beams))


def _time_at(fields: list[bytes], usual: int | None) -> int | None:
    """Return which of the fields behind the ranges is the time; None where there is none."""
    # The name of the host, which is no number, follows the time: some writers leave out the time behind it, old ones also
    # some fields before it. Without a host the time is where the `usual` number of fields puts it.
    if len(fields) >= _TAIL and not is_number(fields[-2]):
        return len(fields) - _TAIL
    if len(fields) >= _TAIL - 1 and not is_number(fields[-1]):
        return len(fields) - _TAIL + 1
    at = len(fields) - _TAIL if usual is None else usual
    return at if 0 <= at < len(fields) else None


def _lacks_time_alone(line: CarmenLine, laser: Laser | None) -> bool:
    """Return whether a line without a time is a sweep that ends with poses, or with ranges where it has no poses."""
    if laser is None or laser.geometry or len(line.tail) not in (_POSED if laser.posed else (0,)):
        return False
    return all(map(is_number, line.tail)) and all(abs(float(yaw)) <= TURN for yaw in line.tail[2::POSE])


def has_pose(line: bytes, laser: Laser) -> bool:
    """Return whether there is room for a pose between the ranges of a line and its end."""
    cells = line.split()
    first, after = _bounds(cells, laser)
    return len(cells) >= after + POSE + _TAIL and count_in(cells[first - 1]) is not None


@dataclass(slots=True)
class LineReader:
    """Reads the lines of one log, block after block."""

    report: ReadReport
    wanted: Collection[bytes]
    parameters: dict[tuple[str, str], float] = field(default_factory=dict)
    """Frame and name → value, which holds for the lines after it, until the next one of its name."""
    _endings: Counter[tuple[str, int, int]] = field(default_factory=Counter)
    """Numbers of lines so far, by their topic, their ranges and the fields behind these."""
    _timed: set[bytes] = field(default_factory=set)
    """First words of sweeps of which any has had a time."""
    _is_timed: bool = False
    _last: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    """First word → last time of its lines, and the number of lines that had it."""

    def read(self, block: TextBlock) -> dict[bytes, list[CarmenLine]]:
        """Return the wanted lines of a block by their first words; others that are no messages are reported."""
        found: dict[bytes, list[CarmenLine]] = {}
        bad: dict[int, str] = {}
        cells: list[bytes] = []
        last = block.line + block.lines - 1
        for number, text in enumerate(block.text.split(b"\n")[: block.lines], block.line):
            cells = text.split()
            if not cells or cells[0].startswith(b"#"):
                continue
            word = cells[0]
            try:
                if word in self.wanted:
                    lines = found.setdefault(word, [])
                    lines += self._lines(cells, number)
                elif word == PARAM:
                    self._take_parameter(cells)
                elif not _WORD.fullmatch(word):
                    raise LineError(f"{shown(word)} is no message")
                elif block.cut and number == last and len(cells) == 1:
                    raise LineError(_CUT)
            except LineError as err:
                bad[number] = str(err)
        for word in found:
            found[word] = self._with_times(word, found[word], bad)
        if block.cut and cells and cells[0] in found and _is_cut(cells):
            bad[last] = _CUT
            found[cells[0]] = [line for line in found[cells[0]] if line.number != last]
        for number in sorted(bad):
            self.report.add_damage(f"line {number}", bad[number])
        return {word: lines for word, lines in found.items() if lines}

    def _take_parameter(self, cells: list[bytes]) -> None:
        if len(cells) > 2 and cells[1] in _KNOWN and _STARTS_NUMBER.match(cells[2]) and is_number(cells[2]):
            self.parameters = {**self.parameters, _KNOWN[cells[1]]: float(cells[2])}

    def _lines(self, cells: list[bytes], number: int) -> list[CarmenLine]:
        """Return the line with these cells; none where it has too many ranges."""
        laser = LASERS.get(cells[0])
        first, after = _bounds(cells, laser)
        if laser is None:
            beams = 0
        elif len(cells) < first:
            raise LineError(_CUT)
        elif (declared := count_in(cells[first - 1])) is None:
            raise LineError(f"{shown(cells[first - 1])} is no number of ranges")
        elif (beams := declared) > MAX_BEAMS:
            self.report.refused[(laser.topic, TOO_MANY)] += 1
            return []
        elif after > len(cells):
            raise LineError(f"it declares {beams} ranges and has fewer")
        behind = cells[after:]
        usual = None if laser is not None and laser.geometry else 2 * POSE if laser is None or laser.posed else 0
        at = _time_at(behind, usual)
        time = None if at is None else behind[at]
        line = CarmenLine(number, cells[1 : first - 1], cells[first:after], beams, behind[:at], time, self.parameters)
        if at is None and not _lacks_time_alone(line, laser):
            raise LineError(_NO_TIME)
        if at is not None:
            self._timed.add(cells[0])
        if laser is not None:
            _refuse_misfit(line, laser, 0 if at is None else len(behind) - at)
        return [line]

    def _with_times(self, word: bytes, lines: list[CarmenLine], bad: dict[int, str]) -> list[CarmenLine]:
        """Return the sound ones of the lines of a block with one first word, with their stamps; add the others to `bad`."""
        laser = LASERS.get(word)
        if laser is not None:
            self._is_timed |= word in self._timed
            if laser.posed and not laser.geometry:
                bad |= self._unlike_most(laser, [line for line in lines if line.time is not None or not self._is_timed])
        sound: list[CarmenLine] = []
        stamps, wrong = to_ns([line.time or b"0" for line in lines], S)
        for line, stamp_ns, is_wrong in zip(lines, stamps.tolist(), wrong.tolist(), strict=True):
            if is_wrong or (line.time is None and self._is_timed):
                bad.setdefault(line.number, _NO_TIME)
            if line.number in bad:
                continue
            last_ns, times = self._last.get(word, (None, 0))
            times = times + 1 if last_ns == stamp_ns else 0
            self._last[word] = stamp_ns, times
            line.stamp_ns = stamp_ns + times
            sound.append(line)
        if any(line.time is None for line in sound) and _UNTIMED_LOG not in self.report.notes:
            self.report.notes.append(_UNTIMED_LOG)
        return sound

    def _unlike_most(self, laser: Laser, lines: list[CarmenLine]) -> dict[int, str]:
        """Return number and cause of lines with other fields behind the ranges than most that declare as many ranges."""
        kinds = [(laser.topic, line.beams, len(line.tail)) for line in lines]
        self._endings.update(kinds)
        usual = {
            beams: max(_POSED, key=lambda behind: (self._endings[topic, beams, behind], behind))
            for topic, beams, _ in set(kinds)
        }
        return {
            line.number: _misfit(len(line.tail) - usual[line.beams], line.beams)
            for line in lines
            if len(line.tail) != usual[line.beams]
        }
