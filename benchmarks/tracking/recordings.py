"""Simulated logs in memory with what is true of every sweep."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.tracking.cells import SLOW, Cell, scene_of
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.simulation.generate import simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.scene import Odometry, Scene
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Bool, Float64, Int64, SweepBatch, SweepPoses, record

BATCH = 256
"""Sweeps of a batch."""
RIGID = ("box", "cylinder", "plant")
YAW_DRIFT = 0.5
"""[rad/m] Drift of the heading for each metre of drift of the position."""


@record
class Recording:
    """A log of S sweeps of B beams, and the truth of its E entities. Velocities in the frame that tracking speaks of."""

    name: str
    batch: SweepBatch
    entity: Int64
    """(S, B) entity that each beam hit, -1 for none or without a range."""
    wall: Bool
    """(E,)"""
    rigid: Bool
    """(E,) neither a wall nor on legs."""
    kinds: tuple[str, ...]
    size: Float64
    """(E, 2) length and width [m]."""
    place: Float64
    """(S, E, 2) middles of the bodies [m]; where poses drift, as if they did not."""
    velocity: Float64
    """(S, E, 2) of the bodies over ground [m/s]."""
    begun: Bool
    """(S, E) whether it goes or turns in this sweep or has done so before."""
    fast: Bool
    """(S, E) whether it moves with at least `cells.SLOW` in this sweep or did so before."""


@record
class Detected:
    """What was found in a recording, by batch."""

    batches: list[SweepBatch]
    detections: list[Detection]
    row: Int64
    """(K,) sweep of each object of all batches."""
    labels: Int64
    """(S, B) object of each beam, index into all K; -1 for none."""
    entity: Int64
    """(K,) entity that most of its beams hit, -1 for none."""
    seconds: float
    """Time that the detection took."""


def in_batches(batch: SweepBatch) -> list[SweepBatch]:
    """The same sweeps as a reader hands them out."""
    return [batch.rows(np.arange(first, min(first + BATCH, len(batch)))) for first in range(0, len(batch), BATCH)]


def record_cell(cell: Cell, seed: int) -> Recording:
    """Simulate the log of a cell."""
    return simulate(scene_of(cell, seed), seed, poses=cell.driving, delay=cell.delay, drift=cell.drift)


def simulate(scene: Scene, seed: int, *, poses: bool = True, delay: float = 0.0, drift: float = 0.0) -> Recording:
    """A recording of a scene; poses may be `delay` late [s] and drift by a share of the way driven."""
    raw, hit, entities = simulate_sweep_arrays(scene, scene.sweeps, seed)
    batch = normalise(raw, np.arange(len(raw)), RangeRules())
    seconds = np.arange(len(raw)) / scene.sensor.rate
    true = scene.path.poses(seconds)
    place = np.stack([entity.poses(seconds)[:, :2] for entity in entities], axis=1)
    turn = -true[:, 2]
    if not poses:
        place = _turned(place - true[:, None, :2], turn)
    else:
        # A pose of the past is told as that of now.
        late = _believed(scene, seed, drift, delay)
        batch = replace(batch, poses=SweepPoses(late[:, 0], late[:, 1], late[:, 2], np.zeros(len(raw), np.bool_)))
        turn = _believed(scene, seed, drift, 0.0)[:, 2] - true[:, 2]
    # Vx, vy and the rate of the yaw.
    velocity = np.stack([entity.velocities(seconds) for entity in entities], axis=1)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    return Recording(
        name=scene.name,
        batch=batch,
        entity=hit.astype(np.int64),
        wall=np.array([entity.wall for entity in entities]),
        rigid=np.array([entity.kind in RIGID for entity in entities]),
        kinds=tuple(entity.kind for entity in entities),
        size=np.array([[entity.length, entity.width] for entity in entities]),
        place=place,
        velocity=_turned(velocity[..., :2], turn),
        begun=np.logical_or.accumulate(velocity.any(axis=2), axis=0),
        fast=np.logical_or.accumulate(speed >= SLOW, axis=0),
    )


def detected(batches: Sequence[SweepBatch], parameters: Parameters, truth: Int64 | None = None) -> Detected:
    """The objects of a log; `truth` (S, B) is the entity of each beam."""
    detections = []
    rows, labels, before, first, seconds = [], [], 0, 0, 0.0
    for batch in batches:
        begin = time.process_time()
        found = detect(batch, parameters, per_beam=True)
        seconds += time.process_time() - begin
        assert found.beam_object is not None
        number = np.full((len(batch), int(found.object.max(initial=0)) + 1), -1)
        number[found.row, found.object] = np.arange(len(found)) + before
        labels.append(np.take_along_axis(number, found.beam_object.astype(np.int64), axis=1))
        rows.append(found.row + first)
        detections.append(found)
        before, first = before + len(found), first + len(batch)
    label = np.concatenate(labels)
    entity = np.full(before, -1) if truth is None else majority(label, truth, before)
    return Detected(list(batches), detections, np.concatenate(rows), label, entity, seconds)


def majority(labels: Int64, entity: Int64, count: int) -> Int64:
    """(K,) the entity that most beams of each object hit, -1 for none: of equals the first."""
    most = int(entity.max(initial=0)) + 2
    known = labels >= 0
    pairs, hits = np.unique(labels[known] * most + entity[known] + 1, return_counts=True)
    which, hit = np.divmod(pairs, most)
    order = np.lexsort((-hit, hits, which))
    result = np.full(count, -1)
    result[which[order]] = hit[order] - 1
    return result


def _believed(scene: Scene, seed: int, drift: float, delay: float) -> Float64:
    """(S, 3) poses that the robot tells of its sensor for each sweep."""
    odometry = Odometry(noise=drift, yaw_noise=YAW_DRIFT * drift)
    told = simulate_odometry(replace(scene, odometry=odometry), scene.sweeps, seed)
    assert told is not None
    seconds = np.arange(scene.sweeps) / scene.sensor.rate
    return np.column_stack([np.interp(seconds - delay, seconds, column) for column in told.poses.T])


def _turned(vectors: Float64, angle: Float64) -> Float64:
    """(S, E, 2) vectors turned by an angle for each S."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
