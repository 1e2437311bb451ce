"""Fig. 7b: occupancy grids, from the number of sweeps that have hit and passed each cell.

Counts add up in any order. Sweeps of a sensor that waits are left out, because people who wait next to it are no wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import Facts, counted, shown, span
from lidarcli.formalism.mapping import rays
from lidarcli.sweeps.types import TURN, Float32, Float64, Int32, Int64, SweepBatch, SweepPoses, UInt8, record

Int8 = NDArray[np.int8]

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""Values of a cell, as in nav_msgs/OccupancyGrid."""

SKIPPED, HIT, CLEAR = rays.USES
"""Uses of a beam: none, it ended in a cell, or it only passed cells."""
TOLERANCE = 1
"""Greatest distance of an occupied cell from one of the other map, in cells, also across corners."""
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
    note : what of its file was not taken as it says; empty for nothing
    """

    resolution: float
    x: float
    y: float
    cells: Int8
    frame_id: str = "map"
    note: str = ""

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
class GridComparison:
    """Figures of a map compared with a true one; shares of no cells are NaN."""

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


def compare(found: Occupancy, true: Occupancy) -> GridComparison:
    """Compare the occupied cells of a map with those of a true one, cell by cell; `UnlikeError` if cells differ in size."""
    if abs(found.resolution - true.resolution) > SAME_RESOLUTION * true.resolution:
        raise UnlikeError(f"cells of {found.resolution:g} m cannot be compared with cells of {true.resolution:g} m")
    mine, theirs = _cells(found, true), _cells(true, true)
    precision, recall = _share_near(mine, theirs), _share_near(theirs, mine)
    both = precision + recall
    return GridComparison(
        cells=len(mine),
        true_cells=len(theirs),
        precision=precision,
        recall=recall,
        f1=2.0 * precision * recall / both if both > 0 else (0.0 if both == 0 else float("nan")),
    )


def _cells(grid: Occupancy, true: Occupancy) -> Int64:
    """Return (N, 2) column and row of the occupied cells, in cells of the true map."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    off_x, off_y = (grid.x - true.x) / true.resolution, (grid.y - true.y) / true.resolution
    return np.column_stack([column + round(off_x), row + round(off_y)]).astype(np.int64)


def _share_near(cells: Int64, others: Int64) -> float:
    """Return the share of the cells (N, 2) within `TOLERANCE` of one of the others (M, 2); NaN without cells."""
    if not len(cells):
        return float("nan")
    both = np.concatenate([cells, others])
    low = both.min(axis=0) - TOLERANCE
    across = int(both[:, 0].max() - low[0]) + TOLERANCE + 1
    key, known = ((each[:, 1] - low[1]) * across + each[:, 0] - low[0] for each in (cells, others))
    steps = np.arange(-TOLERANCE, TOLERANCE + 1)
    near = np.isin(key, np.add.outer(known, np.add.outer(steps * across, steps)))
    return float(np.mean(near))


BLOCK = 256
"""Least number of cells by which the counted space grows on each side."""
CELL_BYTES = 12
"""Memory of a cell that was observed [bytes]: hits, passes, and the last sweep that counted."""
MAP_MARGIN = 1
"""Number of unknown cells around the known ones, as some programs lose walls on the edge of a map."""


FARTHEST_CELL = 1 << 32
"""Greatest distance of a cell from the origin of the world, in cells: 215,000 km at 5 cm."""
MIN_TURN, PAUSE_NS = math.radians(10.0), 5_000_000_000
"""Turn [rad] and time [ns] after which a sweep counts again, as objects may have gone."""


class TooLargeError(ValueError):
    """The space that was observed is larger than the map may be; the text is its extent."""


@record
class Beams:
    """The beams of S sweeps in the world."""

    end: Float64
    """(2, S, B) x and y of their ends [m]; NaN for a beam that is skipped."""
    use: UInt8
    """(S, B) `SKIPPED`, `HIT` or `CLEAR`."""
    beams: Int32
    """(S,) number of beams of each sweep."""
    poses: Float64
    """(S, 4) x, y, yaw and side of the sensor."""
    way: Float64
    """(S, 3) way of the sensor in x, y, yaw during the sweep."""

    def __len__(self) -> int:
        return len(self.poses)

    def rows(self, index: Int64) -> Beams:
        """Return the beams of some sweeps."""
        return Beams(
            np.ascontiguousarray(self.end[:, index]), self.use[index], self.beams[index], self.poses[index], self.way[index]
        )


def placed(batch: SweepBatch, poses: SweepPoses, use: UInt8, ranges: Float32 | None = None) -> Beams:
    """Return the beams of sweeps in the world, each from the pose of the sensor at its own time.

    Parameters
    ----------
    batch : S sweeps of up to B beams
    poses : pose of each sweep, all known
    use : (S, B) `SKIPPED`, `HIT` or `CLEAR`
    ranges : (S, B) ranges [m], by default those of the sweeps
    """
    side = np.where(poses.upside_down, -1.0, 1.0)
    where = np.ascontiguousarray(np.column_stack([poses.x, poses.y, poses.yaw, side]))
    way = np.zeros((len(batch), 3)) if poses.way is None else np.ascontiguousarray(poses.way)
    beams = np.ascontiguousarray(batch.beams, np.int32)
    ranges = np.require(batch.ranges if ranges is None else ranges, np.float32, ["C", "A"])
    use = np.require(use, np.uint8, ["C", "A"])
    end = np.empty((2, *ranges.shape))
    if ranges.size:
        angles = np.ascontiguousarray(batch.angle_min), np.ascontiguousarray(batch.angle_increment)
        rays.place(ranges, use, beams, *angles, where, way, end)
    return Beams(end, use, beams, where, way)


@dataclass(slots=True)
class CellLayers:
    """Arrays with a number for each cell of the space that was observed, which grow with it.

    `resolution`: side of a cell [m]; `most_cells`: greatest number of cells.
    """

    LAYERS: ClassVar[tuple[str, ...]]
    """Names of the arrays."""

    resolution: float
    most_cells: int
    column: int = 0
    row: int = 0
    """Column and row of cell (0, 0), in cells from the origin of the world."""
    _seen: tuple[int, int, int, int] | None = None
    """Left, low, right, high of all cells so far [cells]."""

    def reach(self, left: int, low: int, right: int, high: int) -> None:
        """Make room for the cells from column `left` and row `low` up to `right` and `high`."""
        if self._seen is not None:
            left, low = min(left, self._seen[0]), min(low, self._seen[1])
            right, high = max(right, self._seen[2]), max(high, self._seen[3])
        if (right - left) * (high - low) > self.most_cells:
            far = f"{(right - left) * self.resolution:,.0f} x {(high - low) * self.resolution:,.0f} m"
            raise TooLargeError(far)
        self._seen = left, low, right, high
        height, width = getattr(self, self.LAYERS[0]).shape
        if height and width:
            left, low = min(left, self.column), min(low, self.row)
            right, high = max(right, self.column + width), max(high, self.row + height)
            if right - left == width and high - low == height:
                return
        # Cells that are never touched take no memory, so the room may be larger.
        column, row = (left // BLOCK) * BLOCK, (low // BLOCK) * BLOCK
        shape = -(-(high - row) // BLOCK) * BLOCK, -(-(right - column) // BLOCK) * BLOCK
        part = np.s_[self.row - row : self.row - row + height, self.column - column : self.column - column + width]
        for name in self.LAYERS:
            before = getattr(self, name)
            larger = np.zeros(shape, before.dtype)
            # Only what is not 0 is touched.
            np.copyto(larger[part], before, where=before != 0)
            setattr(self, name, larger)
        self.column, self.row = column, row


@dataclass(slots=True)
class Counts(CellLayers):
    """Counts of hits and passes, a fold over sweeps; takes `CELL_BYTES` for each cell of the space that was observed."""

    LAYERS: ClassVar[tuple[str, ...]] = ("hits", "passes", "_stamps")

    sweeps: int = 0
    """Number of sweeps that were counted."""
    hits: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    passes: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    """(H, W) number of sweeps of which a beam ended in each cell, and of which beams only passed it."""
    _stamps: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))

    def add(self, beams: Beams) -> None:
        """Count the cells of some sweeps, or of none where they reach farther than the map may (`TooLargeError`)."""
        if not len(beams):
            return
        self.reach(*_bounds(beams, self.resolution))
        sweeps = beams.end, beams.use, beams.beams, beams.poses, beams.way
        layers = self.hits, self.passes, self._stamps
        rays.trace(sweeps, layers, self.sweeps + 1, self.resolution, self.column, self.row)
        self.sweeps += len(beams)

    def close(self) -> None:
        """Free the memory that only counting needs, after the last sweep."""
        self._stamps = np.zeros((0, 0), np.int32)

    def merge(self, other: Counts) -> None:
        """Add the counts of `other`, with cells of the same size (`TooLargeError` as in `add`)."""
        height, width = other.hits.shape
        if height and width:
            self.reach(*(other._seen or (other.column, other.row, other.column + width, other.row + height)))
            part = np.s_[
                other.row - self.row : other.row - self.row + height,
                other.column - self.column : other.column - self.column + width,
            ]
            self.hits[part] += other.hits
            self.passes[part] += other.passes
        self.sweeps += other.sweeps

    def occupancy(self, min_hits: int, ratio: float, frame_id: str) -> Occupancy:
        """Return the grid: cells that enough sweeps hit are occupied, other cells that were passed are free.

        A cell that too few sweeps hit, and none passed, is unknown.

        Parameters
        ----------
        min_hits : least number of sweeps that hit an occupied cell
        ratio : an occupied cell was hit by more than this share of the sweeps that hit or passed it
        frame_id : name of the fixed frame
        """
        rows, columns = (_known(self.hits, self.passes, axis) for axis in (1, 0))
        hits, passes = self.hits[rows, columns], self.passes[rows, columns]
        cells = np.full((hits.shape[0] + 2 * MAP_MARGIN, hits.shape[1] + 2 * MAP_MARGIN), UNKNOWN, np.int8)
        inner: Int8 = cells[MAP_MARGIN:-MAP_MARGIN, MAP_MARGIN:-MAP_MARGIN]
        # In parts, so that no copy of a large map is made.
        for begin in range(0, len(inner), BLOCK):
            part = slice(begin, begin + BLOCK)
            hit, passed = hits[part], passes[part]
            inner[part][passed > 0] = FREE
            inner[part][(hit >= min_hits) & (hit > ratio * (hit.astype(np.int64) + passed))] = OCCUPIED
        return Occupancy(
            self.resolution,
            # Rounded, so that 0.15 is not written as 0.15000000000000002.
            round((self.column + columns.start - MAP_MARGIN) * self.resolution, 9),
            round((self.row + rows.start - MAP_MARGIN) * self.resolution, 9),
            cells,
            frame_id,
        )


def _bounds(beams: Beams, resolution: float) -> tuple[int, int, int, int]:
    """Return left, low, right, high of the cells that beams and sensor may touch, and one around (`TooLargeError`)."""
    limits = []
    for axis in range(2):
        begin = beams.poses[:, axis]
        ends = beams.end[axis]
        path = np.concatenate([begin, begin + beams.way[:, axis]])
        low = min(float(np.fmin.reduce(ends, axis=None, initial=np.inf)), float(path.min()))
        high = max(float(np.fmax.reduce(ends, axis=None, initial=-np.inf)), float(path.max()))
        if not max(-low, high) < FARTHEST_CELL * resolution:
            raise TooLargeError(f"{max(-low, high):,.0f} m from the origin of its world")
        limits.append((int(np.floor(low / resolution)) - 1, int(np.floor(high / resolution)) + 2))
    (left, right), (low_row, high_row) = limits
    return left, low_row, right, high_row


def pieces(cell: Int64, width: int) -> NDArray[np.intp]:
    """Return (N,) the number of the piece of each of N cells (ascending, row * width + column), from 0.

    Cells that touch, also at a corner, are of one piece; pieces are numbered by their first cells.
    """
    piece = np.arange(len(cell))
    pairs = []
    for step in (1, width - 1, width, width + 1):
        at = np.minimum(np.searchsorted(cell, cell + step), len(cell) - 1)
        found = np.flatnonzero(cell[at] == cell + step)
        pairs.append((found, at[found]))
    one, other = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    while len(one):
        least = np.minimum(piece[one], piece[other])
        np.minimum.at(piece, piece[one], least)
        np.minimum.at(piece, piece[other], least)
        # Each takes the number of the cell whose number it has, until none changes.
        while (piece[piece] != piece).any():
            piece = piece[piece]
        apart = piece[one] != piece[other]
        one, other = one[apart], other[apart]
    return np.unique(piece, return_inverse=True)[1]


def _known(hits: NDArray[np.int32], passes: NDArray[np.int32], axis: int) -> slice:
    """Return the rows (axis 1) or columns (axis 0) from the first to the last known cell."""
    some = np.flatnonzero(hits.any(axis=axis) | passes.any(axis=axis))
    # Without any known cell only the margin is left, as an image needs some pixels.
    return slice(int(some[0]), int(some[-1]) + 1) if len(some) else slice(0, 0)


@dataclass(slots=True)
class MotionFilter:
    """Choice of the sweeps that count, a fold over the sweeps of a sensor in the order of the log.

    `min_move`: least distance from one sweep that counts to the next [m]; 0 if every sweep counts.
    """

    min_move: float
    unplaced: int = 0
    """Number of sweeps without a pose, which never count."""
    _last: tuple[float, float, float, int] | None = None
    """x, y, yaw, stamp of the last sweep that counts."""

    def take(self, poses: SweepPoses, stamp_ns: Int64) -> Int64:
        """Return the indices of the sweeps (of S) that count."""
        known = np.flatnonzero(np.isfinite(poses.x) & np.isfinite(poses.y) & np.isfinite(poses.yaw))
        self.unplaced += len(stamp_ns) - len(known)
        if self.min_move <= 0.0:
            return known
        chosen = []
        columns = (known, poses.x[known], poses.y[known], poses.yaw[known], stamp_ns[known])
        for row, x, y, yaw, stamp in zip(*(column.tolist() for column in columns), strict=True):
            last = self._last
            if (
                last is None
                or math.hypot(x - last[0], y - last[1]) >= self.min_move
                or abs((yaw - last[2] + 0.5 * TURN) % TURN - 0.5 * TURN) >= MIN_TURN
                or abs(stamp - last[3]) >= PAUSE_NS
            ):
                self._last = x, y, yaw, stamp
                chosen.append(row)
        return np.array(chosen, np.int64)
