"""Streaming Parquet: large row groups whatever comes in, and a file that has its name only when whole."""

from __future__ import annotations

import base64
import contextlib
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import OutputError

ROWS_PER_GROUP = 100_000
"""Small row groups cost a factor of three in writing time and more in reading."""


class Output(Protocol):
    """What a stream of bytes must offer; it need not be able to seek."""

    def write(self, data: Any, /) -> int: ...

    def flush(self) -> None: ...


class ParquetSink:
    """A Parquet stream that takes record batches of any size and writes row groups of equal size.

    The schema metadata is given at the end, because only then is it known whether the source was damaged.
    """

    def __init__(self, out: Output, schema: pa.Schema) -> None:
        self._schema = schema
        self._pending: list[pa.RecordBatch] = []
        self._rows = 0
        floats, texts = _leaves(schema)
        self._writer = pq.ParquetWriter(
            pa.PythonFile(out, mode="w"),
            schema,
            compression="zstd",
            compression_level=1,
            use_dictionary=texts,
            use_byte_stream_split=floats,
            # Written by `finish`, which knows the metadata: readers take the schema's own over the footer's.
            store_schema=False,
        )

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows; whole row groups are written at once, the rest waits."""
        self._pending.append(rows)
        self._rows += rows.num_rows
        if self._rows >= ROWS_PER_GROUP:
            self._flush(self._rows - self._rows % ROWS_PER_GROUP)

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Write what waits, then the schema and its metadata."""
        if self._rows:
            self._flush(self._rows)
        full = self._schema.with_metadata(metadata)
        encoded = base64.b64encode(full.serialize().to_pybytes()).decode()
        footer = {key.decode(): value.decode() for key, value in metadata.items()}
        self._writer.add_key_value_metadata({**footer, "ARROW:schema": encoded})
        self._writer.close()

    def abandon(self) -> None:
        """Let go of the stream without making it whole."""
        self._pending.clear()
        with contextlib.suppress(OSError, ValueError, pa.ArrowException):
            self._writer.close()

    def _flush(self, rows: int) -> None:
        table = pa.Table.from_batches(self._pending, self._schema).unify_dictionaries()
        # A copy, so that the rest does not keep the memory of the rows that were written.
        rest = table.slice(rows).combine_chunks()
        self._pending = rest.to_batches() if rest.num_rows else []
        self._rows = rest.num_rows
        self._writer.write_table(table.slice(0, rows), row_group_size=ROWS_PER_GROUP)


class PartFile:
    """A Parquet file under a temporary name beside its final one; `publish` gives it the final name."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.path = path
        self._part = path.with_name(f".{path.name}.part")
        try:
            self._file = self._part.open("wb")
        except OSError as err:
            raise unwritable(path, err) from err
        self._sink = ParquetSink(self._file, schema)

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows of the table."""
        try:
            self._sink.write(rows)
        except OSError as err:
            raise unwritable(self.path, err) from err

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Make the temporary file whole."""
        try:
            self._sink.finish(metadata)
            self._file.close()
        except OSError as err:
            raise unwritable(self.path, err) from err

    def publish(self) -> None:
        """Give the whole file its name."""
        try:
            self._part.replace(self.path)
        except OSError as err:
            raise unwritable(self.path, err) from err

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        """Remove the temporary file, whatever happened; a published one has gone already."""
        self._sink.abandon()
        with contextlib.suppress(OSError):
            self._file.close()
        with contextlib.suppress(OSError):
            self._part.unlink(missing_ok=True)


def unwritable(path: Path | str, err: OSError) -> OutputError:
    """The error of an output that the system refuses, as one line."""
    return OutputError(f"cannot write {path}: {err.strerror or str(err).splitlines()[0]}")


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
