"""The ground that a run saw, and how two lie on each other, by drawn grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy, TooLargeError
from lidarcli.formalism.matching.alignment import refine
from lidarcli.formalism.matching.free_space import HERE, OBSERVED_FREE, REACH, Nearest, SpaceMap, SpaceMotion, of_map

SIDE = 0.05


def room(width: float = 6.0, height: float = 4.0, corner: tuple[float, float] = (-3.0, -2.0)) -> SpaceMap:
    """A room with a niche in its upper right corner, seen free within its walls and not at all outside of them."""
    columns, rows = round(width / SIDE), round(height / SIDE)
    cells = np.full((rows, columns), UNKNOWN, np.int8)
    cells[2:-2, 2:-2] = FREE
    cells[2, 2:-2] = cells[-3, 2:-2] = OCCUPIED
    cells[2:-2, 2] = cells[2:-2, -3] = OCCUPIED
    cells[-30:-2, -30:-2] = UNKNOWN
    cells[-30, -30:-2] = cells[-30:-2, -30] = OCCUPIED
    return of_map(Occupancy(SIDE, *corner, cells))


def test_cells_and_points_of_a_map() -> None:
    ground = room()
    x, y = np.array([0.0, -2.875, 2.5, 50.0]), np.array([0.0, 0.0, 1.5, 0.0])
    assert ground.state(x, y).tolist() == [FREE, OCCUPIED, UNKNOWN, UNKNOWN]
    assert ground.passed(x, y).tolist() == [OBSERVED_FREE, 0, 0, 0]
    assert ground.seen(x, y).tolist() == [OBSERVED_FREE, OBSERVED_FREE, 0, 0]
    assert len(ground.points) == np.count_nonzero(ground.cells == OCCUPIED)
    assert (ground.state(*ground.points.T) == OCCUPIED).all()


def test_a_moved_ground_is_the_same_elsewhere() -> None:
    ground, motion = room(), SpaceMotion(0.5 * math.pi, 2.0, -1.0)
    moved = ground.moved(motion)
    x, y = np.array([0.0, -2.0, 2.0]), np.array([0.5, 1.0, -1.0])
    assert moved.state(*motion.of(x, y)).tolist() == ground.state(x, y).tolist()
    places = np.column_stack(motion.of(*ground.points.T))
    assert moved.points == pytest.approx(places)


def test_the_nearest_point_is_found_within_reach_and_no_farther() -> None:
    ground = room()
    near = Nearest(ground)
    x, y = np.array([-2.6, 0.0, 2.8]), np.array([0.0, 0.0, -1.6])
    index, away = near.of(x, y)
    brute = np.hypot(x[:, None] - ground.points[:, 0], y[:, None] - ground.points[:, 1])
    assert index[1] == -1
    assert math.isinf(away[1])
    assert brute[1].min() > REACH
    for at in (0, 2):
        assert away[at] == pytest.approx(brute[at].min(), abs=SIDE)
    assert near.area == pytest.approx(np.count_nonzero(ground.cells == FREE) * SIDE**2, rel=0.05)


def test_grounds_far_apart_are_not_laid_over_each_other() -> None:
    with pytest.raises(TooLargeError, match=r"^1,006 x 1,004 m$"):
        room().over(room(corner=(997.0, 998.0)))
    with pytest.raises(TooLargeError):
        room(30_000.0, 3.0).moved(SpaceMotion(0.8, 0.0, 0.0))


@pytest.mark.parametrize("motion", [SpaceMotion(0.03, 0.12, -0.08), SpaceMotion(-0.05, -0.1, 0.15)])
def test_refining_brings_points_back_onto_their_walls(motion: SpaceMotion) -> None:
    near = Nearest(room())
    points = np.column_stack(motion.inverse.of(*near.ground.points.T))
    found = refine(near, points, HERE)
    assert np.column_stack(found.of(*points.T)) == pytest.approx(near.ground.points, abs=0.02)
