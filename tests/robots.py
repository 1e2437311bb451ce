"""Logs of drawn robots that carry several sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lidarcli.ros.messages import Outgoing
from lidarcli.simulation.generate import START_NS
from lidarcli.simulation.scene import Scene, SceneMount, SceneSensor
from lidarcli.sweeps.types import concatenate
from tests.zones.runs import scans, sweeps_of, transform_at, write_bag

Place = tuple[float, float, float]


def wide(degrees: float, rate: float = 10.0) -> SceneSensor:
    """A sensor with so wide a view, and two beams in each degree."""
    half = np.radians(degrees) / 2
    return SceneSensor(
        beams=2 * round(degrees) + 1, angle_min=-half, angle_increment=np.radians(0.5), noise=0.01, rate=rate
    )


class Carried(NamedTuple):
    """A sensor, where it is on the robot, and where the transforms have it."""

    name: str
    place: Place
    sensor: SceneSensor
    off: Place = (0.0, 0.0, 0.0)
    """How far that is from its place."""


CORNERS = (Carried("front", (0.35, 0.25, np.pi / 4), wide(270)), Carried("rear", (-0.35, -0.25, -3 * np.pi / 4), wide(270)))
"""Two sensors at opposite corners."""
SIDES = (
    Carried("front", (0.4, 0.0, 0.0), wide(180)),
    Carried("left", (-0.2, 0.3, 2 * np.pi / 3), wide(180, 15.0)),
    Carried("right", (-0.2, -0.3, -2 * np.pi / 3), wide(180)),
)
"""Three sensors around the robot, of which one is faster."""


def robot_log(
    path: Path, scene: Scene, carried: Sequence[Carried] = CORNERS, *, told: bool = True, odometry: bool = True
) -> Path:
    """Write what the sensors see in a scene, one a third of its period after the other; the scene counts at 10 Hz."""
    return write_bag(path, *robot_messages(scene, carried, told=told, odometry=odometry))


def robot_messages(
    scene: Scene, carried: Sequence[Carried] = CORNERS, space: str = "", *, told: bool = True, odometry: bool = True
) -> list[list[Outgoing]]:
    """The messages of such a log, in a namespace."""
    seconds = scene.sweeps / 10.0
    messages = []
    for number, one in enumerate(carried):
        rate = 3.0 * one.sensor.rate
        sensor = replace(one.sensor, topic=f"{space}/{one.name}", frame_id=one.name, rate=rate)
        seen = replace(scene, sensor=sensor, mount=SceneMount(one.place), sweeps=int(seconds * rate))
        every = concatenate(sweeps_of(seen, number))
        messages.append(scans([every.rows(slice(number % 3, None, 3))]))
        if told:
            place = tuple(here + off for here, off in zip(one.place, one.off, strict=True))
            messages.append([transform_at(START_NS, "base_link", one.name, place, f"{space}/tf_static")])
    if odometry and not scene.path.parked:
        times = np.arange(0.0, seconds + 0.5, 0.05)
        poses = scene.path.poses(times).tolist()
        stamps = [START_NS + round(time * 1e9) for time in times.tolist()]
        messages.append(
            [
                transform_at(at, "odom", "base_link", tuple(pose), f"{space}/tf")
                for at, pose in zip(stamps, poses, strict=True)
            ]
        )
    return messages
