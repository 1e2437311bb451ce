"""What a sensor makes of the ranges that it should measure.

Every kind of fault draws from its own stream in sweep order, so that neither the block size nor the number of
sweeps changes a sweep that both runs hold.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidarcli.simulate.scene import Entity, Sensor
from lidarcli.sweeps import TURN, Bool, Float32, Float64, Int32

_EDGE = 0.15
"""Neighbouring surfaces further apart than this [m] make mixed pixels."""
_DARK_SHARE, _DARK = 0.25, 4.0
"""So many of the entities are dark, and flicker so much more than others."""
_NEAR = 0.05
"""How much what is near flickers; what is at the longest range flickers once more."""
_WAVES = ((0.7, 2), (0.5, 5))
"""Glare over the bearings: height and number of waves; where they lie is drawn."""
_SURE = 0.95
"""Most that a beam flickers."""
_TOGETHER = 0.6
"""How often a beam shares the luck of the one before it."""
_ROUNDS = 12
"""Times that the shares are scaled, until those that are held at the most make no difference."""


def _depth_behind(ideal: Float64, padding: Bool) -> Float64:
    """(S, B) how far behind each hit the surface of a neighbouring beam lies, 0 where none does."""
    surface = np.where(np.isfinite(ideal) & ~padding, ideal, -np.inf)
    neighbour = np.full_like(surface, -np.inf)
    neighbour[:, 1:] = surface[:, :-1]
    neighbour[:, :-1] = np.maximum(neighbour[:, :-1], surface[:, 1:])
    depth: Float64 = np.maximum(neighbour - np.where(np.isfinite(ideal), ideal, np.inf), 0)
    return depth


class Faults:
    """Noise, lost and flickering beams, mixed pixels and changing beam counts, each from its own random stream."""

    def __init__(self, sensor: Sensor, seed: int, entities: Sequence[Entity]) -> None:
        self.sensor = sensor
        streams = np.random.SeedSequence(seed).spawn(7)
        self.noise, self.lost, self.mixed, self.count, self.flickering, surfaces, self.swallowed = (
            np.random.Generator(np.random.PCG64(stream)) for stream in streams
        )
        self.phases = surfaces.uniform(0, TURN, len(_WAVES))
        # One more for what is no entity's own surface: its index is -1.
        self.darkness = np.append(np.where(surfaces.random(len(entities)) < _DARK_SHARE, _DARK, 1.0), 1.0)
        self.swallows = np.append([entity.lost for entity in entities], 0.0)

    def beam_counts(self, sweeps: int) -> Int32:
        """(S,) beams of the next sweeps."""
        if not self.sensor.beams_jitter:
            return np.full(sweeps, self.sensor.beams, np.int32)
        jitter = self.sensor.beams_jitter
        return (self.sensor.beams + self.count.integers(-jitter, jitter + 1, sweeps)).astype(np.int32)

    def apply(self, ideal: Float64, entity: Int32, padding: Bool, bearings: Float64) -> Float32:
        """(S, B) measured ranges; clears `entity` wherever a beam comes back without a range of its own."""
        sensor = self.sensor
        measured, hit = ideal, entity.copy()
        if sensor.mixed_pixels:
            draw = self._uniform(self.mixed, ideal.shape, columns=2)
            depth = _depth_behind(ideal, padding)
            edge = (depth > _EDGE) & (draw[0] < sensor.mixed_pixels)
            measured = np.where(edge, ideal + draw[1] * depth, ideal)
            entity[edge] = -1
        if sensor.noise or sensor.noise_per_metre:
            spread = sensor.noise + sensor.noise_per_metre * np.where(np.isfinite(measured), measured, 0.0)
            measured = measured + spread * self._normal(ideal.shape)
        if sensor.resolution:
            measured = np.rint(measured / sensor.resolution) * sensor.resolution
        return self._limit(measured.astype(np.float32), entity, hit, padding, bearings)

    def _limit(
        self, measured: Float32, entity: Int32, hit: Int32, padding: Bool, bearings: Float64
    ) -> Float32:
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
        if self.swallows.any():
            gone = (self._uniform(self.swallowed, measured.shape)[0] < self.swallows[hit]) & ~nothing
            measured[gone] = self._fill()
            nothing |= gone
        if sensor.flicker:
            gone = self._flickers(measured, entity, nothing | padding, bearings)
            measured[gone] = self._fill()
            nothing |= gone
        nothing |= padding
        measured[padding] = np.nan
        entity[nothing] = -1
        return measured

    def _flickers(self, measured: Float32, entity: Int32, nothing: Bool, bearings: Float64) -> Bool:
        """(S, B) True for beams that return nothing in this sweep: in runs, most where it is far or dark."""
        far = np.where(nothing, 0.0, measured / np.float64(self.sensor.range_max))
        glare = np.exp(
            sum(
                height * np.sin(count * bearings + phase)
                for (height, count), phase in zip(_WAVES, self.phases, strict=True)
            )
        )
        weight = np.where(nothing, 0.0, (far**2 + _NEAR) * self.darkness[entity] * glare)
        wanted = self.sensor.flicker * np.count_nonzero(~nothing, axis=1)
        share = weight
        for _ in range(_ROUNDS):
            total = share.sum(axis=1)
            scale = wanted / np.where(total > 0, total, 1.0)
            share = np.minimum(share * scale[:, None], _SURE)
        draw = self._uniform(self.flickering, measured.shape, columns=2)
        # A beam most often shares the luck of the one before it.
        alone = draw[0] >= _TOGETHER
        alone[:, 0] = True
        leader = np.maximum.accumulate(np.where(alone, np.arange(measured.shape[1]), 0), axis=1)
        luck = np.take_along_axis(draw[1], leader, axis=1)
        gone: Bool = ~nothing & (luck < share)
        return gone

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
