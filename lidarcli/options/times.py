"""Times as people write them: seconds after the first sweep, or date and time of day."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from numbers import Real

from lidarcli.errors import OptionError

LONGEST = 1_000_000_000
"""Longest time after the first sweep [s], thirty years; a greater number counts seconds since 1970."""
LATEST = 100_000_000_000
"""Greatest number of seconds since 1970: the year 5138."""
SECOND_NS = 1_000_000_000
SAME_STAMP = 1_000_000
"""Greatest difference of equal stamps [ns]: programs rewrite them in coarser units."""
_UNITS = {"": 1.0, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_SECONDS = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?) ?(ms|s|min|h|)", re.IGNORECASE)
_FRACTION = re.compile(r"\.(\d{1,9})(?=Z|[+-]|$)", re.IGNORECASE)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, order=True)
class Instant:
    """A moment by date and time of day."""

    ns: int
    """Nanoseconds since 1970, UTC."""

    def __str__(self) -> str:
        seconds, rest = divmod(self.ns, SECOND_NS)
        text = (_EPOCH + timedelta(seconds=seconds)).isoformat().removesuffix("+00:00")
        return f"{text}{f'.{rest:09d}'.rstrip('0') if rest else ''}Z"


def as_time(value: float | str | Instant) -> float | Instant:
    """Return a time that is given as text, as seconds after the first sweep, or as a moment.

    Raises
    ------
    OptionError
        The value is none of these, or no time.
    """
    if isinstance(value, str):
        return parse_time(value)
    if isinstance(value, Instant):
        return value
    if not isinstance(value, Real) or not math.isfinite(value):
        raise OptionError(f"{value!r} is neither a number of seconds nor a text such as 2min or 2026-11-22T10:00:00Z")
    return float(value)


def parse_time(text: str) -> float | Instant:
    """Parse seconds after the first sweep (`12.5`, `12.5s`, `500ms`, `2min`, `1h`), or a moment in ISO 8601.

    A moment without an offset is meant in UTC, as all times that lidarcli writes. A plain number beyond `LONGEST` is a
    moment, too: seconds since 1970, as header stamps have them.

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
    """
    text = text.strip()
    if (seconds := _SECONDS.fullmatch(text)) is not None:
        found = float(seconds[1]) * _UNITS[seconds[2].lower()]
        if LONGEST < found <= LATEST and not seconds[2]:
            return Instant(int(Decimal(seconds[1]) * SECOND_NS))
        if not abs(found) <= LONGEST:
            raise OptionError(f"'{text}' is more than {LONGEST:g} seconds")
        return found
    fraction = _FRACTION.search(text)
    whole = text if fraction is None else text[: fraction.start()] + text[fraction.end() :]
    try:
        moment = datetime.fromisoformat(whole)
    except ValueError:
        raise OptionError(
            f"'{text}' is no time: give seconds after the first sweep (12.5, 500ms, 2min) or date and time "
            "(2026-11-22T10:00:00Z)"
        ) from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    since = moment - _EPOCH
    ns = (since.days * 86_400 + since.seconds) * SECOND_NS
    return Instant(ns + (int(fraction[1].ljust(9, "0")) if fraction else 0))
