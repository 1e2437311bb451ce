"""Tables read back, also those that another program has written in the meantime: every column of its declared type.

pandas, polars and DuckDB keep the values but not the types (text in place of a dictionary, int64 in place of int32, stamps
in microseconds): what can be cast without loss is cast, and all else is one line that names the file and the column.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import UnreadableError
from lidarcli.files.stores import Place, Url
from lidarcli.system.records import dataclass
from lidarcli.tabular.columns import are, integers, plain
from lidarcli.tabular.schemas import BACKGROUND, CHANGES, INFINITE, NULLABLE, SCHEMAS

T = TypeVar("T")

MAX_VALUE = 1e12
"""Greatest number of a table [m], [rad]: no place on Earth is farther, whatever the origin."""
ANY = "any"
"""Kind of a table whose columns are not checked."""
MAKERS = {"background": "background build", "tracks": "track", "trajectories": "track", "changes": "diff"} | dict.fromkeys(
    ("events", "zones", "counts"), "zones"
)
"""Kind of table → the command that writes it, where that is not `detect`."""
KINDS = {**SCHEMAS, "background": BACKGROUND, "changes": CHANGES}
"""Kind of table → the columns by which it is recognised."""
MAX_WHOLE = 1 << 53
"""Greatest count or index: up to here a double holds every whole number."""


@dataclass(frozen=True, slots=True, eq=False)
class TableInMemory:
    """A table in memory, which is read as a Parquet file is, under the name that a file of it would have."""

    name: str
    table: pa.Table | None
    """None where there is no such table."""

    def __str__(self) -> str:
        return self.name

    def exists(self) -> bool:
        """Return True if there is such a table."""
        return self.table is not None

    @property
    def schema_arrow(self) -> pa.Schema:
        """Return its columns with its metadata, as of a file."""
        assert self.table is not None
        return self.table.schema

    def read(self, columns: Sequence[str], use_threads: bool = False) -> pa.Table:
        """Return some columns, as of a file."""
        assert self.table is not None
        return self.table.select(list(columns))

    def iter_batches(self, columns: Sequence[str], use_threads: bool = False) -> Iterator[pa.RecordBatch]:
        """Yield some columns piece by piece, as of a file."""
        yield from self.read(columns).to_batches()


Readable = Place | TableInMemory
"""A table that can be read: a file, or one in memory."""


def read_columns(path: Readable, kind: str, schema: pa.Schema, names: Iterable[str] | None = None) -> pa.Table:
    """Read columns of a table in their declared types, by default all of the schema of its kind, with its metadata.

    Raises
    ------
    UnreadableError
        There is no such file, it is no Parquet file, or a column is missing, there twice, of a type or with values that
        it cannot have.
    """
    wanted = read_schema(schema, names)
    with _opened(path, kind) as file:
        refuse_columns(path, kind, file.schema_arrow.names, wanted.names)
        found = file.read(columns=wanted.names, use_threads=False)
        columns = [_fitted(path, kind, field, found[field.name]) for field in wanted]
        return pa.Table.from_arrays(columns, schema=wanted.with_metadata(file.schema_arrow.metadata))


def read_pieces(path: Readable, kind: str, schema: pa.Schema, names: Iterable[str]) -> Iterator[pa.RecordBatch]:
    """Yield columns as `read_columns` does, piece by piece, for a table that may be large."""
    wanted = read_schema(schema, names)
    with _opened(path, kind) as file:
        refuse_columns(path, kind, file.schema_arrow.names, wanted.names)
        for rows in file.iter_batches(columns=wanted.names, use_threads=False):
            columns = [
                _fitted(path, kind, field, pa.chunked_array([rows[field.name]])).combine_chunks() for field in wanted
            ]
            yield pa.RecordBatch.from_arrays(columns, schema=wanted)


@dataclass(frozen=True, slots=True, eq=False)
class StoredTable:
    """Columns of a table that may be large: each is read again whenever it is asked for, so that few are held."""

    path: Readable
    kind: str
    schema: pa.Schema
    """The columns, with the metadata of the file."""
    num_rows: int

    @staticmethod
    def of(path: Readable, kind: str, names: Iterable[str]) -> StoredTable:
        """Return columns of a table, once all of them have been checked as `read_columns` does."""
        wanted = {*names}
        rows = sum(piece.num_rows for piece in read_pieces(path, kind, SCHEMAS[kind], wanted))
        schema = read_schema(SCHEMAS[kind], wanted).with_metadata(schema_of(path).metadata)
        return StoredTable(path, kind, schema, rows)

    def __len__(self) -> int:
        return self.num_rows

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        return list(self.schema.names)

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        return pa.chunked_array(self.pieces(name), self.schema.field(name).type)

    def pieces(self, name: str) -> Iterator[pa.Array]:
        """Yield a column piece by piece."""
        return (rows[name] for rows in self.batches([name]))

    def batches(self, names: Iterable[str]) -> Iterator[pa.RecordBatch]:
        """Yield columns piece by piece; `UnreadableError` where the file has other rows by now."""
        left = self.num_rows
        for rows in read_pieces(self.path, self.kind, self.schema, names):
            if (left := left - len(rows)) < 0:
                break
            yield rows
        if left:
            raise UnreadableError(f"{self.path}: was written again while it was read; try once more")


def column_names(path: Readable, kind: str) -> list[str]:
    """Return the names of all columns of a table."""
    with _opened(path, kind) as file:
        return list(file.schema_arrow.names)


def schema_of(path: Readable) -> pa.Schema:
    """Return the columns of any table, with the metadata of the file."""
    with _opened(path, ANY) as file:
        return file.schema_arrow


def read_as_is(path: Readable, names: Sequence[str]) -> Iterator[pa.RecordBatch]:
    """Yield columns of any table piece by piece, as they are; `UnreadableError` where one is there twice."""
    with _opened(path, ANY) as file:
        refuse_columns(path, ANY, file.schema_arrow.names, names)
        for rows in file.iter_batches(columns=list(names), use_threads=False):
            yield rows.select(list(names))


def file_metadata(path: Readable) -> dict[str, str]:
    """Read the metadata of a table alone, as text."""
    with _opened(path, ANY) as file:
        return _as_text(file.schema_arrow.metadata)


def notes_of(table: pa.Table | StoredTable) -> dict[str, str]:
    """Return the metadata of a table that was read, as text."""
    return _as_text(table.schema.metadata)


def _as_text(metadata: dict[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in (metadata or {}).items()}


def parsed(text: str) -> Any:
    """Return a value of the metadata from its JSON; `ValueError` where it is none.

    >>> parsed('{"every": 1}')
    {'every': 1}
    """
    try:
        value = json.loads(text, parse_constant=_finite, parse_float=_finite)
    except RecursionError as err:
        raise ValueError("nested too deeply") from err
    level = [value]
    # What lidarcli writes has four levels.
    for _ in range(20):
        level = [
            item
            for part in level
            if isinstance(part, dict | list)
            for item in (part.values() if isinstance(part, dict) else part)
        ]
        if not level:
            return value
    raise ValueError("nested too deeply")


def note_value(notes: Mapping[str, str], key: str, kind: type[T]) -> T:
    """Return a value of the metadata, which any program may have written; an empty one where it is not of its `kind`."""
    try:
        value = parsed(notes.get(key, "null"))
    except ValueError:
        return kind()
    return value if isinstance(value, kind) else kind()


def _finite(text: str) -> float:
    """Return a number of JSON, which has no NaN and nothing infinite."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is no number of JSON")
    return number


@contextmanager
def _opened(path: Readable, kind: str) -> Iterator[pq.ParquetFile | TableInMemory]:
    """Open a file and close it in the end; errors of Arrow become one line."""
    if isinstance(path, TableInMemory):
        yield path
        return
    refused = "no background" if kind == "background" else "cannot be read as Parquet"
    if not path.exists():
        raise UnreadableError(f"{path}: no such file")
    if not path.is_file():
        raise UnreadableError(f"{path}: {refused}: it is no file")
    try:
        with _file(path) as source, pq.ParquetFile(source, pre_buffer=isinstance(path, Url)) as file:
            yield file
    except (OSError, pa.ArrowException, UnicodeDecodeError) as err:
        if kind == "background" and not _begins_as_parquet(path):
            raise UnreadableError(f"{path}: no Parquet file; give the table of lidarcli background build") from err
        raise UnreadableError(f"{path}: {refused}: {_first_line(err)}") from err


def _begins_as_parquet(path: Place) -> bool:
    try:
        with _file(path) as source:
            return bytes(source.read(4)) == b"PAR1"
    except (OSError, pa.ArrowException):
        return False


def _file(path: Place) -> pa.NativeFile:
    """Open a file of which parts are read."""
    if isinstance(path, Url):
        from lidarcli.files.stores import open_object

        return open_object(path)
    # A name need not be UTF-8, and Arrow takes such a one as bytes alone.
    return pa.OSFile(os.fsencode(path), "rb")


def read_schema(schema: pa.Schema, names: Iterable[str] | None = None) -> pa.Schema:
    """Return the schema of columns that are read: any may be null, as other programs write tables, too."""
    chosen = schema.names if names is None else set(names)
    return pa.schema([_nullable(field) for field in schema if field.name in chosen])


def _nullable(field: pa.Field) -> pa.Field:
    kind = field.type
    if pa.types.is_list(kind):
        kind = pa.list_(_nullable(kind.value_field))
    elif pa.types.is_struct(kind):
        kind = pa.struct([_nullable(part) for part in kind])
    return field.with_type(kind).with_nullable(True)


def refuse_columns(path: Readable, kind: str, there: list[str], wanted: Sequence[str]) -> None:
    """Refuse a file in which a wanted column is missing, or there twice."""
    missing = sorted(name for name in wanted if name not in there)
    if missing and isinstance(path, TableInMemory):
        raise UnreadableError(f"{path} (in memory): no column {', '.join(missing)}; leave the table all of its columns")
    if missing:
        maker = MAKERS.get(kind, "detect")
        other = next((name for name, schema in KINDS.items() if name != kind and {*schema.names} <= {*there}), None)
        if other is not None:
            raise UnreadableError(
                f"{path}: this is the {other} table of lidarcli {MAKERS.get(other, 'detect')}; "
                f"give the {kind} table of lidarcli {maker}"
            )
        raise UnreadableError(f"{path}: not a table of lidarcli {maker}: no column {', '.join(missing)}")
    twice = [name for name in wanted if there.count(name) > 1]
    if twice:
        raise UnreadableError(f"{path}: column {twice[0]} is there {there.count(twice[0])} times, not once")


def _fitted(path: Readable, kind: str, field: pa.Field, column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return the column in its declared type, its values checked."""
    place = f"{path}: column {field.name}"
    if not _castable(column.type, field.type):
        raise UnreadableError(f"{place} is {_words(column.type)}, not {_words(field.type)}")
    # Values are checked before they become single, as which some are infinite.
    checked = pa.float64() if pa.types.is_float32(field.type) else field.type
    try:
        column.validate(full=True)
        fitted = _cast(column, checked)
    except pa.ArrowException as err:
        raise UnreadableError(f"{place} holds a value that is no {_words(field.type)}: {_first_line(err)}") from err
    empty = fitted.null_count
    if empty and not pa.types.is_floating(field.type) and field.name not in NULLABLE[kind]:
        raise UnreadableError(f"{place} is empty (null) in {empty:,} of {len(fitted):,} rows")
    _refuse_values(place, field, fitted)
    return fitted if fitted.type.equals(field.type) else fitted.cast(field.type)


def _castable(found: pa.DataType, wanted: pa.DataType) -> bool:
    """Return whether values of one type can replace those of the other, if each of them fits."""
    if pa.types.is_null(found) or found.equals(wanted):
        return True
    if is_text(wanted):
        return is_text(found)
    if pa.types.is_integer(wanted) or pa.types.is_floating(wanted):
        return _is_number(found)
    if pa.types.is_timestamp(wanted):
        return bool(pa.types.is_timestamp(found))
    if pa.types.is_list(wanted):
        return _is_list(found) and _castable(found.value_type, wanted.value_type)
    if pa.types.is_struct(wanted) and pa.types.is_struct(found):
        names = [part.name for part in found]
        return all(names.count(part.name) == 1 and _castable(found.field(part.name).type, part.type) for part in wanted)
    return False


def _cast(column: pa.ChunkedArray, wanted: pa.DataType) -> pa.ChunkedArray:
    """Return the column in another type, without loss; NaN, which some programs write for null, is null."""
    if pa.types.is_dictionary(wanted):
        if column.type.equals(wanted) and not any(chunk.dictionary.null_count for chunk in column.chunks):
            return column
        return column.cast(pa.string()).dictionary_encode().cast(wanted)
    if pa.types.is_floating(column.type):
        import pyarrow.compute as pc

        nan = pc.is_nan(column)
        if pc.any(nan).as_py():
            column = pc.if_else(nan, pa.scalar(None, column.type), column)
    return column if column.type.equals(wanted) else column.cast(wanted)


def _refuse_values(place: str, field: pa.Field, column: pa.ChunkedArray) -> None:
    """Refuse impossible numbers: a negative count, a length that is not finite."""
    whole = pa.types.is_integer(field.type)
    if not whole and not pa.types.is_floating(field.type):
        return
    import pyarrow.compute as pc

    if field.name in INFINITE:
        column = pc.if_else(pc.is_inf(column), pa.scalar(None, column.type), column)
    least, most = (0, MAX_WHOLE) if whole else (-MAX_VALUE, MAX_VALUE)
    found = pc.min_max(column).as_py()
    if found["min"] is not None and found["min"] < least:
        raise UnreadableError(f"{place} holds {found['min']}; the least that it can be is {least:g}")
    if found["max"] is not None and found["max"] > most:
        raise UnreadableError(f"{place} holds {found['max']}; the most that it can be is {most:g}")


def is_text(kind: pa.DataType) -> bool:
    """Return whether values of a type are text, in whatever form."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind))


def _is_list(kind: pa.DataType) -> bool:
    return bool(
        pa.types.is_list(kind)
        or pa.types.is_large_list(kind)
        or pa.types.is_fixed_size_list(kind)
        or pa.types.is_list_view(kind)
        or pa.types.is_large_list_view(kind)
    )


def _words(kind: pa.DataType) -> str:
    """Return the name of a type for a message.

    >>> _words(pa.float64()), _words(pa.list_(pa.struct([("theta", pa.float64())])))
    ('double', 'list of struct (theta)')
    """
    if is_text(kind):
        return "text"
    if _is_list(kind):
        return f"list of {_words(kind.value_type)}"
    if pa.types.is_struct(kind):
        return f"struct ({', '.join(part.name for part in kind)})"
    if pa.types.is_timestamp(kind):
        return "timestamp"
    if pa.types.is_dictionary(kind):
        return f"dictionary of {_words(kind.value_type)}"
    return str(kind)


def _first_line(err: Exception) -> str:
    return (str(err).splitlines() or [type(err).__name__])[0]


AGAIN = "write both again with lidarcli track"
"""What to do where tables do not fit each other or their log."""


class TopicRows:
    """The rows of one topic of a table, taken in their order."""

    def __init__(self, path: Readable, table: str, columns: tuple[str, ...], topic: str) -> None:
        self._path = path
        self._schema = read_schema(SCHEMAS[table], columns)
        self._pieces = self._read(table, columns, topic)
        self._rows: pa.RecordBatch | None = None

    def until(self, sweep: int) -> pa.RecordBatch:
        """Return the rows that are left of the sweeps before this one."""
        taken = []
        while (rows := next(self._pieces, None) if self._rows is None else self._rows) is not None:
            count = int(np.searchsorted(integers(rows, "sweep"), sweep))
            if count:
                taken.append(rows.slice(0, count))
            self._rows = rows.slice(count) if count < rows.num_rows else None
            if self._rows is not None:
                break
        if len(taken) == 1:
            return taken[0]
        whole = pa.Table.from_batches(taken, self._schema).unify_dictionaries().combine_chunks()
        return whole.to_batches()[0] if taken else pa.RecordBatch.from_pylist([], self._schema)

    def rest(self) -> Iterator[pa.RecordBatch]:
        """Yield all rows that are left."""
        if self._rows is not None:
            yield self._rows
        yield from self._pieces

    def _read(self, table: str, columns: tuple[str, ...], topic: str) -> Iterator[pa.RecordBatch]:
        last = -1
        for piece in read_pieces(self._path, table, SCHEMAS[table], columns):
            own = are(piece["topic"], topic)
            rows = piece if own.all() else piece.take(plain(np.flatnonzero(own)))
            if not rows.num_rows:
                if last >= 0:
                    return
                continue
            sweeps = integers(rows, "sweep")
            if sweeps[0] < last or (np.diff(sweeps) < 0).any():
                raise UnreadableError(f"{self._path}: its rows are not in the order of topic and sweep; {AGAIN}")
            last = int(sweeps[-1])
            yield rows
