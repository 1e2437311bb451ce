"""The layouts of CSV: beams, geometry, times and frames by the names of the columns, in the file or by `--columns`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.blocks import given_geometry
from lidarcli.logs.cells import is_numeric, shown, value_of
from lidarcli.logs.clock import NO_STAMPS
from lidarcli.logs.csv.column_names import (
    ANGLE,
    BEAM,
    BEFORE_INDEX,
    INDEX,
    LAYER,
    LENGTH,
    OF_NO_USE,
    SPHERE,
    SWEEP,
    FieldIndex,
    canonical,
    find_families,
    find_intensities,
)
from lidarcli.logs.csv.table import TRAJECTORY, Dialect, Head, csv_cells, empty_lists
from lidarcli.sweeps.types import TURN, Float64, Int64

ROSTOPIC = "rostopic echo -p"
ROS2 = "ros2 topic echo --csv"
PLOTJUGGLER = "PlotJuggler"
BAGPY = "bagpy"
MCAP_CAT = "mcap cat --format=csv"
LIST = "list of ranges"
WIDE = "plain wide"
LONG = "long form"
PER_SWEEP = "one file per sweep"
RPLIDAR = "RPLIDAR"
LAYOUTS = (ROSTOPIC, ROS2, PLOTJUGGLER, BAGPY, MCAP_CAT, LIST, WIDE, LONG, PER_SWEEP)

DEFAULT_TOPIC = "/scan"
COUNTER_CLOCKWISE = "bearings run counter-clockwise; name them `clockwise` where they are those of an RPLIDAR"
NUMBERED = "the beam of the lowest number is the first"
ABBREVIATED = "the arrays are abbreviated ('...'): record again with `ros2 topic echo --csv --full-length`"

_LIST = re.compile(r"(?:\w[\w.]*\s*\()?\s*[\[(]|\w*array\(")
_RANGE = re.compile(rf"(?:.*_)?(?:ranges?|r|rho|distance|dist|radius|depth)(?:_?\(?{LENGTH}\)?)?")
_IN_LENGTH = re.compile(rf"(?:^|(?<=[^a-z]))({LENGTH})(?=[^a-z]|$)")
_SCALES = {"mm": 0.001, "mi": 0.001, "cm": 0.01, "ce": 0.01}
"""First letters of a unit of length → metres."""
_SHOWN = 3
_NUMBERS = re.compile(r"\s*[-+.\dainfAINF][^\s,;|]*(?:[\s,;|]+[-+.\dainfAINF][^\s,;|]*){2,}\s*")
"""Cell of numbers without brackets."""
_RECORD = 1 << 20
"""Bytes within which the first record with a list must end, the list itself not counted."""
_POSE = 8
"""Numbers in a row of a trajectory: time, place and quaternion."""
_MIN_COUNT = 16
_MAX_OF_BEAM = 3
"""Most numbers in a row for it to be taken for a beam: bearing, range, quality."""
_NO_COLUMNS = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class ScanColumns:
    """Columns of one scan, and the units of its times."""

    topic: str
    fields: dict[str, int]
    """Field of `FIELDS` → its column."""
    units: dict[str, int] = field(default_factory=dict)
    """`record`, `stamp` and `date` → nanoseconds per unit, see `times.time_unit`."""
    ranges: Int64 = field(default_factory=lambda: _NO_COLUMNS)
    """(B,) Column of each beam; empty where `first` is enough."""
    first: int = 0
    doubled: bool = False
    """True where as many intensities follow the ranges, up to the end of the row."""
    intensities: Int64 = field(default_factory=lambda: _NO_COLUMNS)
    """(B,) Column of each intensity where they stand elsewhere; of a list of ranges, the column of their list."""
    open_end: bool = False
    """True where only ranges (and intensities) stand from `first` to the end of a row: rows may be ragged."""
    to_last: bool = False
    """True where `angle_max` is the bearing of the last beam and gives the increment (foxglove.LaserScan)."""
    ends_before: bool = False
    """True where `angle_max` is a step past the last beam: empty cells tell so."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a CSV, as far as its first lines show it: a row is a sweep, or a beam (long form)."""

    name: str
    dialect: Dialect
    start: int
    header: bytes = b""
    """Header line as it stands; it is left out wherever it is repeated."""
    width: int = 0
    scans: tuple[ScanColumns, ...] = ()
    sparse: bool = False
    """True where rows hold one topic or another: a row without any range of a topic is no sweep of it."""
    listed: bool = False
    brackets: bytes = b"["
    angle: int = -1
    """Long form: column of the bearing; -1 in other forms."""
    key: int | None = None
    """Long form: column that changes from sweep to sweep."""
    numbered: bool = False
    """Long form: `angle` holds numbers of beams, whose bearings the options tell."""
    degrees: bool = False
    clockwise: bool = False
    flag: int = -1
    """Long form: column that is 1 at the start of a sweep; -1 without."""
    spelling: str = ""
    """Long form: text of a tool for RPLIDAR sensors (`rplidar`); empty for a table."""
    scale: float | None = None
    notes: tuple[str, ...] = ()
    passed: tuple[str, ...] = ()
    """Names of columns that are passed over."""
    unread: dict[str, str] = field(default_factory=dict)
    """Topic → a note on a column of times that is not understood."""


class NamelessError(UnreadableError):
    """A table has no names of columns."""

    def __init__(self, message: str, per_sweep: bool = False) -> None:
        super().__init__(message)
        self.per_sweep = per_sweep
        """True where its rows look like the beams of one sweep."""


def expected_beams(angle_min: Float64, angle_max: Float64, increment: Float64) -> Int64:
    """Return the beams (K,) of views and increments; -1 where these make none."""
    with np.errstate(all="ignore"):
        steps = (angle_max - angle_min) / increment
    sane = np.isfinite(steps) & (steps > -0.5) & (steps < 1e7)
    return np.where(sane, np.rint(np.where(sane, steps, 0)).astype(np.int64) + 1, -1)


def layout_of(head: Head) -> Layout:
    """Return the layout of a table; UnreadableError where none fits, or names or geometry are missing."""
    columns = head.options.columns
    if not columns and not head.names:
        for row in head.rows:
            if _is_ros2(row):
                return _ros2_layout(head, row)
        raise _nameless(head)
    if columns:
        head.options.used.add("columns")
        head = replace(head, names=_expanded(head, columns))
    elif head.usual > len(head.names) and "ranges" in head.names:
        # A list without quotes is as many cells.
        head = replace(head, names=_expanded(head, head.names))
    head = replace(head, names=_without_empty(head.names, head.rows))
    layout = _named_layout(head)
    passed = () if columns or layout.name not in (LIST, WIDE, LONG, PER_SWEEP) else _passed_over(head.names, layout)
    return replace(layout, unread=unread_times(head, layout.scans), passed=passed)


def _without_empty(names: list[str], rows: Sequence[Sequence[bytes]]) -> list[str]:
    """Return the names, empty ones in place of columns that are empty throughout, but those of beams."""
    whole = [row for row in rows if len(row) == len(names)]
    empty = [not any(row[column] for row in whole) for column in range(len(names))]
    families = [columns for _, columns in find_families(names)]
    if not whole or (len(families) > 1 and any(empty[column] for columns in families for column in columns.tolist())):
        # In a table of several topics, a topic may begin behind the first rows.
        return names
    kept = (
        not gone or INDEX.search(name) or _RANGE.fullmatch(canonical(name)) for name, gone in zip(names, empty, strict=True)
    )
    return [name if keep else "" for name, keep in zip(names, kept, strict=True)]


def _passed_over(names: Sequence[str], layout: Layout) -> tuple[str, ...]:
    """Return the names of columns that are neither used nor known to be of no use."""
    used = {layout.angle, layout.key}
    for scan in layout.scans:
        used |= {scan.first, *scan.fields.values(), *scan.ranges.tolist(), *scan.intensities.tolist()}
    return tuple(
        name
        for column, name in enumerate(names)
        if name and column not in used and "intens" not in name.lower() and not OF_NO_USE.fullmatch(canonical(name))
    )


def unread_times(head: Head, scans: Sequence[ScanColumns]) -> dict[str, str]:
    """Return a note for each topic with a column of times that is not understood."""
    notes: dict[str, str] = {}
    for scan in scans:
        for name in sorted({"record", "stamp"} & scan.fields.keys() - scan.units.keys()):
            column = scan.fields[name]
            if not any(head.column(column)):
                continue
            others = scan.units or {"seconds", "header"} & scan.fields.keys()
            so = "another column tells them" if others else NO_STAMPS
            value = shown(head.column(column)[0], 30)[1:-1]
            notes[scan.topic] = f"times of column `{head.names[column]}` are not understood ({value}): {so}"
    return notes


def _need_geometry(head: Head, name: str) -> None:
    """Raise UnreadableError, with the options that help, where neither file nor options give the bearings."""
    if given_geometry(head.options, 2) is None:
        raise UnreadableError(
            f"{head.path}: CSV ({name}) without geometry: give --angle-min and --angle-increment, or --fov"
            " (radians, or degrees with --degrees)"
        )


def _unknown(head: Head, what: str) -> UnreadableError:
    return UnreadableError(
        f"{head.path}: {what} is none of the CSV layouts: {'; '.join(LAYOUTS)}; --columns names its columns"
    )


# Tables without names.


def _is_ros2(row: Sequence[bytes]) -> bool:
    """Return whether a row begins like those of `ros2 topic echo --csv`: seconds, nanoseconds, frame."""
    return (
        len(row) >= 4
        and re.fullmatch(rb"-?\d{1,10}", row[0]) is not None
        and re.fullmatch(rb"\d{1,9}", row[1]) is not None
        and bool(row[2])
        and not is_numeric(row[2])
    )


def _ros2_layout(head: Head, row: Sequence[bytes]) -> Layout:
    values = [value_of(cell) for cell in row[3:10]]
    if len(values) < 7 or any(value is None for value in values):
        return Layout(ROS2, head.dialect, head.start, notes=("no LaserScan in it",))
    if any(cell == b"..." for cell in row):
        raise UnreadableError(f"{head.path}: CSV ({ROS2}): {ABBREVIATED}")
    names = "seconds nanoseconds frame angle_min angle_max angle_increment time_increment scan_time range_min range_max"
    rest = len(row) - 10 - (not row[-1])
    expected = expected_beams(*(np.array([values[i]], np.float64) for i in range(3)))[0]
    doubled = rest % 2 == 0 and abs(rest // 2 - expected) < abs(rest - expected)
    fields = {name: column for column, name in enumerate(names.split())}
    scan = ScanColumns(DEFAULT_TOPIC, fields, first=10, doubled=doubled, open_end=True)
    notes = ("intensities follow the ranges",) if doubled else ()
    return Layout(ROS2, head.dialect, head.start, width=len(row), scans=(scan,), notes=notes)


def _expanded(head: Head, columns: Sequence[str]) -> list[str]:
    """Return a name for each column: `NAME*N` for N of them, `ranges` and `intensities` for what the others leave."""
    width = head.usual or Counter(map(len, head.rows)).most_common(1)[0][0] if head.rows else len(head.names)
    parts = [(name.strip(), count.strip()) for name, _, count in (each.partition("*") for each in columns)]
    is_open = [name in ("ranges", "intensities") and not count for name, count in parts]
    fixed = sum(int(count or 1) for (_, count), open_ in zip(parts, is_open, strict=True) if not open_)
    each, rest = divmod(width - fixed, sum(is_open) or 1)
    if each < any(is_open) or rest or (each and not any(is_open)):
        source = "--columns" if head.options.columns else "the first line"
        raise UnreadableError(
            f"{head.path}: {source} {','.join(columns)} names {fixed}{' and more' if any(is_open) else ''} columns, "
            f"and rows have {width}, such as {shown((head.lines or [head.header])[0], 60)}"
        )
    names = []
    for (name, count), open_ in zip(parts, is_open, strict=True):
        number = each if open_ else int(count or 1)
        names += [name] if number == 1 else [f"{name}[{place}]" for place in range(number)]
    return names


def _nameless(head: Head) -> UnreadableError:
    """Return the error for a table without names, with names that the user may copy."""
    width = head.usual or Counter(map(len, head.rows)).most_common(1)[0][0]
    rows = [row for row in head.rows if len(row) == width and all(map(is_numeric, row[2:]))]
    listed = any(_LIST.match(row[-1].decode("utf-8", "replace")) for row in rows[:1])
    if not rows or (width < 2 and not listed):
        return _unknown(head, f"lines like {shown(head.lines[0], 60)}")
    if width == _POSE:
        table = np.array([[value_of(cell) for cell in row] for row in rows], np.float64)
        with np.errstate(invalid="ignore", over="ignore"):
            length = np.sqrt((table[:, 4:] ** 2).sum(axis=1))
        if (np.abs(length - 1.0) < 0.01).all():
            return UnreadableError(f"{head.path}: {TRAJECTORY.refusal}")
    if _holds_beams([value_of(cell) for cell in rows[0]]):
        raise UnreadableError(
            f"{head.path}: rows such as {shown(head.lines[0], 60)} hold beams of several numbers one after the other "
            "(bearing, range, ...): write each beam on a line of its own, and name the columns: --columns time,angle,range"
        )
    first = "time," * (width > 1)
    return NamelessError(
        f"{head.path}: a table of {width} columns without names, such as {shown(head.lines[0], 60)}: name them, for "
        f"example --columns {first}ranges with a sweep in each row (and the bearings by --fov, or --angle-min and "
        "--angle-increment), or --columns angle,range with a beam in each row; `clockwise` in place of `angle` for an "
        "RPLIDAR, `beam` for the number of a beam",
        per_sweep=width <= _MAX_OF_BEAM and not listed,
    )


def _holds_beams(values: Sequence[float | None]) -> bool:
    """Return whether each second or third number of a row is a bearing that goes on in degrees or radians."""
    numbers = np.array(values, np.float64)

    def even(numbers: Float64) -> bool:
        """Return whether most steps are alike."""
        steps = np.diff(numbers)
        middle = np.median(steps) if len(steps) > 8 else 0.0
        return bool(middle and np.mean(np.abs(steps - middle) <= 0.5 * abs(middle)) >= 0.9)

    series = (numbers[first::period] for period in (2, 3) for first in range(2 * period))
    return not even(numbers) and any(even(each) and np.max(np.abs(each)) <= 361.0 for each in series)


# Tables with names.


def _topic(prefix: str) -> str:
    """Return the topic by the prefix of the word for ranges (`field.`, `/scan/`); `/scan` without one."""
    name = prefix.rstrip("._/ ")
    return DEFAULT_TOPIC if name.lower() in ("", "field", "msg", "data") else name


def _ros_name(names: Sequence[str]) -> str:
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


def _named_layout(head: Head) -> Layout:
    names = head.names
    if listed := _list_layout(head):
        return listed
    name = _ros_name(names)
    families = find_families(names)
    if not families:
        if long := _long_layout(head):
            return long
        plain = {canonical(name) for name in names}
        if name != WIDE or plain & {"header", "header_stamp", "header_frame_id", "header_stamp_secs", "header_stamp_sec"}:
            return Layout(name if name != WIDE else LIST, head.dialect, head.start, notes=("no ranges in it",))
        if {"x", "y"} <= plain:
            raise UnreadableError(
                f"{head.path}: columns x and y are points or poses, not beams: lidarcli reads points with their bearing, "
                "atan2(y, x), in a column `angle`, and their distance, hypot(x, y), in a column `range`"
            )
        raise _unknown(head, f"a table with the columns {shown(', '.join(names).encode(), 60)}")
    index, strengths = FieldIndex(names), find_intensities(names)
    scans = [_scan_columns(head, index, strengths, *family) for family in families]
    if name == MCAP_CAT:
        scans = [_of_mcap(head, each) for each in scans]
    for each in scans:
        if not each.to_last and not {"angle_min", "angle_increment"} <= each.fields.keys():
            _need_geometry(head, name)
    beams = ", ".join(f"{len(each.ranges)} ranges of {each.topic}" for each in scans)
    return Layout(
        name,
        head.dialect,
        head.start,
        head.header,
        len(names),
        tuple(scans),
        sparse=name == PLOTJUGGLER or len(scans) > 1,
        scale=_scale(head, int(scans[0].ranges[0])),
        notes=(beams,),
    )


def _scale(head: Head, column: int) -> float | None:
    """Return the metres of a unit of ranges, by the name of their column; None where this or an option does not tell it."""
    name = head.names[column].strip()
    stem = INDEX.sub("", name).rstrip(BEFORE_INDEX)
    unit = _IN_LENGTH.search(re.split(r"[./]", stem or name)[-1].lower())
    return _SCALES.get(unit[1][:2]) if unit and head.options.range_scale == 1.0 else None


def _scan_columns(
    head: Head, index: FieldIndex, strengths: Mapping[str, Int64], prefix: str, columns: Int64
) -> ScanColumns:
    """Return the fields around a family of range columns, and whether rows may be ragged."""
    fields = index.find(prefix)
    first, last = int(columns[0]), int(columns[-1])
    in_order = bool((np.diff(columns) == 1).all())
    after = len(head.names) - last - 1
    # Where the step is given, rows of fewer ranges have a narrower view; where the view is, they are cut or joined.
    tells_view = {"angle_min", "angle_max", "angle_increment"} <= fields.keys()
    may_differ = tells_view or head.options.angle_increment is not None or head.usual != len(head.names)
    own = strengths.get(prefix.lower(), _NO_COLUMNS)
    doubled = after == len(columns) and all("intens" in name.lower() for name in head.names[-after:])
    return ScanColumns(
        _topic(prefix),
        fields,
        head.units(fields),
        columns,
        first,
        doubled,
        # Those of ragged rows stand wherever the ranges end.
        _NO_COLUMNS if doubled or len(own) != len(columns) else own,
        in_order and may_differ and (doubled or not after),
        ends_before=tells_view and _ends_before(head.rows, fields, columns),
    )


def _ends_before(rows: Sequence[Sequence[bytes]], fields: Mapping[str, int], columns: Int64) -> bool:
    """Return whether in each of the first rows the last beam by `angle_max`, and that one alone, is an empty cell."""
    beams = columns.tolist()
    rows = [row for row in rows if len(row) > max(beams)]
    told = ([value_of(row[fields[name]]) for row in rows] for name in ("angle_min", "angle_max", "angle_increment"))
    views = expected_beams(*(np.array(values, np.float64) for values in told))
    return len(rows) > 1 and all(
        1 < view <= len(beams) and row[beams[view - 2]] and not any(row[column] for column in beams[view - 1 :])
        for row, view in zip(rows, views.tolist(), strict=True)
    )


def _of_mcap(head: Head, scan: ScanColumns) -> ScanColumns:
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
    # Units of times come from the first record and all others that stand in one line.
    records = [cells]
    for line in head.lines[1:]:
        with suppress(ValueError):
            records.append(csv_cells(empty_lists(line).decode("utf-8", "replace"), head.dialect.separator.decode()))
    rows = [[cell.encode() for cell in record] for record in records if len(record) == len(head.names)]
    if not rows and any(map(_LIST.match, map(str.strip, cells))):
        raise UnreadableError(
            f"{head.path}: {len(cells)} cells where the first line has {len(head.names)} names, such as "
            f"{shown(head.lines[0], 60)}: take out the name too many, or add the missing one"
        )
    found = _list_column(head.names, cells)
    if found is None:
        return None
    listed, prefix = found
    fields = FieldIndex(head.names).find(prefix)
    units = replace(head, rows=rows).units(fields)
    if not {"angle_min", "angle_increment"} <= fields.keys():
        _need_geometry(head, LIST)
    name = _ros_name(head.names)
    lower = [each.strip().lower() for each in head.names]
    own = f"{prefix}intensities".lower()
    intensities = np.array([lower.index(own)] if own in lower else [], np.int64)
    scan = ScanColumns(_topic(prefix), fields, units, first=listed, intensities=intensities)
    return Layout(
        LIST if name == WIDE else f"{name}, {LIST}",
        head.dialect,
        head.start,
        head.header,
        len(head.names),
        (scan,),
        listed=True,
        brackets=next((mark for mark in (b"[", b"(") if mark in cells[listed].encode()), b""),
        scale=_scale(head, listed),
    )


def _list_column(names: Sequence[str], cells: Sequence[str]) -> tuple[int, str] | None:
    """Return the column whose cell is a list of ranges, and the prefix of its name."""
    for column, (name, cell) in enumerate(zip(names, cells, strict=False)):
        word = re.sub(rf"(?<![_ (\[])[_ (\[]+{LENGTH}[)\]]?$", "", re.split(r"[./]", name.strip())[-1].lower())
        is_ranges = "intens" not in word and re.fullmatch(r".*(?:ranges?|scan|distances?|data|values?)", word)
        if is_ranges and (_LIST.match(cell.strip()) or _NUMBERS.fullmatch(cell)):
            end = name.strip().lower().rfind("ranges")
            return column, name.strip()[:end] if end >= 0 else ""
    return None


def _long_layout(head: Head) -> Layout | None:
    """Return the layout of one beam per row; None for other tables, UnreadableError where beams lie in several layers."""
    columns: dict[str, int] = {}
    for column, name in enumerate(head.names):
        columns.setdefault(canonical(name), column)

    def first(pattern: re.Pattern[str]) -> int | None:
        return next((column for name, column in columns.items() if pattern.fullmatch(name)), None)

    bearings = ((column, ANGLE.fullmatch(name)) for name, column in columns.items() if not LAYER.fullmatch(name))
    angle, match = next(((column, match) for column, match in bearings if match), (-1, None))
    distance, key, number = first(_RANGE), first(SWEEP), first(BEAM)
    if distance is None or (match is None and number is None):
        return None
    numbered = match is None
    if match is None:
        _need_geometry(head, LONG)
        angle = int(number or 0)
    whole = [row for row in head.rows if len(row) == len(head.names)]
    if key is None and _has_heads([(value_of(row[angle]), value_of(row[distance])) for row in whole]):
        raise UnreadableError(
            f"{head.path}: lines such as {shown(head.lines[0], 60)} are no beams, but heads with the number of a sweep and "
            "of its beams: take them out, for sweeps begin where the bearing starts over"
        )
    sphere = {part[1]: column for name, column in columns.items() if (part := SPHERE.fullmatch(name))}
    layers = [column for name, column in columns.items() if LAYER.fullmatch(name)]
    for column in [*layers, *([max(sphere.values())] if len(sphere) == 2 else [])]:
        values = list(dict.fromkeys(head.column(column)))
        if len(values) > 1:
            some = ", ".join(map(shown, values[:_SHOWN])) + (", ..." if len(values) > _SHOWN else "")
            raise UnreadableError(
                f"{head.path}: one beam per row, in several layers (column {shown(head.names[column].encode(), 60)}"
                f" holds {some}); lidarcli reads scans of one plane: keep the rows of one layer"
            )
    fields = FieldIndex(head.names).find("")
    for name in ("seq", "frame"):
        if fields.get(name) == key:
            fields.pop(name, None)
    numbers = np.array([value_of(cell) for cell in head.column(angle)], np.float64)
    for name in ("stamp", "record"):
        if key is None and name in fields:
            cells = head.column(fields[name])
            if sum(a == b for a, b in pairwise(cells)) > len(cells) // 3:
                # A time with few digits changes within a turn as well.
                turns = len(cut_restarts(numbers))
                key = fields[name] if turns == 1 or sum(1 for _ in groupby(cells)) <= 2 * turns else None
    unit, notes = (match["unit"] or match["bare"], []) if match else ("rad", [NUMBERED])
    degrees = not unit.startswith("rad") if unit else bool(np.nanmax(np.abs(numbers), initial=0.0) > TURN + 0.1)
    if degrees and not unit:
        notes.append("bearings beyond a turn in radians: taken as degrees")
    clockwise = bool(match and match["clockwise"])
    if degrees and not clockwise and "quality" in columns:
        notes.append(COUNTER_CLOCKWISE)
    return Layout(
        PER_SWEEP if key is None else LONG,
        head.dialect,
        head.start,
        head.header,
        len(head.names),
        (ScanColumns(DEFAULT_TOPIC, fields, head.units(fields), first=distance),),
        angle=angle,
        key=key,
        numbered=numbered,
        degrees=degrees,
        clockwise=clockwise,
        scale=_scale(head, distance),
        notes=tuple(notes),
    )


def _has_heads(rows: Sequence[tuple[float | None, float | None]]) -> bool:
    """Return whether pairs of numbers are heads, a number that rises by 1 and a count, with as many pairs behind each."""
    at, numbers = 0, []
    while at < len(rows) and (count := rows[at][1]) and count.is_integer() and count >= _MIN_COUNT:
        numbers.append(rows[at][0])
        at += int(count) + 1
    steps = {None if a is None or b is None else b - a for a, b in pairwise(numbers)}
    return steps == {1.0} if len(numbers) > 1 else len(numbers) == 1 and at == len(rows)


def cut_restarts(angle: Float64) -> Int64:
    """Return the first row of each sweep without a key: the bearing jumps back by most of the view.

    A single jump between two parts of the turn that do not overlap is the seam of one sweep.

    >>> cut_restarts(np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2])).tolist()
    [0, 3]
    >>> cut_restarts(np.array([3.0, 3.1, -3.1, -3.0])).tolist()
    [0]
    """
    start = np.zeros(1, np.int64)
    if len(angle) < 3:
        return start
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(angle)
        middle = np.nanmedian(steps) if np.isfinite(steps).any() else 0.0
        view = np.nanmax(angle) - np.nanmin(angle) if np.isfinite(angle).any() else 0.0
        back = (steps * np.sign(middle) < 0) & (np.abs(steps) > max(0.5 * view, 1.5 * abs(middle)))
    jumps = np.flatnonzero(back) + 1
    if len(jumps) == 1:
        before, after = angle[: jumps[0]], angle[jumps[0] :]
        if np.nanmin(before) > np.nanmax(after) or np.nanmax(before) < np.nanmin(after):
            return start
    return np.concatenate([start, jumps])
