"""How right a map is: its occupied cells beside the true ones, and those that people have left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.mapping.grid import OCCUPIED, TOLERANCE, Occupancy, compare
from lidarcli.sweeps.types import Float64, Int64

GHOST = 0.3
"""A wrong cell within this of where a leg was at any sweep is the person's [m]."""
_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Score:
    """Of one map."""

    precision: float
    recall: float
    f1: float
    ghosts: int
    """Occupied cells that are none and lie where somebody was."""
    cells: int
    """Occupied cells, of the map …"""
    true_cells: int
    """… and of the true one."""

    @property
    def thickness(self) -> float:
        """Occupied cells for each one of the true map that the map has: how thick the walls are."""
        return self.cells / (self.recall * self.true_cells) if self.recall else float("nan")


def score(grid: Occupancy, true: Occupancy, walked: Float64) -> Score:
    """Compare a map with the true one; `walked` (W, 2) is where legs of people were [m]."""
    found = compare(grid, true)
    return Score(
        found.precision,
        found.recall,
        found.f1,
        int(np.count_nonzero(nearest(middles(grid, wrong(grid, true)), walked) <= GHOST)),
        found.cells,
        found.true_cells,
    )


def wrong(grid: Occupancy, true: Occupancy) -> Int64:
    """(N, 2) column and row of the occupied cells of a map that are more than a cell away from any true one."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    there = np.column_stack(
        [column + round((grid.x - true.x) / true.resolution), row + round((grid.y - true.y) / true.resolution)]
    )
    height, width = true.cells.shape
    near = np.zeros((height + 2 * TOLERANCE, width + 2 * TOLERANCE), np.bool_)
    reach = 2 * TOLERANCE + 1
    for down in range(reach):
        for along in range(reach):
            near[down : down + height, along : along + width] |= true.cells == OCCUPIED
    at = there + TOLERANCE
    inside = ((at >= 0) & (at < [near.shape[1], near.shape[0]])).all(axis=1)
    right = np.zeros(len(at), np.bool_)
    right[inside] = near[at[inside, 1], at[inside, 0]]
    return np.column_stack([column, row])[~right]


def middles(grid: Occupancy, cells: Int64) -> Float64:
    """(N, 2) the middles of cells (N, 2) in the world [m]."""
    there: Float64 = np.array([grid.x, grid.y]) + (cells + 0.5) * grid.resolution
    return there


def nearest(points: Float64, others: Float64) -> Float64:
    """(N,) how far the nearest of the others is [m]; infinite without any."""
    away = np.full(len(points), np.inf)
    if len(others):
        for first in range(0, len(points), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            apart = points[part, None] - others
            away[part] = np.sqrt((apart**2).sum(axis=2).min(axis=1))
    return away
