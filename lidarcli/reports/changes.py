"""Changes from run to run as a part of a report: their figures, and what tables and pictures show of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from lidarcli.display.texts import counted
from lidarcli.options.choices import CHANGE_STATUSES
from lidarcli.reports.columns import Origin, Record
from lidarcli.reports.document import MARKDOWN, PAGE, TEXT, Block, Card, FromAbove, Notes, Part, Section, Table, table_of
from lidarcli.reports.figures import OF_MAPS, plain_fields
from lidarcli.reports.wording import in_unit, percent
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import ALIGNMENT, CHANGE_FIGURES, DAMAGE, PARAMETERS, VERSION

if TYPE_CHECKING:
    import pyarrow as pa

COLUMNS = (
    *("thing", "kind", "status", "why", "score", "x_a", "y_a", "yaw_a", "x_b", "y_b", "yaw_b"),
    *("moved", "turned", "length", "width", "label"),
)
"""Columns of the table of changes that a report shows."""
FIRST = ("moved", "new", "gone", "uncertain", "known")
"""Statuses, those to look at first before the others."""
CHANGES, CHANGES_OF_PAGE = 12, 500
"""Most changes of a run that text and Markdown, and the page, show one by one; a page also draws no more."""
DRAWN = 6
"""Most runs that a page draws."""
SEEN_TURN = math.radians(5.0)
"""Boxes of the same thing seen from other sides are turned by up to this angle [rad]."""


class Change(Record):
    """A row of the table of changes: attributes are `COLUMNS`, None for null."""

    @property
    def place(self) -> tuple[float, float] | None:
        """Place in the last run that has it [m]; None where the table tells none."""
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
        parts = [] if self.overlap is None else [f"{percent(self.overlap)} of the structure in place"]
        if self.dx is not None and self.dy is not None and self.dyaw is not None:
            turn = abs(math.degrees(math.remainder(self.dyaw, math.tau)))
            parts.append(f"{math.hypot(self.dx, self.dy):.2f} m and {turn:.1f} degrees apart")
        return "; ".join(filter(None, [f"{self.title}: {self.words}", ", ".join(parts)]))


def pairs_of(table: pa.Table) -> list[RunPair]:
    """Return the runs of a table with the schema `lidarcli.tabular.schemas.CHANGES`, in their order."""
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
    # Without metadata the rows alone tell which runs there were.
    aligned |= {name: {"log_a": names[name], "log_b": name} for name in names if name not in aligned}
    pairs = []
    for name, one in aligned.items():
        mine = changes.get(name, [])
        count = Counter(each.status for each in mine)
        alignment = (_number(one.get(key)) for key in ("dx", "dy", "dyaw", "overlap", "rms"))
        pairs.append(RunPair(one["log_a"], name, mine, {status: count[status] for status in CHANGE_STATUSES}, *alignment))
    return pairs


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


@dataclass(frozen=True, slots=True)
class ChangesPart(Part):
    """Changes of some tables, as a part of a report."""

    sources: tuple[Origin, ...]
    figures: dict[str, float | None]
    """Every name of `figures.OF_CHANGES` → value; those of `figures.OF_MAPS` where two maps were compared."""
    pairs: tuple[RunPair, ...]
    schema = "lidarcli.changes/1"

    @property
    def title(self) -> str:
        """Subject in a few words."""
        only = len(self.pairs) == 1
        return f"changes from {self.pairs[0].title}" if only else f"changes of {counted(len(self.pairs), 'run')}"

    @property
    def lines(self) -> list[str]:
        """A line for each run."""
        return [one.line for one in self.pairs]

    def sections(self) -> dict[str, Section]:
        """Return the sections by name."""
        pairs = self.pairs
        head = ("from", "to", *CHANGE_STATUSES, "overlap")
        overlaps = ["" if one.overlap is None else percent(one.overlap) for one in pairs]
        rows = [
            (one.before, one.name, *(f"{count:,}" for count in one.counts.values()), overlap)
            for one, overlap in zip(pairs, overlaps, strict=True)
        ]
        sections = {"changed": Section("Changes from run to run", [Table(head, rows, range(2, len(head)))])}
        drawn: list[Block] = []
        for number, one in enumerate(pairs[:DRAWN], 1):
            too_many = len(one.changes) > CHANGES_OF_PAGE
            drawn.append(FromAbove(number, replace(one, changes=one.first(CHANGES_OF_PAGE)) if too_many else one))
            if too_many:
                drawn.append(Notes([(f"{CHANGES_OF_PAGE:,} of {len(one.changes):,} changes are drawn",)]))
        if len(pairs) > DRAWN:
            drawn.append(Notes([(f"and {counted(len(pairs) - DRAWN, 'more run')}",)]))
        sections["changes from above"] = Section("Changes from above", drawn, (PAGE,))
        for name, most, formats in (
            ("changed things", CHANGES, (TEXT, MARKDOWN)),
            ("page of changed things", CHANGES_OF_PAGE, (PAGE,)),
        ):
            blocks: list[Block] = []
            for one in pairs:
                if one.changes:
                    blocks += [Notes([(one.title,)])] if len(pairs) > 1 else []
                    left = len(one.changes) - most
                    more = f"and {left:,} more, all of them in the table of changes" if left > 0 else ""
                    blocks.append(table_of(_cells(one.first(most)), more))
            if blocks:
                sections[name] = Section("Changes by status", blocks, formats, "Changes by status")
        cells = ("from", "to", "dx", "dy", "turn", "rms")
        aligned = []
        for one in pairs:
            if one.dx is not None:
                shift = (in_unit(one.dx, "m", ".2f"), in_unit(one.dy, "m", ".2f"))
                turn = "" if one.dyaw is None else f"{math.degrees(math.remainder(one.dyaw, math.tau)):.1f}°"
                aligned.append((one.before, one.name, *shift, turn, in_unit(one.rms, "m", ".3f")))
        if aligned:
            table = Table(cells, aligned, range(2, len(cells)))
            sections["alignment"] = Section("How the runs lie on each other", [table], fold="Alignment")
        return sections

    def cards(self) -> list[Card]:
        """Return what was moved, is new or gone."""
        counts = {status: self.figures[status] for status in FIRST}
        if None in counts.values():
            return [Card("changes", "not known", "a run is too short for anything to stand in it")]
        words = [f"{status} {count:,.0f}" for status, count in counts.items() if count]
        overlap = self.figures["overlap"]
        words += [] if overlap is None else [f"{percent(overlap)} of the structure in place"]
        total = sum(counts[status] or 0 for status in ("moved", "new", "gone"))
        return [Card("changes", f"{total:,.0f}", ", ".join(words))]

    def as_dict(self) -> dict[str, Any]:
        """Return how the runs lie on each other, and the changes, for JSON."""
        alignment = ("dx", "dy", "dyaw", "overlap", "rms")
        return {
            "alignments": [{"log_a": one.before, "log_b": one.name, **plain_fields(one, *alignment)} for one in self.pairs],
            "changes": [{"log_b": one.name, **plain_fields(each, *COLUMNS)} for one in self.pairs for each in one.changes],
        }


def _cells(changes: Sequence[Change]) -> dict[str, list[str]]:
    """Return heading → cells of a table of changes; empty where one has no such value."""
    return {
        "thing": [str(one.thing) for one in changes],
        "status": [one.status for one in changes],
        "detail": [_detail(one) for one in changes],
        "score": [in_unit(one.score, "", ".2f") for one in changes],
        "size": [
            " x ".join(f"{side:.1f}" for side in sides) + (" m" if sides else "")
            for one in changes
            for sides in [[side for side in (one.length, one.width) if side is not None]]
        ],
        "place": ["" if one.place is None else "({:.1f}, {:.1f})".format(*one.place) for one in changes],
        "kind": [f"{one.kind}, {one.label}" if one.label else one.kind for one in changes],
    }


def _detail(one: Change) -> str:
    """Return by how much a thing was moved and turned, else the reason of the status."""
    if one.status != "moved" or one.moved is None:
        return one.why or ""
    turned = abs(one.turned or 0.0)
    return f"by {one.moved:.2f} m" + (f", {math.degrees(turned):.0f}°" if turned >= SEEN_TURN else "")


def changes_part(tables: Sequence[tuple[str, pa.Table]]) -> ChangesPart:
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
        version, damage = notes.get(VERSION, ""), tuple(map(str, note_value(notes, DAMAGE, list)))
        parameters = note_value(notes, PARAMETERS, dict)
        sources.append(Origin(name, name.rpartition("/")[2], version=version, parameters=parameters, damage=damage))
    values: dict[str, float | None] = {
        status: None if status in unknown else sum(pair.counts[status] for pair in pairs) for status in CHANGE_STATUSES
    }
    values["overlap"] = min((pair.overlap for pair in pairs if pair.overlap is not None), default=None)
    if len(tables) == 1:
        # Those of several pairs of maps have no mean that says anything.
        values |= of_maps
    return ChangesPart(tuple(sources), values, tuple(pairs))
