"""Tables as files that appear together, and as streams of JSON lines, CSV, Arrow or Parquet; the order of topics."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Protocol, Self

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli._version import __version__
from lidarcli.files.newfiles import NewFiles, writing
from lidarcli.files.stores import Place
from lidarcli.options.choices import NS
from lidarcli.system.machine import Threads
from lidarcli.tabular.columns import in_unit, restamped
from lidarcli.tabular.schemas import SCHEMAS

if TYPE_CHECKING:
    from concurrent.futures import Future

VERSION, PARAMETERS, SOURCE, DAMAGE = ("lidarcli.version", "lidarcli.parameters", "lidarcli.source", "lidarcli.damage")
"""Keys of the schema metadata."""
ALIGNMENT, CHANGE_FIGURES = "lidarcli.alignment", "lidarcli.figures"
"""Keys of the table of changes: how runs lie on each other, and what was counted, as JSON."""

ROWS_PER_GROUP = 50_000
"""Rows of a row group: small ones take three times as long to write, and longer to read; large ones take memory."""
WORTH_A_THREAD = 20_000
"""Rows left over in the end from which on a thread encodes them."""
ORDERED = ("log", "topic", "station", "sweep", "stamp")
"""Columns with statistics: rows are in their order, so that readers may skip row groups."""
MAX_PARTS = 500
"""Batches that wait as they came: thousands of tiny ones would take far more memory than their rows."""
MAX_BYTES = 8 << 20
"""Bytes of rows that wait in memory for the rows of an earlier topic; more are put on disk."""
BATCH_BYTES = 6 << 10
"""Bytes that a batch takes in addition to its rows: its columns, each with a type, buffers and a dictionary."""

BY_DATE = "date"
"""Layout with a folder for each table, and in it one for each day; without days it is `table`."""

_SPILLED = pa.ipc.IpcWriteOptions(compression="lz4")


def table_metadata(
    parameters: Mapping[str, Any],
    source: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    damage: Sequence[str] = (),
) -> dict[bytes, bytes]:
    """Return the schema metadata: version, parameters, source (name, size, format) and, only if there is any, damage.

    >>> table_metadata({"b": 1, "a": None})[b"lidarcli.parameters"]
    b'{"a": null, "b": 1}'
    """
    entries = {VERSION: __version__, PARAMETERS: _json(parameters)}
    if source is not None:
        entries[SOURCE] = _json(source)
    if damage:
        entries[DAMAGE] = _json(list(damage))
    # Names of files need not be UTF-8, but what Arrow keeps must be.
    return {key.encode(): value.encode(errors="replace") for key, value in entries.items()}


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, ensure_ascii=False)


class Output(Protocol):
    """A stream of bytes to write; it need not be able to seek."""

    def write(self, data: Any, /) -> int: ...

    def flush(self) -> None: ...


class RowSink(Protocol):
    """Takes rows of one table: a Parquet file or a stream."""

    def write(self, rows: pa.RecordBatch) -> None: ...


class ParquetSink:
    """A Parquet table that takes record batches of any size and writes row groups of equal size.

    A thread encodes and writes row groups, one at a time, while the caller computes the next one. The metadata is given at
    the end, because only then is it known whether the source was damaged.

    Parameters
    ----------
    out : stream that is open, which stays open; or path of a file, which `open` creates and leaving the context closes
    shown : name of the file in an `OutputError`, by default its path; errors of a stream pass as they are
    """

    def __init__(self, out: Output | pa.NativeFile | Path, schema: pa.Schema, shown: Place | None = None) -> None:
        self._out = out
        self._schema = schema
        self._shown = out if shown is None and isinstance(out, Path) else shown
        self._file: pa.OSFile | None = None
        self._writer: pq.ParquetWriter | None = None
        self._pending: list[pa.RecordBatch] = []
        self._rows = 0
        self._thread: Threads | None = None
        self._written: list[Future[None]] = []
        if not isinstance(out, Path):
            self._begin(out)

    def open(self) -> None:
        """Create the file of a path. Before, the caller arranges for `abandon`, because an interrupt may come any time."""
        assert isinstance(self._out, Path)
        with self._named():
            # Arrow's own file: the writing thread need not wait for the interpreter.
            self._file = pa.OSFile(os.fsencode(self._out), mode="wb")
            # Its first four bytes may be too many already.
            self._begin(self._file)

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows; whole row groups are written at once, the rest waits. May raise the error of an earlier row group."""
        if not rows.num_rows:
            return
        self._pending.append(rows)
        self._rows += rows.num_rows
        if len(self._pending) > MAX_PARTS:
            self._pending = self._joined().combine_chunks().to_batches()
        if self._rows >= ROWS_PER_GROUP:
            table = self._take(self._rows - self._rows % ROWS_PER_GROUP)
            # Two row groups in memory are enough.
            self._wait()
            self._hand_over(table)

    def hand_over(self) -> None:
        """Let the thread write what waits, where that is much: no more rows will come."""
        if self._rows >= WORTH_A_THREAD:
            self._hand_over(self._take(self._rows))

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Write what waits, then the schema and its metadata; a file of a path is whole afterwards."""
        assert self._writer is not None
        self._wait()
        with self._named():
            if self._rows:
                self._write(self._take(self._rows))
            full = self._schema.with_metadata(metadata)
            encoded = base64.b64encode(full.serialize().to_pybytes()).decode()
            footer = {key.decode(): value.decode() for key, value in metadata.items()}
            self._writer.add_key_value_metadata({**footer, "ARROW:schema": encoded})
            self._writer.close()
            self._stop()
            if self._file is not None:
                self._file.close()

    def abandon(self) -> None:
        """Let go of the table, whole or not."""
        self._pending.clear()
        self._stop()
        for each in (self._writer, self._file):
            if each is not None:
                with suppress(OSError, ValueError, pa.ArrowException):
                    each.close()

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            self.abandon()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.abandon()

    def _begin(self, out: Output | pa.NativeFile) -> None:
        floats, texts = _leaves(self._schema)
        # Bearings repeat from row to row, byte by byte: split into streams they would lose that.
        self._writer = pq.ParquetWriter(
            out if isinstance(out, pa.NativeFile) else pa.PythonFile(out, mode="w"),
            self._schema,
            compression="zstd",
            compression_level=-1,
            use_dictionary=texts,
            use_byte_stream_split=[path for path in floats if "theta" not in path],
            write_statistics=[name for name in ORDERED if name in self._schema.names],
            write_batch_size=1 << 16,
            # Written by `finish`, which knows the metadata: readers take the schema's own over the footer's.
            store_schema=False,
        )

    def _named(self) -> AbstractContextManager[None]:
        """Name the file in errors of the system, where it has a name."""
        return nullcontext() if self._shown is None else writing(self._shown)

    def _hand_over(self, table: pa.Table) -> None:
        if self._thread is None:
            self._thread = Threads("parquet")
        self._written.append(self._thread.submit(self._write, table))

    def _joined(self) -> pa.Table:
        return pa.Table.from_batches(self._pending, self._schema).unify_dictionaries()

    def _take(self, rows: int) -> pa.Table:
        """Remove the first `rows` of what waits and return them."""
        table = self._joined()
        # A copy, so that the rest does not keep the memory of the rows that are written.
        rest = table.slice(rows).combine_chunks()
        self._pending = rest.to_batches() if rest.num_rows else []
        self._rows = rest.num_rows
        return table.slice(0, rows)

    def _write(self, table: pa.Table) -> None:
        assert self._writer is not None
        self._writer.write_table(table, row_group_size=ROWS_PER_GROUP)

    def _wait(self) -> None:
        """Wait for the row groups that are being written, and raise their errors here."""
        with self._named():
            while self._written:
                self._written.pop(0).result()

    def _stop(self) -> None:
        """End the writing thread, once it is done with its row group."""
        if self._thread is not None:
            self._thread.close()


def _leaves(schema: pa.Schema) -> tuple[list[str], list[str]]:
    """Return the paths of the floating-point and of the text columns, nested ones included, as Parquet names them."""
    floats: list[str] = []
    texts: list[str] = []

    def visit(path: str, kind: Any) -> None:
        if pa.types.is_list(kind):
            visit(f"{path}.list.element", kind.value_type)
        elif pa.types.is_struct(kind):
            for field in kind:
                visit(f"{path}.{field.name}", field.type)
        elif pa.types.is_floating(kind):
            floats.append(path)
        elif pa.types.is_dictionary(kind) or pa.types.is_string(kind):
            texts.append(path)

    for field in schema:
        visit(field.name, field.type)
    return floats, texts


class TopicOrder:
    """Passes the rows of the first topic on at once and keeps those of other topics until `drain`.

    Logs interleave their topics, and tables are in the order of topics. What is more than `MAX_BYTES` waits in one file,
    which has no name, so that nothing is left behind whatever happens to the process.

    Parameters
    ----------
    sinks : name of a table → where its rows go, in the declared schema; rows of other tables are left out
    first : topic that sorts first, where that is known; without it every topic waits
    folder : folder of the file for rows that wait, by default that of temporary files
    stamps : unit of the stamps that come out, as of `in_unit`
    at_once : True to pass on all rows as they come, of whatever topic
    """

    def __init__(
        self,
        sinks: Mapping[str, RowSink],
        first: str | None,
        folder: Path | None = None,
        stamps: str = NS,
        at_once: bool = False,
    ) -> None:
        self._sinks = sinks
        self._first = first
        self._at_once = at_once
        self._folder = folder
        self._stamps = stamps
        self._file: IO[bytes] | None = None
        self._waiting: dict[tuple[str, str], list[pa.RecordBatch]] = {}
        """Table and topic → rows in memory."""
        self._size = 0
        self._places: dict[tuple[str, str], list[int]] = {}
        """Table and topic → places of its rows in the file, each part an Arrow stream of its own."""

    def write(self, table: str, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one table and topic, in the order in which they have to come out."""
        if table not in self._sinks:
            return
        rows = restamped(rows, self._stamps)
        if self._at_once or topic == self._first:
            self._sinks[table].write(rows)
            return
        self._waiting.setdefault((table, topic), []).append(rows)
        self._size += rows.nbytes + BATCH_BYTES
        if self._size > MAX_BYTES:
            self._put_away()

    def drain(self, table: str) -> None:
        """Pass on the rows of a table that wait, by the name of their topic."""
        if self._file is not None:
            with self._spilling():
                self._file.flush()
        for key in sorted({*self._places, *self._waiting}):
            if key[0] != table:
                continue
            for place in self._places.pop(key, ()):
                assert self._file is not None
                self._file.seek(place)
                for rows in pa.ipc.open_stream(self._file):
                    self._sinks[table].write(rows)
            for rows in self._waiting.pop(key, ()):
                self._sinks[table].write(rows)

    def _put_away(self) -> None:
        """Write what waits in memory to the file."""
        with self._spilling():
            if self._file is None:
                # Only long runs need this import.
                from tempfile import TemporaryFile

                self._file = TemporaryFile(dir=self._folder)  # noqa: SIM115 (closed by __exit__)
            for key, parts in self._waiting.items():
                self._places.setdefault(key, []).append(self._file.tell())
                with pa.ipc.new_stream(self._file, parts[0].schema, options=_SPILLED) as stream:
                    for rows in parts:
                        stream.write_batch(rows)
        self._waiting.clear()
        self._size = 0

    def _spilling(self) -> AbstractContextManager[None]:
        from tempfile import gettempdir

        return writing(f"a temporary file in {self._folder or gettempdir()}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._file is not None:
            # Rows in its buffer are no longer needed, and may not fit on the disk.
            with suppress(OSError):
                self._file.close()


def table_suffix(table: str) -> str:
    """Return the end of the names of files of a table, after the name of their log."""
    return f".{table}.parquet"


def table_paths(
    folder: Place, log: str, tables: Sequence[str], layout: str | None = None, date: str | None = None
) -> dict[str, Place]:
    """Return `DIR/<log>.<table>.parquet` of each table of a log, whose name may hold the folders below the one given.

    >>> table_paths(Path("out"), "trip/run", ["objects"], BY_DATE, "2026-11-22")["objects"].as_posix()
    'out/objects/date=2026-11-22/trip/run.parquet'
    """
    if layout is None:
        return {table: folder / f"{log}{table_suffix(table)}" for table in tables}
    # A log without a sweep has the day that readers of partitioned folders know.
    day = f"date={date or '__HIVE_DEFAULT_PARTITION__'}/" if layout == BY_DATE else ""
    return {table: folder / table / f"{day}{log}.parquet" for table in tables}


class TableFiles:
    """The tables of one log as files that appear together, when all of them are whole; without `publish` none appears.

    Parameters
    ----------
    paths : table → its file
    first_topic : topic that sorts first, where that is known
    overwrite : whether files that are there may be replaced
    stamps : unit of the stamps, as of `in_unit`
    """

    def __init__(
        self, paths: Mapping[str, Place], first_topic: str | None, overwrite: bool = True, stamps: str = NS
    ) -> None:
        self.paths = tuple(paths.values())
        self._new = NewFiles(self.paths, overwrite)
        self._sinks: dict[str, ParquetSink] = {}
        with ExitStack() as stack:
            stack.push(self._new)
            self._new.open()
            for table, path in paths.items():
                sink = ParquetSink(self._new.part(path), in_unit(SCHEMAS[table], stamps), path)
                stack.push(sink)
                sink.open()
                self._sinks[table] = sink
            spill = self.paths[0].parent
            spill_folder = spill if isinstance(spill, Path) else None
            self._order = TopicOrder(self._sinks, first_topic, spill_folder, stamps)
            stack.push(self._order)
            self.write = self._order.write
            self._stack = stack.pop_all()

    def publish(self, metadata: dict[bytes, bytes]) -> list[str]:
        """Make every table whole, then give all of them their names; notes as of `NewFiles.publish`."""
        for table, sink in self._sinks.items():
            self._order.drain(table)
            sink.hand_over()
        for sink in self._sinks.values():
            sink.finish(metadata)
        return self._new.publish()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stack.__exit__(kind, error, trace)
