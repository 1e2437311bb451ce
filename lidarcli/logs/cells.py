"""The cells of a block of lines: their places, their numbers in bulk, and times as exact nanoseconds.

All numbers of a block are parsed as ONE column, whatever the number of beams. So a block of few long rows costs what
one of many short rows costs, ragged rows are no special case, and the result is row-major already. Where some cell
is spelled unusually (spaces, null), the C++ parser of pyarrow.csv takes over; where a cell is no number at all,
the search for its row halves the block.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from datetime import date
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.blocks import pad
from lidarcli.sweeps.types import Bool, Float32, Float64, Int32, Int64
from lidarcli.system.records import dataclass

NEWLINE = 10
_NULLS = ("", "null", "None", "NULL", "none", "NA", "N/A", "n/a", "#N/A", "<NA>", "-", "--", ".nan", ".NaN")
_WORDS = {
    **{word.lower().encode(): None for word in _NULLS},
    b"nil": None,
    b"1.#qnan": None,
    b"-1.#ind": None,
    b".inf": np.inf,
    b"+.inf": np.inf,
    b"-.inf": -np.inf,
    b"1.#inf": np.inf,
    b"-1.#inf": -np.inf,
}


@dataclass(frozen=True, slots=True)
class Numbers:
    """Numbers of rows of cells, one after the other."""

    values: NDArray[Any]
    empty: Bool | None
    """True for cells without a value (empty, null); None without such cells."""
    bad: dict[int, bytes]
    """Row → cell that is no number; all values of such a row are NaN."""


class Cells:
    """Places of the cells in a text of lines without quotes."""

    def __init__(self, text: bytes, separator: bytes) -> None:
        self.text = text
        self.separator = separator
        buffer = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero((buffer == separator[0]) | (buffer == NEWLINE)).astype(np.int32)
        last = np.flatnonzero(buffer[ends] == NEWLINE)
        self._ends = ends
        self._starts = np.empty_like(ends)
        self._starts[:1] = 0
        self._starts[1:] = ends[:-1] + 1
        self._first = np.empty_like(last)
        self._first[:1] = 0
        self._first[1:] = last[:-1] + 1
        self.count: Int64 = last - self._first + 1
        """(R,) Cells of each row; an empty line has one."""
        self.length = ends[last] - self._starts[self._first]
        self._regular = bool((self.count == self.count[:1]).all())

    def spans(self, rows: Int64, first: int | Int64, count: int | Int64) -> list[bytes]:
        """Return the text of `count` cells from cell `first` on, of each of `rows`; b'' for a count of 0."""
        most = len(self._ends) - 1
        begin = np.minimum(self._first[rows] + first, most)
        end = self._ends[np.minimum(begin + np.maximum(count, 1) - 1, most)]
        start = self._starts[begin]
        end = np.where(np.asarray(count) > 0, end, start)
        text = self.text
        # One slice per row: copying bytes, not looking at them.
        return [text[i:j] for i, j in zip(start.tolist(), end.tolist(), strict=True)]

    def column(self, rows: Int64, index: int) -> list[bytes]:
        """Return cell `index` of each of `rows`, which all have it."""
        return self.spans(rows, index, 1)

    def numbers(self, rows: Int64, first: int | Int64, count: Int64, dtype: type[np.floating]) -> Numbers:
        """Return the numbers in `count` cells from cell `first` on, of each of `rows` (ascending)."""
        starts, ends = self._bounds(rows, first, count)
        if not len(starts):
            return Numbers(np.empty(0, dtype), None, {})
        try:
            values, empty = _cast(self.text, starts, ends, dtype)
            return Numbers(values, empty, {})
        except ValueError:
            return parse_rows(self.spans(rows, first, count), count, self.separator, dtype)

    def codes(self, rows: Int64, index: int) -> tuple[Int64, list[bytes]]:
        """Return cell `index` of each of `rows` (ascending) as an index into the distinct cells, and these."""
        import pyarrow as pa

        starts, ends = self._bounds(rows, index, np.ones(len(rows), np.int64))
        if not len(rows):
            return np.empty(0, np.int64), []
        coded = _between(self.text, starts, ends, None, pa.binary()).dictionary_encode()
        codes = coded.indices.fill_null(0).to_numpy()[::2].astype(np.int64)
        return codes, coded.dictionary.to_pylist()

    def _bounds(self, rows: Int64, first: int | Int64, count: Int64) -> tuple[Int32, Int32]:
        """Return start and end of each of these cells, in their order."""
        if isinstance(first, int) and self._regular and len(count) and (count == count[0]).all():
            columns = slice(first, first + int(count[0]))
            shape = (len(self.count), int(self.count[0]))
            some = slice(None) if len(rows) == shape[0] else rows
            starts, ends = (self._starts.reshape(shape)[some, columns], self._ends.reshape(shape)[some, columns])
            return starts.ravel(), ends.ravel()
        begin = self._first[rows] + first - (np.cumsum(count) - count)
        index = np.repeat(begin, count) + np.arange(int(count.sum()))
        return self._starts[index], self._ends[index]


def pad_cells(cells: Cells, rows: Int64, first: Int64, count: Int64, width: int) -> Float32 | None:
    """Return (S, `width`) intensities: `count` cells of each of `rows` from its cell `first` on, padded with NaN.

    None where no row has any. A cell that is no number leaves its row without them: it costs no sweep.
    """
    if not count.any():
        return None
    padded = np.full((len(rows), width), np.nan, np.float32)
    filled = np.flatnonzero(count)
    values = pad(cells.numbers(rows[filled], first[filled], count[filled], np.float32).values, count[filled], 1.0)
    padded[filled, : values.shape[1]] = values
    return padded


def parse_rows(parts: Sequence[bytes], counts: Int64, separator: bytes, dtype: type[np.floating]) -> Numbers:
    """Parse rows of `counts` cells each; a row with a cell that is no number is named, not raised."""
    total = int(counts.sum())
    if not total:
        return Numbers(np.empty(0, dtype), None, {})
    try:
        some = [part for part, count in zip(parts, counts.tolist(), strict=True) if count]
        flat = b"\n".join(some).replace(separator, b"\n") + b"\n"
        values, empty = _parse_flat(flat, total, dtype)
        return Numbers(values, empty, {})
    except ValueError:
        pass
    # Of many rows a half is tried at a time, of few each one.
    if len(parts) > 64:
        half = len(parts) // 2
        left = parse_rows(parts[:half], counts[:half], separator, dtype)
        right = parse_rows(parts[half:], counts[half:], separator, dtype)
        return _join(left, right, half)
    return _slow_rows(parts, counts, separator, dtype)


def parse_number(cell: bytes) -> float | None:
    """Return the number in a cell, in any spelling of logs; None for an empty one, ValueError for a text.

    >>> parse_number(b" -.inf "), parse_number(b"null")
    (-inf, None)
    """
    text = cell.strip().lower()
    if text in _WORDS:
        return _WORDS[text]
    if b"_" in text:
        raise ValueError(text)
    return float(text)


def shown(cell: bytes, most: int = 24) -> str:
    """Return a cell for a message: short, printable.

    >>> shown(b"abc")
    "'abc'"
    """
    text = cell.decode("utf-8", "replace").strip()
    text = "".join(char if char.isprintable() else "?" for char in text)
    return f"'{text[:most]}…'" if len(text) > most else f"'{text}'"


def not_a_number(cell: bytes) -> str:
    """Return the cause for a row with this cell, which is no number."""
    if cell.strip(b" \"'") in (b"...", b"\xe2\x80\xa6"):
        return "the array was abbreviated ('...') when the log was written (ros2 topic echo: --full-length)"
    return f"{shown(cell)} is not a number"


def _between(text: bytes, starts: Int32, ends: Int32, null: Bool | None, kind: Any) -> Any:
    """Return an Arrow array of type `kind` whose even entries are cells between `starts` and `ends`; some are `null`."""
    # The text itself is the data of the array: a cell, the text between it and the next cell, which is null, the next
    # cell, ... So nothing is copied or tokenised a second time.
    import pyarrow as pa

    slots = 2 * len(starts)
    offsets = np.empty(slots + 1, np.int32)
    offsets[0:-1:2] = starts
    offsets[1::2] = ends
    offsets[-1] = ends[-1]
    valid = np.full(-(-slots // 8), 0b01010101, np.uint8)
    if null is not None:
        bits = np.zeros(slots, np.bool_)
        bits[::2] = ~null
        valid = np.packbits(bits, bitorder="little")
    return pa.Array.from_buffers(kind, slots, [*map(pa.py_buffer, (valid, offsets, text))])


def _cast(text: bytes, starts: Int32, ends: Int32, dtype: type[np.floating]) -> tuple[NDArray[Any], Bool | None]:
    """Return the numbers of the cells between `starts` and `ends`; ValueError where one is spelled unusually."""
    import pyarrow as pa

    empty = starts == ends
    none = not empty.any()
    strings = _between(text, starts, ends, None if none else empty, pa.string())
    numbers = strings.cast(pa.float32() if dtype is np.float32 else pa.float64())
    values = np.frombuffer(numbers.buffers()[1], dtype, 2 * len(starts))[::2].copy()
    if none:
        return values, None
    values[empty] = np.nan
    return values, empty


def _parse_flat(text: bytes, total: int, dtype: type[np.floating]) -> tuple[NDArray[Any], Bool | None]:
    """Parse one cell per line; ValueError where any is no number."""
    bare = text.replace(b" ", b"")
    ends = np.flatnonzero(np.frombuffer(bare, np.uint8) == NEWLINE).astype(np.int32)
    if len(ends) == total:
        try:
            return _cast(bare, np.append(np.int32(0), ends[:-1] + np.int32(1)), ends, dtype)
        except ValueError:
            pass
    import pyarrow as pa
    from pyarrow import csv

    kind = pa.float32() if dtype is np.float32 else pa.float64()
    table = csv.read_csv(
        pa.py_buffer(text),
        read_options=csv.ReadOptions(column_names=["value"], block_size=1 << 20),
        parse_options=csv.ParseOptions(delimiter="\x01", quote_char=False, ignore_empty_lines=False),
        convert_options=csv.ConvertOptions(column_types={"value": kind}, null_values=list(_NULLS), check_utf8=False),
    )
    column = table.column(0)
    if len(column) != total:
        raise ValueError(f"{len(column)} cells where {total} were counted")
    values = column.to_numpy()
    return values, np.asarray(column.is_null()) if column.null_count else None


def _slow_rows(parts: Sequence[bytes], counts: Int64, separator: bytes, dtype: type[np.floating]) -> Numbers:
    """Parse rows cell by cell: the few among which one is bad, or spells its numbers oddly."""
    values: list[float] = []
    empty: list[bool] = []
    bad = {}
    for row, (part, count) in enumerate(zip(parts, counts.tolist(), strict=True)):
        if not count:
            continue
        numbers: list[float | None] = []
        for cell in part.split(separator):
            try:
                numbers.append(parse_number(cell))
            except ValueError:
                bad[row] = cell
                numbers = [np.nan] * count
                break
        values += [np.nan if number is None else number for number in numbers]
        empty += [number is None for number in numbers]
    with np.errstate(over="ignore"):
        flat = np.array(values, np.float64).astype(dtype)
    return Numbers(flat, np.array(empty, np.bool_) if any(empty) else None, bad)


def _join(left: Numbers, right: Numbers, rows: int) -> Numbers:
    empty = None
    if left.empty is not None or right.empty is not None:
        empty = np.concatenate([np.zeros(len(n.values), np.bool_) if n.empty is None else n.empty for n in (left, right)])
    bad = left.bad | {row + rows: cell for row, cell in right.bad.items()}
    return Numbers(np.concatenate([left.values, right.values]), empty, bad)


NS, US, MS, S = 1, 1_000, 1_000_000, 1_000_000_000
DATE = 0
"""Stands in place of a unit for a date and time of day."""
S_UNPADDED, DATE_UNPADDED = -1, -2
"""Stand for seconds, and dates, with nanoseconds without leading zeros behind the point: `1.5` is 1 s 5 ns."""
DIGITS, DAY_FIRST, MONTH_FIRST = -3, -4, -5
"""Stand for dates as digits (`20261126T130510`), and for those that end with the year."""
TIME_OF_DAY, MINUTES, DAYS, DATED = -6, -7, -8, -9
"""Stand for a time of day, for minutes and seconds, for days as spreadsheets count them, and for a time of day whose date
stands in another column."""
PERIODS = {TIME_OF_DAY: 86_400 * S, MINUTES: 3600 * S}
"""Times after which a clock without a date begins again [ns]."""
_NOTES = {
    (DATE, DATE_UNPADDED, DIGITS, DAY_FIRST, MONTH_FIRST): "times without a zone are read as UTC",
    (DAY_FIRST,): "dates are read as day, month, year",
    (MONTH_FIRST,): "dates are read as month, day, year",
    (TIME_OF_DAY,): "times of day without a date: dates begin in 1970",
    (MINUTES,): "times are minutes and seconds",
    (DAYS,): "times are days, as spreadsheets and MATLAB count them",
    (MS,): "times are milliseconds",
    (US,): "times are microseconds",
    (S_UNPADDED, DATE_UNPADDED): "behind the point of times stand nanoseconds without leading zeros",
}

_STEPS = ((NS, 5_000_000), (US, 5_000), (MS, 10))
"""Unit → least step from sweep to sweep in it, of a clock without a named unit: 5 ms, 5 ms, 10 ms."""

_UNITS = {"ns": NS, "nsec": NS, "nsecs": NS, "nanosec": NS, "nanoseconds": NS, "us": US, "usec": US, "µs": US}
_UNITS |= {"ms": MS, "msec": MS, "s": S, "sec": S, "secs": S, "seconds": S}
_UNITS |= {
    f"{parts}{s}": unit for parts, unit in (("nano", NS), ("micro", US), ("milli", MS)) for s in ("s", "sec", "seconds")
}
_UNIT_IN_NAME = re.compile(rf"(?:[_(\[ ]|^(?=[mnuµ]))({'|'.join(_UNITS)})[)\]]*$")
_SECOND = rb"(?P<second>\d\d)(?:(?:[.,]|:(?=\d{3}\b))(?P<fraction>\d+))?"
_HALF = rb"(?:\s*(?P<half>[AP])\.?M\b\.?)?"
_CLOCK = rb"(?:(?:[T_,]|\s)+(?P<hour>\d\d?):(?P<minute>\d\d)(?::%s)?%s)?" % (_SECOND, _HALF)
_ZONE = rb"\s*(?:Z|UTC|GMT|(?P<sign>[+-])(?P<off_hours>\d\d):?(?P<off_minutes>\d\d)?)?"
_ON = rb"(?:\s*[-/.,]\s*|\s+)"
_DAY, _MONTH = rb"(?P<day>\d\d?)", rb"(?P<month>\d\d?|[A-Z]{3,9})"
_LAST_YEAR = rb"(?P<year>\d{4}|\d\d)"
_SPELLINGS = {
    DATE: rb"(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)" + _CLOCK + _ZONE,
    DIGITS: rb"(?P<year>(?:19|20)\d\d)(?P<month>\d\d)(?P<day>\d\d)[T_ -]?"
    rb"(?P<hour>\d\d)(?P<minute>\d\d)(?P<second>\d\d)(?:[.,_]?(?P<fraction>\d{3}|(?<=[.,_])\d+))?" + _ZONE,
    DAY_FIRST: rb"(?:[A-Z]{2,9},?\s+)?" + _DAY + _ON + _MONTH + _ON + _LAST_YEAR + _CLOCK + _ZONE,
    MONTH_FIRST: rb"(?:[A-Z]{2,9},?\s+)?" + _MONTH + _ON + _DAY + _ON + _LAST_YEAR + _CLOCK + _ZONE,
    TIME_OF_DAY: rb"(?:(?P<days>\d+) days?,? +)?(?P<hour>\d{1,3}):(?P<minute>\d\d):" + _SECOND + _HALF + _ZONE,
    MINUTES: rb"(?P<minute>\d{1,3}):(?P<second>\d\d?)[.,](?P<fraction>\d+)",
}
"""Spelling of times that are no plain numbers → its pattern."""
_PATTERNS = {unit: re.compile(rb"\s*%s\s*" % pattern, re.IGNORECASE) for unit, pattern in _SPELLINGS.items()}
_MONTHS = b"jan feb mar apr may jun jul aug sep oct nov dec - - - - mai - - - - okt - dez".split()
"""First letters of months in English, and behind them where German ones differ."""
_EXCEL, _MATLAB = 25_569, 719_529
"""Number of the first day of 1970 in a spreadsheet, and in MATLAB."""
_NUMBER = re.compile(rb"[-+]?(?:\d{1,30}(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,2})?")
_EPOCH = date(1970, 1, 1).toordinal()
_MIN, _MAX = -(1 << 63), (1 << 63) - 1


def time_unit(name: str, samples: Sequence[bytes]) -> int | None:
    """Return nanoseconds per unit of a time column (`DATE` for dates), from its name or the size of its values.

    None where most samples are no times. Seconds since 1970 have 10 digits before the point, milliseconds 13,
    microseconds 16, nanoseconds 19: no clock that a robot carries comes near the next unit. Whole numbers of a clock
    that starts with the robot are known by their steps: no LiDAR waits 10 s for its next sweep.

    >>> time_unit("time", [b"1714555596445048407"]), time_unit("t", [b"12.5"]), time_unit("t_ms", [b"5"])
    (1, 1000000000, 1000000)
    """
    samples = [cell for cell in samples if cell.strip()]
    for unit, pattern in _PATTERNS.items():
        dates = [cell for cell in samples if pattern.fullmatch(cell)]
        if np.count_nonzero(~to_ns(dates, unit)[1]) > len(samples) // 2:
            if unit == DATE:
                return DATE_UNPADDED if _is_unpadded(dates, DATE, DATE_UNPADDED) else DATE
            return _order(dates) if unit in (DAY_FIRST, MONTH_FIRST) else unit
    numbers = [cell for cell in samples if _NUMBER.fullmatch(cell.strip())]
    if len(numbers) <= len(samples) // 2:
        return None
    largest = max(Decimal(cell.decode().strip()).copy_abs() for cell in numbers)
    if named := _UNIT_IN_NAME.search(name.lower()):
        return _UNITS[named[1]]
    for unit, least in ((NS, 10**17), (US, 10**14), (MS, 10**11)):
        if largest >= least:
            return unit
    if all(cell.strip().isdigit() for cell in numbers):
        return _unit_of_steps([int(cell) for cell in numbers])
    if _are_days(np.array([float(cell) for cell in numbers])):
        return DAYS
    return S_UNPADDED if _is_unpadded(numbers, S, S_UNPADDED) else S


def _unit_of_steps(counts: Sequence[int]) -> int:
    """Return the unit of whole numbers below 1e11, in which the usual step from sweep to sweep is a likely one."""
    steps = np.diff(np.array(counts, np.int64))
    steps = steps[steps > 0]
    step = np.median(steps) if len(steps) else 0
    if min(counts) >= 10**9 and step < 3600:
        return S
    return next((unit for unit, least in _STEPS if step >= least), S)


def _order(dates: Sequence[bytes]) -> int:
    """Return the order in which most dates are dates, and go on by the smallest steps; the month first before a slash."""
    steps: dict[int, tuple[int, float]] = {}
    for unit in (MONTH_FIRST, DAY_FIRST) if b"/" in dates[0] else (DAY_FIRST, MONTH_FIRST):
        times, bad = to_ns(dates, unit)
        steps[unit] = int(bad.sum()), float(np.abs(np.diff(times / S)).sum())
    return min(steps, key=lambda unit: steps[unit])


def _are_days(numbers: Float64) -> bool:
    """Return whether numbers with decimals count days: their steps fit sweeps then, and as seconds nothing."""
    steps = np.abs(np.diff(numbers))
    steps = steps[steps > 0]
    since = numbers - (_MATLAB if numbers[0] >= _MATLAB else _EXCEL)
    likely = since.min() >= 0 and since.max() <= 55_000
    # Such steps are at most 2 s as days; as seconds they would be shorter than those of any sensor.
    return bool(likely and len(steps) and np.median(steps) < 2.5e-5)


def _is_unpadded(samples: Sequence[bytes], padded: int, unpadded: int) -> bool:
    """Return whether times rise only if the digits behind the point count nanoseconds (`{secs}.{nsecs}`)."""
    fractions = [cell.partition(b".")[2].strip() for cell in samples]
    sizes = set(map(len, fractions))
    if len(sizes) < 2 or max(sizes) != 9 or not all(part.isdigit() and part[:1] != b"0" for part in fractions):
        return False
    times, bad = to_ns(samples, padded)
    others, bad_too = to_ns(samples, unpadded)
    return bool(not (bad | bad_too).any() and (np.diff(times) < 0).any() and (np.diff(others) >= 0).all())


def time_notes(units: Iterable[int]) -> list[str]:
    """Return notes for the user on times in these units."""
    found = set(units)
    return [note for some, note in _NOTES.items() if found.intersection(some)]


def to_ns(cells: Sequence[bytes], unit: int) -> tuple[Int64, Bool]:
    """Return nanoseconds of each cell, and True for cells that are no times (their value is 0)."""
    convert = _CONVERTERS[unit]
    bad = np.zeros(len(cells), np.bool_)
    with suppress(ValueError, ArithmeticError):
        return np.fromiter(map(convert, cells), np.int64, len(cells)), bad
    times = np.zeros(len(cells), np.int64)
    for row, cell in enumerate(cells):
        try:
            times[row] = convert(cell)
        except (ValueError, ArithmeticError):
            bad[row] = True
    return times, bad


def going_on(times: Int64, unit: int, last: tuple[int, int] | None) -> tuple[Int64, tuple[int, int]]:
    """Return times (R > 0,) that go on where a clock without a date begins again, and what the next ones need as `last`."""
    if unit not in PERIODS:
        return times, (0, 0)
    before, ahead = last or (int(times[0]), 0)
    steps = np.diff(times, prepend=before) / PERIODS[unit]
    # What is late at midnight belongs to the day before.
    turns = np.cumsum((steps < -0.5).astype(np.int64) - (steps > 0.95))
    gone: Int64 = times + ahead + turns * PERIODS[unit]
    return gone, (int(times[-1]), int(gone[-1] - times[-1]))


def seconds_and_parts(seconds: Sequence[bytes], rest: Sequence[bytes], unit: int) -> tuple[Int64, Bool]:
    """Return nanoseconds from a column of whole seconds and one of parts of these in a `unit` of nanoseconds."""
    high, bad_high = to_ns(seconds, S)
    low, bad_low = to_ns(rest, unit)
    # The sum of two int64 can wrap around; no such time is meant.
    wrapped = (np.abs(high) > _MAX // 2) | (np.abs(low) > _MAX // 2)
    bad: Bool = wrapped | bad_high | bad_low
    return np.where(bad, 0, high + low), bad


def _checked(value: int) -> int:
    if not _MIN <= value <= _MAX:
        raise ValueError("beyond 64 bits")
    return value


def _decimal(cell: bytes, unit: int) -> int:
    """Convert any decimal spelling, exactly."""
    text = cell.decode("ascii").strip()
    number = Decimal(text)
    if not number.is_finite() or abs(number.adjusted()) > 30:
        if number.is_finite() and number.adjusted() < 0:
            return 0
        raise ValueError(text)
    return _checked(int((number * unit).to_integral_value()))


def _seconds(cell: bytes) -> int:
    whole, _, fraction = cell.partition(b".")
    if len(fraction) == 9 and fraction.isdigit():
        return int(whole + fraction)
    if len(fraction) < 9 and (not fraction or fraction.isdigit()) and whole.lstrip(b"-").isdigit():
        return int(whole + fraction.ljust(9, b"0"))
    return _decimal(cell, S)


def _spelled(unit: int) -> Callable[[bytes], int]:
    """Return the conversion of times that are spelled as `_SPELLINGS` has it."""

    def convert(cell: bytes) -> int:
        match = _PATTERNS[unit].fullmatch(cell)
        if match is None:
            raise ValueError("not a date")
        part = match.groupdict(b"")
        hour, minute, second = (int(part.get(name) or 0) for name in ("hour", "minute", "second"))
        if half := part.get("half"):
            hour = hour % 12 + (12 if half in b"Pp" else 0)
        days = int(part.get("days") or 0)
        if year := part.get("year"):
            name = part["month"]
            month = int(name) if name.isdigit() else _MONTHS.index(name[:3].lower()) % 12 + 1
            since = date(int(year) + (2000 if len(year) == 2 else 0), month, int(part["day"]))
            days = since.toordinal() - _EPOCH
        seconds = days * 86400 + hour * 3600 + minute * 60 + second
        if sign := part.get("sign"):
            offset = int(part["off_hours"]) * 3600 + int(part["off_minutes"] or 0) * 60
            seconds += offset if sign == b"-" else -offset
        return _checked(seconds * S + int((part["fraction"] or b"").ljust(9, b"0")[:9]))

    return convert


def _days(cell: bytes) -> int:
    days = Decimal(cell.decode("ascii").strip())
    return _decimal(str(days - (_MATLAB if days >= _MATLAB else _EXCEL)).encode(), 86_400 * S)


def _padded(cell: bytes) -> bytes:
    whole, point, fraction = cell.strip().partition(b".")
    return whole + point + fraction.rjust(9, b"0") if point else cell


def _of_unit(unit: int) -> Callable[[bytes], int]:
    return lambda cell: int(cell) * unit if cell.isdigit() else _decimal(cell, unit)


_CONVERTERS: dict[int, Callable[[bytes], int]] = {
    **{unit: _spelled(unit) for unit in _SPELLINGS},
    DATED: _spelled(TIME_OF_DAY),
    DAYS: _days,
    **{unit: _of_unit(unit) for unit in (NS, US, MS)},
    S: _seconds,
    S_UNPADDED: lambda cell: _seconds(_padded(cell)),
    DATE_UNPADDED: lambda cell: _spelled(DATE)(_padded(cell)),
}


def value_of(cell: bytes) -> float | None:
    """Return the number of a cell; None where it holds none."""
    try:
        return parse_number(cell)
    except ValueError:
        return None


def is_numeric(cell: bytes) -> bool:
    """Return whether a cell can stand for a number, also for a missing one."""
    try:
        parse_number(cell)
    except ValueError:
        return False
    return True
