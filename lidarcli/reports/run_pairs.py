"""Two runs that are compared with each other, and the changes between them as a table has them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidarcli.options.choices import CHANGE_STATUSES
from lidarcli.reports.columns import Record

if TYPE_CHECKING:
    import pyarrow as pa

COLUMNS = (
    *("thing", "kind", "status", "why", "score", "x_a", "y_a", "yaw_a", "x_b", "y_b", "yaw_b"),
    *("moved", "turned", "length", "width", "label"),
)
"""Columns of the table of changes that a report shows."""
FIRST = ("moved", "new", "gone", "uncertain", "known")
"""Statuses, those to look at first before the others."""


class Change(Record):
    """A row of the table of changes: attributes are `COLUMNS`, None for null."""

    @property
    def place(self) -> tuple[float, float] | None:
        """Place in the last run that has it [m]; None where the table has none."""
        for x, y in ((self.x_b, self.y_b), (self.x_a, self.y_a)):
            if x is not None and y is not None:
                return x, y
        return None


@dataclass(frozen=True, slots=True)
class RunPair:
    """A run and the one that it is compared with."""

    before: str
    name: str
    changes: Sequence[Change]
    counts: dict[str, int]
    """Status → number of changes."""
    dx: float | None = None
    """Shift of the run onto the first one [m]; None, here and below, where it is not known."""
    dy: float | None = None
    dyaw: float | None = None
    """Turn [rad]."""
    overlap: float | None = None
    rms: float | None = None

    @property
    def title(self) -> str:
        """Names of both."""
        return f"{self.before} to {self.name}"

    @property
    def words(self) -> str:
        """Number of changes of each status that occurs."""
        words = [f"{status} {count:,}" for status, count in self.counts.items() if count]
        return ", ".join(words) or "nothing stands in them, and no structure differs"

    def first(self, most: int) -> list[Change]:
        """Return the changes to look at first: by status, then by number."""
        return sorted(self.changes, key=lambda one: (FIRST.index(one.status), one.thing))[:most]

    @property
    def line(self) -> str:
        """Names, numbers and alignment in a line."""
        from lidarcli.reports.wording import percent

        parts = [] if self.overlap is None else [f"{percent(self.overlap)} of the structure in place"]
        if self.dx is not None and self.dy is not None and self.dyaw is not None:
            turn = abs(math.degrees(math.remainder(self.dyaw, math.tau)))
            parts.append(f"{math.hypot(self.dx, self.dy):.2f} m and {turn:.1f} degrees apart")
        return "; ".join(filter(None, [f"{self.title}: {self.words}", ", ".join(parts)]))


def pairs_of(table: pa.Table) -> list[RunPair]:
    """Return the runs of a table with the schema `lidarcli.tabular.schemas.CHANGES`, in their order."""
    from lidarcli.tabular.reading import note_value, notes_of
    from lidarcli.tabular.writing import ALIGNMENT

    changes: dict[str, list[Change]] = {}
    names: dict[str, str] = {}
    for row in table.select(["log_a", "log_b", *COLUMNS]).to_pylist():
        before, name = row.pop("log_a"), row.pop("log_b")
        changes.setdefault(name, []).append(Change(**row))
        names.setdefault(name, before)
    aligned = {
        one["log_b"]: one
        for one in note_value(notes_of(table), ALIGNMENT, list)
        if isinstance(one, dict) and all(isinstance(one.get(name), str) for name in ("log_a", "log_b"))
    }
    # Without metadata the rows alone say which runs there were.
    aligned |= {name: {"log_a": names[name], "log_b": name} for name in names if name not in aligned}
    pairs = []
    for name, one in aligned.items():
        own = changes.get(name, [])
        count = Counter(each.status for each in own)
        alignment = (number_or_none(one.get(key)) for key in ("dx", "dy", "dyaw", "overlap", "rms"))
        pairs.append(RunPair(one["log_a"], name, own, {status: count[status] for status in CHANGE_STATUSES}, *alignment))
    return pairs


def number_or_none(value: object) -> float | None:
    """Return a value of the metadata if it is a number."""
    return float(value) if isinstance(value, int | float) else None
