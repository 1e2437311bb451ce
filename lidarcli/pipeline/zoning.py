"""Zones over the sweeps of logs: events, and what is in each zone in every sweep, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.errors import OptionError
from lidarcli.newfiles import refuse, scratch_folder
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import Nothing, Source, open_source
from lidarcli.pipeline.inputs.tables import one_pair
from lidarcli.pipeline.reading.one_log import Progress, RunSummary
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, logs_at_once, over_logs
from lidarcli.pipeline.watching.events import Settled
from lidarcli.pipeline.watching.options import TABLES, ZoneOptions
from lidarcli.pipeline.watching.over_log import Watching, masked, narrowed
from lidarcli.reports.checks import Verdict, verdict_of
from lidarcli.reports.figures import plain_number
from lidarcli.reports.wording import counted
from lidarcli.reports.zone_report import NEVER
from lidarcli.reports.zones import figures_of, judge_zones, parse_zone_check, unobserved, watched_in
from lidarcli.stores import Place
from lidarcli.tabular.columns import FORMS, answers, codes, constant
from lidarcli.tabular.schemas import DIRECTIONS, EVENT_KINDS, SCHEMAS
from lidarcli.tabular.writing import TableFiles, table_metadata
from lidarcli.zone import Line

_MASKED = "masks of the zone file hide beams, but no objects of --objects: give --mask where these are made, too"
_SAME = "always the same beams at the same range: the robot's own body? (info --deep)"


class ZoneTables(NamedTuple):
    """Tables that `zones` returns, with the schemas of `lidarcli.tabular.SCHEMAS`."""

    events: pa.Table
    """One row per event."""
    zones: pa.Table
    """One row per sweep and zone."""


@dataclass(slots=True)
class ZoneSummary(RunSummary):
    """The counts of one run over one log, and its zones."""

    tables: ZoneTables = field(default_factory=lambda: ZoneTables(*(SCHEMAS[name].empty_table() for name in TABLES)))
    lines: list[str] = field(default_factory=list)
    """A line for each zone."""

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values, with what a check may name."""
        figures = figures_of(watched_in({0: self.tables}))
        return RunSummary.as_dict(self) | {"figures": {name: plain_number(figures[name]) for name in figures}}


def watch(
    source: Source, options: ZoneOptions, folder: Place | None = None, progress: Progress | None = None
) -> ZoneSummary:
    """Find what is in the zones in every sweep of a log, and write the tables if a folder is given.

    Raises
    ------
    OptionError
        The log is standard input, which is read only once.
    UnreadableError
        The log or its tables cannot be read, or its poses contradict its sweeps while a zone is in the world.
    NoScanError
        The log has no LaserScan topic, or not the one that a zone names; or nothing leads to the frame of a zone.
    OutputError
        A file cannot be written.
    """
    if source.is_stdin:
        raise OptionError("zones are watched by reading the log twice; give the name of its file instead of -")
    paths = None if folder is None else options.outputs(source, folder)
    if paths is not None:
        refuse(paths.values(), options.overwrite, options.inputs([source]))
    with ExitStack() as stack:
        found: RunSummary | None = None
        told = options.as_dict()
        with open_source(source, options.detect.opening) as log:
            options = narrowed(log, options)
        pair = None if options.objects is None else one_pair(options.objects)
        if pair is None and options.find:
            private = stack.enter_context(scratch_folder())
            with open_source(source, options.detect.opening) as log:
                finding = masked(log, options)
            pair, found = detect_to_temporary(source, private, finding, progress)
            progress = second_half(progress, source.size)
        log = stack.enter_context(open_source(source, options.detect.opening))
        read, settled, described = Watching(log, options, pair).run(source, progress)
        summary = ZoneSummary(**{name: getattr(read, name) for name in RunSummary.__dataclass_fields__})
        if found is not None:
            # Both passes tell of the same damage; the first one also of what it found.
            summary.damage = [*dict.fromkeys([*found.damage, *summary.damage])]
            summary.notes = [*dict.fromkeys([*found.notes, *summary.notes])]
        metadata = table_metadata(told, described, summary.damage)
        tables = _tables(source.name, settled, metadata)
        summary.tables = tables
        names = _names(settled)
        longest = max(map(len, names))
        summary.lines = [f"{name:<{longest}}  {_words(each)}" for name, each in zip(names, settled, strict=True)]
        summary.notes += [
            *options.zones.notes,
            *_stale(settled, bool(options.zones.robot)),
            *([_MASKED] if options.objects is not None and options.zones.masks.masks else ()),
            *(f"{name}: {_SAME}" for name, each in zip(names, settled, strict=True) if each.always_same),
        ]
        if paths is not None:
            files = stack.enter_context(TableFiles(paths, None, options.overwrite, options.detect.stamps))
            for name, table in tables._asdict().items():
                for batch in table.to_batches():
                    files.write(name, "", batch)
            summary.notes += files.publish(metadata)
            summary.outputs = [str(path) for path in files.paths]
            summary.output_sizes = files.sizes
            summary.rows = sum(table.num_rows for table in tables)
    return summary


def watch_files(
    sources: Sequence[Source | Nothing], folder: Place | None, options: ZoneOptions, report: LogProgress | None = None
) -> Iterator[Outcome]:
    """Watch the zones in every log, one after the other or several at the same time."""
    at_once = logs_at_once(sources, options.detect.jobs or options.detect.cores)
    if at_once > 1:
        detect = options.detect
        detect = replace(detect, jobs=detect.jobs // at_once, cores=detect.cores // at_once)
        options = replace(options, detect=detect)

    return over_logs(sources, partial(watch, options=options, folder=folder), report, at_once)


def refuse_outputs(sources: Sequence[Source | Nothing], folder: Place | None, options: ZoneOptions) -> list[str]:
    """Return the files that are written, after refusing those that cannot be, and two logs of one name, before any work."""
    if folder is None:
        return []
    paths: dict[str, Place] = {}
    for source in sources:
        if isinstance(source, Source):
            for path in options.outputs(source, folder).values():
                if str(path) in paths:
                    raise OptionError(f"{path} would be written for two logs; give -o another DIR for one of them")
                paths[str(path)] = path
    refuse(paths.values(), options.overwrite, options.inputs(sources))
    return [*paths]


class Gates:
    """Checks of what a run over several logs finds."""

    def __init__(self, options: ZoneOptions, expressions: Sequence[str]) -> None:
        """Understand the checks, or raise a usage error."""
        zones = options.zones.zones
        self._checks = [parse_zone_check(each, [zone.name for zone in zones]) for each in expressions]
        self._tables: list[ZoneTables] = []

    def add(self, tables: ZoneTables) -> None:
        """Take the tables of a log."""
        if self._checks:
            self._tables.append(tables)

    def verdicts(self) -> tuple[list[Verdict], tuple[str, ...]]:
        """Hold the checks against all tables; also returns a line for each zone that was not observed all the time."""
        if not self._checks or not self._tables:
            return [verdict_of(check, None) for check in self._checks], ()
        watched = watched_in(dict(enumerate(self._tables)))
        figures = figures_of(watched)
        verdicts = [judge_zones(check, figures, watched) for check in self._checks]
        return verdicts, unobserved(self._checks, watched)


def _tables(log: str, settled: Sequence[Settled], metadata: dict[bytes, bytes]) -> ZoneTables:
    """Return the tables of a log."""
    events = [event for each in settled for event in each.events]
    order = sorted(range(len(events)), key=lambda at: (events[at]["start"], at))
    rows = [events[at] | {"log": log, "event": number} for number, at in enumerate(order, 1)]
    found = pa.Table.from_batches([_event_rows(rows)], SCHEMAS["events"])
    pieces = [_zone_rows(log, each) for each in settled]
    zones = pa.Table.from_batches(pieces, SCHEMAS["zones"]).unify_dictionaries()
    if zones.num_rows:
        # By topic and sweep; zones of one sweep in the order of the file.
        topics = np.concatenate([np.array([one.topic for one in each.topics])[each.topic] for each in settled])
        zones = zones.take(pa.array(np.lexsort((np.asarray(zones["sweep"]), topics))))
    return ZoneTables(*(table.replace_schema_metadata(metadata) for table in (found, zones)))


def _event_rows(events: Sequence[Mapping[str, Any]]) -> pa.RecordBatch:
    schema = SCHEMAS["events"]
    arrays = [pa.array([event.get(one.name) for event in events], one.type) for one in schema]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _zone_rows(log: str, settled: Settled) -> pa.RecordBatch:
    count = len(settled.topic)
    columns: dict[str, Any] = {
        "log": constant(log, count),
        "topic": codes(settled.topic.astype(np.int32), tuple(one.topic for one in settled.topics)),
        "zone": constant(settled.zone.name, count),
    }
    columns |= {name: values for name, values in settled.columns.items() if values is not None}
    columns |= {name: answers(columns[name].astype(np.int8)) for name in ("active", "observed")}
    return FORMS["zones"].fill(columns, None, count)


def _names(settled: Sequence[Settled]) -> list[str]:
    """Return a name for each zone, with its topic, or also its frame, where several sensors see one of their own."""
    count = Counter(each.zone.name for each in settled)
    names = [
        each.zone.name if count[each.zone.name] == 1 else f"{each.zone.name} ({each.topics[0].topic})" for each in settled
    ]
    return [
        name if names.count(name) == 1 else f"{name} ({each.topics[0].frame_id})"
        for name, each in zip(names, settled, strict=True)
    ]


def _words(settled: Settled) -> str:
    """Return what was in a zone, for people."""
    zone, events = settled.zone, settled.events
    columns = settled.columns
    observed = columns["observed"]
    assert observed is not None
    if not settled.in_force:
        return "none of its polygons covers the velocity"
    if not observed.any():
        return NEVER
    if isinstance(zone.shape, Line):
        counts = [sum(event.get("direction") == way for event in events) for way in DIRECTIONS]
        missed = f"; {settled.one_sided} seen on one side only" if settled.one_sided else ""
        if settled.one_sided is None:
            return "no tracks"
        return f"in {counts[0]}, out {counts[1]}{missed}"
    alarms = [event for event in events if event["kind"] in EVENT_KINDS[:2]]
    stamps = columns["stamp"]
    assert stamps is not None
    span = (int(stamps.max()) - int(stamps.min())) * 1e-9
    active = sum(event["duration"] for event in alarms)
    nearest = min((event["nearest"] for event in alarms if event["nearest"] is not None), default=None)
    parts = [f"{counted(len(alarms), 'event')}, {active:.1f} s of {span:.1f} s"]
    if nearest is not None:
        parts.append(f"nearest {nearest:.2f} m")
    ttc = min((event["ttc"] for event in alarms if event["ttc"] is not None), default=None)
    if ttc is not None:
        parts.append(f"least time to collision {ttc:.1f} s")
    words = ", ".join(parts)
    by = {letter: sum(event["set"] == letter for event in alarms) for letter in ("A", "O", "S")}
    words_of = {"A": "agents", "O": "things", "S": "walls"}
    told = [f"{words_of[letter]} {count}" for letter, count in by.items() if count]
    words += f"; by {', '.join(told)}" if told else ""
    if visits := sum(event["kind"] == "visit" for event in events):
        words += f"; {counted(visits, 'visit')}"
    return words


def _stale(settled: Sequence[Settled], is_nav2: bool) -> list[str]:
    """Return a line for each topic that told nothing for too long, be it in one zone or in several."""
    counts = Counter(
        (event["topic"], each.zone.timeout, each.zone.name)
        for each in settled
        for event in each.events
        if event["kind"] == "stale"
    )
    times = {(topic, timeout): count for (topic, timeout, _), count in counts.items()}
    why = ": Nav2 stops the robot then (invalid source)" if is_nav2 else ""
    return [
        f"{topic}: no sweep for more than {timeout:g} s, {counted(count, 'time')}{why}"
        for (topic, timeout), count in times.items()
    ]
