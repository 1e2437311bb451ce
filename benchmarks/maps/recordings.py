"""Simulated drives: as a log for the program, as beams in the world for the rules, and what is true of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.maps.scenes import walkers
from lidarcli.formalism.mapping.grid import HIT, SKIPPED, Beams, MotionFilter, Occupancy, placed
from lidarcli.options.choices import MAP_RESOLUTION
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Scene
from lidarcli.simulation.truth import true_map
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, RawSweeps, Status, SweepPoses, concatenate, record

RESOLUTION = MAP_RESOLUTION


@record
class Drive:
    """A simulated drive of S sweeps and what is true of it."""

    scene: Scene
    raw: RawSweeps
    entity: Int32
    """(S, B) entity that each beam hit, -1 for none."""
    poses: Float64
    """(S, 3) true x, y, yaw of the sensor."""
    beams: Beams
    """As the rules take them: an instant each."""
    true: Occupancy
    walked: Float64
    """(W, 2) where legs of people were at any sweep [m]."""


def record_drive(scene: Scene, seed: int) -> Drive:
    """Simulate a drive."""
    blocks = list(simulate_blocks(scene, scene.sweeps, seed))
    raw = concatenate([block.raw for block in blocks])
    poses = np.vstack([block.poses for block in blocks])
    batch = normalise(raw, np.arange(len(raw)), RangeRules())
    use = np.where(batch.status == Status.VALID, HIT, SKIPPED).astype(np.uint8)
    here = _sweep_poses(poses)
    seconds = np.arange(scene.sweeps) / scene.sensor.rate
    feet = [walker.feet(seconds) for walker in walkers(scene)]
    return Drive(
        scene=scene,
        raw=raw,
        entity=np.vstack([block.entity for block in blocks]),
        poses=poses,
        beams=placed(batch, here, use),
        true=true_map(scene, scene.sweeps, RESOLUTION),
        walked=np.vstack([np.empty((0, 2)), *(legs.reshape(-1, 2) for legs in feet if legs is not None)]),
    )


def new_sweeps(drive: Drive, min_move: float) -> Bool:
    """(S,) the sweeps that the motion filter lets through."""
    here = _sweep_poses(drive.poses)
    taken = np.zeros(len(drive.poses), np.bool_)
    taken[MotionFilter(min_move).take(here, drive.raw.stamp_ns)] = True
    return taken


def write_drive(drive: Drive, log: Path, rounds: int = 1) -> None:
    """The drive as a log with true poses, as often as asked for one after the other."""
    poses = simulate_odometry(drive.scene, drive.scene.sweeps)
    assert poses is not None
    period = round(drive.scene.sweeps / drive.scene.sensor.rate * 1e9)
    later: Int64 = np.repeat(period * np.arange(rounds), len(poses))
    told = replace(
        poses,
        stamp_ns=np.tile(poses.stamp_ns, rounds) + later,
        poses=np.tile(poses.poses, (rounds, 1)),
        speed=np.tile(poses.speed, rounds),
        yaw_rate=np.tile(poses.yaw_rate, rounds),
    )
    raw = (
        replace(drive.raw, stamp_ns=drive.raw.stamp_ns + period * number, record_ns=drive.raw.record_ns + period * number)
        for number in range(rounds)
    )
    write_log(log, raw, poses=told)


def _sweep_poses(poses: Float64) -> SweepPoses:
    x, y, yaw = np.ascontiguousarray(poses.T)
    return SweepPoses(x, y, yaw, np.zeros(len(poses), np.bool_))
