"""Index arithmetic for ragged arrays: flat values with offsets, as Arrow's lists."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps import Float64, Int64


def spans(begin: Int64, size: Int64) -> tuple[Int64, Int64, Int64]:
    """Flat indices of the spans `begin[j] … begin[j] + size[j] - 1`, joined.

    Returns
    -------
    index : (T,) the indices, T = sum of sizes
    owner : (T,) j of each
    offsets : (J + 1,) where each span starts in the joined array

    >>> [part.tolist() for part in spans(np.array([5, 0]), np.array([2, 1]))]
    [[5, 6, 0], [0, 0, 1], [0, 2, 3]]
    """
    offsets = np.zeros(len(size) + 1, np.int64)
    np.cumsum(size, out=offsets[1:])
    owner = np.repeat(np.arange(len(size)), size)
    index = np.arange(offsets[-1]) + (begin - offsets[:-1])[owner]
    return index, owner, offsets


def span_sum(values: Float64, offsets: Int64) -> Float64:
    """(J,) sums over the spans of a joined array, all of which hold at least one value."""
    total: Float64 = np.add.reduceat(values, offsets[:-1]) if len(offsets) > 1 else np.empty(0)
    return total


def span_max(values: Float64, offsets: Int64) -> Float64:
    """(J,) greatest values over the spans of a joined array, all of which hold at least one value."""
    greatest: Float64 = np.maximum.reduceat(values, offsets[:-1]) if len(offsets) > 1 else np.empty(0)
    return greatest


def span_min(values: Float64, offsets: Int64) -> Float64:
    """(J,) least values over the spans of a joined array, all of which hold at least one value."""
    least: Float64 = np.minimum.reduceat(values, offsets[:-1]) if len(offsets) > 1 else np.empty(0)
    return least


def span_first(mask: np.ndarray, owner: Int64, count: int) -> Int64:
    """(count,) joined index of the first True of each span; -1 where a span has none."""
    first = np.full(count, -1, np.int64)
    hit = np.flatnonzero(mask)[::-1]
    first[owner[hit]] = hit
    return first


def offsets_of(sizes: Int64) -> Int64:
    """(J + 1,) offsets of spans of the given sizes."""
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets
