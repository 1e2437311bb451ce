"""What every format shows: the figures of a run, the verdicts of its checks, the comparison with a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lidarcli.errors import UnreadableError
from lidarcli.reports.checks import Verdict
from lidarcli.reports.compare import Comparison
from lidarcli.reports.streams import unlike_of
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import counted, differences, number, quantity, rate

CHECK_FAILED = 1


@dataclass(frozen=True, slots=True)
class Case:
    """A test case."""

    name: str
    classname: str = "lidarcli.report"
    failure: str | None = None
    """What is wrong, None where nothing is."""
    kind: str = "check"
    """The kind of failure."""
    seconds: float | None = None
    """How long it took, where that is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What reports of every kind have."""

    verdicts: tuple[Verdict, ...] = ()
    unread: tuple[str, ...] = ()
    """Tables and folders that could not be read, one line each."""
    unseen: tuple[str, ...] = ()
    """What the checks have not seen although all tables could be read, one line each."""

    @property
    def problems(self) -> tuple[str, ...]:
        """What could not be read, be it now or when the tables were made."""
        return (*self.unread, *self.unseen)

    @property
    def told_problems(self) -> tuple[tuple[str, str], ...]:
        """The same, each after what it is, for people."""
        return (
            *(("not read", line) for line in self.unread),
            *(("incomplete", line) for line in self.unseen),
        )

    @property
    def title(self) -> str:
        """What the report is about, in a few words."""
        raise NotImplementedError

    @property
    def lines(self) -> tuple[str, ...]:
        """What it says, in a line or two."""
        raise NotImplementedError

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Figures by name; None where there is nothing to measure."""
        raise NotImplementedError

    @property
    def cases(self) -> tuple[Case, ...]:
        """Test cases beside the checks."""
        return ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before its figures are believed, one line each."""
        return ()

    @property
    def judgement(self) -> str:
        """How many checks failed, in a few words, and whether they have seen everything; empty without checks."""
        failed = sum(not verdict.holds for verdict in self.verdicts)
        total = len(self.verdicts)
        if not total:
            return ""
        seen = ", on part of the data" if self.problems else ""
        return f"Checks: {failed or total} of {total} {'failed' if failed else 'passed'}{seen}"

    @property
    def holds(self) -> bool:
        """Whether every check holds, and all of the data could be read."""
        return not self.exit_code

    @property
    def exit_code(self) -> int:
        """3 when tables could not be read, 1 when a check does not hold, 3 when the checks have not seen all, else 0."""
        if self.unread:
            return UnreadableError.exit_code
        if not all(verdict.holds for verdict in self.verdicts):
            return CHECK_FAILED
        return UnreadableError.exit_code if self.unseen else 0


@dataclass(frozen=True, slots=True)
class Report(Judged):
    """One report on tables, whatever its format."""

    summary: Summary
    comparison: Comparison | None = None

    @property
    def title(self) -> str:
        """What the report is about, in a few words."""
        names = [source.log for source in self.summary.sources]
        return names[0] if len(names) == 1 else counted(len(names), "log")

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Figures by name; with a baseline also their differences."""
        return self.summary.figures | (self.comparison.figures if self.comparison else {})

    @property
    def lines(self) -> tuple[str, ...]:
        """Sweeps and objects, and with a baseline in how many sweeps they are others."""
        figures = self.summary.figures
        parts = [f"{counted(figures['sweeps'], 'sweep')} in {quantity('duration', figures['duration'])}"]
        if figures["rate"] is not None:
            parts.append(rate(self.summary))
        parts.append(counted(figures["objects"], "object"))
        if figures["sweeps"]:
            parts[-1] += f" ({number(figures['objects_per_sweep.mean'], 3)} per sweep)"
        if self.summary.tracked is not None:
            agents = counted(figures["tracks.agents"], "agent")
            parts.append(f"{counted(figures['tracks'], 'track')} ({agents})")
        if figures["damage"]:
            parts.append(f"damage in {counted(figures['damage'], 'place')} of the logs")
        line = f"{self.title}: {', '.join(parts)}"
        return (line,) if self.comparison is None else (line, self.comparison.words)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Whether sensors are pooled, or compared, that should not be."""
        found = []
        if unlike := differences(self.summary.unlike):
            found.append(
                f"unlike sensors ({unlike}): the figures pool all of them, and no map in the sensor frame is drawn; for "
                "figures of one sensor report its tables alone"
            )
        if self.comparison is not None:
            baseline = self.comparison.baseline
            both = unlike_of([*self.summary.streams.all, *baseline.streams.all])
            if both and not (self.summary.unlike or baseline.unlike):
                found.append(
                    f"the baseline is of another sensor ({differences(both)}): what differs need not be in the scene"
                )
        return tuple(found)
