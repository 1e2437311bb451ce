"""Fig. 7b: an occupancy grid, the cells of the ground that are occupied, free or unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.records import record

Int8 = NDArray[np.int8]

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""What a cell may be, as nav_msgs/OccupancyGrid has it."""

SKIPPED, HIT, CLEAR = range(3)
"""What a beam says of cells: nothing, that it ended in one, or only that it got so far."""


@record
class Occupancy:
    """What is known of W x H square cells of the ground, in a fixed frame."""

    resolution: float
    """Side of a cell [m]."""
    x: float
    """Where the lower left corner of cell (0, 0) is [m]."""
    y: float
    cells: Int8
    """(H, W) `UNKNOWN`, `FREE` or `OCCUPIED`; row 0 has the least y, column 0 the least x."""
    frame_id: str = "map"
    """The fixed frame."""

    @property
    def occupied(self) -> int:
        """Number of occupied cells."""
        return int(np.count_nonzero(self.cells == OCCUPIED))

    @property
    def free(self) -> int:
        """Number of free cells."""
        return int(np.count_nonzero(self.cells == FREE))
