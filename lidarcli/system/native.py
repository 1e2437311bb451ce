"""Memory and the interpreter lock, which the compiled core and the same files as plain Python handle differently.

The steps of the formalism, from `segmentation` to `description`, are plain Python: loops over the beams of one sweep, in
the order of the paper's definitions. The `.pxd` file next to each declares the C types of its fields, arguments and
constants; where a compiler was at hand at installation, they run compiled. `native.pxd` holds the same functions as this
file for the compiled modules, in terms of pointers and the lock.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Mapping, MutableSequence
from types import SimpleNamespace
from typing import Any, cast

from numpy.typing import NDArray


class _Checked:
    """Numbers that refuse negative indices, which sequences take from the end and pointers from outside."""

    def __init__(self, values: Any) -> None:
        self._values = values

    def __getitem__(self, index: int) -> Any:
        if index < 0:
            raise IndexError(f"index {index} of {len(self._values)}")
        return self._values[index]

    def __setitem__(self, index: int, value: Any) -> None:
        if index < 0:
            raise IndexError(f"index {index} of {len(self._values)}")
        self._values[index] = value


def _checked(values: Any) -> Any:
    """Return the numbers, with bounds checked on both sides where `LIDARCLI_BOUNDS` asks for it."""
    return _Checked(values) if _BOUNDS else values


_BOUNDS = bool(os.environ.get("LIDARCLI_BOUNDS"))


def doubles(owner: list[Any], count: int) -> MutableSequence[float]:
    """Return room for so many float64, 0 at first, which lives as long as `owner`."""
    return cast("MutableSequence[float]", _checked([0.0] * count))


def integers(owner: list[Any], count: int) -> MutableSequence[int]:
    """Return room for so many indices, 0 at first."""
    return cast("MutableSequence[int]", _checked([0] * count))


numbers = integers
"""Room for so many of 32 bits."""


def singles(owner: list[Any], count: int) -> MutableSequence[float]:
    """Return room for so many float32, to which storing rounds."""
    return cast("MutableSequence[float]", _checked(array("f", bytes(4 * count))))


def at_doubles(values: NDArray[Any]) -> MutableSequence[float]:
    """Return the numbers of a contiguous array of float64, which has to be kept as long as they are used."""
    return cast("MutableSequence[float]", _numbers(values))


def at_ints(values: NDArray[Any]) -> MutableSequence[int]:
    """Return those of an array of int32."""
    return cast("MutableSequence[int]", _numbers(values))


at_singles = at_doubles
"""Of float32."""
at_longs = at_bytes = at_ints
"""Of int64, and of one byte."""


def pointers(arrays: Mapping[str, NDArray[Any]]) -> Any:
    """Return the numbers of some arrays of a `Detection` by the names of its fields: `pointers(arrays).r_min[k]`."""
    return SimpleNamespace(**{name: _numbers(values) for name, values in arrays.items()})


def _numbers(values: NDArray[Any]) -> Any:
    return _checked(memoryview(values.reshape(-1).data))


def release() -> object:
    """Let other threads run Python: what follows touches no Python object."""
    return None


def resume(state: object) -> None:
    """Take the interpreter lock again."""
