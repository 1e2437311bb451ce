"""numpy arrays as Arrow arrays, on the same memory.

`pyarrow.array` would do, but it imports pandas to look at its argument, which costs half a second at start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def plain(values: NDArray[Any], kind: pa.DataType | None = None) -> pa.Array:
    """Values without nulls; `kind` may give a type of the same size another meaning (a stamp)."""
    return _array(values, None, kind)


def masked(values: NDArray[Any], null: NDArray[np.bool_]) -> pa.Array:
    """Values that are null where `null` says so."""
    return _array(values, ~null, None)


def floats(values: NDArray[np.floating[Any]]) -> pa.DoubleArray:
    """Double precision, null for NaN: what is undefined is no number to compute with.

    >>> floats(np.array([1.5, np.nan])).to_pylist()
    [1.5, None]
    """
    double = np.ascontiguousarray(values, np.float64)
    undefined = np.isnan(double)
    return masked(double, undefined) if undefined.any() else plain(double)


def codes(values: NDArray[Any], names: Sequence[str]) -> pa.DictionaryArray:
    """A column of names from small integers.

    >>> codes(np.array([1, 0, 1], np.uint8), ("O", "S")).to_pylist()
    ['S', 'O', 'S']
    """
    indices = plain(np.ascontiguousarray(values, np.int32))
    return pa.DictionaryArray.from_arrays(indices, _texts(names))


def names_of(values: NDArray[Any], names: Sequence[str]) -> pa.StringArray:
    """The same as plain text, for columns inside lists, where not every reader takes dictionaries."""
    return codes(values, names).dictionary_decode()


def _texts(names: Sequence[str]) -> pa.StringArray:
    encoded = [name.encode("utf-8", "replace") for name in names]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(names), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))


def _array(values: NDArray[Any], valid: NDArray[np.bool_] | None, kind: pa.DataType | None) -> pa.Array:
    values = np.ascontiguousarray(values)
    bitmap = None if valid is None else pa.py_buffer(np.packbits(valid, bitorder="little"))
    kind = kind or pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [bitmap, pa.py_buffer(values)])
