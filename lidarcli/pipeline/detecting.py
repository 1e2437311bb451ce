"""The objects of logs: tables in a folder, one stream or file, or tables in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import pyarrow as pa

from lidarcli.choices import NS
from lidarcli.errors import LidarcliError, warn
from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.matching.catalogue import Catalogue, names_in
from lidarcli.newfiles import NewFiles, refuse
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.making import Made, Rows, Splitting, finder, rows_of
from lidarcli.pipeline.objects.options import OF_TRACKS, DetectOptions
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary, read_log
from lidarcli.pipeline.runs.outcomes import Outcome
from lidarcli.pipeline.runs.over_logs import LogProgress, logs_at_once, over_logs, progress_of
from lidarcli.stores.url import Place
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.schemas import OBJECTS, SCHEMAS
from lidarcli.tabular.stamps import in_unit
from lidarcli.tabular.writing import BY_DATE, RowSink, TableFiles, TopicOrder, table_metadata

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.tables import TableSet
    from lidarcli.pipeline.objects.following import TrackOptions


def detect_to_files(source: Source, folder: Place, options: DetectOptions, progress: Progress | None = None) -> RunSummary:
    """Write the tables of one log below `folder`; they appear when all of them are whole, or not at all."""
    known_before = options.layout != BY_DATE
    if known_before:
        refuse(options.outputs(source, folder).values(), options.overwrite, options.inputs([source]))
    with read_log(source, options, options.need) as reading, ExitStack() as stack:

        def opened() -> TableFiles:
            paths = options.outputs(source, folder, reading.date)
            if not known_before:
                refuse(paths.values(), options.overwrite, options.inputs([source]))
            return stack.enter_context(TableFiles(paths, reading.first, options.overwrite, options.stamps))

        files = opened() if known_before else None
        work = stack.enter_context(Splitting(reading, options.recipe(source, options.tables), options.threads))
        summary = reading.summary
        for table, topic, rows in _rows(source, reading, work, options, progress, stack):
            # The day of a log is that of its first sweep.
            files = files or opened()
            files.write(table, topic, rows)
            summary.rows += rows.num_rows
        files = files or opened()
        described = reading.describe(source)
        summary.notes += files.publish(table_metadata(options.as_dict(), described, summary.damage))
        summary.outputs = [str(path) for path in files.paths]
        summary.output_sizes = files.sizes
    return summary


def detect_beside(
    source: Source, folder: Path, options: DetectOptions, progress: Progress | None = None
) -> tuple[TableSet, RunSummary]:
    """Write the tables of one log below a private folder, for a second pass over the log; tells progress up to one half."""
    # Only a second pass needs this import.
    from lidarcli.pipeline.inputs.tables import TableSet

    half = None if progress is None else lambda position: progress(position // 2)
    summary = detect_to_files(source, folder, replace(options, overwrite=True, layout=None, stamps=NS), half)
    return TableSet(f"{folder / source.name}.", ".parquet"), summary


def second_of_two(progress: Progress | None, size: int) -> Progress | None:
    """Return the progress of the second of two passes over a log of so many bytes."""
    return None if progress is None else lambda position: progress((size + position) // 2)


def detect_to_sinks(
    source: Source, sinks: Mapping[str, RowSink], options: DetectOptions, progress: Progress | None = None
) -> tuple[RunSummary, dict[str, Any]]:
    """Pass the rows of one log to the sinks of their tables; returns the counts and the description of the source."""
    with (
        read_log(source, options, options.need) as reading,
        TopicOrder(sinks, reading.first, stamps=options.stamps) as order,
        Splitting(reading, options.recipe(source, tuple(sinks)), options.threads) as work,
        ExitStack() as stack,
    ):
        for table, topic, rows in _rows(source, reading, work, options, progress, stack):
            order.write(table, topic, rows)
        for table in sinks:
            order.drain(table)
        return reading.summary, reading.describe(source)


def _rows(
    source: Source, reading: Reading, work: Splitting, options: DetectOptions, progress: Progress | None, stack: ExitStack
) -> Iterator[Rows]:
    """Yield all rows of one log, those of a table and topic in their order; in the end the summary is complete."""
    summary = reading.summary
    following = None
    if options.tracking is not None:
        # Runs that do not track should not wait for this import.
        from lidarcli.pipeline.objects.following import Following

        following = stack.enter_context(
            Following(
                source.name,
                options.tracking,
                options.parameters,
                options.catalogue,
                waits=options.background is None and not reading.is_pipe,
            )
        )
    for part in work.parts(progress):
        summary.add_found(part.found)
        yield from part.rows if following is None else following.take(part.batches)
    notes = []
    if following is not None:
        yield from following.finish()
        summary.add_found(following.summary)
        notes = following.notes
    # The end of the work: the summary tells how long it took.
    reading.close()
    summary.notes += [*work.notes(), *notes]


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
    from lidarcli.tabular.stream import FORMATS, CountingOutput

    guard = CountingOutput(out, name)
    parameters = options.as_dict()
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    try:
        stream = FORMATS[kind](guard, in_unit(OBJECTS, options.stamps), table_metadata(parameters))

        def work(log: Source, *, progress: Progress | None = None) -> RunSummary:
            summary, origin = detect_to_sinks(log, {"objects": stream}, options, progress)
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
    # The last log that could be read, and those after it, wait: its outcome also tells of the file.
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
    trajectories : one row per thing and sweep, from its first sight to its last; None with `trajectories=False`
    """

    trajectories: pa.Table | None = None


def of_logs(
    sources: Sequence[Source], tables: Sequence[str], options: DetectOptions, report: LogProgress | None = None
) -> dict[str, pa.Table]:
    """Return some tables of all logs; warns of damage, and of logs that cannot be read while others can."""
    collected = {table: _Collected() for table in tables}
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    failed = Failed(len(sources))
    for source in sources:
        with failed.noted(source):
            summary, origin = detect_to_sinks(source, collected, options, progress_of(source, report))
            described.append(origin)
            damage += [line if len(sources) == 1 else f"{source.name}: {line}" for line in summary.damage]
            # Notes are for reading, but a table without a sweep needs its reason.
            for line in [*summary.damage, *(summary.doubts if summary.sweeps else summary.notes)]:
                warn(f"{source.label}: {line}")
    failed.conclude()
    origins = described[0] if len(described) == 1 else described
    metadata = table_metadata(options.as_dict(), origins, damage)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def of_batches(batches: Iterable[SweepBatch], tables: Sequence[str], options: DetectOptions) -> dict[str, pa.Table]:
    """Return some tables of batches in memory: in their order, or, where things are followed, by log and topic."""
    parameters, background, tracking = options.parameters, options.background, options.tracking
    catalogue = options.catalogue
    # Where things are followed, their names are those of the tracks.
    sought = parameters if tracking is None else tracking.found_with(parameters)
    find = finder(sought, background, catalogue if tracking is None else None, explain=options.explain)
    per_beam = "beams" in tables
    told: dict[str, Any] = {} if background is None else {"background": background.as_dict()}
    told |= {} if catalogue is None else {"catalogue": catalogue.as_dict()}
    collected = {table: _Collected() for table in tables}
    if tracking is None:
        for batch in batches:
            made = rows_of(batch.log, tables, batch, find(batch, per_beam), names_in(catalogue))
            for table, _, rows in made:
                collected[table].write(rows)
    else:
        told["tracking"] = tracking.as_dict()
        found = ((batch, find(batch, per_beam)) for batch in batches)
        _follow(found, collected, tracking, parameters, catalogue, waits=background is None)
    metadata = table_metadata(parameters.as_dict() | told)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def _follow(
    found: Iterable[tuple[SweepBatch, Detection]],
    sinks: Mapping[str, RowSink],
    tracking: TrackOptions,
    parameters: Parameters,
    catalogue: Catalogue | None,
    *,
    waits: bool,
) -> None:
    """Pass the rows of batches to the sinks of their tables, by log and topic."""
    # Runs that do not track should not wait for this import.
    from lidarcli.pipeline.objects.following import Following

    tables = [table for table in sinks if table not in OF_TRACKS]
    logs: dict[str, tuple[Following, TopicOrder]] = {}
    with ExitStack() as stack:
        for batch, detection in found:
            if batch.log not in logs:
                order = stack.enter_context(TopicOrder(sinks, None))
                following = Following(batch.log, tracking, parameters, catalogue, waits=waits)
                logs[batch.log] = stack.enter_context(following), order
            following, order = logs[batch.log]
            made = Made(rows_of(batch.log, tables, batch, detection), (batch, detection))
            for table, topic, rows in following.take([made]):
                order.write(table, topic, rows)
        for following, order in logs.values():
            for table, topic, rows in following.finish():
                order.write(table, topic, rows)
            for table in sinks:
                order.drain(table)


def _table(name: str, collected: _Collected, metadata: dict[bytes, bytes]) -> pa.Table:
    whole = pa.Table.from_batches(collected.rows, SCHEMAS[name])
    return whole.replace_schema_metadata(metadata).unify_dictionaries()


class Failed:
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
