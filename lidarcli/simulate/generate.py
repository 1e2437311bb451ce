"""Sweeps of a scene, with the entity every beam hit: ray casting, then the sensor's faults.

Every kind of fault draws from its own stream in sweep order, so that neither the block size nor the number of
sweeps changes a sweep that both runs hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lidarcli.simulate.raycast import cast, place
from lidarcli.simulate.scene import Entity, Scene, Sensor
from lidarcli.sweeps import Bool, Float32, Float64, Int32, Int64, RawSweeps, concatenate

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sweep: fixed, because a simulation has no clock of its own."""
_EDGE = 0.15
"""Neighbouring surfaces further apart than this [m] make mixed pixels."""


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
    faults = _Faults(scene.sensor, seed)
    still = None
    for first in range(0, sweeps, size):
        index = np.arange(first, min(first + size, sweeps))
        seconds = index / scene.sensor.rate
        poses = scene.path.poses(seconds)
        beams = faults.beam_counts(len(index))
        increment = _increments(scene.sensor, beams)
        bearings = scene.sensor.angle_min + increment[:, None] * np.arange(beams.max(initial=0))
        if scene.still and not scene.sensor.beams_jitter:
            if still is None:
                still = cast(place(scene.entities, poses[:1], seconds[:1]), bearings[:1])
            ideal = np.repeat(still[0], len(index), axis=0)
            entity = np.repeat(still[1], len(index), axis=0)
        else:
            ideal, entity = cast(place(scene.entities, poses, seconds), bearings)
        padding = np.arange(bearings.shape[1]) >= beams[:, None]
        ranges = faults.apply(ideal, entity, padding)
        raw = _raw(scene.sensor, START_NS + np.rint(seconds * 1e9).astype(np.int64), beams, increment, ranges)
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
    )


def _depth_behind(ideal: Float64, padding: Bool) -> Float64:
    """(S, B) how far behind each hit the surface of a neighbouring beam lies, 0 where none does."""
    surface = np.where(np.isfinite(ideal) & ~padding, ideal, -np.inf)
    neighbour = np.full_like(surface, -np.inf)
    neighbour[:, 1:] = surface[:, :-1]
    neighbour[:, :-1] = np.maximum(neighbour[:, :-1], surface[:, 1:])
    depth: Float64 = np.maximum(neighbour - np.where(np.isfinite(ideal), ideal, np.inf), 0)
    return depth


class _Faults:
    """Noise, lost beams, mixed pixels and changing beam counts, each from its own random stream."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.sensor = sensor
        streams = np.random.SeedSequence(seed).spawn(4)
        self.noise, self.lost, self.mixed, self.count = (
            np.random.Generator(np.random.PCG64(stream)) for stream in streams
        )

    def beam_counts(self, sweeps: int) -> Int32:
        """(S,) beams of the next sweeps."""
        if not self.sensor.beams_jitter:
            return np.full(sweeps, self.sensor.beams, np.int32)
        jitter = self.sensor.beams_jitter
        return (self.sensor.beams + self.count.integers(-jitter, jitter + 1, sweeps)).astype(np.int32)

    def apply(self, ideal: Float64, entity: Int32, padding: Bool) -> Float32:
        """(S, B) measured ranges; clears `entity` wherever a beam comes back without a range of its own."""
        sensor = self.sensor
        measured = ideal
        if sensor.mixed_pixels:
            draw = self._uniform(self.mixed, ideal.shape, columns=2)
            depth = _depth_behind(ideal, padding)
            edge = (depth > _EDGE) & (draw[0] < sensor.mixed_pixels)
            measured = np.where(edge, ideal + draw[1] * depth, ideal)
            entity[edge] = -1
        if sensor.noise:
            measured = measured + sensor.noise * self._normal(ideal.shape)
        return self._limit(measured.astype(np.float32), entity, padding)

    def _limit(self, measured: Float32, entity: Int32, padding: Bool) -> Float32:
        """What the sensor says where it has no range: out of limits, lost, or padding."""
        sensor = self.sensor
        nothing = ~(measured <= np.float32(sensor.range_max))
        measured[nothing] = self._fill()
        close = measured < np.float32(sensor.range_min)
        close &= ~nothing
        measured[close] = -np.inf
        nothing |= close
        if sensor.lost:
            draw = self._uniform(self.lost, measured.shape)[0]
            lost = (draw < sensor.lost) & ~nothing
            measured[lost] = self._fill()
            if sensor.lost_as == "mixed":
                # One draw decides both whether and how: its upper half of the lost share is NaN.
                measured[lost & (draw >= sensor.lost / 2)] = np.nan
            nothing |= lost
        nothing |= padding
        measured[padding] = np.nan
        entity[nothing] = -1
        return measured

    def _fill(self) -> float:
        values = {"inf": np.inf, "mixed": np.inf, "nan": np.nan, "zero": 0.0, "max": self.sensor.range_max}
        return values[self.sensor.lost_as]

    def _full(self, shape: tuple[int, ...]) -> tuple[int, int]:
        """Draws are made for the widest possible sweep, so that block boundaries do not shift the streams."""
        return shape[0], self.sensor.beams + self.sensor.beams_jitter

    def _normal(self, shape: tuple[int, ...]) -> Float64:
        return self.noise.standard_normal(self._full(shape))[:, : shape[1]]

    def _uniform(self, stream: np.random.Generator, shape: tuple[int, ...], columns: int = 1) -> Float64:
        rows, width = self._full(shape)
        draw: Float64 = np.moveaxis(stream.random((rows, width, columns)), 2, 0)[:, :, : shape[1]]
        return draw
