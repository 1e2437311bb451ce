"""What the compiled core and the same files as plain Python do differently: memory, and the interpreter lock.

The modules in `sweep/`, `surfaces/` and `description/` are plain Python: loops over the beams of one sweep, in the order
of the paper's definitions. The `.pxd` file beside each tells Cython the C types of its fields, arguments and constants;
where a compiler was at hand at installation, they run compiled. `native.pxd` holds the same functions as this file for
the compiled modules, in terms of pointers and the lock.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import MutableSequence
from typing import Any, cast

from numpy.typing import NDArray


class Checked(list[Any]):
    """A list that refuses negative indices, which plain ones take from the end and pointers from outside."""

    def __getitem__(self, index: Any) -> Any:
        if index < 0:
            raise IndexError(index)
        return super().__getitem__(index)

    def __setitem__(self, index: Any, value: Any) -> None:
        if index < 0:
            raise IndexError(index)
        super().__setitem__(index, value)


_list: type[list[Any]] = Checked if os.environ.get("LIDARCLI_BOUNDS") else list


def doubles(owner: list[Any], count: int) -> list[float]:
    """Room for so many float64, 0 at first; as long as `owner` lives."""
    return _list([0.0] * count)


def integers(owner: list[Any], count: int) -> list[int]:
    """Room for so many indices, 0 at first."""
    return _list([0] * count)


def singles(owner: list[Any], count: int) -> array[float]:
    """Room for so many float32, to which storing rounds."""
    return array("f", bytes(4 * count))


def at_doubles(values: NDArray[Any]) -> MutableSequence[float]:
    """The numbers of a contiguous array of float64, which has to be kept as long as they are used."""
    return cast("MutableSequence[float]", memoryview(values.reshape(-1).data))


def at_ints(values: NDArray[Any]) -> MutableSequence[int]:
    """The same of int32."""
    return cast("MutableSequence[int]", memoryview(values.reshape(-1).data))


at_singles = at_doubles
"""The same of float32."""
at_longs = at_bytes = at_ints
"""The same of int64, and of one byte."""


def release() -> object:
    """Let other threads run Python: what follows touches no Python object."""
    return None


def resume(state: object) -> None:
    """Take the interpreter lock again."""
