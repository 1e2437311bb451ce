"""Fig. 7b: the number of sweeps that have hit and passed each cell of the ground, and the choice of the sweeps that count.

Counts add up in any order. Sweeps of a sensor that waits are left out, because people who wait beside it are no wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.mapping import rays
from lidarcli.formalism.mapping.occupancy import FREE, OCCUPIED, UNKNOWN, Int8, Occupancy
from lidarcli.sweeps import TURN, Float32, Float64, Int32, Int64, SweepBatch, SweepPoses, UInt8, record

BLOCK = 256
"""Least number of cells by which the counted ground grows on each side."""
CELL_BYTES = 12
"""Memory of a cell that was seen [bytes]: hits, passes, and the last sweep that counted."""
MAP_MARGIN = 1
"""Number of unknown cells around the known ones, as some programs lose walls on the edge of a map."""


FARTHEST_CELL = 1 << 32
"""Greatest distance of a cell from the origin of the world, in cells: 215,000 km at 5 cm."""
MIN_TURN = math.radians(10.0)
"""[rad] Turn after which a sweep counts again."""
PAUSE_NS = 5_000_000_000
"""[ns] Time after which a sweep counts again, as things may have gone."""


class TooLargeError(ValueError):
    """The ground that was seen is larger than the map may be; the text is its extent."""


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
    told = np.require(batch.ranges if ranges is None else ranges, np.float32, ["C", "A"])
    use = np.require(use, np.uint8, ["C", "A"])
    end = np.empty((2, *told.shape))
    if told.size:
        rays.place(
            told,
            use,
            beams,
            np.ascontiguousarray(batch.angle_min),
            np.ascontiguousarray(batch.angle_increment),
            where,
            way,
            end,
        )
    return Beams(end, use, beams, where, way)


@dataclass(slots=True)
class Counts:
    """Counts of hits and passes, a fold over sweeps; takes `CELL_BYTES` for each cell of the ground that was seen.

    Parameters
    ----------
    resolution : side of a cell [m]
    most_cells : greatest number of cells
    """

    LAYERS: ClassVar[tuple[str, ...]] = ("hits", "passes", "_stamps")
    """Arrays with a number for each cell."""

    resolution: float
    most_cells: int
    sweeps: int = 0
    """Number of sweeps that were counted."""
    column: int = 0
    row: int = 0
    """Column and row of cell (0, 0), in cells from the origin of the world."""
    hits: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    passes: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    """(H, W) number of sweeps of which a beam ended in each cell, and of which beams only passed it."""
    _stamps: Int32 = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    _seen: tuple[int, int, int, int] | None = None
    """Left, low, right, high of all cells so far [cells]."""

    def add(self, beams: Beams) -> None:
        """Count the cells of some sweeps.

        Raises
        ------
        TooLargeError
            The sweeps reach farther than the map may; none of them is counted.
        """
        if not len(beams):
            return
        self._reach(*_bounds(beams, self.resolution))
        rays.trace(
            beams.end,
            beams.use,
            beams.beams,
            beams.poses,
            beams.way,
            self.hits,
            self.passes,
            self._stamps,
            self.sweeps + 1,
            self.resolution,
            self.column,
            self.row,
        )
        self.sweeps += len(beams)

    def close(self) -> None:
        """Free the memory that only counting needs, after the last sweep."""
        self._stamps = np.zeros((0, 0), np.int32)

    def merge(self, other: Counts) -> None:
        """Add the counts of `other`, with cells of the same size (`TooLargeError` as in `add`)."""
        height, width = other.hits.shape
        if height and width:
            self._reach(*(other._seen or (other.column, other.row, other.column + width, other.row + height)))
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

    def _reach(self, left: int, low: int, right: int, high: int) -> None:
        """Make room for the cells from column `left` and row `low` up to `right` and `high`."""
        if self._seen is not None:
            left, low = min(left, self._seen[0]), min(low, self._seen[1])
            right, high = max(right, self._seen[2]), max(high, self._seen[3])
        if (right - left) * (high - low) > self.most_cells:
            far = f"{(right - left) * self.resolution:,.0f} x {(high - low) * self.resolution:,.0f} m"
            raise TooLargeError(far)
        self._seen = left, low, right, high
        height, width = self.hits.shape
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


def _bounds(beams: Beams, resolution: float) -> tuple[int, int, int, int]:
    """Return the cells that the beams and the sensor may touch, and one around them: left, low, right, high.

    Raises
    ------
    TooLargeError
        They are farther away than cells can be told apart.
    """
    limits = []
    for axis in range(2):
        begin = beams.poses[:, axis]
        ends = beams.end[axis]
        low = min(float(np.fmin.reduce(ends, axis=None, initial=np.inf)), float(begin.min()))
        high = max(float(np.fmax.reduce(ends, axis=None, initial=-np.inf)), float(begin.max()))
        low, high = (
            min(low, float((begin + beams.way[:, axis]).min())),
            max(high, float((begin + beams.way[:, axis]).max())),
        )
        if not max(-low, high) < FARTHEST_CELL * resolution:
            raise TooLargeError(f"{max(-low, high):,.0f} m from the origin of its world")
        limits.append((int(np.floor(low / resolution)) - 1, int(np.floor(high / resolution)) + 2))
    (left, right), (low_row, high_row) = limits
    return left, low_row, right, high_row


def _known(hits: NDArray[np.int32], passes: NDArray[np.int32], axis: int) -> slice:
    """Return the rows (axis 1) or columns (axis 0) from the first to the last known cell."""
    some = np.flatnonzero(hits.any(axis=axis) | passes.any(axis=axis))
    # Without any known cell only the margin is left, as an image needs some pixels.
    return slice(int(some[0]), int(some[-1]) + 1) if len(some) else slice(0, 0)


@dataclass(slots=True)
class MotionFilter:
    """Choice of the sweeps that count, a fold over the sweeps of a sensor in the order of the log.

    Parameters
    ----------
    min_move : least distance from one sweep that counts to the next [m]; 0 if every sweep counts
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
        taken = []
        places = zip(
            known.tolist(),
            poses.x[known].tolist(),
            poses.y[known].tolist(),
            poses.yaw[known].tolist(),
            stamp_ns[known].tolist(),
            strict=True,
        )
        for row, *here in places:
            if self._is_new(*here):
                self._last = (here[0], here[1], here[2], here[3])
                taken.append(row)
        return np.array(taken, np.int64)

    def _is_new(self, x: float, y: float, yaw: float, stamp_ns: int) -> bool:
        if self._last is None:
            return True
        turned = abs((yaw - self._last[2] + 0.5 * TURN) % TURN - 0.5 * TURN)
        return (
            math.hypot(x - self._last[0], y - self._last[1]) >= self.min_move
            or turned >= MIN_TURN
            or abs(stamp_ns - self._last[3]) >= PAUSE_NS
        )
