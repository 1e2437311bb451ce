"""Crossings and visits of exact paths whose truth is known from how they were drawn."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from lidarcli.formalism.zones import CLEAR, MARGIN, TrackPath, Visit, crossings, visits
from lidarcli.sweeps.masks import Circle, Polygon
from lidarcli.sweeps.types import Float64
from lidarcli.sweeps.zone import Line

STEP_NS = 50_000_000


def path_of(points: Any, first_ns: int = 0, unseen: Sequence[int] = ()) -> TrackPath:
    points = np.asarray(points, np.float64).reshape(-1, 2)
    steps = ~np.isin(np.arange(len(points)), unseen)
    return TrackPath(first_ns + np.arange(len(points)) * STEP_NS, points[:, 0], points[:, 1], steps)


def walked(corners: Sequence[tuple[float, float]], step: float) -> Float64:
    """Points on the way from corner to corner, `step` [m] apart and on the corners themselves."""
    pieces = [np.array(corners[:1])]
    for (x, y), (next_x, next_y) in pairwise(corners):
        count = max(int(np.ceil(np.hypot(next_x - x, next_y - y) / step)), 1)
        share = np.arange(1, count + 1)[:, None] / count
        pieces.append(np.array([[x, y]]) * (1.0 - share) + np.array([[next_x, next_y]]) * share)
    return np.concatenate(pieces)


ACTS = ("cross", "touch", "dip", "beside", "away")


def drawn_route(rng: np.random.Generator, margin: float = 0.0) -> tuple[Line, list[tuple[float, float]], int, int]:
    """A line, the corners of a route across or beside it, and how often it goes in and out.

    The route is drawn along a line on the x axis, whose left side is y > 0, and both are moved to some place. With a
    `margin` [m] it counts the same when it is known to that only.
    """
    length = rng.uniform(0.8, 3.0)
    side = float(rng.choice([-1.0, 1.0]))
    route = [(rng.uniform(0.1, 0.9) * length, side * rng.uniform(0.4, 1.2))]
    ways = {1.0: 0, -1.0: 0}
    for _ in range(int(rng.integers(1, 7))):
        along = rng.uniform(0.1, 0.9) * length
        deep = rng.uniform(CLEAR + 0.05 + margin, 1.0)
        match rng.choice(ACTS):
            case "cross":
                route += [(along, side * 0.3), (along, -side * deep)]
                side = -side
                ways[side] += 1
            case "touch":
                route += [(along, side * 0.25), (along, side * (margin + rng.choice([0.0, 0.01]))), (along, side * deep)]
            case "dip":
                turn = -side * rng.uniform(0.02, CLEAR - 0.02 - margin)
                route += [(along, side * 0.25), (along, turn), (along, side * deep)]
            case "beside":
                off = rng.uniform(0.05 + margin, 1.0)
                beyond = length + off if rng.random() < 0.5 else -off
                route += [(beyond, side * 0.5), (beyond, -side * 0.5)]
                side = -side
            case "away":
                route.append((along, side * rng.uniform(0.5, 2.0)))
    turn, x, y = rng.uniform(-np.pi, np.pi), *rng.uniform(-3.0, 3.0, 2)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    moved = [(float(a), float(b)) for a, b in np.array(route) @ turned + (x, y)]
    ends = np.array([[0.0, 0.0], [length, 0.0]]) @ turned + (x, y)
    return Line(tuple(ends[0]), tuple(ends[1])), moved, ways[1.0], ways[-1.0]


def test_routes_that_cross_touch_turn_back_and_pass_beside() -> None:
    rng = np.random.default_rng(3)
    counts = 0
    for number in range(200):
        line, route, into, out = drawn_route(rng)
        path = path_of(walked(route, 0.06))
        found, one_sided, unseen = crossings(line, path)
        ways = [each.inwards for each in found]
        assert (ways.count(True), ways.count(False), one_sided, unseen) == (into, out, [], []), (number, line, route)
        counts += len(found)
    assert counts > 140


LINE = Line((0.0, 0.0), (2.0, 0.0))


def crossed(*corners: tuple[float, float]) -> tuple[list[bool], int]:
    found, one_sided, _ = crossings(LINE, path_of(walked(corners, 0.05)))
    return [each.inwards for each in found], len(one_sided)


def test_a_path_that_begins_or_ends_beside_the_line_is_seen_on_one_side_only() -> None:
    assert crossed((1.0, -0.1), (1.0, 1.0)) == ([], 1)
    assert crossed((1.0, -1.0), (1.0, 0.1)) == ([], 1)
    assert crossed((1.0, -0.1), (1.0, 0.1)) == ([], 1)
    assert crossed((1.0, 0.1), (1.0, -0.1), (1.0, 1.0)) == ([], 0), "it came back"


def test_the_event_is_the_first_place_behind_the_line() -> None:
    path = path_of([(1.0, y) for y in (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)])
    assert crossings(LINE, path)[0] == [(3, True)]


def test_places_that_are_not_known_do_not_hide_a_crossing() -> None:
    path = path_of([(1.0, -0.5), (np.nan, np.nan), (1.0, 0.5)])
    assert crossings(LINE, path) == ([(2, True)], [], [])


def test_a_crossing_that_no_sweep_saw_is_counted_apart() -> None:
    there = [(1.0, y) for y in (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)]
    assert crossings(LINE, path_of(there, unseen=[3])) == ([], [], [(3, True)])
    assert crossings(LINE, path_of(there, unseen=[2, 4])) == ([(3, True)], [], []), "hidden beside the line"
    both = path_of([*there, *there[::-1]], unseen=[3])
    assert crossings(LINE, both) == ([(9, False)], [], [(3, True)]), "it came back in sight"


def visits_of(shape: Circle | Polygon, path: TrackPath) -> list[Visit]:
    return visits([shape], np.zeros(len(path.x), np.int64), path)


def slow_visits(shape: Circle | Polygon, points: Float64, distance: Float64, within: Any) -> list[Visit]:
    """Visits by a walk over all places."""
    found: list[Visit] = []
    first = None
    for k in range(len(points)):
        if first is None and within[k]:
            first = k
        if first is not None and not distance[k] <= MARGIN:
            found.append(Visit(first, k - 1, first == 0))
            first = None
    if first is not None:
        found.append(Visit(first, len(points) - 1, True))
    return found


def test_visits_of_a_circle_by_random_walks() -> None:
    rng = np.random.default_rng(5)
    circle = Circle(0.5, -0.25, 0.8)
    several = 0
    for _ in range(200):
        points = np.cumsum(rng.normal(0.0, 0.15, (120, 2)), axis=0) + rng.uniform(-1.0, 1.0, 2)
        points[rng.random(120) < 0.02] = np.nan
        away = np.hypot(points[:, 0] - 0.5, points[:, 1] + 0.25)
        expected = slow_visits(circle, points, away - 0.8, away < 0.8)
        assert visits_of(circle, path_of(points)) == expected
        several += len(expected) > 1
    assert several > 20
