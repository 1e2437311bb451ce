"""The objects of several logs: into a folder, as one stream or in one file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import IO, Any

from lidarcli.newfiles import new_files, refuse
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files, detect_to_sinks
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.pipeline.running.outcomes import LogProgress, Outcome, logs_at_once, outcome_of, progress_of
from lidarcli.stores.url import Place
from lidarcli.tabular.metadata import table_metadata
from lidarcli.tabular.schemas import OBJECTS
from lidarcli.tabular.stream import FORMATS, CountingOutput


def detect_files(
    sources: Sequence[Source | Nothing],
    folder: Place,
    options: DetectOptions,
    report: LogProgress | None = None,
) -> Iterator[Outcome]:
    """Write the tables of every log below `folder`, one after the other or several at the same time."""
    jobs = options.jobs or options.cores
    at_once = logs_at_once(sources, jobs)
    if at_once < 2:
        for source in sources:
            yield outcome_of(
                source, lambda log: detect_to_files(log, folder, options, progress_of(log, report))
            )
        return
    # Most runs need no process, nor wait for this import.
    from lidarcli.pipeline.running.side_by_side import side_by_side

    each = replace(options, jobs=options.jobs // at_once, cores=options.cores // at_once)
    work = partial(detect_to_files, folder=folder, options=each)
    for source, outcome in zip(sources, side_by_side(sources, work, at_once), strict=True):
        if report is not None and isinstance(source, Source):
            report(source, source.size)
        yield outcome


def detect_stream(
    sources: Sequence[Source | Nothing],
    out: IO[bytes],
    kind: str,
    options: DetectOptions,
    report: LogProgress | None = None,
    name: str = "standard output",
) -> Iterator[Outcome]:
    """Write the objects of all logs to one stream of `kind` (ndjson, csv, arrow, parquet), log after log.

    `name` is what errors call the stream.
    """
    guard = CountingOutput(out, name)
    parameters = options.as_dict()
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    try:
        stream = FORMATS[kind](guard, OBJECTS, table_metadata(parameters))

        def work(log: Source) -> RunSummary:
            summary, origin = detect_to_sinks(log, {"objects": stream}, options, progress_of(log, report))
            described.append(origin)
            damage.extend(summary.damage)
            summary.notes += stream.notes()
            return summary

        for source in sources:
            yield outcome_of(source, work)
        origin = described[0] if len(described) == 1 else described
        stream.finish(table_metadata(parameters, origin, damage))
    except BaseException:
        # An unfinished stream must not get an end that makes it look whole.
        guard.discard()
        raise


def detect_file(
    sources: Sequence[Source | Nothing],
    path: Place,
    kind: str,
    options: DetectOptions,
    report: LogProgress | None = None,
) -> Iterator[Outcome]:
    """The same into one file, which appears when it is whole, and only if anything could be read."""
    refuse([path], options.overwrite, options.inputs(sources))
    # The last log that could be read, and those after it, wait: it also tells what became of the file.
    waiting: list[Outcome] = []
    with new_files([path], options.overwrite) as new:
        with new.part(path).open("wb") as out:
            for outcome in detect_stream(sources, out, kind, options, report, str(path)):
                if outcome.summary is not None:
                    yield from waiting
                    waiting = []
                waiting.append(outcome)
        if waiting and (last := waiting[0].summary) is not None:
            last.notes += new.publish()
            last.outputs.append(str(path))
    yield from waiting
