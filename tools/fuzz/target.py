"""What a fuzzer is made of: it writes a case, and says what went wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tools.fuzz.place import Place

Random = np.random.Generator


@dataclass(frozen=True, slots=True)
class Target:
    """One kind of input. `write` depends on nothing but its arguments, so that a case can be repeated."""

    name: str
    write: Callable[[Place, int, Random], None]
    """Make the case of this number in a prepared place; `tools.fuzz.judge.judge` does the rest."""
    judge: Callable[[Place], Iterable[str]]
    """Read the case, and tell what is not allowed to happen beyond what is asked of every case."""
    weight: int = 1
    """How often it has a turn: many for what is cheap."""
    known: int = 0
    """The cases of numbers below are made by hand; from here on they are drawn."""
