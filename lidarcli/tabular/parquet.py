"""Streaming Parquet: large row groups whatever comes in."""

from __future__ import annotations

import base64
import contextlib
import os
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.newfiles import unwritable
from lidarcli.stores.url import Place
from lidarcli.threads import Beside

if TYPE_CHECKING:
    from concurrent.futures import Future

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
