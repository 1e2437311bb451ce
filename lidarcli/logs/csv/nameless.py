"""Which layout the rows of a CSV without column names have, by their numbers alone."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.csv.coreslam import find_coreslam
from lidarcli.logs.csv.doubts import COUNTER_ROWS, is_turn, refuse_numbered, refuse_other_tables, restarts
from lidarcli.logs.csv.head import (
    Head,
    long_layout,
    need_geometry,
    numeric,
    repeats,
    shown,
    units,
    unknown,
    value_of,
)
from lidarcli.logs.csv.layouts import (
    ABBREVIATED,
    DEFAULT_TOPIC,
    ROS2,
    WIDE,
    Columns,
    Layout,
    expected_beams,
)
from lidarcli.logs.times import DATE, DATE_UNPADDED, S, time_unit

_SEQ_STEP = 10
"""A sequence number rises by less from row to row ..."""
_SEQ_STEP_MOST = 1000
"""... or by less than this, where what follows is a time for sure."""


def without_header(head: Head) -> Layout:
    """The layout of rows without names; UnreadableError where none fits or geometry is missing."""
    for row in head.rows:
        if _is_ros2(row):
            return _ros2_layout(head, row)
    if layout := find_coreslam(head):
        return layout
    usual = head.usual
    width = usual or Counter(len(row) for row in head.rows).most_common(1)[0][0]
    rows = [row for row in head.rows if len(row) == width and all(numeric(cell) for cell in row[2:])]
    if not rows or (len(rows) < len(head.rows) // 2 and width > 3):
        rows = [row for row in head.rows if sum(map(numeric, row[2:])) >= 0.9 * len(row[2:]) and len(row) > 3]
    if not rows:
        raise unknown(head, f"lines like {shown(head.lines[0])}")
    head = replace(head, rows=rows)
    if width <= 3 and (layout := _bare_long(head, width)):
        return layout
    if width < 3:
        refuse_numbered(head)
        raise unknown(head, f"a table of {width} columns without names, such as {shown(head.lines[0])}")
    fields, first = _leading(rows)
    refuse_other_tables(head, rows, first)
    words = [name for name, _ in sorted(fields.items(), key=lambda item: item[1])]
    need_geometry(head, WIDE)
    # A view that is told once for all makes of a beam that is missing another step between all others.
    usual = usual if head.options.fov is not None else 0
    ranges = np.arange(first, usual)
    scan = Columns(DEFAULT_TOPIC, fields, units(head, fields), ranges, first, open_end=not usual)
    notes = [f"no header; columns taken as {', '.join([*words, 'ranges'])}"]
    if not first:
        notes.append("no time column: all stamps are 0")
    return Layout(WIDE, head.dialect, head.start, width=usual, scans=(scan,), notes=tuple(notes))


def _is_ros2(row: Sequence[bytes]) -> bool:
    """seconds, nanoseconds, frame, ...: how `ros2 topic echo --csv` begins a message with a header."""
    return (
        len(row) >= 4
        and re.fullmatch(rb"-?\d{1,10}", row[0]) is not None
        and re.fullmatch(rb"\d{1,9}", row[1]) is not None
        and not numeric(row[2], empty=False)
    )


def _ros2_layout(head: Head, row: Sequence[bytes]) -> Layout:
    values = [value_of(cell) for cell in row[3:10]]
    if len(values) < 7 or any(value is None for value in values):
        if row[2]:
            return Layout(ROS2, head.dialect, head.start, notes=("no LaserScan in it",))
        raise unknown(head, f"lines like {shown(head.lines[0])}")
    if any(cell == b"..." for cell in row):
        raise UnreadableError(f"{head.path}: CSV ({ROS2}): {ABBREVIATED}")
    names = "seconds nanoseconds frame angle_min angle_max angle_increment time_increment scan_time range_min range_max"
    rest = len(row) - 10 - (not row[-1])
    expected = expected_beams(*(np.array([values[i]], np.float64) for i in range(3)))[0]
    doubled = rest % 2 == 0 and abs(rest // 2 - expected) < abs(rest - expected)
    scan = Columns(
        DEFAULT_TOPIC,
        {name: column for column, name in enumerate(names.split())},
        first=10,
        doubled=doubled,
        open_end=True,
    )
    notes = ("intensities follow the ranges",) if doubled else ()
    return Layout(ROS2, head.dialect, head.start, width=len(row), scans=(scan,), notes=notes)


def _bare_long(head: Head, width: int) -> Layout | None:
    """Two columns (bearing, range) or three (sweep or stamp first) without names."""
    if width < 2:
        return None
    values = np.array([value_of(row[width - 2]) for row in head.rows], np.float64)
    angles = values[np.abs(values) <= 360.5]
    if len(angles) < 3:
        return None
    steps = np.diff(angles)
    step = np.median(steps)
    even = step != 0 and np.mean(np.abs(steps - step) <= 0.25 * abs(step)) >= 0.6
    turning = width == 2 and restarts(angles) and is_turn(angles)
    if not (even or turning) or len(angles) < 0.8 * len(values):
        return None
    if width == 2:
        return long_layout(head, 0, 1, None, None, {})
    keys = head.column(0)
    # A key that comes back is none: an angle or a layer; nor is one that stays the same for turn after turn.
    if not repeats(keys) or len(set(keys)) < sum(1 for _ in groupby(keys)):
        return None
    if len(set(keys)) == 1 and restarts(angles) and is_turn(angles):
        return None
    counted = all(cell.isdigit() for cell in keys) and time_unit("", keys) == S
    return long_layout(head, 1, 2, 0, None, {} if counted else {"record": 0})


@dataclass(frozen=True, slots=True)
class _Column:
    """A column of a table without names, by which it is told what it holds."""

    cells: list[bytes]
    values: list[float | None]

    @classmethod
    def of(cls, rows: Sequence[Sequence[bytes]], index: int) -> _Column:
        """Column `index` of rows."""
        cells = [row[index] for row in rows]
        return cls(cells, [value_of(cell) for cell in cells])

    @property
    def is_date(self) -> bool:
        """Whether its cells are dates."""
        return time_unit("", self.cells) in (DATE, DATE_UNPADDED)

    @property
    def is_whole(self) -> bool:
        """Whether its cells are whole numbers."""
        return all(re.fullmatch(rb"-?\d+", cell) for cell in self.cells)

    @property
    def rises(self) -> bool:
        """Whether its numbers never fall, and rise somewhere."""
        values = [value for value in self.values if value is not None]
        return len(values) == len(self.cells) and values == sorted(values) and values[-1] > values[0]


def _leading(rows: Sequence[Sequence[bytes]]) -> tuple[dict[str, int], int]:
    """What stands before the ranges in rows without a header: fields, and the first column of ranges."""
    first, second = (_Column.of(rows, index) for index in range(2))
    if first.is_date:
        return {"record": 0}, 1
    if _are_seconds(first, second):
        return {"seconds": 0, "nanoseconds": 1}, 2
    if _is_counter(first) and _is_time_behind_counter(rows, first, second):
        return {"seq": 0, "record": 1}, 2
    if len(rows) == 1 or first.rises or len(set(first.cells)) == 1:
        return {"record": 0}, 1
    return {}, 0


def _are_seconds(first: _Column, second: _Column) -> bool:
    """Whether two columns are the whole seconds of times and their nanoseconds."""
    return (
        first.is_whole
        and second.is_whole
        and all(value is not None and value >= 1e8 for value in first.values)
        and all(value is not None and 0 <= value < 1e9 for value in second.values)
        and max(value or 0 for value in second.values) > 1e5
    )


def _is_counter(column: _Column) -> bool:
    """Whether a column may hold sequence numbers."""
    small = column.is_whole and all(value is not None and abs(value) < 1e8 for value in column.values)
    return small and (column.rises or len(column.cells) == 1)


def _is_time_behind_counter(rows: Sequence[Sequence[bytes]], counter: _Column, column: _Column) -> bool:
    """Whether the column behind what may be sequence numbers holds times."""
    others = [abs(value) for cell in rows[0][2:] if (value := value_of(cell)) is not None]
    beyond = column.values[0] is not None and column.values[0] > 10 * max(others, default=0)
    if column.is_date or len(rows) == 1:
        return column.is_date or beyond
    step = float(np.median(np.diff(np.array(counter.values, np.float64))))
    # What rises in large steps is a time itself, and what rises behind it may be a range.
    sure = step < _SEQ_STEP or (step < _SEQ_STEP_MOST and (beyond or len(rows) >= COUNTER_ROWS))
    return column.rises and sure
