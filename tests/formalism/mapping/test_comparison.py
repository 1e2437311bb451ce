"""How right a map is: in closed form, and against every pair of cells."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lidarcli.formalism.mapping.grid import (
    FREE,
    OCCUPIED,
    TOLERANCE,
    UNKNOWN,
    GridComparison,
    Occupancy,
    UnlikeError,
    compare,
)

CELL = 0.05


def grid(cells: object, column: int = 0, row: int = 0, resolution: float = CELL) -> Occupancy:
    """A map whose cell (0, 0) is so many cells from the origin of the world."""
    return Occupancy(resolution, column * resolution, row * resolution, np.array(cells, np.int8))


def marked(*cells: tuple[int, int], size: int = 60) -> Occupancy:
    """A map of free cells, but for these (column, row)."""
    values = np.full((size, size), FREE, np.int8)
    for column, row in cells:
        values[row, column] = OCCUPIED
    return grid(values)


def room(seed: int, share: float, size: int = 30) -> NDArray[np.int8]:
    random = np.random.default_rng(seed)
    kinds = np.array([OCCUPIED, FREE, UNKNOWN], np.int8)
    return random.choice(kinds, (size, size), p=[share, 0.7 - share, 0.3])


def by_pairs(found: Occupancy, true: Occupancy) -> GridComparison:
    """Every cell of one map beside every cell of the other."""
    places = []
    for each in (found, true):
        row, column = np.nonzero(each.cells == OCCUPIED)
        cells = zip(column.tolist(), row.tolist(), strict=True)
        places.append([(x + round(each.x / CELL), y + round(each.y / CELL)) for x, y in cells])
    mine, theirs = places

    def right(cell: tuple[int, int], others: list[tuple[int, int]]) -> bool:
        return any(max(abs(cell[0] - x), abs(cell[1] - y)) <= TOLERANCE for x, y in others)

    precision = sum(right(cell, theirs) for cell in mine) / len(mine)
    recall = sum(right(cell, mine) for cell in theirs) / len(theirs)
    return GridComparison(
        len(mine), len(theirs), precision, recall, 2 / (1 / precision + 1 / recall) if precision and recall else 0.0
    )


def assert_alike(one: GridComparison, other: GridComparison) -> None:
    assert (one.cells, one.true_cells) == (other.cells, other.true_cells)
    for name in ("precision", "recall", "f1"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), nan_ok=True), name


@pytest.mark.parametrize("share", [0.002, 0.02, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_it_agrees_with_every_pair(seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    column, row = random.integers(-25, 25, 2).tolist()
    values, true = room(seed, share), room(seed + 100, share)
    values[3, 4] = true[11, 17] = OCCUPIED
    one, other = grid(values, column, row), grid(true, -3, 8)
    assert_alike(compare(one, other), by_pairs(one, other))


@pytest.mark.parametrize("resolution", [0.1, 0.0501, 0.0499])
def test_cells_of_another_size_are_not_compared(resolution: float) -> None:
    with pytest.raises(UnlikeError, match=rf"^cells of {resolution:g} m cannot be compared with cells of 0.05 m$"):
        compare(grid([[OCCUPIED]], resolution=resolution), grid([[OCCUPIED]]))
    # As a float32 tells it, it is the same.
    same = compare(grid([[OCCUPIED]], resolution=float(np.float32(CELL))), grid([[OCCUPIED]]))
    assert same.f1 == 1.0


def test_empty_maps() -> None:
    nan = float("nan")
    nothing = (grid(np.zeros((0, 0))), grid([[FREE, UNKNOWN]]))
    for none in nothing:
        assert_alike(compare(none, marked((3, 3))), GridComparison(0, 1, nan, 0.0, nan))
        assert_alike(compare(marked((3, 3)), none), GridComparison(1, 0, 0.0, nan, nan))
        assert_alike(compare(none, none), GridComparison(0, 0, nan, nan, nan))
