"""Rows of several topics in the order of their names, though the log interleaves them, in bounded memory."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol, Self

import pyarrow as pa

from lidarcli.errors import OutputError
from lidarcli.tables.parquet import unwritable


class RowSink(Protocol):
    """Where rows go: a Parquet file or a stream."""

    def write(self, rows: pa.RecordBatch) -> None: ...


class TopicOrder:
    """Passes the rows of the first topic on at once and keeps those of the others on disk until `drain`.

    `first` is the topic that sorts first where that is known; without it every topic waits. The waiting files
    have no name, so nothing is left behind whatever happens to the process.
    """

    def __init__(self, sink: RowSink, schema: pa.Schema, first: str | None, folder: Path | None) -> None:
        self._sink = sink
        self._schema = schema
        self._first = first
        self._folder = folder
        self._waiting: dict[str, tuple[IO[bytes], pa.RecordBatchStreamWriter]] = {}

    def write(self, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one topic, in the order in which they have to come out."""
        if topic == self._first:
            self._sink.write(rows)
            return
        try:
            if topic not in self._waiting:
                file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 (closed by __exit__)
                options = pa.ipc.IpcWriteOptions(compression="lz4")
                self._waiting[topic] = file, pa.ipc.new_stream(file, self._schema, options=options)
            self._waiting[topic][1].write_batch(rows)
        except OSError as err:
            raise self._full(err) from err

    def drain(self) -> None:
        """Pass on the rows that wait, by the name of their topic."""
        for topic in sorted(self._waiting):
            file, writer = self._waiting[topic]
            try:
                writer.close()
                file.seek(0)
            except OSError as err:
                raise self._full(err) from err
            for rows in pa.ipc.open_stream(file):
                self._sink.write(rows)
            file.close()

    def _full(self, err: OSError) -> OutputError:
        return unwritable(f"a temporary file in {self._folder or tempfile.gettempdir()}", err)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        for file, _ in self._waiting.values():
            # What is still in its buffer may not fit on the disk, and is wanted no more.
            with contextlib.suppress(OSError):
                file.close()
