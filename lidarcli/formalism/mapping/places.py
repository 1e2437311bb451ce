"""Verdict by place: what all sweeps say of the cells of the ground that a body covers, and what their map says of these.

One sweep cannot tell a short wall from a cupboard. Where the place of the sensor is known, what stands at one place is one
thing or one piece of building in all sweeps, whatever parts of it they see. Votes add up in any order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lidarcli.formalism.detection import NOISE, OBJECT, WALL, Detection
from lidarcli.formalism.mapping import rays
from lidarcli.formalism.mapping.grid import HIT, SKIPPED, Beams, Counts, MotionFilter, pieces
from lidarcli.sweeps import Bool, Float32, Float64, Int32, Int64, SweepBatch, SweepPoses, UInt8, record

# Long lines of a map, along which building goes on. What stands by itself in free space is an island, and no part of a
# line.

OCCUPIED_SHARE, FREE_SHARE = 0.25, 0.15
"""An occupied cell was hit by more than the first share of the sweeps that saw it, a free one by less than the second."""
ENOUGH_CELLS, MOST_LINE_CELLS = 1000, 40_000
"""Occupied cells with two hits beyond which those with one make no line, and beyond which some are left out."""
DIRECTIONS = 180
"""Number of directions of lines that are tried."""
NEAR, ON_LINE = 0.09, 0.12
"""[m] Greatest distance of the cells that make a line, and of those that are on it."""
LEAST_LENGTH, GREATEST_GAP, LEAST_COVER = 2.5, 1.0, 0.6
"""[m], [m] Least length of a line, and its greatest gap; least share of its length that has cells."""
MOST_LINES = 600
"""Greatest number of lines."""
ISLAND_SIZE, ISLAND_RING, ISLAND_FREE = 1.5, 3, 0.6
"""[m], cells: an island is smaller than this, and more than this share of the ring of this width around it is free."""


def lines(hits: Int32, passes: Int32, resolution: float) -> Int64:
    """Return (N,) the cells on long lines without islands, by their number in the map; (H, W) hits and passes, resolution
    [m].
    """
    width = hits.shape[1]
    cell = _occupied(hits, passes)
    steady = cell[hits.reshape(-1)[cell] > 1]
    row, column = np.divmod(steady if len(steady) > ENOUGH_CELLS else cell, width)
    if not len(row):
        return cell
    # The part of the map that has cells, and some around it.
    low, left = int(row.min()) - ISLAND_RING, int(column.min()) - ISLAND_RING
    shape = int(row.max()) - low + ISLAND_RING + 1, int(column.max()) - left + ISLAND_RING + 1
    on = np.zeros(shape, np.bool_)
    for at in _lines(row - low, column - left, resolution):
        on[at[0].clip(0, shape[0] - 1), at[1].clip(0, shape[1] - 1)] = True
    row, column = np.nonzero(on)
    row, column = row + low, column + left
    inside = (row >= 0) & (row < hits.shape[0]) & (column >= 0) & (column < width)
    found: Int64 = row[inside] * width + column[inside]
    if not len(found):
        return found
    rest: Int64 = found[~np.isin(found, islands(hits, passes, resolution))]
    return rest


def _occupied(hits: Int32, passes: Int32) -> Int64:
    """Return the occupied cells, by their number in the map."""
    cell = np.flatnonzero(hits)
    hit = hits.reshape(-1)[cell]
    return cell[hit > OCCUPIED_SHARE * (hit + passes.reshape(-1)[cell])]


def _lines(row: Int64, column: Int64, resolution: float) -> Iterator[tuple[Int64, Int64]]:
    """Yield rows and columns of the cells on each line, the one with most cells first; no cell makes two lines (Hough)."""
    if len(row) > MOST_LINE_CELLS:
        some = np.linspace(0, len(row) - 1, MOST_LINE_CELLS).astype(np.int64)
        row, column = row[some], column[some]
    turns = np.arange(DIRECTIONS) * (np.pi / DIRECTIONS)
    cos, sin = np.cos(turns), np.sin(turns)
    reach = int(np.hypot(row.max(), column.max())) + 1
    bins = 2 * reach + 1
    # Number of the bin of each cell in each direction; cells on a line share one.
    across = np.rint(np.outer(column, cos) + np.outer(row, sin)).astype(np.int32) + reach
    across += np.arange(DIRECTIONS, dtype=np.int32) * bins
    votes = np.bincount(across.reshape(-1), minlength=DIRECTIONS * bins).astype(np.int32)
    left = np.ones(len(row), np.bool_)
    least = round(LEAST_COVER * LEAST_LENGTH / resolution)
    for _ in range(MOST_LINES):
        best = int(votes.argmax())
        if votes[best] < least:
            return
        turn, distance = divmod(best, bins)
        distance -= reach
        off = column * cos[turn] + row * sin[turn] - distance
        near = np.flatnonzero(left & (np.abs(off) < NEAR / resolution))
        along = row[near] * cos[turn] - column[near] * sin[turn]
        taken = _stretches(along, resolution)
        for part in taken:
            yield _beside(along[part], distance, cos[turn], sin[turn], resolution)
        if not taken:
            votes[max(best - 1, 0) : best + 2] = 0
            continue
        gone = near[np.concatenate(taken)]
        left[gone] = False
        np.subtract.at(votes, across[gone].reshape(-1), 1)


def _stretches(along: Float64, resolution: float) -> list[Int64]:
    """Return the indices of the cells of each long stretch of a line; `along` (N,) their places on it [cells]."""
    order = np.argsort(along, kind="stable")
    sorted_along = along[order]
    gaps = np.flatnonzero(np.diff(sorted_along) * resolution > GREATEST_GAP) + 1
    found, end = [], 0
    for stop in [*gaps.tolist(), len(order)]:
        begin, end = end, stop
        length = float(sorted_along[end - 1] - sorted_along[begin]) if end > begin else 0.0
        if length * resolution < LEAST_LENGTH:
            continue
        covered = 1 + np.count_nonzero(np.diff(np.floor(sorted_along[begin:end])))
        if covered >= LEAST_COVER * length:
            found.append(order[begin:end])
    return found


def _beside(along: Float64, distance: int, cos: float, sin: float, resolution: float) -> tuple[Int64, Int64]:
    """Return rows and columns of the cells near a stretch of a line."""
    steps = np.arange(along.min() - 1.0, along.max() + 1.0, 0.5)
    sides = distance + np.linspace(-1.0, 1.0, 7) * (ON_LINE / resolution)
    column = np.rint(np.add.outer(cos * sides, -sin * steps)).astype(np.int64)
    row = np.rint(np.add.outer(sin * sides, cos * steps)).astype(np.int64)
    return row.reshape(-1), column.reshape(-1)


def islands(hits: Int32, passes: Int32, resolution: float) -> Int64:
    """Return (N,) the occupied cells of small pieces with free space around, by their number in the map; as `lines`."""
    height, width = hits.shape
    cell = _occupied(hits, passes)
    if not len(cell):
        return cell
    piece = pieces(cell, width)
    row, column = np.divmod(cell, width)
    count = int(piece.max()) + 1
    size = np.zeros(count)
    for at in (row, column):
        low, high = np.full(count, max(height, width)), np.zeros(count, np.int64)
        np.minimum.at(low, piece, at)
        np.maximum.at(high, piece, at)
        size += np.square(high - low + 1.0)
    mine = np.flatnonzero(size[piece] < (ISLAND_SIZE / resolution) ** 2)
    steps = np.arange(-ISLAND_RING, ISLAND_RING + 1)
    down, right = (each.reshape(-1) for each in np.meshgrid(steps, steps, indexing="ij"))
    beside = np.clip(row[mine, None] + down, 0, height - 1) * width
    beside += np.clip(column[mine, None] + right, 0, width - 1)
    beside += piece[mine, None] * (height * width)
    touches = np.maximum(np.abs(down), np.abs(right)) <= 1
    ring = np.setdiff1d(beside[:, ~touches], beside[:, touches])
    of, place = np.divmod(ring, height * width)
    passed = passes.reshape(-1)[place]
    free = (passed > 0) & (hits.reshape(-1)[place] < FREE_SHARE * (hits.reshape(-1)[place] + passed))
    share = np.bincount(of, free, minlength=count) / np.maximum(np.bincount(of, minlength=count), 1)
    return cell[mine[share[piece[mine]] > ISLAND_FREE]]


CELL, FARTHEST, REACH = 0.1, 15.0, 150.0
"""[m] Side of a cell; greatest range of a beam that votes, as farther ones miss their cells where the pose is turned a
little; greatest distance of the sensor from where its world begins: farther sweeps do not vote."""
MOST_STOPS = 16
"""Greatest number of places where a sensor without poses stood that are remembered."""
WORLDS = MOST_STOPS + 1
"""Worlds of one sensor: the first is that of its poses."""
MOST_SENSORS = 64
"""Most sensors of one topic that are told apart; sweeps of further frames do not vote."""
MOST_VOTE, BUILDING_VOTE, LINE_ODDS = 4.0, -2.0, -2.0
"""[log-odds] Greatest vote of a body; vote of a beam on a surface that is no body, because it is too wide; what the map
adds to a body that is on one of its lines as a whole."""
SURFACE_STEP = 0.3
"""[m] Greatest difference of the ranges of neighbours on one surface."""
SAME_RANGE, SAME_RANGE_GROWTH = 0.03, 0.01
"""[m], [m/m] Greatest change of a range that is the same, and its growth with the range."""
STANDING_SHARE = 0.8
"""Share of the beams with a range in two sweeps that measure the same if the sensor stands."""
UNIT = 64.0
"""Votes of one log-odds: whole numbers have the same sum in any order."""
MARGIN = FARTHEST + 1.0
"""[m] Greatest distance of a cell from the way of the sensor during a sweep: beams end within it, with those around."""
MAP_STEP = 0.2
"""[m] Least way of the sensor between two sweeps that the map is made of."""


@record
class ByPlace:
    """Evidence of the places of K bodies; NaN where a body is in no place that is known."""

    thing: Float64
    """(K,) probability of being a thing."""
    place: Float64
    """(K,) part of the votes in its log-odds."""
    map: Float64
    """(K,) part of the map."""

    def judged(self, detection: Detection, least: float) -> Detection:
        """Return the bodies with these probabilities; what is less likely than `least` a thing is wall."""
        thing = np.where(np.isnan(self.thing), detection.thing, self.thing)
        kind, shape = detection.set.copy(), detection.shape.copy()
        refused = (kind == OBJECT) & (thing < least)
        kind[refused], shape[refused] = NOISE, WALL
        return replace(detection, thing=thing, set=kind, shape=shape)


@dataclass(slots=True)
class _Ground(Counts):
    """Counts of the cells of one world, and their votes."""

    LAYERS: ClassVar[tuple[str, ...]] = (*Counts.LAYERS, "votes", "line")

    votes: Int64 = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(H, W) sum of the votes and their number, as of `rays.cast`."""
    line: UInt8 = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    """(H, W) 1 for a cell on a line of the map."""
    motion: MotionFilter = field(default_factory=lambda: MotionFilter(MAP_STEP))
    """Choice of the sweeps of the map."""

    def take(self, sweeps: SweepsInWorld, rows: Int64, vote: Int64) -> None:
        """Take the votes of some sweeps."""
        begin = sweeps.poses[rows, :2]
        path = np.concatenate([begin, begin + sweeps.way[rows, :2]])
        left, low = np.floor((path.min(axis=0) - MARGIN) / self.resolution).astype(np.int64).tolist()
        right, high = np.ceil((path.max(axis=0) + MARGIN) / self.resolution).astype(np.int64).tolist()
        self._reach(left, low, right, high)
        building = round(BUILDING_VOTE * UNIT)
        rays.cast(sweeps.ends, rows, vote, building, self.votes, self.resolution, self.column, self.row)
        x, y, yaw, side = sweeps.poses[rows].T
        kept = rows[self.motion.take(SweepPoses(x, y, yaw, side < 0.0), sweeps.batch.stamp_ns[rows])]
        if len(kept):
            self.add(sweeps.beams(kept))


class SweepsInWorld:
    """The sweeps of a batch in their worlds, (S,) as of `Places.add`."""

    def __init__(self, batch: SweepBatch, detection: Detection, worlds: Int64) -> None:
        self.batch = batch
        self.poses: Float64 = np.zeros((len(batch), 4))
        """(S, 4) x, y, yaw and side of the sensor; where it is known by none but itself, it is the origin."""
        self.way: Float64 = np.zeros((len(batch), 3))
        """(S, 3) its way in x, y, yaw during the sweep."""
        self.poses[:, 3] = 1.0
        at, poses = (worlds >= 0) & (worlds % WORLDS == 0), batch.poses
        if poses is not None:
            side = np.where(poses.upside_down, -1.0, 1.0)
            self.poses[at] = np.column_stack([poses.x, poses.y, poses.yaw, side])[at]
            if poses.way is not None:
                self.way[at] = poses.way[at]
        self.ends = rays.Ends(batch, detection, self.poses, self.way, FARTHEST, SURFACE_STEP)

    def beams(self, rows: Int64) -> Beams:
        """Return the beams of some sweeps."""
        ranges = self.batch.ranges[rows]
        end = np.empty((2, *ranges.shape))
        rays.place_ends(self.ends, rows, end)
        use = np.where(ranges <= FARTHEST, np.uint8(HIT), np.uint8(SKIPPED))
        return Beams(end, use, np.require(self.batch.beams[rows], np.int32), self.poses[rows], self.way[rows])


class Standing:
    """A fold over the sweeps of a topic that tells whether the sensor stands, by the beams that measure the same again."""

    def __init__(self) -> None:
        self._before: Float32 = np.empty(0, np.float32)

    def see(self, batch: SweepBatch) -> Bool:
        """Return (S,) True where the sensor stood since the sweep before, and for the first sweep."""
        ranges = batch.ranges
        # Padding depends on the batch and has no ranges, nor has the sweep before the first one.
        last = np.full((1, batch.width), np.nan, ranges.dtype)
        shared = min(batch.width, len(self._before))
        last[0, :shared] = self._before[:shared]
        self._before = ranges[-1].copy()
        before = np.concatenate([last, ranges[:-1]])
        change = np.abs(ranges - before)
        # Comparisons with NaN are false.
        same = np.count_nonzero(change < SAME_RANGE + SAME_RANGE_GROWTH * before, axis=1)
        stood: Bool = same >= STANDING_SHARE * np.count_nonzero(change >= 0.0, axis=1)
        return stood


@dataclass(slots=True)
class _Sensor:
    """The place of one sensor of a topic, and the origin of its world."""

    first: int
    """Number of the first of its worlds."""
    standing: Standing = field(default_factory=Standing)
    stops: int = 1
    begin: tuple[float, float] | None = None

    def worlds(self, batch: SweepBatch) -> Int64:
        """Return (S,) the world of each sweep among those of the sensor, -1 for none."""
        stood = self.standing.see(batch) if batch.still is None else batch.still
        stops = self.stops + np.cumsum(~stood)
        if len(batch):
            self.stops = int(stops[-1])
        worlds = np.where(stood & (stops <= MOST_STOPS), stops, -1)
        poses = batch.poses
        if poses is None:
            return worlds
        known = np.isfinite(poses.x) & np.isfinite(poses.y) & np.isfinite(poses.yaw)
        if batch.fits is not None:
            known &= batch.fits
        if poses.way is not None:
            known &= (np.abs(poses.way) < FARTHEST).all(axis=1)
        if known.any() and self.begin is None:
            at = int(np.argmax(known))
            self.begin = float(poses.x[at]), float(poses.y[at])
        if self.begin is not None:
            x, y = self.begin
            with np.errstate(invalid="ignore"):
                far = np.maximum(np.abs(poses.x - x), np.abs(poses.y - y)) > REACH
            return np.where(known, np.where(far, -1, 0), worlds)
        return worlds


class Places:
    """Places of one topic: a fold over its sweeps in bounded memory; batches of any size give the same."""

    def __init__(self) -> None:
        self._grounds: dict[int, _Ground] = {}
        """Cells by world: of each sensor that of its poses, and one for every stop where it has none."""
        self._sensors: dict[tuple[str, int], _Sensor] = {}
        """By frame and run of the log: the world of each run is its own."""

    def add(self, batch: SweepBatch, detection: Detection) -> Int64:
        """Take the votes of S sweeps; return (S,) their worlds, which `read` asks for, -1 where the sensor's place is not
        known.
        """
        worlds = self._worlds(batch)
        thing = np.clip(np.nan_to_num(detection.thing, nan=0.5), 1e-9, 1.0 - 1e-9)
        vote = np.rint(UNIT * np.clip(np.log(thing / (1.0 - thing)), -MOST_VOTE, MOST_VOTE)).astype(np.int64)
        sweeps = SweepsInWorld(batch, detection, worlds)
        for world, rows in _by_world(worlds):
            if world not in self._grounds:
                self._grounds[world] = _Ground(CELL, MOST_CELLS)
            self._grounds[world].take(sweeps, rows, vote)
        return worlds

    def settle(self) -> None:
        """Look at the maps, once all sweeps have voted; without this the maps say nothing."""
        for ground in self._grounds.values():
            ground.close()
            ground.line.reshape(-1)[lines(ground.hits, ground.passes, ground.resolution)] = 1
            ground.hits = ground.passes = np.zeros((0, 0), np.int32)

    def read(self, batch: SweepBatch, detection: Detection, worlds: Int64) -> ByPlace:
        """Return what the places of K bodies say by all sweeps so far; `worlds` (S,) as `add` returned them."""
        found = np.zeros((len(detection), 4), np.int64)
        sweeps = SweepsInWorld(batch, detection, worlds)
        for world, rows in _by_world(worlds):
            ground = self._grounds[world]
            rays.poll(sweeps.ends, rows, ground.votes, ground.line, ground.resolution, ground.column, ground.row, found)
        total, count, on_line, cells = found.T
        known = (cells > 0) & ~np.isnan(detection.thing)
        place = np.where(known, total / (UNIT * np.maximum(count, 1)), np.nan)
        by_map = np.where(known, LINE_ODDS * on_line / np.maximum(cells, 1), np.nan)
        return ByPlace(1.0 / (1.0 + np.exp(-place - by_map)), place, by_map)

    def _worlds(self, batch: SweepBatch) -> Int64:
        """Return (S,) the world of each sweep, -1 for none."""
        found = np.full(len(batch), -1)
        for name, rows, mine in batch.by_frame():
            key = name, batch.run
            if key not in self._sensors and len(self._sensors) == MOST_SENSORS:
                continue
            sensor = self._sensors.setdefault(key, _Sensor(WORLDS * len(self._sensors)))
            worlds = sensor.worlds(mine)
            found[rows] = np.where(worlds >= 0, sensor.first + worlds, -1)
        return found


MOST_CELLS = math.ceil(2.0 * (REACH + FARTHEST + MARGIN) / CELL + 2.0) ** 2
"""Cells of the ground that the sweeps of one world can reach."""


def _by_world(worlds: Int64) -> list[tuple[int, Int64]]:
    """Return the worlds of some sweeps, and the rows of each."""
    return [(world, np.flatnonzero(worlds == world)) for world in np.unique(worlds).tolist() if world >= 0]
