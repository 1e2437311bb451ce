"""Layouts of tables without column names, by their numbers alone.

Numbers do not say what they are, so a table is refused where something speaks against one sweep per row. The beams of a
scan are of one kind: none goes below zero time and again, none counts, none is far beyond all others, and neighbours are
mostly alike.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import UnreadableError
from lidarcli.logs.blocks import FAR
from lidarcli.logs.csv.dialect import TRAJECTORY
from lidarcli.logs.csv.layouts import (
    ABBREVIATED,
    CORESLAM,
    DEFAULT_TOPIC,
    MILLIMETRE,
    ROS2,
    TITLES,
    WIDE,
    Columns,
    Head,
    Layout,
    expected_beams,
    numeric,
    repeats,
    shown,
    value_of,
)
from lidarcli.logs.times import NO_NUMBERS, US, S, time_unit
from lidarcli.sweeps import TURN, Bool, Float64, Int64

_SEQ_STEP = 10
"""Bound of the step of sequence numbers."""
_SEQ_STEP_MOST = 1000
"""Bound of the step of sequence numbers before a column that must be a time."""

_CORESLAM_STATE = 24
"""Cells before the ranges: a time [µs], wheel ticks, and what else the robot has measured."""
_CORESLAM_BEAMS = 682
"""Ranges of a URG-04LX."""
_CORESLAM_STEP = np.pi / 512
"""Angle between beams [rad]; the middle one looks ahead."""
_CORESLAM_NEAREST, _CORESLAM_FARTHEST = 20.0, 6000.0
"""Limits of the sensor [mm]; smaller numbers are codes of errors."""
_CORESLAM_ROWS = 2
"""Least rows by which the layout is recognised."""

AS_RPLIDAR = "write `#RPLIDAR SCAN DATA` and `#{}` as the first lines"
LEAST_NUMBERS = 8
"""Least numbers in a row that is a sweep."""
LEAST_ROWS = 5
"""Least rows by which columns are judged."""
COUNTER_ROWS = 30
"""Least rows that show a counter without a step back, or a bearing that starts over."""
FAR_BEYOND = 100.0
"""Factor by which the median of a column before a scan exceeds all others where it holds no ranges."""
FAR_COLUMNS = 32
"""Least columns for that: a scan of fewer may see far in one direction alone."""
UNLIKE = 10.0
"""Factor between the medians of neighbours that are unlike."""
MOST_UNLIKE = 0.6
"""Share of unlike neighbours that no scan has."""
_FEW = 4
"""Most columns side by side that may be no ranges; more of them are a part of the scan that differs."""
_DISTINCT = 3
"""Least distinct values of a column that varies, or goes below zero; fewer may be markers of missing ranges."""
_BELOW_ALONE = 10
"""Least distinct values below zero of a single column."""
_MANY = 4
"""Least ratio of varying whole columns to decimal ones that are of another kind."""
_COUNTS = 10
"""Least distinct values of a counter."""
_WHOLE = 5
"""Least distinct values of a column of whole numbers among decimals."""
_DECIMAL = 0.1
"""Greatest share of whole numbers in a table of decimals."""
_LEAST_PAIRS = 5
"""Least columns whose neighbours are compared."""


def without_header(head: Head) -> Layout:
    """Return the layout of rows without names; UnreadableError where none fits or geometry is missing."""
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
        raise head.unknown(f"lines like {shown(head.lines[0])}")
    head = replace(head, rows=rows)
    if width <= 3 and (layout := _bare_long(head, width)):
        return layout
    if width < 3:
        refuse_numbered(head)
        raise head.unknown(f"a table of {width} columns without names, such as {shown(head.lines[0])}")
    fields, first = _leading(rows)
    refuse_other_tables(head, rows, first)
    words = [name for name, _ in sorted(fields.items(), key=lambda item: item[1])]
    head.need_geometry(WIDE)
    # A view that is told once for all makes of a beam that is missing another step between all others.
    usual = usual if head.options.fov is not None else 0
    ranges = np.arange(first, usual)
    scan = Columns(DEFAULT_TOPIC, fields, head.units(fields), ranges, first, open_end=not usual)
    notes = [f"no header; columns taken as {', '.join([*words, 'ranges'])}"]
    if not first:
        notes.append("no time column: all stamps are 0")
    return Layout(WIDE, head.dialect, head.start, width=usual, scans=(scan,), notes=tuple(notes))


def _is_ros2(row: Sequence[bytes]) -> bool:
    """Tell whether a row begins like those of `ros2 topic echo --csv`: seconds, nanoseconds, frame."""
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
        raise head.unknown(f"lines like {shown(head.lines[0])}")
    if any(cell == b"..." for cell in row):
        raise UnreadableError(f"{head.path}: CSV ({ROS2}): {ABBREVIATED}")
    names = "seconds nanoseconds frame angle_min angle_max angle_increment time_increment scan_time range_min range_max"
    rest = len(row) - 10 - (not row[-1])
    expected = expected_beams(*(np.array([values[i]], np.float64) for i in range(3)))[0]
    doubled = rest % 2 == 0 and abs(rest // 2 - expected) < abs(rest - expected)
    scan = Columns(
        DEFAULT_TOPIC, {name: column for column, name in enumerate(names.split())}, first=10, doubled=doubled, open_end=True
    )
    notes = ("intensities follow the ranges",) if doubled else ()
    return Layout(ROS2, head.dialect, head.start, width=len(row), scans=(scan,), notes=notes)


def _bare_long(head: Head, width: int) -> Layout | None:
    """Return the layout of two columns (bearing, range) or three (sweep or stamp first); None for other tables."""
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
        return head.long_layout(0, 1, None, None, {})
    keys = head.column(0)
    # A key that comes back is none: an angle or a layer; nor is one that stays the same for turn after turn.
    if not repeats(keys) or len(set(keys)) < sum(1 for _ in groupby(keys)):
        return None
    if len(set(keys)) == 1 and restarts(angles) and is_turn(angles):
        return None
    counted = all(cell.isdigit() for cell in keys) and time_unit("", keys) == S
    return head.long_layout(1, 2, 0, None, {} if counted else {"record": 0})


@dataclass(frozen=True, slots=True)
class _Column:
    """A column whose meaning is guessed by its values."""

    cells: list[bytes]
    values: list[float | None]

    @classmethod
    def of(cls, rows: Sequence[Sequence[bytes]], index: int) -> _Column:
        """Take column `index` of rows."""
        cells = [row[index] for row in rows]
        return cls(cells, [value_of(cell) for cell in cells])

    @property
    def is_date(self) -> bool:
        """True where all cells are dates."""
        return time_unit("", self.cells) in NO_NUMBERS

    @property
    def is_whole(self) -> bool:
        """True where all cells are whole numbers."""
        return all(re.fullmatch(rb"-?\d+", cell) for cell in self.cells)

    @property
    def rises(self) -> bool:
        """True where the numbers never fall, and rise somewhere."""
        values = [value for value in self.values if value is not None]
        return len(values) == len(self.cells) and values == sorted(values) and values[-1] > values[0]


def _leading(rows: Sequence[Sequence[bytes]]) -> tuple[dict[str, int], int]:
    """Return the fields before the ranges, and the first column of ranges."""
    first, second = (_Column.of(rows, index) for index in range(2))
    if first.is_date:
        return ({"date": 0, "record": 1}, 2) if second.is_date else ({"record": 0}, 1)
    if _are_seconds(first, second):
        return {"seconds": 0, "nanoseconds": 1}, 2
    if _is_counter(first) and _is_time_behind_counter(rows, first, second):
        return {"seq": 0, "record": 1}, 2
    if len(rows) == 1 or first.rises or len(set(first.cells)) == 1:
        return {"record": 0}, 1
    return {}, 0


def _are_seconds(first: _Column, second: _Column) -> bool:
    """Tell whether two columns are the whole seconds of times and their nanoseconds."""
    return (
        first.is_whole
        and second.is_whole
        and all(value is not None and value >= 1e8 for value in first.values)
        and all(value is not None and 0 <= value < 1e9 for value in second.values)
        and max(value or 0 for value in second.values) > 1e5
    )


def _is_counter(column: _Column) -> bool:
    """Tell whether a column may hold sequence numbers."""
    small = column.is_whole and all(value is not None and abs(value) < 1e8 for value in column.values)
    return small and (column.rises or len(column.cells) == 1)


def _is_time_behind_counter(rows: Sequence[Sequence[bytes]], counter: _Column, column: _Column) -> bool:
    """Tell whether the column behind possible sequence numbers holds times."""
    others = [abs(value) for cell in rows[0][2:] if (value := value_of(cell)) is not None]
    beyond = column.values[0] is not None and column.values[0] > 10 * max(others, default=0)
    if column.is_date or len(rows) == 1:
        return column.is_date or beyond
    step = float(np.median(np.diff(np.array(counter.values, np.float64))))
    # What rises in large steps is a time itself, and what rises behind it may be a range.
    sure = step < _SEQ_STEP or (step < _SEQ_STEP_MOST and (beyond or len(rows) >= COUNTER_ROWS))
    return column.rises and sure


def find_coreslam(head: Head) -> Layout | None:
    """Return the layout of CoreSLAM's and BreezySLAM's `.dat` logs: time, state of the robot, ranges of a URG-04LX.

    None unless rows can be nothing else: by their length, a time that rises, ticks, and whole millimetres.
    """
    width = len(head.rows[0])
    rows = [row for row in head.rows if len(row) == width]
    if (
        width not in (_CORESLAM_STATE + _CORESLAM_BEAMS, _CORESLAM_STATE + _CORESLAM_BEAMS + 1)
        or len(rows) < _CORESLAM_ROWS
        or head.dialect.separator != b" "
    ):
        return None
    table = np.array([[value_of(cell) for cell in row] for row in rows], np.float64)
    time, ticks, ranges = table[:, 0], table[:, 1:_CORESLAM_STATE], table[:, _CORESLAM_STATE:]
    if not ((np.diff(time) > 0).all() and (time == np.rint(time)).all() and (ticks > _CORESLAM_FARTHEST).any()):
        return None
    if not ((ranges == np.rint(ranges)).all() and (ranges >= 0).all() and (ranges <= _CORESLAM_FARTHEST).all()):
        return None
    scan = Columns(
        DEFAULT_TOPIC,
        {"record": 0},
        {"record": US},
        np.arange(_CORESLAM_STATE, _CORESLAM_STATE + _CORESLAM_BEAMS),
        _CORESLAM_STATE,
        geometry=(-0.5 * (_CORESLAM_BEAMS - 1) * _CORESLAM_STEP, _CORESLAM_STEP),
        nearest=_CORESLAM_NEAREST,
    )
    notes = ("682 ranges of a URG-04LX in millimetres, times in microseconds",)
    return Layout(CORESLAM, head.dialect, head.start, width=width, scans=(scan,), scale=MILLIMETRE, notes=notes)


def refuse_other_tables(head: Head, rows: Sequence[Sequence[bytes]], first: int) -> None:
    """Raise UnreadableError where rows (the ranges from column `first` on) are not one sweep each."""
    width = Counter(map(len, rows)).most_common(1)[0][0]
    alike = [row for row in rows if len(row) == width]
    same = _numbers(alike, LEAST_NUMBERS)
    if first and width == LEAST_NUMBERS and is_trajectory(same):
        raise UnreadableError(f"{head.path}: {TRAJECTORY.refusal}")
    for column in range(min(width, 3)):
        # In few rows, a range may climb and fall back as well.
        long_enough = width < LEAST_NUMBERS or (len(same) >= COUNTER_ROWS and is_turn(same[:, column]))
        if long_enough and restarts(same[:, column]):
            rated = column == 1 and width == 3 and _is_quality(same[:, 0])
            raise UnreadableError(f"{head.path}: {_one_beam_per_row(same, column, width, rated)}")
    if width < LEAST_NUMBERS:
        raise UnreadableError(
            f"{head.path}: rows of {width} numbers without column names, such as {shown(head.lines[0])}, are too"
            " short for a sweep each: name the columns in a first line (`angle,range` for one beam per row,"
            " `time,r0,r1,r2` for one sweep per row)"
        )
    if len(alike) >= LEAST_ROWS and (why := no_ranges(_numbers(alike, width)[:, first:], first)):
        raise UnreadableError(
            f"{head.path}: a table without column names in which not all numbers are ranges ({why}): name the"
            " columns in a first line, the ranges r0, r1, ..., or take the other columns out"
        )


def _numbers(rows: Sequence[Sequence[bytes]], columns: int) -> Float64:
    """Return the numbers (R, C) in the first columns; NaN where a cell has none."""
    return np.array([[value_of(cell) for cell in row[:columns]] for row in rows], np.float64)


def is_trajectory(table: Float64) -> bool:
    """Tell whether rows of 8 are a time, a place and a unit quaternion, as trajectories of TUM are."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt((table[:, 4:] ** 2).sum(axis=1))
    return bool((np.abs(length - 1) < 0.01).all())


def restarts(values: Float64) -> bool:
    """Tell whether a column climbs (or falls) nearly always, and starts over by more than half of its span."""
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(values[np.isfinite(values)])
        if len(steps) < 2 or not (middle := np.median(steps)):
            return False
        back = steps * np.sign(middle) < 0
        over = back & (np.abs(steps) > 0.5 * np.ptp(values[np.isfinite(values)]))
    return bool(over.any() and (back & ~over).mean() <= 0.1)


def is_turn(values: Float64) -> bool:
    """Tell whether a column covers a turn, in degrees or radians."""
    known = values[np.isfinite(values)]
    if not len(known):
        return False
    with np.errstate(over="ignore"):
        view = float(np.ptp(known))
    return any(0.9 * turn <= view <= 1.01 * turn for turn in (360.0, TURN))


def _is_quality(values: Float64) -> bool:
    """Tell whether a column may hold the quality of returns: small whole numbers that are no counter."""
    whole = np.isfinite(values) & (values == np.rint(values)) & (values >= 0) & (values <= 255)
    return bool(whole.all() and ((np.diff(values) < 0).any() or np.ptp(values) == 0))


def refuse_numbered(head: Head) -> None:
    """Raise UnreadableError where rows are the number of a beam and its range: its bearing is unknown."""
    if len(head.rows) < COUNTER_ROWS or any(len(row) != 2 for row in head.rows):
        return
    numbers = _numbers(head.rows, 2)[:, 0]
    whole = bool((numbers == np.rint(numbers)).all())
    if whole and numbers[0] in (0.0, 1.0) and (np.diff(numbers) == 1.0).mean() > 0.9:
        raise UnreadableError(
            f"{head.path}: a row is the number of a beam and its range, and nothing tells where the beam points to:"
            " write the bearing in place of the number and `angle,range` as the first line; or all ranges of a sweep in"
            " one row, `time,r0,r1,...` as the first line, and give --fov"
        )


def _behind(table: Float64, column: int) -> list[str]:
    """Return the names of the columns behind bearings and ranges: quality of returns, and time."""
    rest = [table[:, place] for place in range(column + 2, table.shape[1])]
    if len(rest) == 1:
        return ["quality"]
    if len(rest) == 2 and _is_quality(rest[0]) and bool((np.diff(rest[1]) >= 0).all()) and np.ptp(rest[1]) > 0:
        return ["quality", "time"]
    return []


def _one_beam_per_row(table: Float64, column: int, width: int, rated: bool) -> str:
    """Return the message for a table of one beam per row; `rated`: the quality of returns comes first."""
    values = table[:, column]
    low, high = np.nanmin(values), np.nanmax(values)
    before, behind = (["quality"], []) if rated else (["time", "sweep"][:column], _behind(table, column))
    names = [*before, "angle", "range", *behind]
    names += [f"column{place}" for place in range(len(names) + 1, width + 1)]
    way_out = f"`{','.join(names[:width])}`" + (f"; {TITLES}" if rated else "")
    ranges = table[:, column + 1] if column + 1 < width else np.zeros(1)
    if not rated and np.nanmedian(ranges) > FAR:
        way_out += "; --range-unit mm says that ranges are millimetres"
        if names[:3] == ["angle", "range", "quality"] and high > TURN:
            titles = " ".join(["Angle Distance Quality", "Time"][: width - 2])
            way_out += f"; bearings of an RPLIDAR run clockwise: {AS_RPLIDAR.format(titles)} instead"
    return (
        f"a table without column names that looks like one beam per row (column {column + 1} runs from {low:g} to"
        f" {high:g} and starts over): name the columns in a first line, such as {way_out}"
    )


def no_ranges(table: Float64, first: int) -> str:
    """Return which columns of a table (R, C) hold no ranges and why, in words; empty where nothing speaks against it.

    `first` is the number of columns before the table.
    """
    varying = _distinct(table) >= _DISTINCT
    below = np.where(np.isfinite(table) & (table < 0), table, np.nan)
    signed = _distinct(below) >= _DISTINCT
    if signed.sum() > 1 or (_distinct(below) >= _BELOW_ALONE).any():
        return f"below zero: {_columns(signed, first)}"
    for columns, words in (
        (_counters(table, varying), "counters"),
        (_far_beyond(table, varying), "far beyond all others"),
        (_other_digits(table, varying), "decimals among whole numbers, or the reverse"),
    ):
        if columns.any():
            return f"{words}: {_columns(columns, first)}"
    return "columns far from their neighbours" if _unlike(table, varying) else ""


def _columns(chosen: Bool, first: int) -> str:
    places = (np.flatnonzero(chosen) + first + 1).tolist()
    more = f" and {len(places) - 3} more" if len(places) > 3 else ""
    return f"column{'s' if len(places) > 1 else ''} {', '.join(map(str, places[:3]))}{more}"


def _distinct(table: Float64) -> Int64:
    """Return the number of distinct finite values of each column (C,)."""
    ordered = np.sort(np.where(np.isfinite(table), table, np.nan), axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        changes = np.diff(ordered, axis=0) > 0
    found: Int64 = changes.sum(axis=0) + np.isfinite(ordered[0])
    return found


def _in_few(columns: Bool) -> Bool:
    """Return the chosen columns (C,) that stand side by side with few others of them."""
    edges = np.diff(np.concatenate([[False], columns, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    few: Bool = np.zeros(len(columns), np.bool_)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        few[start:end] = end - start <= _FEW
    return few


def _counters(table: Float64, varying: Bool) -> Bool:
    """Return the columns (C,) that count between columns that hardly change: wheel ticks, sequence numbers, times.

    What moves away from a sensor is seen by beams whose neighbours change, too.
    """
    if len(table) < COUNTER_ROWS:
        return np.zeros(table.shape[1], np.bool_)
    with np.errstate(invalid="ignore", over="ignore"):
        rising = (np.diff(table, axis=0) >= 0).all(axis=0) & (table == np.rint(table)).all(axis=0)
    rising &= _distinct(table) >= _COUNTS
    around = np.concatenate([[False], varying & ~rising, [False]])
    few = _in_few(rising)
    edges = np.diff(np.concatenate([[False], rising, [False]]).astype(np.int8))
    for start, end in zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True):
        few[start:end] &= not around[start] and not around[end + 1]
    return few


def _medians(table: Float64, chosen: Bool) -> Float64:
    """Return the medians (C,) of the numbers above zero in the chosen columns; NaN in others."""
    medians = np.full(table.shape[1], np.nan)
    for column in np.flatnonzero(chosen).tolist():
        values = table[:, column]
        values = values[np.isfinite(values) & (values > 0)]
        if len(values):
            with np.errstate(over="ignore"):
                medians[column] = np.median(values)
    return medians


def _far_beyond(table: Float64, varying: Bool) -> Bool:
    """Return the few columns (C,) before the scan whose medians are far beyond all of the scan."""
    if table.shape[1] < FAR_COLUMNS:
        return np.zeros(table.shape[1], np.bool_)
    medians = _medians(table, np.ones(table.shape[1], np.bool_))
    start = table.shape[1] // 4
    top = np.nanmax(medians[start:], initial=0.0) if np.isfinite(medians[start:]).any() else 0.0
    with np.errstate(over="ignore"):
        beyond = varying & (medians > FAR_BEYOND * top) & (top > 0)
    beyond[start:] = False
    return _in_few(beyond)


def _other_digits(table: Float64, varying: Bool) -> Bool:
    """Return the few columns (C,) of decimals among whole numbers, or of whole numbers among decimals."""
    known = np.isfinite(table) & (table != 0)
    whole = known & (table == np.rint(table))
    decimals = np.where(known & ~whole, table, np.nan)
    cells = known.sum(axis=0)
    fractional = _distinct(decimals) >= _DISTINCT
    none = np.zeros(table.shape[1], np.bool_)
    if cells.sum() == 0:
        return none
    share = whole.sum() / cells.sum()
    # Whole numbers that hardly change are markers, among which a few beams may see something.
    counted = (varying & ~fractional).sum() >= _MANY * fractional.sum()
    if fractional.sum() <= _FEW and counted and whole[:, ~fractional].sum() == cells[~fractional].sum():
        return fractional & varying
    if share < _DECIMAL and len(table) >= COUNTER_ROWS:
        counts = (whole.sum(axis=0) == cells) & (_distinct(np.where(whole, table, np.nan)) >= _WHOLE)
        return _in_few(counts)
    return none


def _unlike(table: Float64, varying: Bool) -> bool:
    """Tell whether most neighbours among the columns that vary differ by far."""
    medians = _medians(table, varying)
    pairs: NDArray[np.float64] = medians[np.isfinite(medians)]
    if len(pairs) <= _LEAST_PAIRS:
        return False
    with np.errstate(over="ignore"):
        ratio = pairs[1:] / pairs[:-1]
    return bool(((ratio > UNLIKE) | (ratio < 1 / UNLIKE)).mean() > MOST_UNLIKE)
