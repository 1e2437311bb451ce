"""The tracks of a run as a picture of one sweep shows them: where each has come from, and where it goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.reports.columns import Rows
from lidarcli.reports.ground import ground_of
from lidarcli.sweeps import Bool, Float64

COLUMNS = {
    "objects": (
        *("topic", "sweep", "set", "track", "vx", "vy", "moving", "label"),
        *("box_x", "box_y", "world_x", "world_y"),
    ),
    "sweeps": ("topic", "sweep", "pose_x", "pose_y", "pose_yaw"),
}
"""Table → columns that paths are made of."""


@dataclass(frozen=True, slots=True)
class TrackPath:
    """One track up to a sweep, in the sensor frame of that sweep."""

    number: int
    is_agent: bool
    label: str
    seen: bool
    """Whether it is seen in this sweep; else it is hidden and seen again later."""
    x: Float64
    """(N,) where it was [m], the last one now."""
    y: Float64
    velocity: tuple[float, float]
    """[m/s] over ground; zero while it stands or is hidden."""


class Paths:
    """The tracks of one topic: rows of an objects and a sweeps table with `COLUMNS`."""

    def __init__(self, sweeps: Rows, objects: Rows, topic: str) -> None:
        rows = np.flatnonzero(sweeps.are("topic", topic))
        index = sweeps.integers("sweep")[rows]
        order = np.argsort(index, kind="stable")
        rows, self._sweeps = rows[order], index[order]
        track = objects.numbers("track")
        mine = (
            objects.are("topic", topic) & ~np.isnan(track) & np.isin(objects.integers("sweep"), self._sweeps)
        )
        members = np.flatnonzero(mine)
        self._at = np.searchsorted(self._sweeps, objects.integers("sweep")[members])
        order = np.argsort(self._at, kind="stable")
        members, self._at = members[order], self._at[order]
        self._track = track[members].astype(np.int64)
        self._agent = objects.are("set", "A")[members]
        moves = objects.numbers("moving")[members] == 1
        self._vx, self._vy = (np.where(moves, objects.numbers(name)[members], 0.0) for name in ("vx", "vy"))
        codes, names = objects.words("label")
        self._labels = ["" if code < 0 else names[code] for code in codes[members].tolist()]
        self._ground = ground_of(sweeps, rows, objects, members, self._at)

    @property
    def are_there(self) -> bool:
        """Whether any object of the topic has a track."""
        return len(self._track) > 0

    def has(self, sweep: int) -> bool:
        """Whether the tables hold this sweep."""
        return sweep in self._sweeps

    def up_to(self, sweep: int) -> tuple[TrackPath, ...]:
        """The tracks that go on in this sweep, by number; none where its pose is not known."""
        now = int(np.searchsorted(self._sweeps, sweep))
        ground = self._ground
        x, y = ground.to_sensor(now, ground.x, ground.y)
        past = (self._at <= now) & np.isfinite(x) & np.isfinite(y)
        alive = np.intersect1d(self._track[past], self._track[self._at >= now])
        return tuple(self._path(number, now, x, y, past) for number in alive.tolist())

    def _path(self, number: int, now: int, x: Float64, y: Float64, past: Bool) -> TrackPath:
        mine = np.flatnonzero(past & (self._track == number))
        # The parts of a thing, as two legs, are one point.
        places, part, size = np.unique(self._at[mine], return_inverse=True, return_counts=True)
        last = int(mine[-1])
        seen = bool(places[-1] == now)
        vx, vy = self._ground.turned(now, self._vx[last : last + 1], self._vy[last : last + 1])
        return TrackPath(
            number=number,
            is_agent=bool(self._agent[last]),
            label=self._labels[last],
            seen=seen,
            x=np.bincount(part, x[mine]) / size,
            y=np.bincount(part, y[mine]) / size,
            velocity=(float(vx[0]), float(vy[0])) if seen else (0.0, 0.0),
        )
