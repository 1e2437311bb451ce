"""The published rules of `make tracking`: what each does with one or two things on a straight way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.tracking.filters import Filters
from benchmarks.tracking.more_rules import LegTracker, Sort
from benchmarks.tracking.rules import Datmo, DynamicObstacleDetector, ObstacleDetector, Rules, Seen
from lidarcli.sweeps.types import Float64

STEP = 0.1
SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.15
ALL: list[Callable[[], Rules]] = [Datmo, DynamicObstacleDetector, ObstacleDetector, Sort, LegTracker]


def seen(*places: tuple[float, float], width: float = 0.3) -> Seen:
    """Boxes of 30 cm at these places."""
    place = np.array(places, float).reshape(-1, 2)
    return Seen(STEP, place, np.full(len(place), width), place[:, None] + SQUARE)


def walk(rules: Rules, sweeps: int, speed: float = 0.5) -> tuple[list[int], Float64]:
    """Something that goes along x: its tracks, and its velocity at the end."""
    tracks, velocity = [], np.zeros((1, 2))
    for sweep in range(sweeps):
        track, velocity = rules.step(seen((speed * STEP * sweep, 2.0)))
        tracks += track.tolist()
    return tracks, velocity[0]


@pytest.mark.parametrize("make", ALL)
def test_one_thing_is_one_track_with_its_velocity(make: Callable[[], Rules]) -> None:
    tracks, velocity = walk(make(), 60)
    assert tracks == [1] * 60
    assert velocity == pytest.approx([0.5, 0.0], abs=0.01)


@pytest.mark.parametrize("make", ALL)
def test_two_things_are_two_tracks_in_either_order(make: Callable[[], Rules]) -> None:
    rules = make()
    a, b = (0.0, 1.0), (0.0, 3.0)
    assert [rules.step(seen(a, b))[0].tolist(), rules.step(seen(b, a))[0].tolist()] == [[1, 2], [2, 1]]


@pytest.mark.parametrize(
    ("make", "missed", "again"),
    [
        (Datmo, 1, False),
        (Sort, 1, True),
        (Sort, 2, False),
        (DynamicObstacleDetector, 8, True),
        (DynamicObstacleDetector, 11, False),
        (ObstacleDetector, 18, True),
        (ObstacleDetector, 21, False),
        (LegTracker, 3, True),
        (LegTracker, 60, False),
    ],
)
def test_how_long_a_track_lives_unseen(make: Callable[[], Rules], missed: int, again: bool) -> None:
    rules = make()
    walk(rules, 20, 0.0)
    for _ in range(missed):
        assert len(rules.step(seen())[0]) == 0
    assert (rules.step(seen((0.0, 2.0)))[0].tolist() == [1]) is again


@pytest.mark.parametrize(
    ("make", "near", "far"), [(Datmo, 0.24, 0.26), (DynamicObstacleDetector, 0.54, 0.56), (ObstacleDetector, 0.29, 0.31)]
)
def test_the_gate(make: Callable[[], Rules], near: float, far: float) -> None:
    for away, same in ((near, True), (far, False)):
        rules = make()
        walk(rules, 20, 0.0)
        assert (rules.step(seen((away, 2.0)))[0].tolist() == [1]) is same


def test_leg_tracker_makes_a_person_of_two_legs_that_walk_together() -> None:
    rules = LegTracker()
    tracks = []
    for sweep in range(40):
        x = 0.1 * sweep
        tracks.append(rules.step(seen((x, 2.0), (x, 2.3), width=0.12))[0].tolist())
    assert tracks[0] == [1, 2]
    assert tracks[-1] == [3, 3]
    # What stands side by side never becomes one.
    rules = LegTracker()
    assert [rules.step(seen((0, 2.0), (0, 2.3), width=0.12))[0].tolist() for _ in range(40)][-1] == [1, 2]
    # Nor does what is wider than a leg.
    rules = LegTracker()
    assert rules.step(seen((0, 2.0), (0, 2.6)))[0].tolist() == [1, 2]
    for sweep in range(40):
        track, _ = rules.step(seen((0.1 * sweep, 2.0), (0.1 * sweep, 2.6)))
    assert track.tolist() == [1, 2]


def test_obstacle_detector_splits_and_joins() -> None:
    rules = ObstacleDetector()
    walk(rules, 20, 0.0)
    parts = rules.step(seen((-0.1, 2.0), (0.1, 2.0)))[0].tolist()
    assert 1 not in parts
    assert len(set(parts)) == 2
    for _ in range(20):
        assert rules.step(seen((-0.1, 2.0), (0.1, 2.0)))[0].tolist() == parts
    assert rules.step(seen((0.0, 2.0)))[0].tolist()[0] not in {1, *parts}


def test_a_filter_step_by_hand() -> None:
    filters = Filters(np.array([1.0, 4.0]), np.array([0.0, 1.0]), 2.0)
    assert filters.add(np.array([[1.0, 5.0]])).tolist() == [1]
    filters.predict(0.5)
    # Variance of the place 1 + 0.25 · 4, with the velocity 0.5 · 4, of the velocity 4 + 1.
    assert filters.covariance[0].tolist() == [[2.0, 2.0], [2.0, 5.0]]
    filters.correct(np.array([0]), np.array([[2.0, 5.0]]))
    # Gains 2 / 4 and 2 / 4.
    assert filters.state[0].tolist() == [[1.5, 5.0], [0.5, 0.0]]
    assert filters.covariance[0].tolist() == [[1.0, 1.0], [1.0, 4.0]]
