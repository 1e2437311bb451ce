"""The parameters of both profiles: their defaults, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Any

import pytest

from lidarcli.errors import OptionError
from lidarcli.formalism import Parameters, detect, difference, sweep


def test_defaults_of_both_profiles() -> None:
    robust = Parameters.for_profile()
    assert robust == Parameters()
    assert (robust.profile, robust.threshold) == ("robust", "adaptive")
    assert (robust.min_beams, robust.max_width, robust.max_gap, robust.walls) == (3, 2.0, 2, False)
    paper = Parameters.for_profile("paper")
    assert (paper.profile, paper.threshold) == ("paper", "mean")
    assert (paper.min_beams, paper.max_width, paper.max_gap, paper.walls) == (1, inf, 0, False)


def test_an_override_that_is_none_leaves_the_default() -> None:
    given = Parameters.for_profile("paper", min_beams=None, max_width=3.0, walls=True)
    assert (given.min_beams, given.max_width, given.walls) == (1, 3.0, True)


@pytest.mark.parametrize(
    ("profile", "overrides", "message"),
    [
        ("exact", {}, "--profile: 'exact' is not one of robust, paper"),
        ("robust", {"colour": 1, "beams": 2}, "no such parameter: beams, colour"),
        ("robust", {"threshold": "median"}, "--threshold: 'median' is not adaptive, mean or a number of metres"),
        ("robust", {"threshold": -0.1}, "--threshold: -0.1 m is not a distance"),
        ("robust", {"threshold": inf}, "--threshold: inf m is not a distance"),
        ("robust", {"threshold": nan}, "--threshold: nan m is not a distance"),
        ("robust", {"min_beams": 0}, "--min-beams: 0 is below 1"),
        ("robust", {"max_gap": -1}, "--max-gap: -1 is below 0"),
        ("robust", {"max_width": 0.0}, "--max-width: 0.0 m is not a width"),
        ("robust", {"max_gap": 1 << 40}, "--max-gap: 1099511627776 is above 1,000,000"),
        ("robust", {"min_beams": 10**20}, "--min-beams: 100000000000000000000 is above 1,000,000"),
        ("paper", {"group_gap": inf}, "--group-gap: inf is above 1,000,000"),
        ("robust", {"threshold": 1e300}, "--threshold: 1e+300 m is not a distance"),
        ("robust", {"max_width": 1e308}, "--max-width: 1e+308 m is not a width"),
        ("robust", {"max_width": nan}, "--max-width: nan m is not a width"),
    ],
)
def test_values_without_a_meaning_are_refused(profile: Any, overrides: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError) as caught:
        Parameters.for_profile(profile, **overrides)
    assert str(caught.value) == message
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("name", ["angle_min", "angle_increment"])
@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("profile", ["robust", "paper"])
def test_bearings_that_are_no_numbers_are_refused(name: str, value: float, profile: Any) -> None:
    batch = sweep([[1.0, 2.0, 3.0]] * 3, angle_increment=0.1)
    values = getattr(batch, name).copy()
    values[1] = value
    odd = replace(batch, **{name: values}, sweep=batch.sweep + 40)
    for function in (lambda: detect(odd, Parameters.for_profile(profile)), lambda: difference(odd)):
        with pytest.raises(ValueError, match=rf"^sweep 41 of /scan: {name} is {value}, not a finite angle$"):
            function()
    with pytest.raises(ValueError, match=r"is not a finite angle$"):
        sweep([1.0, 2.0], **{"angle_increment": 0.1, name: value})
