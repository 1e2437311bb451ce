"""A report on tables: the figures of a run, the verdicts of its checks, the comparison with a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lidarcli.reports.compare import Comparison
from lidarcli.reports.contents import cards_of, damage_cards, sections_of
from lidarcli.reports.document import Card, Document, Section
from lidarcli.reports.streams import unlike_of
from lidarcli.reports.summary import Summary
from lidarcli.reports.wording import counted, differences, number, quantity, rate


@dataclass(frozen=True, slots=True)
class Report(Document):
    """One report on tables, whatever its format."""

    summary: Summary
    comparison: Comparison | None = None

    @property
    def title(self) -> str:
        """Subject of the report in a few words."""
        names = [source.log for source in self.summary.sources]
        return names[0] if len(names) == 1 else counted(len(names), "log")

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Figures by name; with a baseline also their differences."""
        return self.summary.figures | (self.comparison.figures if self.comparison else {})

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        return sections_of(self.summary, self.comparison)

    def cards(self) -> list[Card]:
        """Return the key figures, those of checks and damage last."""
        return [*cards_of(self.summary), *self.check_cards(), *damage_cards(self.summary)]

    @property
    def lines(self) -> tuple[str, ...]:
        """Numbers of sweeps and objects; with a baseline also of sweeps that differ."""
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
        """Warnings of sensors that are pooled, or compared, but unlike."""
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
