"""Index arithmetic for ragged arrays: flat values with offsets, as Arrow's lists."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps import Int64


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


def offsets_of(sizes: Int64) -> Int64:
    """(J + 1,) offsets of spans of the given sizes."""
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets
