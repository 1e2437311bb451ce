"""§3: learning r_e from sweeps among which people walk: a fold over batches, in bounded memory for any length of log.

Ranges are counted per station, beam and bin of 5 mm. The background is the surface with enough support in these counts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.background import (
    NO_PLACES,
    UNKNOWN_PLACE,
    Background,
    Grid,
    Shift,
    align,
    gather,
    greatest_range,
    joined,
    lines,
    project,
    shift,
)
from lidarcli.formalism.detection import offsets_of, spans
from lidarcli.sweeps.types import Bool, Float64, Int64, Status, SweepBatch, record

MAX_CELLS, MAX_PENDING = 1 << 24, 1 << 20
"""Greatest number of cells, and of beams of all stations, about a gigabyte: sweeps that need more are left out; and of
cells that wait to be sorted in."""
UNIT = 1e-4
"""[m] Unit in which ranges are counted, so that sums are exact in any order."""
BIN_UNITS = 50
"""Width of a bin, in units: 5 mm."""


@dataclass(frozen=True)
class SurfaceRules:
    """How the counted ranges of a beam become its background r_e. Bins are `BIN_UNITS` wide."""

    bins: int = 20
    """Ranges so many bins to either side of a mode are of its surface: 10 cm."""
    foliage_bins: int = 60
    """The same where no surface is narrower, as in foliage: 30 cm."""
    peak_bins: int = 5
    """Bins to either side that make a mode."""
    clip_sds: float = 2.5
    """Ranges beyond so many standard deviations do not count for r_e, as of a person close to the surface."""
    clipped_sd: float = 0.946
    """Standard deviation of a normal distribution that is cut there, as a share of its own."""
    min_clip: int = 200
    """[units] Ranges nearer to the mode always count: 2 cm."""
    support: float = 0.35
    """A surface with a smaller share of the observations of its beam is no background; people who pass have less."""
    static_bins: int = 10
    """A static surface repeats within so many bins, with any noise: 5 cm."""
    before_bins: int = 30
    """From so many bins before such a surface on nearly all ranges are its own: 15 cm."""
    repeated_share: float = 0.1
    """Share of its observations from which on a surface behind people who nearly always hide it is background, ..."""
    min_repeated: int = 10
    """... and their number, as a few steps of people fall into one place by chance, ..."""
    set_apart_share: float = 0.8
    """... if this share of the ranges from there on is its own."""
    open_share: float = 0.5
    """A beam with a greater share without a return is open, unless a surface has enough support."""
    support_sds: float = 4.0
    """A range within so many standard deviations of r_e supports it."""


SURFACE = SurfaceRules()


_BITS = np.int64(23)
_FAR = (np.int64(1) << _BITS) - 1
"""Greatest range [units]: 838 m."""


class Learning:
    """Sums over the sweeps of one sensor; `add` folds sweeps, `background` gives the background so far.

    `grid` are its bearings; a station reaches `distance` [m] and `angle` [rad].
    """

    def __init__(self, topic: str, frame_id: str, grid: Grid, distance: float, angle: float) -> None:
        self.topic = topic
        self.frame_id = frame_id
        self.grid = grid
        self.distance = distance
        self.angle = angle
        self.range_max = 0.0
        self.left_out = 0
        """Number of sweeps for which there was no room."""
        self.poses = NO_PLACES
        """Poses of the stations in the order in which they were opened; NaN for the station of sweeps without a pose."""
        self._sweeps = np.zeros(0, np.int64)
        self._no_return = np.zeros((0, grid.beams), np.int64)
        self._first = np.zeros((0, grid.beams), np.float32)
        """Ranges of the sweep that opened each station [m]; later sweeps are aligned with it."""
        self._parts: list[LearnedCells] = []
        self._pending = 0
        self._settled = 0

    def add(self, batch: SweepBatch) -> None:
        """Fold sweeps of this sensor, in their order."""
        station = self._stations(batch)
        kept = np.flatnonzero(station >= 0)
        self.left_out += len(batch) - len(kept)
        batch, station = batch.rows(kept), station[kept]
        if not len(batch):
            return
        self.range_max = max(self.range_max, float(greatest_range(batch).max()))
        self._sweeps[: self.stations] += np.bincount(station, minlength=self.stations)
        moved = None if batch.poses is None else shift(batch.poses, self.poses.rows(station))
        here = self.grid.fits(batch)
        if moved is not None:
            here &= moved.none
        # Sweeps that need no projection are picked row by row, so that the other sweeps of the batch make no difference.
        for rows in (np.flatnonzero(here), np.flatnonzero(~here)):
            if len(rows):
                self._fold(
                    batch.rows(rows), station[rows], bool(here[rows[0]]), None if moved is None else moved.rows(rows)
                )

    @property
    def stations(self) -> int:
        """Number of stations so far."""
        return len(self.poses.x)

    @property
    def unplaced(self) -> int:
        """Number of sweeps that are left out because they have no pose while others have one."""
        posed = ~np.isnan(self.poses.x)
        return int(self._sweeps[: self.stations][~posed].sum()) if posed.any() else 0

    def background(self) -> Background:
        """Return the background of every station; one without a pose is left out where others have one."""
        cells = self._settle()
        found = estimate(cells, self._no_return[: self.stations].reshape(-1))
        shape = self.stations, self.grid.beams
        posed = ~np.isnan(self.poses.x)
        chosen = np.flatnonzero(posed if posed.any() else ~posed)
        beams = {each.name: getattr(found, each.name).reshape(shape)[chosen] for each in fields(Estimate)}
        return Background(
            topic=self.topic,
            frame_id=self.frame_id,
            grid=self.grid,
            range_max=self.range_max if self.range_max > 0 else np.inf,
            sweeps=self._sweeps[chosen],
            poses=self.poses.rows(chosen),
            distance=self.distance,
            angle=self.angle,
            **beams,
        )

    def _stations(self, batch: SweepBatch) -> Int64:
        """Return the station of each sweep, new ones included; -1 where there is no room for one."""
        if self._settled + self._pending >= MAX_CELLS:
            self._settle()
        full = self._settled >= MAX_CELLS
        room = self.stations if full else max(MAX_CELLS // max(self.grid.beams, 1), 1)
        poses = batch.poses or UNKNOWN_PLACE.rows(np.zeros(len(batch), np.int64))
        station, places = gather(poses, self.poses, self.distance, self.angle, room)
        unknown = np.isnan(poses.x)
        if unknown.any():
            nowhere = np.flatnonzero(np.isnan(places.x))
            if not len(nowhere) and len(places.x) < room:
                nowhere = np.array([len(places.x)])
                places = joined([places, UNKNOWN_PLACE])
            station[unknown] = nowhere[0] if len(nowhere) else -1
        before, self.poses = self.stations, places
        if self.stations > before:
            self._sweeps = _longer(self._sweeps, self.stations)
            self._no_return = _longer(self._no_return, self.stations)
            self._first = _longer(self._first, self.stations)
            new, row = np.unique(station, return_index=True)
            for number, first in zip(new.tolist(), row.tolist(), strict=True):
                if number >= before:
                    self._first[number] = self._on_grid(batch.rows(np.array([first])))
        return np.full(len(batch), -1) if full else station

    def _on_grid(self, sweep: SweepBatch) -> NDArray[np.float32]:
        """Return (B,) the ranges of one sweep at the bearings of the background [m]."""
        own = None if sweep.poses is None else shift(sweep.poses, sweep.poses)
        beam, ranges = project(sweep, self.grid, None if own is None or own.none.all() else own)
        known = (beam >= 0) & ~np.isnan(ranges)
        result = np.full(self.grid.beams, np.nan, np.float32)
        result[beam[known]] = ranges[known]
        return result

    def _fold(self, batch: SweepBatch, station: Int64, here: bool, moved: Shift | None) -> None:
        """Count the ranges of sweeps, all of them taken at their stations with its bearings, or none of them."""
        if here:
            beam = np.broadcast_to(np.arange(batch.width, dtype=np.int32), batch.ranges.shape)
            ranges = batch.ranges.astype(np.float64)
        else:
            if moved is not None:
                used, which = np.unique(station, return_inverse=True)
                known = lines(self.grid, self._first[used].astype(np.float64))
                moved = align(batch, self.grid, known, which, moved)
            beam, ranges = project(batch, self.grid, moved)
        place = station[:, None] * self.grid.beams + beam
        in_view: Bool = beam >= 0
        nothing = in_view & (batch.status == Status.NO_RETURN)
        count = self.stations * self.grid.beams
        self._no_return[: self.stations] += np.bincount(place[nothing], minlength=count).reshape(self.stations, -1)
        valid = in_view & (batch.status == Status.VALID)
        self._parts.append(count_ranges(place[valid], ranges[valid]))
        self._pending += len(self._parts[-1])
        if self._pending > max(MAX_PENDING, self._settled):
            self._settle()

    def _settle(self) -> LearnedCells:
        """Sort in the cells that wait, and return all."""
        cells = merge(self._parts) if self._parts else count_ranges(np.zeros(0, np.int64), np.zeros(0))
        self._parts, self._pending, self._settled = [cells], 0, len(cells)
        return cells


def _longer(values: NDArray[Any], rows: int) -> NDArray[Any]:
    """Return the values with room for at least so many rows, at least twice as many as before so that growing is cheap."""
    if rows <= len(values):
        return values
    result = np.zeros((max(rows, 2 * len(values)), *values.shape[1:]), values.dtype)
    result[: len(values)] = values
    return result


@record
class LearnedCells:
    """C cells, each a beam and a bin, sorted. All numbers are integers, so that sums are exact in any order."""

    key: Int64
    """(C,) number of the beam << 23 | first unit of the bin."""
    count: Int64
    """(C,) ranges in it."""
    total: Int64
    """(C,) sum of their units above the first of the bin."""
    squares: Int64
    """(C,) sum of the squares of these."""

    def __len__(self) -> int:
        return len(self.key)

    def of(self, beams: Bool) -> LearnedCells:
        """Return the cells of some beams (N,)."""
        mine = beams[self.beam]
        return LearnedCells(self.key[mine], self.count[mine], self.total[mine], self.squares[mine])

    @property
    def beam(self) -> Int64:
        """(C,) the beam of each cell."""
        return self.key >> _BITS

    @property
    def unit(self) -> Int64:
        """(C,) the first unit of the bin."""
        return self.key & _FAR


def count_ranges(beam: Int64, ranges: Float64) -> LearnedCells:
    """Count ranges [m] at beams, (N,) each.

    >>> cells = count_ranges(np.array([1, 0, 1]), np.array([2.001, 5.0, 2.003]))
    >>> cells.beam.tolist(), (cells.unit * UNIT).round(2).tolist(), cells.count.tolist()
    ([0, 1], [5.0, 2.0], [1, 2])
    """
    unit = np.minimum(np.rint(ranges / UNIT).astype(np.int64), _FAR)
    value = (beam.astype(np.int64) << _BITS) | unit
    value.sort()
    unit = (value & _FAR) % BIN_UNITS
    return _summed(value - unit, np.ones(len(value), np.int64), unit, unit * unit)


def merge(parts: list[LearnedCells]) -> LearnedCells:
    """Return the cells of all parts as one."""
    if len(parts) == 1:
        return parts[0]
    key = np.concatenate([part.key for part in parts])
    order = np.argsort(key, kind="stable")
    count = np.concatenate([part.count for part in parts])[order]
    total = np.concatenate([part.total for part in parts])[order]
    squares = np.concatenate([part.squares for part in parts])[order]
    return _summed(key[order], count, total, squares)


def _summed(key: Int64, count: Int64, total: Int64, squares: Int64) -> LearnedCells:
    """Return one cell for each distinct key; the keys are sorted."""
    first = np.ones(len(key), bool)
    np.not_equal(key[1:], key[:-1], out=first[1:])
    start = np.flatnonzero(first)
    if len(start) == len(key):
        return LearnedCells(key, count, total, squares)
    sums = (np.add.reduceat(values, start) for values in (count, total, squares))
    return LearnedCells(key[start], *sums)


@record
class Estimate:
    """r_e of N beams, see `Background`."""

    r_e: Float64
    r_near: Float64
    spread: Float64
    support: Float64
    no_return: Float64


def estimate(cells: LearnedCells, no_return: Int64) -> Estimate:
    """Return r_e of each beam: its farthest surface with enough support, because people stand before the background.

    Ranges within 10 cm of one another are one surface, and 35 % of the observations are enough support. Where no
    surface has as much, one of these is the background, in this order:

    1. what has 35 % within 30 cm, and 80 % of all ranges from there on: foliage, or a wall that a shaking sensor observes
       at many ranges. Between people who come and go more shows of what is behind them;
    2. what repeats within 5 cm though people hide it most of the time: at least 10 % of the observations and 10 of
       them, no fewer than those without a return, and 80 % of all ranges from 15 cm before it on. What is static still
       repeats exactly and nothing is behind it; people and leaves are spread;
    3. nothing: the beam is open, and whatever returns is new.

    `no_return`: (N,) observations without a return.
    """
    beams = len(no_return)
    beam = cells.beam
    returns = np.bincount(beam, cells.count, minlength=beams).astype(np.int64)
    observed = no_return + returns
    result = Estimate(
        r_e=np.where(observed > 0, np.inf, np.nan),
        r_near=np.where(observed > 0, np.inf, np.nan),
        spread=np.full(beams, np.nan),
        support=no_return / np.maximum(observed, 1),
        no_return=no_return / np.maximum(observed, 1),
    )
    need = SURFACE.support * observed
    wanted = returns > 0
    near = _windows(cells, SURFACE.bins)
    _take(result, cells, wanted, near, near.backing >= need[beam], SURFACE.bins, observed)
    # What returns less often than not may be people alone: nothing but enough support makes them a surface.
    wanted &= no_return < SURFACE.open_share * observed
    if wanted.any():
        few = cells.of(wanted)
        wide = _windows(few, SURFACE.foliage_bins)
        diffuse = _set_apart(few, wide.backing, SURFACE.foliage_bins) >= need[few.beam]
        _take(result, few, wanted, wide, diffuse, SURFACE.foliage_bins, observed)
        near, narrow = _windows(few, SURFACE.bins), _windows(few, SURFACE.static_bins)
        least = np.maximum(np.maximum(SURFACE.repeated_share * observed, no_return), SURFACE.min_repeated)
        repeats = _set_apart(few, narrow.backing, SURFACE.before_bins) >= least[few.beam]
        _take(result, few, wanted, _Windows(near.begin, near.end, narrow.backing), repeats, SURFACE.static_bins, observed)
    return result


@record
class _Windows:
    """The cells around each of C cells, and the ranges in them."""

    begin: Int64
    end: Int64
    """(C,) the cells from `begin` to before `end`."""
    backing: Int64
    """(C,) ranges that speak for a surface at this cell."""


def _take(
    result: Estimate, cells: LearnedCells, wanted: Bool, windows: _Windows, fitting: Bool, reach: int, observed: Int64
) -> None:
    """Fill in the wanted beams (N,) that have a surface `reach` bins wide to either side; they are wanted no more.

    `windows` are the cells that describe a surface at each cell, and its backing; `fitting` (C,) cells that may be its
    middle.
    """
    enough = np.flatnonzero(fitting & wanted[cells.beam])
    if not len(enough):
        return
    begin, end, backing = windows.begin, windows.end, windows.backing
    found, peak = _peaks(cells, enough, backing, reach)
    _describe(result, cells, found, begin[peak], end[peak], observed)
    result.r_near[found] = result.r_e[found]
    _, near = _peaks(cells, enough, backing, reach, nearest=True)
    before = end[near] <= begin[peak]
    mean = _Surface(cells, begin[near], end[near])
    result.r_near[found[before]] = ((mean.origin + mean.peak()) * UNIT)[before]
    wanted[found] = False


def _set_apart(cells: LearnedCells, backing: Int64, before: int) -> Int64:
    """(C,) the backing of each cell; 0 where too many other ranges are within `before` bins before it or beyond."""
    base = cells.beam << _BITS
    until = offsets_of(cells.count)
    start = np.searchsorted(cells.key, np.maximum(cells.key - before * BIN_UNITS, base))
    onwards = until[np.searchsorted(cells.key, base + _FAR, side="right")] - until[start]
    return np.where(backing >= SURFACE.set_apart_share * onwards, backing, 0)


def _windows(cells: LearnedCells, reach: int) -> _Windows:
    """The cells within `reach` bins of each cell."""
    base = cells.beam << _BITS
    low = np.maximum(cells.key - reach * BIN_UNITS, base)
    high = np.minimum(cells.key + reach * BIN_UNITS, base + _FAR)
    begin, end = np.searchsorted(cells.key, low), np.searchsorted(cells.key, high, side="right")
    until = offsets_of(cells.count)
    return _Windows(begin, end, until[end] - until[begin])


def _peaks(cells: LearnedCells, enough: Int64, backing: Int64, reach: int, nearest: bool = False) -> tuple[Int64, Int64]:
    """Return the beams with cells that have enough backing, and of each the cell with most, on the farthest or nearest
    surface.
    """
    beam = cells.beam[enough]
    found, first = np.unique(beam, return_index=True)
    key, which = cells.key[enough], np.searchsorted(found, beam)
    if nearest:
        there = enough[key <= (key[first] + 2 * reach * BIN_UNITS)[which]]
    else:
        last = np.append(first[1:], len(beam)) - 1
        there = enough[key >= (key[last] - 2 * reach * BIN_UNITS)[which]]
    order = np.lexsort((backing[there], cells.beam[there]))
    there = there[order]
    return found, there[np.append(np.flatnonzero(np.diff(cells.beam[there])), len(there) - 1)]


def _describe(result: Estimate, cells: LearnedCells, found: Int64, begin: Int64, end: Int64, observed: Int64) -> None:
    """Fill in the beams `found`, whose surface is in the cells from `begin` to before `end`.

    People stand before a surface, never behind it: where most ranges are, the farther half of them tells how far they
    spread, and what is too near for that spread does not count.
    """
    near = _Surface(cells, begin, end)
    r_e = near.peak()
    for _ in range(2):
        count, mean, square = near.moments(r_e - 0.5 * BIN_UNITS, np.full(len(r_e), np.inf), r_e)
        clip = np.maximum(SURFACE.clip_sds * np.sqrt(square), SURFACE.min_clip)
        count, mean, square = near.moments(r_e - clip, r_e + clip, r_e)
        r_e = r_e + mean
    result.r_e[found] = (near.origin + r_e) * UNIT
    spread = np.sqrt(np.maximum(square - mean * mean, 0.0)) / SURFACE.clipped_sd
    result.spread[found] = spread * UNIT
    reach = np.maximum(SURFACE.support_sds * spread, SURFACE.min_clip)
    count, _, _ = near.moments(r_e - reach, r_e + reach, r_e)
    result.support[found] = count / observed[found]


class _Surface:
    """The cells near the surface of F beams, with sums over any stretch of them. Lengths in units from `origin`."""

    def __init__(self, cells: LearnedCells, begin: Int64, end: Int64) -> None:
        index, self._owner, _ = spans(begin, end - begin)
        self.origin = cells.unit[begin]
        self._unit = cells.unit[index] - self.origin[self._owner]
        self._key = (self._owner << _BITS) | self._unit
        count, total = cells.count[index], cells.total[index]
        self._count = offsets_of(count)
        self._sum = offsets_of(self._unit * count + total)
        self._square = offsets_of(self._unit**2 * count + 2 * self._unit * total + cells.squares[index])

    def peak(self) -> Float64:
        """(F,) mean of the ranges where most of them are."""
        base = self._owner << _BITS
        low = base | np.maximum(self._unit - SURFACE.peak_bins * BIN_UNITS, 0)
        begin = np.searchsorted(self._key, low)
        end = np.searchsorted(self._key, base | (self._unit + SURFACE.peak_bins * BIN_UNITS), side="right")
        backing = self._count[end] - self._count[begin]
        best = np.lexsort((backing, self._owner))[np.cumsum(np.bincount(self._owner)) - 1]
        begin, end = begin[best], end[best]
        mean: Float64 = (self._sum[end] - self._sum[begin]) / backing[best]
        return mean

    def moments(self, low: Float64, high: Float64, about: Float64) -> tuple[Float64, Float64, Float64]:
        """Number, mean and mean square of the ranges between two bounds, measured from `about`. (F,) each."""
        base = np.arange(len(about)) << _BITS
        first, last = (np.clip(np.rint(bound), 0, _FAR).astype(np.int64) for bound in (low, high))
        begin = np.searchsorted(self._key, base | first)
        end = np.searchsorted(self._key, base | last, side="right")
        count = np.maximum(self._count[end] - self._count[begin], 1).astype(np.float64)
        mean = (self._sum[end] - self._sum[begin]) / count
        square = (self._square[end] - self._square[begin]) / count
        return count, mean - about, np.maximum(square - 2 * about * mean + about * about, 0.0)
