"""Tables as streams of JSON lines, CSV, Arrow or Parquet."""

from __future__ import annotations

import csv
import io
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.errors import OutputError
from lidarcli.tabular.writing import Output, ParquetSink


class RowStream(ABC):
    """A stream of rows of one schema, made of an output, the schema and the metadata known by then."""

    def __init__(self, out: Output, schema: pa.Schema, metadata: dict[bytes, bytes]) -> None:
        self._out = out

    @abstractmethod
    def write(self, rows: pa.RecordBatch) -> None:
        """Write the rows at once, for programs that read along."""

    def notes(self) -> list[str]:
        """Return, once, what a user should know of the rows."""
        return []

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Complete the stream."""
        self._out.flush()


class NdjsonStream(RowStream):
    """One JSON object per row and line; stamps in ISO 8601, null for what is undefined."""

    def write(self, rows: pa.RecordBatch) -> None:
        lines = [_compact(dict(zip(rows.schema.names, values, strict=True))) for values in _python_rows(rows)]
        if lines:
            self._out.write(("\n".join(lines) + "\n").encode())
            self._out.flush()


class CsvStream(RowStream):
    """A header line, then one line per row; lists as JSON text, empty for what is undefined."""

    def __init__(self, out: Output, schema: pa.Schema, metadata: dict[bytes, bytes]) -> None:
        super().__init__(out, schema, metadata)
        self._formulas: dict[str, bool] = {}
        """Columns with text that a spreadsheet takes for a formula → whether a note on it was given."""
        self._nested = [index for index, field in enumerate(schema) if pa.types.is_nested(field.type)]
        self._lines([schema.names])

    def write(self, rows: pa.RecordBatch) -> None:
        lines = [list(values) for values in _python_rows(rows)]
        for line in lines:
            for index in self._nested:
                line[index] = "" if line[index] is None else _compact(line[index])
        self._lines(lines)
        for field, column in zip(rows.schema, rows.columns, strict=True):
            if field.name not in self._formulas and _has_formula(column):
                self._formulas[field.name] = False

    def notes(self) -> list[str]:
        """Return a note on columns that a spreadsheet would run, once."""
        new = [name for name, was_noted in self._formulas.items() if not was_noted]
        self._formulas |= dict.fromkeys(new, True)
        if not new:
            return []
        return [
            f"text of column {', '.join(new)} begins as a formula does, which a spreadsheet would run: "
            "import such columns as text; for other programs they are as the log has them"
        ]

    def _lines(self, lines: list[list[Any]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        self._out.write(text.getvalue().encode())
        self._out.flush()


def _has_formula(column: pa.Array) -> bool:
    """Return True if any text begins as spreadsheets take for a formula."""
    # Other formats should not wait for this import.
    import pyarrow.compute as pc

    texts = column.dictionary if pa.types.is_dictionary(column.type) else column
    return pa.types.is_string(texts.type) and bool(pc.any(pc.match_substring_regex(texts, "^[=+@\t\r-]")).as_py())


class ArrowStream(RowStream):
    """The Arrow IPC stream format; its schema comes first, with the metadata known by then."""

    def __init__(self, out: Output, schema: pa.Schema, metadata: dict[bytes, bytes]) -> None:
        super().__init__(out, schema, metadata)
        self._schema = schema.with_metadata(metadata)
        self._writer = pa.ipc.new_stream(pa.PythonFile(out, mode="w"), self._schema)

    def write(self, rows: pa.RecordBatch) -> None:
        self._writer.write_batch(rows.replace_schema_metadata(self._schema.metadata))
        self._out.flush()

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Write the end of the stream."""
        self._writer.close()
        self._out.flush()


class ParquetStream(RowStream):
    """A Parquet file on a stream that cannot seek."""

    def __init__(self, out: Output, schema: pa.Schema, metadata: dict[bytes, bytes]) -> None:
        super().__init__(out, schema, metadata)
        self._sink = ParquetSink(out, schema)

    def write(self, rows: pa.RecordBatch) -> None:
        """Take rows; whole row groups are written at once."""
        self._sink.write(rows)

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        """Write the rows that wait, and the footer."""
        self._sink.finish(metadata)
        self._out.flush()


FORMATS: dict[str, Callable[[Output, pa.Schema, dict[bytes, bytes]], RowStream]] = {
    "ndjson": NdjsonStream,
    "csv": CsvStream,
    "arrow": ArrowStream,
    "parquet": ParquetStream,
}


def write_stream(
    out: Output, kind: str, name: str, schema: pa.Schema, metadata: dict[bytes, bytes], pieces: Iterable[pa.RecordBatch]
) -> tuple[int, list[str]]:
    """Write a whole table to a stream of a format of `FORMATS`; return the number of rows, and notes on them.

    `name` is that of the stream in errors.
    """
    stream = FORMATS[kind](CountingOutput(out, name), schema, metadata)
    count = 0
    for rows in pieces:
        stream.write(rows)
        count += rows.num_rows
    stream.finish(metadata)
    return count, stream.notes()


class CountingOutput(io.RawIOBase):
    """A pipe that knows its position, as the writers of Arrow and Parquet need it. Errors become `OutputError`.

    A reader that went away (`| head`) is no error of the output: `BrokenPipeError` passes through.
    """

    def __init__(self, out: Output, name: str) -> None:
        self._out = out
        self._name = name
        self._position = 0
        self._discarded = False

    def write(self, data: Any) -> int:
        """Write all of `data`."""
        size = memoryview(data).nbytes
        if not self._discarded:
            with self._guarded():
                self._out.write(data)
        self._position += size
        return size

    def writable(self) -> bool:
        """Return True."""
        return True

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self._position

    def flush(self) -> None:
        """Flush the output."""
        if not self._discarded:
            with self._guarded():
                self._out.flush()

    def discard(self) -> None:
        """Write nothing more: it would only end a stream that is not whole."""
        self._discarded = True

    def close(self) -> None:
        """Leave the stream below open: it belongs to the process."""

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            raise
        except OSError as err:
            raise OutputError(f"cannot write {self._name}: {err.strerror or err}") from err


def _python_rows(rows: pa.RecordBatch) -> Any:
    """Return tuples of plain values, stamps as text."""
    columns: list[list[Any]] = []
    for field, values in zip(rows.schema, rows.columns, strict=True):
        if pa.types.is_timestamp(field.type):
            unit = field.type.unit
            stamps = values.view(pa.int64()).to_numpy(zero_copy_only=False).astype(f"datetime64[{unit}]")
            texts = np.datetime_as_string(stamps, unit=unit)
            there = values.is_valid().to_pylist()
            columns.append([f"{text}Z" if known else None for text, known in zip(texts, there, strict=True)])
        elif (text := _with_singles(field.type, pa.string())) != field.type:
            # The shortest decimals: as doubles, 0.1 has 17 digits.
            columns.append(values.cast(text).cast(_with_singles(field.type, pa.float64())).to_pylist())
        else:
            columns.append(values.to_pylist())
    return zip(*columns, strict=True)


def _with_singles(kind: pa.DataType, other: pa.DataType) -> pa.DataType:
    """Return a type with another in the place of numbers of single precision, also inside of lists and structs."""
    if pa.types.is_list(kind):
        item = kind.value_field
        return pa.list_(item.with_type(_with_singles(item.type, other)))
    if pa.types.is_struct(kind):
        return pa.struct([part.with_type(_with_singles(part.type, other)) for part in kind])
    return other if pa.types.is_float32(kind) else kind


def _compact(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
