"""What every format shows: the figures of a run, the verdicts of its checks, the comparison with a baseline."""

from __future__ import annotations

from dataclasses import dataclass

from lidarcli.errors import UnreadableError
from lidarcli.reports.checks import Verdict
from lidarcli.reports.compare import Comparison
from lidarcli.reports.summary import Summary

CHECK_FAILED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What reports of every kind have."""

    verdicts: tuple[Verdict, ...] = ()
    problems: tuple[str, ...] = ()
    """Tables that could not be read, one line each."""

    @property
    def holds(self) -> bool:
        """Whether every check holds."""
        return all(verdict.holds for verdict in self.verdicts)

    @property
    def exit_code(self) -> int:
        """3 when tables could not be read, 1 when a check does not hold, else 0."""
        if self.problems:
            return UnreadableError.exit_code
        return 0 if self.holds else CHECK_FAILED


@dataclass(frozen=True, slots=True)
class Report(Judged):
    """One report on tables, whatever its format."""

    summary: Summary
    comparison: Comparison | None = None

    @property
    def title(self) -> str:
        """What the report is about, in a few words."""
        names = [source.log for source in self.summary.sources]
        return names[0] if len(names) == 1 else f"{len(names)} logs"
