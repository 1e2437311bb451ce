"""Delay between the header stamp of a sweep and its true time, from the sharpness of the world that it draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.poses.sources import Way
from lidarcli.poses.tracks import planar
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.sweeps import Bool, Float64, Int64, RawSweeps, Status, SweepBatch, SweepPoses

SWEEPS = 200
"""Sweeps that are looked at, the first ones of the way."""
LEAST_SWEEPS = 20
"""Fewer than these have not gone far enough to tell."""
BEAMS = 120
"""Beams of each that are, at equal distances."""
FARTHEST = 100.0
"""[m] Ranges up to this one count: beyond it beams are too far apart to meet in a cell again."""
STEP = 0.05
"""[m] From one of these sweeps to the next the sensor goes this far …"""
TURN = 1.0
"""[m/rad] … where a turn counts as the way of what is so far off."""
CELL = 0.1
"""[m] Side of the world's cells: the fewer the points fill, the sharper the world."""
LONGEST = 0.5
"""[s] Delays up to this one are tried, either way …"""
FINENESS = 0.05
"""[s] … in such steps."""
NEAR = 0.1
"""[s] Around the best of them a parabola is laid through delays this far off …"""
STEP_NEAR = 0.01
"""[s] … in such steps: its lowest point is the delay."""
CLEAR = 0.1
"""Share of the cells that a delay has to save to be worth telling."""

SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class DelaySample:
    """Points of the first sweeps along a way on which the sensor moves; a fold, whatever the batches."""

    way: Way
    deskew: bool = True
    """False: sweeps take no time."""
    _path: float = 0.0
    """Length of the way so far [m]."""
    _place: int = -1
    """Steps of it from which there is a sweep."""
    _last: tuple[float, float, float] | None = None
    """x, y, yaw of the sweep before."""
    _stamps: list[Int64] = field(default_factory=list)
    _lasts: list[Int64] = field(default_factory=list)
    """Durations of sweeps [ns]."""
    _points: list[tuple[Int64, Float64, Float64, Float64]] = field(default_factory=list)
    """Sweep in the sample, x, y in the sensor frame [m], share of the sweep's time; (K,) each."""
    _count: int = 0

    @property
    def full(self) -> bool:
        """True once further sweeps change nothing."""
        return self._count >= SWEEPS

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps of the sensor, in their order."""
        kept = self._wanted(batch.stamp_ns)
        if len(kept):
            self._keep(batch.rows(kept))

    def add_raw(self, block: RawSweeps, rules: RangeRules) -> None:
        """As `add` for raw sweeps; only those that count are judged."""
        kept = self._wanted(block.time_ns)
        if len(kept):
            self._keep(normalise(block.rows(kept), kept, rules))

    def _wanted(self, stamp_ns: Int64) -> Int64:
        """Return the sweeps that belong to the sample."""
        if self.full:
            return np.zeros(0, np.int64)
        return self._far_enough(planar(self.way.at(stamp_ns)))[: SWEEPS - self._count]

    def _keep(self, rows: SweepBatch) -> None:
        """Keep the points of sweeps that belong to it."""
        self._stamps.append(rows.stamp_ns)
        stride = np.maximum(rows.beams // BEAMS, 1)[:, None]
        usable = (rows.status == Status.VALID) & (rows.ranges < FARTHEST)
        row, beam = np.nonzero(usable & (np.arange(rows.width) % stride == 0))
        bearing, ranges = rows.bearings()[row, beam], rows.ranges[row, beam].astype(np.float64)
        taken = 0.0 if rows.duration is None or not self.deskew else rows.duration
        self._lasts.append(np.rint(np.broadcast_to(taken, len(rows)) * SECOND_NS).astype(np.int64))
        x, y = ranges * np.cos(bearing), ranges * np.sin(bearing)
        self._points.append((row + self._count, x, y, rows.shares(row, beam)))
        self._count += len(rows)

    def best(self) -> tuple[float, float] | None:
        """Return the delay [s] whose poses draw the sharpest world, and the share of filled cells that it saves.

        None where the sensor did not move enough, or no delay is clearly better than none.
        """
        if self._count < LEAST_SWEEPS:
            return None
        steps = round(LONGEST / FINENESS)
        # The least delay first, so that it wins where two are as good.
        order = sorted(range(-steps, steps + 1), key=lambda step: (abs(step), step))
        filled = self._filled([step * FINENESS for step in order])
        if not filled[0]:
            return None
        sharpest = int(filled.argmin())
        saved = 1.0 - float(filled[sharpest] / filled[0])
        # At the end of what is tried a greater delay may be better yet, or the poses are those of something else.
        if saved < CLEAR or abs(order[sharpest]) == steps:
            return None
        return self._refined(order[sharpest] * FINENESS), saved

    def _refined(self, near: float) -> float:
        """The lowest point of the parabola through the cells filled by delays around one [s], in steps of `STEP_NEAR`."""
        steps = round(NEAR / STEP_NEAR)
        step = np.arange(-steps, steps + 1)
        filled = self._filled([near + float(by) * STEP_NEAR for by in step])
        # Least squares over steps on both sides alike; sums of whole numbers are the same on every machine.
        square = step * step
        slope = int(step @ filled) / int(square.sum())
        bend = len(step) * square - square.sum()
        curvature = len(step) * int(bend @ filled) / int(bend @ bend)
        # Farther off the next of the coarse steps would have been the best; and it never gets to none.
        most = round(FINENESS / STEP_NEAR) - 1
        lowest = -slope / (2.0 * curvature) if curvature > 0 else 0.0
        return round(near + min(max(round(lowest), -most), most) * STEP_NEAR, 9)

    def _filled(self, delays: Sequence[float]) -> Int64:
        """Number of cells that the points fill with each of the delays [s], all judged by the same points."""
        stamps, lasts = np.concatenate(self._stamps), np.concatenate(self._lasts)
        row, x, y, share = (np.concatenate(values) for values in zip(*self._points, strict=True))
        poses = [self._poses(stamps + round(delay * SECOND_NS), lasts) for delay in delays]
        known: Bool = np.logical_and.reduce([~np.isnan(one.x) for one in poses])[row]
        row, x, y, share = row[known], x[known], y[known], share[known]
        return np.array([_cells(one, row, x, y, share) for one in poses], np.int64)

    def _poses(self, stamps: Int64, lasts: Int64) -> SweepPoses:
        """Return the poses of the sensor from these times on."""
        return self.way.going(planar(self.way.at(stamps)), stamps, lasts if lasts.any() else None)

    def _far_enough(self, poses: SweepPoses) -> Int64:
        """Return the sweeps that are the first in their step of the way."""
        known = np.flatnonzero(~np.isnan(poses.x))
        if not len(known):
            return known
        here = np.column_stack([poses.x[known], poses.y[known], poses.yaw[known]])
        before = np.vstack([here[:1] if self._last is None else np.array([self._last]), here[:-1]])
        moved = here - before
        turned = np.abs((moved[:, 2] + np.pi) % (2 * np.pi) - np.pi)
        # One by one from the path so far, so that the cut of the batches does not change a bit of the sum.
        lengths = np.concatenate([[self._path], np.hypot(moved[:, 0], moved[:, 1]) + TURN * turned])
        path = np.cumsum(lengths)[1:]
        place = np.floor(path / STEP).astype(np.int64)
        first = place > np.concatenate([[self._place], place[:-1]])
        self._path, self._place = float(path[-1]), int(place[-1])
        self._last = (float(here[-1, 0]), float(here[-1, 1]), float(here[-1, 2]))
        return known[first]


def _cells(poses: SweepPoses, row: Int64, x: Float64, y: Float64, share: Float64) -> int:
    """Number of cells of the world that the points (K,) of sweeps `row` fill, at a share of the time of each."""
    world_x, world_y, _ = poses.to_world(row, x, y, np.zeros(len(row)), share)
    column, line = (np.floor(value / CELL).astype(np.int64) for value in (world_x, world_y))
    return len(np.unique(column * np.int64(1 << 32) + line))
