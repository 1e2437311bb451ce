"""In random scenes in which everything stands nothing moves, whether the sensor does or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.random import KINDS, SENSORS, random_scene, sensor_with
from lidarcli.simulation.scene import Course, Scene, super_ellipse
from tests.formalism.tracking.following import TrackedLog, follow, simulated

SWEEPS = 300


def driven(scene: Scene) -> Scene:
    """The same scene around a sensor that goes round a little."""
    here = scene.path.poses(np.zeros(1))[0, :2]
    return replace(scene, path=Course(super_ellipse(0.5, 0.35, 2.5, points=36_000) + here, speed=0.4))


def told_of(kind: str, seed: int, sensor: str, noise: float, *, drive: bool = False, log_seed: int = 0) -> TrackedLog:
    """What is told of a standing scene."""
    lost = {0.003: 0.0, 0.01: 0.003, 0.03: 0.01}[noise]
    scene = random_scene(kind, seed, sensor_with(SENSORS[sensor], noise, lost))  # type: ignore[arg-type]
    assert scene.path.parked
    return follow(simulated(driven(scene) if drive else scene, SWEEPS, log_seed, poses=drive))


PLACES = [
    pytest.param(drive, kind, id=f"{name}-{kind}", marks=[pytest.mark.whole] if drive else [])
    for name, drive in (("parked", False), ("driving", True))
    for kind in KINDS
]


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "kind"), PLACES)
def test_nothing_moves_where_everything_stands(kind: str, drive: bool) -> None:
    tracks, agents = 0, 0
    for sensor in SENSORS:
        for noise in (0.01, 0.03):
            for seed in range(900, 903):
                told = told_of(kind, seed, sensor, noise, drive=drive)
                tracks, agents = tracks + len(told.tracks), agents + len(told.agents)
    assert tracks > 20
    # It should be none. Legs that are seen in turn are told to move by mistake, mostly to a sensor that drives.
    assert agents <= (0.03 if drive else 0.01) * tracks


def test_legs_that_are_found_in_turn_are_no_motion() -> None:
    assert told_of("hall", 501, "1081", 0.03, log_seed=1).agents.tolist() == []


def test_pieces_that_come_into_view_are_no_motion() -> None:
    assert told_of("hall", 700, "1081", 0.01, drive=True).agents.tolist() == []
