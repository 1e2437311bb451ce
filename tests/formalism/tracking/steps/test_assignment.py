"""The assignment of least cost, against all assignments there are and against scipy."""

from __future__ import annotations

from itertools import product
from math import inf

import numpy as np
import pytest

from lidarcli.formalism.tracking.association import Assignment, solve


def solved(cost: np.ndarray, without: float, room: Assignment | None = None) -> tuple[list[int], float]:
    """The column of each row, and the cost of all."""
    rows, columns = cost.shape
    assignment = room or Assignment(rows, columns)
    assignment.rows, assignment.columns = rows, columns
    for at, value in enumerate(cost.ravel().tolist()):
        assignment.cost[at] = value
    solve(assignment, without)
    chosen = [assignment.column[i] for i in range(rows)]
    assert len({j for j in chosen if j >= 0}) == sum(j >= 0 for j in chosen)
    return chosen, sum(without if j < 0 else float(cost[i, j]) for i, j in enumerate(chosen))


def least(cost: np.ndarray, without: float) -> float:
    """The least cost of all choices that give no column twice."""
    rows, columns = cost.shape
    best = inf
    for choice in product(range(-1, columns), repeat=rows):
        used = [j for j in choice if j >= 0]
        if len(set(used)) == len(used):
            best = min(best, sum(without if j < 0 else cost[i, j] for i, j in enumerate(choice)))
    return best


def random_cost(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Costs of which some are equal and some are infinite."""
    cost = rng.choice([0.0, 1.0, 2.0, 5.0, 9.0], (rows, columns)) + rng.choice([0.0, 1.0]) * rng.random((rows, columns))
    return np.where(rng.random((rows, columns)) < rng.choice([0.0, 0.3, 0.9]), inf, cost)


def test_no_choice_of_columns_costs_less() -> None:
    rng = np.random.default_rng(1)
    room = Assignment(4, 4)
    for _ in range(300):
        rows, columns = rng.integers(0, 5, 2)
        cost, without = random_cost(rng, rows, columns), float(rng.choice([0.5, 3.0, 100.0]))
        assert solved(cost, without)[1] == pytest.approx(least(cost, without), abs=1e-12)
        # Whatever was solved in the same room before.
        assert solved(cost, without, room) == solved(cost, without)


def test_scipy_finds_the_same_cost() -> None:
    optimize = pytest.importorskip("scipy.optimize")
    rng = np.random.default_rng(2)
    for _ in range(60):
        rows, columns = rng.integers(1, 25, 2)
        cost, without = random_cost(rng, rows, columns), 6.0
        # A column of its own for each row: it stays without. Nothing is infinite for scipy.
        padded = np.full((rows, columns + rows), 1e6)
        padded[:, :columns] = np.minimum(cost, 1e6)
        padded[np.arange(rows), columns + np.arange(rows)] = without
        i, j = optimize.linear_sum_assignment(padded)
        assert solved(cost, without)[1] == pytest.approx(padded[i, j].sum())
