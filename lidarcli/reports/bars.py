"""Bars, courses and maps in block characters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.reports.distributions import Density
from lidarcli.sweeps import Float64

EIGHTHS = " ▁▂▃▄▅▆▇█"
SHADES = " ░▒▓█"

LEAST = 1e-300
"""Values that differ by less are drawn as one: a share of their difference could not be computed."""


def bar(part: float, width: int) -> str:
    """Return a bar of `width` cells for the whole.

    >>> bar(0.5, 4)
    '██  '
    """
    cells = round(part * width)
    # What is there must be seen.
    if part > 0 and not cells:
        return "▏".ljust(width)
    return "█" * min(cells, width) + " " * (width - min(cells, width))


def spark(values: Sequence[float] | NDArray[Any], low: float = 0.0) -> str:
    """Return one character per value, from `low` to the greatest; a blank for a value that is not finite.

    >>> spark([0, 1, 4, 8])
    '▁▁▄█'
    """
    numbers = np.asarray(values, float)
    top = np.nanmax(numbers) if np.isfinite(numbers).any() else 0.0
    scale = 8 / (top - low) if top - low > LEAST else 0.0
    heights = np.clip(np.nan_to_num(np.ceil((numbers - low) * scale)), 1, 8).astype(int)
    return "".join(
        " " if not np.isfinite(value) else EIGHTHS[height]
        for value, height in zip(numbers, heights, strict=True)
    )


def resample(values: Float64, width: int) -> Float64:
    """Return the means of at most `width` groups of values."""
    if len(values) <= width:
        return values
    begin = np.linspace(0, len(values), width, endpoint=False).astype(int)
    there = np.isfinite(values)
    count = np.add.reduceat(there.astype(int), begin)
    total = np.add.reduceat(np.where(there, values, 0.0), begin)
    means: Float64 = np.divide(total, count, out=np.full(width, np.nan), where=count > 0)
    return means


def shade(one: Density, width: int, height: int) -> list[str]:
    """Return the map from above, x to the right and y up: one character per cell, which is twice as high as wide."""
    nx, ny = one.counts.shape
    # A character covers k cells across and 2 k cells up.
    k = max(1, -(-nx // width), -(-ny // (2 * height)))
    columns, lines = -(-nx // k), -(-ny // (2 * k))
    padded = np.zeros((columns * k, lines * 2 * k))
    padded[:nx, :ny] = one.counts
    blocks = padded.reshape(columns, k, lines, 2 * k).sum(axis=(1, 3))
    top = blocks.max()
    level = np.ceil(4 * np.sqrt(blocks / top)).astype(int) if top else blocks.astype(int)
    return ["".join(SHADES[cell] for cell in level[:, line]) for line in range(lines - 1, -1, -1)]
