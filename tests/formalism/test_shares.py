"""What sweeps say of the shape of a thing."""

from __future__ import annotations

import math

import pytest

from lidarcli.formalism.matching.catalogue import ALIKE, KINDS, SEEN_AS, shape_likelihood


def best(*seen: float) -> str:
    """The likeliest shape of what was taken so often for prismatic, round, legged and irregular."""
    odds = shape_likelihood(seen)
    return KINDS[odds.index(max(odds))]


@pytest.mark.parametrize("times", [1, 6, 100])
def test_many_sweeps_are_no_vote(times: int) -> None:
    """A plant is taken for a prism now and then, which no box is for something else half of the times."""
    assert best(50 * times, times, 0, 49 * times) == "irregular"
    assert best(95 * times, times, 0, 4 * times) == "prismatic"
    assert best(10 * times, 80 * times, 0, 10 * times) == "round"
    assert best(5 * times, 25 * times, 40 * times, 30 * times) == "legged"


def test_sweeps_that_follow_each_other_are_not_independent() -> None:
    """A plant that is mostly taken for a prism may be one after 100 sweeps, and may as well be none after 100,000."""
    few, many = (shape_likelihood([70.0 * times, 0.0, 0.0, 30.0 * times]) for times in (1, 1000))
    assert abs(few[0] - few[3]) < 3.0
    assert abs(many[0] - many[3]) < 3.0


def test_the_likelihood_is_that_of_the_formula() -> None:
    """Sweep after sweep, each by what is known then: a Dirichlet distribution learns by counting."""
    known = [ALIKE[3] * share for share in SEEN_AS[3]]
    log = 0.0
    for shape in (0, 3, 0, 1):
        log += math.log(known[shape] / sum(known))
        known[shape] += 1.0
    assert shape_likelihood([2, 1, 0, 1])[3] == pytest.approx(log)
