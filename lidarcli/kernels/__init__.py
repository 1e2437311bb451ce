"""Compiled counterparts of the hottest functions on flat arrays; optional, and with the same results bit for bit.

A function of `lidarcli/formalism/NAME.py` that is marked with `@compiled` is replaced by the function of the same name
in `lidarcli/kernels/NAME.pyx`, where that was built. What the marked function says and does in numpy remains the
definition; the tests compare the two. `LIDARCLI_COMPILED=no` leaves them out.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

PAIRS: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {}
"""The replaced functions by their full name: as written in numpy, and compiled."""


def compiled(plain: Callable[P, R]) -> Callable[P, R]:
    """The compiled counterpart of a function, or the function itself where there is none."""
    if os.environ.get("LIDARCLI_COMPILED", "").lower() in ("no", "0", "false"):
        return plain
    try:
        kernels = import_module(f"{__name__}.{plain.__module__.rpartition('.')[2]}")
    except ImportError:
        return plain
    # One that was built before this function was marked knows nothing of it.
    fast: Callable[P, R] | None = getattr(kernels, plain.__name__, None)
    if fast is None:
        return plain
    PAIRS[f"{plain.__module__}.{plain.__qualname__}"] = plain, fast
    return fast
