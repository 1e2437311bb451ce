"""The cells of a block of lines: their places, and their numbers in bulk.

All numbers of a block are parsed as ONE column, whatever the number of beams. So a block of few long rows costs what
one of many short rows costs, ragged rows are no special case, and the result is row-major already. Where some cell
is spelled unusually (spaces, null), the C++ parser of pyarrow.csv takes over; where a cell is no number at all,
the search for its row halves the block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.blocks import pad
from lidarcli.sweeps import Bool, Float32, Int32, Int64

NEWLINE = 10
_NULLS = ("", "null", "None", "NULL", "none", "NA", "N/A", "n/a", "#N/A", "<NA>", "-", "--", ".nan", ".NaN")
_WORDS = {
    **{word.lower().encode(): None for word in _NULLS},
    b"nil": None,
    b"1.#qnan": None,
    b"-1.#ind": None,
    b".inf": np.inf,
    b"+.inf": np.inf,
    b"-.inf": -np.inf,
    b"1.#inf": np.inf,
    b"-1.#inf": -np.inf,
}
_ONE_BY_ONE = 64
"""Rows from which on the search for a bad row halves them."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """Numbers of rows of cells, one after the other."""

    values: NDArray[Any]
    """Values; NaN where a cell holds none."""
    empty: Bool | None
    """True for cells without a value (empty, null); None without such cells."""
    bad: dict[int, bytes]
    """Row → cell that is no number; all values of such a row are NaN."""


class Cells:
    """Places of the cells in a text of lines without quotes."""

    def __init__(self, text: bytes, separator: bytes) -> None:
        self.text = text
        self.separator = separator
        buffer = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero((buffer == separator[0]) | (buffer == NEWLINE)).astype(np.int32)
        last = np.flatnonzero(buffer[ends] == NEWLINE)
        self._ends = ends
        self._starts = np.empty_like(ends)
        self._starts[:1] = 0
        self._starts[1:] = ends[:-1] + 1
        self._first = np.empty_like(last)
        self._first[:1] = 0
        self._first[1:] = last[:-1] + 1
        self.count: Int64 = last - self._first + 1
        """(R,) Cells of each row; an empty line has one."""
        self.length = ends[last] - self._starts[self._first]
        """(R,) Bytes of each row."""
        self._regular = bool((self.count == self.count[:1]).all())

    def spans(self, rows: Int64, first: int | Int64, count: int | Int64) -> list[bytes]:
        """Return the text of `count` cells from cell `first` on, of each of `rows`; b'' for a count of 0."""
        most = len(self._ends) - 1
        begin = np.minimum(self._first[rows] + first, most)
        end = self._ends[np.minimum(begin + np.maximum(count, 1) - 1, most)]
        start = self._starts[begin]
        end = np.where(np.asarray(count) > 0, end, start)
        text = self.text
        # One slice per row: copying bytes, not looking at them.
        return [text[i:j] for i, j in zip(start.tolist(), end.tolist(), strict=True)]

    def column(self, rows: Int64, index: int) -> list[bytes]:
        """Return cell `index` of each of `rows`, which all have it."""
        return self.spans(rows, index, 1)

    def numbers(self, rows: Int64, first: int | Int64, count: Int64, dtype: type[np.floating]) -> Numbers:
        """Return the numbers in `count` cells from cell `first` on, of each of `rows` (ascending)."""
        starts, ends = self._bounds(rows, first, count)
        if not len(starts):
            return Numbers(np.empty(0, dtype), None, {})
        try:
            values, empty = _cast(self.text, starts, ends, dtype)
            return Numbers(values, empty, {})
        except ValueError:
            return parse_rows(self.spans(rows, first, count), count, self.separator, dtype)

    def codes(self, rows: Int64, index: int) -> tuple[Int64, list[bytes]]:
        """Return cell `index` of each of `rows` (ascending) as an index into the distinct cells, and these."""
        import pyarrow as pa

        starts, ends = self._bounds(rows, index, np.ones(len(rows), np.int64))
        if not len(rows):
            return np.empty(0, np.int64), []
        coded = _between(self.text, starts, ends, None, pa.binary()).dictionary_encode()
        codes = coded.indices.fill_null(0).to_numpy()[::2].astype(np.int64)
        return codes, coded.dictionary.to_pylist()

    def _bounds(self, rows: Int64, first: int | Int64, count: Int64) -> tuple[Int32, Int32]:
        """Return start and end of each of these cells, in their order."""
        if isinstance(first, int) and self._regular and len(count) and (count == count[0]).all():
            columns = slice(first, first + int(count[0]))
            shape = (len(self.count), int(self.count[0]))
            some = slice(None) if len(rows) == shape[0] else rows
            starts, ends = (self._starts.reshape(shape)[some, columns], self._ends.reshape(shape)[some, columns])
            return starts.ravel(), ends.ravel()
        begin = self._first[rows] + first - (np.cumsum(count) - count)
        index = np.repeat(begin, count) + np.arange(int(count.sum()))
        return self._starts[index], self._ends[index]


def pad_cells(cells: Cells, rows: Int64, first: Int64, count: Int64, width: int) -> Float32 | None:
    """Return (S, `width`) intensities: `count` cells of each of `rows` from its cell `first` on, padded with NaN.

    None where no row has any. A cell that is no number leaves its row without them: it costs no sweep.
    """
    if not count.any():
        return None
    padded = np.full((len(rows), width), np.nan, np.float32)
    mine = np.flatnonzero(count)
    values = pad(cells.numbers(rows[mine], first[mine], count[mine], np.float32).values, count[mine], 1.0)
    padded[mine, : values.shape[1]] = values
    return padded


def parse_rows(parts: Sequence[bytes], counts: Int64, separator: bytes, dtype: type[np.floating]) -> Numbers:
    """Parse rows of `counts` cells each; a row with a cell that is no number is named, not raised."""
    total = int(counts.sum())
    if not total:
        return Numbers(np.empty(0, dtype), None, {})
    try:
        some = [part for part, count in zip(parts, counts.tolist(), strict=True) if count]
        flat = b"\n".join(some).replace(separator, b"\n") + b"\n"
        values, empty = _parse_flat(flat, total, dtype)
        return Numbers(values, empty, {})
    except ValueError:
        pass
    if len(parts) > _ONE_BY_ONE:
        half = len(parts) // 2
        left = parse_rows(parts[:half], counts[:half], separator, dtype)
        right = parse_rows(parts[half:], counts[half:], separator, dtype)
        return _join(left, right, half)
    return _slow_rows(parts, counts, separator, dtype)


def parse_number(cell: bytes) -> float | None:
    """Return the number in a cell, in any spelling of logs; None for an empty one, ValueError for a text.

    >>> parse_number(b" -.inf "), parse_number(b"null")
    (-inf, None)
    """
    text = cell.strip().lower()
    if text in _WORDS:
        return _WORDS[text]
    if b"_" in text:
        raise ValueError(text)
    return float(text)


def shown(cell: bytes, most: int = 24) -> str:
    """Return a cell for a message: short, printable.

    >>> shown(b"abc")
    "'abc'"
    """
    text = cell.decode("utf-8", "replace").strip()
    text = "".join(char if char.isprintable() else "?" for char in text)
    return f"'{text[:most]}…'" if len(text) > most else f"'{text}'"


def not_a_number(cell: bytes) -> str:
    """Return the cause for a row with this cell, which is no number."""
    if cell.strip(b" \"'") in (b"...", b"\xe2\x80\xa6"):
        return "the array was abbreviated ('...') when the log was written (ros2 topic echo: --full-length)"
    return f"{shown(cell)} is not a number"


def _between(text: bytes, starts: Int32, ends: Int32, null: Bool | None, kind: Any) -> Any:
    """Return an Arrow array of type `kind` whose even entries are the cells between `starts` and `ends`.

    The text itself is the data of the array: a cell, the text between it and the next cell, which is null, the next
    cell, ... So nothing is copied or tokenised a second time. Cells that are `null` are null as well.
    """
    import pyarrow as pa

    slots = 2 * len(starts)
    offsets = np.empty(slots + 1, np.int32)
    offsets[0:-1:2] = starts
    offsets[1::2] = ends
    offsets[-1] = ends[-1]
    valid = np.full(-(-slots // 8), 0b01010101, np.uint8)
    if null is not None:
        bits = np.zeros(slots, np.bool_)
        bits[::2] = ~null
        valid = np.packbits(bits, bitorder="little")
    return pa.Array.from_buffers(kind, slots, [*map(pa.py_buffer, (valid, offsets, text))])


def _cast(text: bytes, starts: Int32, ends: Int32, dtype: type[np.floating]) -> tuple[NDArray[Any], Bool | None]:
    """Return the numbers of the cells between `starts` and `ends`; ValueError where one is spelled unusually."""
    import pyarrow as pa

    empty = starts == ends
    none = not empty.any()
    strings = _between(text, starts, ends, None if none else empty, pa.string())
    numbers = strings.cast(pa.float32() if dtype is np.float32 else pa.float64())
    values = np.frombuffer(numbers.buffers()[1], dtype, 2 * len(starts))[::2].copy()
    if none:
        return values, None
    values[empty] = np.nan
    return values, empty


def _parse_flat(text: bytes, total: int, dtype: type[np.floating]) -> tuple[NDArray[Any], Bool | None]:
    """Parse one cell per line; ValueError where any is no number."""
    bare = text.replace(b" ", b"")
    ends = np.flatnonzero(np.frombuffer(bare, np.uint8) == NEWLINE).astype(np.int32)
    if len(ends) == total:
        try:
            return _cast(bare, np.append(np.int32(0), ends[:-1] + np.int32(1)), ends, dtype)
        except ValueError:
            pass
    import pyarrow as pa
    from pyarrow import csv

    kind = pa.float32() if dtype is np.float32 else pa.float64()
    table = csv.read_csv(
        pa.py_buffer(text),
        read_options=csv.ReadOptions(column_names=["value"], block_size=1 << 20),
        parse_options=csv.ParseOptions(delimiter="\x01", quote_char=False, ignore_empty_lines=False),
        convert_options=csv.ConvertOptions(column_types={"value": kind}, null_values=list(_NULLS), check_utf8=False),
    )
    column = table.column(0)
    if len(column) != total:
        raise ValueError(f"{len(column)} cells where {total} were counted")
    values = column.to_numpy()
    return values, np.asarray(column.is_null()) if column.null_count else None


def _slow_rows(parts: Sequence[bytes], counts: Int64, separator: bytes, dtype: type[np.floating]) -> Numbers:
    """Parse rows cell by cell: the few among which one is bad, or spells its numbers oddly."""
    values: list[float] = []
    empty: list[bool] = []
    bad = {}
    for row, (part, count) in enumerate(zip(parts, counts.tolist(), strict=True)):
        if not count:
            continue
        numbers: list[float | None] = []
        for cell in part.split(separator):
            try:
                numbers.append(parse_number(cell))
            except ValueError:
                bad[row] = cell
                numbers = [np.nan] * count
                break
        values += [np.nan if number is None else number for number in numbers]
        empty += [number is None for number in numbers]
    with np.errstate(over="ignore"):
        flat = np.array(values, np.float64).astype(dtype)
    return Numbers(flat, np.array(empty, np.bool_) if any(empty) else None, bad)


def _join(left: Numbers, right: Numbers, rows: int) -> Numbers:
    empty = None
    if left.empty is not None or right.empty is not None:
        empty = np.concatenate([np.zeros(len(n.values), np.bool_) if n.empty is None else n.empty for n in (left, right)])
    bad = left.bad | {row + rows: cell for row, cell in right.bad.items()}
    return Numbers(np.concatenate([left.values, right.values]), empty, bad)
