"""Fig. 7b: an occupancy grid, the cells of the ground that are occupied, free or unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.display import Facts, counted, shown, span
from lidarcli.sweeps import record

Int8 = NDArray[np.int8]

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""What a cell may be, as nav_msgs/OccupancyGrid has it."""

SKIPPED, HIT, CLEAR = range(3)
"""What a beam says of cells: nothing, that it ended in one, or only that it got so far."""


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
