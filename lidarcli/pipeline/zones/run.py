"""`zones` over a log and over several, with checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any

import pyarrow as pa

from lidarcli.display.texts import Routine
from lidarcli.errors import OptionError
from lidarcli.files.newfiles import NewFiles, refuse, scratch_folder, write_whole, writing
from lidarcli.files.stores import Place
from lidarcli.logs.base import Log
from lidarcli.options.times import Instant
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import MissingInput, Source, open_source
from lidarcli.pipeline.inputs.tables import TableSet, other_recording, tables_together
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, logs_at_once, over_logs
from lidarcli.pipeline.zones.events import ZoneEvents
from lidarcli.pipeline.zones.options import MAX_EXPLAINED, ZoneOptions, masked, narrowed
from lidarcli.pipeline.zones.reader import ZoneReader
from lidarcli.pipeline.zones.summary import CountedTables, ZoneSummary, ZoneTables, stale_notes
from lidarcli.reports.checks import Check, CheckVerdict, held, verdict_of
from lidarcli.reports.programs import as_junit
from lidarcli.reports.report import Report
from lidarcli.reports.zones import figures_of, parse_zone_check, unobserved, zones_alone, zones_in
from lidarcli.tabular.reading import TableInMemory
from lidarcli.tabular.writing import TableFiles, table_metadata


def watch(
    source: Source, options: ZoneOptions, folder: Place | None = None, progress: Progress | None = None
) -> ZoneSummary:
    """Find what is in the zones in every sweep of a log, and write the tables if a folder is given.

    `OptionError`: the log is standard input, which is read only once; `UnreadableError`: the log or its tables cannot be
    read, or its poses contradict its sweeps while a zone is in the world; `NoScanError`: no LaserScan topic, or not the one
    that a zone names, or nothing leads to the frame of a zone; `OutputError`: a file cannot be written.
    """
    if source.is_stdin:
        raise OptionError("zones are watched by reading the log twice; give the name of its file instead of -")
    paths = None if folder is None else options.outputs(source, folder)
    if paths is not None:
        refuse(paths.values(), options.overwrite, options.inputs([source]))
    parameters = options.as_dict()
    with ExitStack() as stack:
        tables = None if options.objects is None else tables_together(options.objects)
        with open_source(source, options.detect.opening) as log:
            options = narrowed(log, options)
            read = options.detect.read
            masking = masking_of(log, read.rules, options.detect.poses, read.topics)
            finds = tables is None and options.find
            detect = masked(log, options, masking) if finds else options.detect
        first: Reading | None = None
        if finds:
            tables, first = detect_to_temporary(source, stack.enter_context(scratch_folder()), detect, progress)
            progress = second_half(progress, source.size)
        log = stack.enter_context(open_source(source, options.detect.opening))
        reader = ZoneReader(log, options, tables, masking, first)
        found, by_zone, described = reader.run(source, progress)
        if first is not None:
            # Both passes report the same damage; the first one also notes what it found.
            found.damage = [*dict.fromkeys([*first.summary.damage, *found.damage])]
            found.notes = [*dict.fromkeys([*masking.notes, *first.summary.notes, *found.notes])]
        metadata = table_metadata(parameters, described, found.damage)
        stops = reader.stops if options.stops else None
        summary = ZoneSummary.of(found, source.name, by_zone, reader.acts, stops, metadata, options.interval_ns)
        summary.notes += [*options.zones.notes, *stale_notes(by_zone, bool(options.zones.robot), summary.time_zone)]
        if tables is not None and options.objects is not None:
            summary.notes += other_recording(tables, described.get("recording", {}))
            if options.zones.masks.masks:
                hidden = "masks of the zone file hide beams, but no objects of --objects"
                summary.notes.append(f"{hidden}: give --mask where these are made, too")
        if paths is not None:
            files = stack.enter_context(TableFiles(paths, None, options.overwrite, options.detect.stamps))
            for name, table in summary.tables._asdict().items():
                for batch in table.to_batches():
                    files.write(name, "", batch)
            summary.notes += files.publish(metadata)
            summary.outputs = [str(path) for path in files.paths]
        if options.explain is not None:
            _explain(source, log, options, summary, reader, by_zone, described, tables)
        if options.clips is not None:
            clips = _clips(source, options.clips, options, summary.tables.events)
            summary.notes, summary.outputs = summary.notes + clips.notes, summary.outputs + clips.outputs
    return summary


def _explain(
    source: Source,
    log: Log,
    options: ZoneOptions,
    summary: ZoneSummary,
    reader: ZoneReader,
    by_zone: Sequence[ZoneEvents],
    described: Mapping[str, Any],
    tables: TableSet | None,
) -> None:
    """Write what happened at a time, or at the worst ones."""
    from lidarcli.pipeline.zones.explanation import Found, explain, worst_times
    from lidarcli.reports.html import render

    assert options.explain is not None
    doubted = [note for note in summary.notes if not isinstance(note, Routine)]
    poses = [note for note in doubted if note.startswith(("poses", "matched path"))]
    events = summary.events if options.stops else [*summary.events, *reader.stops]
    found = Found(
        reader.topics, by_zone, summary.acts, reader.odometry, events, described, reader.doubts, poses, reader.late_ns or 0
    )
    wanted = options.explain.time
    times = [Instant(ns) for ns in worst_times(found.events, MAX_EXPLAINED)] if wanted is None else [wanted]
    if not times:
        summary.notes.append("--explain worst: no event, and the robot never stopped: there is nothing to explain")
    for number, time in enumerate(times, 1):
        answer = explain(source, log, options, found, tables, time)
        summary.answers = [*summary.answers, answer.answer]
        for path in options.explain.files(number):
            with NewFiles([path], options.overwrite) as new:
                with writing(path):
                    match path.suffix.lower():
                        case ".html":
                            new.part(path).write_bytes(render(Report((answer,))).encode())
                        case ".png":
                            new.part(path).write_bytes(answer.png())
                        case _:
                            answer.write_film(new.part(path))
                summary.notes += new.publish()
            summary.outputs.append(str(path))


def _clips(source: Source, folder: Place, options: ZoneOptions, events: pa.Table) -> RunSummary:
    """Write a part of the log around each event."""
    # Most runs cut nothing, and should not wait for this import.
    from lidarcli.pipeline.clean.log import clean_log
    from lidarcli.pipeline.clean.options import CleanOptions

    rows = TableInMemory(f"the events of {source.label}", events)
    read = replace(options.detect.read, start=None, end=None, run=None, every=1)
    detect = replace(options.detect, read=read)
    cutting = CleanOptions(detect, frozenset(), overwrite=options.overwrite, clips=rows, around=options.around)
    return clean_log(source, folder, cutting)


def watch_files(
    sources: Sequence[Source | MissingInput], folder: Place | None, options: ZoneOptions, report: LogProgress | None = None
) -> Iterator[Outcome]:
    """Watch the zones in every log, one after the other or several at the same time."""
    at_once = logs_at_once(sources, options.detect.jobs or options.detect.cores)
    if at_once > 1:
        detect = options.detect
        detect = replace(detect, jobs=detect.jobs // at_once, cores=detect.cores // at_once)
        options = replace(options, detect=detect)

    return over_logs(sources, partial(watch, options=options, folder=folder), report, at_once)


def refuse_outputs(
    sources: Sequence[Source | MissingInput], folder: Place | None, options: ZoneOptions, more: Sequence[Place] = ()
) -> list[str]:
    """Return the files that are written, and `more`, after refusing those that cannot be, before any work."""
    logs = [source for source in sources if isinstance(source, Source)]
    paths = [path for source in logs if folder is not None for path in options.outputs(source, folder).values()]
    if options.explain is not None:
        numbers = range(1, 2 if options.explain.time is not None else MAX_EXPLAINED + 1)
        paths += [path for number in numbers for path in options.explain.files(number)]
    paths += more
    refuse(paths, options.overwrite, options.inputs(sources))
    return [*map(str, paths)]


def understand(options: ZoneOptions, expressions: Sequence[str]) -> list[Check]:
    """Parse checks of zones, or raise a usage error."""
    return [parse_zone_check(each, [zone.name for zone in options.zones.zones]) for each in expressions]


def judge(
    checks: Sequence[Check], logs: Sequence[tuple[str, ZoneTables | CountedTables]]
) -> tuple[list[CheckVerdict], tuple[str, ...], dict[str, float | None]]:
    """Return the verdicts on all logs, a line for each zone that was not observed all the time, and the figures."""
    if not logs:
        return [verdict_of(check, None) for check in checks], (), {}
    rows = zones_in({number: tables for number, (_, tables) in enumerate(logs)})
    figures = figures_of(rows)
    runs = [zones_alone(*log, checks) for log in logs if any(check.is_of_each for check in checks)]
    return [held(check, runs, figures, rows) for check in checks], unobserved(checks, rows), figures


def write_verdicts(path: Place, overwrite: bool, *told: Any) -> list[str]:
    """Write the arguments of `as_junit` to a JUnit file; returns notes."""
    return write_whole(path, as_junit("zones", *told).encode(), overwrite)
