"""What is judged: the pieces of a sweep, cut without any notion of a wall or of an object.

A sweep is cut wherever something might end: at steps, at lost beams, at corners. What is cut too often does no harm: pieces
of one thing get the same number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.sweeps.types import Closure, Float64, Int64, SweepBatch

STEP = 0.1
"""[m] Neighbouring points further apart than this, and three times the beam spacing, are of two pieces."""
SPACINGS = 3.0
MAX_LOST = 3
"""Lost beams within a piece."""
LEAST = 3
"""Beams of a piece that is judged."""
BEND = 0.05
"""[m] A piece that leaves its chord by more than this, and three times its own noise, has a corner there."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive beams of a sweep that have a range, in the order of the log."""

    beams: Int64
    """(N,) at least `LEAST`; across the seam of a full turn they go on from the first beam."""
    x: Float64
    """(N,) forward [m]."""
    y: Float64

    @property
    def first(self) -> int:
        """The beam it begins with."""
        return int(self.beams[0])

    @property
    def last(self) -> int:
        """The beam it ends with; before `first` where it lies across the seam."""
        return int(self.beams[-1])


def pieces(batch: SweepBatch, row: int) -> list[Piece]:
    """The pieces of one sweep that are judged, by increasing beam."""
    count = int(batch.beams[row]) - (batch.closure[row] == Closure.SHARED)
    ranges = batch.ranges[row, :count].astype(float)
    beam = np.flatnonzero(np.isfinite(ranges))
    if len(beam) < LEAST:
        return []
    bearing = batch.angle_min[row] + batch.angle_increment[row] * beam
    r = ranges[beam]
    x, y = r * np.cos(bearing), r * np.sin(bearing)
    lost = (np.diff(beam, append=beam[0] + count) - 1).astype(float)
    away = np.hypot(np.roll(x, -1) - x, np.roll(y, -1) - y)
    spacing = np.minimum(r, np.roll(r, -1)) * abs(batch.angle_increment[row])
    breaks = (away > STEP + SPACINGS * spacing * (1 + lost)) | (lost > MAX_LOST)
    if batch.closure[row] == Closure.OPEN:
        breaks[-1] = True
    ends = np.flatnonzero(breaks)
    if not len(ends):
        ends = np.array([len(beam) - 1])
    order = np.roll(np.arange(len(beam)), -(ends[0] + 1))
    runs = np.split(order, np.cumsum(np.diff(ends)))
    found = [part for run in runs for part in _straight(run, x, y)]
    kept = [Piece(beam[part], x[part], y[part]) for part in found if len(part) >= LEAST]
    return sorted(kept, key=lambda piece: piece.first)


def _straight(run: Int64, x: Float64, y: Float64) -> list[Int64]:
    """A run of points, cut at its corners."""
    if len(run) < 2 * LEAST:
        return [run]
    px, py = x[run], y[run]
    along = np.array([px[-1] - px[0], py[-1] - py[0]])
    length = float(np.hypot(*along))
    # What comes back to where it began has no chord: its farthest point is a corner.
    off = np.hypot(px - px[0], py - py[0])
    if length >= STEP:
        off = np.abs((px - px[0]) * along[1] - (py - py[0]) * along[0]) / length
    elif off.max() < STEP:
        return [run]
    noise = float(np.median(np.abs(np.diff(off, 2)))) if len(run) > 4 else 0.0
    at = int(off[LEAST - 1 : len(run) - LEAST + 1].argmax()) + LEAST - 1
    if off[at] <= BEND + 3.0 * noise:
        return [run]
    return [*_straight(run[:at], x, y), *_straight(run[at:], x, y)]
