"""§3: learning r_e from sweeps among which people walk: a fold over batches, in bounded memory for any length of log."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.background.alignment import align, lines
from lidarcli.formalism.background.cells import Cells, count_ranges, estimate, merge
from lidarcli.formalism.background.grid import Grid, project
from lidarcli.formalism.background.model import Background, greatest_range
from lidarcli.formalism.background.stations import NOWHERE, UNKNOWN, Shift, gather, joined, shift
from lidarcli.sweeps import Bool, Int64, Status, SweepBatch

MOST_CELLS = 1 << 24
"""Cells that are kept, and beams of all stations: about a gigabyte. Sweeps that would need more are left out."""
PENDING = 1 << 20
"""Cells that wait before they are sorted in."""


class Learning:
    """What has been seen of one sensor; `add` folds sweeps, `background` is what they say so far.

    Parameters
    ----------
    topic, frame_id : the sensor
    grid : its bearings
    distance, angle : reach of a station in position [m] and heading [rad]
    """

    def __init__(self, topic: str, frame_id: str, grid: Grid, distance: float, angle: float) -> None:
        self.topic = topic
        self.frame_id = frame_id
        self.grid = grid
        self.distance = distance
        self.angle = angle
        self.range_max = 0.0
        self.left_out = 0
        """Sweeps for which there was no room."""
        self.poses = NOWHERE
        """Stations in the order in which they were opened; the pose of that of the sweeps without one is NaN."""
        self._sweeps = np.zeros(0, np.int64)
        self._no_return = np.zeros((0, grid.beams), np.int64)
        self._first = np.zeros((0, grid.beams), np.float32)
        """The sweep that opened each station [m]: the later ones are laid onto it."""
        self._parts: list[Cells] = []
        self._pending = 0
        self._settled = 0

    def add(self, batch: SweepBatch) -> None:
        """Fold sweeps of this sensor, in their order."""
        station = self._stations(batch)
        kept = np.flatnonzero(station >= 0)
        self.left_out += len(batch) - len(kept)
        batch, station = batch.rows(kept), station[kept]
        if not len(batch):
            return
        self.range_max = max(self.range_max, float(greatest_range(batch).max()))
        self._sweeps[: self.stations] += np.bincount(station, minlength=self.stations)
        moved = None if batch.poses is None else shift(batch.poses, self.poses.rows(station))
        here = self.grid.fits(batch)
        if moved is not None:
            here &= moved.none
        # Sweeps that need not be moved are told apart row by row, so that their company makes no difference.
        for rows in (np.flatnonzero(here), np.flatnonzero(~here)):
            if len(rows):
                self._fold(
                    batch.rows(rows),
                    station[rows],
                    bool(here[rows[0]]),
                    None if moved is None else moved.rows(rows),
                )

    @property
    def stations(self) -> int:
        """Number of stations so far."""
        return len(self.poses.x)

    @property
    def unplaced(self) -> int:
        """Sweeps that are left out because they have no pose, while others have one."""
        posed = ~np.isnan(self.poses.x)
        return int(self._sweeps[: self.stations][~posed].sum()) if posed.any() else 0

    def background(self) -> Background:
        """r_e of every station. A station without a pose is left out where others have one."""
        cells = self._settle()
        found = estimate(cells, self._no_return[: self.stations].reshape(-1))
        shape = self.stations, self.grid.beams
        posed = ~np.isnan(self.poses.x)
        chosen = np.flatnonzero(posed if posed.any() else ~posed)
        return Background(
            topic=self.topic,
            frame_id=self.frame_id,
            grid=self.grid,
            range_max=self.range_max if self.range_max > 0 else np.inf,
            r_e=found.r_e.reshape(shape)[chosen],
            r_near=found.r_near.reshape(shape)[chosen],
            spread=found.spread.reshape(shape)[chosen],
            support=found.support.reshape(shape)[chosen],
            no_return=found.no_return.reshape(shape)[chosen],
            sweeps=self._sweeps[chosen],
            poses=self.poses.rows(chosen),
            distance=self.distance,
            angle=self.angle,
        )

    def _stations(self, batch: SweepBatch) -> Int64:
        """The station of each sweep, new ones included; -1 where there is no room for one."""
        if self._settled + self._pending >= MOST_CELLS:
            self._settle()
        full = self._settled >= MOST_CELLS
        room = self.stations if full else max(MOST_CELLS // max(self.grid.beams, 1), 1)
        poses = batch.poses or UNKNOWN.rows(np.zeros(len(batch), np.int64))
        station, places = gather(poses, self.poses, self.distance, self.angle, room)
        unknown = np.isnan(poses.x)
        if unknown.any():
            nowhere = np.flatnonzero(np.isnan(places.x))
            if not len(nowhere) and len(places.x) < room:
                nowhere = np.array([len(places.x)])
                places = joined([places, UNKNOWN])
            station[unknown] = nowhere[0] if len(nowhere) else -1
        before, self.poses = self.stations, places
        if self.stations > before:
            self._sweeps = _longer(self._sweeps, self.stations)
            self._no_return = _longer(self._no_return, self.stations)
            self._first = _longer(self._first, self.stations)
            new, row = np.unique(station, return_index=True)
            for number, first in zip(new.tolist(), row.tolist(), strict=True):
                if number >= before:
                    self._first[number] = self._on_grid(batch.rows(np.array([first])))
        return np.full(len(batch), -1) if full else station

    def _on_grid(self, sweep: SweepBatch) -> NDArray[np.float32]:
        """(B,) the ranges of one sweep at the bearings of the background."""
        own = None if sweep.poses is None else shift(sweep.poses, sweep.poses)
        beam, ranges = project(sweep, self.grid, None if own is None or own.none.all() else own)
        seen = (beam >= 0) & ~np.isnan(ranges)
        result = np.full(self.grid.beams, np.nan, np.float32)
        result[beam[seen]] = ranges[seen]
        return result

    def _fold(self, batch: SweepBatch, station: Int64, here: bool, moved: Shift | None) -> None:
        """Count the ranges of sweeps that are all at home at their stations, or all not."""
        if here:
            beam = np.broadcast_to(np.arange(batch.width, dtype=np.int32), batch.ranges.shape)
            ranges = batch.ranges.astype(np.float64)
        else:
            if moved is not None:
                used, which = np.unique(station, return_inverse=True)
                known = lines(self.grid, self._first[used].astype(np.float64))
                moved = align(batch, self.grid, known, which, moved)
            beam, ranges = project(batch, self.grid, moved)
        place = station[:, None] * self.grid.beams + beam
        seen: Bool = beam >= 0
        nothing = seen & (batch.status == Status.NO_RETURN)
        count = self.stations * self.grid.beams
        self._no_return[: self.stations] += np.bincount(place[nothing], minlength=count).reshape(
            self.stations, -1
        )
        valid = seen & (batch.status == Status.VALID)
        self._parts.append(count_ranges(place[valid], ranges[valid]))
        self._pending += len(self._parts[-1])
        if self._pending > max(PENDING, self._settled):
            self._settle()

    def _settle(self) -> Cells:
        """Sort in what waits."""
        cells = merge(self._parts) if self._parts else count_ranges(np.zeros(0, np.int64), np.zeros(0))
        self._parts, self._pending, self._settled = [cells], 0, len(cells)
        return cells


def _longer(values: NDArray[Any], rows: int) -> NDArray[Any]:
    """The same values with room for at least so many rows: twice as many as before, so that growing stays cheap."""
    if rows <= len(values):
        return values
    result = np.zeros((max(rows, 2 * len(values)), *values.shape[1:]), values.dtype)
    result[: len(values)] = values
    return result
