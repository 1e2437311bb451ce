"""Print a digest of all that is told of many logs: the compiled core and its source have to print the same."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np

from benchmarks.scenes.moving import moving_scene
from lidarcli.formalism import Parameters, detect
from lidarcli.simulation.scene import SceneSensor
from lidarcli.sweeps.types import TURN, SweepBatch
from tests.formalism.tracking.following import TrackedLog, assert_sums, batches, follow, simulated
from tests.formalism.tracking.hostile import hostile_logs

SENSORS = (
    SceneSensor(beams=180, angle_increment=TURN / 180, noise=0.01),
    SceneSensor(beams=181, angle_increment=-TURN / 180, noise=0.02, lost=0.01, flicker=0.1),
    SceneSensor(beams=150, angle_min=-2.0, angle_increment=4.0 / 150, noise=0.003, beams_jitter=3),
)
SWEEPS = 560
"""More than two windows."""


def scenes() -> Iterator[SweepBatch]:
    """Of every kind, with a sensor that stands, drives, or hangs head down."""
    for number, (kind, driving) in enumerate(
        (("room", False), ("room", True), ("hall", True), ("crossing", False), ("people", False))
    ):
        scene = moving_scene(kind, number, SENSORS[number % 3], driving=driving)  # type: ignore[arg-type]
        batch = simulated(scene, SWEEPS, number, poses=driving, delay=0.05)
        if kind == "hall":
            assert batch.poses is not None
            batch = replace(batch, poses=replace(batch.poses, upside_down=np.ones(len(batch), np.bool_)))
        yield batch


def digest(told: TrackedLog) -> str:
    """A few letters that differ where any bit of anything told does."""
    total = hashlib.sha256()
    arrays = {**told.columns, **{each.name: getattr(told.tracks, each.name) for each in fields(told.tracks)}}
    for name, values in arrays.items():
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values)
        total.update(f"{name} {values.dtype} {values.shape} ".encode() + values.tobytes())
    return total.hexdigest()[:16]


def main_part(hostile: int, simulate: bool) -> None:
    """Hostile logs, each also in one go where it is of one width, and simulated ones."""
    for number, (log, parameters) in enumerate(hostile_logs(hostile)):
        told = follow(log, parameters)
        first = np.cumsum([0, *(len(batch) for batch in log)])
        for batch, begin in zip(log, first[:-1], strict=True):
            _check(told, detect(batch, parameters), int(begin), len(batch))
        print(number, len(told.tracks), digest(told))
    for number, batch in enumerate(scenes() if simulate else ()):
        told = follow(batches(batch, 100))
        assert_sums(told, detect(batch, Parameters()))
        print("scene", number, len(told.tracks), len(told.agents), digest(told))


def _check(told: TrackedLog, found: object, begin: int, count: int) -> None:
    """Definition 4 sums in every batch."""
    rows = slice(begin, begin + count)
    for kind in ("objects", "object_beams"):
        agents = kind.replace("object", "agent") if kind != "objects" else "agents"
        total = told.columns[kind][rows] + told.columns[agents][rows]
        assert (total == getattr(found, kind)).all()


if __name__ == "__main__":
    main_part(int(sys.argv[1]), "scenes" in sys.argv[2:])
