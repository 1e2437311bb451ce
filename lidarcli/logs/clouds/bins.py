"""The beams of a sweep that is made of a cloud: which point is in which, and which had none."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import OpenOptions
from lidarcli.logs.blocks import given_geometry
from lidarcli.logs.clouds.cloud import Floats
from lidarcli.sweeps import TURN, Float32, Int64

MANY_HOLES = 0.05
"""A greater share of empty bins, each between two alike, is worth a note."""
WIDE = np.deg2rad(45.0)
SOME_CLOUDS = 10
"""So wide a part of the view without a point in so many clouds is worth a note."""


@dataclass(frozen=True, slots=True)
class Bins:
    """The beams of a sweep that is made of a cloud."""

    first: float
    """Bearing of the first one [rad]."""
    step: float
    """From one to the next [rad]."""
    count: int

    @classmethod
    def of(cls, options: OpenOptions, count: int) -> Bins:
        """The view that the options tell, else a full turn that begins behind the sensor."""
        first, step = given_geometry(options, count) or (-np.pi, TURN / count)
        return cls(first if options.angle_min is None else options.angle_min, step, count)

    def nearest(self, x: Floats, y: Floats, near: float, far: float) -> tuple[Int64, Int64]:
        """The bins that have a point, and of each the nearest of the points (N,) at x, y [m] from `near` to `far`."""
        square = x * x + y * y
        # NaN and what overflows is no point.
        kept = np.flatnonzero((square >= near * near) & (square <= far * far))
        if len(kept) < len(x):
            x, y, square = x[kept], y[kept], square[kept]
        step = abs(self.step)
        # A point belongs to the bin whose bearing is nearest: bins begin half a step before it.
        turned = np.arctan2(y, x)
        turned -= (self.first + np.pi) % TURN - np.pi
        if self.step < 0:
            turned = -turned
        turned += 0.5 * step
        turned[turned < 0.0] += TURN
        # What is a whole turn on is the first bin again, also where a bearing has been rounded up to it.
        turned[turned >= TURN] -= turned.dtype.type(TURN)
        places = np.maximum(turned, 0.0) / step
        inside = places < self.count
        if not inside.all():
            kept, places, square = kept[inside], places[inside], square[inside]
        at = places.astype(np.int64)
        # Of positive numbers the bits are in the order of their values: the point follows its distance in one word.
        words = square.astype(np.float32).view(np.uint32).astype(np.uint64) << np.uint64(32)
        words |= np.arange(len(words), dtype=np.uint64)
        best = np.full(self.count, _NONE)
        np.minimum.at(best, at, words)
        bins = np.flatnonzero(best != _NONE)
        return bins, kept[(best[bins] & np.uint64(0xFFFFFFFF)).astype(np.int64)]


_NONE = np.uint64(0xFFFFFFFFFFFFFFFF)


@dataclass(slots=True)
class Fill:
    """Which bins had points, over all clouds of a topic."""

    bins: Bins
    clouds: int = 0
    _hit: Int64 = field(init=False)
    """(B,) clouds that had a point there."""
    _between: int = 0
    """Empty bins both of whose neighbours are at about the same range …"""
    _filled: int = 0
    """… and bins that are not empty."""

    def __post_init__(self) -> None:
        """Begin at zero."""
        self._hit = np.zeros(self.bins.count, np.int64)

    def add(self, ranges: Float32) -> None:
        """Take some sweeps."""
        filled = np.isfinite(ranges)
        self.clouds += len(ranges)
        self._hit += np.count_nonzero(filled, axis=0)
        self._filled += int(np.count_nonzero(filled))
        if ranges.shape[1] > 2:
            before, after = ranges[:, :-2], ranges[:, 2:]
            with np.errstate(invalid="ignore"):
                near = np.abs(before - after) < 0.1 * before
            self._between += int(np.count_nonzero(near & ~filled[:, 1:-1]))

    def notes(self) -> list[str]:
        """What a user should know: a view that is told wrong, and bins that are too narrow for the sensor."""
        if not self._filled:
            return ["no cloud has a point between these heights"] if self.clouds else []
        notes = []
        holes = self._between / (self._between + self._filled)
        if holes > MANY_HOLES:
            fitting = self.bins.count // int(np.ceil(1.0 / (1.0 - holes)))
            notes.append(
                f"{holes:.0%} of the bins are empty between two that are not: the sensor has fewer columns than --bins "
                f"{self.bins.count}; try --bins {max(fitting, 2)}"
            )
        if self.clouds >= SOME_CLOUDS and (blind := self._blind()) is not None:
            first, last = np.degrees(blind)
            notes.append(
                f"no cloud has a point from {first:.0f} to {last:.0f} degrees: if the sensor does not look there, "
                f"--angle-min {last - 360:.0f} --fov {360 - (last - first):.0f} --degrees say so"
            )
        return notes

    def _blind(self) -> tuple[float, float] | None:
        """The bearings between which no bin of a full turn was ever hit, if they are far apart [rad]."""
        bins = self.bins
        if abs(bins.count * abs(bins.step) - TURN) > 1e-6:
            return None
        hit = np.flatnonzero(self._hit)
        gaps = np.diff(hit, append=hit[0] + bins.count)
        widest = int(np.argmax(gaps))
        if gaps[widest] * abs(bins.step) < WIDE:
            return None
        edges = bins.first + bins.step * (hit[widest] + np.array([0, gaps[widest]]))
        low, high = np.sort(edges)
        turns = TURN * np.floor((low + np.pi) / TURN)
        return float(low - turns), float(high - turns)
