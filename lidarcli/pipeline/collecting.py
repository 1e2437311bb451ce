"""Tables in memory, for Python: those of logs, and those of batches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import pyarrow as pa

from lidarcli.errors import LidarcliError
from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.catalogue import Catalogue, names_in
from lidarcli.pipeline.detecting import DetectOptions, detect_to_sinks
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.finders import finder
from lidarcli.pipeline.objects.parts import Made, rows_of
from lidarcli.pipeline.warned import warn
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.metadata import table_metadata
from lidarcli.tabular.order import RowSink, TopicOrders
from lidarcli.tabular.schemas import SCHEMAS

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.following import TrackOptions


class TrackTables(NamedTuple):
    """What `track` returns: tables with the schemas of `lidarcli.tabular.SCHEMAS`."""

    objects: pa.Table
    """One row per object per sweep, with the thing that it belongs to."""
    sweeps: pa.Table
    """One row per sweep."""
    tracks: pa.Table
    """One row per thing."""


def of_logs(sources: Sequence[Source], tables: Sequence[str], options: DetectOptions) -> dict[str, pa.Table]:
    """Some tables of all logs; warns of damage, and of logs that cannot be read while others can."""
    collected = {table: _Collected() for table in tables}
    described: list[dict[str, Any]] = []
    damage: list[str] = []
    failed = Failed(len(sources))
    for source in sources:
        with failed.noted(source):
            summary, origin = detect_to_sinks(source, collected, options)
            described.append(origin)
            damage += summary.damage
            # Notes are for reading, but a table without a sweep needs its reason.
            for line in [*summary.damage, *(summary.doubts if summary.sweeps else summary.notes)]:
                warn(f"{source.path}: {line}")
    failed.conclude()
    origins = described[0] if len(described) == 1 else described
    metadata = table_metadata(options.as_dict(), origins, damage)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def of_batches(
    batches: Iterable[SweepBatch], tables: Sequence[str], options: DetectOptions
) -> dict[str, pa.Table]:
    """Some tables of batches that somebody has: as they come, or, where things are followed, by log and topic."""
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
        _follow(found, collected, tracking, parameters, catalogue)
    metadata = table_metadata(parameters.as_dict() | told)
    return {table: _table(table, rows, metadata) for table, rows in collected.items()}


def _follow(
    found: Iterable[tuple[SweepBatch, Detection]],
    sinks: Mapping[str, RowSink],
    tracking: TrackOptions,
    parameters: Parameters,
    catalogue: Catalogue | None,
) -> None:
    """Pass the rows of batches to the sinks of their tables, by log and topic."""
    # Who does not track does not wait for this import.
    from lidarcli.pipeline.objects.following import Following

    tables = [table for table in sinks if table != "tracks"]
    logs: dict[str, tuple[Following, TopicOrders]] = {}
    with ExitStack() as stack:
        for batch, detection in found:
            if batch.log not in logs:
                orders = stack.enter_context(TopicOrders(sinks, None))
                logs[batch.log] = Following(batch.log, tracking, parameters, catalogue), orders
            following, orders = logs[batch.log]
            made = Made(rows_of(batch.log, tables, batch, detection), (batch, detection))
            orders.write(following.take([made]))
        for following, orders in logs.values():
            orders.write(following.finish())
            orders.drain()


def _table(name: str, collected: _Collected, metadata: dict[bytes, bytes]) -> pa.Table:
    whole = pa.Table.from_batches(collected.rows, SCHEMAS[name])
    return whole.replace_schema_metadata(metadata).unify_dictionaries()


class Failed:
    """Logs of several that cannot be read: each is warned of, and the first one's error raised where none can."""

    def __init__(self, logs: int) -> None:
        self._logs = logs
        self._errors: list[LidarcliError] = []

    @contextmanager
    def noted(self, source: Source) -> Iterator[None]:
        """What befalls one log; errors name it."""
        try:
            yield
        except LidarcliError as err:
            named = type(err)(f"{source.path}: {str(err).removeprefix(f'{source.path}: ')}")
            self._errors.append(named)
            if self._logs == 1:
                raise named from err
            warn(str(named))

    def conclude(self) -> None:
        """Raise where every log failed."""
        if self._errors and len(self._errors) == self._logs:
            raise self._errors[0]


class _Collected:
    """A sink that keeps its rows."""

    def __init__(self) -> None:
        self.rows: list[pa.RecordBatch] = []

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows."""
        self.rows.append(rows)
