"""Which layout a CSV has, recognised from its first lines alone, never from its name."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.csv.coreslam import find_coreslam
from lidarcli.logs.csv.dialect import csv_cells, empty_lists
from lidarcli.logs.csv.doubts import COUNTER_ROWS, is_turn, refuse_other_tables, restarts
from lidarcli.logs.csv.head import (
    Head,
    long_layout,
    need_geometry,
    numeric,
    read_head,
    repeats,
    shown,
    units,
    unknown,
    value_of,
)
from lidarcli.logs.csv.layouts import (
    ABBREVIATED,
    DEFAULT_TOPIC,
    LIST,
    MCAP_CAT,
    PLOTJUGGLER,
    ROS2,
    WIDE,
    Columns,
    Layout,
    expected_beams,
)
from lidarcli.logs.csv.names import (
    Family,
    FieldIndex,
    LongColumns,
    canonical,
    find_bearings,
    find_families,
    find_intensities,
    find_layers,
    find_long,
    has_ros_header,
    list_column,
    ros_name,
)
from lidarcli.logs.csv.rplidar import COUNTER_CLOCKWISE
from lidarcli.logs.numbers import say
from lidarcli.logs.times import DATE, DATE_UNPADDED, S, time_unit
from lidarcli.sweeps import TURN, Int64

_SHOWN = 3
"""Values of a column that a message names."""
_RECORD = 1 << 20
"""Bytes within which the first record with a list must end, the list itself not counted."""

_SEQ_STEP = 10
"""A sequence number rises by less from row to row ..."""
_SEQ_STEP_MOST = 1000
"""... or by less than this, where what follows is a time for sure."""


def recognise(lines: Sequence[bytes], options: OpenOptions, path: str) -> Layout:
    """The layout of a file that begins with `lines` (all of them, as they stand).

    Raises UnreadableError where the text is no table, no layout that is known, or lacks its geometry.
    """
    head = read_head(lines, options, path)
    if head.names:
        return with_header(head)
    return without_header(head)


def with_header(head: Head) -> Layout:
    """The layout of rows below names; UnreadableError where none fits or geometry is missing."""
    names = head.names
    if listed := _list_layout(head):
        return listed
    bearings = find_bearings(names)
    families = [] if bearings else find_families(names)
    if not families and not bearings:
        if columns := find_long(names):
            return _named_long_layout(head, columns)
        name = ros_name(names)
        if name != WIDE or has_ros_header(names):
            return Layout(
                name if name != WIDE else LIST, head.dialect, head.start, notes=("no ranges in it",)
            )
        raise unknown(head, f"a table with the columns {shown(', '.join(names).encode())}")
    name = ros_name(names)
    index = FieldIndex(names)
    if bearings:
        family, first, step = bearings
        degrees = max(abs(first), abs(first + step * (len(family.columns) - 1))) > TURN + 0.1
        scale = np.pi / 180 if degrees else 1.0
        scans = [_columns(head, index, {}, family, (first * scale, step * scale))]
        notes = ["bearings from the column names" + (", taken as degrees" if degrees else "")]
    else:
        notes = []
        strengths = find_intensities(names)
        scans = [_columns(head, index, strengths, family) for family in families]
    if name == MCAP_CAT:
        scans = [_of_mcap(head, each) for each in scans]
    for each in scans:
        told = each.to_last or {"angle_min", "angle_increment"} <= each.fields.keys()
        if not told and each.geometry is None:
            need_geometry(head, name)
    beams = ", ".join(f"{len(each.ranges)} ranges of {each.topic}" for each in scans)
    return Layout(
        name,
        head.dialect,
        head.start,
        head.header,
        len(names),
        tuple(scans),
        sparse=name == PLOTJUGGLER or len(scans) > 1,
        notes=(beams, *notes),
    )


def _columns(
    head: Head,
    index: FieldIndex,
    strengths: Mapping[str, Int64],
    family: Family,
    geometry: tuple[float, float] | None = None,
) -> Columns:
    """The fields around a family of range columns, and whether rows may be ragged."""
    fields = index.find(family.prefix)
    first, last = int(family.columns[0]), int(family.columns[-1])
    in_order = bool((np.diff(family.columns) == 1).all())
    after = len(head.names) - last - 1
    none = np.empty(0, np.int64)
    beside = strengths.get(family.prefix.lower(), none)
    doubled = after == len(family.columns) and all("intens" in name.lower() for name in head.names[-after:])
    return Columns(
        family.topic,
        fields,
        units(head, fields),
        family.columns,
        first,
        doubled,
        # Those of ragged rows stand wherever the ranges end.
        none if doubled or len(beside) != len(family.columns) else beside,
        in_order and (doubled or not after),
        geometry,
    )


def _of_mcap(head: Head, scan: Columns) -> Columns:
    """The same with what a foxglove.LaserScan has in place of a header and of the increment."""
    fields = dict(scan.fields)
    plain = [canonical(name) for name in head.names]
    if not {"stamp", "seconds"} & fields.keys() and "timestamp" in plain:
        fields["stamp"] = plain.index("timestamp")
    to_last = "angle_increment" not in fields and {"angle_min", "angle_max"} <= fields.keys()
    return replace(scan, fields=fields, units=units(head, fields), to_last=to_last)


def _list_layout(head: Head) -> Layout | None:
    """One cell holds all ranges of a sweep, as a list."""
    if not head.lines:
        plain = [canonical(name) for name in head.names]
        return Layout(LIST, head.dialect, head.start) if "ranges" in plain else None
    # A list may span lines (numpy's own spelling); a comma inside brackets separates no cells.
    # Only names that speak of ranges are worth the look.
    if not any(re.search("range|scan|dist|data|value", name.lower()) for name in head.names):
        return None
    text = empty_lists(b"\n".join(head.lines))[:_RECORD].decode("utf-8", "replace")
    try:
        cells = csv_cells(text, head.dialect.separator.decode())
    except ValueError:
        return None
    found = list_column(head.names, dict(enumerate(cells[: len(head.names)])))
    if found is None:
        return None
    listed, prefix = found
    fields = FieldIndex(head.names).find(prefix)
    found_units = _list_units(head, fields, cells)
    if not {"angle_min", "angle_increment"} <= fields.keys():
        need_geometry(head, LIST)
    brackets = b"[" if "[" in cells[listed] else b"("
    name = ros_name(head.names)
    topic = Family(prefix, np.empty(0, np.int64)).topic
    named = f"{prefix}intensities".lower()
    beside = np.array([i for i, each in enumerate(head.names) if each.strip().lower() == named][:1], np.int64)
    return Layout(
        LIST if name == WIDE else f"{name}, {LIST}",
        head.dialect,
        head.start,
        head.header,
        len(head.names),
        (Columns(topic, fields, found_units, first=listed, intensities=beside),),
        listed=True,
        brackets=brackets,
    )


def _list_units(head: Head, fields: dict[str, int], first: list[str]) -> dict[str, int]:
    """The units of time columns, from the first record and all others that stand in one line."""
    records = [first]
    for line in head.lines[1:]:
        with suppress(ValueError):
            bare = empty_lists(line).decode("utf-8", "replace")
            records.append(csv_cells(bare, head.dialect.separator.decode()))
    found: dict[str, int] = {}
    for name in ("record", "stamp"):
        if name in fields:
            column = fields[name]
            samples = [cells[column].encode() for cells in records if len(cells) == len(head.names)]
            unit = time_unit(head.names[column], samples)
            if unit is not None:
                found[name] = unit
    return found


def _named_long_layout(head: Head, columns: LongColumns) -> Layout:
    """One beam per row, by the names of the columns; UnreadableError where the beams lie in several layers."""
    for column in find_layers(head.names):
        values = list(dict.fromkeys(head.column(column)))
        if len(values) > 1:
            some = ", ".join(map(say, values[:_SHOWN])) + (", ..." if len(values) > _SHOWN else "")
            raise UnreadableError(
                f"{head.path}: one beam per row, in several layers (column {shown(head.names[column].encode())}"
                f" holds {some}); lidarcli reads scans of one plane: keep the rows of one layer"
            )
    fields = FieldIndex(head.names).find("")
    for taken in ("seq", "frame"):
        if fields.get(taken) == columns.sweep:
            fields.pop(taken, None)
    key = columns.sweep
    for name in ("stamp", "record"):
        if key is None and name in fields and repeats(head.column(fields[name])):
            key = fields[name]
    layout = long_layout(head, columns.angle, columns.range, key, columns.degrees, fields)
    if layout.degrees and "quality" in map(canonical, head.names):
        return replace(layout, notes=(*layout.notes, COUNTER_CLOCKWISE))
    return layout


def without_header(head: Head) -> Layout:
    """The layout of rows without names; UnreadableError where none fits or geometry is missing."""
    for row in head.rows:
        if _is_ros2(row):
            return _ros2_layout(head, row)
    if layout := find_coreslam(head):
        return layout
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
