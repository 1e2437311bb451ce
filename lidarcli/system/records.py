"""Dataclasses that are cheap to make: their functions are shared, not compiled for each class at every start."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError, asdict, field, fields, replace
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar, dataclass_transform

__all__ = ["MISSING", "asdict", "dataclass", "field", "fields", "replace"]

T = TypeVar("T")


@dataclass_transform(field_specifiers=(field,))
def dataclass(
    *, frozen: bool = False, eq: bool = True, repr: bool = True, slots: bool = True
) -> Callable[[type[T]], type[T]]:
    """As the decorator of the standard library, with `fields`, `replace` and `asdict` of there; with slots."""

    def made(cls: type[T]) -> type[T]:
        own: dict[str, Any] = {"__init__": _init}
        if repr:
            own["__repr__"] = _repr
        if eq:
            own |= {"__eq__": _eq, "__hash__": _hash if frozen else None}
        if frozen:
            own |= {"__setattr__": _refuse, "__delattr__": _refuse, "__setstate__": _restore}
        for name in own.keys() - vars(cls).keys():
            setattr(cls, name, own[name])
        return dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(cls)

    return made


class _Layout(NamedTuple):
    """What the shared functions ask of a class."""

    given: tuple[str, ...]
    """Fields that a call may give, in order."""
    defaults: dict[str, Any]
    factories: dict[str, Callable[[], Any]]
    compared: attrgetter[Any]
    shown: tuple[str, ...]


@cache
def _layout(cls: Any) -> _Layout:
    known = fields(cls)
    return _Layout(
        tuple(each.name for each in known if each.init),
        {each.name: each.default for each in known if each.default is not MISSING},
        {each.name: each.default_factory for each in known if each.default_factory is not MISSING},
        attrgetter(*(each.name for each in known if each.compare)),
        tuple(each.name for each in known if each.repr),
    )


_set = object.__setattr__


def _init(self: Any, *values: Any, **named: Any) -> None:
    cls = self.__class__
    layout = _layout(cls)
    given = dict(zip(layout.given, values, strict=False), **named)
    known = layout.defaults | given
    for name, make in layout.factories.items():
        if name not in known:
            known[name] = make()
    if len(given) < len(values) + len(named) or not known.keys() >= set(layout.given) >= given.keys():
        raise TypeError(f"{cls.__name__}() takes {', '.join(layout.given)}; given are {', '.join(given)}")
    for name, value in known.items():
        _set(self, name, value)
    if hasattr(cls, "__post_init__"):
        self.__post_init__()


def _repr(self: Any) -> str:
    cls = self.__class__
    return f"{cls.__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in _layout(cls).shown)})"


def _eq(self: Any, other: Any) -> Any:
    if other.__class__ is not self.__class__:
        return NotImplemented
    values = _layout(self.__class__).compared
    return values(self) == values(other)


def _hash(self: Any) -> int:
    return hash(_layout(self.__class__).compared(self))


def _refuse(self: object, name: str, value: object = None) -> None:
    raise FrozenInstanceError(f"cannot change {name} of a {type(self).__name__}")


def _restore(self: object, state: tuple[None, dict[str, Any]]) -> None:
    for name, value in state[1].items():
        _set(self, name, value)
