"""Times in text as int64 nanoseconds, without a detour over floats."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from datetime import date
from decimal import Decimal

import numpy as np

from lidarcli.sweeps import Bool, Float64, Int64

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
"""Times after which a clock without a date begins anew [ns]."""
_LATE = 0.95
"""Least step ahead of a clock without a date that is one back, as a share of its period."""
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
_SINCE_1970 = 10**9
"""Least count that is whole seconds since 1970, whatever its steps."""
_HOUR = 3600
"""Bound of the steps of such seconds [s]."""

_UNITS = {"ns": NS, "nsec": NS, "nsecs": NS, "nanosec": NS, "nanoseconds": NS, "us": US, "usec": US, "µs": US}
_UNITS |= {"ms": MS, "msec": MS, "s": S, "sec": S, "secs": S, "seconds": S}
_UNIT_IN_NAME = re.compile(rf"[_(\[ ]({'|'.join(_UNITS)})[)\]]*$")
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
NO_NUMBERS = (*_SPELLINGS, DATE_UNPADDED)
_PATTERNS = {unit: re.compile(rb"\s*%s\s*" % pattern, re.IGNORECASE) for unit, pattern in _SPELLINGS.items()}
_MONTHS = b"jan feb mar apr may jun jul aug sep oct nov dec - - - - mai - - - - okt - dez".split()
"""First letters of months in English, and behind them where German ones differ."""
_EXCEL, _MATLAB = 25_569, 719_529
"""Number of the first day of 1970 in a spreadsheet, and in MATLAB."""
_MOST_DAYS = 55_000
"""Days for about 150 years from then on."""
_MOST_DAY_STEP = 2.5e-5
"""Greatest usual step of such days, about 2 s: as seconds, no sensor is as fast."""
_NUMBER = re.compile(rb"[-+]?(?:\d{1,30}(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,2})?")
_EPOCH = date(1970, 1, 1).toordinal()
_MIN, _MAX = -(1 << 63), (1 << 63) - 1


def time_unit(name: str, samples: Sequence[bytes]) -> int | None:
    """Return nanoseconds per unit of a time column (`DATE` for dates), from its name or the size of its values.

    None where most samples are no times. Seconds since 1970 have 10 digits before the point, milliseconds 13,
    microseconds 16, nanoseconds 19: no clock that a robot carries comes near the next unit. Whole numbers of a clock
    that starts with the robot tell by their steps: no LiDAR waits 10 s for its next sweep.

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
    if min(counts) >= _SINCE_1970 and step < _HOUR:
        return S
    return next((unit for unit, least in _STEPS if step >= least), S)


def _order(dates: Sequence[bytes]) -> int:
    """Return the order of day and month in which the dates are dates, and go on by the smallest steps.

    Where both are alike, the month is first before a slash alone.
    """
    steps: dict[int, tuple[int, float]] = {}
    for unit in (MONTH_FIRST, DAY_FIRST) if b"/" in dates[0] else (DAY_FIRST, MONTH_FIRST):
        times, bad = to_ns(dates, unit)
        steps[unit] = int(bad.sum()), float(np.abs(np.diff(times / S)).sum())
    return min(steps, key=lambda unit: steps[unit])


def _are_days(numbers: Float64) -> bool:
    """Tell whether numbers with decimals count days: their steps fit sweeps then, and as seconds nothing."""
    steps = np.abs(np.diff(numbers))
    steps = steps[steps > 0]
    since = numbers - (_MATLAB if numbers[0] >= _MATLAB else _EXCEL)
    likely = since.min() >= 0 and since.max() <= _MOST_DAYS
    return bool(likely and len(steps) and np.median(steps) < _MOST_DAY_STEP)


def _is_unpadded(samples: Sequence[bytes], padded: int, unpadded: int) -> bool:
    """Tell whether times rise only if the digits behind the point count nanoseconds (`{secs}.{nsecs}`)."""
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
    """Return times (R > 0,) that go on where a clock without a date begins anew, and what the next ones need as `last`."""
    if unit not in PERIODS:
        return times, (0, 0)
    before, ahead = last or (int(times[0]), 0)
    steps = np.diff(times, prepend=before) / PERIODS[unit]
    # What is late at midnight belongs to the day before.
    turns = np.cumsum((steps < -0.5).astype(np.int64) - (steps > _LATE))
    gone: Int64 = times + ahead + turns * PERIODS[unit]
    return gone, (int(times[-1]), int(gone[-1] - times[-1]))


def seconds_and_nanoseconds(seconds: Sequence[bytes], rest: Sequence[bytes]) -> tuple[Int64, Bool]:
    """Return nanoseconds from a column of whole seconds and one of nanoseconds."""
    high, bad_high = to_ns(seconds, S)
    low, bad_low = to_ns(rest, NS)
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


def _nanoseconds(cell: bytes) -> int:
    return int(cell) if cell.isdigit() else _decimal(cell, NS)


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
    NS: _nanoseconds,
    US: _of_unit(US),
    MS: _of_unit(MS),
    S: _seconds,
    S_UNPADDED: lambda cell: _seconds(_padded(cell)),
    DATE_UNPADDED: lambda cell: _spelled(DATE)(_padded(cell)),
}
