"""Changes from run to run as a part of a report: their figures, and what tables and pictures show of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from lidarcli.display.texts import counted
from lidarcli.options.choices import CHANGE_STATUSES
from lidarcli.reports.checks import OneRun
from lidarcli.reports.columns import Origin
from lidarcli.reports.document import (
    MARKDOWN,
    PAGE,
    TEXT,
    Block,
    Card,
    FromAbove,
    Notes,
    ReportPart,
    ReportTable,
    Section,
    table_of,
)
from lidarcli.reports.figures import OF_MAPS, plain_fields
from lidarcli.reports.run_pairs import COLUMNS, FIRST, Change, RunPair, number_or_none, pairs_of
from lidarcli.reports.wording import in_unit, percent
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import CHANGE_FIGURES, DAMAGE, PARAMETERS, VERSION

CHANGES, CHANGES_OF_PAGE = 12, 500
"""Most changes of a run that text and Markdown, and the page, show one by one; a page also draws no more."""
DRAWN = 6
"""Most runs that a page draws."""


@dataclass(frozen=True, slots=True)
class ChangesPart(ReportPart):
    """Changes of some tables, as a part of a report."""

    sources: tuple[Origin, ...]
    figures: dict[str, float | None]
    """Every name of `figures.OF_CHANGES` → value; those of `figures.OF_MAPS` where two maps were compared."""
    pairs: tuple[RunPair, ...]
    runs: tuple[OneRun, ...]
    """Several tables, one by one."""
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
        sections = {"changed": Section("Changes from run to run", [ReportTable(head, rows, range(2, len(head)))])}
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
            table = ReportTable(cells, aligned, range(2, len(cells)))
            sections["alignment"] = Section("How the runs lie on each other", [table], fold="Alignment")
        return sections

    def cards(self) -> list[Card]:
        """Return what was moved, is new or gone."""
        counts = {status: self.figures[status] for status in FIRST}
        if None in counts.values():
            return [Card("changes", "not known", "a run is too short for anything to stand in it, or a table")]
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
    """Return by how much an object was moved and turned, else the reason of the status, of drift with its size."""
    if one.status != "moved" or one.moved is None:
        return (one.why or "") if one.moved is None else f"{one.why} of {one.moved:.2f} m"
    turned = math.degrees(abs(one.turned or 0.0))
    # Boxes of the same object, observed from other sides, are turned by up to 5 degrees.
    return f"by {one.moved:.2f} m" + (f", {turned:.0f}°" if turned >= 5.0 else "")


def changes_part(tables: Sequence[tuple[str, pa.Table]]) -> ChangesPart:
    """Return the changes of tables, whose statuses are known, each with its name."""
    pairs: list[RunPair] = []
    sources = []
    unknown: set[str] = set()
    of_maps: dict[str, float | None] = {}
    for name, table in tables:
        notes = notes_of(table)
        figures = note_value(notes, CHANGE_FIGURES, dict)
        # What diff could not count, as of a run too short for anything to be static in it, is not none.
        unknown |= {status for status in CHANGE_STATUSES if status in figures and figures[status] is None}
        of_maps |= {each: number_or_none(figures[each]) for each in OF_MAPS if each in figures}
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
    alone = [*zip(sources, tables, strict=True)] if len(tables) > 1 else []
    runs = tuple(OneRun(source.log, None, changes_part([table]).figures) for source, table in alone)
    return ChangesPart(tuple(sources), values, tuple(pairs), runs)
