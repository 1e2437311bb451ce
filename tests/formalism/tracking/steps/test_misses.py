"""A sweep made by hand: where its beams passed or ended, and what becomes of a target that it misses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.tracking import kalman, track_evidence
from lidarcli.formalism.tracking.kalman import Targets
from tests.formalism.tracking.steps.looking import BEAMS, GEOMETRIES, POSES, STEP, Pose, at, sweep_of


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("pose", POSES)
def test_a_place_is_passed_or_hit_or_in_the_shadow(geometry: str, pose: Pose) -> None:
    beams, first, step = GEOMETRIES[geometry]
    measurements, scans = sweep_of(np.full(beams, 4.0), first, step, pose)
    targets = body_at(0.0, 0.0, 1)
    for bearing in np.arange(-3.2, 3.2, 0.1):
        for r, shares in ((2.0, (1, 0, 0)), (4.05, (0, 1, 0)), (6.0, (0, 0, 0))):
            x, y = at(r, float(bearing), pose)
            assert track_evidence.passing(measurements, scans, targets, 0, x, y) == shares


@pytest.mark.parametrize(("first", "step"), [(-90 * STEP, STEP), (90 * STEP, -STEP)])
def test_a_place_at_the_edge_of_the_view_is_half_outside(first: float, step: float) -> None:
    measurements, scans = sweep_of(np.full(181, 4.0), first, step)
    targets = body_at(0.0, 0.0, 1)
    targets.h[0] = targets.h[1] = 0.4
    for edge in (-90, 90):
        passes, hits, unseen = track_evidence.passing(measurements, scans, targets, 0, *at(2.0, math.radians(edge)))
        assert unseen == pytest.approx(0.5, abs=0.12)
        assert passes == pytest.approx(1.0 - unseen)
        assert hits == 0.0
    assert track_evidence.passing(measurements, scans, targets, 0, *at(2.0, math.pi)) == (0.0, 0.0, 1.0)


def body_at(x: float, y: float, sightings: int) -> Targets:
    """A disc that was seen so often."""
    targets = Targets(2)
    b = kalman.allocate(targets)
    kalman.reset(targets, b)
    targets.kind[b] = kalman.DISC
    for i, place in enumerate((x, y)):
        kalman.initiate_axis(targets, i, place - 0.2, place + 0.2, 1e-4, 1e-4)
    targets.existence[b] = track_evidence.EXISTENCE_AT_FIRST
    targets.measurement[b] = -1
    kalman.mark_seen(targets, b, 0)
    for _ in range(sightings):
        track_evidence.record_hit(targets, b)
        targets.sightings[b] += 1
    return targets


def test_what_beams_pass_through_is_gone_soon() -> None:
    measurements, scans = sweep_of(np.full(BEAMS, 4.0))
    targets, missed = body_at(2.0, 0.0, 20), 0
    likely = targets.existence[0]
    assert likely > 0.95
    while targets.state[0] == kalman.LIVE:
        measurements.time = 0.1 * missed
        track_evidence.record_miss(targets, 0, measurements, scans)
        assert targets.existence[0] < likely
        likely, missed = targets.existence[0], missed + 1
    assert targets.state[0] == kalman.ENDED
    assert targets.end[0] == track_evidence.FREE
    assert missed < 10


def test_a_sensor_that_has_never_seen_it_cannot_miss_it() -> None:
    measurements, scans = sweep_of(np.full(BEAMS, 4.0))
    targets = body_at(2.0, 0.0, 20)
    likely, measurements.sensor = targets.existence[0], 1
    track_evidence.record_miss(targets, 0, measurements, scans)
    assert targets.existence[0] == likely
    kalman.mark_seen(targets, 0, 1)
    track_evidence.record_miss(targets, 0, measurements, scans)
    assert targets.existence[0] < likely


def test_what_was_hardly_seen_is_forgotten_at_once() -> None:
    measurements, scans = sweep_of(np.full(BEAMS, 4.0))
    targets = body_at(2.0, 0.0, track_evidence.CONFIRMED_SIGHTINGS - 1)
    for _ in range(10):
        if targets.state[0] == kalman.LIVE:
            track_evidence.record_miss(targets, 0, measurements, scans)
    assert targets.state[0] == kalman.EMPTY


@pytest.mark.parametrize("moved", [0, 1])
def test_in_the_shadow_a_body_is_kept_for_a_time_or_until_its_place_is_uncertain(moved: int) -> None:
    measurements, scans = sweep_of(np.full(BEAMS, 1.0))
    targets = body_at(2.0, 0.0, 20)
    targets.moved[0], likely = moved, targets.existence[0]
    targets.first_time[0] = targets.last_time[0] - track_evidence.PATIENCE_STILL
    if moved:
        targets.cc[0] = targets.cc[1] = track_evidence.LOST_VAR - 0.1
    measurements.time = 100.0 if moved else track_evidence.PATIENCE_STILL - 0.1
    track_evidence.record_miss(targets, 0, measurements, scans)
    assert targets.state[0] == kalman.LIVE
    assert targets.existence[0] == likely
    if moved:
        targets.cc[0] = targets.cc[1] = track_evidence.LOST_VAR + 0.1
    else:
        measurements.time = track_evidence.PATIENCE_STILL + 0.1
    track_evidence.record_miss(targets, 0, measurements, scans)
    assert (targets.state[0], targets.end[0]) == (kalman.ENDED, track_evidence.LOST)


def test_what_is_outside_of_the_view_has_left_it() -> None:
    measurements, scans = sweep_of(np.full(91, 4.0), -45 * STEP)
    targets = body_at(-2.0, 0.0, 20)
    measurements.time = track_evidence.PATIENCE_STILL + 0.1
    track_evidence.record_miss(targets, 0, measurements, scans)
    assert (targets.state[0], targets.end[0]) == (kalman.ENDED, track_evidence.LEFT_VIEW)
