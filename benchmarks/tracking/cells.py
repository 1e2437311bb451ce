"""The conditions under which things are followed: kind of scene, sensor, noise, and how the sensor is carried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

from benchmarks.scenes.moving import DRIVEN, Kind, moving_scene
from benchmarks.scenes.random import SENSORS, sensor_with
from lidarcli.simulation.scene import Scene

PERSONS: Kind = "people"
"""The kind of scene with persons; in all others everything is rigid."""
Carried = Literal["parked", "driving", "drifting"]
CARRIED: tuple[Carried, ...] = ("parked", "driving", "drifting")

SLOW = 0.15
"""[m/s] What has moved this fast is asked for in set A."""
DELAY, DRIFT = 0.05, 0.01
"""[s] by which the poses of `drifting` are late, and the share of the way by which they drift."""
LOST = {0.0: 0.0, 0.01: 0.003, 0.03: 0.01}
"""Noise [m] → share of beams lost at random."""
FLICKER = 0.2
"""Share of the beams that would hit something and return nothing, in the cells that ask for it."""

TUNING, REPORTING = 0, 70_000
"""First seeds of what constants may be chosen on, and of what is reported."""
APART = 100
"""Each cell has so many seeds of its own."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One condition."""

    kind: Kind
    sensor: str
    noise: float
    """Standard deviation of a range [m]."""
    carried: Carried
    flicker: float = 0.0
    rolling: bool = False
    """Whether a sweep takes the whole time until the next one."""

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
    def place(self) -> str:
        """Kind of scene and how the sensor is carried."""
        return f"{self.kind}, {self.carried}"

    @property
    def fault(self) -> str:
        """What is unusual about it, or nothing."""
        return "flicker" if self.flicker else "rolling" if self.rolling else ""

    @property
    def label(self) -> str:
        """Short name for tables."""
        fault = f", {self.fault}" if self.fault else ""
        return f"{self.place}, {self.sensor} beams, {100 * self.noise:.0f} cm{fault}"


def _cells() -> Iterator[Cell]:
    places: list[tuple[Kind, Carried]] = [
        *((kind, carried) for kind in DRIVEN for carried in CARRIED),
        ("crossing", "parked"),
        (PERSONS, "parked"),
    ]
    for (kind, carried), sensor, noise in product(places, SENSORS, LOST):
        yield Cell(kind, sensor, noise, carried)
    for kind, carried in places:
        yield Cell(kind, "361", 0.01, carried, flicker=FLICKER)
        yield Cell(kind, "720", 0.01, carried, rolling=True)


CELLS = tuple(_cells())

QUICK = (
    Cell("room", "361", 0.01, "parked"),
    Cell("room", "1081", 0.01, "parked"),
    Cell("room", "361", 0.03, "parked"),
    Cell("hall", "720", 0.01, "parked"),
    Cell("crossing", "720", 0.01, "parked"),
    Cell("room", "720", 0.01, "driving"),
    Cell("room", "720", 0.01, "drifting"),
    Cell("hall", "361", 0.01, "driving"),
    Cell("room", "361", 0.01, "parked", flicker=FLICKER),
    Cell("people", "1081", 0.01, "parked"),
    Cell("people", "361", 0.01, "parked"),
)
"""A handful, for between two edits."""


def scene_of(cell: Cell, seed: int) -> Scene:
    """The scene of a cell."""
    sensor = sensor_with(SENSORS[cell.sensor], cell.noise, LOST[cell.noise])
    turn = 1.0 / sensor.rate
    sensor = replace(sensor, flicker=cell.flicker, time_increment=turn / sensor.beams if cell.rolling else 0.0)
    return moving_scene(cell.kind, seed, sensor, driving=cell.driving, legged=cell.kind == PERSONS)
