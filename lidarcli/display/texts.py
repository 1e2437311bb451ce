"""Text of batches, backgrounds and maps: a line in a list, a few lines by `print`, a small table in a notebook."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import UTC
from typing import NamedTuple, Protocol, TypeVar

from lidarcli.options.times import TimeZone, is_date, local

_SHOWN = 4
"""Names of a list that are shown."""
_VARYING = re.compile(r"[^\s,;:()]*[\d/_][^\s,;:()]*")
"""Numbers, and names of topics, frames and files."""


class Facts(NamedTuple):
    """Description of an object."""

    title: str
    """One line that names it."""
    rows: tuple[tuple[str, str], ...]
    """Pairs of a name and its text."""


class Described(Protocol):
    """An object that describes itself."""

    def facts(self) -> Facts:
        """Return the description of this object."""


T = TypeVar("T", bound=Described)


def shown(cls: type[T]) -> type[T]:
    """Decorate a class whose objects print their `facts`."""
    cls.__repr__ = _line  # type: ignore[method-assign,assignment]
    cls.__str__ = _text  # type: ignore[method-assign,assignment]
    cls._repr_html_ = _html  # type: ignore[attr-defined]
    return cls


def _line(self: Described) -> str:
    return f"<{type(self).__name__} {self.facts().title}>"


def _text(self: Described) -> str:
    title, rows = self.facts()
    width = max((len(name) for name, _ in rows), default=0) + 2
    return "\n".join([f"{type(self).__name__} {title}", *(f"  {name:{width}}{words}" for name, words in rows)])


def _html(self: Described) -> str:
    from html import escape

    title, rows = self.facts()
    cells = "".join(
        f'<tr><th style="text-align: left">{escape(name)}</th><td style="text-align: left">{escape(words)}</td></tr>'
        for name, words in rows
    )
    head = f'<caption style="text-align: left"><b>{type(self).__name__}</b> {escape(title)}</caption>'
    return f"<table>{head}{cells}</table>"


class Routine(str):
    """A note on how the work was done, which needs no action of the user: only `--verbose` shows it."""

    __slots__ = ()


class Unused(str):
    """A note on options that change nothing: the Python functions warn of it, too."""

    __slots__ = ()


def headed(head: str, note: str) -> str:
    """Return a note with words before it, as routine as it was."""
    return type(note)(head + note)


def times(number: int) -> str:
    """Return how often in words.

    >>> [times(1), times(2000)]
    ['once', '2,000 times']
    """
    return "once" if number == 1 else f"{number:,} times"


def counted(number: int, what: str) -> str:
    """Return a number with its noun.

    >>> counted(1, "sweep"), counted(1200, "sweep")
    ('1 sweep', '1,200 sweeps')
    """
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def span(values: Iterable[float], form: str, unit: str) -> str:
    """Return a range as text, as `1.0 to 3.0 m`; of values that read the same that one value.

    >>> span([1.0, 3.0, 2.0], ".1f", "m"), span([2, 2], ",", "per sweep"), span([], "g", "m")
    ('1.0 to 3.0 m', '2 per sweep', 'none')
    """
    given = [*values]
    if not given:
        return "none"
    low, high = format(min(given), form), format(max(given), form)
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def moment(stamp_ns: int, zone: TimeZone = UTC) -> str:
    """Return date and time of a wall clock, or plain seconds of a clock that started near zero (simulation).

    >>> moment(1_700_000_000_250_000_000), moment(2_500_000_000)
    ('2023-11-14T22:13:20.250Z', '2.500 s')
    """
    return stamp(stamp_ns, zone) if is_date(stamp_ns) else f"{stamp_ns * 1e-9:.3f} s"


def stamp(stamp_ns: int, zone: TimeZone = UTC) -> str:
    """Return a stamp in a time zone, to the millisecond; in nanoseconds where the calendar ends.

    >>> stamp(1_700_000_000_123_456_789), stamp(10**30)
    ('2023-11-14T22:13:20.123Z', '1000000000000000000000000000000 ns')
    """
    try:
        return local(stamp_ns, zone).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    except (OverflowError, ValueError, OSError):
        return f"{stamp_ns} ns"


def time_of_day(stamp_ns: int, zone: TimeZone = UTC) -> str:
    """Return the time of day of a stamp; empty where it is no date.

    >>> time_of_day(1_700_000_000_123_456_789), time_of_day(2_500_000_000)
    ('22:13:20.1', '')
    """
    return f"{local(stamp_ns, zone):%H:%M:%S.%f}"[:-5] if is_date(stamp_ns) else ""


def times_of_day(stamps_ns: Sequence[int], zone: TimeZone = UTC) -> tuple[str, list[str]]:
    """Return the heading and the cells of a column of times of day: their date once, if they share it.

    >>> times_of_day([1_700_000_000_123_456_789, 1_700_000_001_000_000_000]), times_of_day([2_500_000_000])
    (('2023-11-14', ['22:13:20.1', '22:13:21.0']), ('', ['']))
    """
    clocks = [time_of_day(each, zone) for each in stamps_ns]
    dates = [f"{local(each, zone):%Y-%m-%d}" if clock else "" for each, clock in zip(stamps_ns, clocks, strict=True)]
    if len({*dates} - {""}) < 2:
        return max(dates, default=""), clocks
    return "time of day", [f"{date} {clock}".strip() for date, clock in zip(dates, clocks, strict=True)]


def column_of_times(stamps_ns: Sequence[int], zone: TimeZone) -> list[str]:
    """Return heading and cells of `times_of_day`, of one width with the gap behind them; empty where there are none."""
    head, cells = times_of_day(stamps_ns, zone)
    room = max(map(len, (head, *cells))) + 2 if head else 0
    return [f"{each:<{room}}" for each in (head, *cells)]


def some_of(names: Sequence[str]) -> str:
    """Return the first few of some names.

    >>> some_of(["a", "b", "c", "d", "e", "f"])
    'a, b, c, d and 2 more'
    """
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def alike(lines: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return lines, each with what stands below it; of three that differ in names and numbers alone, or more, the first.

    >>> alike([("/a: 5% are near", ""), ("/b: 6% are near", ""), ("/c: no frame", ""), ("/d: 4% are near", "")])
    [('/a: 5% are near (alike: /b, /d)', ''), ('/c: no frame', '')]
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for line, below in lines:
        groups.setdefault((_VARYING.sub("*", line), below), []).append(line)
    found = []
    for (_, below), each in groups.items():
        first, *others = (_VARYING.findall(line) for line in each)
        names = [next((word for word, one in zip(words, first, strict=True) if word != one), "again") for words in others]
        found += [(f"{each[0]} (alike: {some_of(names)})", below)] if len(each) > 2 else [(line, below) for line in each]
    return found


def nearest(name: str, known: Iterable[str]) -> list[str]:
    """Return which of the known names a misspelt one is most like; empty where it is like none."""
    from difflib import get_close_matches

    return get_close_matches(name, known, 1)


def clipped(text: str) -> str:
    """Return a text of a file for a message: no more than 60 characters of it."""
    return text if len(text) <= 60 else f"{text[:57]}..."


def visible(text: str) -> str:
    r"""Text from a log, a table or a file name, with escapes for what would break the line or steer the terminal.

    >>> visible("/scan\n\x1b[2J °")
    '/scan\\n\\x1b[2J °'
    """
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)


def no_command(line: str) -> str:
    r"""A line of which CI servers read no command, whatever a log or a topic is called.

    >>> no_command("  ::error file=x"), no_command("  ##[error]x"), no_command("  /scan::x")
    ('  \\x3a:error file=x', '  \\x23#[error]x', '  /scan::x')
    """
    text = line.lstrip()
    return line if text[:2] not in ("::", "##") else line.replace(text[0], f"\\x{ord(text[0]):x}", 1)
