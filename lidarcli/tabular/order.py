"""Rows of several topics in the order of their names, though the log interleaves them, in bounded memory."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol, Self

import pyarrow as pa

from lidarcli.errors import OutputError
from lidarcli.newfiles import unwritable
from lidarcli.tabular.schemas import SCHEMAS

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
