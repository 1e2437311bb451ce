"""Times as people write them: seconds after the first sweep, time of day, or date and time of day."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from datetime import UTC, datetime, time, timedelta, tzinfo
from decimal import Decimal
from numbers import Real

from lidarcli.errors import OptionError
from lidarcli.system.records import dataclass

LONGEST = 1_000_000_000
"""Longest time after the first sweep [s], thirty years; a greater number counts seconds since 1970."""
LATEST = 100_000_000_000
"""Greatest number of seconds since 1970: the year 5138."""
SECOND_NS = 1_000_000_000
SAME_STAMP = 1_000_000
"""Greatest difference of equal stamps [ns]: programs rewrite them in coarser units."""
TimeZone = tzinfo | None
"""A time zone; None is that of this machine."""
SLACK = 60 * SECOND_NS
"""A time of day this long before the first sweep is still meant to be of its day [ns]: who writes it leaves out seconds."""
_UNITS = {"": 1.0, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_SECONDS = r"(?i)([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?) ?(ms|s|min|h|)"
_FRACTION = r"(?i)\.(\d{1,9})(?=Z|[+-]|$)"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Instant:
    """A moment by date and time of day."""

    ns: int
    """Nanoseconds since 1970, UTC."""

    def __str__(self) -> str:
        seconds, rest = divmod(self.ns, SECOND_NS)
        text = (_EPOCH + timedelta(seconds=seconds)).isoformat().removesuffix("+00:00")
        return f"{text}{f'.{rest:09d}'.rstrip('0') if rest else ''}Z"

    def __lt__(self, other: Instant) -> bool:
        return self.ns < other.ns


@dataclass(frozen=True, slots=True)
class TimeOfDay:
    """A time of day, which becomes a moment once the day of a log is known."""

    clock: time
    zone: TimeZone

    def after(self, first_ns: int) -> Instant:
        """Return the first such moment at or after a stamp, or up to `SLACK` before it (`OptionError`: it is no date)."""
        if not is_date(first_ns):
            raise OptionError(
                f"{self.clock}: the clock of this log starts at {first_ns / SECOND_NS:.1f} s and has no time of day: give "
                "seconds after the first sweep"
            )
        today = local(first_ns, self.zone).date()
        # An hour that a clock shows twice comes twice.
        each = (datetime.combine(today + timedelta(k // 2), self.clock.replace(fold=k % 2)) for k in range(4))
        return Instant(next(ns for moment in each if (ns := _ns_of(moment, self.zone)) >= first_ns - SLACK))

    def __str__(self) -> str:
        return f"{self.clock} {self.zone or 'local time'}"


Time = float | Instant | TimeOfDay
"""Seconds after the first sweep, or a moment."""


def is_date(stamp_ns: int) -> bool:
    """Return False for a stamp of a clock that starts near zero: simulation, or a robot that was never set."""
    return 10**17 <= stamp_ns < 10**20


def parse_zone(text: str) -> TimeZone:
    """Return the time zone of a name, an offset, or `local` (`OptionError`: there is none).

    >>> str(parse_zone("utc")), str(parse_zone("-03:30")), parse_zone("local")
    ('UTC', 'UTC-03:30', None)
    """
    if text.lower() in ("utc", "local"):
        return UTC if text.lower() == "utc" else None
    # Most runs need no names of zones.
    from zoneinfo import ZoneInfo

    try:
        return datetime.strptime(text, "%z").tzinfo if text[:1] in "+-" else ZoneInfo(text)
    except (KeyError, ValueError, OSError):
        raise OptionError(
            f"'{text}' is no time zone: give a name such as Europe/Berlin, an offset such as +02:00, or local"
        ) from None


def local(stamp_ns: int, zone: TimeZone) -> datetime:
    """Return date and time of a stamp in a time zone, to the microsecond (`OverflowError` where the calendar ends)."""
    return (_EPOCH + timedelta(microseconds=int(stamp_ns) // 1000)).astimezone(zone)


def _ns_of(moment: datetime, zone: TimeZone) -> int:
    """Return nanoseconds since 1970 of date and time of day, which without an offset are meant in a zone."""
    since = (moment if moment.tzinfo else moment.replace(tzinfo=zone)).astimezone(UTC) - _EPOCH
    return (since.days * 86_400 + since.seconds) * SECOND_NS + since.microseconds * 1000


def as_time(value: float | str | Instant | TimeOfDay, zone: TimeZone = UTC) -> Time:
    """Return a time that is given as text, of `parse_time`, as seconds after the first sweep, or as a moment.

    Raises
    ------
    OptionError
        The value is none of these, or no time.
    """
    if isinstance(value, str):
        return parse_time(value, zone)
    if isinstance(value, Instant | TimeOfDay):
        return value
    if not isinstance(value, Real) or not math.isfinite(value):
        raise OptionError(f"{value!r} is neither a number of seconds nor a text such as 2min, 14:02, 2026-11-22T10:00:00Z")
    return float(value)


def parse_time(text: str, zone: TimeZone = UTC) -> Time:
    """Parse seconds after the first sweep (`12.5`, `500ms`, `2min`), a time of day (`14:02:17.5`), or a moment in ISO 8601.

    What is without an offset is meant in a zone, by default UTC, as all times that lidarcli writes. A plain number beyond
    `LONGEST` is a moment, too: seconds since 1970, as header stamps have them.

    Raises
    ------
    OptionError
        The text is neither, or the time is too far away.

    >>> parse_time("2min")
    120.0
    >>> str(parse_time("1700000000.25"))
    '2023-11-14T22:13:20.25Z'
    >>> str(parse_time("2026-11-22 10:00:00.5+01:00"))
    '2026-11-22T09:00:00.5Z'
    >>> str(parse_time("14:02:17.5").after(parse_time("2026-11-22T20:00:00Z").ns))
    '2026-11-23T14:02:17.5Z'
    """
    text = text.strip()
    if (seconds := re.fullmatch(_SECONDS, text)) is not None:
        found = float(seconds[1]) * _UNITS[seconds[2].lower()]
        if LONGEST < found <= LATEST and not seconds[2]:
            return Instant(int(Decimal(seconds[1]) * SECOND_NS))
        if not abs(found) <= LONGEST:
            raise OptionError(f"'{text}' is more than {LONGEST:g} seconds")
        return found
    if ":" in text[1:3]:
        with suppress(ValueError):
            clock = time.fromisoformat(f"0{text}" if text[1] == ":" else text)
            return TimeOfDay(clock.replace(tzinfo=None), clock.tzinfo or zone)
    fraction = re.search(_FRACTION, text)
    whole = text if fraction is None else text[: fraction.start()] + text[fraction.end() :]
    try:
        moment = datetime.fromisoformat(whole)
    except ValueError:
        raise OptionError(
            f"'{text}' is no time: give seconds after the first sweep (12.5, 500ms, 2min), a time of day (14:02, "
            "14:02:17.5) or date and time (2026-11-22T10:00:00Z)"
        ) from None
    return Instant(_ns_of(moment, zone) + (int(fraction[1].ljust(9, "0")) if fraction else 0))


def window(start: Time | None, end: Time | None, first_ns: int) -> tuple[float | Instant | None, float | Instant | None]:
    """Return a window with moments in place of times of day, each after the first sweep and the start (`OptionError`)."""
    start = start.after(first_ns) if isinstance(start, TimeOfDay) else start
    begin_ns = max(start.ns, first_ns) if isinstance(start, Instant) else first_ns
    return start, end.after(begin_ns) if isinstance(end, TimeOfDay) else end
