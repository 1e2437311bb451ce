"""The conditions under which things are followed: kind of scene, sensor, noise, and how the sensor is carried."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lidarcli.simulate.random_scenes import SENSORS, random_scene, sensor_with
from lidarcli.simulate.scene import Course, Motion, Scene, super_ellipse

Kind = Literal["room", "hall", "people", "crossing"]
KINDS: tuple[Kind, ...] = ("room", "hall", "people", "crossing")
Carried = Literal["parked", "driving", "drifting"]
CARRIED: tuple[Carried, ...] = ("parked", "driving", "drifting")

SLOW = 0.15
"""[m/s] What has moved this fast is asked for in set A."""
DELAY, DRIFT = 0.05, 0.01
"""[s] by which the poses of `drifting` are late, and the share of the way by which they drift."""
LOST = {0.0: 0.0, 0.01: 0.003, 0.03: 0.01}
"""Noise [m] → share of beams lost at random."""

TUNING, REPORTING = 0, 70_000
"""First seeds of what constants may be chosen on, and of what is reported."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One condition."""

    kind: Kind
    sensor: str
    noise: float
    """Standard deviation of a range [m]."""
    carried: Carried

    @property
    def driving(self) -> bool:
        """Whether the sensor moves; then the log has poses."""
        return self.carried != "parked"

    @property
    def delay(self) -> float:
        """Of the poses [s]."""
        return DELAY if self.carried == "drifting" else 0.0

    @property
    def drift(self) -> float:
        """Of the poses, as a share of the way."""
        return DRIFT if self.carried == "drifting" else 0.0

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"{self.kind}, {self.sensor} beams, {100 * self.noise:.0f} cm, {self.carried}"


QUICK = (
    Cell("room", "361", 0.01, "parked"),
    Cell("room", "1081", 0.01, "parked"),
    Cell("room", "361", 0.03, "parked"),
    Cell("hall", "720", 0.01, "parked"),
    Cell("room", "720", 0.01, "driving"),
    Cell("room", "720", 0.01, "drifting"),
    Cell("people", "1081", 0.01, "parked"),
    Cell("people", "361", 0.01, "driving"),
)


def scene_of(cell: Cell, seed: int) -> Scene:
    """The scene of a cell: the same seed gives the same things for every sensor and noise."""
    sensor = sensor_with(SENSORS[cell.sensor], cell.noise, LOST[cell.noise])
    rng = np.random.Generator(np.random.PCG64([seed, 7]))
    kind: Literal["room", "hall"] = "hall" if cell.kind == "hall" else "room"
    scene = random_scene(kind, seed, sensor, legged=cell.kind == "people")
    spot = scene.path.points[0]
    entities = []
    for entity in scene.entities:
        if not entity.wall and rng.random() < 0.3:
            speed, heading = rng.uniform(0.15, 1.0), rng.uniform(-np.pi, np.pi)
            velocity = (speed * np.cos(heading), speed * np.sin(heading))
            rate = rng.uniform(-0.35, 0.35) if entity.kind == "box" else 0.0
            entity = replace(entity, motion=Motion(velocity, rate))
        entities.append(entity)
    path = Course(super_ellipse(0.6, 0.4, 4.0) + spot, 0.3) if cell.driving else scene.path
    return replace(scene, entities=tuple(entities), path=path, sweeps=200)
