"""Drawn drives through rooms, halls and passages: standing things are no agents, by told poses and by matched ones."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import lidarcli
from benchmarks.scenes.building import WAY, building_scene
from benchmarks.scenes.moving import moving_scene
from benchmarks.scenes.random import SENSORS
from lidarcli.simulation.generate import relative, simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.scene import Course, Odometry, Scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import Int64

Timing = Literal["once", "told", "untold"]
SPEED = 0.3
"""In the passages [m/s]."""


@dataclass(frozen=True)
class Case:
    """A drive, and the greatest shares of the rows of standing things in set A."""

    place: Literal["room", "hall", "passage"]
    seed: int
    sensor: str
    timing: Timing
    """All beams at once; or in turn, and headers tell it or not."""
    people: bool = False
    """People and other things move about."""
    matched: float = 0.02
    true: float = 0.01
    off: float = 0.1
    """Greatest distance of the matched path from the true one [m]."""

    def __str__(self) -> str:
        """Name of the case."""
        people = "-people" if self.people else ""
        return f"{self.place}-{self.seed}-{self.sensor}-{self.timing}{people}"


CASES = (
    Case("room", 1, "361", "told"),
    Case("room", 2, "720", "untold"),
    Case("hall", 1, "361", "untold"),
    Case("hall", 3, "1081", "told"),
    Case("passage", 1, "361", "once"),
    Case("passage", 3, "1081", "untold"),
    Case("room", 2, "720", "untold", people=True),
    Case("hall", 1, "361", "untold", people=True, true=0.011),
    # Who comes near a standing thing hands its track on to it.
    Case("room", 3, "1081", "once", people=True, matched=0.08, true=0.08),
)


def scene_of(case: Case) -> Scene:
    """The scene of a case, with exact odometry."""
    sensor = replace(SENSORS[case.sensor], noise=0.01, lost=0.003)
    if case.timing != "once":
        sensor = replace(sensor, time_increment=1.0 / sensor.rate / sensor.beams)
    if case.place == "passage":
        scene = building_scene("passage", case.seed, sensor, driving=True)
        assert isinstance(scene.path, Course)
        slow = replace(scene.path, speed=SPEED)
        scene = replace(scene, path=slow, sweeps=int(WAY / SPEED * sensor.rate))
    else:
        scene = moving_scene(case.place, case.seed, sensor, driving=True)
    if not case.people:
        scene = replace(scene, entities=tuple(one for one in scene.entities if one.motion.still))
    return replace(scene, odometry=Odometry())


def owners(objects: Any, entity: Int64) -> Int64:
    """(K,) the entity that most beams of each object hit, of (S, B) entities; -1 for none."""
    sweeps, firsts, lasts = (objects[name].to_numpy() for name in ("sweep", "beam_i", "beam_f"))
    beams = entity.shape[1]
    found = np.full(len(sweeps), -1)
    for row, (sweep, first, last) in enumerate(zip(sweeps, firsts, lasts, strict=True)):
        beam = np.arange(first, last + 1 + (beams if last < first else 0)) % beams
        hits = entity[sweep, beam]
        if (hits >= 0).any():
            found[row] = np.bincount(hits[hits >= 0]).argmax()
    return found


def share_of_agents(tables: Any, scene: Scene, entity: Int64) -> float:
    """The share of the rows of what never moves that `track` puts into set A."""
    objects = tables.objects
    owner, sweep = owners(objects, entity), objects["sweep"].to_numpy()
    seconds = np.arange(scene.sweeps) / scene.sensor.rate
    velocity = np.stack([one.velocities(seconds) for one in scene.entities], axis=1)
    begun = np.logical_or.accumulate(velocity.any(axis=2), axis=0)
    # Who stands and goes later may be told as an agent before.
    stands = (owner >= 0) & ~begun[-1, np.maximum(owner, 0)]
    goes = (owner >= 0) & begun[sweep, np.maximum(owner, 0)]
    agents = np.array(objects["set"].to_pylist()) == "A"
    assert stands.sum() > 200
    if begun.any():
        assert (agents & goes).sum() > 0.5 * goes.sum()
    return float((stands & agents).sum() / stands.sum())


def verdict(tables: Any) -> str:
    """The verdict on the poses of the only topic, as the metadata tell it."""
    poses = json.loads(tables.objects.schema.metadata[b"lidarcli.source"])["poses"]
    (found,) = poses["laser"]["pose_verdict"].values()
    return str(found)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_what_stands_is_no_agent(tmp_path: Path, case: Case) -> None:
    scene = scene_of(case)
    raw, entity, _ = simulate_sweep_arrays(scene, scene.sweeps, case.seed)
    if case.timing == "untold":
        nothing = np.zeros_like(raw.time_increment)
        raw = replace(raw, time_increment=nothing, scan_time=nothing)
    tables = {}
    for name, poses in (("unposed", None), ("posed", simulate_odometry(scene, scene.sweeps, case.seed))):
        write_log(tmp_path / f"{name}.mcap", [raw], poses=poses)
        tables[name] = lidarcli.track(tmp_path / f"{name}.mcap")
    assert verdict(tables["unposed"]) == "matched"
    assert verdict(tables["posed"]) == "told"
    hits = entity.astype(np.int64)
    assert share_of_agents(tables["unposed"], scene, hits) <= case.matched
    assert share_of_agents(tables["posed"], scene, hits) <= case.true
    columns = [tables["unposed"].sweeps[name].to_numpy() for name in ("pose_x", "pose_y", "pose_yaw")]
    found = np.column_stack(columns)
    true = scene.path.poses(np.arange(scene.sweeps) / scene.sensor.rate)
    apart = relative(found, found[:1]) - relative(true, true[:1])
    assert np.hypot(apart[:, 0], apart[:, 1]).max() < case.off
    # Where the turn rate jumps during a sweep, its heading is half a degree off, or one.
    assert np.degrees(np.abs(np.sin(apart[:, 2]))).max() < 2.5
