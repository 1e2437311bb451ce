"""Long lines of a map, along which building goes on, without what stands by itself in free space."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps import Float64, Int32, Int64

OCCUPIED_SHARE, FREE_SHARE = 0.25, 0.15
"""An occupied cell was hit by more than the first share of the sweeps that saw it, a free one by less than the second."""
ENOUGH_CELLS, MOST_CELLS = 1000, 40_000
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
    """Return (N,) the cells on long lines, by their number in the map; cells of islands are left out.

    Parameters
    ----------
    hits, passes : (H, W) number of sweeps that hit and passed each cell
    resolution : side of a cell [m]
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
    if len(row) > MOST_CELLS:
        some = np.linspace(0, len(row) - 1, MOST_CELLS).astype(np.int64)
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
    piece = _pieces(cell, width)
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


def _pieces(cell: Int64, width: int) -> NDArray[np.intp]:
    """Return (N,) the number of the piece of each cell, from 0; cells that touch, also at a corner, are of one piece."""
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
