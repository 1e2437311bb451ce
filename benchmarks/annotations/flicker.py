"""How steady detections are: those of a parked sensor that have no counterpart in the next sweep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from lidarcli.sweeps.types import Bool, SweepBatch

MIN_BEAMS, FARTHEST, WITHIN = 8, 5.0, 0.2
"""Detections of at least so many beams, up to so far away [m], have a counterpart that is so near [m]."""
PARKED, SAME, SAME_GROWS = 0.9, 0.03, 0.01
"""A sensor is parked where this share of the beams with a range in both sweeps changes by less than so much [m], [m/m]."""


@dataclass(frozen=True, slots=True)
class Flicker:
    """They add up over logs."""

    detections: int = 0
    lost: int = 0
    """Without a counterpart in the next sweep."""
    pairs: int = 0
    """Detections with one …"""
    reshaped: int = 0
    """… of another shape."""

    def __add__(self, other: Flicker) -> Flicker:
        return Flicker(
            self.detections + other.detections,
            self.lost + other.lost,
            self.pairs + other.pairs,
            self.reshaped + other.reshaped,
        )

    @property
    def share(self) -> float:
        """Of the detections, those that are lost; 0 without any."""
        return self.lost / self.detections if self.detections else 0.0

    @property
    def reshaped_share(self) -> float:
        """Of the detections with a counterpart, those whose shape changes; 0 without any."""
        return self.reshaped / self.pairs if self.pairs else 0.0


def parked_pairs(batches: Sequence[SweepBatch]) -> Iterator[tuple[int, int]]:
    """Consecutive sweeps between which the sensor stood, by their index in the log."""
    for batch in batches:
        for row in range(len(batch) - 1):
            if is_parked(batch, row) and batch.sweep[row + 1] == batch.sweep[row] + 1:
                yield int(batch.sweep[row]), int(batch.sweep[row + 1])


def is_parked(batch: SweepBatch, row: int) -> bool:
    """Whether a sweep measures what the next one does."""
    a, b = batch.ranges[row], batch.ranges[row + 1]
    both: Bool = np.isfinite(a) & np.isfinite(b)
    if not both.any():
        return False
    return float(np.mean(np.abs(a[both] - b[both]) < SAME + SAME_GROWS * a[both])) >= PARKED


def measure(objects: pa.Table, batches: Sequence[SweepBatch]) -> Flicker:
    """The flicker of the rows of the objects table of one topic."""
    sweep = objects["sweep"].to_numpy()
    x, y, beams = (objects[name].to_numpy() for name in ("x", "y", "beams"))
    shape = objects["shape"].to_numpy(zero_copy_only=False)
    total = Flicker()
    for one, other in parked_pairs(batches):
        here = np.arange(*np.searchsorted(sweep, [one, one + 1]))
        there = np.arange(*np.searchsorted(sweep, [other, other + 1]))
        asked = here[(beams[here] >= MIN_BEAMS) & (np.hypot(x[here], y[here]) <= FARTHEST)]
        if not len(asked):
            continue
        if not len(there):
            total += Flicker(len(asked), len(asked))
            continue
        away = np.hypot(x[asked, None] - x[there], y[asked, None] - y[there])
        nearest = away.argmin(axis=1)
        found = away[np.arange(len(asked)), nearest] <= WITHIN
        changed = shape[asked[found]] != shape[there[nearest[found]]]
        total += Flicker(len(asked), int(np.sum(~found)), int(found.sum()), int(changed.sum()))
    return total
