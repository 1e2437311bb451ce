"""Whether the sensor stands: then most beams measure what they did in the sweep before."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps import Bool, Float32, SweepBatch

CHANGE, CHANGE_GROWS = 0.03, 0.01
"""[m], and per metre of range: a range that differs by less is the same."""
SAME = 0.8
"""A sensor stands where more than this share of the beams that have a range in both of two sweeps measure the same."""


class Standing:
    """A fold over the sweeps of a topic."""

    def __init__(self) -> None:
        self._before: Float32 = np.empty((0, 0), np.float32)

    def see(self, batch: SweepBatch) -> Bool:
        """(S,) whether the sensor stood since the sweep before; True for the first."""
        ranges = batch.ranges
        if len(self._before) == 0 or self._before.shape[1] != batch.width:
            before = np.vstack([np.full((1, batch.width), np.nan, ranges.dtype), ranges[:-1]])
        else:
            before = np.vstack([self._before, ranges[:-1]])
        self._before = ranges[-1:].copy()
        both = np.isfinite(ranges) & np.isfinite(before)
        with np.errstate(invalid="ignore"):
            same = np.abs(ranges - before) < CHANGE + CHANGE_GROWS * before
        stood: Bool = (same & both).sum(axis=1) >= SAME * both.sum(axis=1)
        return stood
