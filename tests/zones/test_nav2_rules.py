"""Insides, cases and approach, compared with the rules of Nav2 written as plain loops."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from lidarcli.formalism.zones import Inside, collision_steps, times
from lidarcli.sweeps.masks import Circle, Polygon
from lidarcli.sweeps.zone import Case, crossing_edges, inside

Point = tuple[float, float]


def is_in_polygon(corners: Sequence[Point], point: Point) -> bool:
    """Cast a ray towards +x from the point; an edge counts from just above its lower end up to its upper end."""
    x, y = point
    within = False
    for k in range(len(corners)):
        x0, y0 = corners[k - 1]
        x1, y1 = corners[k]
        if (y <= y0) == (y > y1):
            crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
            if crossing > x:
                within = not within
    return within


def is_in_circle(radius: float, point: Point) -> bool:
    return point[0] * point[0] + point[1] * point[1] < radius * radius


def is_covered(velocity: tuple[float, float, float], linear: Point, turning: Point, direction: Point | None) -> bool:
    """Tell whether a case of a velocity polygon is for a velocity; only holonomic robots have a direction."""
    ahead, left, turn = velocity
    if not turning[0] <= turn <= turning[1]:
        return False
    if direction is None:
        return linear[0] <= ahead <= linear[1]
    speed = math.hypot(ahead, left)
    if not linear[0] <= speed <= linear[1]:
        return False
    heading = math.atan2(left, ahead) if speed > 0 else 0.0
    first, last = direction
    if first <= last:
        return first <= heading <= last
    return heading >= first or heading <= last


def counts_on_the_way(
    corners: Sequence[Point] | float,
    points: Sequence[Point],
    velocity: tuple[float, float, float],
    time_before_collision: float,
    time_step: float,
) -> list[int]:
    """Count the points inside at each tested time; a number in place of corners is the radius of a circle."""
    x = y = yaw = 0.0
    ahead, left, turn = velocity
    counts = []
    time = 0.0
    while time <= time_before_collision:
        x, y, yaw = x + ahead * time_step, y + left * time_step, yaw + turn * time_step
        cos, sin = math.cos(turn * time_step), math.sin(turn * time_step)
        ahead, left = ahead * cos - left * sin, ahead * sin + left * cos
        cos, sin = math.cos(yaw), math.sin(yaw)
        number = 0
        for px, py in points:
            dx, dy = px - x, py - y
            moved = dx * cos + dy * sin, -dx * sin + dy * cos
            if isinstance(corners, float):
                number += is_in_circle(corners, moved)
            else:
                number += is_in_polygon(corners, moved)
        counts.append(number)
        time += time_step
    return counts


POINTS = 20
"""Points of each random shape."""
SQUARE = ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))


def corners_of(random: np.random.Generator, side: int = 4) -> tuple[tuple[float, float], ...]:
    """Corners on a grid: of a star, or in any order."""
    corners = random.integers(-side, side + 1, (int(random.integers(3, 9)), 2)).astype(float)
    if random.integers(2):
        corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]), kind="stable")]
    return tuple((float(x), float(y)) for x, y in corners)


def points_of(random: np.random.Generator, number: int, side: int = 5) -> np.ndarray:
    """Points on a grid of half its step: many lie on edges and corners."""
    return random.integers(-2 * side, 2 * side + 1, (number, 2)) / 2


@pytest.mark.slow
def test_insides_are_those_of_nav2_in_100_000_cases() -> None:
    random = np.random.default_rng(1)
    edges = 0
    for _ in range(4500):
        corners, points = corners_of(random), points_of(random, POINTS, side=4)
        told = inside(Polygon(corners), points[:, 0], points[:, 1])
        expected = [is_in_polygon(corners, (x, y)) for x, y in points.tolist()]
        edges += sum(on_edge(corners, point) < 1e-12 for point in points.tolist())
        assert told.tolist() == expected, corners
    assert edges > 5_000, "points on edges are the hard ones"
    for _ in range(500):
        radius, points = float(random.integers(1, 11)) / 2, points_of(random, POINTS)
        told = inside(Circle(0.0, 0.0, radius), points[:, 0], points[:, 1])
        assert told.tolist() == [is_in_circle(radius, (x, y)) for x, y in points.tolist()], radius


def on_edge(corners: tuple[tuple[float, float], ...], point: list[float]) -> float:
    """The way by which a detour over a point is longer than the nearest edge."""
    return min(
        math.dist(a, point) + math.dist(point, b) - math.dist(a, b)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    )


def test_a_point_on_an_edge_of_two_polygons_is_in_one_of_them() -> None:
    y = np.linspace(-1.0, 1.0, 9)
    left = Polygon(((-1.0, -1.0), (0.0, -1.0), (0.0, 1.0), (-1.0, 1.0)))
    right = Polygon(((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)))
    both = inside(left, 0.0 * y, y).astype(int) + inside(right, 0.0 * y, y)
    assert both.tolist() == [0, *[1] * 8]


def test_cases_cover_the_velocities_that_nav2_says() -> None:
    random = np.random.default_rng(2)
    still = 0
    for _ in range(2000):
        numbers = (random.integers(-4, 5, 6) / 4).tolist()
        linear, turning = tuple(sorted(numbers[:2])), tuple(sorted(numbers[2:4]))
        direction = (numbers[4] * math.pi, numbers[5] * math.pi) if random.integers(2) else None
        # A zero has a sign, and a robot that stands may have any.
        velocity = random.integers(-4, 5, (50, 3)) / 4 * random.choice([-1.0, 1.0], (50, 3))
        velocity[: len(velocity) // 5, :2] *= 0.0
        told = Case("case", Polygon(SQUARE), linear, turning, direction).covers(velocity)  # type: ignore[arg-type]
        expected = [is_covered(tuple(each), linear, turning, direction) for each in velocity.tolist()]  # type: ignore[arg-type]
        still += sum(expected[: len(velocity) // 5])
        assert told.tolist() == expected, (linear, turning, direction)
    assert still > 1000


@pytest.mark.slow
@pytest.mark.parametrize("turns", [False, True])
def test_approach_steps_are_those_of_nav2(turns: bool) -> None:
    random = np.random.default_rng(3)
    met = 0
    for number in range(60):
        sweeps, points = 20, points_of(random, 1000, side=8)
        row = random.integers(0, sweeps, len(points))
        velocity = random.integers(-4, 5, (sweeps, 3)) / 2
        velocity[:, 2] *= 0.618 if turns else 0.0
        if turns:
            # Rounding decides of points on edges: sines differ in their last digit.
            points = points + random.uniform(0.01, 0.2, points.shape)
        corners = 1.5 if number % 4 == 0 else corners_of(random, side=2)
        shape = Circle(0.0, 0.0, corners) if isinstance(corners, float) else Polygon(corners)
        told = collision_steps(shape, at(row, *points.T), velocity, 2.0, 0.25)
        for sweep in range(sweeps):
            mine = [(x, y) for x, y in points[row == sweep].tolist()]
            expected = counts_on_the_way(corners, mine, tuple(velocity[sweep].tolist()), 2.0, 0.25)  # type: ignore[arg-type]
            assert told[sweep].tolist() == expected
            met += sum(expected)
    assert met > 5_000


def at(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> Inside:
    """Points of these sweeps, each of the first beam."""
    return Inside(row, np.zeros(len(row), int), x, y)


def first(counts: np.ndarray, ahead: float, step: float) -> float:
    """The time that is told for the first of one row of counts."""
    return float(times(ahead, step)[np.flatnonzero(counts[0])[0]])


def test_a_wall_ahead_is_met_when_the_way_to_it_is_gone() -> None:
    wall = np.linspace(-0.3, 0.3, 7)
    counts = collision_steps(
        Polygon(SQUARE), at(np.zeros(7, int), np.full(7, 1.3), wall), np.array([[0.5, 0.0, 0.0]]), 3.0, 0.1
    )
    # 0.8 m at 0.5 m/s; the robot has moved by a step more than the time that is told.
    assert first(counts, 3.0, 0.1) == pytest.approx(1.5, abs=0.1)
    assert set(counts[0].tolist()) == {0, 7}


def test_a_bar_that_turns_on_the_spot_meets_what_is_beside_it() -> None:
    bar = Polygon(((1.0, 0.05), (1.0, -0.05), (-1.0, -0.05), (-1.0, 0.05)))
    x, y = np.array([0.8 * math.cos(1.0)]), np.array([0.8 * math.sin(1.0)])
    counts = collision_steps(bar, at(np.zeros(1, int), x, y), np.array([[0.0, 0.0, 0.5]]), 3.0, 0.05)
    # The edge is 0.05 m before the middle of the bar, at 0.8 m.
    assert first(counts, 3.0, 0.05) == pytest.approx((1.0 - math.asin(0.05 / 0.8)) / 0.5, abs=0.1)


def test_agents_come_to_a_robot_that_stands() -> None:
    x, y = np.array([2.5, 2.5]), np.array([0.0, 0.1])
    coming = np.array([[-1.0, 0.0], [1.0, 0.0]])
    counts = collision_steps(Polygon(SQUARE), at(np.zeros(2, int), x, y), np.zeros((1, 3)), 3.0, 0.1, point_velocity=coming)
    assert first(counts, 3.0, 0.1) == pytest.approx(2.0, abs=0.11)
    assert counts.max() == 1


def test_edges_that_cross_are_found() -> None:
    assert crossing_edges(Polygon(SQUARE)) is None
    assert crossing_edges(Polygon(((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)))) == (1, 3)
    assert crossing_edges(Polygon(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, -1.0)))) == (1, 3)
    touching = Polygon(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.0), (0.0, 2.0)))
    assert crossing_edges(touching) == (1, 3)
    bow_tie = Polygon(((-3.0, -1.0), (0.0, 0.0), (3.0, 1.0), (3.0, -1.0), (0.0, 0.0), (-3.0, 1.0)))
    assert crossing_edges(bow_tie) == (1, 4)
    there_and_back = Polygon(((0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    assert crossing_edges(there_and_back) == (1, 3)
    assert crossing_edges(Polygon((*SQUARE, SQUARE[0]))) is None, "the first corner, told once more"
    assert crossing_edges(Polygon(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))) is None
