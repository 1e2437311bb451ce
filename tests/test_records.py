"""Records do what dataclasses of the standard library do."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from dataclasses import asdict, field, fields, replace
from inspect import signature
from typing import Any

import pytest

from lidarcli.system import records


@records.dataclass(frozen=True)
class Spot:
    """A frozen record."""

    x: int
    y: float = 0.5
    names: list[str] = field(default_factory=list, compare=False)
    seen: int = field(default=3, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.x < 0:
            raise ValueError("left of all")


@dataclasses.dataclass(frozen=True, slots=True)
class _Standard:
    x: int
    y: float = 0.5
    names: list[str] = field(default_factory=list, compare=False)
    seen: int = field(default=3, init=False, repr=False)


@records.dataclass()
class Pile:
    """A record that changes."""

    spots: list[Spot]
    high: bool = False


@records.dataclass()
class Tower(Pile):
    """One that has what its base has."""

    high: bool = True
    floors: int = 1


def test_a_record_is_what_the_standard_makes() -> None:
    for values, named in (((1,), {}), ((1, 2.0), {"names": ["a"]}), ((), {"y": 3.0, "x": 7})):
        mine, theirs = Spot(*values, **named), _Standard(*values, **named)
        assert asdict(mine) == asdict(theirs)
        assert repr(mine) == repr(theirs).replace("_Standard", "Spot")
        assert hash(mine) == hash(theirs)
        assert asdict(replace(mine, y=9.0)) == asdict(replace(theirs, y=9.0))
    assert [each.name for each in fields(Spot)] == [each.name for each in fields(_Standard)]
    for name in ("__slots__", "__match_args__", "__module__"):
        assert getattr(Spot, name) == getattr(_Standard, name)
    assert Spot(1).names is not Spot(1).names
    with pytest.raises(ValueError, match="left of all"):
        Spot(-1)


def test_equality_is_of_a_class_and_of_what_is_compared() -> None:
    assert Spot(1, names=["a"]) == Spot(1) != Spot(2)
    assert len({Spot(1, names=["a"]), Spot(1), Spot(2)}) == 2
    assert Pile([], high=True) != Tower([])
    assert Tower([Spot(1)], floors=2) == Tower([Spot(1)], True, 2)
    with pytest.raises(TypeError, match="unhashable"):
        hash(Pile([]))


def test_a_frozen_record_stays_as_it_is() -> None:
    spot = Spot(1)
    with pytest.raises(dataclasses.FrozenInstanceError, match="cannot change x of a Spot"):
        spot.x = 2  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError, match="cannot change x of a Spot"):
        del spot.x
    pile = Pile([spot])
    pile.high = True
    assert pile == Pile([Spot(1)], True)


def _unpickled(one: Any) -> Any:
    return pickle.loads(pickle.dumps(one))


@pytest.mark.parametrize("kept", [_unpickled, copy.copy, copy.deepcopy])
def test_records_are_copied_and_pickled(kept: Callable[[Any], Any]) -> None:
    tower = Tower([Spot(4, names=["b"])], floors=3)
    assert repr(kept(tower)) == repr(tower)


@pytest.mark.parametrize(
    "call",
    [
        lambda: Spot(),  # type: ignore[call-arg]
        lambda: Spot(1, 2.0, [], 3),  # type: ignore[call-arg]
        lambda: Spot(1, x=1),  # type: ignore[misc]
        lambda: Spot(1, seen=1),  # type: ignore[call-arg]
        lambda: Spot(1, z=1),  # type: ignore[call-arg]
    ],
)
def test_values_that_fit_no_field_are_refused(call: Callable[[], Spot]) -> None:
    with pytest.raises(TypeError, match=r"Spot\(\) takes x, y, names; given are"):
        call()


def test_help_tells_the_parameters() -> None:
    assert str(signature(Spot)) == str(signature(_Standard))
    assert [*signature(Tower).parameters] == ["spots", "high", "floors"]

    class Plain(Pile):
        """One that is not decorated."""

    assert [*signature(Plain).parameters] == ["spots", "high"]
    assert Spot(1).names == []
