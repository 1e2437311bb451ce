"""Numbers, stamps and lists as people read them; shared by all formats for people."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from lidarcli.reports.columns import Origin
from lidarcli.reports.figures import CATEGORIES, DELTA, unit_of
from lidarcli.reports.spread import Spread
from lidarcli.reports.summary import Summary

NONE = "-"
SET_WORDS = {"O": "objects (O)", "A": "agents (A)", "S": "noise (S)"}
SHOWN_SPREADS = (
    "objects_per_sweep",
    "range",
    "width",
    "box_length",
    "box_width",
    "beams_per_object",
    "difference",
    "d_th",
    "noise",
    "lost_share",
    "step",
)
SHOWN_STATISTICS = ("mean", "min", "p05", "p50", "p95", "max")


def visible(text: str) -> str:
    r"""Text of a log with escapes for what would steer the terminal that it is shown on.

    >>> visible("/scan\x1b[2J °")
    '/scan\\x1b[2J °'
    """
    return "".join(mark if mark.isprintable() else repr(mark)[1:-1] for mark in text)


def number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    """A number of few digits, with thousands set apart.

    >>> [number(value) for value in (None, 12345, 0.123456, 3.0, 123456.7)]
    ['-', '12,345', '0.1235', '3', '123,457']
    """
    if value is None or not math.isfinite(value):
        return NONE
    mark = "+" if sign else ""
    if value == int(value) or abs(value) >= 10**digits:
        return f"{value:{mark},.0f}"
    return f"{value:{mark}.{digits}g}"


def quantity(name: str, value: float | None, sign: bool = False) -> str:
    """A figure with its unit; a share in per cent."""
    if value is None:
        return NONE
    plain = name.removeprefix(DELTA)
    if plain.endswith("_share") or plain.startswith("lost_share."):
        return f"{100 * value:{'+' if sign else ''}.2f} %"
    unit = unit_of(name)
    return number(value, sign=sign) + ("" if unit == "1" else f" {unit}")


def share(count: float, total: float) -> str:
    """A part of a whole in per cent."""
    return f"{count / total:.1%}" if total else NONE


def stamp(stamp_ns: int) -> str:
    """A stamp in UTC, to the millisecond.

    >>> stamp(1_700_000_000_123_456_789)
    '2023-11-14T22:13:20.123Z'
    """
    try:
        moment = datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{stamp_ns} ns"
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{stamp_ns % 1_000_000_000 // 1_000_000:03d}Z"


def settings(source: Origin) -> str:
    """The parameters of a run that are worth a line: the profile, and what is not null."""
    found = {name: value for name, value in source.parameters.items() if value not in (None, False, [], 0.0)}
    return ", ".join(f"{name} {_plain(value)}" for name, value in found.items()) or "not recorded"


def origin(source: Origin) -> str:
    """Format and size of a log."""
    size = f", {source.size:,} bytes" if source.size is not None else ""
    return f"{source.format or 'unknown format'}{size}"


def kind_counts(summary: Summary, name: str) -> dict[str, int]:
    """Objects by kind, in the order of the declaration."""
    counts = summary.kinds[name]
    return {kind: counts[kind] for kind in CATEGORIES[name] if kind in counts}


def spread_row(name: str, spread: Spread) -> list[str]:
    """One line of the table of spreads."""
    if name == "lost_share":
        return [quantity(name + ".", getattr(spread, part)) for part in SHOWN_STATISTICS]
    return [number(getattr(spread, part)) for part in SHOWN_STATISTICS]


def spread_name(name: str) -> str:
    """The figure with its unit."""
    unit = unit_of(name)
    return name if unit == "1" else f"{name} [{unit}]"


def _plain(value: object) -> str:
    if isinstance(value, list):
        return "[" + " ".join(map(str, value)) + "]"
    if isinstance(value, dict):
        return "{" + " ".join(f"{key}={item}" for key, item in value.items()) + "}"
    return str(value)
