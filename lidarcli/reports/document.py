"""Parts of a report as a document: sections of tables, facts, shares, lines and notes.

Renderers walk the sections and know nothing of the figures in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

from lidarcli.display.texts import time_of_day
from lidarcli.options.times import TimeZone
from lidarcli.reports.columns import Origin
from lidarcli.reports.run_pairs import RunPair
from lidarcli.sweeps.types import Float64

TEXT, MARKDOWN, PAGE = "text", "markdown", "page"
"""Formats for people: the terminal, Markdown and HTML."""
Line = tuple[str, ...]
"""A line of running text in parts, some of which are `Code`."""
NAMES = frozenset({"zone", "kind", "by", "log", "status", "detail", "shape", "label", "end", "from", "people"})
"""Columns of `table_of` that hold names, which are flush left; numbers are flush right."""


class Code(str):
    """Text that is set as code: the name of a figure, a value of a parameter, a command, a course in blocks."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Share:
    """A part of a whole, drawn as a bar."""

    part: int
    whole: int


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table with a heading for each column."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()
    """Columns that are flush right."""
    more: str = ""
    """Rows that are left out, in words."""


def table_of(cells: Mapping[str, Sequence[str]], more: str = "") -> ReportTable:
    """Return a table of heading → cells; columns without a single entry are left out."""
    head = [name for name, column in cells.items() if any(column)]
    right = [k for k, name in enumerate(head) if name not in NAMES]
    return ReportTable(head, [*zip(*(cells[name] for name in head), strict=True)], right, more)


@dataclass(frozen=True, slots=True)
class NamedValues:
    """Names with a value each."""

    rows: Sequence[tuple[str, str | Share]]


@dataclass(frozen=True, slots=True)
class Shares:
    """Parts of a whole by kind."""

    kind: str
    """Heading of the kinds."""
    unit: str
    """Heading of the counts."""
    counts: Mapping[str, int]
    total: int


@dataclass(frozen=True, slots=True)
class Drawing:
    """Lines of block characters, which keep their blanks."""

    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class Notes:
    """Lines of running text."""

    lines: Sequence[Line]
    alarming: bool = False


Spans = Sequence[tuple[float, float]]


class Band(NamedTuple):
    """Stretches in which something went on, in shares of a time."""

    name: str
    word: str
    """Action that a zone asks for."""
    parts: Sequence[tuple[str, Spans]]
    """Kinds of what went on, each with its stretches: an action, by which pages colour them, `stale` or `still`."""
    thin: Spans = ()
    """Spans of less weight."""


@dataclass(frozen=True, slots=True)
class Bands:
    """Bands over one time."""

    title: str
    seconds: float
    """Length of the time."""
    bands: Sequence[Band]
    start_ns: int
    time_zone: TimeZone

    def clock(self, share: float) -> str:
        """Return the time of day at a share of the time; empty where nobody knows it."""
        return time_of_day(self.start_ns + round(share * self.seconds * 1e6) * 1000, self.time_zone)


@dataclass(frozen=True, slots=True)
class FromAbove:
    """Changes of a run, which pages draw."""

    number: int
    """Number of the run, 1 for the first that is compared with another one."""
    changes: RunPair


class TimeSeries(NamedTuple):
    """A quantity over time."""

    name: str
    seconds: Float64
    """(K,) [s], ascending."""
    values: Float64
    """(K,); NaN where it is not known."""
    colour: str


class Stretch(NamedTuple):
    """A time in which something went on [s]."""

    name: str
    begin: float
    end: float
    colour: str


@dataclass(frozen=True, slots=True)
class TimePlot:
    """Quantities over one time, by their axis, and what went on meanwhile."""

    at: float
    """Time that is marked [s]."""
    courses: Mapping[str, Sequence[TimeSeries]]
    """Words at the axis, with the unit → quantities."""
    stretches: Sequence[Stretch]


class Trend(NamedTuple):
    """A figure of several runs, one after the other, which pages draw; x and y are shares of the axes."""

    name: str
    limit: str
    points: Sequence[tuple[float, float, bool, str]]
    """x, y, whether a check fails, and words, of the runs whose value is known."""
    limits: Sequence[float]
    """y of each limit."""
    ends: tuple[str, str, str, str]
    """Words at the low and the high end of y, and of x."""


@dataclass(frozen=True, slots=True)
class Film:
    """Pictures to step through, for pages."""

    frames: Sequence[str]
    """Images as data URIs."""
    words: Sequence[str]
    seconds: Sequence[float]
    at: int
    """The one that is shown first."""


Block = TimePlot | Trend | Film | Bands | ReportTable | NamedValues | Shares | Drawing | Notes | FromAbove


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a document."""

    title: str
    """Heading; empty without one."""
    blocks: Sequence[Block]
    formats: Sequence[str] = (TEXT, MARKDOWN, PAGE)
    """Formats that have the section."""
    fold: str = ""
    """Title of the fold in which Markdown puts the section; empty where it stays in sight."""


class Card(NamedTuple):
    """A key figure at the top of a page."""

    name: str
    value: str
    detail: str
    alarming: bool = False
    meaning: str = ""
    """Meaning of the figure, for those who do not know the word."""


class Opening(NamedTuple):
    """Beginning of a report on one kind of table alone."""

    cards: Sequence[Card] = ()
    lines: Sequence[str] = ()
    values: Mapping[str, Any] = {}
    """Entries of its JSON."""


class ReportPart(ABC):
    """Tables of one kind in a report: together with another part, or alone.

    `schema` is the name of the JSON schema of a report that begins with this part; pages explain `words`.
    """

    __slots__ = ()
    schema = ""
    words: Mapping[str, str] = MappingProxyType({})
    sources: tuple[Origin, ...]
    figures: Mapping[str, float | None]

    @property
    def differences(self) -> Mapping[str, float | None]:
        """Differences from a baseline, which the JSON has apart from the figures."""
        return {}

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the figures, one line each."""
        return []

    @property
    def opening(self) -> Opening:
        """Beginning of a report on them alone."""
        return Opening()

    @property
    @abstractmethod
    def title(self) -> str:
        """Subject in a few words."""

    @property
    @abstractmethod
    def lines(self) -> list[str]:
        """Summary in a few lines."""

    @abstractmethod
    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""

    @abstractmethod
    def cards(self) -> list[Card]:
        """Return the key figures."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the entries of the JSON in addition to the figures."""
