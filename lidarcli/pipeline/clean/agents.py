"""Where agents are, from when on they move, and which beams are on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.inputs.tracked import Columns, TrackPaths, columns_of, paths_of, to_sensor, tracks_of
from lidarcli.pose.findings import Key
from lidarcli.sweeps.types import Bool, Closure, Float64, Int64, Status, SweepBatch

REACH, REACH_AROUND = 0.45, 0.1
"""A piece belongs to an agent if it ends so near to its middle [m], or so near to its box if that is larger."""
LINK = 0.1
"""Greatest step in range between beams of one piece [m], in addition to what its slant takes."""
MAX_SD = 0.3
"""Greatest standard deviation of a place of an agent by which its beams are found [m]."""
MIN_SPEED, MOVING_SDS = 0.1, 2.0
"""Least speed of what moves [m/s], and least distance in standard deviations."""
PAIRS = 256
"""Places of agents that are looked at together."""


class _Places(NamedTuple):
    """Places (P) of agents in sweeps of a batch, in the frame of the sensor."""

    row: Int64
    x: Float64
    y: Float64
    radius: Float64

    def pieces(self, batch: SweepBatch) -> Bool:
        """Return the beams (S, B) on pieces that end within the reach of an agent as a whole.

        A leg far away has too few beams for an object; of a wall only a part is within reach.
        """
        found = np.zeros(batch.ranges.shape, np.bool_)
        valid, width = batch.status == Status.VALID, batch.width
        ranges = np.where(valid, batch.ranges, np.float32(np.nan)).astype(np.float64)
        # Most sweeps have the same bearings.
        geometry = np.stack([batch.angle_min, batch.angle_increment])
        _, one, at = np.unique(geometry, axis=1, return_index=True, return_inverse=True)
        bearing = batch.rows(one).bearings
        x, y = ranges * np.cos(bearing)[at.ravel()], ranges * np.sin(bearing)[at.ravel()]
        slant = 2.0 * np.abs(batch.angle_increment)[:, None] * ranges
        with np.errstate(invalid="ignore"):
            joined = np.abs(ranges - np.roll(ranges, 1, axis=1)) <= LINK + slant
        begins = ~joined
        begins[:, 0] = True
        piece = np.cumsum(begins, axis=1) - 1
        # Of a full turn the last piece may go on in the first.
        seam = joined[:, 0] & (batch.closure != Closure.OPEN)
        piece[(piece == piece[:, -1:]) & seam[:, None]] = 0
        beams = np.bincount((piece + np.arange(len(batch))[:, None] * width).ravel(), valid.ravel(), piece.size)
        for first in range(0, len(self.row), PAIRS):
            part = slice(first, first + PAIRS)
            with np.errstate(invalid="ignore"):
                pair, beam = np.nonzero(np.abs(x[self.row[part]] - self.x[part, None]) <= self.radius[part, None])
            near, row = pair + first, self.row[part][pair]
            inside = np.hypot(x[row, beam] - self.x[near], y[row, beam] - self.y[near]) <= self.radius[near]
            pair, row, beam = pair[inside], row[inside], beam[inside]
            within = np.bincount(pair * width + piece[row, beam])
            whole = within[pair * width + piece[row, beam]] >= beams[row * width + piece[row, beam]]
            found[row[whole], beam[whole]] = True
        return found


@dataclass(frozen=True, slots=True)
class Agents:
    """Places (N) of the agents of a sensor by sweep, from when on they move."""

    sweep: Int64
    """(N,) ascending."""
    x: Float64
    y: Float64
    radius: Float64
    in_world: Bool
    track: Int64
    """(T,) their tracks, and those of parts of them, ascending; and the sweeps (T,) from which on they are left out."""
    since: Int64
    sweeps: Int64
    """(S,) sweeps of the sensor, and its pose (S, 4) in each, as of `to_sensor`."""
    pose: Float64

    def of(self, batch: SweepBatch) -> _Places:
        """Return the places of agents in some sweeps."""
        own = slice(*np.searchsorted(self.sweep, [batch.sweep[0], batch.sweep[-1] + 1]))
        sweep, x, y, in_world = self.sweep[own], self.x[own], self.y[own], self.in_world[own]
        at = np.minimum(np.searchsorted(self.sweeps, sweep), len(self.sweeps) - 1)
        in_sensor = to_sensor(self.pose[at], x, y)
        x, y = (np.where(in_world, moved, known) for moved, known in zip(in_sensor, (x, y), strict=True))
        row = np.minimum(np.searchsorted(batch.sweep, sweep), len(batch) - 1)
        known = np.isfinite(x) & np.isfinite(y) & (batch.sweep[row] == sweep)
        return _Places(row[known], x[known], y[known], self.radius[own][known])


class _Track(NamedTuple):
    """A track of one sensor."""

    number: int
    moves: bool
    moved_at_ns: int
    half: float
    """Half of its diagonal [m], 0 where it is not known."""

    @property
    def reach(self) -> float:
        """Distance from its middle in which pieces belong to it [m]."""
        return max(REACH, self.half + REACH_AROUND)


def agents_in(tables: TableSet) -> dict[Key, Agents]:
    """Return where agents are, by topic and frame, hidden or not."""
    sweeps = columns_of(tables, "sweeps", ("topic", "frame_id"))
    found = {}
    for topic, frame in sorted({*zip(*(names.tolist() for names in sweeps.values()), strict=True)}):
        tracks = [*_tracks(tables, topic, frame)]
        paths = paths_of(tables, topic, ("stamp", "x_sd", "y_sd"))
        if len(paths.track) and any(each.moves for each in tracks):
            found[topic, frame] = _agents_of(tracks, paths, *_sensor(tables, topic, frame))
    return found


def _tracks(tables: TableSet, topic: str, frame: str) -> Iterator[_Track]:
    """Yield the tracks of a sensor, by number."""
    for row in tracks_of(tables, topic, frame, ("set", "moved_at", "length", "width")):
        half = 0.5 * float(np.hypot(row["length"] or 0.0, row["width"] or 0.0))
        yield _Track(row["track"], row["set"] == "A", row["moved_at"] or 0, half)


def _agents_of(tracks: list[_Track], paths: TrackPaths, sweeps: Int64, pose: Float64) -> Agents:
    """Return the agents of a sensor; `sweeps` and `pose` as of `_sensor`."""
    stamp_ns, sd = paths.more["stamp"], np.maximum(paths.more["x_sd"], paths.more["y_sd"])
    since: dict[int, int] = {}
    pieces = []
    for track in tracks:
        own = paths.of(track.number)
        count = own.stop - own.start
        if not track.moves or not count:
            continue
        onset = own.start + min(int(np.searchsorted(stamp_ns[own], track.moved_at_ns)), count - 1)
        rows = slice(own.start, onset)
        first = own.start + _sets_out(paths.x[rows], paths.y[rows], sd[rows] ** 2, stamp_ns[rows])
        since[track.number] = int(paths.sweep[first])
        sure = first + np.flatnonzero(sd[first : own.stop] <= MAX_SD)
        if len(sure):
            pieces.append((sure, track.reach, since[track.number]))
    begun = np.array([begin for _, _, begin in pieces], np.int64)
    last = _Reach(np.array([rows[-1] for rows, _, _ in pieces], np.int64), np.array([reach for _, reach, _ in pieces]))
    at = np.concatenate([np.zeros(0, np.int64), *(rows for rows, _, _ in pieces)])
    reach = np.repeat(last.radius, [len(rows) for rows, _, _ in pieces])
    order = np.argsort(paths.sweep[at], kind="stable")
    at, reach = at[order], reach[order]
    for track in tracks:
        if not track.moves and _came_along(track, paths, _Reach(at, reach), last, begun):
            since[track.number] = 0
    numbers, left_out = np.array(sorted(since.items()), np.int64).reshape(-1, 2).T
    places = paths.sweep[at], paths.x[at], paths.y[at], reach, paths.in_world[at]
    return Agents(*places, numbers, left_out, sweeps, pose)


def _sets_out(x: Float64, y: Float64, var: Float64, stamp_ns: Int64) -> int:
    """Return the row from which on an agent went further within a second than noise explains; rows end at its onset.

    Parameters
    ----------
    var : (N,) variance of its places [m²]
    """
    if not len(x):
        return 0
    # Of a clock that steps back none is later.
    before = np.minimum(np.searchsorted(stamp_ns, stamp_ns - SECOND_NS), np.arange(len(x)))
    distance = np.hypot(x - x[before], y - y[before])
    least = MIN_SPEED * 1e-9 * (stamp_ns - stamp_ns[before])
    resting = np.flatnonzero(~(distance > np.maximum(least, MOVING_SDS * np.sqrt(var + var[before]))))[-1]
    # What moves so soon after it was first observed moved before.
    return 0 if before[resting] == 0 else int(resting)


class _Reach(NamedTuple):
    """Rows (N) of the paths of agents, ascending by sweep, and how far pieces of them are from there."""

    row: Int64
    radius: Float64
    """[m]"""


def _came_along(track: _Track, paths: TrackPaths, agents: _Reach, ends: _Reach, since: Int64) -> bool:
    """Return whether an object is part of an agent, or one that stopped there.

    What is static is also observed while no agent is within reach. Of an agent that stops a new track may begin.

    Parameters
    ----------
    ends, since : (A,) last row of each agent, and the sweep from which on it moved
    """
    own = paths.of(track.number)
    rows = np.arange(own.start, own.stop)[~paths.hidden[own]]
    # Most objects are observed without agents at first.
    if not len(rows):
        return False
    first, stamp_ns = rows[0], paths.more["stamp"]
    over = np.hypot(paths.x[ends.row] - paths.x[first], paths.y[ends.row] - paths.y[first]) + track.half
    left = (over <= ends.radius) & (since < paths.sweep[first])
    left &= stamp_ns[ends.row] >= stamp_ns[first] - SECOND_NS
    if not left.any() and not _with_agents(rows[:1], track.half, paths, agents).all():
        return False
    inside = _with_agents(rows, track.half, paths, agents)
    last = paths.sweep[ends.row[left]]
    return bool(inside.all()) or any(inside[paths.sweep[rows] <= end].all() for end in last.tolist())


def _with_agents(rows: Int64, half: float, paths: TrackPaths, agents: _Reach) -> Bool:
    """Return (K,) True in which rows of its path an object lies within the reach of an agent as a whole.

    Parameters
    ----------
    half : half of the diagonal of the object [m]
    """
    sweep = paths.sweep[agents.row]
    first, after = (np.searchsorted(sweep, paths.sweep[rows], side) for side in ("left", "right"))
    count = after - first
    which = np.repeat(np.arange(len(rows)), count)
    agent = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + first[which]
    other, own = agents.row[agent], rows[which]
    over = np.hypot(paths.x[other] - paths.x[own], paths.y[other] - paths.y[own]) + half
    inside: Bool = np.bincount(which, over <= agents.radius[agent], len(rows)) > 0
    return inside


def _sensor(tables: TableSet, topic: str, frame: str) -> tuple[Int64, Float64]:
    """Return the sweeps (S,) of a sensor, and its pose (S, 4) in each, as of `to_sensor`."""
    sweeps = _of_sensor(tables, "sweeps", topic, frame, ("sweep", "pose_x", "pose_y", "pose_yaw"))
    objects = _of_sensor(tables, "objects", topic, frame, ("sweep", "box_x", "box_y", "world_x", "world_y"))
    sweep, *pose = sweeps.values()
    placed = np.column_stack([*pose, np.zeros(len(sweep))])
    if count := len(objects["sweep"]):
        at = np.minimum(np.searchsorted(sweep, objects["sweep"]), max(len(sweep) - 1, 0))
        _, left = to_sensor(placed[at], objects["world_x"], objects["world_y"])
        y = objects["box_y"]
        # The mirror image of most of its objects fits better: the sensor hangs head down.
        with np.errstate(invalid="ignore"):
            placed[:, 3] = 2 * int(np.count_nonzero(np.abs(left + y) < np.abs(left - y))) > count
    return sweep, placed


def _of_sensor(tables: TableSet, kind: str, topic: str, frame: str, names: Sequence[str]) -> Columns:
    """Return columns of a table, those of one sensor alone."""
    columns = columns_of(tables, kind, ("topic", "frame_id", *names))
    own = (columns["topic"] == topic) & (columns["frame_id"] == frame)
    return {name: columns[name][own] for name in names}
