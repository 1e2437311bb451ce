"""Trajectories: where each track was in every sweep from its first sighting to its last, visible or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.tracking.results import HIDDEN, PARTLY, SEEN, Trajectories
from lidarcli.formalism.tracking.tracks import Track, place_of
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, UInt8, median

PARTS_MASK, PARTLY_BIT = 63, 64
"""A byte for a sweep of a track: the number of its parts that are visible, and whether more of it is hidden."""
LONGEST_STEP, PAUSE = 1.0, 3.0
"""[s] A longer step from row to row is a pause of the log, in which nothing was observed, unless it is less than so many
times the median step."""
MAX_ROWS = 65_536
"""Rows that are handed out at once, about."""


def observed_steps(seconds: Float64, seen: Bool, sensor: NDArray[np.integer[Any]]) -> Bool:
    """Return (N,) whether sweeps observed a track all the path to each of its rows from the one before.

    They observed the path between two rows that are visible if no other sweep of the sensor of the latter lies between
    them, and no pause of the log. The rows are those of one track in the order of time, with the sensor of each."""
    at, steps = np.flatnonzero(seen), np.diff(seconds)
    before, order = np.full(len(seen), -1), np.argsort(sensor, kind="stable")
    before[order[1:]] = np.where(sensor[order[1:]] == sensor[order[:-1]], order[:-1], -1)
    longest = max(LONGEST_STEP, PAUSE * float(median(steps))) if len(steps) else 0.0
    whole = np.flatnonzero((before[at[1:]] <= at[:-1]) & (np.diff(seconds[at]) <= longest))
    edges = np.zeros(len(seen) + 1, np.int64)
    edges[at[whole] + 1] += 1
    edges[at[whole + 1] + 1] -= 1
    return np.cumsum(edges)[:-1] > 0


@dataclass(slots=True)
class TrackPiece:
    """A piece of the path of a track that moves, sweep by sweep."""

    track: Track
    begin: int
    """Number of sweeps of the topic before the first one of the piece."""
    path: Float64
    """(S, 9) as `smoothing.Smoother.smooth` fills it in."""
    codes: UInt8
    """(S,) bytes as of `PARTS_MASK`."""
    moving: UInt8
    """(S,) 1 where it moves."""

    def add_distance(self, sweeps: Sweeps) -> None:
        """Add the path of the piece to that of the track, apart what sweeps observed of it and what they did not."""
        track, place, stop = self.track, self.path[:, :2], self.begin + len(self.codes)
        seen = self.codes & PARTS_MASK > 0
        # The row before is the last one of the piece before.
        lead = int(track.seen_stop == self.begin)
        rows = sweeps.of(self.begin - lead, stop)
        step = observed_steps(rows["seconds"], np.append(np.ones(lead, bool), seen), rows["sensor"])[lead:]
        goes_on = track.path_stop >= 0 and self.moving.any()
        steps = np.hypot(*np.diff(place, axis=0, prepend=[[track.x, track.y]] if goes_on else place[:1]).T)
        track.distance += float(steps[step & (self.moving == 1)].sum())
        track.distance_hidden += float(steps[~step].sum())
        track.seen_ns += int(np.diff(rows["stamp_ns"], prepend=rows["stamp_ns"][:1])[lead:][step].sum())
        track.seen_stop = stop if seen[-1] else -1

    def add_to_track(self) -> None:
        """Add the piece to the greatest speed of the track, whose place is now the end of the piece."""
        track, place = self.track, self.path[:, :2]
        speed = np.hypot(self.path[:, 2], self.path[:, 3])[self.codes & PARTS_MASK > 0]
        track.speed_max = max(track.speed_max, float(speed.max(initial=0.0)))
        track.x, track.y = float(place[-1, 0]), float(place[-1, 1])
        track.path_stop = self.begin + len(self.codes)


SWEEP = np.dtype(
    [
        ("index", np.int64),
        ("stamp_ns", np.int64),
        ("seconds", np.float64),
        ("posed", np.uint8),
        ("sensor", np.int32),
        ("placed", np.bool_),
    ]
)
"""Of a sweep: its index in the log; stamp [ns]; time since the first sweep [s]; 1 where places are those of the world;
its sensor; True where the place of the sensor is known, because it has a pose or stands."""


class Sweeps:
    """(N,) `SWEEP` of all sweeps so far, of one sensor or of several that are followed together, by number."""

    def __init__(self) -> None:
        self.count = 0
        self._rows = np.empty(0, SWEEP)

    def add(self, rows: NDArray[np.void]) -> None:
        """Add the next sweeps."""
        stop = self.count + len(rows)
        if stop > len(self._rows):
            more = np.empty(max(len(self._rows) * 5 // 4, stop), SWEEP)
            more[: self.count] = self._rows[: self.count]
            self._rows = more
        self._rows[self.count : stop] = rows
        self.count = stop

    def of(self, begin: int, stop: int) -> NDArray[np.void]:
        """Return the sweeps of some numbers."""
        return self._rows[begin:stop]

    def sensors_of(self, sweeps: Int64) -> Int32:
        """Return (N,) the sensors of some sweeps."""
        return self._rows["sensor"][sweeps]

    def steps(self, before: int, sweeps: Int64) -> Int64:
        """Return (N,) the steps to sweeps from the ones before, the first from `before`, in sweeps of their own sensors."""
        sensors = self._rows["sensor"][before : int(sweeps[-1]) + 1]
        if (sensors == sensors[0]).all():
            return np.diff(sweeps, prepend=before)
        mine = np.unique(self.sensors_of(sweeps), return_inverse=True)
        passed = np.cumsum(sensors[:, None] == mine[0], axis=0)
        at = np.concatenate([[before], sweeps]) - before
        found: Int64 = passed[at[1:], mine[1]] - passed[at[:-1], mine[1]]
        return found

    def rows(self, track: Int64, sweeps: Int64, path: Float64, codes: UInt8) -> Trajectories:
        """Return rows for (N,) tracks in sweeps by number, with (N, 9) of the path and (N,) bytes as of `PARTS_MASK`."""
        parts = (codes & PARTS_MASK).astype(np.int32)
        sd = np.sqrt(path[:, [4, 6, 7, 8]])
        row = self._rows[sweeps]
        return Trajectories(
            track=track,
            sensor=row["sensor"].copy(),
            sweep=row["index"].copy(),
            stamp_ns=row["stamp_ns"].copy(),
            seconds=row["seconds"].copy(),
            frame=row["posed"].copy(),
            x=path[:, 0],
            y=path[:, 1],
            vx=path[:, 2],
            vy=path[:, 3],
            x_sd=sd[:, 0],
            y_sd=sd[:, 1],
            xy_cov=path[:, 5],
            vx_sd=sd[:, 2],
            vy_sd=sd[:, 3],
            seen=np.where(parts == 0, HIDDEN, np.where(codes & PARTLY_BIT, PARTLY, SEEN)).astype(np.uint8),
            parts=parts,
        )


def standing(sweeps: Sweeps, tracks: list[Track]) -> Iterator[Trajectories]:
    """Yield the pending rows of what is static: one place each, by all that was observed of it."""
    pending: list[TrackPiece] = []
    rows = 0
    for track in tracks:
        if not track.static_codes:
            continue
        codes = np.concatenate(track.static_codes)
        track.static_codes.clear()
        for first in range(0, len(codes), MAX_ROWS):
            some = codes[first : first + MAX_ROWS]
            begin, rest = track.path_stop - len(codes) + first, np.zeros(len(some), np.uint8)
            x, y, xx, xy, yy = place_of(track)
            path = np.tile([x, y, 0.0, 0.0, xx, xy, yy, 0.0, 0.0], (len(some), 1))
            pending.append(TrackPiece(track, begin, path, some, rest))
            rows += len(some)
            if rows >= MAX_ROWS:
                yield joined(sweeps, pending)
                pending, rows = [], 0
    if pending:
        yield joined(sweeps, pending)


def joined(sweeps: Sweeps, pieces: list[TrackPiece]) -> Trajectories:
    """Return the rows of pieces of paths, one after the other, and add their paths to those of the tracks."""
    for piece in pieces:
        piece.add_distance(sweeps)
    lengths = [len(piece.codes) for piece in pieces]
    return sweeps.rows(
        np.repeat([piece.track.number for piece in pieces], lengths).astype(np.int64),
        np.concatenate([np.arange(piece.begin, piece.begin + len(piece.codes)) for piece in pieces]),
        np.concatenate([piece.path for piece in pieces]),
        np.concatenate([piece.codes for piece in pieces]),
    )
