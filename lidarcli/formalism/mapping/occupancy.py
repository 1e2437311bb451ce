"""Fig. 7b: occupancy grids of the ground, and the comparison of one with a true map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarcli.display import Facts, counted, shown, span
from lidarcli.sweeps import Bool, Float64, Int64, record

Int8 = NDArray[np.int8]

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""What a cell may be, as nav_msgs/OccupancyGrid has it."""

SKIPPED, HIT, CLEAR = range(3)
"""What a beam says of cells: nothing, that it ended in one, or only that it got so far."""
TOLERANCE = 1
"""An occupied cell is right where one is so many cells from it at most, also across corners."""
FARTHEST_CELLS = 40
"""Cells up to which the nearest occupied cell is looked for; what is farther counts as this."""
SAME_RESOLUTION = 1e-6
"""Cells of two maps that differ by less than this share are of one size."""


@shown
@record
class Occupancy:
    """What is known of W x H square cells of the ground, in a fixed frame.

    Attributes
    ----------
    resolution : side of a cell [m]
    x, y : where the lower left corner of cell (0, 0) is [m]
    cells : (H, W) int8: -1 unknown, 0 free, 100 occupied; row 0 has the least y, column 0 the least x
    frame_id : name of the fixed frame
    """

    resolution: float
    x: float
    y: float
    cells: Int8
    frame_id: str = "map"

    @property
    def occupied(self) -> int:
        """Number of occupied cells."""
        return int(np.count_nonzero(self.cells == OCCUPIED))

    @property
    def free(self) -> int:
        """Number of free cells."""
        return int(np.count_nonzero(self.cells == FREE))

    def facts(self) -> Facts:
        """What is known, in words."""
        height, width = self.cells.shape
        right, top = self.x + width * self.resolution, self.y + height * self.resolution
        rows = (
            ("frame", self.frame_id),
            ("x", span([self.x, right], ".2f", "m")),
            ("y", span([self.y, top], ".2f", "m")),
            ("occupied", counted(self.occupied, "cell")),
            ("free", counted(self.free, "cell")),
            ("unknown", counted(self.cells.size - self.occupied - self.free, "cell")),
        )
        return Facts(f"{width:,} x {height:,} cells of {self.resolution:g} m", rows)


class UnlikeError(ValueError):
    """Maps that cannot be compared; the text is the cause."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """What a map has of a true one. Shares are NaN where there is nothing to take a share of."""

    cells: int
    """Occupied cells of the map."""
    true_cells: int
    """Occupied cells of the true map."""
    precision: float
    """Share of the map's occupied cells that lie within `TOLERANCE` of an occupied cell of the true map."""
    recall: float
    """Share of the true map's occupied cells that lie within `TOLERANCE` of an occupied cell of the map."""
    f1: float
    """Harmonic mean of both."""
    mean_distance: float
    """Mean distance from the occupied cells of the true map to the nearest ones of the map [m], cut at `FARTHEST_CELLS`."""


def refuse_unlike(resolution: float, true: Occupancy) -> None:
    """Refuse to compare cells of this side [m] with those of a true map (`UnlikeError`)."""
    if abs(resolution - true.resolution) > SAME_RESOLUTION * true.resolution:
        raise UnlikeError(f"cells of {resolution:g} m cannot be compared with cells of {true.resolution:g} m")


def compare(found: Occupancy, true: Occupancy) -> Comparison:
    """Compare the occupied cells of a map with those of a true one, cell by cell.

    Raises
    ------
    UnlikeError
        Their cells differ in size.
    """
    refuse_unlike(found.resolution, true)
    mine, theirs = _cells(found, true), _cells(true, true)
    precise, _ = _nearest(mine, theirs, 2 * TOLERANCE)
    there, away = _nearest(theirs, mine, FARTHEST_CELLS)
    precision = float(np.mean(precise)) if len(mine) else float("nan")
    recall = float(np.mean(there)) if len(theirs) else float("nan")
    both = precision + recall
    return Comparison(
        cells=len(mine),
        true_cells=len(theirs),
        precision=precision,
        recall=recall,
        f1=2.0 * precision * recall / both if both > 0 else (0.0 if both == 0 else float("nan")),
        mean_distance=float(np.mean(away)) * true.resolution if len(theirs) else float("nan"),
    )


def _cells(grid: Occupancy, true: Occupancy) -> Int64:
    """(N, 2) column and row of the occupied cells, in cells of the true map."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    off_x, off_y = (grid.x - true.x) / true.resolution, (grid.y - true.y) / true.resolution
    return np.column_stack([column + round(off_x), row + round(off_y)]).astype(np.int64)


def _nearest(cells: Int64, others: Int64, farthest: int) -> tuple[Bool, Float64]:
    """(N,) whether one of the others is within `TOLERANCE`, and how far the nearest is [cells], `farthest` at most."""
    near = np.zeros(len(cells), np.bool_)
    away = np.full(len(cells), float(farthest))
    if not len(cells) or not len(others):
        return near, away
    low = np.minimum(cells.min(axis=0), others.min(axis=0)) - farthest
    across = int(np.maximum(cells.max(axis=0), others.max(axis=0))[0] - low[0]) + farthest + 1
    known: NDArray[np.int64] = np.sort((others[:, 1] - low[1]) * across + others[:, 0] - low[0])
    key = (cells[:, 1] - low[1]) * across + cells[:, 0] - low[0]
    left = np.arange(len(cells))
    reach = np.arange(-farthest, farthest + 1)
    dx, dy = (part.ravel() for part in np.meshgrid(reach, reach))
    distance = np.hypot(dx, dy)
    # The nearest first, so that each cell is done with once it has found one.
    for at in np.argsort(distance, kind="stable").tolist():
        if distance[at] >= farthest or not len(left):
            break
        wanted = key[left] + int(dy[at]) * across + int(dx[at])
        found = known[np.minimum(np.searchsorted(known, wanted), len(known) - 1)] == wanted
        hit = left[found]
        away[hit] = distance[at]
        near[hit] |= max(abs(int(dx[at])), abs(int(dy[at]))) <= TOLERANCE
        left = left[~found]
    return near, away
