"""Layouts of tables with column names: beams, geometry, times and frames by their names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from string import whitespace

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.csv.dialect import csv_cells, empty_lists
from lidarcli.logs.csv.layouts import (
    BAGPY,
    DEFAULT_TOPIC,
    LIST,
    MCAP_CAT,
    PLOTJUGGLER,
    ROSTOPIC,
    WIDE,
    Columns,
    Head,
    Layout,
    repeats,
    shown,
    value_of,
)
from lidarcli.logs.csv.long_form import cut_restarts
from lidarcli.logs.csv.nameless import refuse_numbered
from lidarcli.logs.csv.rplidar import COUNTER_CLOCKWISE
from lidarcli.logs.numbers import say
from lidarcli.sweeps import TURN, Int64

_MARKS = re.compile(r"[./\[\]\s%#:]+")
_DECIMAL = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[-+]?\.\d+")
_LIST = re.compile(r"(?:\w[\w.]*\s*\()?\s*[\[(]|\w*array\(")
_INDEX = re.compile(r"(\d{1,7})\]?(?:[._/]echoes[\[._]?0\]?)?\Z")
_BEFORE_INDEX = "[._/-" + whitespace
"""Characters between a word and its index."""
_RANGE_WORD = re.compile(r"(?:.*(?:range|scan|dist|beam|laser|lidar|ray|bin|point|value).*|r|d|b|m|l|v|rho|col(?:umn)?|)$")
_UNIT = r"(?:_?\(?(?:s|secs?|seconds|ms|msec|us|usec|µs|ns|nsecs?|nanosec)\)?)?"
_FIELDS = {
    name: re.compile(pattern)
    for name, pattern in {
        "angle_min": r"(?:angle_min|anglemin|min_angle|start_?angle)",
        "angle_max": r"(?:angle_max|anglemax|max_angle|end_?angle)",
        "angle_increment": r"(?:angle_increment|angleincrement|angle_inc|angular_resolution)",
        "time_increment": r"time_increment",
        "scan_time": r"scan_time",
        "range_min": r"(?:range_min|rangemin|min_range)",
        "range_max": r"(?:range_max|rangemax|max_range)",
        "seconds": r"(?:(?:header_)?(?:(?:time)?stamp_)?(?:secs?|seconds))",
        "nanoseconds": r"(?:(?:header_)?(?:(?:time)?stamp_)?(?:nsecs?|nanosecs?|nanoseconds))",
        "stamp": rf"(?:header_)?stamp{_UNIT}",
        "record": rf"(?:rosbag)?(?:time_?stamp|(?:date|bag|record|log)?_?time|t|record){_UNIT}",
        "date": r"date",
        "frame": r"(?:header_)?(?:frame_?id|frame)",
        "header": r"header",
        "seq": r"(?:header_)?(?:seq|sequence|index|id)",
    }.items()
}
_ANY_FIELD = re.compile("|".join(pattern.pattern for pattern in _FIELDS.values()))
_LONGEST_FIELD = 40
"""Most characters of the name of a field, without its prefix."""
_ANGLE = re.compile(
    r"(?:.*_)?(?:angle|theta|bearing|azimuth|phi)s?(?:_?\(?(?P<unit>deg|degrees?|°|rad|radians?)\)?)?"
    r"|(?P<bare>deg|degrees?|rad|radians?)"
)
_RANGE = re.compile(r"(?:.*_)?(?:ranges?|r|rho|distance|dist|radius|depth)(?:_?\(?(?:m|mm|cm|met[er]{2}s?)\)?)?")
_LAYER = re.compile(
    r"(?:.*_)?(?:elevations?|inclination|vertical(?:_angle)?|layer|ring|channel|laser)"
    r"(?:_?\(?(?:deg|degrees?|°|rad|radians?|id|index|idx|number|no|nr|num)\)?)?"
)
_SPHERE = re.compile(r"(theta|phi)(?:_?\(?(?:deg|degrees?|°|rad|radians?)\)?)?")
_SWEEP = re.compile(r"(?:sweep|scan|turn|revolution|rotation|seq|frame)(?:_?(?:id|index|idx|number|no|nr|num))?|id")

_SHOWN = 3
"""Most values of a column in a message."""
_RECORD = 1 << 20
"""Bytes within which the first record with a list must end, the list itself not counted."""


@dataclass(frozen=True, slots=True)
class Family:
    """Columns that hold the beams of one scan."""

    prefix: str
    """Prefix of the word for ranges: `field.`, `/scan/`, or nothing."""
    columns: Int64
    """(B,) Column of each beam."""

    @property
    def topic(self) -> str:
        """Topic by the prefix; `/scan` without one."""
        name = self.prefix.rstrip("._/ ")
        return DEFAULT_TOPIC if name.lower() in ("", "field", "msg", "data") else name


@dataclass(frozen=True, slots=True)
class LongColumns:
    """Columns of a table with one beam per row."""

    angle: int
    range: int
    sweep: int | None
    degrees: bool | None
    """None where the name says nothing."""


def canonical(name: str) -> str:
    """Return one spelling for a column name: `/scan/header.stamp` → `scan_header_stamp`.

    >>> canonical("%time"), canonical("field.header.frame_id"), canonical("Angle Min")
    ('time', 'field_header_frame_id', 'angle_min')
    """
    return _MARKS.sub("_", name.strip().lower()).strip("_")


class FieldIndex:
    """Columns that may be fields of a scan; each name is parsed once for all scans of a header."""

    def __init__(self, names: Sequence[str]) -> None:
        self._starts: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
        """Prefix → column and the fields it may be, in the order of the columns."""
        seen: Counter[tuple[str, tuple[str, ...]]] = Counter()
        again: Counter[str] = Counter()
        for column, name in enumerate(names):
            again[name] += 1
            if again[name] > len(_FIELDS):
                continue
            for start, fields in _endings(canonical(name)):
                # Columns of one kind beyond the number of fields they may be are never needed.
                if seen[start, fields] < len(fields):
                    seen[start, fields] += 1
                    self._starts.setdefault(start, []).append((column, fields))

    def find(self, prefix: str) -> dict[str, int]:
        """Return the columns of the fields of one scan: those with its prefix first, then those without any."""
        found: dict[str, int] = {}
        start = canonical(prefix) + "_" if canonical(prefix) else ""
        for begin in dict.fromkeys((start, "")):
            for column, fields in self._starts.get(begin, ()):
                for field in fields:
                    if field not in found:
                        found[field] = column
                        break
        if not {"seconds", "nanoseconds"} <= found.keys():
            found.pop("nanoseconds", None)
            if "seconds" in found:
                found.setdefault("record", found.pop("seconds"))
        if "record" not in found and "date" in found:
            found["record"] = found.pop("date")
        return found


def _endings(name: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield every way to read a canonical name as a prefix and a field: the prefix, and the fields it may be."""
    for place in range(max(len(name) - _LONGEST_FIELD, 0), len(name)):
        if (not place or name[place - 1] == "_") and _ANY_FIELD.fullmatch(name, place):
            yield (name[:place], tuple(field for field, pattern in _FIELDS.items() if pattern.fullmatch(name, place)))


def _series(names: Iterable[str]) -> dict[str, dict[int, int]]:
    """Return the stem of each name with an index → index → first column with it."""
    found: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        if (match := _INDEX.search(name)) is not None:
            stem = name[: match.start()].rstrip(_BEFORE_INDEX)
            found.setdefault(stem, {}).setdefault(int(match[1]), column)
    return found


def find_families(names: Sequence[str]) -> list[Family]:
    """Return the groups of columns `ranges[0]`, `ranges_1`, `r2`, ... that are the beams of a scan."""
    found = _series("" if "intens" in name.lower() else name.strip() for name in names)
    families = []
    for stem, columns in found.items():
        word = re.split(r"[./]", stem)[-1].strip(" _-").lower()
        indices = sorted(columns)
        whole = len(indices) >= 3 and indices[-1] - indices[0] == len(indices) - 1
        if whole and _RANGE_WORD.fullmatch(word):
            end = stem.lower().rfind("ranges")
            prefix = stem[:end] if end >= 0 else stem[: len(stem) - len(word)]
            ranged = end >= 0
            families.append((ranged, Family(prefix, np.array([columns[i] for i in indices], np.int64))))
    if any(ranged for ranged, _ in families):
        return [family for ranged, family in families if ranged]
    return [max((family for _, family in families), key=lambda family: len(family.columns))] if families else []


def find_intensities(names: Sequence[str]) -> dict[str, Int64]:
    """Return the columns `intensities[0]`, `intensities_1`, ... of each scan by their prefix in lower case."""
    lower = [name.strip().lower() for name in names]
    found = _series(name if "intens" in name else "" for name in lower)
    return {
        stem.removesuffix("intensities"): np.array([columns[index] for index in sorted(columns)], np.int64)
        for stem, columns in found.items()
        if stem.endswith("intensities") and max(columns) - min(columns) == len(columns) - 1
    }


def find_bearings(names: Sequence[str]) -> tuple[Family, float, float] | None:
    """Return columns that are named by their bearing, the first bearing and the step, as written."""
    numbers: dict[int, float] = {}
    for column, name in enumerate(names):
        text = name.strip().rstrip("°")
        if _DECIMAL.fullmatch(text):
            numbers[column] = float(text)
    columns = np.array(list(numbers), np.int64)
    values = np.array(list(numbers.values()))
    if len(values) < 3 or (np.diff(columns) != 1).any() or not np.isfinite(values).all():
        return None
    step = (values[-1] - values[0]) / (len(values) - 1)
    even = np.abs(values - values[0] - step * np.arange(len(values))).max() <= 0.25 * abs(step)
    counted = step == 1 and values[0] in (0, 1) and not any("." in names[c] for c in numbers)
    if not even or counted or not step:
        return None
    return Family("", columns), float(values[0]), float(step)


def _first_columns(names: Sequence[str]) -> dict[str, int]:
    """Return each canonical name once, and the first column that has it."""
    columns: dict[str, int] = {}
    for name, column in {name: column for column, name in reversed(list(enumerate(names)))}.items():
        plain = canonical(name)
        columns[plain] = min(column, columns.get(plain, column))
    return dict(sorted(columns.items(), key=lambda item: item[1]))


def find_long(names: Sequence[str]) -> LongColumns | None:
    """Return the columns of a table with one beam per row; None where it is none."""
    columns = _first_columns(names)
    angle = next(
        (
            (column, match)
            for name, column in columns.items()
            if (match := _ANGLE.fullmatch(name)) and not _LAYER.fullmatch(name)
        ),
        None,
    )
    distance = next((column for name, column in columns.items() if _RANGE.fullmatch(name)), None)
    if angle is None or distance is None:
        return None
    unit = angle[1]["unit"] or angle[1]["bare"]
    sweep = next((column for name, column in columns.items() if _SWEEP.fullmatch(name)), None)
    return LongColumns(angle[0], distance, sweep, None if unit is None else not unit.startswith("rad"))


def find_layers(names: Sequence[str]) -> list[int]:
    """Return the columns that may hold the layer of a beam: an elevation, a ring, one of the angles of a sphere."""
    columns = _first_columns(names)
    sphere = {match[1]: column for name, column in columns.items() if (match := _SPHERE.fullmatch(name))}
    layers = [column for name, column in columns.items() if _LAYER.fullmatch(name)]
    return layers + ([max(sphere.values())] if len(sphere) == 2 else [])


def list_column(names: Sequence[str], cells: Mapping[int, str]) -> tuple[int, str] | None:
    """Return the column whose cell is a list of ranges, and the prefix of its name."""
    for column, cell in cells.items():
        text = cell.strip()
        if not _LIST.match(text):
            continue
        name = names[column].strip()
        word = re.split(r"[./]", name)[-1].lower()
        if "intens" not in word and re.fullmatch(r".*(?:ranges?|scan|distances?|data|values?)", word):
            end = name.lower().rfind("ranges")
            return column, name[:end] if end >= 0 else ""
    return None


def ros_name(names: Sequence[str]) -> str:
    """Return the layout of the tool of ROS that has named the columns; plain wide for other names."""
    plain = [name.strip().lower() for name in names]
    if plain[0] == "%time":
        return ROSTOPIC
    if "__time" in plain:
        return PLOTJUGGLER
    if plain[:3] == ["log_time", "publish_time", "sequence"]:
        return MCAP_CAT
    if any(name.startswith("header.") for name in plain):
        return BAGPY
    return WIDE


def has_ros_header(names: Sequence[str]) -> bool:
    """Tell whether there are columns of a ROS header: without ranges, a log of something else."""
    plain = {canonical(name) for name in names}
    return bool(plain & {"header", "header_stamp", "header_frame_id", "header_stamp_secs", "header_stamp_sec"})


def with_header(head: Head) -> Layout:
    """Return the layout of rows below names; UnreadableError where none fits or geometry is missing."""
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
            return Layout(name if name != WIDE else LIST, head.dialect, head.start, notes=("no ranges in it",))
        refuse_numbered(head)
        raise head.unknown(f"a table with the columns {shown(', '.join(names).encode())}")
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
            head.need_geometry(name)
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
    """Return the fields around a family of range columns, and whether rows may be ragged."""
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
        head.units(fields),
        family.columns,
        first,
        doubled,
        # Those of ragged rows stand wherever the ranges end.
        none if doubled or len(beside) != len(family.columns) else beside,
        in_order and may_differ and (doubled or not after),
        geometry,
    )


def _of_mcap(head: Head, scan: Columns) -> Columns:
    """Return a scan with the fields of a foxglove.LaserScan, which has no header and no increment."""
    fields = dict(scan.fields)
    plain = [canonical(name) for name in head.names]
    if not {"stamp", "seconds"} & fields.keys() and "timestamp" in plain:
        fields["stamp"] = plain.index("timestamp")
    to_last = "angle_increment" not in fields and {"angle_min", "angle_max"} <= fields.keys()
    return replace(scan, fields=fields, units=head.units(fields), to_last=to_last)


def _list_layout(head: Head) -> Layout | None:
    """Return the layout of a list of ranges in one cell; None for other tables."""
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
        head.need_geometry(LIST)
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
    """Return the units of time columns, from the first record and all others that stand in one line."""
    records = [first]
    for line in head.lines[1:]:
        with suppress(ValueError):
            bare = empty_lists(line).decode("utf-8", "replace")
            records.append(csv_cells(bare, head.dialect.separator.decode()))
    rows = [[cell.encode() for cell in cells] for cells in records if len(cells) == len(head.names)]
    return replace(head, rows=rows).units(fields)


def _named_long_layout(head: Head, columns: LongColumns) -> Layout:
    """Return the layout of one beam per row by its columns; UnreadableError where beams lie in several layers."""
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
        if key is None and name in fields and repeats(cells := head.column(fields[name])):
            # A time with few digits changes within a turn as well.
            turns = len(cut_restarts(np.array([value_of(cell) for cell in head.column(columns.angle)], np.float64)))
            key = fields[name] if turns == 1 or sum(1 for _ in groupby(cells)) <= 2 * turns else None
    layout = head.long_layout(columns.angle, columns.range, key, columns.degrees, fields)
    if layout.degrees and "quality" in map(canonical, head.names):
        return replace(layout, notes=(*layout.notes, COUNTER_CLOCKWISE))
    return layout
