"""What a run over one log has done, for people and for exit codes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidarcli.errors import NoScanError, UnreadableError
from lidarcli.formalism.detection import SETS, Detection
from lidarcli.judging import count_statuses
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.sweeps import STATUSES, SweepBatch

if TYPE_CHECKING:
    from lidarcli.formalism.tracking.tracked import Followed


@dataclass(slots=True)
class RunSummary:
    """Counts of one run of `detect` over one log."""

    sweeps: int = 0
    objects: int = 0
    agents: int = 0
    things: int | None = None
    """What the objects belong to; None where nothing was followed."""
    moved: int = 0
    """Things that moved."""
    by_status: Counter[str] = field(default_factory=Counter)
    """`valid`, `no_return`, `too_close`, `invalid` → beams."""
    by_set: Counter[str] = field(default_factory=lambda: Counter(dict.fromkeys(SETS, 0)))
    """`O`, `A`, `S` (Def. 4) → beams."""
    topics: set[str] = field(default_factory=set)
    missing_topics: tuple[str, ...] = ()
    """Topics that were asked for and are not there, while others are."""
    dropped: list[tuple[str, str, int]] = field(default_factory=list)
    """(topic, cause, messages) that could not be a sweep."""
    damage: list[str] = field(default_factory=list)
    """One line per loss, the dropped messages included."""
    notes: list[str] = field(default_factory=list)
    """What a user should know, the doubts included."""
    doubts: list[str] = field(default_factory=list)
    """How ranges are judged, and what looks wrong in the sweeps."""
    outputs: list[str] = field(default_factory=list)
    output_sizes: list[int] = field(default_factory=list)
    """Bytes of each output."""
    rows: int = 0
    """Rows of all tables that were written."""
    seconds: float = 0.0

    def __setstate__(self, state: tuple[None, dict[str, Any]]) -> None:
        """As any object with slots is read from a pickle; but a class cannot be changed so, which others may ask for."""
        for name, value in state[1].items():
            setattr(self, name, value)

    @property
    def beams(self) -> int:
        """Beams of all sweeps."""
        return self.by_status.total()

    @property
    def exit_code(self) -> int:
        """3 when some of the log could not be read, 4 when a topic was not there, else 0."""
        if self.damage:
            return UnreadableError.exit_code
        return NoScanError.exit_code if self.missing_topics else 0

    def add_sweeps(self, batch: SweepBatch) -> None:
        """Count the sweeps of one batch."""
        self.sweeps += len(batch)
        self.topics.add(batch.topic)
        for status, count in zip(STATUSES, count_statuses(batch.status).sum(axis=1).tolist(), strict=False):
            self.by_status[status] += count

    def add_sets(self, found: Detection | Followed) -> None:
        """Count the objects and agents of one batch, and the beams of each set."""
        self.objects += int(found.objects.sum())
        self.agents += int(found.agents.sum())
        for letter, beams in zip(
            "OAS", (found.object_beams, found.agent_beams, found.noise_beams), strict=True
        ):
            self.by_set[letter] += int(beams.sum())

    def add_things(self, things: int, moved: int) -> None:
        """Count the things of one topic."""
        self.things = (self.things or 0) + things
        self.moved += moved

    def add_found(self, other: RunSummary) -> None:
        """Count what was counted elsewhere."""
        self.objects += other.objects
        self.agents += other.agents
        self.by_set.update(other.by_set)
        if other.things is not None:
            self.add_things(other.things, other.moved)

    def close(self, report: ReadReport, posing: Posing) -> None:
        """Take over what reading has met, the sweeps and their poses."""
        report = posing.together(report)
        self.dropped = [(topic, cause, count) for (topic, cause), count in sorted(report.refused.items())]
        self.damage = damage_lines(report)
        self.doubts = report.doubted()
        self.notes = [*report.notes, *self.doubts, *posing.notes()]


def damage_lines(report: ReadReport) -> list[str]:
    """One line per damaged part and per kind of refused message, and one for those that are not shown."""
    lines = [f"{part.place}: {part.cause}" for part in report.damage]
    if report.damage_more:
        lines.append(f"and {report.damage_more} more damaged parts")
    refused = sorted(report.refused.items())
    for (topic, cause), count in refused[: ReadReport.MAX_DAMAGE]:
        lines.append(f"topic {topic}: {count:,} message{'' if count == 1 else 's'} left out: {cause}")
    if len(refused) > ReadReport.MAX_DAMAGE:
        more = sum(count for _, count in refused[ReadReport.MAX_DAMAGE :])
        lines.append(f"and {more:,} more messages left out")
    return lines
