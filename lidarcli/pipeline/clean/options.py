"""Options of `clean`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.registry import TopicChoice
from lidarcli.options.choices import AROUND, NAN
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.reading import Readable


@dataclass(frozen=True, slots=True)
class CleanOptions:
    """Options of `clean`, apart from input and output."""

    detect: DetectOptions
    """Options of reading, detection and tracking; a mask tells the robot itself, times and run the part to write."""
    remove: frozenset[str] = frozenset({"agents"})
    """Kinds of beams that are removed in addition to those under a mask: of agents and temporary."""
    value: str | float = NAN
    """Value of removed beams: one of `SAYINGS`, or a range [m]."""
    margin: int = 1
    """Neighbours of these beams that are removed, too."""
    overwrite: bool = False
    mend: frozenset[str] | None = None
    """Faults that are mended: words of `MENDS`, or `FOUND`; None: none."""
    clips: Readable | None = None
    """Table with a row for each log that is written."""
    around: float = AROUND
    """Time before and after each of its rows [s]."""
    merge: str | None = None
    """Topic of the merged sweeps of a robot; None: none are written."""
    merge_frame: str | None = None
    """Frame of these; None: that of the robot itself."""

    def inputs(self, sources: Sequence[Source]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        return [*self.detect.inputs(sources), *([str(self.clips)] if isinstance(self.clips, Path) else [])]

    @property
    def is_cut(self) -> bool:
        """True if only a part of the log is written, or more than it: of a folder one file."""
        return self.merge is not None or not self.is_whole

    @property
    def is_whole(self) -> bool:
        """True if no part of the log is left out."""
        read = self.detect.read
        return all(each is None for each in (read.start, read.end, read.run, self.clips))

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the table's metadata."""
        own: dict[str, Any] = {"remove": sorted(self.remove), "value": self.value, "margin": self.margin}
        own |= {"mend": sorted(self.mend)} if self.mend is not None else {}
        own |= {"merge": [self.merge, self.merge_frame]} if self.merge is not None else {}
        return self.detect.as_dict() | own

    def sweeps(self, log: Log, rules: RangeRules) -> Iterator[SweepBatch]:
        """Yield all sweeps; the pass that makes the tables reports the damage."""
        topics = self.detect.read.topics
        return read_batches(log, ReadOptions(topics, rules=rules), ReadReport(), TopicChoice(topics, log.topics()))
