"""The space as a run observed it (§3, matching): free, occupied or unobserved, and the occupied point nearest to any
place."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lidarcli.formalism.mapping.grid import (
    BLOCK,
    FREE,
    HIT,
    OCCUPIED,
    UNKNOWN,
    Beams,
    Counts,
    Int8,
    Occupancy,
    TooLargeError,
)
from lidarcli.sweeps.types import TURN, Bool, Float64, Int32, Int64, record

OBSERVED_FREE = 3
"""Least number of sweeps that pass a place that was observed free."""
FINEST = 0.05
"""[m] Cells of a map that are finer are taken together."""
REACH, ON_LINE, STRAIGHT = 0.6, 0.15, 0.1
"""Greatest distance to a nearest occupied point [m]; half width of the windows in which lines are fitted to occupied points
[m]; greatest ratio of the variances across and along a line."""
MAX_CELLS = 100_000_000
"""Most cells of several maps together: those of the largest map at 5 cm."""
FREE_SIDE = 300
"""Most places in a row, and rows of them, by which free space is compared."""
AT_ONCE = 1 << 18
"""Number of cells that are worked on at once."""
BUCKET = 0.5
"""[m] Side of the cells by which points in boxes are found."""
OTHER_RUN = 1e7
"""[m] Added to the way of another run, more than a robot drives."""
FAR_CORNER = float(1 << 33)
"""Column and row of the origin of the world, in cells from a corner far outside, so that all cells are positive."""


@dataclass(frozen=True, slots=True)
class SpaceMotion:
    """Motion from the coordinates of a run to those of the first one: a turn [rad], then a shift [m]."""

    angle: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def of(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return places in the coordinates of the first run [m]."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y

    @property
    def shift(self) -> float:
        """Length of the shift [m]."""
        return math.hypot(self.x, self.y)

    @property
    def turn(self) -> float:
        """The turn, -π to π [rad]."""
        return (self.angle + 0.5 * TURN) % TURN - 0.5 * TURN

    @property
    def inverse(self) -> SpaceMotion:
        """The motion back."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return SpaceMotion(-self.angle, -cos * self.x - sin * self.y, sin * self.x - cos * self.y)


HERE = SpaceMotion()
"""Motion of a run in the coordinates of the first one."""


@record
class SpaceMap:
    """Square cells of the map in the coordinates of a run, and N occupied points, one for each occupied cell."""

    resolution: float
    """Side of a cell [m]."""
    x: float
    y: float
    """Lower left corner of cell (0, 0) [m]."""
    cells: Int8
    """(H, W) as of `Occupancy`."""
    passes: Int32 | None
    """(H, W) number of sweeps that passed each cell; None for a map: `OBSERVED_FREE` where it is free."""
    looks: Int32 | None
    """(H, W) number of sweeps that hit or passed each cell; None for a map: `OBSERVED_FREE` where it is known."""
    points: Float64
    """(N, 2) mean of what was hit in each occupied cell [m]."""
    way: Float64
    """(N, 2) way of the sensor up to these hits, mean and standard deviation [m]; 0 where it is unknown."""
    counted: bool = True
    """False for a map: the number of its sweeps is unknown."""

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
        return np.where(inside, self.cells[row, column], UNKNOWN).astype(np.int8)

    def passed(self, x: Float64, y: Float64) -> Int32:
        """Return (K,) the number of sweeps that observed places free; 0 for occupied ones."""
        cells, passes, _ = self._at(x, y)
        return np.where(cells == FREE, passes, 0).astype(np.int32)

    def seen(self, x: Float64, y: Float64) -> Int32:
        """Return (K,) the number of sweeps that hit or passed places."""
        return self._at(x, y)[2]

    def occupancy(self, frame_id: str = "map") -> Occupancy:
        """Return the cells as a grid."""
        return Occupancy(self.resolution, self.x, self.y, self.cells, frame_id)

    def moved(self, motion: SpaceMotion) -> SpaceMap:
        """Return the space in other coordinates, each new cell as the old one at its middle."""
        height, width = self.cells.shape
        corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) * self.resolution
        x, y = motion.of(corners[:, 0] + self.x, corners[:, 1] + self.y)
        points = np.column_stack(motion.of(self.points[:, 0], self.points[:, 1]))
        inverse = motion.inverse
        left, low, cells, passes, looks = _laid(self.resolution, x, y, lambda x, y: self._at(*inverse.of(x, y)))
        # Turned cells may miss a point, and the points are what counts.
        cells[cells == OCCUPIED] = FREE
        moved = SpaceMap(self.resolution, left, low, cells, passes, looks, points, self.way, self.counted)
        row, column, inside = moved.index(points[:, 0], points[:, 1])
        cells[row[inside], column[inside]] = OCCUPIED
        return moved

    def over(self, older: SpaceMap) -> SpaceMap:
        """Return this map, and where it observed nothing an older one in the same coordinates."""
        corners = [
            (one.x + across * one.resolution, one.y + up * one.resolution)
            for one in (self, older)
            for up, across in ((0, 0), one.cells.shape)
        ]

        def read(x: Float64, y: Float64) -> _Layers:
            mine, before = self._at(x, y), older._at(x, y)
            known = mine[0] != UNKNOWN
            cells, passes, looks = (np.where(known, mine[k], before[k]) for k in range(3))
            return cells.astype(np.int8), passes, looks

        x, y = np.array(corners).T
        left, low, cells, passes, looks = _laid(self.resolution, x, y, read)
        kept = self.state(older.points[:, 0], older.points[:, 1]) == UNKNOWN
        points = np.concatenate([self.points, older.points[kept]])
        way = np.concatenate([self.way, older.way[kept] + [OTHER_RUN, 0.0]])
        return SpaceMap(self.resolution, left, low, cells, passes, looks, points, way, self.counted and older.counted)

    def _at(self, x: Float64, y: Float64) -> _Layers:
        """Return cells, passes and looks at places."""
        row, column, inside = self.index(x, y)
        cells = np.where(inside, self.cells[row, column], UNKNOWN).astype(np.int8)
        if self.passes is None or self.looks is None:
            return cells, np.int32(OBSERVED_FREE) * (cells == FREE), np.int32(OBSERVED_FREE) * (cells != UNKNOWN)
        passes, looks = (np.where(inside, layer[row, column], 0) for layer in (self.passes, self.looks))
        return cells, passes, looks


_Layers = tuple[Int8, Int32, Int32]


def _laid(
    side: float, x: Float64, y: Float64, read: Callable[[Float64, Float64], _Layers]
) -> tuple[float, float, Int8, Int32, Int32]:
    """Return the lower left corner of cells that hold some places, and their layers as `read` tells them of their middles.

    More than `MAX_CELLS` raise a `TooLargeError`.
    """
    left, low = math.floor(x.min() / side), math.floor(y.min() / side)
    height, width = math.ceil(y.max() / side) - low, math.ceil(x.max() / side) - left
    if height * width > MAX_CELLS:
        raise TooLargeError(f"{width * side:,.0f} x {height * side:,.0f} m")
    layers = np.empty((height, width), np.int8), *np.empty((2, height, width), np.int32)
    middle_x, middle_y = ((np.arange(many) + first + 0.5) * side for many, first in ((width, left), (height, low)))
    step = max(1, AT_ONCE // max(width, 1))
    for begin in range(0, height, step):
        rows = slice(begin, begin + step)
        for layer, part in zip(layers, read(*np.meshgrid(middle_x, middle_y[rows])), strict=True):
            layer[rows] = part
    return left * side, low * side, *layers


def of_map(grid: Occupancy) -> SpaceMap:
    """Return the space of a map: its occupied points are the middles of its cells, of several fine ones their mean."""
    row, column = np.nonzero(grid.cells == OCCUPIED)
    points = np.column_stack([column + 0.5, row + 0.5]) * grid.resolution + [grid.x, grid.y]
    group, cells = max(1, round(FINEST / grid.resolution)), grid.cells
    if group > 1:
        height, width = (-(-length // group) for length in cells.shape)
        whole = np.full((height * group, width * group), UNKNOWN, np.int8)
        whole[: cells.shape[0], : cells.shape[1]] = cells
        # Occupied goes before free, and free before unknown.
        cells = np.ascontiguousarray(whole.reshape(height, group, width, group).max(axis=(1, 3)))
        count = np.ones(len(points))
        _, sums = _summed((row // group) * width + column // group, np.column_stack([points, count]))
        points = sums[:, :2] / sums[:, 2:]
    return SpaceMap(
        group * grid.resolution, grid.x, grid.y, cells, None, None, points, np.zeros_like(points), counted=False
    )


@dataclass(slots=True)
class SpaceSurvey:
    """The space of a run, a fold over its sweeps."""

    counts: Counts
    _keys: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    _sums: Float64 = field(default_factory=lambda: np.empty((0, 6)))
    """(C, 6) x, y, number of the hits of each cell, number of those of agents, way of the sensor and its square."""
    _last: dict[str, tuple[Float64, float]] = field(default_factory=dict)
    """Last place of each sensor (1, 2), and its way up to there [m]."""
    _waiting: list[tuple[Int64, Float64]] = field(default_factory=list)

    def add(self, beams: Beams, agents: Bool | None = None, sensor: str = "") -> None:
        """Count some sweeps of a sensor, of which (S, B) beams are on agents; `TooLargeError` as of `Counts.add`."""
        self.counts.add(beams)
        if not len(beams):
            return
        where = beams.poses[:, :2]
        last, done = self._last.get(sensor, (where[:1], 0.0))
        way = done + np.cumsum(np.hypot(*np.diff(where, axis=0, prepend=last).T))
        self._last[sensor] = where[-1:], float(way[-1])
        hit = (beams.use == HIT) & np.isfinite(beams.end[0])
        x, y = beams.end[0][hit], beams.end[1][hit]
        mine = np.zeros(len(x)) if agents is None else agents[hit]
        way = np.broadcast_to(way[:, None], hit.shape)[hit]
        key, sums = _summed(self._key(x, y), np.column_stack([x, y, np.ones(len(x)), mine, way, way**2]))
        self._waiting.append((key, sums))
        if sum(len(part) for part, _ in self._waiting) > len(self._keys) + (1 << 16):
            self._gather()

    def ground(self, hits: int, ratio: float) -> SpaceMap:
        """Return the space; `hits` and `ratio` as of `Counts.occupancy`."""
        self._gather()
        grid = self.counts.occupancy(hits, ratio, "")
        height, width = grid.cells.shape
        side = grid.resolution
        # The grid lies within what was counted, but for its margin.
        left = round(grid.x / side) - self.counts.column
        low = round(grid.y / side) - self.counts.row
        passes, looks = np.zeros((2, height, width), np.int32)
        rows, columns = self.counts.passes.shape
        top, right, start = min(low + height, rows), min(left + width, columns), max(left, 0)
        # In parts, so that space that nobody observed takes no memory.
        for first in range(max(low, 0), top, BLOCK):
            last = min(first + BLOCK, top)
            passed, hit = (layer[first:last, start:right] for layer in (self.counts.passes, self.counts.hits))
            if passed.any() or hit.any():
                part = np.s_[first - low : last - low, start - left : right - left]
                passes[part], looks[part] = passed, passed + hit
        row, column = np.nonzero(grid.cells == OCCUPIED)
        if not len(row):
            return SpaceMap(side, grid.x, grid.y, grid.cells, passes, looks, *np.empty((2, 0, 2)))
        middle = np.column_stack([column + 0.5, row + 0.5]) * side + [grid.x, grid.y]
        at = np.searchsorted(self._keys, self._key(middle[:, 0], middle[:, 1]))
        sums = self._sums[np.minimum(at, len(self._keys) - 1)]
        # Where an agent stood long, it is unknown what is there without it.
        stands = sums[:, 3] <= 0.5 * sums[:, 2]
        grid.cells[row[~stands], column[~stands]] = UNKNOWN
        sums = sums[stands] / sums[stands, 2:3]
        way = np.column_stack([sums[:, 4], np.sqrt(np.maximum(sums[:, 5] - sums[:, 4] ** 2, 0.0))])
        return SpaceMap(side, grid.x, grid.y, grid.cells, passes, looks, sums[:, :2], way)

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


class Buckets:
    """N points by square cells, so that those near a place are found without a look at all."""

    def __init__(self, points: Float64) -> None:
        """Take points (N, 2) [m]."""
        column, row = np.floor(points / BUCKET).astype(np.int64).T
        self._left = int(column.min(initial=0))
        self._across = int(column.max(initial=0)) - self._left + 1
        self._rows, rank = np.unique(row, return_inverse=True)
        key = rank * self._across + column - self._left
        self._order = np.argsort(key, kind="stable")
        self._keys = key[self._order]

    def near(self, places: Float64, reach: Float64) -> tuple[Int64, Int64]:
        """Return (P,) indices of places (K, 2) and points `reach` (K,) apart or less along each axis, and of some beyond.

        They ascend.
        """
        (left, low), (right, high) = (
            np.floor((places + sign * reach[:, None]) / BUCKET).astype(np.int64).T for sign in (-1.0, 1.0)
        )
        place, rank = _counted_up(np.searchsorted(self._rows, low), np.searchsorted(self._rows, high, side="right"))
        first = rank * self._across + np.clip(left[place] - self._left, 0, self._across)
        last = rank * self._across + np.clip(right[place] - self._left, -1, self._across - 1)
        which, at = _counted_up(np.searchsorted(self._keys, first), np.searchsorted(self._keys, last, side="right"))
        place, point = place[which], self._order[at]
        order = np.lexsort((point, place))
        return place[order], point[order]


def _counted_up(begin: Int64, end: Int64) -> tuple[Int64, Int64]:
    """Return the numbers of each range, and the index of its range."""
    count = end - begin
    which = np.repeat(np.arange(len(begin)), count)
    return which, np.arange(len(which)) + np.repeat(begin - np.cumsum(count) + count, count)


class Nearest:
    """The occupied point nearest to any place, up to `REACH`, and the places that were observed free."""

    def __init__(self, ground: SpaceMap) -> None:
        self.ground = ground
        side = ground.resolution
        up, right = (max(2, -(-length // FREE_SIDE)) for length in ground.cells.shape)
        row, column = np.nonzero(ground.cells[::up, ::right] == FREE)
        self.free: Float64 = (np.column_stack([column * right, row * up]) + 0.5) * side + [ground.x, ground.y]
        """(F, 2) places that were observed free: every other cell of every other row, of large maps fewer [m]."""
        self.area = len(row) * up * right * side**2
        """Space that was observed free [m²]."""
        reach = max(1, math.ceil(REACH / side))
        height, width = ground.cells.shape
        self._pad = reach
        # One more than the index of a point; 0 takes no memory.
        self._index = np.zeros((height + 2 * reach, width + 2 * reach), np.int32)
        x, y = ground.points.T
        column = np.floor((x - ground.x) / side).astype(np.int64) + reach
        row = np.floor((y - ground.y) / side).astype(np.int64) + reach
        across = self._index.shape[1]
        inner = (row >= reach) & (column >= reach) & (row < height + reach) & (column < width + reach)
        self._cell = np.where(inner, row * across + column, -1)
        which = np.flatnonzero(inner).astype(np.int32)
        cell = self._cell[which]
        steps = np.arange(-reach, reach + 1)
        dx, dy = (part.ravel() for part in np.meshgrid(steps, steps))
        distance = np.hypot(dx, dy)
        flat = self._index.reshape(-1)
        flat[cell] = which + 1
        # What is within a mass of others is nearest to no other cell.
        inner_cells = np.all([flat[cell + step] > 0 for step in (1, -1, across, -across)], axis=0)
        edge, cells = which[~inner_cells], cell[~inner_cells]
        # The farthest first, so that nearer points take their place.
        for at in np.argsort(-distance, kind="stable").tolist():
            if 0 < distance[at] <= reach:
                flat[cells + int(dy[at]) * across + int(dx[at])] = edge + 1
        flat[cell] = which + 1

        self._lines = np.empty((len(x), 2)), np.zeros(len(x), np.bool_), np.zeros(len(x), np.bool_)

    def lines(self, index: Int64) -> tuple[Float64, Bool]:
        """Return (K, 2) the normals of the lines through points and their neighbours, and (K,) whether they lie on one."""
        across, is_line, is_known = self._lines
        new = np.unique(index[~is_known[index]])
        across[new], is_line[new] = _lines(self.ground, self._cell, self._index, new)
        is_known[new] = True
        return across[index], is_line[index]

    def of(self, x: Float64, y: Float64) -> tuple[Int64, Float64]:
        """Return (K,) the index of the nearest point of each place, -1 for none, and its distance [m], inf for none."""
        ground = self.ground
        column = np.floor((x - ground.x) / ground.resolution).astype(np.int64) + self._pad
        row = np.floor((y - ground.y) / ground.resolution).astype(np.int64) + self._pad
        height, width = self._index.shape
        inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
        index = np.full(len(x), -1, np.int64)
        index[inside] = self._index[row[inside], column[inside]] - 1
        away = np.full(len(x), np.inf)
        some = index >= 0
        near = ground.points[index[some]]
        away[some] = np.hypot(near[:, 0] - x[some], near[:, 1] - y[some])
        return index, away


def _lines(ground: SpaceMap, cell: Int64, index: Int32, which: Int64) -> tuple[Float64, Bool]:
    """Return what `Nearest.lines` does, of points in cells of an index."""
    points, flat, across = ground.points, index.reshape(-1), index.shape[1]
    reach = max(1, round(ON_LINE / ground.resolution))
    sums = np.zeros((6, len(which)))
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            at = np.clip(cell[which] + dy * across + dx, 0, flat.size - 1)
            other = flat[at] - 1
            there = np.flatnonzero((other >= 0) & (cell[other] == at) & (cell[which] >= 0))
            u, v = (points[other[there]] - points[which[there]]).T
            for each, value in zip(sums, (1.0, u, v, u * u, u * v, v * v), strict=True):
                each[there] += value
    sums = sums.T
    number = np.maximum(sums[:, 0], 1.0)
    mean_x, mean_y = sums[:, 1] / number, sums[:, 2] / number
    xx, xy, yy = (sums[:, 3] / number - mean_x**2, sums[:, 4] / number - mean_x * mean_y, sums[:, 5] / number - mean_y**2)
    root = np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    middle = 0.5 * (xx + yy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    is_line = (number >= 3) & (middle - root <= STRAIGHT * (middle + root)) & (middle + root > 0)
    return np.column_stack([-np.sin(angle), np.cos(angle)]), is_line
