"""Real recordings: a car followed by motion capture, and legs of people marked by hand.

The recordings are public but no part of the project: the environment variable LIDARCLI_REAL_LOGS names their folder.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import lidarcli
from benchmarks.accuracy.real import CAR, CAR_LOGS, EGO, LEG_LOGS, labelled_legs, mocap, poses_at, seen_from
from benchmarks.tracking.methods import METHODS, PARAMETERS
from benchmarks.tracking.recordings import Detected, detected
from lidarcli.sweeps.types import Float64, Int64, SweepBatch, SweepPoses

MOUNT = -0.12
"""[m] The laser sits so far before the body that the motion capture follows (datmo's launch file)."""
DELAY = 0.03
"""[s] Its sweeps are taken so much later than their stamps say."""
ON_CAR, BESIDE = 0.35, 1.0
"""[m] An object this near to the car's place is the car; one further away than this is something else."""
AROUND = 0.1
"""[s] The car's velocity is the difference of its places so long before and after."""
NEAR = 0.25
"""[m] An object is of a leg when its centroid is this near."""
LEAST = 3
"""Tracks with fewer rows on the car do not count as its."""
SLOW = 0.15
"""[m/s] From this speed on the car is asked for in set A."""


@dataclass(frozen=True, slots=True)
class Car:
    """How one method follows the car of one log."""

    log: str
    method: str
    rows: int
    """Objects on the car."""
    rms: float
    """Error of its velocity [m/s]."""
    median: float
    tracks: int
    """On the car."""
    in_a: float
    """Share of its rows from `SLOW` on that are in set A."""
    others_in_a: float
    """Share of the rows of other things that are."""
    all_tracks: int


@dataclass(frozen=True, slots=True)
class Legs:
    """How one method follows labelled legs."""

    method: str
    labels: int
    matched: float
    """Share of the labels that have an object with a track near."""
    in_a: float
    """Share of these whose object is in set A."""
    tracks: int
    """On legs."""


def measure_cars(folder: Path) -> list[Car]:
    """All methods on all logs with motion capture."""
    return [car for path in sorted(folder.glob(CAR_LOGS)) for car in _cars(path)]


def _cars(path: Path) -> list[Car]:
    car, ego = mocap(path, CAR), mocap(path, EGO)
    late = round(DELAY * 1e9)
    batches, places, velocities = [], [], []
    for batch in lidarcli.read(path, pose="none"):
        taken = batch.stamp_ns + late
        sensor = poses_at(ego, taken)
        sensor[:, :2] += MOUNT * np.column_stack([np.cos(sensor[:, 2]), np.sin(sensor[:, 2])])
        poses = SweepPoses(sensor[:, 0], sensor[:, 1], sensor[:, 2], np.zeros(len(batch), np.bool_))
        batches.append(replace(batch, poses=poses))
        places.append(seen_from(sensor, poses_at(car, taken)))
        step = round(AROUND * 1e9)
        way = poses_at(car, taken + step)[:, :2] - poses_at(car, taken - step)[:, :2]
        velocities.append(way / (2 * AROUND))
    found = detected(batches, PARAMETERS)
    place, velocity = np.concatenate(places)[found.row], np.concatenate(velocities)[found.row]
    x, y = _centroids(found)
    off = np.hypot(x - place[:, 0], y - place[:, 1])
    on, other = off <= ON_CAR, off > BESIDE
    moves = on & (np.hypot(*velocity.T) >= SLOW)
    results = []
    for name, method in METHODS.items():
        told = method(found)
        error = np.hypot(*(told.velocity - velocity)[on & (told.track > 0)].T)
        error = error[np.isfinite(error)]
        results.append(
            Car(
                log=path.name,
                method=name,
                rows=int(np.count_nonzero(on)),
                rms=float(np.sqrt(np.mean(error**2))),
                median=float(np.median(error)),
                tracks=int(np.count_nonzero(np.bincount(told.track[on & (told.track > 0)]) >= LEAST)),
                in_a=float(told.agent[moves].mean()),
                others_in_a=float(told.agent[other].mean()),
                all_tracks=len(np.unique(told.track[told.track > 0])),
            )
        )
    return results


def measure_legs(folder: Path) -> list[Legs]:
    """All methods on all logs with labelled legs."""
    logs = []
    for path in sorted(folder.glob(LEG_LOGS)):
        batches: list[SweepBatch] = []
        labels: list[Float64] = []
        for batch, legs in labelled_legs(path):
            batches.append(batch)
            labels += legs
        found = detected(batches, PARAMETERS)
        logs.append((found, _nearest(found, labels)))
    results = []
    for name, method in METHODS.items():
        count = matched = in_a = tracks = 0
        for found, objects in logs:
            told = method(found)
            hit = objects[objects >= 0]
            hit = hit[told.track[hit] > 0]
            count += len(objects)
            matched += len(hit)
            in_a += int(np.count_nonzero(told.agent[hit]))
            tracks += len(np.unique(told.track[hit]))
        results.append(Legs(name, count, matched / max(count, 1), in_a / max(matched, 1), tracks))
    return results


def _nearest(found: Detected, labels: list[Float64]) -> Int64:
    """The object nearest to each label, -1 where none is near."""
    x, y = _centroids(found)
    result = []
    for sweep, legs in enumerate(labels):
        mine = np.flatnonzero(found.row == sweep)
        for leg in legs:
            off = np.hypot(x[mine] - leg[0], y[mine] - leg[1])
            near = len(mine) > 0 and off.min() <= NEAR
            result.append(int(mine[off.argmin()]) if near else -1)
    return np.array(result, np.int64)


def _centroids(found: Detected) -> tuple[Float64, Float64]:
    """(K,) in the sensor frame."""
    return (np.concatenate([one.x for one in found.detections]), np.concatenate([one.y for one in found.detections]))
