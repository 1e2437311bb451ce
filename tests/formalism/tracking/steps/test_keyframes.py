"""Looks at places in keyframes, and what they say of a target: sweeps made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import kalman, keyframes, track_evidence
from lidarcli.formalism.tracking.kalman import Sightings, Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import Measurements
from tests.formalism.tracking.steps.looking import BEAMS, GEOMETRIES, POSES, STEP, Pose, at, sweep_of

HIT, NOTHING, FREE = -1.0, 0.0, 1.0
Sweep = tuple[Measurements, Scans]


def kept(*sweeps: Sweep) -> Keyframes:
    """Keyframes a second apart."""
    frames = Keyframes(BEAMS + 1)
    for second, (meas, scans) in enumerate(sweeps):
        meas.time, meas.sweep = float(second), keyframes.SWEEPS_APART * second
        keyframes.store(frames, meas, scans)
    assert frames.count == len(sweeps)
    return frames


def look(
    frames: Keyframes, place: tuple[float, float], width: float = 0.5, seen_from: tuple[float, float] = (0, 0)
) -> float:
    keyframes.aim(frames, *place, width, *seen_from)
    return keyframes.look(frames, 0)


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("pose", POSES)
def test_a_place_is_passed_hit_or_hidden(geometry: str, pose: Pose) -> None:
    beams, first, step = GEOMETRIES[geometry]
    frames = kept(sweep_of(np.full(beams, 4.0), first, step, pose))
    for bearing in np.arange(-3.2, 3.2, 0.1):
        for r, seen in ((2.0, FREE), (3.7, FREE), (3.95, HIT), (4.05, HIT), (4.3, NOTHING), (6.0, NOTHING)):
            assert look(frames, at(r, float(bearing), pose)) == seen


def test_a_beam_around_a_place_that_does_not_pass_it_makes_it_less_free() -> None:
    # A post at one of them.
    ranges = np.full(BEAMS, 4.0)
    ranges[BEAMS // 2] = 1.0
    frames = kept(sweep_of(ranges))
    beams = np.arange(-5, 5) + 0.5
    hidden = np.abs(beams) < 2
    # Two metres away the guard is 2 beams to each side, near by it is 3.
    assert [look(frames, at(2.0, k * STEP)) for k in beams] == pytest.approx(np.where(hidden, (1 - 1 / 3) ** 2, FREE))
    assert [look(frames, at(1.0, k * STEP)) for k in beams] == np.where(np.abs(beams) < 3, HIT, FREE).tolist()
    assert look(frames, at(0.8, 0.0)) == FREE
    # With most of them the place is hidden.
    ranges[BEAMS // 2 - 1 : BEAMS // 2 + 2] = 1.0
    assert look(kept(sweep_of(ranges)), at(2.0, 0.0)) == NOTHING


def test_outside_of_a_partial_view_nothing_is_seen() -> None:
    frames = kept(sweep_of(np.full(91, 4.0), -45 * STEP))
    for degrees, inside in ((0, True), (43, True), (-43, True), (46, False), (-46, False), (180, False)):
        assert look(frames, at(2.0, math.radians(degrees))) == (FREE if inside else NOTHING)
        assert look(frames, at(4.0, math.radians(degrees))) == (HIT if inside else NOTHING)


def test_what_is_thin_may_stand_between_the_beams() -> None:
    frames = kept(sweep_of(np.full(BEAMS, 9.0)))
    for width, r in ((0.05, 4.0), (0.05, 6.0), (0.1, 6.0)):
        assert look(frames, at(r, 0.3), width) == pytest.approx(width / (r * STEP))
    assert look(frames, at(6.0, 0.3), 0.3) == FREE
    # A width that was hardly seen is no proof that the thing is thinner than a leg.
    assert look(frames, at(6.0, 0.3), 0.0) == look(frames, at(6.0, 0.3), 0.02) > 0.0


@pytest.mark.parametrize(
    ("seen_from", "seen"),
    [
        pytest.param((0.0, 0.0), FREE, id="same"),
        pytest.param((1.0, 1.0), FREE, id="near"),
        pytest.param((0.0, 2.0), NOTHING, id="another side"),
        pytest.param((18.0, 0.0), NOTHING, id="behind"),
        pytest.param((3.0, 0.0), NOTHING, id="nearer"),
        pytest.param((-3.0, 0.0), NOTHING, id="farther"),
    ],
)
def test_beams_without_a_return_show_free_space_from_the_same_view_only(
    seen_from: tuple[float, float], seen: float
) -> None:
    frames = kept(sweep_of(np.full(BEAMS, np.inf)))
    assert look(frames, (9.0, 0.0), 2.0, seen_from) == seen


def test_what_is_invalid_or_flickers_shows_no_free_space() -> None:
    ranges = np.full(BEAMS, np.inf)
    ranges[BEAMS // 4] = np.nan
    frames = kept(sweep_of(ranges))
    assert look(frames, at(9.0, 0.0), 2.0) == FREE
    assert look(frames, at(9.0, -math.pi / 2), 2.0) == NOTHING
    frames.changes[0], frames.lost[0] = 30.0, 100.0
    assert look(frames, at(9.0, 0.0), 2.0) == NOTHING


def test_beams_that_come_and_go_prove_nothing() -> None:
    rng = np.random.default_rng(1)
    calm, flickering = Keyframes(BEAMS), Keyframes(BEAMS)
    fixed = np.where(rng.random(BEAMS) < 0.3, np.inf, 4.0)
    for _ in range(20):
        still, scans = sweep_of(fixed)
        keyframes.count_flicker(calm, still, scans)
        changing, scans = sweep_of(np.where(rng.random(BEAMS) < 0.3, np.inf, 4.0))
        keyframes.count_flicker(flickering, changing, scans)
    assert still.steady
    assert not changing.steady


@pytest.mark.parametrize("first", [-math.pi, math.pi], ids=["counter-clockwise", "clockwise"])
@pytest.mark.parametrize("place", [(2.0, 1.0), (1.0, 2.0), (0.5, -2.5)])
def test_a_sensor_that_goes_during_a_sweep_sees_a_thing_where_it_is(first: float, place: tuple[float, float]) -> None:
    way = (0.8, 0.3, 0.5)
    share = np.arange(BEAMS) / (BEAMS - 1)
    step = -math.copysign(STEP, first)
    off = complex(*place) - share * complex(*way[:2])
    bearing = np.angle(off * np.exp(-1j * (first + step * np.arange(BEAMS) + share * way[2])))
    ranges = np.where(np.abs(bearing) * np.abs(off) < 0.2, np.abs(off), 6.0)
    assert (ranges < 6.0).any()
    frames = kept(sweep_of(ranges, first, step, way=way))
    assert look(frames, place) == HIT
    # In front of it the beams pass.
    assert look(frames, tuple(0.6 * np.array(place))) != HIT
    assert look(kept(sweep_of(ranges, first, step)), place) != HIT


def stored(seconds: float, rate: float, most: float = math.inf) -> np.ndarray:
    """Times of the keyframes of a log with so many sweeps a second, oldest first."""
    meas, scans = sweep_of(np.full(BEAMS, 4.0))
    frames = Keyframes(BEAMS)
    for sweep in range(int(seconds * rate)):
        meas.sweep, meas.time = sweep, sweep / rate
        keyframes.store(frames, meas, scans)
    times = np.sort([frames.time[m] for m in range(min(frames.count, keyframes.KEPT))])
    grown = Keyframes(2 * BEAMS)
    grown.grow(frames)
    assert grown.count == frames.count
    keyframes.aim(grown, 2.0, 0.0, 0.5, 0.0, 0.0)
    assert {keyframes.look(grown, m) for m in range(len(times))} == {FREE}
    return times


def test_the_latest_keyframes_are_kept_some_time_and_sweeps_apart() -> None:
    times = stored(210.0, 10.0)
    assert len(times) == keyframes.KEPT
    assert np.diff(times) == pytest.approx(keyframes.SECONDS_APART)
    assert times[-1] == pytest.approx(209.5)
    # Every second sweep of a slow sensor: two windows of it have room.
    assert np.diff(stored(60.0, 1.0)) == pytest.approx(2.0)


def sighting(time: float, place: tuple[float, float] = (2.0, 0.0), travelled: float = 0.0) -> Sightings:
    """A thing of 0.5 m that was seen from the origin."""
    sightings = Sightings()
    sightings.resize(1)
    sightings.time[0], sightings.chord[0], sightings.travelled[0] = time, 0.5, travelled
    sightings.middle_x[0], sightings.middle_y[0] = place
    return sightings


def occupied(place: tuple[float, float]) -> Sweep:
    """A sweep in which something stands at a place."""
    ranges = np.full(BEAMS, 4.0)
    bearing, r = math.atan2(place[1], place[0]), math.hypot(*place)
    near = np.abs(np.arange(BEAMS) * STEP - math.pi - bearing) < 0.25 / r
    ranges[near] = r
    return sweep_of(ranges)


def test_looks_are_counted_before_and_after() -> None:
    frames = kept(*[occupied((2.0, 0.0))] * 3, *[sweep_of(np.full(BEAMS, 4.0))] * 5)
    looks = np.empty((1, 4))
    for time, counts in ((3.5, (1, 3, 4, 0)), (1.5, (0, 2, 5, 1)), (-0.5, (0, 0, 5, 3)), (90.0, (0, 0, 0, 0))):
        frames.count_looks(sighting(time), np.zeros(1, np.int64), looks)
        assert tuple(looks[0]) == counts
    frames.count_looks(sighting(3.5, travelled=keyframes.MAX_WAY + 0.1), np.zeros(1, np.int64), looks)
    assert not looks.any()


def test_something_stood_where_hits_outweigh_free_looks() -> None:
    free, stands = sweep_of(np.full(BEAMS, 4.0)), occupied((2.0, 0.0))
    frames = kept(free, stands, stands, free)
    for until, stood in ((0.5, False), (1.5, False), (2.5, True), (3.5, False), (-1.0, False)):
        assert frames.stood(sighting(4.0), 0, -math.inf, until) == stood
    assert not frames.stood(sighting(4.0), 0, 2.75, 3.0)
    assert not frames.stood(sighting(keyframes.SECONDS_BEFORE + 10.0), 0, -math.inf, 2.5)
    assert not frames.stood(sighting(4.0, (-2.0, 0.0)), 0, -math.inf, 2.5)


@pytest.mark.parametrize(("before", "left"), [("free", True), ("stands", False), ("nothing", True)])
def test_a_target_has_left_only_for_a_place_that_was_free(before: str, left: bool) -> None:
    """It was last at rest at (2, 1), which beams pass now, and is seen at (2, 0)."""
    now, scans = occupied((2.0, 0.0))
    assert now.count > 0
    k = min(range(now.count), key=lambda k: math.hypot(now.middle_x[k] - 2.0, now.middle_y[k]))
    sweeps = {"free": [sweep_of(np.full(BEAMS, 4.0))] * 3, "stands": [occupied((2.0, 0.0))] * 3, "nothing": []}
    frames = kept(*sweeps[before])
    now.time = 6.0
    targets = Targets(1)
    kalman.reset(targets, kalman.allocate(targets))
    targets.kind[0] = kalman.DISC
    for i, (place, speed) in enumerate(((2.0, 0.0), (0.0, -0.5))):
        kalman.initiate_axis(targets, i, place - 0.2, place + 0.2, 1e-4, 1e-4)
        targets.v[i] = speed
    targets.birth_x[0], targets.birth_y[0] = 2.0, 1.0
    assert track_evidence.has_left(targets, 0, now, scans, k, frames) == left
    # Less than a step away, it has not.
    targets.birth_y[0] = 0.1
    assert not track_evidence.has_left(targets, 0, now, scans, k, frames)
