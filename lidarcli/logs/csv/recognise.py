"""Which layout a CSV has, recognised from its first lines alone, never from its name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.csv.dialect import csv_cells, empty_lists
from lidarcli.logs.csv.doubts import refuse_numbered
from lidarcli.logs.csv.head import (
    Head,
    long_layout,
    need_geometry,
    read_head,
    repeats,
    shown,
    units,
    unknown,
)
from lidarcli.logs.csv.layouts import (
    LIST,
    MCAP_CAT,
    PLOTJUGGLER,
    WIDE,
    Columns,
    Layout,
)
from lidarcli.logs.csv.nameless import without_header
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
from lidarcli.logs.times import time_unit
from lidarcli.sweeps import TURN, Int64

_SHOWN = 3
"""Values of a column that a message names."""
_RECORD = 1 << 20
"""Bytes within which the first record with a list must end, the list itself not counted."""


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
        refuse_numbered(head)
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
    # Where the step is told, rows of fewer ranges see less; where the view is, they could only be cut or joined.
    tells_view = {"angle_min", "angle_max", "angle_increment"} <= fields.keys()
    tells_step = head.options.angle_increment is not None
    may_differ = tells_view or tells_step or head.usual != len(head.names)
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
        in_order and may_differ and (doubled or not after),
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
