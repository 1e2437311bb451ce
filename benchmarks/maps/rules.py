"""How published programs fill an occupancy grid, written anew from their code: gmapping, Karto, Cartographer, OctoMap.

Each takes sweep after sweep: where the sensor was and where its beams ended, in cells of the ground. Beams without a return
say nothing, as they do in these programs with their defaults.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, SKIPPED, UNKNOWN, Beams, Counts, Occupancy
from lidarcli.sweeps.types import Bool, Float64, Int64

GMAPPING_RATIO = 0.25
"""slam_gmapping, `occ_thresh`."""
KARTO_RATIO, KARTO_PASSES = 0.1, 2
"""slam_toolbox, `occupancy_threshold` and `min_pass_through`."""
CARTOGRAPHER_HIT, CARTOGRAPHER_MISS, CARTOGRAPHER_CLAMP = 0.55, 0.49, (0.1, 0.9)
"""Probabilities of a hit, of a miss, and the least and the greatest of a cell."""
CARTOGRAPHER_OCCUPIED = (0.5, 0.65)
"""More than even, and what map_server takes as occupied."""
OCTOMAP_HIT, OCTOMAP_MISS, OCTOMAP_CLAMP, OCTOMAP_OCCUPIED = 0.7, 0.4, (0.1192, 0.971), 0.5
ONCE = ((2, 0.1), (2, 0.25), (2, 0.5), (4, 0.25))
"""Least hits, and the ratio to be exceeded, of the rules by which each cell counts once per sweep."""


@dataclass(frozen=True, slots=True)
class Ground:
    """The cells that are counted: W columns from `column`, H rows from `row`, in cells from the origin of the world."""

    resolution: float
    column: int
    row: int
    width: int
    height: int

    def key(self, column: Int64, row: Int64) -> Int64:
        """One number for each cell."""
        return row * self.width + column


def ground_of(beams: Beams, resolution: float) -> Ground:
    """The ground that the beams may touch, with a cell around it."""
    points = np.hstack([beams.end.reshape(2, -1), beams.poses[:, :2].T])
    low = np.floor(np.nanmin(points, axis=1) / resolution).astype(np.int64) - 1
    high = np.floor(np.nanmax(points, axis=1) / resolution).astype(np.int64) + 2
    width, height = (high - low).tolist()
    return Ground(resolution, int(low[0]), int(low[1]), width, height)


class Rule(Protocol):
    """A fold over sweeps that ends in grids."""

    def add(self, ground: Ground, start: Float64, ends: Float64) -> None:
        """Take a sweep from `start` (2,) to the `ends` (N, 2) of its beams, in cells of the ground."""

    def occupied(self) -> dict[str, tuple[Bool, Bool]]:
        """Name → which cells (H * W,) are occupied, and which are known at all."""


def stepped(start: Int64, ends: Int64) -> tuple[Int64, Int64]:
    """Columns and rows of the cells before the ends (N, 2), by Bresenham: one for each step along the longer axis."""
    way = ends - start
    steps = np.abs(way).max(axis=1)
    ray = np.repeat(np.arange(len(ends)), steps)
    at = np.arange(len(ray)) - np.repeat(np.cumsum(steps) - steps, steps)
    share = way[ray] / np.maximum(steps, 1)[ray, None]
    cells = start + np.floor(at[:, None] * share + 0.5).astype(np.int64)
    return cells[:, 0], cells[:, 1]


def crossed(start: Float64, ends: Float64) -> tuple[Int64, Int64]:
    """Columns and rows of all cells that the rays go through, but for the one in which each of them ends."""
    begin, last = np.floor(start).astype(np.int64), np.floor(ends).astype(np.int64)
    way = ends - start
    columns, rows, rays = ([np.full(len(ends), begin[0])], [np.full(len(ends), begin[1])], [np.arange(len(ends))])
    for axis in range(2):
        steps = np.abs(last[:, axis] - begin[axis])
        ray = np.repeat(np.arange(len(ends)), steps)
        number = np.arange(len(ray)) - np.repeat(np.cumsum(steps) - steps, steps)
        sign = np.where(way[ray, axis] > 0, 1, -1)
        # The cell that is entered, and how far along the other axis the border is met.
        entered = begin[axis] + sign * (number + 1)
        border = entered + (sign < 0)
        share = (border - start[axis]) / way[ray, axis]
        other = np.floor(start[1 - axis] + share * way[ray, 1 - axis]).astype(np.int64)
        columns.append(entered if axis == 0 else other)
        rows.append(other if axis == 0 else entered)
        rays.append(ray)
    column, row, ray = np.concatenate(columns), np.concatenate(rows), np.concatenate(rays)
    before = (column != last[ray, 0]) | (row != last[ray, 1])
    return column[before], row[before]


@dataclass(slots=True)
class PerBeam:
    """gmapping and Karto: every beam counts for every cell on its way, also where another one of its sweep has."""

    hits: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    passes: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    """(H * W,) beams that ended in each cell, and beams that went through it."""

    def add(self, ground: Ground, start: Float64, ends: Float64) -> None:
        cells = ground.width * ground.height
        if not len(self.hits):
            self.hits, self.passes = np.zeros(cells, np.int64), np.zeros(cells, np.int64)
        last = np.floor(ends).astype(np.int64)
        self.hits += np.bincount(ground.key(last[:, 0], last[:, 1]), minlength=cells)
        self.passes += np.bincount(ground.key(*stepped(np.floor(start).astype(np.int64), last)), minlength=cells)

    def occupied(self) -> dict[str, tuple[Bool, Bool]]:
        """gmapping: n hits of all visits. Karto: the last cell of a beam is passed twice, once by its line."""
        visits, passes = self.hits + self.passes, 2 * self.hits + self.passes
        known = passes > KARTO_PASSES
        return {
            "gmapping": (self.hits > GMAPPING_RATIO * visits, visits > 0),
            "Karto": (known & (self.hits > KARTO_RATIO * passes), known),
        }


@dataclass(slots=True)
class LogOdds:
    """Cartographer and OctoMap: each cell once per sweep, hit or else missed, and its odds are kept within limits."""

    name: str
    hit: float
    miss: float
    clamp: tuple[float, float]
    thresholds: tuple[float, ...]
    """A cell is occupied above this probability."""
    odds: Float64 = field(default_factory=lambda: np.zeros(0))
    """(H * W,) logarithm of the odds of each cell, even at the beginning."""
    seen: Bool = field(default_factory=lambda: np.zeros(0, np.bool_))

    def add(self, ground: Ground, start: Float64, ends: Float64) -> None:
        cells = ground.width * ground.height
        if not len(self.odds):
            self.odds, self.seen = np.zeros(cells), np.zeros(cells, np.bool_)
        last = np.floor(ends).astype(np.int64)
        change = np.zeros(cells)
        change[ground.key(*crossed(start, ends))] = log_odds(self.miss)
        change[ground.key(last[:, 0], last[:, 1])] = log_odds(self.hit)
        low, high = (log_odds(limit) for limit in self.clamp)
        touched = np.flatnonzero(change)
        self.odds[touched] = np.clip(self.odds[touched] + change[touched], low, high)
        self.seen[touched] = True

    def occupied(self) -> dict[str, tuple[Bool, Bool]]:
        several = len(self.thresholds) > 1
        return {
            f"{self.name}, p > {limit:g}" if several else self.name: (self.seen & (self.odds > log_odds(limit)), self.seen)
            for limit in self.thresholds
        }


def log_odds(probability: float) -> float:
    """Of a probability."""
    return float(np.log(probability / (1.0 - probability)))


def published() -> list[Rule]:
    """All of them, empty."""
    return [
        PerBeam(),
        LogOdds("Cartographer", CARTOGRAPHER_HIT, CARTOGRAPHER_MISS, CARTOGRAPHER_CLAMP, CARTOGRAPHER_OCCUPIED),
        LogOdds("OctoMap", OCTOMAP_HIT, OCTOMAP_MISS, OCTOMAP_CLAMP, (OCTOMAP_OCCUPIED,)),
    ]


def maps_by_rules(
    beams: Beams, taken: Bool, resolution: float, rules: Callable[[], Sequence[Rule]] = published
) -> dict[str, Occupancy]:
    """Name of each published rule → the map that it makes of those of the S sweeps that are taken."""
    ground = ground_of(beams, resolution)
    folds = rules()
    corner = np.array([ground.column, ground.row])
    for sweep in np.flatnonzero(taken):
        ends = beams.end[:, sweep][:, beams.use[sweep] != SKIPPED].T / resolution - corner
        start = beams.poses[sweep, :2] / resolution - corner
        for fold in folds:
            fold.add(ground, start, ends)
    return {name: _grid(ground, *cells) for fold in folds for name, cells in fold.occupied().items()}


def _grid(ground: Ground, occupied: NDArray[np.bool_], known: NDArray[np.bool_]) -> Occupancy:
    cells = np.where(occupied, OCCUPIED, np.where(known, FREE, UNKNOWN)).astype(np.int8)
    size = ground.resolution
    return Occupancy(size, ground.column * size, ground.row * size, cells.reshape(ground.height, ground.width))


def counts_of(beams: Beams, taken: Bool, resolution: float) -> Counts:
    """This project's counts, each cell once per sweep, of those of the S sweeps that are taken."""
    counts = Counts(resolution, 1 << 30)
    rows = np.flatnonzero(taken)
    end, use = np.ascontiguousarray(beams.end[:, rows]), np.ascontiguousarray(beams.use[rows])
    counts.add(Beams(end, use, beams.beams[rows], beams.poses[rows], beams.way[rows]))
    return counts


def maps_once(beams: Beams, taken: Bool, resolution: float) -> dict[str, Occupancy]:
    """The maps of these counts with several least hits and ratios."""
    counts = counts_of(beams, taken, resolution)
    return {once(*rule): counts.occupancy(*rule, "map") for rule in ONCE}


def once(hits: int, ratio: float) -> str:
    """The name of such a rule."""
    return f"once per sweep, hits ≥ {hits}, ratio > {ratio:g}"
