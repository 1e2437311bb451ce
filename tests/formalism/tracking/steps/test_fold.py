"""The clock, who takes which view, and what is remembered of legs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.tracking import association, belief, estimation, fold
from lidarcli.formalism.tracking.estimation import Bodies
from lidarcli.formalism.tracking.observation import Memory, Views


def test_the_clock_never_goes_back() -> None:
    state = fold.Fold(10.0, Bodies(4), Views(4, 4), Memory(4))
    assert fold._tick(state, 5.0) == 0.0
    passed = []
    for stamp in (5.1, 5.2, 5.2, 4.0, 4.1, 1e6):
        state.sweeps += 1
        passed.append(fold._tick(state, stamp))
    assert passed[:3] == pytest.approx([0.1, 0.1, 0.0])
    # Set back: as long as a sweep usually takes. After ages: no longer than the longest pause.
    assert passed[3:] == pytest.approx([0.1, 0.1, fold.MOST_PAUSE], rel=0.05)
    assert state.clock == pytest.approx(sum(passed))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_how_far_a_point_is_outside_of_a_body(yaw: float) -> None:
    bodies = Bodies(1)
    estimation.clear(bodies, 0)
    bodies.kind[0] = estimation.BOX
    for i, half in enumerate((0.4, 0.2)):
        estimation.begin_axis(bodies, i, -half, half, 1e-4, 1e-4)
    bodies.cos[0], bodies.sin[0] = math.cos(yaw), math.sin(yaw)
    for along, across, off in ((0.0, 0.0, -0.2), (0.5, 0.0, 0.1), (0.0, 0.5, 0.3), (0.39, 0.0, -0.01)):
        point = estimation.to_world(bodies, 0, along, across)
        assert estimation.outside(bodies, 0, *point) == pytest.approx(off)
    bodies.kind[0] = estimation.DISC
    assert estimation.outside(bodies, 0, 0.0, 1.0) == pytest.approx(1.0 - 0.3)


def test_pairs_of_persons_and_legs_are_sorted_by_cost() -> None:
    rng = np.random.default_rng(1)
    room = association.Persons(10)
    room.count = 12
    costs = rng.choice([1.0, 2.0, 3.0], 12)
    for i, cost in enumerate(costs):
        room.person[i], room.view[i], room.cost[i] = i, 100 + i, float(cost)
    association._sort_pairs(room)
    # Of equals the first stays the first.
    assert [room.person[i] for i in range(12)] == np.argsort(costs, kind="stable").tolist()
    assert [room.view[i] - room.person[i] for i in range(12)] == [100] * 12
    assert [room.cost[i] for i in range(12)] == sorted(costs)


def test_who_was_seen_in_the_sweep_before_comes_first_and_a_duplicate_last() -> None:
    bodies, views = Bodies(1), Views(1, 4)
    estimation.clear(bodies, 0)
    bodies.h[0] = bodies.h[1] = 0.2
    bodies.view[0] = -1
    assert association._precedence(bodies, views, 0) == 0.0
    bodies.view[0] = 0
    assert association._precedence(bodies, views, 0) == -association.SEEN_BEFORE
    bodies.same_as[0] = 7
    expected = association.DUPLICATE_COST - association.SEEN_BEFORE
    assert association._precedence(bodies, views, 0) == expected
    bodies.sightings[0] = association.DUPLICATE_SIGHTINGS
    assert association._precedence(bodies, views, 0) == -association.SEEN_BEFORE
    # Legs swing past each other, and where nobody knows where the sensor is, no body is one object for long.
    bodies.h[0] = bodies.h[1] = 0.1
    assert association._precedence(bodies, views, 0) == 0.0
    bodies.h[0] = bodies.h[1] = 0.2
    views.is_placed = False
    assert association._precedence(bodies, views, 0) == 0.0


def test_a_body_is_another_one_only_where_both_are_seen_at_once() -> None:
    bodies = Bodies(2)
    for _ in range(2):
        estimation.clear(bodies, estimation.free_slot(bodies))
    bodies.same_as[1], bodies.inside[1] = bodies.number[0], 5
    bodies.view[0] = -1
    belief.note_seen(bodies, 1)
    assert bodies.inside[1] == 5
    bodies.view[0] = 3
    belief.note_seen(bodies, 1)
    assert bodies.inside[1] == 4
    bodies.view[0], bodies.state[0] = -1, estimation.ENDED
    belief.note_seen(bodies, 1)
    assert bodies.inside[1] == 3


def two_persons(apart: float) -> tuple[association.Persons, Bodies, Views, estimation.Sightings, list[int]]:
    """Two persons so far apart, the second one of whom has a leg in view 0."""
    persons, bodies, views, log = association.Persons(1), Bodies(3), Views(1, 4), estimation.Sightings()
    for b in range(2):
        estimation.clear(bodies, estimation.free_slot(bodies))
        bodies.kind[b], bodies.settled[b], bodies.view[b], bodies.sightings[b] = estimation.PERSON, 1, 0, 9
        for i in range(2):
            x = b * apart if i == 0 else 0.0
            estimation.begin_axis(bodies, 2 * b + i, x - 0.2, x + 0.2, 1e-4, 1e-4)
    estimation.clear(bodies, estimation.free_slot(bodies))
    bodies.member[2] = bodies.number[1]
    views.count, persons.entry[0], persons.taken[0] = 1, -1, 2
    return persons, bodies, views, log, [1]


@pytest.mark.parametrize(("apart", "legs", "one"), [(0.3, 1, True), (0.5, 1, False), (0.3, 2, False)])
def test_two_persons_who_have_two_legs_together_are_one(apart: float, legs: int, one: bool) -> None:
    persons, bodies, views, log, owner = two_persons(apart)
    bodies.settled[1] = legs
    for _ in range(belief.DUPLICATE_SWEEPS // association.MERGED_GAIN):
        assert bodies.state[1] == estimation.LIVE
        for b in range(2):
            association._merge_person(persons, bodies, views, owner, log, b)
    if one:
        # The elder takes the legs, and the place that the younger had becomes its own.
        assert (bodies.state[1], bodies.same_as[1]) == (estimation.ENDED, bodies.number[0])
        assert (owner, persons.taken[0], bodies.settled[0]) == ([0], 1, 2)
        assert bodies.member[2] == bodies.number[0]
    else:
        assert (bodies.state[1], bodies.inside[1], owner) == (estimation.LIVE, 0, [1])


def test_a_leg_is_the_mean_of_where_it_was_seen() -> None:
    bodies = Bodies(1)
    estimation.clear(bodies, 0)
    for x in (1.0, 1.02, 1.04):
        belief._note_leg(bodies, 0, x, 2.0)
    belief._note_leg(bodies, 0, 1.5, 2.0)
    assert (bodies.leg_x[0], bodies.leg_y[0], bodies.leg_seen[0]) == (pytest.approx(1.02), 2.0, 3)
    assert (bodies.leg_x[1], bodies.leg_seen[1], bodies.leg_seen[2]) == (1.5, 1, 0)
