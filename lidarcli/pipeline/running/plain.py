"""Pickles of a cluster read as data: numbers, texts and lists of them, and nothing that could run.

Whoever answers at the address of a scheduler says what its pickles call when they are read. Here they call nothing: a class
that is not one of a few of our own stands for its name and its values alone.
"""

from __future__ import annotations

import io
import pickle
from collections import Counter
from collections.abc import Iterable
from functools import partial
from typing import Any

from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.pipeline.running.outcomes import Outcome

_KNOWN = {(kind.__module__, kind.__name__): kind for kind in (Outcome, RunSummary)}
"""Classes of results. Each has a `__setstate__`: without one a pickle could set attributes of the class itself."""


class StandIn(Exception):  # noqa: N818 (it stands for whatever it is named like)
    """An object of a class that is not made; errors of a cluster can be told by the name of it, and by their words."""

    def __new__(cls, *values: Any, **named: Any) -> StandIn:
        """Take whatever there is."""
        return super().__new__(cls, *values)

    def __init__(self, *values: Any, **named: Any) -> None:
        super().__init__(*values)

    def __setstate__(self, state: Any) -> None:
        """Nothing is set."""


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str, /) -> Any:
        """One of our own classes, or one that does nothing; for what others use, too, a new object that stands for it."""
        if (module, name) == ("collections", "Counter"):
            return partial(Counter)
        if module == "tblib.pickling_support":
            # By it workers pickle exceptions and tracebacks; whoever asks for one of these takes none as well.
            return partial(_exception if name.startswith("unpickle_exception") else _none)
        return _KNOWN.get((module, name)) or type(name, (StandIn,), {})


def loads(data: Any, *, buffers: Iterable[Any] = ()) -> Any:
    """What a pickle says; distributed calls it like the function of this name in the standard library."""
    return _Reader(io.BytesIO(data), buffers=buffers).load()


def _exception(kind: Any, values: Any, *more: Any) -> StandIn:
    """An exception of this kind, which makes a stand-in; its words are values or among its attributes."""
    words = values.get("args") if isinstance(values, dict) else values
    is_kind = isinstance(kind, type) and issubclass(kind, StandIn)
    return (kind if is_kind else StandIn)(*(words if isinstance(words, tuple) else ()))


def _none(*values: Any) -> None:
    """Nothing."""
