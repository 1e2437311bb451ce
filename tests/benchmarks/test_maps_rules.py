"""The rules of `make maps`: what each makes of a few beams, counted by hand, and how maps are scored."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.maps.rules import Ground, LogOdds, PerBeam, crossed, ground_of, log_odds, maps_by_rules, published, stepped
from benchmarks.maps.scoring import Score, score, wrong
from lidarcli.formalism.mapping.grid import FREE, HIT, OCCUPIED, SKIPPED, UNKNOWN, Beams, Occupancy

GROUND = Ground(1.0, 0, 0, 8, 4)
START = np.array([0.5, 0.5])
FAR, NEAR = [5.5, 0.5], [3.5, 0.5]
"""Ends of beams along the lowest row: in the cell of column 5, and of column 3."""


def sweeps(rule: PerBeam | LogOdds, *sweeps_: list[list[float]]) -> None:
    """Let the rule take sweeps of beams with these ends."""
    for ends in sweeps_:
        rule.add(GROUND, START, np.array(ends))


def occupied(rule: PerBeam | LogOdds, name: str) -> list[int]:
    """Columns of the lowest row that are occupied; nothing else may be."""
    cells, known = rule.occupied()[name]
    assert not (cells & ~known).any()
    found = np.flatnonzero(cells)
    assert (found < GROUND.width).all()
    return [int(column) for column in found]


def world(*ends: list[list[float]]) -> Beams:
    """Sweeps of beams from (0.5, 0.5) to these ends [m]; NaN is skipped."""
    points = np.array(ends, float).transpose(2, 0, 1).copy()
    rows, width = points.shape[1:]
    use = np.where(np.isnan(points[0]), SKIPPED, HIT).astype(np.uint8)
    poses = np.tile([0.5, 0.5, 0.0, 1.0], (rows, 1))
    return Beams(points, use, np.full(rows, width, np.int32), poses, np.zeros((rows, 3)))


def states(grid: Occupancy, row: int = 0) -> list[int]:
    """The cells of a row of the world, from x = 0 to 6."""
    first = round(-grid.x / grid.resolution)
    return grid.cells[row - round(grid.y / grid.resolution), first : first + 6].tolist()


def test_a_line_is_one_cell_for_each_step_of_its_longer_axis() -> None:
    column, row = stepped(np.array([0, 0]), np.array([[4, 2], [0, -3], [0, 0]]))
    assert list(zip(column.tolist(), row.tolist(), strict=True)) == [
        (0, 0),
        (1, 1),
        (2, 1),
        (3, 2),
        (0, 0),
        (0, -1),
        (0, -2),
    ]


def test_a_ray_crosses_every_cell_on_its_way_but_not_that_of_its_end() -> None:
    column, row = crossed(np.array([0.5, 0.4]), np.array([[2.5, 1.4]]))
    # From (0.5, 0.4) with slope 1/2: x = 1 at y = 0.65, y = 1 at x = 1.7, x = 2 at y = 1.15.
    assert sorted(zip(column.tolist(), row.tolist(), strict=True)) == [(0, 0), (1, 0), (1, 1)]
    back = crossed(np.array([2.5, 1.4]), np.array([[0.5, 0.4]]))
    assert sorted(zip(back[0].tolist(), back[1].tolist(), strict=True)) == [(1, 0), (1, 1), (2, 1)]


@pytest.mark.parametrize(
    ("passed", "there"), [(2, [5, 3]), (3, [5])], ids=["1 of 3 visits is more than a quarter", "1 of 4 is not"]
)
def test_gmapping_counts_hits_of_visits(passed: int, there: list[int]) -> None:
    rule = PerBeam()
    sweeps(rule, [NEAR], *[[FAR]] * passed)
    assert occupied(rule, "gmapping") == sorted(there)


@pytest.mark.parametrize(("passed", "there"), [(7, True), (8, False), (9, False)])
def test_karto_counts_the_end_of_a_beam_as_passed_twice(passed: int, there: bool) -> None:
    rule = PerBeam()
    sweeps(rule, [NEAR], *[[FAR]] * passed)
    # 1 / (2 + 7) is more than 0.1, 1 / (2 + 8) is not.
    assert (3 in occupied(rule, "Karto")) is there


def log_odds_rule(name: str) -> LogOdds:
    """One of the published rules."""
    return next(rule for rule in published() if isinstance(rule, LogOdds) and rule.name == name)


def test_cartographer_takes_a_hit_before_a_miss_and_each_once_per_sweep() -> None:
    rule = log_odds_rule("Cartographer")
    sweeps(rule, [NEAR, NEAR, FAR, FAR])
    assert rule.odds[3] == pytest.approx(log_odds(0.55))
    assert rule.odds[1] == pytest.approx(log_odds(0.49))
    assert occupied(rule, "Cartographer, p > 0.5") == [3, 5]
    # Four hits are 0.69, three 0.65 - short of 0.646.
    sweeps(rule, [NEAR], [NEAR])
    assert occupied(rule, "Cartographer, p > 0.65") == []
    sweeps(rule, [NEAR])
    assert occupied(rule, "Cartographer, p > 0.65") == [3]


def test_probabilities_stay_within_their_limits() -> None:
    rule = log_odds_rule("Cartographer")
    sweeps(rule, *[[NEAR]] * 50)
    assert rule.odds[3] == pytest.approx(log_odds(0.9))
    assert rule.odds[0] == pytest.approx(log_odds(0.49) * 50)
    octomap = log_odds_rule("OctoMap")
    sweeps(octomap, *[[NEAR]] * 50)
    assert octomap.odds[3] == pytest.approx(log_odds(0.971))
    assert octomap.odds[0] == pytest.approx(log_odds(0.1192))


@pytest.mark.parametrize(("missed", "there"), [(2, True), (3, False)])
def test_octomap_weighs_a_hit_as_two_misses(missed: int, there: bool) -> None:
    rule = log_odds_rule("OctoMap")
    sweeps(rule, [NEAR], *[[FAR]] * missed)
    assert (3 in occupied(rule, "OctoMap")) is there


def test_only_the_sweeps_that_are_taken_and_the_beams_that_tell_count() -> None:
    nothing = [np.nan, np.nan]
    beams = world([NEAR, nothing], [FAR, nothing], [NEAR, nothing])
    grid = maps_by_rules(beams, np.array([True, False, True]), 1.0)["gmapping"]
    assert states(grid) == [FREE, FREE, FREE, OCCUPIED, UNKNOWN, UNKNOWN]
    ground = ground_of(beams, 1.0)
    assert (ground.column, ground.row, ground.width, ground.height) == (-1, -1, 8, 3)


def grid_of(*cells: tuple[int, int], x: float = 0.0) -> Occupancy:
    """20 x 20 cells of 5 cm; those given, column and row, are occupied."""
    found = np.full((20, 20), FREE, np.int8)
    for column, row in cells:
        found[row, column] = OCCUPIED
    return Occupancy(0.05, x, 0.0, found)


def test_ghosts_are_wrong_cells_where_somebody_was() -> None:
    true = grid_of((5, 5), (4, 5))
    # Beside a true cell; two cells away from one, at (0.375, 0.375) and (0.775, 0.975).
    found = grid_of((4, 4), (7, 7), (15, 19))
    assert wrong(found, true).tolist() == [[7, 7], [15, 19]]
    assert wrong(grid_of((4, 4), x=0.1), true).tolist() == []
    assert wrong(grid_of((4, 4), x=0.5), true).tolist() == [[4, 4]]
    somewhere = np.array([[0.375, 0.6], [5.0, 5.0]])
    assert score(found, true, somewhere) == Score(1 / 3, 1.0, 0.5, ghosts=1, cells=3, true_cells=2)
    assert score(found, true, np.empty((0, 2))).ghosts == 0
    assert score(found, true, somewhere).thickness == 1.5
