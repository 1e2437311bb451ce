"""The clock, who takes which view, and what is remembered of legs."""

from __future__ import annotations

import math

import pytest

from lidarcli.formalism.tracking import association, kalman, sweep_tracker, track_evidence
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import Measurements


def test_the_clock_never_goes_back() -> None:
    state = sweep_tracker.SweepTracker(Targets(4), Measurements(4, 4), Keyframes(4))
    assert sweep_tracker.advance_clock(state, 5.0) == 0.0
    passed = []
    for stamp in (5.1, 5.2, 5.2, 4.0, 4.1, 1e6):
        state.sweeps += 1
        passed.append(sweep_tracker.advance_clock(state, stamp))
    assert passed[:3] == pytest.approx([0.1, 0.1, 0.0])
    # Set back: as long as a sweep usually takes. After ages: no longer than the longest pause.
    assert passed[3:] == pytest.approx([0.1, 0.1, sweep_tracker.MAX_PAUSE], rel=0.05)
    assert state.time == pytest.approx(sum(passed))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_how_far_a_point_is_outside_of_a_body(yaw: float) -> None:
    targets = Targets(1)
    kalman.reset(targets, 0)
    targets.kind[0] = kalman.BOX
    for i, half in enumerate((0.4, 0.2)):
        kalman.initiate_axis(targets, i, -half, half, 1e-4, 1e-4)
    targets.cos[0], targets.sin[0] = math.cos(yaw), math.sin(yaw)
    for along, across, off in ((0.0, 0.0, -0.2), (0.5, 0.0, 0.1), (0.0, 0.5, 0.3), (0.39, 0.0, -0.01)):
        point = kalman.to_world(targets, 0, along, across)
        assert kalman.outside(targets, 0, *point) == pytest.approx(off)
    targets.kind[0] = kalman.DISC
    assert kalman.outside(targets, 0, 0.0, 1.0) == pytest.approx(1.0 - 0.3)


def test_who_was_seen_in_the_sweep_before_comes_first_and_a_duplicate_last() -> None:
    targets, measurements = Targets(1), Measurements(1, 4)
    kalman.reset(targets, 0)
    targets.h[0] = targets.h[1] = 0.2
    targets.measurement[0] = -1
    assert association.precedence(targets, measurements, 0) == 0.0
    targets.measurement[0] = 0
    assert association.precedence(targets, measurements, 0) == -association.SEEN_BEFORE
    targets.same_as[0] = 7
    expected = association.DUPLICATE_COST - association.SEEN_BEFORE
    assert association.precedence(targets, measurements, 0) == expected
    targets.sightings[0] = association.DUPLICATE_SIGHTINGS
    assert association.precedence(targets, measurements, 0) == -association.SEEN_BEFORE
    # Legs swing past each other, and where nobody knows where the sensor is, no body is one object for long.
    targets.h[0] = targets.h[1] = 0.1
    assert association.precedence(targets, measurements, 0) == 0.0
    targets.h[0] = targets.h[1] = 0.2
    measurements.is_placed = False
    assert association.precedence(targets, measurements, 0) == 0.0


def test_a_body_is_another_one_only_where_both_are_seen_at_once() -> None:
    targets = Targets(2)
    for _ in range(2):
        kalman.reset(targets, kalman.allocate(targets))
    targets.same_as[1], targets.inside[1] = targets.number[0], 5
    targets.measurement[0] = -1
    track_evidence.record_hit(targets, 1)
    assert targets.inside[1] == 5
    targets.measurement[0] = 3
    track_evidence.record_hit(targets, 1)
    assert targets.inside[1] == 4
    targets.measurement[0], targets.state[0] = -1, kalman.ENDED
    track_evidence.record_hit(targets, 1)
    assert targets.inside[1] == 3


def two_persons(apart: float) -> tuple[association.Persons, Targets, Measurements, kalman.Sightings]:
    """Two persons so far apart, the second one of whom has a leg in view 0."""
    persons, targets, measurements, sightings = association.Persons(1), Targets(3), Measurements(1, 4), kalman.Sightings()
    for b in range(2):
        kalman.reset(targets, kalman.allocate(targets))
        targets.kind[b], targets.kind_hits[b], targets.measurement[b], targets.sightings[b] = kalman.PERSON, 1, 0, 9
        for i in range(2):
            x = b * apart if i == 0 else 0.0
            kalman.initiate_axis(targets, 2 * b + i, x - 0.2, x + 0.2, 1e-4, 1e-4)
    kalman.reset(targets, kalman.allocate(targets))
    targets.member[2] = targets.number[1]
    measurements.count, measurements.sighting[0], persons.assigned[0] = 1, -1, 2
    measurements.assigned[0] = 1
    return persons, targets, measurements, sightings


@pytest.mark.parametrize(("apart", "legs", "one"), [(0.3, 1, True), (0.5, 1, False), (0.3, 2, False)])
def test_two_persons_who_have_two_legs_together_are_one(apart: float, legs: int, one: bool) -> None:
    persons, targets, measurements, sightings = two_persons(apart)
    targets.kind_hits[1] = legs
    for _ in range(track_evidence.DUPLICATE_SWEEPS // association.MERGED_GAIN):
        assert targets.state[1] == kalman.LIVE
        for b in range(2):
            association.merge_person(persons, targets, measurements, sightings, b)
    if one:
        # The elder takes the legs, and the place that the younger had becomes its own.
        assert (targets.state[1], targets.same_as[1]) == (kalman.ENDED, targets.number[0])
        assert (measurements.assigned[0], persons.assigned[0], targets.kind_hits[0]) == (0, 1, 2)
        assert targets.member[2] == targets.number[0]
    else:
        assert (targets.state[1], targets.inside[1], measurements.assigned[0]) == (kalman.LIVE, 0, 1)
