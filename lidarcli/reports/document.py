"""A report as a document: verdicts of checks, and sections of tables, facts, shares, lines and notes.

Renderers walk the sections and know nothing of the figures in them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from lidarcli.errors import CHECK_FAILED, UnreadableError
from lidarcli.reports.checks import Verdict
from lidarcli.reports.columns import Origin

if TYPE_CHECKING:
    from lidarcli.reports.changes import RunPair
    from lidarcli.reports.html import Page

TEXT, MARKDOWN, PAGE = "text", "markdown", "page"
"""Formats for people: the terminal, Markdown and HTML."""
Line = tuple[str, ...]
"""A line of running text in parts, some of which are `Code`."""
NAMES = frozenset({"zone", "kind", "by", "log", "status", "detail", "shape", "label", "end"})
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
class Table:
    """A table with a heading for each column."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()
    """Columns that are flush right."""
    more: str = ""
    """Rows that are left out, in words."""


def table_of(cells: Mapping[str, Sequence[str]], more: str = "") -> Table:
    """Return a table of heading → cells; columns without a single entry are left out."""
    head = [name for name, column in cells.items() if any(column)]
    right = [k for k, name in enumerate(head) if name not in NAMES]
    return Table(head, [*zip(*(cells[name] for name in head), strict=True)], right, more)


@dataclass(frozen=True, slots=True)
class Facts:
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


class Band(NamedTuple):
    """Stretches in which something went on, in shares of a time."""

    name: str
    word: str
    """Kind of what went on: an action, by which pages colour it."""
    spans: Sequence[tuple[float, float]]
    thin: Sequence[tuple[float, float]]
    """Spans of less weight."""


@dataclass(frozen=True, slots=True)
class Bands:
    """Bands over one time."""

    title: str
    seconds: float
    """Length of the time."""
    bands: Sequence[Band]


@dataclass(frozen=True, slots=True)
class FromAbove:
    """Changes of a run, which pages draw."""

    number: int
    """Number of the run, 1 for the first that is compared with another one."""
    changes: RunPair


Block = Bands | Table | Facts | Shares | Drawing | Notes | FromAbove


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


class Part(ABC):
    """Tables of one kind in a report: beside another part, or alone.

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
        """Return the entries of the JSON beside the figures."""


@dataclass(frozen=True, slots=True)
class Report:
    """A report on tables of a run, of zones, of changes, or of several of these, whatever its format."""

    parts: tuple[Part, ...]
    """The first one gives the report its title; the sections of the others come before its own."""
    verdicts: tuple[Verdict, ...] = ()
    unread: tuple[str, ...] = ()
    """Tables and folders that could not be read, one line each."""
    unseen: tuple[str, ...] = ()
    """Data that the checks did not see although all tables could be read, one line each."""
    page: Page | None = None
    """Contents of the HTML alone, where it was asked for, of a run."""

    @property
    def title(self) -> str:
        """Subject of the report in a few words."""
        return self.parts[0].title

    @property
    def lines(self) -> tuple[str, ...]:
        """Summary in a few lines."""
        return (*self.parts[0].opening.lines, *(line for part in self.parts for line in part.lines))

    @property
    def figures(self) -> dict[str, float | None]:
        """Figures by name; None where there is nothing to measure."""
        return {name: value for part in self.parts for name, value in {**part.figures, **part.differences}.items()}

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        found = {name: one for part in reversed(self.parts) for name, one in part.sections().items()}
        words = [pair for part in self.parts for pair in part.words.items()]
        return found | ({"words": Section("Words", [Facts(words)], (PAGE,))} if words else {})

    def cards(self) -> list[Card]:
        """Return the key figures, those of checks last."""
        found = [*self.parts[0].opening.cards, *(card for part in self.parts for card in part.cards())]
        if total := len(self.verdicts):
            held = sum(verdict.holds for verdict in self.verdicts)
            words = f"{f'{total - held} failed' if held < total else 'all hold'}{self._partly}"
            found.append(Card("checks", f"{held} of {total}", words, alarming=not self.holds))
        return found

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the figures, one line each."""
        return tuple(line for part in self.parts for line in part.warnings)

    @property
    def problems(self) -> tuple[str, ...]:
        """Everything that could not be read, now or when the tables were made, one line each."""
        return (*self.unread, *self.unseen)

    @property
    def named_problems(self) -> tuple[tuple[str, str], ...]:
        """(kind, line) of each problem, for people."""
        return (*(("not read", line) for line in self.unread), *(("incomplete", line) for line in self.unseen))

    @property
    def judgement(self) -> str:
        """Number of checks that failed, and whether they saw all data, in words; empty without checks."""
        if not (total := len(self.verdicts)):
            return ""
        failed = sum(not verdict.holds for verdict in self.verdicts)
        return f"Checks: {failed or total} of {total} {'failed' if failed else 'passed'}{self._partly}"

    @property
    def _partly(self) -> str:
        return ", on part of the data" if self.problems else ""

    @property
    def holds(self) -> bool:
        """True if every check holds and all of the data could be read."""
        return not self.exit_code

    @property
    def exit_code(self) -> int:
        """3 if tables could not be read, 1 if a check does not hold, 3 if checks did not see all data, else 0."""
        if self.unread:
            return UnreadableError.exit_code
        if not all(verdict.holds for verdict in self.verdicts):
            return CHECK_FAILED
        return UnreadableError.exit_code if self.unseen else 0
