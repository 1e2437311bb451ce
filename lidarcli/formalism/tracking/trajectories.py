"""Trajectories: where each track was in every sweep from its first sight to its last, seen or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.tracking.results import HIDDEN, PARTLY, SEEN, Trajectories
from lidarcli.formalism.tracking.tracks import Track, place_of
from lidarcli.sweeps import Float64, Int64, UInt8

PARTS_MASK, PARTLY_BIT = 63, 64
"""A byte for a sweep of a track: the number of its parts that are seen, and whether more of it is hidden."""
MOST_ROWS = 65_536
"""Rows that are handed out at once, about."""


@dataclass(slots=True)
class Path:
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

    def add_to_track(self) -> None:
        """Add the piece to the way and the greatest speed of the track, whose place is the end of the piece from now on."""
        track, place = self.track, self.path[:, :2]
        hidden = self.codes & PARTS_MASK == 0
        steps = np.diff(place, axis=0, prepend=place[:1] if track.path_stop < 0 else [[track.x, track.y]])
        track.distance += float(np.hypot(steps[:, 0], steps[:, 1])[hidden | (self.moving == 1)].sum())
        speed = np.hypot(self.path[:, 2], self.path[:, 3])[~hidden]
        track.speed_max = max(track.speed_max, float(speed.max(initial=0.0)))
        track.x, track.y = float(place[-1, 0]), float(place[-1, 1])
        track.path_stop = self.begin + len(self.codes)


class Sweeps:
    """Index, stamp and time of all sweeps of a topic so far, by number."""

    def __init__(self) -> None:
        self.count = 0
        self._index = np.empty(0, np.int64)
        self._stamp = np.empty(0, np.int64)
        self._seconds = np.empty(0)
        self._posed = np.empty(0, np.uint8)

    def add(self, index: Int64, stamp_ns: Int64, seconds: Float64, posed: bool) -> None:
        """Add the next sweeps; `posed`: True where places are those of the world."""
        stop = self.count + len(index)
        if stop > len(self._index):
            room = max(len(self._index) * 5 // 4, stop)
            for name in ("_index", "_stamp", "_seconds", "_posed"):
                old = getattr(self, name)
                more = np.empty(room, old.dtype)
                more[: self.count] = old[: self.count]
                setattr(self, name, more)
        at = slice(self.count, stop)
        self._index[at], self._stamp[at], self._seconds[at], self._posed[at] = index, stamp_ns, seconds, posed
        self.count = stop

    def rows(self, track: Int64, sweeps: Int64, path: Float64, codes: UInt8) -> Trajectories:
        """Return rows for (N,) tracks in sweeps by number, with (N, 9) of the path and (N,) bytes as of `PARTS_MASK`."""
        parts = (codes & PARTS_MASK).astype(np.int32)
        sd = np.sqrt(path[:, [4, 6, 7, 8]])
        return Trajectories(
            track=track,
            sweep=self._index[sweeps],
            stamp_ns=self._stamp[sweeps],
            seconds=self._seconds[sweeps],
            frame=self._posed[sweeps],
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
    """Yield the rows of what stands and was not told yet: one place each, by all that was seen of it."""
    pending: list[Path] = []
    rows = 0
    for track in tracks:
        if not track.static_codes:
            continue
        codes = np.concatenate(track.static_codes)
        track.static_codes.clear()
        for first in range(0, len(codes), MOST_ROWS):
            some = codes[first : first + MOST_ROWS]
            begin, rest = track.path_stop - len(codes) + first, np.zeros(len(some), np.uint8)
            pending.append(Path(track, begin, _static_path(track, len(some)), some, rest))
            rows += len(some)
            if rows >= MOST_ROWS:
                yield joined(sweeps, pending)
                pending, rows = [], 0
    if pending:
        yield joined(sweeps, pending)


def joined(sweeps: Sweeps, pieces: list[Path]) -> Trajectories:
    """Return the rows of pieces of paths, one after the other."""
    lengths = [len(piece.codes) for piece in pieces]
    return sweeps.rows(
        np.repeat([piece.track.number for piece in pieces], lengths).astype(np.int64),
        np.concatenate([np.arange(piece.begin, piece.begin + len(piece.codes)) for piece in pieces]),
        np.concatenate([piece.path for piece in pieces]),
        np.concatenate([piece.codes for piece in pieces]),
    )


def _static_path(track: Track, count: int) -> Float64:
    """Return (count, 9) the path of what stands: one place, and no velocity."""
    x, y, xx, xy, yy = place_of(track)
    return np.tile([x, y, 0.0, 0.0, xx, xy, yy, 0.0, 0.0], (count, 1))
