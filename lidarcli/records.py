"""Dataclasses of arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True, eq_default=False)
def record(cls: type[T]) -> type[T]:
    """A dataclass whose fields are arrays: they stay what they are, as the type checker sees to.

    Arrays have no equality that is true or false, so neither have records. Without that, their text and a guard at run
    time a class is made in a third of the time; there are some forty of them, and most runs are short.
    """
    return dataclass(slots=True, eq=False, repr=False)(cls)
