"""The sweeps of the benchmark with their truth: random scenes × sensors × faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.scenes import building
from benchmarks.scenes.random import CHEAP_NOISE, FAULTS, KINDS, SENSORS, Kind, cheap, random_scene, sensor_with
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import Entity, Scene, SceneSensor
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Float64, Int32, RawSweeps, SweepBatch, UInt8, concatenate

Things = Literal["plain", "whole", "legs"]
"""Scenes without legged things; with them, each one entity; with them, each leg an entity of its own."""

THINGS = ("box", "cylinder", "pole", "plant", "person", "chair", "table", "ladder", "leg", "wall")
"""Kinds of entities; the codes of `Truth.kind` are positions in this tuple."""
WALL = THINGS.index("wall")
POLE_DIAMETER = 0.12
"""A cylinder up to this thick [m] is called a pole: few beams hit it."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One of the conditions."""

    kind: Kind | building.Kind
    sensor: str
    noise: float
    """Standard deviation of a range [m]."""
    lost: float
    """Share of lost beams."""
    cheap: bool = False
    """Whether the sensor has all the faults of cheap ones besides."""

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"{self.sensor} · " + ("cheap" if self.cheap else f"{100 * self.noise:.0f} cm")

    def fitted(self) -> SceneSensor:
        """The sensor with its faults."""
        sensor = {**SENSORS, **NARROW}[self.sensor]
        return cheap(sensor) if self.cheap else sensor_with(sensor, self.noise, self.lost)


CELLS = tuple(Cell(kind, sensor, *fault) for kind in KINDS for sensor in SENSORS for fault in FAULTS)
"""Scenes of clean surfaces."""
BUILDING_FAULTS = ((0.01, 0.003, False), (*CHEAP_NOISE[:1], 0.01, True))
BUILDING_CELLS = tuple(
    Cell(kind, sensor, *fault) for kind in building.KINDS for sensor in SENSORS for fault in BUILDING_FAULTS
)
"""Scenes like real buildings."""
NARROW = {
    "181": SceneSensor(181, -TURN / 4, TURN / 360, 0.1, 30.0),
    "361 over half a turn": SceneSensor(361, -TURN / 4, TURN / 720, 0.1, 30.0),
    "361 up to 5 m": SceneSensor(361, -TURN / 2, TURN / 360, 0.1, 5.0),
    "683": SceneSensor(683, -TURN / 3, TURN / 1023, 0.05, 5.6),
}
"""Sensors of a narrow or a short view."""
NARROW_CELLS = tuple(
    Cell(kind, sensor, *fault) for kind in building.KINDS for sensor in NARROW for fault in BUILDING_FAULTS
)
"""Scenes like real buildings of which little is seen: trees are grown on them, nothing is reported on them."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What S sweeps of B beams saw. E: the largest number of entities in one sweep."""

    entity: Int32
    """(S, B) entity that the beam hit, -1 for none or without a range."""
    kind: UInt8
    """(S, E) code into `THINGS`; `WALL` also where there is no such entity."""


def kind_of(entity: Entity) -> int:
    """Code into `THINGS`."""
    thin = entity.kind == "cylinder" and entity.length <= POLE_DIAMETER
    return THINGS.index("pole" if thin else entity.kind)


def with_legs_apart(scene: Scene) -> Scene:
    """The same scene with every leg an entity of its own."""
    return replace(scene, entities=tuple(leg for entity in scene.entities for leg in legs_of(entity)))


def simulate(scenes: list[Scene], seeds: list[int], sweeps: int = 1) -> tuple[SweepBatch, Truth]:
    """Sweeps of several scenes as one batch, with their truth."""
    raws, hits, kinds = [], [], []
    most = max(len(scene.entities) for scene in scenes)
    for scene, seed in zip(scenes, seeds, strict=True):
        raw, hit, entities = simulate_sweep_arrays(scene, sweeps, seed)
        kind = np.full(most, WALL, np.uint8)
        kind[: len(entities)] = [kind_of(entity) for entity in entities]
        raws.append(raw)
        hits.append(hit)
        kinds.append(np.tile(kind, (sweeps, 1)))
    return judged(concatenate(raws)), Truth(np.concatenate(hits), np.concatenate(kinds))


def judged(raw: RawSweeps) -> SweepBatch:
    """Normalised by the default rules."""
    return normalise(raw, np.arange(len(raw)), RangeRules())


def cells_of(
    kind: Kind | building.Kind, seeds: list[int], things: Things, cells: tuple[Cell, ...] = (*CELLS, *BUILDING_CELLS)
) -> Iterator[tuple[Cell, SweepBatch, Truth]]:
    """The cells of one kind of scene: one sweep of each seed's scene by each sensor with each fault."""
    ideal, legged = SENSORS["361"], things != "plain"
    scenes = []
    for seed in seeds:
        if kind == "passage" or kind == "chamber":
            scenes.append(building.building_scene(kind, seed, ideal, legged=legged))
        else:
            scenes.append(random_scene(kind, seed, ideal, legged=legged))
    if things == "legs":
        scenes = [with_legs_apart(scene) for scene in scenes]
    for cell in cells:
        if cell.kind == kind:
            sensor = cell.fitted()
            batch, truth = simulate([replace(scene, sensor=sensor) for scene in scenes], seeds)
            yield cell, batch, truth


def points_xy(batch: SweepBatch) -> tuple[Float64, Float64]:
    """(S, B) positions in the sensor frame [m], NaN without a range."""
    bearings, ranges = batch.bearings, batch.ranges.astype(np.float64)
    return ranges * np.cos(bearings), ranges * np.sin(bearings)


def legs_of(entity: Entity) -> list[Entity]:
    """The legs of a legged thing as entities of their own (kind `leg`); anything else, and what has a route, as it is."""
    if entity.kind not in ("ladder", "chair", "table", "person") or entity.motion.route:
        return [entity]
    cos, sin = np.cos(entity.yaw), np.sin(entity.yaw)
    legs = []
    for number, (cx, cy, radius) in enumerate(entity.circles):
        ring = np.array([[0.0, 0.0, radius]])
        swing = (1 - 2 * (number % 2)) * entity.motion.stride
        legs.append(
            replace(
                entity,
                kind="leg",
                x=entity.x + cos * cx - sin * cy,
                y=entity.y + sin * cx + cos * cy,
                length=2 * radius,
                width=2 * radius,
                circles=ring,
                motion=replace(entity.motion, stride=swing),
            )
        )
    for sides in entity.segments.reshape(-1, 4, 4):
        middle = sides[:, :2].mean(axis=0)
        local = sides - np.tile(middle, 2)
        extent = 2 * np.abs(local).max(axis=0)
        legs.append(
            replace(
                entity,
                kind="leg",
                x=entity.x + cos * middle[0] - sin * middle[1],
                y=entity.y + sin * middle[0] + cos * middle[1],
                length=float(extent[0]),
                width=float(extent[1]),
                segments=local,
            )
        )
    return legs
