"""Tables as files: their metadata, Parquet streams, the order of topics, and files that appear together."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Protocol, Self

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli._version import __version__
from lidarcli.errors import OutputError
from lidarcli.machine import Beside
from lidarcli.newfiles import WholeFiles, new_files, refuse_lost, unwritable
from lidarcli.stores.url import Place
from lidarcli.tabular.schemas import SCHEMAS

if TYPE_CHECKING:
    from concurrent.futures import Future

VERSION, PARAMETERS, SOURCE, DAMAGE = (
    "lidarcli.version",
    "lidarcli.parameters",
    "lidarcli.source",
    "lidarcli.damage",
)


def table_metadata(
    parameters: Mapping[str, Any],
    source: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    damage: Sequence[str] = (),
) -> dict[bytes, bytes]:
    """Schema metadata: version, parameters, source (name, size, format) and, only when there is any, damage.

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


ROWS_PER_GROUP = 50_000
"""Small row groups cost a factor of three in writing time and more in reading; larger ones memory, two at a time."""
WORTH_A_THREAD = 20_000
"""Rows that are left over in the end."""
ORDERED = ("log", "topic", "station", "sweep", "stamp")
"""Columns by which rows are in order, so that statistics help readers to skip row groups; others are all over the place."""
MOST_PARTS = 500
"""Batches that wait as they came: thousands of tiny ones would take far more memory than their rows."""


class Output(Protocol):
    """What a stream of bytes must offer; it need not be able to seek."""

    def write(self, data: Any, /) -> int: ...

    def flush(self) -> None: ...


class ParquetSink:
    """A Parquet stream that takes record batches of any size and writes row groups of equal size.

    Row groups are encoded and written by a thread of their own, one at a time, while the caller computes the next one; what
    is left over in the end, too, if it is much. The schema metadata is given at the end, because only then is it known
    whether the source was damaged.
    """

    def __init__(self, out: Output | pa.NativeFile, schema: pa.Schema) -> None:
        self._schema = schema
        self._pending: list[pa.RecordBatch] = []
        self._rows = 0
        self._thread: Beside | None = None
        self._written: list[Future[None]] = []
        floats, texts = _leaves(schema)
        # Bearings repeat from row to row, byte by byte: split into streams they would lose that.
        self._writer = pq.ParquetWriter(
            out if isinstance(out, pa.NativeFile) else pa.PythonFile(out, mode="w"),
            schema,
            compression="zstd",
            compression_level=-1,
            use_dictionary=texts,
            use_byte_stream_split=[path for path in floats if "theta" not in path],
            write_statistics=[name for name in ORDERED if name in schema.names],
            write_batch_size=1 << 16,
            # Written by `finish`, which knows the metadata: readers take the schema's own over the footer's.
            store_schema=False,
        )

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows; whole row groups are on their way at once, the rest waits. May raise what befell the last one."""
        if not rows.num_rows:
            return
        self._pending.append(rows)
        self._rows += rows.num_rows
        if len(self._pending) > MOST_PARTS:
            self._pending = self._joined().combine_chunks().to_batches()
        if self._rows >= ROWS_PER_GROUP:
            table = self._take(self._rows - self._rows % ROWS_PER_GROUP)
            # Two row groups in memory are enough.
            self._settle()
            self._hand_over(table)

    def hand_over(self) -> None:
        """Have what waits written beside, where that is much: no more rows will come."""
        if self._rows >= WORTH_A_THREAD:
            self._hand_over(self._take(self._rows))

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Write what waits, then the schema and its metadata."""
        self._settle()
        if self._rows:
            self._write(self._take(self._rows))
        full = self._schema.with_metadata(metadata)
        encoded = base64.b64encode(full.serialize().to_pybytes()).decode()
        footer = {key.decode(): value.decode() for key, value in metadata.items()}
        self._writer.add_key_value_metadata({**footer, "ARROW:schema": encoded})
        self._writer.close()
        self._stop()

    def abandon(self) -> None:
        """Let go of the stream without making it whole."""
        self._pending.clear()
        self._stop()
        with contextlib.suppress(OSError, ValueError, pa.ArrowException):
            self._writer.close()

    def _hand_over(self, table: pa.Table) -> None:
        if self._thread is None:
            self._thread = Beside("parquet")
        self._written.append(self._thread.submit(self._write, table))

    def _joined(self) -> pa.Table:
        return pa.Table.from_batches(self._pending, self._schema).unify_dictionaries()

    def _take(self, rows: int) -> pa.Table:
        """The first `rows` of what waits."""
        table = self._joined()
        # A copy, so that the rest does not keep the memory of the rows that are written.
        rest = table.slice(rows).combine_chunks()
        self._pending = rest.to_batches() if rest.num_rows else []
        self._rows = rest.num_rows
        return table.slice(0, rows)

    def _write(self, table: pa.Table) -> None:
        self._writer.write_table(table, row_group_size=ROWS_PER_GROUP)

    def _settle(self) -> None:
        """Wait for the row groups that are being written; their errors are raised here."""
        while self._written:
            self._written.pop(0).result()

    def _stop(self) -> None:
        """End the writing thread; what it is at comes to its end first."""
        if self._thread is not None:
            self._thread.close()


class TableFile:
    """A table as a Parquet file.

    Parameters
    ----------
    path : where it is written
    schema : of the table
    shown : how errors call it; by default its path
    """

    def __init__(self, path: Path, schema: pa.Schema, shown: Place | None = None) -> None:
        self._path = path
        self._schema = schema
        self._shown = shown or path
        self._file: pa.OSFile | None = None
        self._sink: ParquetSink | None = None

    def open(self) -> None:
        """Create the file. Whoever calls this has seen to `__exit__` before, for an interrupt comes any time."""
        try:
            # Arrow's own file: the writing thread need not wait for the interpreter.
            self._file = pa.OSFile(os.fsencode(self._path), mode="wb")
            # Its first four bytes may be too many already.
            self._sink = ParquetSink(self._file, self._schema)
        except OSError as err:
            raise unwritable(self._shown, err) from err

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows of the table."""
        assert self._sink is not None
        try:
            self._sink.write(rows)
        except OSError as err:
            raise unwritable(self._shown, err) from err

    def hand_over(self) -> None:
        """No more rows will come: see `ParquetSink.hand_over`."""
        assert self._sink is not None
        self._sink.hand_over()

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Make the file whole."""
        assert self._sink is not None
        assert self._file is not None
        try:
            self._sink.finish(metadata)
            self._file.close()
        except OSError as err:
            raise unwritable(self._shown, err) from err

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        """Let go of the file, whatever happened."""
        if self._sink is not None:
            self._sink.abandon()
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()


def _leaves(schema: pa.Schema) -> tuple[list[str], list[str]]:
    """Paths of the floating-point and of the text columns, nested ones included, as Parquet names them."""
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


MOST_BYTES = 32 << 20
"""Rows that wait in memory before they are put on disk: thousands of topics with a few rows each never are."""
BATCH_BYTES = 6 << 10
"""What a batch takes beside its rows: its columns, each with a type, buffers and a dictionary."""

_OPTIONS = pa.ipc.IpcWriteOptions(compression="lz4")


class RowSink(Protocol):
    """Where rows go: a Parquet file or a stream."""

    def write(self, rows: pa.RecordBatch) -> None: ...


class TopicOrder:
    """Passes the rows of the first topic on at once and keeps those of the others until `drain`.

    `first` is the topic that sorts first where that is known; without it every topic waits. What is more than `MOST_BYTES`
    waits in one file, which has no name, so that nothing is left behind whatever happens to the process.
    """

    def __init__(self, sink: RowSink, schema: pa.Schema, first: str | None, folder: Path | None) -> None:
        self._sink = sink
        self._schema = schema
        self._first = first
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._waiting: dict[str, list[pa.RecordBatch]] = {}
        self._size = 0
        self._places: dict[str, list[int]] = {}
        """Where in the file the rows of a topic are, each part an Arrow stream of its own."""

    def write(self, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one topic, in the order in which they have to come out."""
        if topic == self._first:
            self._sink.write(rows)
            return
        self._waiting.setdefault(topic, []).append(rows)
        self._size += rows.nbytes + BATCH_BYTES
        if self._size > MOST_BYTES:
            self._put_away()

    def drain(self) -> None:
        """Pass on the rows that wait, by the name of their topic."""
        try:
            if self._file is not None:
                self._file.flush()
        except OSError as err:
            raise self._full(err) from err
        for topic in sorted({*self._places, *self._waiting}):
            for place in self._places.pop(topic, ()):
                assert self._file is not None
                self._file.seek(place)
                for rows in pa.ipc.open_stream(self._file):
                    self._sink.write(rows)
            for rows in self._waiting.pop(topic, ()):
                self._sink.write(rows)
        self._size = 0

    def _put_away(self) -> None:
        """Write what waits in memory to the file."""
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 (closed by __exit__)
            for topic, parts in self._waiting.items():
                self._places.setdefault(topic, []).append(self._file.tell())
                with pa.ipc.new_stream(self._file, self._schema, options=_OPTIONS) as stream:
                    for rows in parts:
                        stream.write_batch(rows)
        except OSError as err:
            raise self._full(err) from err
        self._waiting.clear()
        self._size = 0

    def _full(self, err: OSError) -> OutputError:
        return unwritable(f"a temporary file in {self._folder or tempfile.gettempdir()}", err)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._file is not None:
            # What is still in its buffer may not fit on the disk, and is wanted no more.
            with contextlib.suppress(OSError):
                self._file.close()


class TopicOrders:
    """The same for the rows of several tables, each with the sink of its name; rows of other tables are left out."""

    def __init__(self, sinks: Mapping[str, RowSink], first: str | None) -> None:
        self._orders = {table: TopicOrder(sink, SCHEMAS[table], first, None) for table, sink in sinks.items()}

    def write(self, rows: Iterable[tuple[str, str, pa.RecordBatch]]) -> None:
        """Take (table, topic, rows), those of a table and topic in their order."""
        for table, topic, some in rows:
            if table in self._orders:
                self._orders[table].write(topic, some)

    def drain(self) -> None:
        """Pass on the rows that wait."""
        for order in self._orders.values():
            order.drain()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for order in self._orders.values():
            order.__exit__(None, None, None)


BY_TABLE, BY_DATE = "table", "date"
"""Layouts beside that of files with the name of their log: a folder for each table, and in it one for each day."""
NO_DATE = "__HIVE_DEFAULT_PARTITION__"
"""What readers of partitioned folders call the day of a log without a sweep."""


def table_suffix(table: str) -> str:
    """How the names of files of a table end, after the name of their log."""
    return f".{table}.parquet"


def table_path(
    folder: Place, log: str, table: str, layout: str | None = None, date: str | None = None
) -> Place:
    """`DIR/<log>.<table>.parquet`; `log` may hold the folders below the one that was given.

    >>> table_path(Path("out"), "trip/run", "objects", BY_DATE, "2026-11-22").as_posix()
    'out/objects/date=2026-11-22/trip/run.parquet'
    """
    if layout is None:
        return folder / f"{log}{table_suffix(table)}"
    day = f"date={date or NO_DATE}/" if layout == BY_DATE else ""
    return folder / table / f"{day}{log}.parquet"


def table_paths(
    folder: Place, log: str, tables: Sequence[str], layout: str | None = None, date: str | None = None
) -> dict[str, Place]:
    """Table → where that of one log belongs, as of `table_path`."""
    return {table: table_path(folder, log, table, layout, date) for table in tables}


class TableFiles:
    """Writers of the named tables of one log; leaving without `publish` leaves no file.

    Parameters
    ----------
    paths : table → where it belongs
    first_topic : the topic that sorts first, where that is known
    overwrite : whether files that are there may be replaced
    """

    def __init__(self, paths: Mapping[str, Place], first_topic: str | None, overwrite: bool = True) -> None:
        self.paths = tuple(paths.values())
        self.sizes: list[int] = []
        """Bytes of each file, once it is published."""
        self._new: dict[Place, WholeFiles] = {}
        self._files: list[TableFile] = []
        self._orders: dict[str, TopicOrder] = {}
        with ExitStack() as stack:
            for folder in dict.fromkeys(path.parent for path in paths.values()):
                new = new_files([path for path in paths.values() if path.parent == folder], overwrite)
                stack.callback(new.close)
                new.open()
                self._new[folder] = new
            for table, path in paths.items():
                file = TableFile(self._new[path.parent].part(path), SCHEMAS[table], path)
                stack.push(file)
                file.open()
                spill = path.parent if isinstance(path, Path) else None
                order = TopicOrder(file, SCHEMAS[table], first_topic, spill)
                self._files.append(file)
                self._orders[table] = stack.enter_context(order)
            self._stack = stack.pop_all()

    def write(self, table: str, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one topic for one table."""
        self._orders[table].write(topic, rows)

    def publish(self, metadata: dict[bytes, bytes]) -> list[str]:
        """Make every table whole, then give all of them their names; notes as of `NewFiles.publish`."""
        for order, file in zip(self._orders.values(), self._files, strict=True):
            order.drain()
            file.hand_over()
        for file in self._files:
            file.finish(metadata)
        self.sizes = [self._new[path.parent].part(path).stat().st_size for path in self.paths]
        return [note for new in self._new.values() for note in new.publish()]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)
        for folder in self._new:
            if isinstance(folder, Path):
                refuse_lost(error, folder)
