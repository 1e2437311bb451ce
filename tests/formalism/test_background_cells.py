"""r_e of a beam from its counted ranges: exact sums, people who pass, open beams, surfaces that are far apart."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.formalism.learning import BIN_UNITS, UNIT, Estimate, count_ranges, estimate, merge
from lidarcli.sweeps.types import Float64

Observed = st.lists(st.tuples(st.integers(0, 3), st.floats(0.02, 30.0)), max_size=60)


def estimated(ranges: list[float], no_return: int = 0) -> Estimate:
    """What one beam with these ranges is taken for."""
    cells = count_ranges(np.zeros(len(ranges), np.int64), np.array(ranges, float))
    return estimate(cells, np.array([no_return]))


def same(a: Estimate, b: Estimate) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True)
        for name in ("r_e", "r_near", "spread", "support", "no_return")
    )


@given(Observed)
def test_counting_agrees_with_a_dictionary(observed: list[tuple[int, float]]) -> None:
    expected: dict[tuple[int, int], list[int]] = {}
    for beam, value in observed:
        unit = round(value / UNIT)
        entry = expected.setdefault((beam, unit // BIN_UNITS * BIN_UNITS), [0, 0, 0])
        entry[0] += 1
        entry[1] += unit % BIN_UNITS
        entry[2] += (unit % BIN_UNITS) ** 2
    cells = count_ranges(np.array([beam for beam, _ in observed], np.int64), np.array([r for _, r in observed]))
    got = zip(
        zip(cells.beam.tolist(), cells.unit.tolist(), strict=True),
        zip(cells.count.tolist(), cells.total.tolist(), cells.squares.tolist(), strict=True),
        strict=True,
    )
    assert [(key, list(values)) for key, values in got] == sorted(expected.items())


@given(Observed, st.integers(0, 60), st.randoms())
def test_the_order_and_the_parts_make_no_difference(observed: list[tuple[int, float]], cut: int, random: Random) -> None:
    beam = np.array([beam for beam, _ in observed], np.int64)
    ranges = np.array([r for _, r in observed])
    whole = count_ranges(beam, ranges)
    order = np.array(random.sample(range(len(ranges)), len(ranges)), np.int64)
    beam, ranges = beam[order], ranges[order]
    parts = merge([count_ranges(beam[:cut], ranges[:cut]), count_ranges(beam[cut:], ranges[cut:])])
    for name in ("key", "count", "total", "squares"):
        assert np.array_equal(getattr(parts, name), getattr(whole, name))
    assert same(estimate(parts, np.zeros(4, np.int64)), estimate(whole, np.zeros(4, np.int64)))


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_a_surface_with_noise(sigma: float) -> None:
    rng = np.random.default_rng(1)
    found = estimated((4.0 + sigma * rng.standard_normal(400)).tolist())
    assert found.r_e[0] == pytest.approx(4.0, abs=sigma / 8 + 1e-4)
    assert found.r_near[0] == found.r_e[0]
    assert found.spread[0] == pytest.approx(sigma, rel=0.2, abs=1e-4)
    assert found.support[0] >= 0.98
    assert found.no_return[0] == 0


def test_the_farther_of_two_surfaces_is_the_background_and_the_nearer_is_known() -> None:
    found = estimated([2.0] * 60 + [5.0] * 40)
    assert found.r_e[0] == pytest.approx(5.0)
    assert found.r_near[0] == pytest.approx(2.0)
    assert found.support[0] == 0.4


def estimated_beams(ranges: Float64) -> Estimate:
    """What beams with these ranges (observations, beams) are taken for; NaN: no return."""
    seen = ~np.isnan(ranges)
    beam = np.broadcast_to(np.arange(ranges.shape[1]), ranges.shape)[seen]
    return estimate(count_ranges(beam, ranges[seen]), np.count_nonzero(~seen, axis=0))


BEAMS = 200


@pytest.mark.parametrize("observations", [20, 100, 400])
@pytest.mark.parametrize("depth", [0.3, 0.45, 0.6, 0.8, 1.0])
def test_foliage_is_a_surface(observations: int, depth: float) -> None:
    """Leaves behind each other, another one in every sweep."""
    rng = np.random.default_rng(3)
    found = estimated_beams(rng.uniform(4.0, 4.0 + depth, (observations, BEAMS)))
    assert ((found.r_e > 4.0) & (found.r_e < 4.0 + depth)).all()
    assert np.median(found.spread) > 0.045


@pytest.mark.parametrize("observations", [20, 100, 400])
@pytest.mark.parametrize("swing", [0.2, 0.3, 0.4])
@pytest.mark.parametrize("way", ["sine", "uniform"])
def test_a_wall_that_a_shaking_sensor_sees_is_a_surface(observations: int, swing: float, way: str) -> None:
    rng = np.random.default_rng(5)
    if way == "sine":
        shake = 0.5 * np.sin(rng.uniform(0, 2 * np.pi, (observations, BEAMS)))
    else:
        shake = rng.uniform(-0.5, 0.5, (observations, BEAMS))
    ranges = 4.0 + swing * shake + 0.01 * rng.standard_normal((observations, BEAMS))
    found = estimated_beams(ranges)
    assert (np.abs(found.r_e - 4.0) < swing / 2 + 0.04).all()


@pytest.mark.parametrize("hidden", [0.7, 0.8, 0.85])
@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_a_wall_behind_people_who_hide_it_most_of_the_time_is_found(hidden: float, sigma: float) -> None:
    """It is seen in fewer than 35 % of the sweeps, but always at the same range; people are everywhere before it."""
    rng = np.random.default_rng(6)
    wall = 5.0 + sigma * rng.standard_normal((400, BEAMS))
    people = rng.uniform(1.0, 4.5, wall.shape)
    found = estimated_beams(np.where(rng.random(wall.shape) < hidden, people, wall))
    at_wall = np.abs(found.r_e - 5.0) < 0.03
    assert at_wall.mean() > 0.97
    # What is left is open: nobody is ever a surface.
    assert np.isinf(found.r_e[~at_wall]).all()
    assert found.support[at_wall] == pytest.approx(1 - hidden, abs=0.08)
    assert found.r_near[at_wall] == pytest.approx(found.r_e[at_wall])
