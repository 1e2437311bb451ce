"""Sweeps of a scene, with the entity every beam hit: ray casting, then the sensor's faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.simulate.faults import Faults
from lidarcli.simulate.raycast import cast, place
from lidarcli.simulate.scene import Entity, Scene, Sensor
from lidarcli.sweeps import Bool, Float32, Float64, Int32, Int64, RawSweeps, concatenate

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sweep: fixed, because a simulation has no clock of its own."""
_CELLS = 1 << 19
"""Largest number of beam × shape pairs of sweeps that take time, placed at once."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedBlock:
    """A run of simulated sweeps and their truth."""

    raw: RawSweeps
    first: int
    """Index of its first sweep."""
    seconds: Float64
    """(S,) since the first sweep."""
    poses: Float64
    """(S, 3) of the sensor in the world."""
    entity: Int32
    """(S, B) index into the scene's entities, -1 for none and for padding."""


def simulate_blocks(scene: Scene, sweeps: int, seed: int = 0, size: int = 512) -> Iterator[SimulatedBlock]:
    """Sweeps of a scene in blocks of at most `size`."""
    faults = Faults(scene.sensor, seed, scene.entities)
    still = None
    for first in range(0, sweeps, size):
        index = np.arange(first, min(first + size, sweeps))
        seconds = index / scene.sensor.rate
        poses = scene.sensor_poses(seconds)
        beams = faults.beam_counts(len(index))
        increment = _increments(scene.sensor, beams)
        bearings = scene.sensor.angle_min + increment[:, None] * np.arange(beams.max(initial=0))
        if scene.still and not scene.sensor.beams_jitter:
            if still is None:
                still = cast(place(scene.entities, poses[:1], seconds[:1]), bearings[:1])
            ideal = np.repeat(still[0], len(index), axis=0)
            entity = np.repeat(still[1], len(index), axis=0)
        elif scene.sensor.time_increment:
            ideal, entity = _cast_in_turn(scene, seconds, _time_increments(scene.sensor, beams), bearings)
        else:
            ideal, entity = cast(place(scene.entities, poses, seconds), bearings)
        padding = np.arange(bearings.shape[1]) >= beams[:, None]
        ranges = faults.apply(ideal, entity, padding, bearings)
        raw = _raw(scene.sensor, START_NS + np.rint(seconds * 1e9).astype(np.int64), beams, increment, ranges)
        raw = replace(raw, intensities=_intensities(scene.entities, entity, padding))
        yield SimulatedBlock(raw, first, seconds, poses, entity)


def simulate_sweep_arrays(
    scene: Scene, n_sweeps: int, seed: int = 0
) -> tuple[RawSweeps, Int32, tuple[Entity, ...]]:
    """All sweeps at once: the sweeps, the (S, B) entity of every beam (-1: none), and the entities."""
    blocks = list(simulate_blocks(scene, n_sweeps, seed))
    raw = concatenate([block.raw for block in blocks])
    entity = np.full(raw.ranges.shape, -1, np.int32)
    for block in blocks:
        rows, columns = block.entity.shape
        entity[block.first : block.first + rows, :columns] = block.entity
    return raw, entity, scene.entities


def _increments(sensor: Sensor, beams: Int32) -> Float64:
    """(S,) the increment that keeps the field of view whatever the number of beams."""
    exact = sensor.angle_increment * (sensor.beams / beams)
    return np.where(beams == sensor.beams, sensor.angle_increment, exact)


def _time_increments(sensor: Sensor, beams: Int32) -> Float64:
    """(S,) from beam to beam [s]: a sweep takes as long whatever the number of beams."""
    exact: Float64 = sensor.time_increment * (sensor.beams / beams)
    return exact


def _cast_in_turn(
    scene: Scene, seconds: Float64, increment: Float64, bearings: Float64
) -> tuple[Float64, Int32]:
    """As `cast`, but each beam meets the world, and leaves the sensor, at its own time."""
    sweeps, beams = bearings.shape
    shapes = sum(len(entity.segments) + len(entity.circles) for entity in scene.entities)
    step = max(1, _CELLS // (beams * max(shapes, 1)))
    ranges, entity = np.empty(bearings.shape), np.empty(bearings.shape, np.int32)
    for first in range(0, sweeps, step):
        part = slice(first, first + step)
        times = (seconds[part, None] + increment[part, None] * np.arange(beams)).ravel()
        placed = place(scene.entities, scene.sensor_poses(times), times)
        found, hit = cast(placed, bearings[part].reshape(-1, 1))
        ranges[part], entity[part] = found.reshape(-1, beams), hit.reshape(-1, beams)
    return ranges, entity


def _intensities(entities: Sequence[Entity], entity: Int32, padding: Bool) -> Float32 | None:
    """(S, B) the intensity of what each beam hit, 0 where nothing tells; None where the scene tells of none."""
    if all(each.intensity is None for each in entities):
        return None
    # One more for what is no entity's own surface: its index is -1.
    told = np.array([*(each.intensity or 0.0 for each in entities), 0.0], np.float32)
    return np.where(padding, np.float32(np.nan), told[entity])


def _raw(sensor: Sensor, stamp_ns: Int64, beams: Int32, increment: Float64, ranges: Float32) -> RawSweeps:
    """Put simulated ranges into the shape in which logs hold them."""
    rows = len(ranges)
    return RawSweeps(
        topic=sensor.topic,
        frame_ids=(sensor.frame_id,),
        frame=np.zeros(rows, np.int32),
        stamp_ns=stamp_ns,
        record_ns=stamp_ns,
        # What a LaserScan can hold: its geometry is float32, and so is ours from here on.
        angle_min=np.full(rows, np.float32(sensor.angle_min), np.float64),
        angle_increment=increment.astype(np.float32).astype(np.float64),
        range_min=np.full(rows, sensor.range_min, np.float32),
        range_max=np.full(rows, sensor.range_max, np.float32),
        beams=beams,
        ranges=ranges,
        time_increment=_time_increments(sensor, beams).astype(np.float32),
        scan_time=np.full(rows, 1 / sensor.rate if sensor.time_increment else 0.0, np.float32),
    )
