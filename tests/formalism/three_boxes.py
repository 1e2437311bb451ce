"""Logs of three boxes that differ by 5 cm in both sides, at random places in a room, and what they are named."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

import lidarcli
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import PARKED, Course, Scene, SceneSensor, super_ellipse
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, SweepPoses

SIDES = {"small": (0.70, 0.50), "middle": (0.75, 0.55), "large": (0.80, 0.60)}
CATALOGUE = Catalogue(tuple(Thing(name, length=a, width=b, tolerance=0.005) for name, (a, b) in SIDES.items()))
ROOM = make.wall([[-4.6, -4.5], [4.4, -4.5], [4.4, 4.7], [-4.6, 4.7], [-4.6, -4.5]])
SWEEPS = 300
ROUND = Course(super_ellipse(0.9, 0.7, 2.0), 0.3)


@dataclass(slots=True)
class Named:
    """Boxes by what they are named."""

    boxes: int = 0
    right: int = 0
    wrong: int = 0

    def __iadd__(self, other: Named) -> Named:
        self.boxes, self.right, self.wrong = (self.boxes + other.boxes, self.right + other.right, self.wrong + other.wrong)
        return self


def scene(seed: int, driving: bool, nearest: float, farthest: float, beams: int = 361) -> Scene:
    """Boxes in directions that differ by 50 degrees at least, so that none hides another."""
    rng = np.random.Generator(np.random.PCG64(seed))
    first = rng.uniform(-math.pi, math.pi)
    gaps = math.radians(70.0) + rng.dirichlet(np.ones(3)) * math.radians(150.0)
    boxes = []
    for (length, width), towards in zip(SIDES.values(), first + np.cumsum(gaps), strict=True):
        away = rng.uniform(nearest, farthest)
        x, y = away * math.cos(towards), away * math.sin(towards)
        boxes.append(make.box(x, y, length, width, rng.uniform(-math.pi, math.pi)))
    sensor = SceneSensor(beams=beams, angle_increment=TURN / (beams - 1), noise=0.01)
    return Scene(f"boxes-{seed}", sensor, (ROOM, *boxes), ROUND if driving else PARKED, sweeps=SWEEPS)


def named(seed: int, driving: bool, nearest: float = 1.8, farthest: float = 3.5, beams: int = 361) -> Named:
    """Track one log, and count its boxes."""
    shown = scene(seed, driving, nearest, farthest, beams)
    raw, _, entities = simulate_sweep_arrays(shown, SWEEPS, seed)
    x, y, yaw = shown.sensor_poses(np.arange(SWEEPS) / shown.sensor.rate).T
    poses = SweepPoses(x, y, yaw, np.zeros(SWEEPS, np.bool_))
    batch = replace(normalise(raw, np.arange(SWEEPS), RangeRules()), poses=poses)
    tracks = lidarcli.track(batch, catalogue=CATALOGUE).tracks.to_pylist()
    result = Named()
    for name, box in zip(SIDES, entities[1:], strict=True):
        near = [row for row in tracks if math.hypot(row["x"] - box.x, row["y"] - box.y) < 0.4]
        labels = {row["label"] for row in near if row["label"] is not None}
        result += Named(1, int(labels == {name}), int(bool(labels - {name})))
    return result
