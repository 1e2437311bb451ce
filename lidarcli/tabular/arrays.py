"""numpy arrays as Arrow arrays, on the same memory.

`pyarrow.array` would do, but it imports pandas to look at its argument, which costs half a second at start; what
needs `pyarrow.compute` costs a tenth of that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def plain(values: NDArray[Any], kind: pa.DataType | None = None) -> pa.Array:
    """Return values without nulls; `kind` may give a type of the same size another meaning (a stamp)."""
    return _array(values, None, kind)


def masked(values: NDArray[Any], null: NDArray[np.bool_], kind: pa.DataType | None = None) -> pa.Array:
    """Return values that are null where `null` is true; `kind` as of `plain`."""
    return _array(values, ~null, kind)


def answers(values: NDArray[np.int8]) -> pa.BooleanArray:
    """Return yes or no, null where a value is negative.

    >>> answers(np.array([1, 0, -1], np.int8)).to_pylist()
    [True, False, None]
    """
    bits, known = (pa.py_buffer(np.packbits(one, bitorder="little")) for one in (values > 0, values >= 0))
    return pa.Array.from_buffers(pa.bool_(), len(values), [known, bits])


def floats(values: NDArray[np.floating[Any]], kind: pa.DataType | None = None) -> pa.Array:
    """Return numbers of double precision, or of another `kind`, null for NaN.

    >>> floats(np.array([1.5, np.nan])).to_pylist()
    [1.5, None]
    """
    kind = kind or _DOUBLE
    # What single precision cannot hold, such as a bearing of a broken header, is infinite.
    with np.errstate(over="ignore"):
        numbers = np.ascontiguousarray(values, kind.to_pandas_dtype())
    if not any_nan(numbers):
        return plain(numbers, kind)
    return _array(numbers, ~np.isnan(numbers), kind)


def codes(values: NDArray[Any], names: Sequence[str]) -> pa.DictionaryArray:
    """Return a column of names from small integers, null where one is negative.

    >>> codes(np.array([1, 0, -1], np.int8), ("O", "S")).to_pylist()
    ['S', 'O', None]
    """
    index = np.ascontiguousarray(values, np.int32)
    none = None if values.dtype.kind == "u" else index < 0
    indices = plain(index) if none is None or not none.any() else masked(index, none)
    return pa.DictionaryArray.from_arrays(indices, _texts(tuple(names)), safe=False)


def names_of(values: NDArray[np.uint8], names: Sequence[str]) -> pa.StringArray:
    """Return a column of names as plain text, for columns inside lists, where not every reader takes dictionaries.

    >>> names_of(np.array([1, 0, 1], np.uint8), ("O", "AS")).to_pylist()
    ['AS', 'O', 'AS']
    """
    offsets, text = spelled(values, tuple(name.encode() for name in names))
    return pa.StringArray.from_buffers(len(values), pa.py_buffer(offsets), pa.py_buffer(text))


def held(column: pa.Array | pa.ChunkedArray) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return (K,) numbers or answers of a column and where it is not null; as `to_numpy`, which imports pandas.

    >>> held(answers(np.array([1, 0, -1], np.int8)))
    (array([ True, False, False]), array([ True,  True, False]))
    """
    if isinstance(column, pa.ChunkedArray):
        chunks = [held(chunk) for chunk in column.chunks] or [(np.empty(0), np.empty(0, bool))]
        values, there = zip(*chunks, strict=True)
        return (np.concatenate(values), np.concatenate(there)) if len(chunks) > 1 else chunks[0]
    known, data = column.buffers()
    part = slice(column.offset, column.offset + len(column))
    there = _bits(known)[part] if column.null_count else np.ones(len(column), bool)
    if pa.types.is_boolean(column.type):
        return _bits(data)[part], there
    return np.frombuffer(b"" if data is None else data, column.type.to_pandas_dtype())[part], there


def numbers(column: pa.Array | pa.ChunkedArray) -> NDArray[np.float64]:
    """Return (K,) numbers of a column, NaN where it is null.

    >>> numbers(floats(np.array([1.5, np.nan])))
    array([1.5, nan])
    """
    values, there = held(column)
    return np.where(there, values.astype(np.float64, copy=False), np.nan)


def integers(rows: pa.RecordBatch, name: str) -> NDArray[np.int64]:
    """Return a column of whole numbers or stamps [ns]; nulls are -1."""
    column = rows[name]
    if pa.types.is_timestamp(column.type):
        column = column.view(pa.int64())
    values, there = held(column)
    return np.where(there, values, -1)


def are(column: pa.DictionaryArray | pa.ChunkedArray, word: str) -> NDArray[np.bool_]:
    """Return (K,) where a column of names has this one.

    >>> are(codes(np.array([1, 0, -1], np.int8), ("O", "S")), "S")
    array([ True, False, False])
    """
    if isinstance(column, pa.ChunkedArray):
        return np.concatenate([np.empty(0, bool), *(are(chunk, word) for chunk in column.chunks)])
    names = column.dictionary.to_pylist()
    code, there = held(column.indices)
    return there & (code == names.index(word)) if word in names else np.zeros(len(column), bool)


def _bits(data: pa.Buffer) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little").view(bool)
    return found


def any_nan(values: NDArray[np.floating[Any]]) -> bool:
    """Tell whether any of the (K,) values is NaN."""
    # The minimum is NaN where any value is: one pass, where `isnan(...).any()` takes two.
    return math.isnan(np.minimum.reduce(values, initial=0.0))


def spelled(codes: NDArray[np.uint8], names: tuple[bytes, ...]) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return the offsets of the names of (K,) codes, (K + 1,), and their letters."""
    offsets = np.zeros(len(codes) + 1, np.int32)
    np.cumsum(np.array([*map(len, names)], np.int32)[codes], out=offsets[1:])
    text = codes.tobytes()
    # No name holds the control characters that stand for the names still to come.
    for code, name in enumerate(names):
        text = text.replace(bytes([code]), name)
    return offsets, np.frombuffer(text, np.uint8)


@lru_cache(maxsize=256)
def _texts(names: tuple[str, ...]) -> pa.StringArray:
    encoded = [name.encode("utf-8", "replace") for name in names]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(names), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))


_DOUBLE = pa.float64()


def _array(values: NDArray[Any], valid: NDArray[np.bool_] | None, kind: pa.DataType | None) -> pa.Array:
    values = np.ascontiguousarray(values)
    bitmap = None if valid is None else pa.py_buffer(np.packbits(valid, bitorder="little"))
    nulls = 0 if valid is None else -1
    kind = kind or pa.from_numpy_dtype(values.dtype)
    assert kind.bit_width == 8 * values.itemsize, f"{values.dtype} is no {kind}"
    return pa.Array.from_buffers(kind, len(values), [bitmap, pa.py_buffer(values)], nulls)
