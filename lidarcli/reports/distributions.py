"""Histograms of the objects' figures, and a map of where objects were."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps import TURN, Float64, Int64

BINS = 24
CELLS = 48
"""Most cells of the map along one side."""
NARROW = 1e-9
"""Values that differ by a smaller share of themselves are one value."""
TAIL = 99.5
"""[%] What lies beyond goes into the last bin: one far point must not flatten all others."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts of a figure between edges; the first and last bin hold what lies beyond."""

    name: str
    unit: str
    edges: Float64
    """(B + 1,)"""
    counts: Int64
    """(B,)"""


@dataclass(frozen=True, slots=True)
class Density:
    """Numbers of objects whose centroid lies in each cell of a grid."""

    frame: str
    """`sensor` or `world`."""
    x0: float
    y0: float
    cell: float
    """[m]"""
    counts: Int64
    """(NX, NY), x forward, y left."""


def nice_edges(values: Float64, bins: int = BINS) -> Float64:
    """Return edges at round numbers that hold the values but for a far tail.

    >>> nice_edges(np.array([0.11, 0.5, 1.02]), 10).tolist()[:3]
    [0.1, 0.2, 0.30000000000000004]
    """
    there = values[np.isfinite(values)]
    if not len(there):
        return np.array([0.0, 1.0])
    low, high = (float(value) for value in np.percentile(there, (100 - TAIL, TAIL)))
    # Bins far narrower than the values would have edges that are all the same number.
    span = high - low if high - low > NARROW * max(abs(low), abs(high), NARROW) else max(abs(low), 1e-3)
    width = round_up(span / bins)
    first = math.floor(low / width)
    last = max(math.floor(high / width) + 1, first + 1)
    edges: Float64 = np.arange(first, last + 1, dtype=np.float64) * width
    return edges


def round_up(value: float) -> float:
    """Return the next of 1, 2, 2.5, 5 times a power of ten.

    >>> [round_up(value) for value in (0.03, 1.0, 7.0)]
    [0.05, 1.0, 10.0]
    """
    power = 10.0 ** math.floor(math.log10(value))
    step = next(step for step in (1.0, 2.0, 2.5, 5.0, 10.0) if step * power >= value * (1 - 1e-9))
    return step * power


def bearing_edges() -> Float64:
    """Return the full turn in bins of 15 degrees."""
    return np.linspace(-TURN / 2, TURN / 2, BINS + 1)


def histogram(name: str, unit: str, values: Float64, edges: Float64) -> Histogram:
    """Count values between edges."""
    there = values[np.isfinite(values)]
    if unit == "rad":
        there = (there + TURN / 2) % TURN - TURN / 2
    counts, _ = np.histogram(np.clip(there, edges[0], edges[-1]), edges)
    return Histogram(name, unit, edges, counts.astype(np.int64))


def density(frame: str, x: Float64, y: Float64) -> Density | None:
    """Count points on square cells of a round size; None without points."""
    there = np.isfinite(x) & np.isfinite(y)
    if not there.any():
        return None
    x, y = x[there], y[there]
    x_low, x_high = (float(value) for value in np.percentile(x, (100 - TAIL, TAIL)))
    y_low, y_high = (float(value) for value in np.percentile(y, (100 - TAIL, TAIL)))
    cell = max(round_up(max(x_high - x_low, y_high - y_low, 1e-3) / CELLS), 0.05)
    # The map ends at whole cells; what lies beyond the tail is outside.
    x0, y0 = math.floor(x_low / cell), math.floor(y_low / cell)
    nx, ny = math.floor(x_high / cell) + 1 - x0, math.floor(y_high / cell) + 1 - y0
    ix, iy = np.floor(x / cell) - x0, np.floor(y / cell) - y0
    inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
    # Far outside a cell has no number that fits.
    place = (ix[inside] * ny + iy[inside]).astype(np.int64)
    counts = np.bincount(place, minlength=nx * ny).reshape(nx, ny)
    return Density(frame, x0 * cell, y0 * cell, cell, counts.astype(np.int64))
