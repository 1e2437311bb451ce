"""The objects of logs: tables in a folder, one stream or file, or tables in memory.

A sweep takes its path through `_detect_log`: a log is read as batches with poses, batches become parts with rows, perhaps
in several threads, or the tracking makes the rows where it is requested, and they are written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import pyarrow as pa

from lidarcli.errors import LidarcliError, warn
from lidarcli.files.newfiles import NewFiles, refuse
from lidarcli.files.stores import Place
from lidarcli.options.choices import NS
from lidarcli.pipeline.inputs.sources import MissingInput, Source, open_source
from lidarcli.pipeline.objects.detection import BatchDetector, BatchPart, DetectOptions, ParallelDetection
from lidarcli.pipeline.reading.needs import Need, SensorMovedError
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.pipeline.runs.over_logs import LogProgress, Outcome, logs_at_once, over_logs, progress_of
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.columns import in_unit
from lidarcli.tabular.schemas import OBJECTS, SCHEMAS
from lidarcli.tabular.writing import BY_DATE, RowSink, TableFiles, TopicOrder, table_metadata

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.tables import TableSet
    from lidarcli.pipeline.objects.tracking import LogTracker


def detect_to_files(source: Source, folder: Place, options: DetectOptions, progress: Progress | None = None) -> RunSummary:
    """Write the tables of one log below `folder`; they appear when all of them are whole, or not at all."""
    return _read_to_files(source, folder, options, progress).summary


def _read_to_files(source: Source, folder: Place, options: DetectOptions, progress: Progress | None) -> Reading:
    if options.need is Need.MOVING:
        # One pass is enough where the sensor is static; where it moves the first one ends soon.
        with suppress(SensorMovedError):
            return _read_once(source, folder, options, progress, Need.STANDING)
    return _read_once(source, folder, options, progress, options.need)


def _read_once(source: Source, folder: Place, options: DetectOptions, progress: Progress | None, need: Need) -> Reading:
    is_by_date = options.layout == BY_DATE
    inputs = options.inputs([source])
    if not is_by_date:
        refuse(options.outputs(source, folder).values(), options.overwrite, inputs)
    with open_source(source, options.opening) as log, Reading(log, options.read, options.poses, need) as reading:
        batches = reading.batches(progress)
        if is_by_date:
            # The day of a log is that of its first sweep.
            batches = chain([*islice(batches, 1)], batches)
        paths = options.outputs(source, folder, reading.date)
        if is_by_date:
            refuse(paths.values(), options.overwrite, inputs)
        with TableFiles(paths, reading.first, options.overwrite, options.stamps) as files:
            _detect_log(source, reading, batches, files, options)
            summary = reading.summary
            metadata = table_metadata(options.as_dict(), reading.describe(source), summary.damage)
            summary.notes += files.publish(metadata)
            summary.outputs = [str(path) for path in files.paths]
    return reading


LINES = ("ndjson", "csv")
"""Formats of streams that are read line by line: rows of a pipe are written as its sweeps come."""


def _detect_log(
    source: Source,
    reading: Reading,
    batches: Iterable[SweepBatch],
    files: TableFiles | TopicOrder,
    options: DetectOptions,
    tables: Sequence[str] = (),
) -> None:
    """Write the rows of the tables of one log, by topic in its order; in the end the summary of the reading is complete."""
    summary = reading.summary
    detector = BatchDetector(source.name, tables or options.tables, options)
    tracking = _tracker(source, reading, detector.tables, options)
    with ParallelDetection(detector, reading, options.threads) as detection, tracking as tracker:
        for part in chain(chain.from_iterable(map(detection.take, batches)), detection.flush()):
            summary.add_found(part.counts)
            for table, topic, rows in part.rows if tracker is None else tracker.take(part.detected):
                files.write(table, topic, rows)
        if tracker is not None:
            for table, topic, rows in tracker.flush():
                files.write(table, topic, rows)
            summary.add_found(tracker.counts)
            summary.followed = tracker.counts.followed
        # The end of the work: the summary states how long it took.
        reading.close()
        summary.notes += [*detection.notes(), *([] if tracker is None else summary.graded(tracker.notes))]


def _tracker(
    source: Source, reading: Reading, tables: Sequence[str], options: DetectOptions
) -> AbstractContextManager[LogTracker | None]:
    if options.tracking is None:
        return nullcontext()
    # Runs that do not track should not wait for this import.
    from lidarcli.pipeline.objects.tracking import LogTracker

    return LogTracker(source.name, tables, options, waits=options.background is None and not reading.is_pipe)


def detect_to_temporary(
    source: Source, folder: Path, options: DetectOptions, progress: Progress | None = None
) -> tuple[TableSet, Reading]:
    """Write the tables of one log below a private folder, for a second pass over the log; reports half of the progress.

    The reading has ended; the second pass takes mask and paths from it.
    """
    # Only a second pass needs this import.
    from lidarcli.pipeline.inputs.tables import TableSet

    half = None if progress is None else lambda position: progress(position // 2)
    reading = _read_to_files(source, folder, replace(options, overwrite=True, layout=None, stamps=NS), half)
    return TableSet(f"{folder / source.name}.", ".parquet"), reading


def second_half(progress: Progress | None, size: int) -> Progress | None:
    """Return the progress of the second of two passes over a log of so many bytes."""
    return None if progress is None else lambda position: progress((size + position) // 2)


def detect_to_sinks(
    source: Source,
    sinks: Mapping[str, RowSink],
    options: DetectOptions,
    progress: Progress | None = None,
    at_once: bool = False,
) -> tuple[RunSummary, dict[str, Any]]:
    """Pass the rows of one log to the sinks of their tables; returns the counts and the description of the source.

    `at_once`: those of a pipe come in its order, and not by topic.
    """
    with (
        open_source(source, options.opening) as log,
        Reading(log, options.read, options.poses, options.need) as reading,
        TopicOrder(sinks, reading.first, stamps=options.stamps, at_once=at_once and reading.is_pipe) as order,
    ):
        _detect_log(source, reading, reading.batches(progress), order, options, tuple(sinks))
        for table in sinks:
            order.drain(table)
        return reading.summary, reading.describe(source)


def detect_files(
    sources: Sequence[Source | MissingInput], folder: Place, options: DetectOptions, report: LogProgress | None = None
) -> Iterator[Outcome]:
    """Write the tables of every log below `folder`, one after the other or several at the same time."""
    at_once = logs_at_once(sources, options.jobs or options.cores)
    if at_once > 1:
        options = replace(options, jobs=options.jobs // at_once, cores=options.cores // at_once)
    return over_logs(sources, partial(detect_to_files, folder=folder, options=options), report, at_once)


def detect_stream(
    sources: Sequence[Source | MissingInput],
    out: IO[bytes],
    kind: str,
    options: DetectOptions,
    report: LogProgress | None = None,
    name: str = "standard output",
) -> Iterator[Outcome]:
    """Write the objects of all logs to one stream of `kind` (ndjson, csv, arrow, parquet), log after log.

    `name` is what errors call the stream.
    """
    from lidarcli.tabular.streams import FORMATS, CountingOutput

    guard = CountingOutput(out, name)
    parameters = options.as_dict()
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    try:
        stream = FORMATS[kind](guard, in_unit(OBJECTS, options.stamps), table_metadata(parameters))

        def work(log: Source, *, progress: Progress | None = None) -> RunSummary:
            summary, origin = detect_to_sinks(log, {"objects": stream}, options, progress, kind in LINES)
            described.append(origin)
            damage.extend(summary.damage)
            summary.notes += stream.notes()
            return summary

        yield from over_logs(sources, work, report)
        origin = described[0] if len(described) == 1 else described
        stream.finish(table_metadata(parameters, origin, damage))
    except BaseException:
        # An unfinished stream must not get an end that makes it look whole.
        guard.discard()
        raise


def detect_file(
    sources: Sequence[Source | MissingInput],
    path: Place,
    kind: str,
    options: DetectOptions,
    report: LogProgress | None = None,
) -> Iterator[Outcome]:
    """Write the objects of all logs to one file, which appears when it is whole, and only if any log could be read."""
    refuse([path], options.overwrite, options.inputs(sources))
    # The last log that could be read, and those after it, wait: its outcome is also that of the file.
    waiting: list[Outcome] = []
    with NewFiles([path], options.overwrite) as new:
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


class _TrackTables(NamedTuple):
    objects: pa.Table
    """One row per object per sweep, with its track."""
    sweeps: pa.Table
    """One row per sweep."""
    tracks: pa.Table
    """One row per track."""


class TrackTables(_TrackTables):
    """Tables that `track` returns, with the columns of docs/tables.md: `objects`, `sweeps`, `tracks`, to be unpacked.

    Attributes
    ----------
    trajectories : one row per track and sweep, from its first sight to its last; None with `trajectories=False`
    beams : one row per beam of each sweep with `beams=True`, else None
    """

    trajectories: pa.Table | None = None
    beams: pa.Table | None = None


def of_logs(
    sources: Sequence[Source], tables: Sequence[str], options: DetectOptions, report: LogProgress | None = None
) -> dict[str, pa.Table]:
    """Return some tables of all logs; warns of damage, and of logs that cannot be read while others can."""
    collected = {table: _Collected() for table in tables}
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    errors = ErrorCollector(len(sources))
    for source in sources:
        with errors.noted(source):
            summary, origin = detect_to_sinks(source, collected, options, progress_of(source, report))
            described.append(origin)
            damage += [line if len(sources) == 1 else f"{source.name}: {line}" for line in summary.damage]
            # Notes are for reading, but a table without a sweep needs its reason.
            for line in dict.fromkeys([*summary.warnings, *(summary.doubts if summary.sweeps else summary.notes)]):
                warn(f"{source.label}: {line}")
    errors.conclude()
    origins = described[0] if len(described) == 1 else described
    metadata = table_metadata(options.as_dict(), origins, damage)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def of_batches(batches: Iterable[SweepBatch], tables: Sequence[str], options: DetectOptions) -> dict[str, pa.Table]:
    """Return some tables of batches in memory: in their order, or, where things are tracked, by log and topic."""
    detector = BatchDetector(None, tables, options)
    parts = (detector.detect([batch]) for batch in batches)
    collected = {table: _Collected() for table in tables}
    if options.tracking is None:
        for part in parts:
            for table, _, rows in part.rows:
                collected[table].write(rows)
    else:
        _track(parts, detector.tables, collected, options)
    named = {"background": options.background, "tracking": options.tracking, "catalogue": options.catalogue}
    described = {name: each.as_dict() for name, each in named.items() if each is not None}
    metadata = table_metadata(options.parameters.as_dict() | described)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def _track(parts: Iterable[BatchPart], tables: Sequence[str], sinks: Mapping[str, RowSink], options: DetectOptions) -> None:
    """Pass the rows of batches to the sinks of their tables, by log and topic."""
    # Runs that do not track should not wait for this import.
    from lidarcli.pipeline.objects.tracking import LogTracker

    logs: dict[str, tuple[LogTracker, TopicOrder]] = {}
    with ExitStack() as stack:
        for part in parts:
            for each in part.detected:
                log = each[0].log
                if log not in logs:
                    order = stack.enter_context(TopicOrder(sinks, None))
                    tracker = LogTracker(log, tables, options, waits=options.background is None)
                    logs[log] = stack.enter_context(tracker), order
                tracker, order = logs[log]
                for table, topic, rows in tracker.take([each]):
                    order.write(table, topic, rows)
        for tracker, order in logs.values():
            for table, topic, rows in tracker.flush():
                order.write(table, topic, rows)
            for table in sinks:
                order.drain(table)


def _table(name: str, collected: _Collected, metadata: dict[bytes, bytes]) -> pa.Table:
    whole = pa.Table.from_batches(collected.rows, SCHEMAS[name])
    return whole.replace_schema_metadata(metadata).unify_dictionaries()


class ErrorCollector:
    """Errors of logs that cannot be read: each is a warning, and the first is raised where all logs fail."""

    def __init__(self, logs: int) -> None:
        self._logs = logs
        self._errors: list[LidarcliError] = []

    @contextmanager
    def noted(self, source: Source) -> Iterator[None]:
        """Take the errors of one log, and name it in them."""
        try:
            yield
        except LidarcliError as err:
            named = type(err)(f"{source.label}: {str(err).removeprefix(f'{source.path}: ')}")
            self._errors.append(named)
            if self._logs == 1:
                raise named from err
            warn(str(named))

    def conclude(self) -> None:
        """Raise where every log failed."""
        if self._errors and len(self._errors) == self._logs:
            raise self._errors[0]


class _Collected:
    """A sink that keeps its rows in memory."""

    def __init__(self) -> None:
        self.rows: list[pa.RecordBatch] = []

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows."""
        self.rows.append(rows)
