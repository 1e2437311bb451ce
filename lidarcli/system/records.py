"""Dataclasses that are cheap to make: their functions are shared, not compiled for each class at every start."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError, asdict, field, fields, replace
from functools import cache
from inspect import signature
from operator import attrgetter
from types import SimpleNamespace
from typing import Any, Literal, TypeVar, dataclass_transform

__all__ = ["MISSING", "asdict", "dataclass", "declared", "field", "fields", "replace"]

T = TypeVar("T")


@dataclass_transform(field_specifiers=(field,))
def dataclass(
    *, frozen: bool = False, eq: bool = True, repr: bool = True, slots: Literal[True] = True
) -> Callable[[type[T]], type[T]]:
    """As the decorator of the standard library, with `fields`, `replace` and `asdict` of there; always with slots."""
    shared: dict[str, Any] = {"__init__": _init, "__dataclass_params__": SimpleNamespace(frozen=frozen)}
    if repr:
        shared["__repr__"] = _repr
    if eq:
        shared |= {"__eq__": _eq, "__hash__": _hash if frozen else None}
    if frozen:
        shared |= {"__setattr__": _refuse, "__delattr__": _refuse, "__setstate__": _restore}

    def made(plain: Any) -> Any:
        own = dict(vars(plain))
        own.pop("__dict__", None), own.pop("__weakref__", None)
        declared = {name: own.pop(name, MISSING) for name in own.get("__annotations__", ())}
        inherited = [name for base in plain.__mro__[1:] for name in vars(base).get("__slots__", ())]
        own["__slots__"] = tuple(name for name in declared if name not in inherited)
        # Order and names of `match`: those of the bases first.
        first = {name: 0 for base in plain.__mro__[:0:-1] for name in vars(base).get("__match_args__", ())}
        hidden = [name for name, one in declared.items() if isinstance(one, Field) and not one.init]
        own["__match_args__"] = tuple(name for name in first | declared if name not in hidden)
        own |= {"__declared__": declared, **{name: _Lazily(plain) for name in ("__dataclass_fields__", "__signature__")}}
        cls = type(plain)(plain.__name__, plain.__bases__, shared | own)
        cls.__qualname__ = plain.__qualname__
        return cls

    return made


class _Lazily:
    """Fields and signature of a class as the standard library makes them; most runs ask for those of few."""

    def __init__(self, plain: type) -> None:
        self._plain = plain

    def __set_name__(self, cls: Any, name: str) -> None:
        self._cls, self._name = cls, name

    def __get__(self, one: object, cls: type) -> Any:
        made: Any = dataclasses.dataclass(repr=False, eq=False)(self._plain)
        whole = signature(made.__init__)
        self._cls.__signature__ = whole.replace(parameters=[*whole.parameters.values()][1:])
        self._cls.__dataclass_fields__ = made.__dataclass_fields__
        return getattr(self._cls, self._name)


def declared(cls: type) -> dict[str, Field[Any]]:
    """Return the fields of a class as they are declared, without name and type; `fields` takes ten times as long."""
    found = {name: one for base in cls.__mro__[::-1] for name, one in vars(base).get("__declared__", {}).items()}
    return {name: one if isinstance(one, Field) else field(default=one) for name, one in found.items()}


@cache
def _layout(cls: Any) -> SimpleNamespace:
    """Return the parts of a class that the shared functions need."""
    known = declared(cls)
    defaults = {name: one.default for name, one in known.items() if one.default is not MISSING}
    factories = {name: one.default_factory for name, one in known.items() if one.default_factory is not MISSING}
    given = tuple(name for name, one in known.items() if one.init)
    return SimpleNamespace(
        given=given,
        names=frozenset(given),
        needed=frozenset(given) - defaults.keys() - factories.keys(),
        defaults=defaults,
        factories=factories,
        compared=attrgetter(*(name for name, one in known.items() if one.compare)),
        shown=[name for name, one in known.items() if one.repr],
        is_checked=hasattr(cls, "__post_init__"),
    )


_set = object.__setattr__


def _init(self: Any, *values: Any, **named: Any) -> None:
    layout = _layout(self.__class__)
    count = len(values) + len(named)
    if values:
        named |= zip(layout.given, values, strict=False)
    if len(named) < count or not layout.needed <= named.keys() <= layout.names:
        name = self.__class__.__name__
        raise TypeError(f"{name}() takes {', '.join(layout.given)}; given are {count}: {', '.join(named)}")
    known = layout.defaults | named
    for name, make in layout.factories.items():
        if name not in known:
            known[name] = make()
    for name, value in known.items():
        _set(self, name, value)
    if layout.is_checked:
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
