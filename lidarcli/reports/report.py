"""A report: its parts, the verdicts of its checks, and what could not be read, whatever its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidarcli.errors import CHECK_FAILED, UnreadableError
from lidarcli.reports.checks import CheckVerdict, OneRun
from lidarcli.reports.document import PAGE, Card, NamedValues, ReportPart, Section

if TYPE_CHECKING:
    from lidarcli.formalism.mapping.grid import Occupancy
    from lidarcli.reports.map_picture import MapPicture
    from lidarcli.reports.world import Walls


@dataclass(frozen=True, slots=True)
class Page:
    """Data of a run that only the page shows."""

    viewer: dict[str, Any]
    """Values of `pack`, and a note on sweeps that are left out."""
    overview: MapPicture | None = None
    """The run from above, where there are poses."""
    walls: Mapping[str, Walls] = field(default_factory=dict)
    """Walls by frame."""
    grid: Occupancy | None = None
    """Map of the run, where there are poses and beams."""
    command: str = ""
    """Command that makes the page again."""


@dataclass(frozen=True, slots=True)
class Report:
    """A report on tables of a run, of zones, of changes, or of several of these, whatever its format."""

    parts: tuple[ReportPart, ...]
    """The first one gives the report its title; the sections of the others come before its own."""
    verdicts: tuple[CheckVerdict, ...] = ()
    unread: tuple[str, ...] = ()
    """Tables and folders that could not be read, one line each."""
    unseen: tuple[str, ...] = ()
    """Data that the checks did not see although all tables could be read, one line each."""
    runs: tuple[OneRun, ...] = ()
    """Several logs, and several tables of changes, one by one."""
    trends: Section | None = None
    """These logs one after the other."""
    page: Page | None = None
    """Contents of the HTML alone, where it was requested, of a run."""

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
        found = {**({} if self.trends is None else {"runs": self.trends}), **found}
        return found | ({"words": Section("Words", [NamedValues(words)], (PAGE,))} if words else {})

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
