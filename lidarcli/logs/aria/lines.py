"""The lines of a block of text: sweeps and poses with the times that stand before them, and what tells of the sensors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.aria.words import (
    CREATED,
    GLOBAL_POSE,
    ROBOT_POSE,
    TIMES,
    UNKNOWN,
    VERSION,
    Sensor,
    is_unpadded,
    of_day,
    padded,
    sensor_of,
)
from lidarcli.logs.base import ReadReport
from lidarcli.logs.beginnings import ARIA_TITLE
from lidarcli.logs.lines import CUT, WITHOUT_TIMES, Apart, cells_of, report_lines, sound_rows
from lidarcli.logs.numbers import Cells, say
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import Bool, Int64

NO_TIME = "its time is none"
_LONGEST_TAG = 80

Told = tuple[int, tuple[str, str], list[float]]
"""Row, frame and part (`pose`, `conf`), and three numbers of what tells of a sensor."""


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """R lines of one kind in a block of text, in the order of the log."""

    rows: Int64
    """(R,) the lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) of equal times that follow each other each is a nanosecond after the one before it."""


@dataclass(frozen=True, eq=False, slots=True)
class Read:
    """What a block holds."""

    cells: Cells
    sweeps: dict[Sensor, Found]
    poses: dict[bytes, Found]
    """By their tags."""
    told: list[Told]
    version: bytes


@dataclass(slots=True)
class _Clock:
    """The time that holds for the next line."""

    now_ns: int = 0
    known: bool = True
    """Whether the last time was one."""
    robot_ns: int | None = None
    """The stamp of the robot's pose, where one has come since: sweeps behind it are taken there."""


@dataclass(slots=True)
class Lines:
    """Reads blocks of one log, one after the other; what cannot be a message goes to the report."""

    report: ReadReport
    version: bytes = b""
    _created: bytes = b""
    _timed: bool = False
    _clock: _Clock = field(default_factory=_Clock)
    _apart: Apart = field(default_factory=Apart)

    def read(self, block: TextBlock) -> Read:
        """What a block holds."""
        cells = cells_of(block.text)
        bad: list[tuple[int, str]] = []
        by_word = self._words(cells, bad, len(cells.count) - 1 if block.cut else -1)
        times = np.array(sorted(row for word in TIMES for row in by_word.get(word, [])), np.int64)
        stamps, known = self._times(cells, times, bad)
        self._timed = self._timed or len(times) > 0
        poses, sweeps = {}, {}
        robot = self._stamped(by_word.get(ROBOT_POSE, []), times, stamps, known, bad, ROBOT_POSE)
        if ROBOT_POSE in by_word:
            poses[ROBOT_POSE] = robot
        told: list[Told] = []
        for word, some in by_word.items():
            sensor = sensor_of(word)
            if sensor is not None and sensor.part:
                told += _told(cells, sensor, np.array(some, np.int64), bad)
            elif sensor is not None:
                sweeps[sensor] = self._stamped(some, times, stamps, known, bad, word, robot)
            elif word == GLOBAL_POSE:
                poses[word] = self._stamped(some, times, stamps, known, bad, word, robot)
        if sweeps and not self._timed and WITHOUT_TIMES not in self.report.notes:
            self.report.notes.append(WITHOUT_TIMES)
        self._go_on(times, stamps, known, robot)
        report_lines(self.report, block.line, bad)
        return Read(cells, sweeps, poses, sorted(told, key=lambda one: one[0]), self.version)

    def _words(self, cells: Cells, bad: list[tuple[int, str]], cut: int) -> dict[bytes, list[int]]:
        """The rows of each tag; what has none is told in `bad`."""
        every = np.arange(len(cells.count))
        by_word: dict[bytes, list[int]] = {}
        for row, word in enumerate(cells.column(every, 0)):
            if word[:1] == b"#":
                if word == CREATED and not self._created:
                    self._created = cells.spans(np.array([row]), 1, cells.count[row : row + 1] - 1)[0]
            elif UNKNOWN.fullmatch(word):
                by_word.setdefault(word, []).append(row)
            elif word and word != ARIA_TITLE:
                bad.append((row, CUT if row == cut else f"{say(word)} is no tag"))
        if cut in by_word.get(ROBOT_POSE, []):
            by_word[ROBOT_POSE].remove(cut)
            bad.append((cut, CUT))
        for row in by_word.get(VERSION, [])[:1]:
            self.version = self.version or cells.spans(np.array([row]), 1, cells.count[row : row + 1] - 1)[0]
        return by_word

    def _times(self, cells: Cells, rows: Int64, bad: list[tuple[int, str]]) -> tuple[Int64, Bool]:
        """The times [ns] in some lines, and which of them are any."""
        texts = cells.spans(rows, 1, np.minimum(cells.count[rows] - 1, 1))
        texts = list(map(padded if is_unpadded(self._created, self.version) else of_day, texts))
        stamps, wrong = to_ns(texts, S)
        known = np.ones(len(rows), np.bool_) if wrong is None else ~wrong
        bad += [
            (row, f"{say(texts[at])} is no time") for at, row in enumerate(rows.tolist()) if not known[at]
        ]
        return stamps, known

    def _stamped(
        self,
        some: list[int],
        times: Int64,
        stamps: Int64,
        known: Bool,
        bad: list[tuple[int, str]],
        word: bytes,
        robot: Found | None = None,
    ) -> Found:
        """Lines with the time before them, or with that of the pose of the robot which has come since."""
        rows = np.array(some, np.int64)
        at = np.searchsorted(times, rows) - 1
        clock = self._clock
        before = at < 0
        ns = np.where(before, clock.now_ns, np.append(stamps, 0)[at])
        good = np.where(before, clock.known, np.append(known, False)[at])
        if robot is not None:
            since = np.searchsorted(robot.rows, rows) - 1
            begin = np.where(before, -1, np.append(times, 0)[at])
            here = (since >= 0) & (np.append(robot.rows, 0)[since] > begin)
            ns = np.where(here, np.append(robot.stamp_ns, 0)[since], ns)
            if clock.robot_ns is not None:
                ns = np.where(before & (since < 0), clock.robot_ns, ns)
        bad += [(row, NO_TIME) for row in rows[~good].tolist()]
        return Found(rows[good], self._apart.of(word, ns[good]))

    def _go_on(self, times: Int64, stamps: Int64, known: Bool, robot: Found) -> None:
        """Remember what holds for the next block."""
        if len(times):
            self._clock = _Clock(int(stamps[-1]), bool(known[-1]))
        if len(robot.rows) and (not len(times) or robot.rows[-1] > times[-1]):
            self._clock.robot_ns = int(robot.stamp_ns[-1])


def _told(cells: Cells, sensor: Sensor, rows: Int64, bad: list[tuple[int, str]]) -> list[Told]:
    """What lines tell of a sensor: x, y, heading, or first and last angle and the number of samples."""
    told = []
    for width, columns in ((3, (0, 1, 2)), (4, (0, 1, 3) if sensor.part == "pose" else (0, 1, 2))):
        # Poses of version 4 have a height before the heading.
        some = rows[cells.count[rows] == width + 1]
        numbers = cells.numbers(some, 1, np.full(len(some), width), np.float64)
        good, values = sound_rows(numbers, some, width, bad)
        told += [
            (row, (sensor.frame, sensor.part), [each[column] for column in columns])
            for row, each in zip(some[good].tolist(), values.tolist(), strict=True)
        ]
    odd = rows[(cells.count[rows] != 4) & (cells.count[rows] != 5)]
    bad += [(row, "three numbers are expected here") for row in odd.tolist()]
    return told


@dataclass(slots=True)
class Index:
    """What a log holds, by the tags of its lines."""

    sweeps: dict[Sensor, int] = field(default_factory=dict)
    poses: dict[bytes, int] = field(default_factory=dict)
    mounted: set[str] = field(default_factory=set)
    """Frames of sensors whose place is told."""

    @classmethod
    def of(cls, blocks: Iterable[TextBlock]) -> Index:
        """The index of a whole text."""
        index = cls()
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:_LONGEST_TAG].split(None, 1)
                if not first or first[0][-1:] != b":":
                    continue
                sensor = sensor_of(first[0])
                if sensor is not None and sensor.part == "pose":
                    index.mounted.add(sensor.frame)
                elif sensor is not None and not sensor.part:
                    index.sweeps[sensor] = index.sweeps.get(sensor, 0) + 1
                elif first[0] in (ROBOT_POSE, GLOBAL_POSE):
                    index.poses[first[0]] = index.poses.get(first[0], 0) + 1
        return index
