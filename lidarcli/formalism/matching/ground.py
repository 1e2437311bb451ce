"""The ground as a run saw it (§3, matching): free, occupied or unseen, and the occupied point nearest to any place."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lidarcli.formalism.mapping.counts import Beams, Counts
from lidarcli.formalism.mapping.occupancy import FREE, HIT, OCCUPIED, UNKNOWN, Int8, Occupancy
from lidarcli.formalism.matching.runs import Motion
from lidarcli.sweeps import Bool, Float64, Int32, Int64, record

SEEN_FREE = 3
"""Least number of sweeps that pass a place that was seen free."""
FINEST = 0.05
"""[m] Cells of a map that are finer are taken together."""
REACH = 0.6
"""[m] Greatest distance to a nearest occupied point."""
ON_LINE = 0.15
"""[m] Half width of the windows in which lines are fitted to occupied points."""
STRAIGHT = 0.1
"""Greatest ratio of the variances across and along a line."""
FAR_CORNER = float(1 << 33)
"""Column and row of the origin of the world, in cells from a corner far outside, so that all cells are positive."""


@record
class Ground:
    """Square cells of the ground in the coordinates of a run, and N occupied points, one for each occupied cell."""

    resolution: float
    """Side of a cell [m]."""
    x: float
    y: float
    """Lower left corner of cell (0, 0) [m]."""
    cells: Int8
    """(H, W) as of `Occupancy`."""
    passes: Int32
    """(H, W) number of sweeps that passed each cell; for a map `SEEN_FREE` where it is free."""
    looks: Int32
    """(H, W) number of sweeps that hit or passed each cell."""
    points: Float64
    """(N, 2) mean of what was hit in each occupied cell [m]."""
    counted: bool = True
    """False for a map, whose sweeps nobody knows."""

    def index(self, x: Float64, y: Float64) -> tuple[Int64, Int64, Bool]:
        """Return (K,) row and column of places, and whether they are within the cells; outside row and column are 0."""
        column = np.floor((x - self.x) / self.resolution).astype(np.int64)
        row = np.floor((y - self.y) / self.resolution).astype(np.int64)
        height, width = self.cells.shape
        inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
        return np.where(inside, row, 0), np.where(inside, column, 0), inside

    def state(self, x: Float64, y: Float64) -> Int8:
        """Return (K,) the cells of places."""
        row, column, inside = self.index(x, y)
        found: Int8 = np.where(inside, self.cells[row, column], UNKNOWN).astype(np.int8)
        return found

    def passed(self, x: Float64, y: Float64) -> Int64:
        """Return (K,) the number of sweeps that saw places free; 0 for occupied ones."""
        row, column, inside = self.index(x, y)
        free = inside & (self.cells[row, column] == FREE)
        return np.where(free, self.passes[row, column], 0).astype(np.int64)

    def seen(self, x: Float64, y: Float64) -> Int64:
        """Return (K,) the number of sweeps that hit or passed places."""
        row, column, inside = self.index(x, y)
        return np.where(inside, self.looks[row, column], 0).astype(np.int64)

    def occupancy(self, frame_id: str = "map") -> Occupancy:
        """Return the cells as a grid."""
        return Occupancy(self.resolution, self.x, self.y, self.cells, frame_id)

    def moved(self, motion: Motion) -> Ground:
        """Return the ground in other coordinates, each new cell as the old one at its middle."""
        height, width = self.cells.shape
        corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) * self.resolution
        x, y = motion.of(corners[:, 0] + self.x, corners[:, 1] + self.y)
        points = np.column_stack(motion.of(self.points[:, 0], self.points[:, 1]))
        left, low, middle_x, middle_y = _cells_of(self.resolution, x, y)
        inverse = motion.inverse
        cells, passes, looks = self._at(*inverse.of(middle_x, middle_y))
        # Turned cells may miss a point, and the points are what counts.
        cells[cells == OCCUPIED] = FREE
        moved = Ground(self.resolution, left, low, cells, passes, looks, points, self.counted)
        row, column, inside = moved.index(points[:, 0], points[:, 1])
        cells[row[inside], column[inside]] = OCCUPIED
        return moved

    def over(self, older: Ground) -> Ground:
        """Return this ground, and where it saw nothing an older one in the same coordinates."""
        corners = [
            (one.x + across * one.resolution, one.y + up * one.resolution)
            for one in (self, older)
            for up, across in ((0, 0), one.cells.shape)
        ]
        left, low, x, y = _cells_of(self.resolution, *np.array(corners).T)
        mine, before = self._at(x, y), older._at(x, y)
        seen = mine[0] != UNKNOWN
        cells = np.where(seen, mine[0], before[0]).astype(np.int8)
        passes, looks = (np.where(seen, mine[k], before[k]).astype(np.int32) for k in (1, 2))
        kept = older.points[self.state(older.points[:, 0], older.points[:, 1]) == UNKNOWN]
        points = np.concatenate([self.points, kept])
        return Ground(
            self.resolution, left, low, cells, passes, looks, points, self.counted and older.counted
        )

    def _at(self, x: Float64, y: Float64) -> tuple[Int8, Int32, Int32]:
        """Return cells, passes and looks at places (H, W)."""
        row, column, inside = self.index(x, y)
        return (
            np.where(inside, self.cells[row, column], UNKNOWN).astype(np.int8),
            np.where(inside, self.passes[row, column], 0).astype(np.int32),
            np.where(inside, self.looks[row, column], 0).astype(np.int32),
        )


def _cells_of(side: float, x: Float64, y: Float64) -> tuple[float, float, Float64, Float64]:
    """Return the lower left corner of cells that hold some places, and (H, W) x and y of their middles."""
    left, low = math.floor(x.min() / side), math.floor(y.min() / side)
    row, column = np.indices((math.ceil(y.max() / side) - low, math.ceil(x.max() / side) - left))
    return left * side, low * side, (column + left + 0.5) * side, (row + low + 0.5) * side


def of_map(grid: Occupancy) -> Ground:
    """Return the ground of a map: its occupied points are the middles of its cells, of several fine ones their mean."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    middle = np.column_stack([column + 0.5, row + 0.5]) * grid.resolution + [grid.x, grid.y]
    group = max(1, round(FINEST / grid.resolution))
    side = group * grid.resolution
    height, width = (-(-length // group) for length in grid.cells.shape)
    whole = np.full((height * group, width * group), UNKNOWN, np.int8)
    whole[: grid.cells.shape[0], : grid.cells.shape[1]] = grid.cells
    # Occupied goes before free, and free before unknown.
    cells = np.ascontiguousarray(whole.reshape(height, group, width, group).max(axis=(1, 3)))
    key, sums = _summed(
        (row // group) * width + column // group, np.column_stack([middle, np.ones(len(middle))])
    )
    passes = np.where(cells == FREE, SEEN_FREE, 0).astype(np.int32)
    looks = np.where(cells == UNKNOWN, 0, SEEN_FREE).astype(np.int32)
    points = sums[:, :2] / sums[:, 2:] if len(key) else np.empty((0, 2))
    return Ground(side, grid.x, grid.y, cells, passes, looks, points, counted=False)


@dataclass(slots=True)
class Surveying:
    """The ground of a run, a fold over its sweeps."""

    counts: Counts
    _keys: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    _sums: Float64 = field(default_factory=lambda: np.empty((0, 4)))
    """(C, 4) x, y, number of the hits of each cell, and number of those of agents."""
    _waiting: list[tuple[Int64, Float64]] = field(default_factory=list)

    def add(self, beams: Beams, agents: Bool | None = None) -> None:
        """Count some sweeps, of which (S, B) beams are on agents; `TooLargeError` as of `Counts.add`."""
        self.counts.add(beams)
        hit = (beams.use == HIT) & np.isfinite(beams.end[0])
        x, y = beams.end[0][hit], beams.end[1][hit]
        mine = np.zeros(len(x)) if agents is None else agents[hit]
        key, sums = _summed(self._key(x, y), np.column_stack([x, y, np.ones(len(x)), mine]))
        self._waiting.append((key, sums))
        if sum(len(part) for part, _ in self._waiting) > len(self._keys) + (1 << 16):
            self._gather()

    def ground(self, hits: int, ratio: float) -> Ground:
        """Return the ground; `hits` and `ratio` as of `Counts.occupancy`."""
        self._gather()
        grid = self.counts.occupancy(hits, ratio, "")
        height, width = grid.cells.shape
        side = grid.resolution
        # The grid lies within what was counted, but for its margin.
        left = round(grid.x / side) - self.counts.column
        low = round(grid.y / side) - self.counts.row
        layers = []
        for layer in (self.counts.passes, self.counts.hits + self.counts.passes):
            part = np.zeros((height, width), np.int32)
            rows, columns = layer.shape
            top, right = min(low + height, rows), min(left + width, columns)
            first, start = max(low, 0), max(left, 0)
            part[first - low : top - low, start - left : right - left] = layer[first:top, start:right]
            layers.append(part)
        row, column = np.nonzero(grid.cells == OCCUPIED)
        if not len(row):
            return Ground(side, grid.x, grid.y, grid.cells, layers[0], layers[1], np.empty((0, 2)))
        middle = np.column_stack([column + 0.5, row + 0.5]) * side + [grid.x, grid.y]
        at = np.searchsorted(self._keys, self._key(middle[:, 0], middle[:, 1]))
        sums = self._sums[np.minimum(at, len(self._keys) - 1)]
        # Where an agent stood long, nobody knows what is there without it.
        stands = sums[:, 3] <= 0.5 * sums[:, 2]
        grid.cells[row[~stands], column[~stands]] = UNKNOWN
        points = sums[stands, :2] / sums[stands, 2:3]
        return Ground(side, grid.x, grid.y, grid.cells, layers[0], layers[1], points)

    def _key(self, x: Float64, y: Float64) -> Int64:
        """Return (K,) a number for the cell of each place."""
        cells = 1.0 / self.counts.resolution
        column, row = ((each * cells + FAR_CORNER).astype(np.int64) - int(FAR_CORNER) for each in (x, y))
        return row * (1 << 30) + column

    def _gather(self) -> None:
        keys = np.concatenate([self._keys, *(key for key, _ in self._waiting)])
        sums = np.concatenate([self._sums, *(part for _, part in self._waiting)])
        self._keys, self._sums = _summed(keys, sums)
        self._waiting = []


def _summed(key: Int64, values: Float64) -> tuple[Int64, Float64]:
    """Return the different keys, ascending, and the sums of the values of each."""
    keys, which = np.unique(key, return_inverse=True)
    sums = [np.bincount(which, column, len(keys)) for column in values.T]
    return keys, np.column_stack(sums).astype(np.float64).reshape(len(keys), values.shape[1])


class Nearest:
    """The occupied point nearest to any place, up to `REACH`, and the places that were seen free."""

    def __init__(self, ground: Ground) -> None:
        self.ground = ground
        row, column = np.nonzero(ground.cells[::2, ::2] == FREE)
        self.free: Float64 = (np.column_stack([column, row]) * 2 + 0.5) * ground.resolution + [
            ground.x,
            ground.y,
        ]
        """(F, 2) places that were seen free: every other cell of every other row [m]."""
        self.area = 4.0 * len(row) * ground.resolution**2
        """Ground that was seen free [m²]."""
        side = ground.resolution
        reach = max(1, math.ceil(REACH / side))
        height, width = ground.cells.shape
        self._pad = reach
        self._index = np.full((height + 2 * reach, width + 2 * reach), -1, np.int32)
        x, y = ground.points.T
        column = np.floor((x - ground.x) / side).astype(np.int64) + reach
        row = np.floor((y - ground.y) / side).astype(np.int64) + reach
        across = self._index.shape[1]
        inner = (row >= reach) & (column >= reach) & (row < height + reach) & (column < width + reach)
        which = np.flatnonzero(inner).astype(np.int32)
        cell = row[inner] * across + column[inner]
        steps = np.arange(-reach, reach + 1)
        dx, dy = (part.ravel() for part in np.meshgrid(steps, steps))
        distance = np.hypot(dx, dy)
        flat = self._index.reshape(-1)
        # The farthest first, so that nearer points take their place.
        for at in np.argsort(-distance, kind="stable").tolist():
            if distance[at] <= reach:
                flat[cell + int(dy[at]) * across + int(dx[at])] = which
        self.across, self.is_line = _lines(ground.points, cell, which, across, self._index.size, side)

    def of(self, x: Float64, y: Float64) -> tuple[Int64, Float64]:
        """Return (K,) the index of the nearest point of each place, -1 for none, and its distance [m], inf for none."""
        ground = self.ground
        column = np.floor((x - ground.x) / ground.resolution).astype(np.int64) + self._pad
        row = np.floor((y - ground.y) / ground.resolution).astype(np.int64) + self._pad
        height, width = self._index.shape
        inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
        index = np.full(len(x), -1, np.int64)
        index[inside] = self._index[row[inside], column[inside]]
        away = np.full(len(x), np.inf)
        some = index >= 0
        near = ground.points[index[some]]
        away[some] = np.hypot(near[:, 0] - x[some], near[:, 1] - y[some])
        return index, away


def _lines(
    points: Float64, cell: Int64, which: Int32, across: int, size: int, side: float
) -> tuple[Float64, Bool]:
    """Return (N, 2) the normal of the line through each point and its neighbours, and (N,) whether they lie on one."""
    count = len(points)
    of_cell = np.full(size, -1, np.int32)
    of_cell[cell] = which
    reach = max(1, round(ON_LINE / side))
    sums = np.zeros((count, 6))
    x, y = points[which].T
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            at = np.clip(cell + dy * across + dx, 0, size - 1)
            other = of_cell[at]
            there = other >= 0
            u, v = points[other[there], 0] - x[there], points[other[there], 1] - y[there]
            sums[which[there]] += np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])
    number = np.maximum(sums[:, 0], 1.0)
    mean_x, mean_y = sums[:, 1] / number, sums[:, 2] / number
    xx, xy, yy = (
        sums[:, 3] / number - mean_x**2,
        sums[:, 4] / number - mean_x * mean_y,
        sums[:, 5] / number - mean_y**2,
    )
    root = np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    middle = 0.5 * (xx + yy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    is_line = (number >= 3) & (middle - root <= STRAIGHT * (middle + root)) & (middle + root > 0)
    return np.column_stack([-np.sin(angle), np.cos(angle)]), is_line
