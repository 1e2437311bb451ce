"""Changes from run to run as sections of a report, and the report on changes alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lidarcli.choices import CHANGE_STATUSES
from lidarcli.display import counted
from lidarcli.reports.changes import FIRST, Change, Changed, RunPair
from lidarcli.reports.document import MARKDOWN, PAGE, TEXT, Block, Card, Document, FromAbove, Notes, Section, Table
from lidarcli.reports.wording import percent

CHANGES, CHANGES_OF_PAGE = 12, 500
"""Most changes of a run that text and Markdown, and the page, show one by one."""
DRAWN = 6
"""Most runs that a page draws."""
CHANGE_CELLS = ("thing", "status", "detail", "score", "size", "place", "kind")
"""Columns of a table of changes; the last one wraps."""
RIGHT = frozenset({"thing", "score", "size", "place"})
"""Columns that are flush right."""


def change_sections(changed: Changed) -> Iterator[tuple[str, Section]]:
    """Yield the sections on changes by name."""
    pairs = changed.pairs
    head = ("from", "to", *CHANGE_STATUSES, "overlap")
    rows = [(one.before, one.name, *(f"{count:,}" for count in one.counts.values()), _share(one.overlap)) for one in pairs]
    yield "changed", Section("Changes from run to run", [Table(head, rows, range(2, len(head)))])
    drawn = [FromAbove(number, one) for number, one in enumerate(pairs[:DRAWN], 1)]
    left = [Notes([(f"and {counted(len(pairs) - DRAWN, 'more run')}",)])] if len(pairs) > DRAWN else []
    yield "changes from above", Section("Changes from above", [*drawn, *left], (PAGE,))
    for name, most, formats in (
        ("changed things", CHANGES, (TEXT, MARKDOWN)),
        ("page of changed things", CHANGES_OF_PAGE, (PAGE,)),
    ):
        blocks: list[Block] = []
        for one in pairs:
            if one.changes:
                blocks += [Notes([(one.title,)])] if len(pairs) > 1 else []
                blocks.append(_things(one, most))
        if blocks:
            yield name, Section("Changes by status", blocks, formats, "Changes by status")
    cells = ("from", "to", "dx", "dy", "turn", "rms")
    aligned = [
        (one.before, one.name, _metres(one.dx), _metres(one.dy), _degrees(one.dyaw), _metres(one.rms, 3))
        for one in pairs
        if one.dx is not None
    ]
    if aligned:
        table = Table(cells, aligned, range(2, len(cells)))
        yield "alignment", Section("How the runs lie on each other", [table], fold="Alignment")


def _things(pair: RunPair, most: int) -> Table:
    """Return the first `most` changes by status, columns without a single entry left out."""
    ordered = sorted(pair.changes, key=lambda one: (FIRST.index(one.status), one.thing))
    rows = [change_cells(one) for one in ordered[:most]]
    head = [name for name in CHANGE_CELLS if any(cells[name] for cells in rows)]
    left = len(ordered) - most
    more = f"and {left:,} more, all of them in the table of changes" if left > 0 else ""
    right = [k for k, name in enumerate(head) if name in RIGHT]
    return Table(head, [[cells[name] for name in head] for cells in rows], right, more)


def change_cells(one: Change) -> dict[str, str]:
    """Return heading → cell of a change in a table; empty where it has no such value."""
    detail = one.why or ""
    if one.status == "moved" and one.moved is not None:
        detail = f"by {one.moved:.2f} m"
        # Less than that is what boxes seen from other sides turn by.
        if one.turned is not None and abs(one.turned) >= math.radians(5.0):
            detail += f", {abs(math.degrees(one.turned)):.0f}°"
    place = one.place
    return {
        "thing": str(one.thing),
        "status": one.status,
        "detail": detail,
        "score": "" if one.score is None else f"{one.score:.2f}",
        "size": " x ".join(f"{side:.1f}" for side in (one.length, one.width) if side is not None)
        + (" m" if one.length is not None or one.width is not None else ""),
        "place": "" if place is None else f"({place[0]:.1f}, {place[1]:.1f})",
        "kind": f"{one.kind}, {one.label}" if one.label else one.kind,
    }


def _share(value: float | None) -> str:
    return "" if value is None else percent(value)


def _metres(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{value:.{digits}f} m"


def _degrees(value: float | None) -> str:
    return "" if value is None else f"{math.degrees(math.remainder(value, math.tau)):.1f}°"


def change_cards(changed: Changed) -> list[Card]:
    """Return the key figure of changes: what was moved, is new or gone."""
    figures = changed.figures
    counts = {status: figures[status] for status in FIRST}
    if None in counts.values():
        return [Card("changes", "not known", "a run is too short for anything to stand in it")]
    told = [f"{status} {count:,.0f}" for status, count in counts.items() if count]
    overlap = figures["overlap"]
    told += [] if overlap is None else [f"{percent(overlap)} of the structure in place"]
    total = sum(count or 0 for status, count in counts.items() if status in ("moved", "new", "gone"))
    return [Card("changes", f"{total:,.0f}", ", ".join(told))]


@dataclass(frozen=True, slots=True)
class ChangesReport(Document):
    """A report on changes alone, where there are no tables of objects."""

    changed: Changed

    @property
    def title(self) -> str:
        """Subject of the report in a few words."""
        pairs = self.changed.pairs
        return f"changes from {pairs[0].title}" if len(pairs) == 1 else f"changes of {counted(len(pairs), 'run')}"

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Figures of the changes by name."""
        return self.changed.figures

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        return dict(change_sections(self.changed))

    def cards(self) -> list[Card]:
        """Return the key figures, those of checks last."""
        return [*change_cards(self.changed), *self.check_cards()]

    @property
    def lines(self) -> tuple[str, ...]:
        """A line for each run."""
        return tuple(one.line for one in self.changed.pairs)
