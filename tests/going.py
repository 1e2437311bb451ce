"""Sweeps that take time, of a sensor that goes evenly: what it sees of things that stand is known exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import Entity, Scene, SceneSensor
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Float64, SweepBatch, SweepPoses

BEAMS = 720
SPINNING = SceneSensor(beams=BEAMS, angle_increment=TURN / BEAMS, time_increment=0.1 / BEAMS)
"""A full turn in 0.1 s, without noise."""
SENSORS = {
    "full turn": SPINNING,
    "clockwise": replace(SPINNING, angle_min=np.pi, angle_increment=-TURN / BEAMS),
    "part of a turn": SceneSensor(beams=541, angle_min=-2.4, angle_increment=4.8 / 540, time_increment=0.08 / 540),
}


@dataclass(frozen=True)
class Drive:
    """A path along which x, y and yaw change evenly, also sideways."""

    start: tuple[float, float, float]
    rate: tuple[float, float, float]
    """[m/s], [rad/s] in the world."""
    parked: bool = False

    def poses(self, seconds: Float64) -> Float64:
        """(S, 3) x, y, yaw."""
        told: Float64 = np.array(self.start) + np.multiply.outer(seconds, self.rate)
        return told

    def speeds(self, seconds: Float64) -> Float64:
        """(S,) [m/s]."""
        return np.full(len(seconds), np.hypot(*self.rate[:2]))


def seen_going(
    sensor: SceneSensor, drive: Drive, *entities: Entity, sweeps: int = 1, upside_down: bool = False
) -> SweepBatch:
    """The sweeps of a sensor on its drive, with poses that tell how it goes."""
    side = -1.0 if upside_down else 1.0
    hung = replace(sensor, angle_min=side * sensor.angle_min, angle_increment=side * sensor.angle_increment)
    path: Any = drive
    raw, _, _ = simulate_sweep_arrays(Scene("going", hung, entities, path), sweeps)
    if upside_down:
        # Hanging head down, bearings run the other way round.
        raw = replace(raw, angle_min=-raw.angle_min, angle_increment=-raw.angle_increment)
    batch = normalise(raw, np.arange(sweeps), RangeRules())
    told = drive.poses(np.arange(sweeps) / sensor.rate)
    lasts = np.zeros(sweeps) if batch.duration is None else batch.duration
    poses = SweepPoses(
        told[:, 0], told[:, 1], told[:, 2], np.full(sweeps, upside_down), lasts[:, None] * np.array(drive.rate)
    )
    return replace(batch, poses=poses)


def told_backwards(batch: SweepBatch) -> SweepBatch:
    """The same beams, told from the last to the first: a sweep begins with what is now its last beam, in time."""
    assert batch.duration is not None
    assert batch.poses is not None
    assert batch.poses.way is not None
    last = (batch.beams - 1) * batch.angle_increment
    poses = batch.poses
    there = poses.during(np.arange(len(batch)), np.ones(len(batch)))
    return replace(
        batch,
        ranges=batch.ranges[:, ::-1].copy(),
        status=batch.status[:, ::-1].copy(),
        angle_min=batch.angle_min + last,
        angle_increment=-batch.angle_increment,
        duration=-batch.duration,
        poses=SweepPoses(there.x, there.y, there.yaw, poses.upside_down, -poses.way),  # type: ignore[operator]
    )


def in_the_world(batch: SweepBatch, row: int = 0) -> Float64:
    """(K, 2) the points of the beams of a sweep with a range, each from where the sensor was then."""
    assert batch.poses is not None
    beam = np.flatnonzero(~np.isnan(batch.ranges[row]))
    r = batch.ranges[row, beam].astype(np.float64)
    theta = batch.bearings[row, beam]
    rows = np.full(len(beam), row)
    x, y, _ = batch.poses.to_world(
        rows, r * np.cos(theta), r * np.sin(theta), np.zeros(len(beam)), batch.shares(rows, beam)
    )
    return np.column_stack([x, y])
