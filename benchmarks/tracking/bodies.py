"""What the tables say of the bodies themselves: their shapes and sizes, and where they were."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.tracking.methods import Result
from benchmarks.tracking.recordings import Detected, Recording
from lidarcli.formalism.detection import AGENT, SHAPES
from lidarcli.formalism.tracking.results import HIDDEN, Tracks, Trajectories
from lidarcli.sweeps.types import Float64, Int64

EXPECTED = {"box": "prismatic", "cylinder": "round", "plant": "irregular", "person": "legged"}
"""Kind of entity → shape of its track."""
SIGHTINGS = 20
"""Tracks seen in fewer sweeps are not asked."""
MIN_WAY = 0.5
"""[m]"""
_NOTHING = np.empty(0)


@dataclass(frozen=True, eq=False, slots=True)
class Bodies:
    """The tracks of one log that are of one entity each."""

    shapes: dict[tuple[str, str], int] = field(default_factory=dict)
    """(kind, shape) → tracks."""
    length_errors: Float64 = field(default_factory=_NOTHING.copy)
    """Of boxes and cylinders [m], the longer side."""
    width_errors: Float64 = field(default_factory=_NOTHING.copy)
    deviations: Float64 = field(default_factory=_NOTHING.copy)
    """Errors of both sides as multiples of the standard deviations that the table states."""
    paths: Paths | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Paths:
    """Trajectories of agents, in the N sweeps that show nothing of any other entity."""

    place_errors: Float64
    """(N,) [m]"""
    deviations: Float64
    """(N,) the same as multiples of the standard deviations that the table states."""
    speed_errors: Float64
    """(N,) [m/s]"""
    ratios: Float64
    """Length of each path over that of the true one, where that is at least `MIN_WAY`."""


def paths(recording: Recording, found: Detected, track: Int64, tracks: Tracks, rows: Trajectories) -> Paths:
    """Compare the trajectories of agents with the way of the entity that most of their objects are of."""
    places, deviations, speeds, ratios = [_NOTHING], [_NOTHING], [_NOTHING], []
    for number in tracks.track[tracks.set == AGENT].tolist():
        mine = np.flatnonzero(track == number)
        entity = int(np.bincount(found.entity[mine] + 1).argmax()) - 1
        mixed = np.unique(found.row[mine[found.entity[mine] != entity]])
        at = np.flatnonzero((rows.track == number) & (rows.seen != HIDDEN) & ~np.isin(rows.sweep, mixed))
        if entity < 0 or not recording.begun[-1, entity] or len(at) < SIGHTINGS:
            continue
        sweep = rows.sweep[at]
        path, true = np.column_stack([rows.x[at], rows.y[at]]), recording.place[sweep, entity]
        velocity = np.column_stack([rows.vx[at], rows.vy[at]])
        off = np.hypot(*(path - true).T)
        places.append(off)
        deviations.append(off / np.hypot(rows.x_sd[at], rows.y_sd[at]))
        speeds.append(np.hypot(*(velocity - recording.velocity[sweep, entity]).T))
        ways = [float(np.hypot(*np.diff(one, axis=0).T).sum()) for one in (path, true)]
        if ways[1] >= MIN_WAY:
            ratios.append(ways[0] / ways[1])
    return Paths(np.concatenate(places), np.concatenate(deviations), np.concatenate(speeds), np.array(ratios))


def bodies(recording: Recording, found: Detected, result: Result) -> Bodies:
    """Compare the tables with the entities that most of the objects of each track are of."""
    tracks, track = result.tracks, result.track
    assert tracks is not None
    shapes: dict[tuple[str, str], int] = {}
    lengths, widths, deviations = [], [], []
    for row, number in enumerate(tracks.track.tolist()):
        of = found.entity[(track == number) & (found.entity >= 0)]
        if len(of) < SIGHTINGS:
            continue
        entity = int(np.bincount(of).argmax())
        kind = recording.kinds[entity]
        if kind not in EXPECTED:
            continue
        key = kind, SHAPES[tracks.shape[row]]
        shapes[key] = shapes.get(key, 0) + 1
        if kind in ("box", "cylinder") and np.isfinite(tracks.length[row] + tracks.width[row]):
            true = np.sort(recording.size[entity])[::-1]
            off = np.array([tracks.length[row], tracks.width[row]]) - true
            lengths.append(off[0])
            widths.append(off[1])
            deviations += (off / np.array([tracks.length_sd[row], tracks.width_sd[row]])).tolist()
    rows = result.trajectories
    known = None if rows is None else paths(recording, found, track, tracks, rows)
    return Bodies(shapes, np.array(lengths), np.array(widths), np.array(deviations), known)
