"""Which entry of a catalogue a thing is: only what was seen may contradict, and `none` is an answer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.matching.catalogue import (
    KINDS,
    MAX_SIZE,
    MIN_FIT,
    MIN_SIZE,
    Catalogue,
    Evidence,
    Thing,
    compare,
    measured,
    name,
)


def possible(evidence: Evidence, catalogue: Catalogue) -> Any:
    """(M, E) True for entries that nothing contradicts."""
    compared = compare(evidence, catalogue)
    return (compared.fit >= MIN_FIT) & ~np.isneginf(compared.ratio)


RANGE = MAX_SIZE - MIN_SIZE
PALLET = Thing("pallet", "prismatic", length=1.2, width=0.8, tolerance=0.05)
CHAIR = Thing("chair", "legged", legs=4, spacing=(0.4, 0.35), tolerance=0.02)
PERSON = Thing("person", legs=2, spacing=(0.25,), tolerance=0.1)


def seen(**given: Any) -> Evidence:
    """Evidence of things of which only the given arrays were seen; standard deviations are 1 cm unless told."""
    given = {key: np.atleast_1d(value) for key, value in given.items()}
    count = len(next(iter(given.values())))
    nothing = np.full(count, np.nan)
    sides = dict.fromkeys(("side_1", "side_2", "least_1", "least_2", "across", "span_1", "span_2"), nothing)
    sds = dict.fromkeys(("side_1_sd", "side_2_sd", "least_sd", "across_sd", "span_sd"), np.full(count, 0.01))
    other = {
        "shape": np.zeros((count, 4)),
        "legs": np.zeros(count, np.int32),
        "moved": np.zeros(count, np.bool_),
        "intensity": nothing,
    }
    return Evidence(**(sides | sds | other | given))


def like(kind: str, log_ratio: float = -5.0) -> Any:
    """Shape log-likelihoods of one thing that looks like `kind`."""
    return np.where(np.array(KINDS) == kind, 0.0, log_ratio)[None]


def names(evidence: Evidence, *things: Thing) -> list[str | None]:
    label, score = name(evidence, Catalogue(things))
    assert (np.isfinite(score) == (label >= 0)).all()
    return [None if code < 0 else things[code].name for code in label.tolist()]


def test_two_sides_are_certain_in_either_order() -> None:
    both = seen(side_1=[1.2, 0.81, 1.2, 0.8], side_2=[0.8, 1.19, 1.2, 0.8])
    assert names(both, PALLET) == ["pallet", "pallet", None, None]


def test_what_is_hidden_contradicts_only_where_it_is_too_long() -> None:
    hidden = seen(side_1=[0.8] * 4, least_2=[0.1, 1.15, 1.3, 1.4])
    assert possible(hidden, Catalogue((PALLET,)))[:, 0].tolist() == [True, True, True, False]
    nothing = seen(least_1=[0.5, 1.3], least_2=[0.2, 1.3])
    assert possible(nothing, Catalogue((PALLET,)))[:, 0].tolist() == [True, False]


def test_probability_is_that_of_the_formula() -> None:
    """One size, measured 2 cm off: a normal density beside a uniform one."""
    value, sd = np.array([0.32]), 0.02
    (ratio,) = measured(value, np.array([sd]), 0.3, 0.3).ratio
    spread = math.hypot(sd, 0.001)
    density = math.exp(-0.5 * (0.02 / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    assert ratio == pytest.approx(math.log(density * RANGE), abs=1e-12)
    label, score = name(seen(across=0.32, across_sd=0.02), Catalogue((Thing("pole", diameter=0.3, tolerance=0.0),)))
    assert label.tolist() == [0]
    assert score == pytest.approx([density * RANGE / (1 + density * RANGE)], abs=1e-9)


def test_legs() -> None:
    chairs = seen(
        legs=[4, 3, 4, 5, 2, 2],
        span_1=[0.4, 0.35, 0.6, 0.4, 0.25, np.nan],
        span_2=[0.35, 0.4, 0.35, 0.35, np.nan, np.nan],
        span_sd=[0.01] * 6,
        shape=np.repeat(like("legged"), 6, axis=0),
    )
    assert names(chairs, CHAIR, PERSON) == ["chair", "chair", None, None, "person", None]
    assert possible(chairs, Catalogue((CHAIR, PERSON))).tolist() == [
        [True, False],
        [True, False],
        [False, False],
        [False, False],
        [False, True],
        [True, True],
    ]


@pytest.mark.parametrize(
    ("boxes", "sd", "least_named", "most_wrong"),
    [
        # Three like boxes that differ by 5 cm in both sides, seen by a track with sides known to 1 cm.
        ([(0.6, 0.4), (0.65, 0.45), (0.7, 0.5)], 0.010, 0.99, 0.0002),
        ([(0.6, 0.4), (0.65, 0.45), (0.7, 0.5)], 0.012, 0.97, 0.0005),
        # In one side alone it takes 8 mm.
        ([(0.6, 0.4), (0.65, 0.4), (0.7, 0.4)], 0.008, 0.97, 0.0003),
    ],
)
def test_three_like_boxes(boxes: list[tuple[float, float]], sd: float, least_named: float, most_wrong: float) -> None:
    rng = np.random.Generator(np.random.PCG64(5))
    count = 30_000
    which = rng.integers(0, 3, count)
    sides = np.array(boxes)[which] + rng.normal(0, sd, (count, 2))
    sides = np.where(rng.random(count)[:, None] < 0.5, sides, sides[:, ::-1])
    things = [Thing(str(i), "prismatic", length=a, width=b, tolerance=0.005) for i, (a, b) in enumerate(boxes)]
    spread = np.full(count, sd)
    evidence = seen(side_1=sides[:, 0], side_2=sides[:, 1], side_1_sd=spread, side_2_sd=spread)
    label, _ = name(evidence, Catalogue(tuple(things)))
    assert (label == which).mean() >= least_named
    assert ((label >= 0) & (label != which)).mean() <= most_wrong


def test_things_of_any_size_get_few_names() -> None:
    """Of boxes of any size those near an entry are taken for it, and no others."""
    rng = np.random.Generator(np.random.PCG64(6))
    true = rng.uniform(0.05, 2.0, (20_000, 2))
    found = true + rng.normal(0, 0.01, true.shape)
    label, _ = name(
        seen(
            side_1=found[:, 0], side_2=found[:, 1], side_1_sd=np.full(len(true), 0.01), side_2_sd=np.full(len(true), 0.01)
        ),
        Catalogue((PALLET,)),
    )
    size = np.sort(true, axis=1) - [0.8, 1.2]
    assert 0 < np.count_nonzero(label == 0) < 400
    assert np.abs(size[label == 0]).max() < 0.2


TAPE = Thing("tape", "round", diameter=0.3, tolerance=0.01, intensity_min=1000.0)
PAINT = Thing("paint", "round", diameter=0.3, tolerance=0.01, intensity_max=1000.0)


def test_an_intensity_tells_things_of_one_size() -> None:
    across = np.full(4, 0.3)
    poles = seen(across=across, shape=np.repeat(like("round"), 4, axis=0), intensity=[3000.0, 50.0, 1000.0, np.nan])
    # At the limit both are right, and nobody knows which.
    assert names(poles, TAPE, PAINT) == ["tape", "paint", None, None]
    assert names(poles, TAPE) == ["tape", None, "tape", None]
    compared = compare(poles, Catalogue((TAPE,)))
    assert np.isneginf(compared.ratio[:, 0]).tolist() == [False, True, False, False]
    assert compared.certain[:, 0].tolist() == [True, True, True, False]
    assert possible(poles, Catalogue((TAPE,)))[:, 0].tolist() == [True, False, True, True]
