"""Tables of the zones of a log, and its lines for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.display.texts import column_of_times, time_of_day, times
from lidarcli.formalism.counting import in_all
from lidarcli.options.times import TimeZone
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.zones.events import STALE, ZoneEvents
from lidarcli.pipeline.zones.intervals import counts_of
from lidarcli.pipeline.zones.intervals import lines_of as people_lines
from lidarcli.pipeline.zones.monitor import Act, lines_of, missed_stops, rows_of
from lidarcli.pipeline.zones.options import TABLES
from lidarcli.pipeline.zones.stops import stop_lines
from lidarcli.reports.figures import plain_number
from lidarcli.reports.wording import counted
from lidarcli.reports.zones import NEVER, WHO, by_words, figures_of, zones_in
from lidarcli.sweeps.zone import Line
from lidarcli.tabular.columns import FORMS, answers, codes, constant
from lidarcli.tabular.schemas import DIRECTIONS, EVENT_KINDS, SCHEMAS


class ZoneTables(NamedTuple):
    """Tables that `zones` returns, with the schemas of `lidarcli.tabular.SCHEMAS`."""

    events: pa.Table
    """One row per event."""
    zones: pa.Table
    """One row per sweep and zone."""


class CountedTables(NamedTuple):
    """Tables that `zones` returns where `every` is an interval of time."""

    events: pa.Table
    zones: pa.Table
    """As of `ZoneTables`."""
    counts: pa.Table
    """One row per line, interval and direction."""


@dataclass(slots=True)
class ZoneSummary(RunSummary):
    """The counts of one run over one log, and its zones."""

    tables: ZoneTables | CountedTables = field(
        default_factory=lambda: ZoneTables(*(SCHEMAS[name].empty_table() for name in TABLES))
    )
    lines: list[tuple[str, str]] = field(default_factory=list)
    """Head and words for each zone, and of what Nav2 did."""
    worst: list[tuple[str, str]] = field(default_factory=list)
    """Those of the worst events."""
    look: tuple[str, float] | None = None
    """Topic and time [s] of the sweep that shows the worst event."""
    acts: Sequence[Act] = ()
    events: Sequence[dict[str, Any]] = ()
    """Rows of the table of events."""
    answers: Sequence[Sequence[str]] = ()
    """Sentences of `--explain` on each of its times."""
    counts: list[dict[str, Any]] = field(default_factory=list)
    """Crossings of each line in all, by direction, where there are intervals."""

    @classmethod
    def of(
        cls,
        found: RunSummary,
        log: str,
        by_zone: Sequence[ZoneEvents],
        acts: Sequence[Act],
        stops: Sequence[dict[str, Any]] | None,
        metadata: dict[bytes, bytes],
        interval_ns: int = 0,
    ) -> ZoneSummary:
        """Return what was found in the zones of a log; people are counted by intervals.

        `acts` are those of Nav2 in it, `stops` those of the robot.
        """
        summary = cls(**{name: getattr(found, name) for name in RunSummary.__dataclass_fields__})
        events = [event for each in by_zone for event in each.events]
        summary.events = [*events, *rows_of(acts, by_zone, found.first_ns or 0), *(stops or ())]
        summary.tables = _tables(log, summary.events, by_zone, metadata)
        names = _names(by_zone)
        longest = max(map(len, names))
        summary.lines = [(f"  {name:<{longest}}  ", _words(each)) for name, each in zip(names, by_zone, strict=True)]
        if interval_ns:
            rows = {name: counts_of(each, interval_ns) for name, each in zip(names, by_zone, strict=True)}
            rows = {name: some for name, some in rows.items() if some}
            summary.lines += people_lines(rows, summary.time_zone)
            counts = [row | {"log": log} for some in rows.values() for row in some]
            table = _table_of("counts", counts).replace_schema_metadata(metadata)
            summary.tables = CountedTables(*summary.tables, table)
            summary.counts = [in_all(some[way::2]) for some in rows.values() for way in range(2)]
        worst = _worst_first(by_zone)
        summary.look = worst[0]["look"] if worst else None
        summary.worst = _worst_lines(worst, summary.time_zone)
        summary.acts = [*acts, *(missed_stops(acts, by_zone) if acts else [])]
        summary.lines += lines_of(summary.acts, summary.first_ns or 0, summary.time_zone)
        summary.lines += [] if stops is None else stop_lines(stops, summary.time_zone)
        return summary

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values, with what a check may name."""
        figures = figures_of(zones_in({0: self.tables}))
        own = {
            "figures": {name: plain_number(figures[name]) for name in figures},
            **({"counts": self.counts} if self.counts else {}),
            "nav2": [act._asdict() for act in self.acts],
        }
        return RunSummary.as_dict(self) | own


def _tables(
    log: str, events: Sequence[dict[str, Any]], by_zone: Sequence[ZoneEvents], metadata: dict[bytes, bytes]
) -> ZoneTables:
    """Return the tables of a log."""
    order = sorted(range(len(events)), key=lambda at: (events[at]["start"], at))
    rows = [events[at] | {"log": log, "event": number} for number, at in enumerate(order, 1)]
    found = _table_of("events", rows)
    pieces = [_zone_rows(log, each) for each in by_zone]
    zones = pa.Table.from_batches(pieces, SCHEMAS["zones"]).unify_dictionaries()
    if zones.num_rows:
        # By topic and sweep; zones of one sweep in the order of the file.
        topics = np.concatenate([np.array([one.topic for one in each.topics])[each.topic] for each in by_zone])
        zones = zones.take(pa.array(np.lexsort((np.asarray(zones["sweep"]), topics))))
    return ZoneTables(*(table.replace_schema_metadata(metadata) for table in (found, zones)))


def _table_of(name: str, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    schema = SCHEMAS[name]
    return pa.table([pa.array([row.get(one.name) for row in rows], one.type) for one in schema], schema)


def _zone_rows(log: str, one: ZoneEvents) -> pa.RecordBatch:
    count = len(one.topic)
    columns: dict[str, Any] = {
        "log": constant(log, count),
        "topic": codes(one.topic.astype(np.int32), tuple(each.topic for each in one.topics)),
        "zone": constant(one.zone.name, count),
    }
    columns |= {name: values for name, values in one.columns.items() if values is not None}
    columns |= {name: answers(columns[name].astype(np.int8)) for name in ("active", "observed")}
    return FORMS["zones"].fill(columns, None, count)


def _names(by_zone: Sequence[ZoneEvents]) -> list[str]:
    """Return a name for each zone, with its topic, or also its frame, where several sensors have one of their own."""
    several = len({each.topics[0].run for each in by_zone}) > 1
    plain = [f"{each.zone.name}, run {each.topics[0].run}" if several else each.zone.name for each in by_zone]
    names = [
        name if plain.count(name) == 1 else f"{name} ({each.topics[0].topic})"
        for name, each in zip(plain, by_zone, strict=True)
    ]
    return [
        name if names.count(name) == 1 else f"{name} ({each.topics[0].frame_id})"
        for name, each in zip(names, by_zone, strict=True)
    ]


def _words(one: ZoneEvents) -> str:
    """Return what was in a zone, for people."""
    zone, events = one.zone, one.events
    columns = one.columns
    observed = columns["observed"]
    assert observed is not None
    if not one.in_force:
        return "none of its polygons covers the velocity"
    if not observed.any():
        return NEVER
    if isinstance(zone.shape, Line):
        counts = [sum(event.get("direction") == direction for event in events) for direction in DIRECTIONS]
        missed = f"; {one.one_sided} seen on one side only" if one.one_sided else ""
        missed += f"; {one.unseen} out of sight, not counted" if one.unseen else ""
        if one.one_sided is None:
            return "no tracks"
        return f"in {counts[0]}, out {counts[1]}{missed}"
    alarms = [event for event in events if event["kind"] in EVENT_KINDS[:2]]
    stamps, away = columns["stamp"], columns["nearest"]
    assert stamps is not None
    assert away is not None
    span = (int(stamps.max()) - int(stamps.min())) * 1e-9
    active = sum(event["duration"] for event in alarms)
    parts = [f"{counted(len(alarms), 'event')}, {active:.1f} s of {span:.1f} s"]
    if np.isfinite(away).any():
        # Of all sweeps, as checks and reports have it: too few points for an event may be nearer.
        parts.append(f"nearest {np.nanmin(away):.2f} m")
    ttc = min((event["ttc"] for event in alarms if event["ttc"] is not None), default=None)
    if ttc is not None:
        parts.append(f"least time to collision {ttc:.1f} s")
    causes = by_words({letter: sum(event["set"] == letter for event in alarms) for letter in WHO})
    words = "; ".join(filter(None, [", ".join(parts), causes]))
    if visits := sum(event["kind"] == "visit" for event in events):
        words += f"; {counted(visits, 'visit')}"
    return words


WORST = 5
"""Most events of which there is a line."""


def _worst_first(by_zone: Sequence[ZoneEvents]) -> list[dict[str, Any]]:
    """Return the times at which zones were occupied, those that stop first and then the nearest; else the crossings."""
    events = [event for each in by_zone for event in each.events]
    alarms = [event for event in events if event["kind"] in EVENT_KINDS[:2]]
    if not alarms:
        return sorted((event for event in events if "direction" in event), key=lambda event: float(event["start"]))
    return sorted(alarms, key=lambda one: (one["action"] != "stop", one["nearest"] is None, one["nearest"]))


def _worst_lines(worst: Sequence[Mapping[str, Any]], zone: TimeZone) -> list[tuple[str, str]]:
    """Return heads and words on the worst events, as many as there are lines for."""
    width = max((len(event["zone"]) for event in worst[:WORST]), default=4)
    head, *clocks = column_of_times([event["start"] for event in worst[:WORST]], zone)
    lines = [("  worst    ", f"{'at':>10}  {head}{'zone':{width}}     lasts  nearest  by track")] if worst else []
    for event, clock in zip(worst[:WORST], clocks, strict=True):
        who = (WHO.get(event["set"], "").removesuffix("s"), event["track"], event["label"], event.get("direction"))
        nearest = " " * 7 if event["nearest"] is None else f"{event['nearest']:5.2f} m"
        lasts = f"{event['duration']:6.1f} s" if event["duration"] >= 0.05 else " < 0.1 s"
        if event["kind"] not in EVENT_KINDS[:2]:
            lasts = " " * 8  # a crossing takes no time
        words = f"{event['t']:8.1f} s  {clock}{event['zone']:{width}}  {lasts}  {nearest}  "
        lines.append((" " * 11, words + " ".join(str(part) for part in who if part)))
    return lines + ([(" " * 11, f"and {len(worst) - WORST:,} more")] if len(worst) > WORST else [])


def stale_notes(by_zone: Sequence[ZoneEvents], is_nav2: bool, zone: TimeZone) -> list[str]:
    """Return a line for each topic that was silent for too long, be it in one zone or in several."""
    begins: dict[tuple[str, float], dict[float, str]] = {}
    for each in by_zone:
        for event in (event for event in each.events if event["kind"] == STALE):
            clock = time_of_day(event["start"], zone)
            found = begins.setdefault((event["topic"], each.zone.timeout), {})
            found[event["t"]] = f"{event['t']:.1f} s" + (f" ({clock})" if clock else "")
    why = ": Nav2 stops the robot then (invalid source)" if is_nav2 else ""
    return [
        f"{topic}: no sweep for over {timeout:g} s, {times(len(stale))} from {stale[min(stale)]} on{why}"
        for (topic, timeout), stale in begins.items()
    ]
