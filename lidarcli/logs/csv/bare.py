"""CSV without column names: recognised by the pattern of its rows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.csv.doubts import COUNTER_ROWS, is_turn, refuse_other_tables, restarts
from lidarcli.logs.csv.head import Head, need_geometry, numeric, repeats, shown, units, unknown, value_of
from lidarcli.logs.csv.layouts import (
    ABBREVIATED,
    LONG,
    PER_SWEEP,
    ROS2,
    WIDE,
    Columns,
    Layout,
    expected_beams,
)
from lidarcli.logs.csv.names import DEFAULT_TOPIC
from lidarcli.logs.csv.times import DATE, DATE_UNPADDED, S, time_unit
from lidarcli.sweeps import TURN

_SEQ_STEP = 10
"""A sequence number rises by less from row to row ..."""
_SEQ_STEP_MOST = 1000
"""... or by less than this, where what follows is a time for sure."""


def without_header(head: Head) -> Layout:
    """The layout of rows without names; UnreadableError where none fits or geometry is missing."""
    for row in head.rows:
        if _is_ros2(row):
            return _ros2_layout(head, row)
    width = Counter(len(row) for row in head.rows).most_common(1)[0][0]
    rows = [row for row in head.rows if len(row) == width and all(numeric(cell) for cell in row[2:])]
    if not rows or (len(rows) < len(head.rows) // 2 and width > 3):
        rows = [row for row in head.rows if sum(map(numeric, row[2:])) >= 0.9 * len(row[2:]) and len(row) > 3]
    if not rows:
        raise unknown(head, f"lines like {shown(head.lines[0])}")
    head = replace(head, rows=rows)
    if width <= 3 and (layout := _bare_long(head, width)):
        return layout
    if width < 3:
        raise unknown(head, f"a table of {width} columns without names, such as {shown(head.lines[0])}")
    fields, first = _leading(rows)
    refuse_other_tables(head, rows, first)
    words = [name for name, _ in sorted(fields.items(), key=lambda item: item[1])]
    need_geometry(head, WIDE)
    scan = Columns(DEFAULT_TOPIC, fields, units(head, fields), first=first, open_end=True)
    notes = [f"no header; columns taken as {', '.join([*words, 'ranges'])}"]
    if not first:
        notes.append("no time column: all stamps are 0")
    return Layout(WIDE, head.dialect, head.start, scans=(scan,), notes=tuple(notes))


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
        return long(head, 0, 1, None, None, {})
    keys = head.column(0)
    # A key that comes back is none: an angle or a layer.
    if not repeats(keys) or len(set(keys)) < sum(1 for _ in groupby(keys)):
        return None
    counted = all(cell.isdigit() for cell in keys) and time_unit("", keys) == S
    return long(head, 1, 2, 0, None, {} if counted else {"record": 0})


def _leading(rows: Sequence[Sequence[bytes]]) -> tuple[dict[str, int], int]:
    """What stands before the ranges in rows without a header: fields, and the first column of ranges."""
    if time_unit("", [row[0] for row in rows]) in (DATE, DATE_UNPADDED):
        return {"record": 0}, 1
    columns = [[value_of(row[c]) for row in rows] for c in range(2)]
    whole = [all(re.fullmatch(rb"-?\d+", row[c]) for row in rows) for c in range(2)]

    def rises(column: int) -> bool:
        values = [value for value in columns[column] if value is not None]
        return values == sorted(values) and len(values) == len(rows) and values[-1] > values[0]

    many = len(rows) > 1
    if all(whole) and all(v is not None and v >= 1e8 for v in columns[0]):
        rest = columns[1]
        if all(v is not None and 0 <= v < 1e9 for v in rest) and max(v or 0 for v in rest) > 1e5:
            return {"seconds": 0, "nanoseconds": 1}, 2
    counter = whole[0] and all(v is not None and abs(v) < 1e8 for v in columns[0])
    if counter and (rises(0) or not many):
        second_is_time = time_unit("", [row[1] for row in rows]) in (DATE, DATE_UNPADDED)
        others = [abs(value) for cell in rows[0][2:] if (value := value_of(cell)) is not None]
        beyond = columns[1][0] is not None and columns[1][0] > 10 * max(others, default=0)
        step = float(np.median(np.diff(np.array(columns[0], np.float64)))) if many else 0.0
        # What rises in large steps is a time itself, and what rises behind it may be a range.
        sure = step < _SEQ_STEP or (step < _SEQ_STEP_MOST and (beyond or len(rows) >= COUNTER_ROWS))
        if second_is_time or (many and rises(1) and sure) or (not many and beyond):
            return {"seq": 0, "record": 1}, 2
    if not many or rises(0) or len({row[0] for row in rows}) == 1:
        return {"record": 0}, 1
    return {}, 0


def long(
    head: Head, angle: int, distance: int, key: int | None, degrees: bool | None, fields: dict[str, int]
) -> Layout:
    """One beam per row; bearings are degrees where the name says so or radians cannot be that large."""
    notes = []
    if degrees is None:
        numbers = [abs(value) for cell in head.column(angle) if (value := value_of(cell)) is not None]
        degrees = bool(numbers) and max(numbers) > TURN + 0.1
        if degrees:
            notes.append("bearings beyond a turn in radians: taken as degrees")
    scan = Columns(DEFAULT_TOPIC, fields, units(head, fields), first=distance)
    width = len(head.names) or len(head.rows[0])
    return Layout(
        PER_SWEEP if key is None else LONG,
        head.dialect,
        head.start,
        head.header,
        width,
        (scan,),
        angle=angle,
        key=key,
        degrees=degrees,
        notes=tuple(notes),
    )
