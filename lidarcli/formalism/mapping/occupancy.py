"""Fig. 7b: occupancy grids of the ground, and the comparison of one with a true map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarcli.display import Facts, counted, shown, span
from lidarcli.sweeps import Bool, Float64, Int64, record

Int8 = NDArray[np.int8]

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""Values of a cell, as in nav_msgs/OccupancyGrid."""

SKIPPED, HIT, CLEAR = range(3)
"""Uses of a beam: none, it ended in a cell, or it only passed cells."""
TOLERANCE = 1
"""Greatest distance of an occupied cell from one of the other map, in cells, also across corners."""
FARTHEST_CELLS = 40
"""Greatest distance that is measured, in cells; a larger one counts as this."""
SAME_RESOLUTION = 1e-6
"""Greatest difference between two sizes of cells that are the same, as a share."""


@shown
@record
class Occupancy:
    """Occupancy grid of W x H square cells of the ground, in a fixed frame.

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
        """Return a summary for printing."""
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
    """The maps cannot be compared; the text is the cause."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Figures of a map beside a true one; shares of no cells are NaN."""

    cells: int
    """Number of occupied cells of the map."""
    true_cells: int
    """Number of occupied cells of the true map."""
    precision: float
    """Share of the map's occupied cells that lie within `TOLERANCE` of an occupied cell of the true map."""
    recall: float
    """Share of the true map's occupied cells that lie within `TOLERANCE` of an occupied cell of the map."""
    f1: float
    """Harmonic mean of precision and recall."""
    mean_distance: float
    """Mean distance from the occupied cells of the true map to the nearest ones of the map [m], cut at `farthest` cells."""


def refuse_unlike(resolution: float, true: Occupancy) -> None:
    """Refuse to compare cells of this side [m] with those of a true map (`UnlikeError`)."""
    if abs(resolution - true.resolution) > SAME_RESOLUTION * true.resolution:
        raise UnlikeError(f"cells of {resolution:g} m cannot be compared with cells of {true.resolution:g} m")


def compare(found: Occupancy, true: Occupancy, farthest: int = FARTHEST_CELLS) -> Comparison:
    """Compare the occupied cells of a map with those of a true one, cell by cell.

    Parameters
    ----------
    farthest : greatest distance that is measured, in cells; what is farther away takes time with its square

    Raises
    ------
    UnlikeError
        Their cells differ in size.
    """
    refuse_unlike(found.resolution, true)
    mine, theirs = _cells(found, true), _cells(true, true)
    precise, _ = _nearest(mine, theirs, 2 * TOLERANCE)
    there, away = _nearest(theirs, mine, farthest)
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
    """Return (N, 2) column and row of the occupied cells, in cells of the true map."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    off_x, off_y = (grid.x - true.x) / true.resolution, (grid.y - true.y) / true.resolution
    return np.column_stack([column + round(off_x), row + round(off_y)]).astype(np.int64)


def _nearest(cells: Int64, others: Int64, farthest: int) -> tuple[Bool, Float64]:
    """Return (N,) True where one of the others is within `TOLERANCE`, and the distance of the nearest [cells]."""
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
    # The nearest offsets first, so that each cell is done once it has found one.
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
