"""Where it was free: remembered sweeps, and the beams of the sweep at hand, made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import kalman, measurement, track_evidence
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.measurement import Measurements, RangeHistory
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.sweeps import TURN
from tests.formalism.tracking.steps.looking import Pose, look_at
from tests.sweeping import raw_sweeps

BEAMS = 360
STEP = TURN / BEAMS
HERE: Pose = (0.0, 0.0, 0.0, 1.0)


def sweep_of(
    ranges: np.ndarray, first: float = -math.pi, step: float = STEP, pose: Pose = HERE
) -> tuple[Measurements, Scans]:
    """One sweep, seen from there."""
    raw = raw_sweeps(ranges[None], angle_min=first, angle_increment=step, range_max=50.0)
    return look_at(normalise(raw, np.arange(1), RangeRules()), pose)


def remembered(measurements: Measurements, scans: Scans) -> RangeHistory:
    history = RangeHistory(BEAMS + 1)
    measurement.store_sweep(history, measurements, scans)
    return history


def at(r: float, bearing: float, pose: Pose = HERE) -> tuple[float, float]:
    """A point of the world by range and bearing of the sensor."""
    direction = pose[2] + pose[3] * bearing
    return pose[0] + r * math.cos(direction), pose[1] + r * math.sin(direction)


GEOMETRIES = {
    "turn": (BEAMS, -math.pi, STEP),
    "clockwise": (BEAMS, math.pi, -STEP),
    "from ahead": (BEAMS, 0.0, STEP),
    "twice": (BEAMS + 1, -math.pi, STEP),
    "more than once around": (BEAMS, 2.0, STEP),
}
POSES: tuple[Pose, ...] = (HERE, (1.0, -2.0, 0.7, 1.0), (1.0, -2.0, 3.0, -1.0))


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("pose", POSES)
def test_beams_passed_what_is_nearer_than_their_ends(geometry: str, pose: Pose) -> None:
    beams, first, step = GEOMETRIES[geometry]
    measurements, scans = sweep_of(np.full(beams, 4.0), first, step, pose)
    history = remembered(measurements, scans)
    for bearing in np.arange(-3.2, 3.2, 0.1):
        for r, passed, hit in ((2.0, True, False), (3.6, True, False), (4.0, False, True), (5.0, False, False)):
            x, y = at(r, float(bearing), pose)
            assert measurement.was_passed(history, 0, x, y, 0.1) == passed
            assert measurement.was_hit(history, 0, x, y) == hit


def test_all_four_beams_around_a_point_have_to_pass_it() -> None:
    # A post at one of them.
    ranges = np.full(BEAMS, 4.0)
    ranges[180] = 1.0
    measurements, scans = sweep_of(ranges)
    history = remembered(measurements, scans)
    asked = [measurement.was_passed(history, 0, *at(2.0, k * STEP), 0.1) for k in np.arange(-5, 5) + 0.5]
    # The post is at bearing 0, between -0.5 and 0.5 steps.
    assert asked == [True, True, True, False, False, False, False, True, True, True]
    assert measurement.was_passed(history, 0, *at(0.8, 0.0), 0.1)


def test_outside_of_a_partial_view_nothing_was_passed() -> None:
    measurements, scans = sweep_of(np.full(91, 4.0), -45 * STEP)
    history = remembered(measurements, scans)
    for degrees, passed in ((0, True), (43, True), (-43, True), (46, False), (-46, False), (180, False)):
        x, y = at(2.0, math.radians(degrees))
        assert measurement.was_passed(history, 0, x, y, 0.1) == passed
        assert measurement.was_hit(history, 0, *at(4.0, math.radians(degrees))) == passed


def test_a_beam_without_a_return_passed_everything_where_such_beams_are_steady() -> None:
    ranges = np.full(BEAMS, np.inf)
    ranges[90] = np.nan
    measurements, scans = sweep_of(ranges)
    assert measurement.was_passed(remembered(measurements, scans), 0, *at(9.0, 0.0), 0.1)
    # One that is invalid tells nothing.
    assert not measurement.was_passed(remembered(measurements, scans), 0, *at(9.0, -math.pi / 2), 0.1)
    measurements.steady = False
    assert not measurement.was_passed(remembered(measurements, scans), 0, *at(9.0, 0.0), 0.1)


def test_beams_that_come_and_go_prove_nothing() -> None:
    rng = np.random.default_rng(1)
    calm, flickering = RangeHistory(BEAMS), RangeHistory(BEAMS)
    fixed = np.where(rng.random(BEAMS) < 0.3, np.inf, 4.0)
    for _ in range(20):
        still, scans = sweep_of(fixed)
        measurement.count_flicker(calm, still, scans)
        changing, scans = sweep_of(np.where(rng.random(BEAMS) < 0.3, np.inf, 4.0))
        measurement.count_flicker(flickering, changing, scans)
    assert still.steady
    assert not changing.steady


def test_the_latest_sweeps_are_kept_some_time_apart() -> None:
    measurements, scans = sweep_of(np.full(BEAMS, 4.0))
    history = RangeHistory(BEAMS)
    times = np.arange(0, 60, 0.1)
    for time in times:
        measurements.time = float(time)
        measurement.store_sweep(history, measurements, scans)
    kept = sorted(history.time[m] for m in range(measurement.SWEEPS_KEPT))
    gaps = np.diff(kept)
    assert (gaps >= measurement.SWEEPS_APART - 1e-9).all()
    assert gaps.max() < measurement.SWEEPS_APART + 0.11
    assert kept[-1] > times[-1] - measurement.SWEEPS_APART
    grown = RangeHistory(2 * BEAMS)
    grown.grow(history)
    assert [measurement.was_passed(grown, m, 2.0, 0.0, 0.1) for m in range(measurement.SWEEPS_KEPT)] == [
        True
    ] * measurement.SWEEPS_KEPT


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
