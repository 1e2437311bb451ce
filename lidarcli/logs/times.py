"""Times in text as int64 nanoseconds, without a detour over floats."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from decimal import Decimal

import numpy as np

from lidarcli.sweeps import Bool, Int64

NS, US, MS, S = 1, 1_000, 1_000_000, 1_000_000_000
DATE = 0
"""Stands in place of a unit for a date and time of day."""
S_UNPADDED, DATE_UNPADDED = -1, -2
"""Stand for seconds, and dates, with nanoseconds without leading zeros behind the point: `1.5` is 1 s 5 ns."""
_NOTES = {
    (DATE, DATE_UNPADDED): "times without a zone are read as UTC",
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
_DATE = re.compile(
    rb"\s*(\d{4})[-/.](\d\d?)[-/.](\d\d?)"
    rb"(?:[T_ ]+(\d\d?):(\d\d)(?::(\d\d)(?:[.,](\d+))?)?)?\s*(?:Z|UTC|([+-])(\d\d):?(\d\d)?)?\s*",
    re.IGNORECASE,
)
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
    dates = [cell for cell in samples if _DATE.fullmatch(cell)]
    if len(dates) > len(samples) // 2:
        return DATE_UNPADDED if _is_unpadded(dates, DATE, DATE_UNPADDED) else DATE
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
    return S_UNPADDED if _is_unpadded(numbers, S, S_UNPADDED) else S


def _unit_of_steps(counts: Sequence[int]) -> int:
    """Return the unit of whole numbers below 1e11, in which the usual step from sweep to sweep is a likely one."""
    steps = np.diff(np.array(counts, np.int64))
    steps = steps[steps > 0]
    step = np.median(steps) if len(steps) else 0
    if min(counts) >= _SINCE_1970 and step < _HOUR:
        return S
    return next((unit for unit, least in _STEPS if step >= least), S)


def _is_unpadded(samples: Sequence[bytes], padded: int, unpadded: int) -> bool:
    """Tell whether times rise only if the digits behind the point count nanoseconds (`{secs}.{nsecs}`)."""
    fractions = [cell.partition(b".")[2].strip() for cell in samples]
    sizes = set(map(len, fractions))
    if (
        len(sizes) < 2
        or max(sizes) != 9
        or not all(part.isdigit() and part[:1] != b"0" for part in fractions)
    ):
        return False
    times, bad = to_ns(samples, padded)
    others, bad_too = to_ns(samples, unpadded)
    if bad is not None or bad_too is not None:
        return False
    return bool((np.diff(times) < 0).any() and (np.diff(others) >= 0).all())


def time_notes(units: Iterable[int]) -> list[str]:
    """Return notes for the user on times in these units."""
    found = set(units)
    return [note for some, note in _NOTES.items() if found.intersection(some)]


def to_ns(cells: Sequence[bytes], unit: int) -> tuple[Int64, Bool | None]:
    """Return nanoseconds of each cell, and True for cells that are no times (their value is 0); None without such."""
    convert = _CONVERTERS[unit]
    try:
        return np.fromiter(map(convert, cells), np.int64, len(cells)), None
    except (ValueError, OverflowError, ArithmeticError):
        pass
    times = np.zeros(len(cells), np.int64)
    bad = np.zeros(len(cells), np.bool_)
    for row, cell in enumerate(cells):
        try:
            times[row] = convert(cell)
        except (ValueError, OverflowError, ArithmeticError):
            bad[row] = True
    return times, bad


def seconds_and_nanoseconds(seconds: Sequence[bytes], rest: Sequence[bytes]) -> tuple[Int64, Bool | None]:
    """Return nanoseconds from a column of whole seconds and one of nanoseconds."""
    high, bad_high = to_ns(seconds, S)
    low, bad_low = to_ns(rest, NS)
    total = high + low
    # The sum of two int64 can wrap around; no such time is meant.
    wrapped = (np.abs(high) > _MAX // 2) | (np.abs(low) > _MAX // 2)
    if bad_high is None and bad_low is None and not wrapped.any():
        return total, None
    bad = wrapped
    for part in (bad_high, bad_low):
        bad = bad if part is None else bad | part
    return np.where(bad, 0, total), bad


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


def _date(cell: bytes) -> int:
    match = _DATE.fullmatch(cell)
    if match is None:
        raise ValueError("not a date")
    year, month, day, hour, minute, second, fraction, sign, off_hours, off_minutes = match.groups()
    days = date(int(year), int(month), int(day)).toordinal() - _EPOCH
    seconds = days * 86400 + int(hour or 0) * 3600 + int(minute or 0) * 60 + int(second or 0)
    if sign:
        offset = int(off_hours) * 3600 + int(off_minutes or 0) * 60
        seconds += offset if sign == b"-" else -offset
    return _checked(seconds * S + int((fraction or b"").ljust(9, b"0")[:9]))


def _padded(cell: bytes) -> bytes:
    whole, point, fraction = cell.strip().partition(b".")
    return whole + point + fraction.rjust(9, b"0") if point else cell


def _of_unit(unit: int) -> Callable[[bytes], int]:
    return lambda cell: int(cell) * unit if cell.isdigit() else _decimal(cell, unit)


_CONVERTERS: dict[int, Callable[[bytes], int]] = {
    DATE: _date,
    NS: _nanoseconds,
    US: _of_unit(US),
    MS: _of_unit(MS),
    S: _seconds,
    S_UNPADDED: lambda cell: _seconds(_padded(cell)),
    DATE_UNPADDED: lambda cell: _date(_padded(cell)),
}
