"""Logs for the tests of tracking, and what the tracker says of them, in one piece."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.scenes.moving import Kind, moving_scene
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detection import AGENT, Detection
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import PARKED, Course, Entity, Scene, SceneSensor
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, SweepBatch, SweepPoses

SENSOR = SceneSensor(beams=720, angle_increment=TURN / 720, noise=0.01)
"""A full turn, each bearing once."""
ROOM = make.wall([[-5.0, -4.0], [5.0, -4.0], [5.0, 4.0], [-5.0, 4.0], [-5.0, -4.0]])
PER_OBJECT = ("track", "vx", "vy", "moving", "agent_score", "set", "label", "label_score")
PER_SWEEP = ("objects", "agents", "object_beams", "agent_beams")


@dataclass(frozen=True)
class TrackedLog:
    """What the tracker says of a whole log of S sweeps and K objects."""

    row: Any
    """(K,) sweep of each object."""
    columns: dict[str, Any]
    """Those of `TrackedBatch`, of all batches."""
    tracks: Tracks
    tracker: Tracker
    detection: Any
    """(K,) x, y of each object in the sensor frame, by name."""

    def of(self, number: int) -> Any:
        """(K,) rows of a track."""
        return self.columns["track"] == number

    def near(self, x: float, y: float, within: float = 0.4) -> list[int]:
        """Numbers of the tracks that were seen near a place of the sensor frame, most often seen first."""
        near = np.hypot(self.detection["x"] - x, self.detection["y"] - y) < within
        numbers, counts = np.unique(self.columns["track"][near], return_counts=True)
        order = np.lexsort((numbers, -counts))
        return [int(n) for n in numbers[order] if n > 0]

    @property
    def agents(self) -> Any:
        """Numbers of the tracks that ever moved."""
        return self.tracks.track[self.tracks.moved]


def parts(batch: SweepBatch, cuts: Iterable[int]) -> list[SweepBatch]:
    """The batch, cut before these rows."""
    bounds = [0, *cuts, len(batch)]
    return [batch.rows(np.arange(first, stop)) for first, stop in pairwise(bounds)]


def batches(batch: SweepBatch, size: int) -> list[SweepBatch]:
    """The batch in pieces of so many sweeps."""
    return parts(batch, range(size, len(batch), size))


def follow(
    log: SweepBatch | Sequence[SweepBatch], parameters: Parameters | None = None, track: TrackParameters | None = None
) -> TrackedLog:
    """Detect and follow what is in the batches of a log; each answer comes in its turn and fits its batch."""
    pieces = [log] if isinstance(log, SweepBatch) else list(log)
    tracker = Tracker(track)
    found: list[Detection] = []
    followed: list[TrackedBatch] = []
    for piece in pieces:
        found.append(detect(piece, parameters or Parameters()))
        followed += tracker.add(piece, found[-1])
    rest, tracks = tracker.finish()
    followed += rest
    assert len(followed) == len(pieces)
    for piece, detection, one in zip(pieces, found, followed, strict=True):
        assert all(len(getattr(one, name)) == len(detection) for name in PER_OBJECT)
        assert all(len(getattr(one, name)) == len(piece) for name in PER_SWEEP)
    first = np.cumsum([0, *map(len, pieces)])
    return TrackedLog(
        np.concatenate([detection.row + begin for detection, begin in zip(found, first[:-1], strict=True)]),
        {name: np.concatenate([getattr(one, name) for one in followed]) for name in PER_OBJECT + PER_SWEEP},
        tracks,
        tracker,
        {name: np.concatenate([getattr(detection, name) for detection in found]) for name in ("x", "y", "beams")},
    )


def assert_same(one: TrackedLog, other: TrackedLog) -> None:
    """Every bit of what is told of two logs is the same."""
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, other.columns[name], err_msg=name, strict=True)
    for field in fields(one.tracks):
        values = getattr(one.tracks, field.name)
        np.testing.assert_array_equal(values, getattr(other.tracks, field.name), err_msg=field.name)


def assert_sums(told: TrackedLog, found: Detection) -> None:
    """Definition 4 sums as before: U = A ∪ S ∪ O, in objects and in beams."""
    np.testing.assert_array_equal(told.columns["objects"] + told.columns["agents"], found.objects)
    np.testing.assert_array_equal(told.columns["object_beams"] + told.columns["agent_beams"], found.object_beams)
    agent = told.columns["set"] == AGENT
    sweeps = len(found.objects)
    np.testing.assert_array_equal(np.bincount(found.row[agent], minlength=sweeps), told.columns["agents"])
    np.testing.assert_array_equal(
        np.bincount(found.row[agent], found.beams[agent], minlength=sweeps), told.columns["agent_beams"]
    )
    known = told.columns["track"] > 0
    # Without a track nothing is known, with one everything is.
    np.testing.assert_array_equal(np.isnan(told.columns["vx"]), ~known)
    np.testing.assert_array_equal(told.columns["moving"] == -1, ~known)
    assert not agent[~known].any()
    # Tracks count from 1 by first sight, and each has a row.
    numbers, first = np.unique(told.columns["track"], return_index=True)
    assert numbers[numbers > 0].tolist() == told.tracks.track.tolist()
    assert (np.diff(first[numbers > 0]) > 0).all()


def simulated(
    scene: Scene, sweeps: int | None = None, seed: int = 0, *, poses: bool | None = None, delay: float = 0.0
) -> SweepBatch:
    """The sweeps of a scene; with poses where the sensor drives, which may be told `delay` seconds late."""
    count = sweeps or scene.sweeps
    raw, _, _ = simulate_sweep_arrays(scene, count, seed)
    batch = normalise(raw, np.arange(count), RangeRules())
    if poses if poses is not None else not scene.path.parked:
        told = scene.path.poses(np.arange(count) / scene.sensor.rate - delay)
        batch = replace(batch, poses=SweepPoses(told[:, 0], told[:, 1], np.unwrap(told[:, 2]), np.zeros(count, np.bool_)))
    return batch


def scene_of(*entities: Entity, path: Course = PARKED, sensor: SceneSensor = SENSOR) -> Scene:
    """A room with these things in it."""
    return Scene("room", sensor, (ROOM, *entities), path)


@cache
def moving_log(kind: Kind, seed: int, *, driving: bool = False, legged: bool = True) -> SweepBatch:
    """A random scene in which things move, 300 to 400 sweeps."""
    sensor = replace(SENSOR, beams=361, angle_increment=TURN / 360)
    return simulated(moving_scene(kind, seed, sensor, driving=driving, legged=legged), seed=seed)


def repeated(batch: SweepBatch, times: int) -> SweepBatch:
    """A log that goes on with the same sweeps again, a sweep later."""
    rows = np.tile(np.arange(len(batch)), times)
    longer = batch.rows(rows)
    step = int(batch.stamp_ns[1] - batch.stamp_ns[0])
    stamps = batch.stamp_ns[0] + step * np.arange(len(rows))
    return replace(longer, stamp_ns=stamps, record_ns=stamps, sweep=np.arange(len(rows)))
