"""What the decoders of all containers share: the size of blocks, and why a message can be no sweep."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidarcli.logs.base import MAX_BEAMS
from lidarcli.sweeps import Float32, Int32, Int64

BLOCK_ROWS = 1024
"""Most sweeps of one block."""
BLOCK_VALUES = 1 << 20
"""Most ranges of one block, padding included, unless one sweep alone has more."""

TOO_MANY = f"more than {MAX_BEAMS} beams declared"
ANGLE_MIN = "angle_min is not finite"
INCREMENT = "angle_increment is not finite"
INCREMENT_ZERO = "angle_increment is zero"


def split_rows(
    counts: Int32 | Int64, max_rows: int = BLOCK_ROWS, max_values: int = BLOCK_VALUES
) -> Iterator[slice]:
    """Cut sweeps of `counts` beams into runs that may be padded to one width.

    A run has at most `max_rows` sweeps and `max_values` values, more than three quarters of them padding
    only where the run is small. One sweep always fits.
    """
    first = 0
    while first < len(counts):
        ahead = np.maximum(counts[first : first + max_rows].astype(np.int64), 1)
        values = np.maximum.accumulate(ahead) * np.arange(1, len(ahead) + 1)
        fits = (values <= max_values) & (values <= np.maximum(4 * np.cumsum(ahead), max_values // 8))
        rows = len(ahead) if fits.all() else max(1, int(np.argmin(fits)))
        yield slice(first, first + rows)
        first += rows


def pad_rows(rows: list[Float32]) -> Float32:
    """Rows of different length as one array, padded with NaN."""
    padded = np.full((len(rows), max(map(len, rows), default=0)), np.nan, np.float32)
    for values, row in zip(padded, rows, strict=True):
        values[: len(row)] = row
    return padded
