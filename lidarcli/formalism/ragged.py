"""Index arithmetic for ragged arrays: flat values with offsets, as Arrow's lists."""

from __future__ import annotations

import numpy as np

from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int64


@compiled
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
    offsets = offsets_of(size)
    owner = np.repeat(np.arange(len(size)), size)
    index = np.arange(offsets[-1])
    index += np.repeat(begin - offsets[:-1], size)
    return index, owner, offsets


@compiled
def span_sum(values: Float64, offsets: Int64) -> Float64:
    """(J,) sums over the spans of a joined array, all of which hold at least one value."""
    total: Float64 = np.add.reduceat(values, offsets[:-1]) if len(offsets) > 1 else np.empty(0)
    return total


@compiled
def span_max(values: Float64, offsets: Int64) -> Float64:
    """(J,) greatest values over the spans of a joined array, all of which hold at least one value."""
    greatest: Float64 = np.maximum.reduceat(values, offsets[:-1]) if len(offsets) > 1 else values[:0]
    return greatest


@compiled
def span_min(values: Float64, offsets: Int64) -> Float64:
    """(J,) least values over the spans of a joined array, all of which hold at least one value."""
    least: Float64 = np.minimum.reduceat(values, offsets[:-1]) if len(offsets) > 1 else values[:0]
    return least


@compiled
def span_max_positive(values: Float64, offsets: Int64) -> Float64:
    """`span_max` of values that are not negative: their bits are ordered as they are, and integers compare faster."""
    if len(offsets) < 2:
        return values[:0]
    greatest: Float64 = np.maximum.reduceat(values.view(np.int64), offsets[:-1]).view(np.float64)
    return greatest


@compiled
def span_bounds(values: Float64, offsets: Int64) -> tuple[Float64, Float64]:
    """(J,) least and greatest values over the spans of a joined array, all of which hold at least one value."""
    if len(offsets) < 2:
        return values[:0], values[:0]
    order = _ordered(values.view(np.int64))
    low, high = np.minimum.reduceat(order, offsets[:-1]), np.maximum.reduceat(order, offsets[:-1])
    return _ordered(low).view(np.float64), _ordered(high).view(np.float64)


def _ordered(bits: Int64) -> Int64:
    """Integers that are ordered as the floats with these bits; and back, by doing it again."""
    sign = bits >> 63
    sign &= np.int64(0x7FFFFFFFFFFFFFFF)
    sign ^= bits
    return sign


@compiled
def span_first(mask: Bool, offsets: Int64) -> Int64:
    """(J,) joined index of the first True of each span, all of which hold one."""
    hit = np.flatnonzero(mask)
    return hit[np.searchsorted(hit, offsets[:-1])]


@compiled
def offsets_of(sizes: Int64) -> Int64:
    """(J + 1,) offsets of spans of the given sizes."""
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets
