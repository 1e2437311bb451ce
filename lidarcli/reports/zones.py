"""Zones as a part of a report: their figures, checks of them, and what tables and bands show of their events."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.display.palette import ZONE_COLOURS
from lidarcli.display.texts import moment, times_of_day
from lidarcli.errors import OptionError
from lidarcli.options.times import TimeZone
from lidarcli.reports.checks import Check, OneRun, accepts, parse_check
from lidarcli.reports.columns import Observation, Origin, Record, Rows, ZoneRows, least_observed, missing_of
from lidarcli.reports.document import (
    MARKDOWN,
    PAGE,
    TEXT,
    Band,
    Bands,
    Block,
    Card,
    Notes,
    Opening,
    ReportPart,
    Section,
    table_of,
)
from lidarcli.reports.figures import STATISTICS, ZONES, Spread, plain_fields, plain_number, zone_of
from lidarcli.reports.people import People, people_cells, people_in
from lidarcli.reports.wording import NONE, column, counted, in_unit, number, percent
from lidarcli.sweeps.masks import Circle
from lidarcli.sweeps.types import Bool, Float64, Int64
from lidarcli.sweeps.zone import SENSOR, WORLD, outline
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import PARAMETERS

_ZONE_NAMED = re.compile(r"\bzone\s*([=!])=\s*([\w-]+)")
"""A zone that the condition of a check names, and whether it is the one or any other."""
OF_AREAS = ("events", "share", "nearest", "points.max", "ttc.min", "duration.")
"""Figures that a line has not: nothing occupies it."""
OF_LINES = ("in", "out")
"""Figures that an area has not: it is entered from all sides."""
NUMBERS = ("points", "nearest", "ttc", "active", "agents", "observed")
"""Columns of the table of zones that figures are of."""
KEPT = 100
"""Most events that are kept one by one."""
KINDS = ("occupied", "approach"), ("visit", "crossing"), ("stale",)
"""Kinds of the events of a zone that its timeline shows apart."""
LISTED = ("occupied", "approach", "stale", "nav2", "stop")
"""Kinds of the events that are listed; visits and crossings are counted."""
EVENT = (
    *("topic", "zone", "kind", "action", "first_sweep", "t", "duration", "cut", "points", "nearest", "ttc"),
    *("set", "track", "label"),
)
"""Columns of the events that are listed."""
RANKED = (*ZONE_COLOURS,)
"""Actions, the most severe first."""
EVENTS = 12
"""Most events that text and Markdown show; the page shows all that are kept."""
LOGS = 6
"""Most logs whose timelines are drawn."""
WHO = {"A": "agents", "O": "objects", "S": "walls"}
"""Set of the points of an event → what was in the zone."""
AREA_CELLS = ("zone", "events", "active", "nearest", "observed", "by")
"""Columns of the table of areas; the first and the last one wrap."""
ENTRY_CELLS = ("zone", "visits", "dwell", "in", "out", "observed")
"""Columns of the table of visits and crossings."""
NEVER = "never observed"
ZONE_WORDS = {
    "event": "a stretch of time in which a zone was occupied, or a collision with what is in it was ahead",
    "active": "the time that all events of a zone took",
    "nearest": "the least distance from the sensor to a point in the zone",
    "observed": "the share of the sweeps in which something in the zone could have been found: enough beams reach it",
    "visit, dwell": "the stay of an agent in a zone, and how long it is seen there",
    "in, out": "crossings of a line to the left and to the right of the way from its first point to its second",
    "stale": "no sweep of a topic for longer than its zone allows: Nav2 stops the robot then (invalid source); hatched",
    "Nav2": "what Nav2's Collision Monitor did, as the log tells",
    "robot stands": "the robot stood still",
    "ttc": "time to collision: until the robot meets what is in the zone, at its present speed",
    "by": "what most of the points in the zone were on: agents, other things, walls",
}
"""Word → meaning, of those that a page with zones explains."""


def zones_in(read: Mapping[int, Sequence[pa.Table]]) -> ZoneRows:
    """Return the zones in the tables of some sources, with their outlines as far as the metadata has them."""
    shapes: dict[str, dict[str, Any]] = {}
    left_out: list[tuple[str, str]] = []
    for source, (_, zones, *_) in read.items():
        rows = Rows.join([zones])
        judged, log = {*rows.counts("zone")}, next(iter(rows.counts("log")), str(source))
        declared = note_value(notes_of(zones), PARAMETERS, dict).get("zones")
        for one in declared if isinstance(declared, list) else ():
            if isinstance(one, dict) and isinstance(one.get("name"), str):
                shapes.setdefault(one["name"], one)
                left_out += [(log, one["name"])] if one["name"] not in judged else []
    events, zones = (Rows.join([one[k] for one in read.values()], [*read]) for k in (0, 1))
    counted_in = [source for source, one in read.items() if len(one) > 2 and one[2] is not None]
    counts = Rows.join([read[source][2] for source in counted_in], counted_in) if counted_in else None
    return ZoneRows(events, zones, shapes, tuple(left_out), counts)


def figures_of(zone_rows: ZoneRows) -> dict[str, float | None]:
    """Return the figures `zones.NAME.X`, summed over logs: every name of `figures.zone_names` of each zone → value.

    It is None where there is nothing to measure. A zone that was never observed has `observed` alone.
    """
    columns = {name: zone_rows.zones.numbers(name) for name in NUMBERS}
    zones = {name: _values(zone_rows, name, columns) for name in zone_rows.names}
    return {f"{ZONES}{zone}.{name}": value for zone, values in zones.items() for name, value in values.items()}


def of_zone(rows: Rows, zone: str, *kinds: str) -> Bool:
    """Return (K,) the rows of a zone; of events those of some kinds."""
    chosen = rows.are("zone", zone)
    if kinds:
        chosen = chosen & np.any([rows.are("kind", kind) for kind in kinds], axis=0)
    return chosen


def _values(zone_rows: ZoneRows, zone: str, columns: Mapping[str, Float64]) -> dict[str, float | None]:
    """Return the figures of a zone without the beginning of their names; `columns`: `NUMBERS` of the rows of all zones."""
    events, own, shape = zone_rows.events, of_zone(zone_rows.zones, zone), zone_rows.shapes.get(zone)
    of = {name: Spread.of(values[own]) for name, values in columns.items()}
    agents, observed = of["agents"], min((one.share for one in sights_of(zone_rows, zone)), default=0.0)
    alarms, visits = of_zone(events, zone, "occupied", "approach"), of_zone(events, zone, "visit")
    crossings, duration = of_zone(events, zone, "crossing"), events.numbers("duration")
    seen = duration - np.nan_to_num(events.numbers("hidden"))
    values: dict[str, float | None] = {
        "events": int(alarms.sum()),
        "share": of["active"].mean,
        "nearest": of["nearest"].min,
        "points.max": of["points"].max,
        "ttc.min": of["ttc"].min,
        # Without tracks nobody knows who went across.
        **{name: int((crossings & events.are("direction", name)).sum()) if agents.count else None for name in OF_LINES},
        "observed": observed,
    }
    spreads = {"duration": Spread.of(duration[alarms]), "agents_at_once": agents, "dwell": Spread.of(seen[visits])}
    for name, spread in spreads.items():
        values |= {f"{name}.{statistic}": getattr(spread, statistic) for statistic in STATISTICS}
    if not observed:
        return dict.fromkeys(values) | {"observed": 0.0}
    missing = () if shape is None else OF_AREAS if "line" in shape else OF_LINES
    return {name: None if name.startswith(missing) else value for name, value in values.items()}


def sights_of(zone_rows: ZoneRows, zone: str) -> list[Observation]:
    """Return how a zone was observed in each log that has it; sweeps that are missing for longer than `UNSEEN` count, too.

    They are missing where no sensor has any; in the frame of the sensor, where one of them has none.
    """
    rows, mine = zone_rows.zones, np.flatnonzero(of_zone(zone_rows.zones, zone))
    (log, logs), (topic, _), observed, stamp = (
        *map(rows.words, ("log", "topic")),
        rows.numbers("observed"),
        rows.integers("stamp"),
    )
    key = rows.source.astype(np.int64) * max(len(logs), 1) + log
    apart = topic * (zone_rows.shapes.get(zone, {}).get("frame") == SENSOR)
    mine = mine[np.lexsort((stamp[mine], key[mine]))]
    found = [Observation(name, 0, 1) for name, left_out in zone_rows.left_out if left_out == zone]
    for some in np.split(mine, np.flatnonzero(np.diff(key[mine])) + 1) if len(mine) else ():
        ends = stamp[some[[0, -1]]]
        own = [stamp[some[apart[some] == one]] for one in np.unique(apart[some])]
        missing = sum(missing_of(np.unique(each), ends) for each in own)
        found.append(Observation(logs[log[some[0]]], int(observed[some].sum()), len(some) + missing))
    return found


def unobserved(checks: Sequence[Check], zone_rows: ZoneRows) -> tuple[str, ...]:
    """Return a line for each zone of checks that was not observed all the time, unless one says how much is enough."""
    wanted: dict[str, None] = {}
    for check in checks:
        if check.condition is not None and check.name == "events":
            named = _ZONE_NAMED.findall(check.expression)
            is_any = not named or any(sign == "!" for sign, _ in named)
            every = [*zone_rows.names, *(name for _, name in zone_rows.left_out)]
            wanted |= dict.fromkeys(every if is_any else [name for _, name in named])
        elif (of := zone_of(check.name)) is not None:
            wanted[of[0]] = None
    lines = []
    for name in wanted:
        least = least_observed(sights_of(zone_rows, name))
        if least is None or accepts(checks, f"{ZONES}{name}.observed"):
            continue
        if not least.observed:
            lines.append(f"{least.log}: zone {name} was never observed")
            continue
        lines.append(
            f"{least.log}: zone {name} was observed in {least.observed:,} of {least.sweeps:,} sweeps; "
            f"--check '{ZONES}{name}.observed >= {floored(least.share)}' accepts that"
        )
    return tuple(lines)


def floored(share: float) -> str:
    """Return a share with three decimals, not above it.

    >>> floored(0.31279), floored(0.5), floored(0.99996)
    ('0.312', '0.5', '0.999')
    """
    return f"{np.floor(1000 * share) / 1000:g}"


def parse_zone_check(expression: str, zones: Collection[str], others: Collection[str] = ()) -> Check:
    """Understand a check of zones alone: their figures, rows of events, and `others`.

    Raises
    ------
    OptionError
        Bad syntax, or a figure or zone that does not exist; the message names what is near.

    >>> parse_zone_check("zones.left-door.in between 30 and 34", ["left-door"]).expected
    'between 30 and 34'
    """
    check = parse_check(expression, only=others, rows=("events",), zones=zones)
    for _, name in _ZONE_NAMED.findall(expression) if check.condition is not None else ():
        if name not in zones:
            raise OptionError(f"--check '{expression}': no zone '{name}'; there is {', '.join(zones)}")
    return check


def by_words(by: Mapping[str, int]) -> str:
    """Return how many events each set caused, in words: `1 by agents, 2 by other objects`."""
    words = WHO | {"O": "other objects"}
    return ", ".join(f"{by[letter]} by {words[letter]}" for letter in WHO if by.get(letter))


def zones_alone(log: str, tables: Sequence[pa.Table], checks: Sequence[Check], damage: int = 0) -> OneRun:
    """Return the zones of one of several logs."""
    rows = zones_in({0: tables})
    return OneRun.of(log, rows.zones.integers("stamp"), {**figures_of(rows), "damage": damage}, rows, checks)


@dataclass(frozen=True, slots=True)
class ZoneFigures:
    """A zone and what happened in it."""

    name: str
    action: str
    """Action it asks for; empty where neither an event nor the metadata has it."""
    is_line: bool
    figures: dict[str, float | None]
    """By the rest of their names: `events`."""
    active: float
    """Time that its events took [s]."""
    by: dict[str, int]
    """Set → events in which most of the points were of that set."""
    visits: int

    def cells(self) -> dict[str, str]:
        """Return heading → cell of a table; empty where it can have no such value."""
        values = self.figures
        if not values["observed"]:
            return {"zone": self.name, "observed": "0 %", "by": NEVER}
        cells = {"zone": self.name}
        if not self.is_line:
            cells |= {"events": number(values["events"]), "active": in_unit(self.active, "s")}
            cells["nearest"] = in_unit(values["nearest"], "m", ".2f")
        if self.visits:
            cells |= {"visits": number(self.visits), "dwell": in_unit(values["dwell.mean"], "s")}
        if self.is_line or values["in"] or values["out"]:
            cells |= {name: number(values[name]) for name in ("in", "out")}
        return cells | {"observed": percent(values["observed"]).replace(".0 %", " %"), "by": by_words(self.by)}

    @property
    def line(self) -> str:
        """Events in it."""
        if not self.figures["observed"]:
            return f"{self.name}: {NEVER}"
        cells, parts = self.cells(), []
        if not self.is_line:
            parts.append(counted(self.figures["events"], "event"))
            parts += [cells["active"]] if self.figures["events"] else []
            parts += [f"nearest {cells['nearest']}"] if cells["nearest"] else []
            parts += [cells["by"]] if cells["by"] else []
        parts += [counted(self.visits, "visit")] if self.visits else []
        parts += [f"in {cells['in']}, out {cells['out']}"] if "in" in cells else []
        return f"{self.name}: {', '.join(parts)}"


@dataclass(frozen=True, slots=True)
class ZoneTimeline:
    """Stretches in which events of a zone went on, in shares of the time of a log."""

    zone: str
    action: str
    events: tuple[tuple[float, float], ...]
    visits: tuple[tuple[float, float], ...]
    """Visits, and crossings of a line, which take no time."""
    stale: tuple[tuple[float, float], ...]
    """Times without sweeps of its topics."""
    frame: str
    """`sensor` or `world`, where that is the frame of its outline, which is in the metadata."""
    outline: tuple[tuple[float, float], ...]
    """Corners [m], of a line its two ends; empty where they are not known, or in another frame."""

    @property
    def band(self) -> Band:
        """The stretches as a band of a document."""
        word = "" if self.action == "none" else self.action
        return Band(self.zone, word, [(word, self.events), ("stale", self.stale)], self.visits)


@dataclass(frozen=True, slots=True)
class ZonesPart(ReportPart):
    """The zones of a run, as a part of a report."""

    sources: tuple[Origin, ...]
    figures: dict[str, float | None]
    """Every name of `figures.zone_names` of each zone → value."""
    zones: tuple[ZoneFigures, ...]
    events: list[Record]
    """Log and `EVENT` of each, the most severe first, at most `KEPT`; those of kinds that are `LISTED`."""
    listed: int
    """Number of all events of these kinds."""
    sweeps: int
    starts_ns: dict[int, int]
    """Source → its first stamp [ns]."""
    seconds: dict[int, float]
    """Source → time from its first stamp to its last one [s]."""
    timelines: dict[int, tuple[ZoneTimeline, ...]]
    """Source → timeline of each of its zones."""
    others: dict[int, list[Band]]
    """Source → what Nav2 did, and when the robot stood still, where the events tell."""
    time_zone: TimeZone
    """Time zone of what people read."""
    people: People
    """Where lines have tables of counts."""
    schema = "lidarcli.zones/1"
    words = ZONE_WORDS

    @property
    def title(self) -> str:
        """Subject in a few words."""
        return f"zones in {self.sources[0].log if len(self.sources) == 1 else counted(len(self.sources), 'log')}"

    @property
    def lines(self) -> list[str]:
        """A line for each zone."""
        return [one.line for one in self.zones]

    @property
    def opening(self) -> Opening:
        """Number of sweeps, as a report on zones alone begins."""
        time = in_unit(sum(self.seconds.values()), "s")
        since = f" from {moment(min(self.starts_ns.values()), self.time_zone)}" if self.starts_ns else ""
        line = f"{self.title}: {counted(self.sweeps, 'sweep')} in {time}{since}, {counted(len(self.zones), 'zone')}"
        return Opening([Card("sweeps", number(self.sweeps), f"{time}{since}")], [line], {"sweeps": self.sweeps})

    def sections(self) -> dict[str, Section]:
        """Return the sections by name."""
        logs = [source.log for source in self.sources]
        rows = [one.cells() for one in self.zones]
        areas = [row for row, one in zip(rows, self.zones, strict=True) if not one.is_line]
        entered = [row for row in rows if {"visits", "in"} & {*row}]
        areas_table, entries_table = (
            table_of({name: [row.get(name, "") for row in some] for name in names})
            for some, names in ((areas, AREA_CELLS), (entered, ENTRY_CELLS))
        )
        blocks: list[Block] = [areas_table] if areas else []
        for source, found in [*self.timelines.items()][:LOGS]:
            bands = [*(one.band for one in found), *self.others[source]]
            title = logs[source] if len(self.timelines) > 1 else ""
            blocks.append(Bands(title, self.seconds[source], bands, self.starts_ns[source], self.time_zone))
        if len(self.timelines) > LOGS:
            blocks.append(Notes([(f"and {counted(len(self.timelines) - LOGS, 'more log')}",)]))
        blocks += [entries_table] if entered else []
        sections = {"zones": Section("Zones", blocks)}
        if self.people:
            title = "People through lines: what moves by itself, each person once; true numbers lie in brackets"
            sections["people"] = Section(
                title, [table_of(people_cells(self.people, self.time_zone, several=len(logs) > 1))]
            )
        title = "Events of zones" + (", the worst first" if self.listed > 1 else "")
        for name, most, formats in (("events", EVENTS, (TEXT, MARKDOWN)), ("page of events", KEPT, (PAGE,))):
            if shown := self.events[:most]:
                left = self.listed - len(shown)
                more = f"and {left:,} more, all of them in the table of events" if left else ""
                table = table_of(_event_cells(shown, self.time_zone, several=len(logs) > 1), more)
                sections[name] = Section(title, [table], formats, "Events of zones")
        return sections

    def cards(self) -> list[Card]:
        """Return the number of events, and which zones were never observed."""
        events = sum(int(one.figures["events"] or 0) for one in self.zones)
        words = f"in {counted(len(self.zones), 'zone')}, active for {in_unit(sum(one.active for one in self.zones), 's')}"
        if unseen := [one.name for one in self.zones if not one.figures["observed"]]:
            words += f"; {NEVER}: {', '.join(unseen)}"
        return [Card("events of zones", number(events), words, meaning=f"event: {self.words['event']}")]

    def as_dict(self) -> dict[str, Any]:
        """Return the zones and the events to look at first, for JSON."""
        return {
            "zones": [
                {**plain_fields(one, "name", "action"), "line": one.is_line, **plain_fields(one, "active", "by", "visits")}
                for one in self.zones
            ],
            "events": [
                {
                    **plain_fields(one, "log", "topic", "zone", "kind", "action"),
                    "sweep": one.first_sweep,
                    **plain_fields(one, "t", "duration"),
                    "cut": bool(one.cut),
                    **plain_fields(one, "points", "nearest", "ttc"),
                    "set": one.set or None,
                    "track": plain_number(one.track),
                    "label": one.label or None,
                }
                for one in self.events
            ],
        }


def zones_part(zone_rows: ZoneRows, sources: Sequence[Origin], time_zone: TimeZone = UTC) -> ZonesPart:
    """Sum up the zones of sources."""
    figures, events = figures_of(zone_rows), zone_rows.events
    # Of each zone by the metadata, or else by its events.
    own = np.flatnonzero(~(events.are("kind", "nav2") | events.are("kind", "stop")))
    actions = dict(zip(*(events.texts(name, own) for name in ("zone", "action")), strict=True))
    actions |= {name: str(shape["action"]) for name, shape in zone_rows.shapes.items() if "action" in shape}
    duration = events.numbers("duration")
    found = []
    for name in zone_rows.names:
        alarms, start = of_zone(events, name, "occupied", "approach"), f"{ZONES}{name}."
        found.append(
            ZoneFigures(
                name=name,
                action=actions.get(name, ""),
                is_line=name in zone_rows.lines,
                figures={full.removeprefix(start): value for full, value in figures.items() if full.startswith(start)},
                active=float(duration[alarms].sum()),
                by=events.counts("set", alarms),
                visits=int(of_zone(events, name, "visit").sum()),
            )
        )
    stamp = zone_rows.zones.integers("stamp")
    present, begin = np.unique(zone_rows.zones.source, return_index=True)
    # Rows of a source follow each other.
    parts = zip(present.tolist(), np.split(stamp, begin[1:]), strict=False)
    spans = {source: (int(own.min()), int(own.max())) for source, own in parts}
    listed = np.flatnonzero(np.any([events.are("kind", kind) for kind in LISTED], axis=0))
    return ZonesPart(
        sources=tuple(sources),
        figures=figures,
        zones=tuple(found),
        events=_most_severe(events, listed, [source.log for source in sources]),
        listed=len(listed),
        sweeps=_sweeps(zone_rows.zones),
        starts_ns={source: first for source, (first, _) in spans.items()},
        seconds={source: (last - first) * 1e-9 for source, (first, last) in spans.items()},
        timelines={source: tuple(_timelines(zone_rows, source, span, actions)) for source, span in spans.items()},
        others={source: [*_others(events, source, span)] for source, span in spans.items()},
        time_zone=time_zone,
        people=people_in(zone_rows.counts, [source.log for source in sources]),
    )


def _sweeps(rows: Rows) -> int:
    """Return the number of sweeps: of each source and topic, the rows of the zone that has most of them."""
    (topic, topics), (zone, zones) = rows.words("topic"), rows.words("zone")
    stream = rows.source.astype(np.int64) * max(len(topics), 1) + topic
    size = max(len(zones), 1)
    counts = np.bincount(stream * size + zone)
    return int(np.pad(counts, (0, -len(counts) % size)).reshape(-1, size).max(axis=1, initial=0).sum())


def _most_severe(rows: Rows, listed: Int64, logs: Sequence[str]) -> list[Record]:
    """Return the events to look at first: by action, then the nearest, then the longest."""
    action = np.array([RANKED.index(word) if word in RANKED else len(RANKED) for word in rows.texts("action")])
    nearest, longest = np.nan_to_num(rows.numbers("nearest"), nan=np.inf), -rows.numbers("duration")
    keys = (longest, nearest, action)
    order = listed[np.lexsort([key[listed] for key in keys])][:KEPT]
    start = rows.integers("start")[order].tolist()
    return rows.records(order, EVENT, log=[logs[source] for source in rows.source[order]], start=start)


def _timelines(
    zone_rows: ZoneRows, source: int, span: tuple[int, int], actions: Mapping[str, str]
) -> Iterator[ZoneTimeline]:
    """Yield the timeline of each zone in a source."""
    events, rows = zone_rows.events, zone_rows.zones
    begin, end = _shares(events, span)
    here = events.source == source
    for name in zone_rows.names:
        if not (of_zone(rows, name) & (rows.source == source)).any():
            continue
        chosen = (here & of_zone(events, name, *kinds) for kinds in KINDS)
        alarms, entries, stale = (_merged(begin[own], end[own]) for own in chosen)
        shape = zone_rows.shapes.get(name, {})
        corners = _corners(shape)
        frame = str(shape["frame"]) if corners else ""
        yield ZoneTimeline(name, actions.get(name, ""), alarms, entries, stale, frame, corners)


def _shares(events: Rows, span: tuple[int, int]) -> tuple[Float64, Float64]:
    """Return (K,) begin and end of events in shares of the time of a log."""
    first, last = span
    begin, end = (np.clip((events.integers(name) - first) / max(last - first, 1), 0.0, 1.0) for name in ("start", "end"))
    return begin, end


def _others(events: Rows, source: int, span: tuple[int, int]) -> Iterator[Band]:
    """Yield a band of what Nav2 did in a source, and one of when the robot stood still, where the events tell."""
    begin, end = _shares(events, span)
    here = events.source == source
    did, stood = (here & events.are("kind", kind) for kind in ("nav2", "stop"))
    if did.any():
        own = ((action, did & events.are("action", action)) for action in RANKED)
        yield Band("Nav2", "", [(action, _merged(begin[some], end[some])) for action, some in own if some.any()])
    if stood.any():
        yield Band("robot stands", "", [("still", _merged(begin[stood], end[stood]))])


def _corners(shape: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """Return the outline of a zone of the sensor or the world; nothing where the metadata has none that can be drawn."""
    if shape.get("frame") not in (SENSOR, WORLD):
        return ()
    circle = shape.get("circle")
    try:
        if isinstance(circle, Mapping):
            points = outline(Circle(*(float(circle[name]) for name in ("x", "y", "radius"))))
        else:
            points = np.array(shape.get("polygon", shape.get("line")), np.float64)
    except (KeyError, TypeError, ValueError):
        return ()
    known = points.ndim == 2 and points.shape[1] == 2 and len(points) <= 1_000
    return tuple((x, y) for x, y in points.tolist()) if known and np.isfinite(points).all() else ()


def _merged(begin: Float64, end: Float64) -> tuple[tuple[float, float], ...]:
    """Return spans in order, those that no picture could show apart as one."""
    found: list[tuple[float, float]] = []
    for low, high in sorted(zip(begin.tolist(), end.tolist(), strict=True)):
        if found and low - found[-1][1] < 0.001:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return tuple(found)


def _event_cells(events: Sequence[Any], zone: TimeZone, several: bool = False) -> dict[str, list[str]]:
    """Return heading → cells of events in a table, with their logs where there are `several`."""
    head, clocks = times_of_day([one.start for one in events], zone)
    lasts, ttc = column([one.duration for one in events], " s"), column([one.ttc for one in events], " s")
    return {
        "zone": [one.zone for one in events],
        "time": [f"{one.t:,.1f} s" for one in events],
        head: clocks,
        "kind": [one.kind for one in events],
        "lasts": [("≥ " if one.cut else "") + words for one, words in zip(events, lasts, strict=True)],
        "points": [in_unit(one.points) for one in events],
        "nearest": [in_unit(one.nearest, "m", ".2f") for one in events],
        "ttc": ["" if words == NONE else words for words in ttc],
        "track": [in_unit(one.track) for one in events],
        "by": [
            {"stale": one.topic, "nav2": one.action}.get(
                one.kind, f"{WHO.get(one.set, '').removesuffix('s')} {one.label}".strip()
            )
            for one in events
        ],
        "log": [one.log if several else "" for one in events],
    }
