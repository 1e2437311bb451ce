"""What every format shows: the figures of a run, the verdicts of its checks, the comparison with a baseline."""

from __future__ import annotations

from dataclasses import dataclass

from lidarcli.reports.checks import Verdict
from lidarcli.reports.compare import Comparison
from lidarcli.reports.summary import Summary


@dataclass(frozen=True, slots=True)
class Report:
    """One report, whatever its format."""

    summary: Summary
    verdicts: tuple[Verdict, ...] = ()
    comparison: Comparison | None = None
    problems: tuple[str, ...] = ()
    """Tables that could not be read, one line each."""

    @property
    def holds(self) -> bool:
        """Whether every check holds."""
        return all(verdict.holds for verdict in self.verdicts)

    @property
    def title(self) -> str:
        """What the report is about, in a few words."""
        names = [source.log for source in self.summary.sources]
        return names[0] if len(names) == 1 else f"{len(names)} logs"
