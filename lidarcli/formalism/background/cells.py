"""§3: ranges counted per station, beam and bin of 5 mm, and the background that the counts speak for."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.background.ragged import offsets_of, spans
from lidarcli.sweeps import Bool, Float64, Int64, record

UNIT = 1e-4
"""[m] Ranges are counted in whole units, so that sums are exact in any order."""
BIN = 50
"""Units of a bin: 5 mm."""
REACH = 20
"""Bins to either side of one that are the same surface: 10 cm."""
DIFFUSE = 60
"""Bins to either side that are one surface where none is narrower, as in foliage: 30 cm."""
PEAK = 5
"""Bins to either side of the place where most of its ranges are."""
CLIP = 2.5
"""Ranges this many standard deviations away from r_e do not count for it: somebody stood close to the surface."""
CLIPPED = 0.946
"""Standard deviation of what is left of a normal distribution, as a share of its own."""
LEAST_CLIP = 200
"""And these need not be fewer units than this: 2 cm."""
SUPPORT = 0.35
"""Share of the observations of a beam that must back its background: people who pass have less."""
NARROW = 10
"""Bins to either side within which a surface that stands still repeats, whatever the noise: 5 cm."""
BEFORE = 30
"""Bins before such a surface, from which on nearly all ranges are its own: 15 cm."""
REPEATED = 0.1
"""Share of the observations that is enough for a surface that stands still behind people who nearly always hide it."""
LEAST_REPEATED = 10
"""And it takes so many observations: a few steps of passers-by fall into one place by chance."""
SET_APART = 0.8
"""Share of the ranges from there on that have to be its own: people and leaves come in all ranges, a surface in one."""
OPEN = 0.5
"""A beam with this share of observations without a return is open, unless a surface has enough support."""

BACKING = 4.0
"""Ranges up to so many standard deviations from r_e support it."""

_BITS = np.int64(23)
_FAR = (np.int64(1) << _BITS) - 1
"""Greatest range that can be told from others [units]: 838 m."""


@record
class Cells:
    """C cells: a beam and a bin each, sorted. All numbers are whole: sums are exact, whatever the order."""

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

    @property
    def beam(self) -> Int64:
        """(C,)"""
        return self.key >> _BITS

    @property
    def unit(self) -> Int64:
        """(C,) first unit of the bin."""
        return self.key & _FAR


def count_ranges(beam: Int64, ranges: Float64) -> Cells:
    """Count ranges [m] at beams, (N,) each.

    >>> cells = count_ranges(np.array([1, 0, 1]), np.array([2.001, 5.0, 2.003]))
    >>> cells.beam.tolist(), (cells.unit * UNIT).round(2).tolist(), cells.count.tolist()
    ([0, 1], [5.0, 2.0], [1, 2])
    """
    unit = np.minimum(np.rint(ranges / UNIT).astype(np.int64), _FAR)
    value = (beam.astype(np.int64) << _BITS) | unit
    value.sort()
    unit = (value & _FAR) % BIN
    return _summed(value - unit, np.ones(len(value), np.int64), unit, unit * unit)


def merge(parts: list[Cells]) -> Cells:
    """The cells of all parts together."""
    if len(parts) == 1:
        return parts[0]
    key = np.concatenate([part.key for part in parts])
    order = np.argsort(key, kind="stable")
    count = np.concatenate([part.count for part in parts])[order]
    total = np.concatenate([part.total for part in parts])[order]
    squares = np.concatenate([part.squares for part in parts])[order]
    return _summed(key[order], count, total, squares)


def _summed(key: Int64, count: Int64, total: Int64, squares: Int64) -> Cells:
    """One cell per distinct key; the keys are sorted."""
    first = np.ones(len(key), bool)
    np.not_equal(key[1:], key[:-1], out=first[1:])
    start = np.flatnonzero(first)
    if len(start) == len(key):
        return Cells(key, count, total, squares)
    sums = (np.add.reduceat(values, start) for values in (count, total, squares))
    return Cells(key[start], *sums)


@record
class Estimate:
    """r_e of N beams, see `Background`."""

    r_e: Float64
    r_near: Float64
    spread: Float64
    support: Float64
    no_return: Float64


def estimate(cells: Cells, no_return: Int64) -> Estimate:
    """r_e of each beam: its farthest surface with enough support, because people stand before the background.

    Ranges within 10 cm of one another are one surface, and 35 % of the observations are enough support. Where no
    surface has as much, one of these is the background, in this order:

    1. what has 35 % within 30 cm, and 80 % of all ranges from there on: foliage, or a wall that a shaking sensor sees
       at many ranges. Between people who come and go more shows of what is behind them;
    2. what repeats within 5 cm though people hide it most of the time: at least 10 % of the observations and 10 of
       them, no fewer than those without a return, and 80 % of all ranges from 15 cm before it on. What stands still
       repeats exactly and nothing is behind it; people and leaves are spread;
    3. nothing: the beam is open, and whatever returns is new.

    Parameters
    ----------
    cells : ranges of N beams
    no_return : (N,) observations without a return

    Returns
    -------
    Estimate, (N,) each
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
    need = SUPPORT * observed
    wanted = returns > 0
    near = _windows(cells, REACH)
    _take(result, cells, wanted, near, near.backing >= need[beam], REACH, observed)
    # What returns less often than not may be people alone: nothing but enough support makes them a surface.
    wanted &= no_return < OPEN * observed
    if wanted.any():
        few = _of(cells, wanted)
        wide = _windows(few, DIFFUSE)
        diffuse = _set_apart(few, wide.backing, DIFFUSE) >= need[few.beam]
        _take(result, few, wanted, wide, diffuse, DIFFUSE, observed)
        near, narrow = _windows(few, REACH), _windows(few, NARROW)
        least = np.maximum(np.maximum(REPEATED * observed, no_return), LEAST_REPEATED)
        repeats = _set_apart(few, narrow.backing, BEFORE) >= least[few.beam]
        _take(result, few, wanted, _Windows(near.begin, near.end, narrow.backing), repeats, NARROW, observed)
    return result


def _of(cells: Cells, beams: Bool) -> Cells:
    """The cells of some beams (N,)."""
    mine = beams[cells.beam]
    return Cells(cells.key[mine], cells.count[mine], cells.total[mine], cells.squares[mine])


@record
class _Windows:
    """The cells around each of C cells, and the ranges in them."""

    begin: Int64
    end: Int64
    """(C,) the cells from `begin` to before `end`."""
    backing: Int64
    """(C,) ranges that speak for a surface at this cell."""


def _take(
    result: Estimate,
    cells: Cells,
    wanted: Bool,
    windows: _Windows,
    fitting: Bool,
    reach: int,
    observed: Int64,
) -> None:
    """Fill in the wanted beams that have a surface `reach` bins wide to either side; they are wanted no more.

    Parameters
    ----------
    wanted : (N,)
    windows : the cells that describe a surface at each cell, and its backing
    fitting : (C,) cells that may be the middle of a surface
    observed : (N,) observations
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


def _set_apart(cells: Cells, backing: Int64, before: int) -> Int64:
    """(C,) the backing of each cell; 0 where too many other ranges are within `before` bins before it or beyond."""
    base = cells.beam << _BITS
    until = offsets_of(cells.count)
    start = np.searchsorted(cells.key, np.maximum(cells.key - before * BIN, base))
    onwards = until[np.searchsorted(cells.key, base + _FAR, side="right")] - until[start]
    return np.where(backing >= SET_APART * onwards, backing, 0)


def _windows(cells: Cells, reach: int) -> _Windows:
    """The cells within `reach` bins of each cell."""
    base = cells.beam << _BITS
    low = np.maximum(cells.key - reach * BIN, base)
    high = np.minimum(cells.key + reach * BIN, base + _FAR)
    begin, end = np.searchsorted(cells.key, low), np.searchsorted(cells.key, high, side="right")
    until = offsets_of(cells.count)
    return _Windows(begin, end, until[end] - until[begin])


def _peaks(
    cells: Cells, enough: Int64, backing: Int64, reach: int, nearest: bool = False
) -> tuple[Int64, Int64]:
    """For each beam with cells that have enough backing the one with most, on the farthest surface, or the nearest.

    Returns
    -------
    beam, cell : (F,)
    """
    beam = cells.beam[enough]
    found, first = np.unique(beam, return_index=True)
    key, which = cells.key[enough], np.searchsorted(found, beam)
    if nearest:
        there = enough[key <= (key[first] + 2 * reach * BIN)[which]]
    else:
        last = np.append(first[1:], len(beam)) - 1
        there = enough[key >= (key[last] - 2 * reach * BIN)[which]]
    order = np.lexsort((backing[there], cells.beam[there]))
    there = there[order]
    return found, there[np.append(np.flatnonzero(np.diff(cells.beam[there])), len(there) - 1)]


def _describe(
    result: Estimate, cells: Cells, found: Int64, begin: Int64, end: Int64, observed: Int64
) -> None:
    """Fill in the beams `found`, whose surface is in the cells from `begin` to before `end`.

    People stand before a surface, never behind it: where most ranges are, the farther half of them tells how far they
    spread, and what is too near for that spread does not count.
    """
    near = _Surface(cells, begin, end)
    r_e = near.peak()
    for _ in range(2):
        count, mean, square = near.moments(r_e - 0.5 * BIN, np.full(len(r_e), np.inf), r_e)
        clip = np.maximum(CLIP * np.sqrt(square), LEAST_CLIP)
        count, mean, square = near.moments(r_e - clip, r_e + clip, r_e)
        r_e = r_e + mean
    result.r_e[found] = (near.origin + r_e) * UNIT
    spread = np.sqrt(np.maximum(square - mean * mean, 0.0)) / CLIPPED
    result.spread[found] = spread * UNIT
    reach = np.maximum(BACKING * spread, LEAST_CLIP)
    count, _, _ = near.moments(r_e - reach, r_e + reach, r_e)
    result.support[found] = count / observed[found]


class _Surface:
    """The cells near the surface of F beams, with sums over any stretch of them. Lengths in units from `origin`."""

    def __init__(self, cells: Cells, begin: Int64, end: Int64) -> None:
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
        low = base | np.maximum(self._unit - PEAK * BIN, 0)
        begin = np.searchsorted(self._key, low)
        end = np.searchsorted(self._key, base | (self._unit + PEAK * BIN), side="right")
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
