"""Trajectories: where each track was in every sweep from its first sight to its last, seen or not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lidarcli.columns import column
from lidarcli.formalism.tracking.tracks import Track, place_of
from lidarcli.sweeps import Float64, Int32, Int64, UInt8, record

VIEWS = ("seen", "partly", "hidden")
"""How much of a track a sweep shows: all of it, a part of it (of a person one leg), or nothing."""
SEEN, PARTLY, HIDDEN = range(3)
FRAMES = ("sensor", "world")
"""Frames of places: of a sensor that stands, and the fixed frame of the poses."""
PARTS_MASK, PARTLY_BIT = 63, 64
"""A byte for a sweep of a track: the number of its parts that are seen, and whether more of it is hidden."""
MOST_ROWS = 65_536
"""Rows that are handed out at once, about."""


@record
class Trajectories:
    """N rows, those of one track in the order of time."""

    track: Int64 = column("1", "number of the thing, as in the tracks table", per="trajectory")
    sweep: Int64
    """(N,) index of the sweep in the log."""
    stamp_ns: Int64
    seconds: Float64
    """(N,) stamp of the sweep [ns], and seconds since the first sweep of the topic."""
    frame: UInt8 = column("", "frame of x and y: world where poses are known, else sensor", per="trajectory", words=FRAMES)
    x: Float64 = column("m", "middle of the thing by all sweeps that saw it, before and after", per="trajectory")
    y: Float64 = column("m", "middle of the thing", per="trajectory")
    vx: Float64 = column("m/s", "velocity over ground; 0 while it stands", per="trajectory")
    vy: Float64 = column("m/s", "velocity over ground", per="trajectory")
    x_sd: Float64 = column("m", "standard deviation of x", per="trajectory")
    y_sd: Float64 = column("m", "standard deviation of y", per="trajectory")
    xy_cov: Float64 = column("m²", "covariance of x and y", per="trajectory")
    vx_sd: Float64 = column("m/s", "standard deviation of vx", per="trajectory")
    vy_sd: Float64 = column("m/s", "standard deviation of vy", per="trajectory")
    seen: UInt8 = column(
        "", "seen, partly (of a person one leg) or hidden in this sweep", per="trajectory", words=VIEWS
    )
    parts: Int32 = column("1", "objects of this sweep that are parts of it; 0 while hidden", per="trajectory")

    def __len__(self) -> int:
        return len(self.track)


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
            room = max(2 * len(self._index), stop)
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
        if not track.stood:
            continue
        codes = np.concatenate(track.stood)
        track.stood.clear()
        pending.append(Path(track, track.told - len(codes), _at_rest(track, len(codes)), codes))
        rows += len(codes)
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


def _at_rest(track: Track, count: int) -> Float64:
    """Return (count, 9) the path of what stands: one place, and no velocity."""
    x, y, xx, xy, yy = place_of(track)
    return np.tile([x, y, 0.0, 0.0, xx, xy, yy, 0.0, 0.0], (count, 1))
