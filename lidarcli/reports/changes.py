"""Changes from run to run in a report: their figures, and what pictures and tables show of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from lidarcli.choices import CHANGE_STATUSES
from lidarcli.reports.columns import Origin
from lidarcli.reports.figures import OF_MAPS
from lidarcli.reports.wording import percent
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import ALIGNMENT, CHANGE_FIGURES, DAMAGE, PARAMETERS, VERSION

if TYPE_CHECKING:
    import pyarrow as pa

FIRST = ("moved", "new", "gone", "uncertain", "known")
"""Statuses, those to look at first before the others."""


@dataclass(frozen=True, slots=True)
class Change:
    """A row of the table of changes: fields are its columns."""

    thing: int
    kind: str
    status: str
    why: str | None
    score: float | None
    x_a: float | None
    y_a: float | None
    yaw_a: float | None
    x_b: float | None
    y_b: float | None
    yaw_b: float | None
    moved: float | None
    turned: float | None
    length: float | None
    width: float | None
    label: str | None

    @property
    def place(self) -> tuple[float, float] | None:
        """Place in the last run that has it [m]; None where the table tells none."""
        for x, y in ((self.x_b, self.y_b), (self.x_a, self.y_a)):
            if x is not None and y is not None:
                return x, y
        return None


@dataclass(frozen=True, slots=True)
class RunPair:
    """A run beside those before it."""

    before: str
    name: str
    changes: tuple[Change, ...]
    dx: float | None = None
    """Shift of the run onto the first one [m]; None, here and below, where nothing tells it."""
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
    def counts(self) -> dict[str, int]:
        """Status → number of changes."""
        found = Counter(one.status for one in self.changes)
        return {status: found[status] for status in CHANGE_STATUSES}

    @property
    def words(self) -> str:
        """Number of changes of each status that occurs."""
        words = [f"{status} {count:,}" for status, count in self.counts.items() if count]
        return ", ".join(words) or "nothing stands in them, and no structure differs"

    @property
    def line(self) -> str:
        """Names, numbers and alignment in a line."""
        way = [] if self.overlap is None else [f"{percent(self.overlap)} of the structure in place"]
        if self.dx is not None and self.dy is not None and self.dyaw is not None:
            turn = abs(math.degrees(math.remainder(self.dyaw, math.tau)))
            way.append(f"{math.hypot(self.dx, self.dy):.2f} m and {turn:.1f} degrees apart")
        return "; ".join([f"{self.title}: {self.words}", *([", ".join(way)] if way else [])])


@dataclass(frozen=True, slots=True)
class Changed:
    """Changes of some tables."""

    pairs: tuple[RunPair, ...]
    figures: dict[str, float | None]
    """Every name of `figures.OF_CHANGES` → value; those of `figures.OF_MAPS` where two maps were compared."""
    sources: tuple[Origin, ...]


def pairs_of(table: pa.Table) -> tuple[RunPair, ...]:
    """Return the runs of a table with the schema `lidarcli.tabular.schemas.CHANGES`, in their order."""
    rows = table.to_pylist()
    changes: dict[str, list[Change]] = {}
    names: dict[str, str] = {}
    for row in rows:
        changes.setdefault(row["log_b"], []).append(Change(**{name: row[name] for name in _NAMES}))
        names.setdefault(row["log_b"], row["log_a"])
    told = [one for one in note_value(notes_of(table), ALIGNMENT, list) if _is_alignment(one)]
    # Without metadata the rows alone tell which runs there were.
    told += [{"log_a": names[name], "log_b": name} for name in names if name not in {*_names_of(told)}]
    return tuple(
        RunPair(
            one["log_a"],
            one["log_b"],
            tuple(changes.get(one["log_b"], ())),
            *(_number(one.get(name)) for name in ("dx", "dy", "dyaw", "overlap", "rms")),
        )
        for one in told
    )


_NAMES = tuple(one.name for one in fields(Change))


def _is_alignment(one: object) -> bool:
    return isinstance(one, dict) and all(isinstance(one.get(name), str) for name in ("log_a", "log_b"))


def _names_of(told: Sequence[Mapping[str, Any]]) -> list[str]:
    return [one["log_b"] for one in told]


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def changed_of(tables: Sequence[tuple[str, pa.Table]]) -> Changed:
    """Return the changes of tables, whose statuses are known, each with its name."""
    pairs: list[RunPair] = []
    sources = []
    unknown: set[str] = set()
    of_maps: dict[str, float | None] = {}
    for name, table in tables:
        notes = notes_of(table)
        figures = note_value(notes, CHANGE_FIGURES, dict)
        # What diff could not count, as of a run too short for anything to stand in it, is not none.
        unknown |= {status for status in CHANGE_STATUSES if status in figures and figures[status] is None}
        of_maps |= {each: _number(figures[each]) for each in OF_MAPS if each in figures}
        pairs += pairs_of(table)
        sources.append(
            Origin(
                name,
                name.rsplit("/", maxsplit=1)[-1],
                version=notes.get(VERSION, ""),
                parameters=note_value(notes, PARAMETERS, dict),
                damage=tuple(map(str, note_value(notes, DAMAGE, list))),
            )
        )
    values: dict[str, float | None] = {
        status: None if status in unknown else sum(pair.counts[status] for pair in pairs) for status in CHANGE_STATUSES
    }
    overlaps = [pair.overlap for pair in pairs if pair.overlap is not None]
    values["overlap"] = min(overlaps) if overlaps else None
    if len(tables) == 1:
        # Those of several pairs of maps have no mean that says anything.
        values |= of_maps
    return Changed(tuple(pairs), values, tuple(sources))
