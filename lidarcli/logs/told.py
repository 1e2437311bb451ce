"""What lines of a text log tell of its devices, line by line: it counts for what comes after it."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, TypeVar

import numpy as np

from lidarcli.sweeps import Float64, Int64

Name = TypeVar("Name", bound=Hashable)


class Told(Generic[Name]):
    """Values by name and line. Of each block of lines all are kept until the next one, of those before it the last."""

    def __init__(self) -> None:
        self._told: dict[Name, tuple[list[int], list[Sequence[float]]]] = {}
        self._fresh: set[Name] = set()
        """What the last block has told."""

    def add(self, first_line: int, values: Iterable[tuple[int, Name, Sequence[float]]]) -> None:
        """Take row, name and values of what a block tells, in the order of its lines; a name has as many values always."""
        for name in self._fresh:
            lines, known = self._told[name]
            self._told[name] = lines[-1:], known[-1:]
        self._fresh.clear()
        for row, name, value in values:
            lines, known = self._told.setdefault(name, ([], []))
            lines.append(first_line + row)
            known.append(value)
            self._fresh.add(name)

    def at(self, name: Name, lines: Int64, width: int) -> Float64:
        """The values at each line (R, width), NaN where none has been told yet."""
        told = self._told.get(name)
        if told is None:
            return np.full((len(lines), width), np.nan)
        index = np.searchsorted(np.array(told[0], np.int64), lines) - 1
        known = np.array(told[1], np.float64).reshape(-1, width)
        return np.where(index[:, None] < 0, np.nan, known[np.maximum(index, 0)])

    def last(self, name: Name) -> Sequence[float] | None:
        """The values told last; None where nothing was."""
        told = self._told.get(name)
        return None if told is None else told[1][-1]
