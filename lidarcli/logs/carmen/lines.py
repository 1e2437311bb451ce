"""The lines of a block of text as messages: which cells hold what, without a look at the numbers themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.carmen.counts import POSED, TAIL, Counts, Sweeps
from lidarcli.logs.carmen.words import LASERS, PARAM, POSES, UNKNOWN, Laser
from lidarcli.logs.lines import (
    CUT,
    MOST_DIGITS,
    WITHOUT_TIMES,
    Apart,
    cells_of,
    declared,
    is_number,
    refuse,
    report_lines,
)
from lidarcli.logs.numbers import Cells, say
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import TURN, Bool, Int64

_LONGEST_WORD, _LONGEST_HEAD = 17, 1024
"""Bytes in which the first word and the number of ranges are looked for."""

NO_TIME = "no time at its end"


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """R messages of one kind in a block of text, in the order of the log."""

    word: bytes
    rows: Int64
    """(R,) their lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) each later than the one before it where the log has the same time for both: by a nanosecond."""
    beams: Int64
    """(R,) ranges; 0 for what is no sweep."""
    after: Int64
    """(R,) the first cell behind the ranges."""
    fields: Int64
    """(R,) cells from there to the time."""


class Lines:
    """Reads blocks of one log, one after the other; what cannot be a message goes to the report."""

    def __init__(self, words: Sequence[bytes], report: ReadReport) -> None:
        """`words`: the kinds of messages that are wanted."""
        self._wanted = frozenset(words)
        self._report = report
        self._apart = Apart()
        self._counts = Counts()
        self._timed = False
        """Whether a sweep so far has a time."""

    def read(self, block: TextBlock) -> tuple[Cells, list[Found], list[tuple[int, bytes, bytes]]]:
        """The cells of a block, the messages that are wanted, and the parameters: row, name and value."""
        cells = cells_of(block.text)
        every = np.arange(len(cells.count))
        by_word: dict[bytes, list[int]] = {}
        for row, word in enumerate(cells.column(every, 0)):
            by_word.setdefault(word, []).append(row)
        found = []
        parameters: list[tuple[int, bytes, bytes]] = []
        bad: list[tuple[int, str]] = []
        last = len(every) - 1 if block.cut else -1
        for word, some in by_word.items():
            rows = np.array(some, np.int64)
            if word in self._wanted:
                found.append(self._framed(word, rows, cells, bad, last))
            elif word == PARAM:
                whole = rows[cells.count[rows] > 2]
                names, values = cells.column(whole, 1), cells.column(whole, 2)
                parameters += zip(whole.tolist(), names, values, strict=True)
            elif word and word[:1] != b"#":
                if not UNKNOWN.fullmatch(word):
                    bad += [(row, f"{say(word)} is no message") for row in some]
                elif some[-1] == last and cells.count[last] == 1:
                    bad.append((last, CUT))
        report_lines(self._report, block.line, bad)
        return cells, [part for part in found if len(part.rows)], sorted(parameters)

    def _framed(self, word: bytes, rows: Int64, cells: Cells, bad: list[tuple[int, str]], cut: int) -> Found:
        """The messages of one kind; those that are none are left out and told in `bad`."""
        laser = LASERS.get(word)
        count = cells.count[rows]
        beams = np.zeros(len(rows), np.int64)
        after = np.ones(len(rows), np.int64)
        causes: dict[int, str] = {}
        refused: set[int] = set()
        if laser is not None:
            told = declared(cells, rows, laser.count, 2 if laser.pairs else 1)
            beams, after, causes, refused = told.beams, told.after, told.causes, told.refused
        usual = None if laser is not None and laser.geometry else 6 if laser is None or laser.posed else 0
        time, fields = _times_at(cells, rows, count, after, usual)
        timeless = np.zeros(len(rows), np.bool_)
        if laser is not None:
            whole = np.ones(len(rows), np.bool_)
            whole[[*causes, *refused]] = False
            self._timed = self._timed or bool((whole & (fields >= 0)).any())
            if not self._timed:
                timeless = whole & _tell_all_but_time(cells, rows, after, laser)
                fields = np.where(timeless, count - after, fields)
            some = np.flatnonzero(whole & (fields >= 0))
            rest = np.where(timeless, 0, count - time)
            sweeps = Sweeps(laser, rows[some], beams[some], after[some], fields[some], rest[some])
            causes |= {int(some[at]): cause for at, cause in self._counts.doubt(cells, sweeps).items()}
        for at in np.flatnonzero(fields < 0).tolist():
            causes.setdefault(at, NO_TIME)
        if len(rows) and rows[-1] == cut and not _is_whole(cells, rows[-1:], count[-1:], after[-1:]):
            causes[len(rows) - 1] = CUT
        stamps, wrong = to_ns(cells.spans(rows, np.minimum(time, count - 1), 1), S)
        stamps = np.where(timeless, 0, stamps)
        if wrong is not None:
            for at in np.flatnonzero(wrong & ~timeless).tolist():
                causes.setdefault(at, NO_TIME)
        if timeless.any() and WITHOUT_TIMES not in self._report.notes:
            self._report.notes.append(WITHOUT_TIMES)
        if laser is not None:
            refuse(self._report, laser.topic, refused)
        bad += [(int(rows[at]), cause) for at, cause in causes.items() if at not in refused]
        good = np.ones(len(rows), np.bool_)
        good[[*causes, *refused]] = False
        return Found(
            word, rows[good], self._apart.of(word, stamps[good]), beams[good], after[good], fields[good]
        )


def _times_at(
    cells: Cells, rows: Int64, count: Int64, after: Int64, usual: int | None
) -> tuple[Int64, Int64]:
    """The cell of each message that holds its time, and how many are between `after` and it; -1 where there is none.

    The name of the host, which is no number, tells where: some writers leave out what stands behind it, old ones also
    some of what stands before it. Without a host it is where the `usual` number of fields puts it.
    """
    left = count - after
    most = count - 1
    second, third = cells.spans(rows, most, 1), cells.spans(rows, np.maximum(most - 1, 0), 1)
    time = np.empty(len(rows), np.int64)
    for at, (end, before) in enumerate(zip(second, third, strict=True)):
        if not is_number(before) and left[at] >= TAIL:
            time[at] = count[at] - TAIL
        elif not is_number(end) and left[at] >= TAIL - 1:
            time[at] = count[at] - TAIL + 1
        elif usual is None:
            time[at] = count[at] - TAIL
        else:
            time[at] = after[at] + usual
            if left[at] <= usual:
                time[at] = -1
    fields = np.where((time >= after) & (time < count), time - after, -1)
    return np.where(fields < 0, 0, time), fields


def _tell_all_but_time(cells: Cells, rows: Int64, after: Int64, laser: Laser) -> Bool:
    """Which sweeps end with the poses, or where there are none with the ranges; numbers alone, and angles that are some."""
    found = np.zeros(len(rows), np.bool_)
    if laser.geometry:
        return found
    left = cells.count[rows] - after
    for at in np.flatnonzero(np.isin(left, POSED if laser.posed else (0,))).tolist():
        text = cells.spans(rows[at : at + 1], after[at : at + 1], left[at : at + 1])[0]
        fields = text.split(b" ") if left[at] else []
        found[at] = all(map(is_number, fields)) and all(abs(float(yaw)) <= TURN for yaw in fields[2::3])
    return found


def _is_whole(cells: Cells, rows: Int64, count: Int64, after: Int64) -> bool:
    """Whether a line without an end has its host and a time behind it: then all before these is whole."""
    if count[0] - after[0] < TAIL:
        return False
    host, logger = cells.spans(rows, count - 2, 1)[0], cells.spans(rows, count - 1, 1)[0]
    return not is_number(host) and is_number(logger)


@dataclass(slots=True)
class Index:
    """What a log holds, by the beginnings of its lines."""

    lines: dict[bytes, int] = field(default_factory=lambda: dict.fromkeys((*LASERS, *POSES), 0))
    """First word → lines that begin with it, of the messages that are read."""
    posed: set[bytes] = field(default_factory=set)
    """Kinds of sweeps that tell poses."""

    @classmethod
    def of(cls, blocks: Iterable[TextBlock]) -> Index:
        """The index of a whole text."""
        index = cls()
        counts, unsure = index.lines, {word for word, laser in LASERS.items() if laser.posed}
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:_LONGEST_WORD].split(None, 1)
                if not first or first[0] not in counts:
                    continue
                counts[first[0]] += 1
                if first[0] in unsure and _tells_pose(line, LASERS[first[0]]):
                    index.posed.add(first[0])
                    unsure.discard(first[0])
        return index


def _tells_pose(line: bytes, laser: Laser) -> bool:
    """Whether there is room for a pose between the ranges of a line and its end."""
    count = line[:_LONGEST_HEAD].split(None, laser.count + 1)[laser.count : laser.count + 1]
    if not count or not count[0].isdigit() or len(count[0]) > MOST_DIGITS:
        return False
    ranges = int(count[0]) * (2 if laser.pairs else 1)
    return len(line.split()) >= laser.count + 1 + ranges + 3 + TAIL
