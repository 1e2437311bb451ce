"""Zones as sections of a report, and the report on zones alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lidarcli.reports.changes import Changed
from lidarcli.reports.changes_report import change_cards, change_sections
from lidarcli.reports.columns import Origin
from lidarcli.reports.document import MARKDOWN, PAGE, TEXT, Band, Bands, Block, Card, Document, Facts, Notes, Section, Table
from lidarcli.reports.wording import column, counted, number, percent
from lidarcli.reports.zones import Course, Zoned, ZoneEvent, ZoneSummary

EVENTS = 12
"""Most events that text and Markdown show; the page shows all that are kept."""
LOGS = 6
"""Most logs whose courses are drawn."""
WHO = {"A": "agents", "O": "things", "S": "walls"}
"""Set of the points of an event → what was in the zone."""
AREA_CELLS = ("zone", "events", "active", "nearest", "observed", "by")
"""Columns of the table of areas; the first and the last one wrap."""
WAY_CELLS = ("zone", "visits", "dwell", "in", "out", "observed")
"""Columns of the table of visits and crossings."""
EVENT_CELLS = ("zone", "time", "kind", "lasts", "points", "nearest", "ttc", "track", "by", "log")
"""Columns of the table of events."""
NEVER = "never observed"
WORDS = frozenset({"zone", "kind", "by", "log"})
"""Columns that are not flush right."""


ZONE_WORDS = {
    "event": "a stretch of time in which a zone was occupied, or a collision with what is in it was ahead",
    "active": "the time that all events of a zone took",
    "nearest": "the least distance from the sensor to a point in the zone",
    "observed": "the share of the sweeps in which something in the zone could have been found: enough beams reach it",
    "visit, dwell": "the stay of an agent in a zone, and how long it lasts",
    "in, out": "crossings of a line to the left and to the right of the way from its first point to its second",
    "ttc": "time to collision: until the robot meets what is in the zone, at its present speed",
    "by": "what most of the points in the zone were on: agents, other things, walls",
}
"""Word → meaning, of those that a page with zones explains."""


def zone_sections(zoned: Zoned, logs: Sequence[str]) -> Iterator[tuple[str, Section]]:
    """Yield the sections on zones by name; `logs`: names of the sources."""
    cells = [zone_cells(one) for one in zoned.zones]
    areas = [row for row, one in zip(cells, zoned.zones, strict=True) if not one.is_line]
    ways = [row for row in cells if {"visits", "in"} & {*row}]
    blocks: list[Block] = [_table(areas, AREA_CELLS)] if areas else []
    for source, found in [*zoned.courses.items()][:LOGS]:
        title = logs[source] if len(zoned.courses) > 1 else ""
        blocks.append(Bands(title, zoned.seconds[source], [*map(_band, found)]))
    if len(zoned.courses) > LOGS:
        blocks.append(Notes([(f"and {counted(len(zoned.courses) - LOGS, 'more log')}",)]))
    blocks += [_table(ways, WAY_CELLS)] if ways else []
    yield "zones", Section("Zones", blocks)
    for name, most, formats in (("events", EVENTS, (TEXT, MARKDOWN)), ("page of events", len(zoned.events), (PAGE,))):
        if shown := zoned.events[:most]:
            rows = event_cells(shown, several=len(logs) > 1)
            left = zoned.listed - len(shown)
            more = f"and {left:,} more, all of them in the table of events" if left else ""
            title = "Events of zones" + (", the worst first" if zoned.listed > 1 else "")
            yield name, Section(title, [_table(rows, EVENT_CELLS, more)], formats, "Events of zones")


def zone_cells(one: ZoneSummary) -> dict[str, str]:
    """Return heading → cell of a zone in a table; empty where it can have no such value."""
    values = one.figures
    if not values["observed"]:
        return {"zone": one.name, "observed": "0 %", "by": NEVER}
    by = [f"{WHO[name]} {one.by[name]}" for name in WHO if one.by.get(name)]
    cells = {"zone": one.name}
    if not one.is_line:
        cells |= {"events": number(values["events"]), "active": _seconds(one.active), "nearest": _metres(values["nearest"])}
    if one.visits:
        cells |= {"visits": number(one.visits), "dwell": _seconds(values["dwell.mean"])}
    if one.is_line or values["in"] or values["out"]:
        cells |= {name: number(values[name]) for name in ("in", "out")}
    return cells | {"observed": percent(values["observed"]).replace(".0 %", " %"), "by": ", ".join(by)}


def event_cells(events: Sequence[ZoneEvent], several: bool = False) -> list[dict[str, str]]:
    """Return heading → cell of each event in a table, with its log where there are `several`."""
    lasts, ttc = column([one.duration for one in events], " s"), column([one.ttc for one in events], " s")
    return [
        {
            "time": f"{one.t:,.2f} s",
            "zone": one.zone,
            "kind": one.kind,
            "lasts": ("≥ " if one.cut else "") + lasts[k],
            "points": _known(one.points),
            "nearest": _metres(one.nearest),
            "ttc": "" if math.isnan(one.ttc) else ttc[k],
            "track": _known(one.track),
            "by": f"{WHO.get(one.set, '').removesuffix('s')} {one.label}".strip(),
            "log": one.log if several else "",
        }
        for k, one in enumerate(events)
    ]


def _band(one: Course) -> Band:
    return Band(one.zone, "" if one.action == "none" else one.action, one.events, one.visits)


def _table(rows: Sequence[Mapping[str, str]], names: Sequence[str], more: str = "") -> Table:
    """Return a table of cells by heading; columns without a single entry are left out."""
    head = [name for name in names if any(cells.get(name) for cells in rows)]
    right = [k for k, name in enumerate(head) if name not in WORDS]
    return Table(head, [[cells.get(name, "") for name in head] for cells in rows], right, more)


def _seconds(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{number(value)} s"


def _metres(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.2f} m"


def _known(value: float) -> str:
    return "" if math.isnan(value) else number(value)


def zone_cards(zoned: Zoned) -> list[Card]:
    """Return the key figures of zones: events by what the zones ask for."""
    events = sum(int(one.figures["events"] or 0) for one in zoned.zones)
    active = sum(one.active for one in zoned.zones)
    unseen = [one.name for one in zoned.zones if not one.figures["observed"]]
    words = f"in {counted(len(zoned.zones), 'zone')}, active for {_seconds(active)}"
    if unseen:
        words += f"; {NEVER}: {', '.join(unseen)}"
    return [Card("events of zones", number(events), words, meaning=f"event: {ZONE_WORDS['event']}")]


@dataclass(frozen=True, slots=True)
class ZonesReport(Document):
    """A report on zones alone, where there are no tables of objects."""

    zoned: Zoned
    sources: tuple[Origin, ...]
    changed: Changed | None = None

    @property
    def title(self) -> str:
        """Subject of the report in a few words."""
        names = [source.log for source in self.sources]
        return f"zones in {names[0] if len(names) == 1 else counted(len(names), 'log')}"

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Figures of the zones by name, and those of changes."""
        return self.zoned.figures | (self.changed.figures if self.changed else {})

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        words = Section("Words", [Facts([*ZONE_WORDS.items()])], (PAGE,))
        found = dict(zone_sections(self.zoned, [source.log for source in self.sources])) | {"words": words}
        return found if self.changed is None else dict(change_sections(self.changed)) | found

    def cards(self) -> list[Card]:
        """Return the key figures, those of checks last."""
        time = _seconds(sum(self.zoned.seconds.values()))
        of_changes = [] if self.changed is None else change_cards(self.changed)
        return [Card("sweeps", number(self.zoned.sweeps), time), *zone_cards(self.zoned), *of_changes, *self.check_cards()]

    @property
    def lines(self) -> tuple[str, ...]:
        """Number of sweeps, and a line for each zone."""
        time = _seconds(sum(self.zoned.seconds.values()))
        first = f"{self.title}: {counted(self.zoned.sweeps, 'sweep')} in {time}, {counted(len(self.zoned.zones), 'zone')}"
        of_changes = [] if self.changed is None else [one.line for one in self.changed.pairs]
        return (first, *(zone_words(one) for one in self.zoned.zones), *of_changes)


def zone_words(one: ZoneSummary) -> str:
    """Return what happened in a zone in one line."""
    if not one.figures["observed"]:
        return f"{one.name}: {NEVER}"
    cells = zone_cells(one)
    parts = []
    if not one.is_line:
        parts.append(counted(one.figures["events"], "event"))
        parts += [cells["active"]] if one.figures["events"] else []
        parts += [f"nearest {cells['nearest']}"] if cells["nearest"] else []
        parts += [f"by {cells['by']}"] if cells["by"] else []
    parts += [counted(one.visits, "visit")] if one.visits else []
    parts += [f"in {cells['in']}, out {cells['out']}"] if "in" in cells else []
    return f"{one.name}: {', '.join(parts)}"
