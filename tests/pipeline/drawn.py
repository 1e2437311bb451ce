"""Drawn logs of a robot that drives through a room, with poses that fit its sweeps or do not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.logs import open_log
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.reading.found_poses import find_poses
from lidarcli.pipeline.reading.path_check import check_paths
from lidarcli.pipeline.reading.path_choice import CheckedPath
from lidarcli.ros.messages import ROS1, Outgoing, bag_writer
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, SimulatedPoses, relative, simulate_blocks
from lidarcli.simulation.scene import Odometry, Scene, SceneSensor
from lidarcli.simulation.writers import ROS1_BYTES, outgoing, write_log
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import TURN, Float64, Int64, RawSweeps
from tests.pose.pose_messages import SECOND

SWEEPS = 200
SENSOR = SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.01)
"""A full turn at 10 Hz."""
ROOM = (
    make.wall([[-4.0, -3.0], [4.0, -3.0], [4.0, 3.0], [-4.0, 3.0], [-4.0, -3.0]]),
    make.cylinder(1.5, 0.5, 0.25),
    make.cylinder(-1.0, 1.0, 0.2),
)


@dataclass(frozen=True)
class Drive:
    """A way through the room, by a function from times (S,) [s] to poses (S, 3)."""

    way: Callable[[Float64], Float64]
    parked: bool = False

    def poses(self, seconds: Float64) -> Float64:
        """(S, 3) x, y, yaw."""
        return self.way(seconds)

    def speeds(self, seconds: Float64) -> Float64:
        """(S,) [m/s]."""
        ahead, behind = self.way(seconds + 0.005), self.way(seconds - 0.005)
        return np.hypot(*(ahead - behind)[:, :2].T) / 0.01


def round_about(seconds: Float64) -> Float64:
    """An oval of 1.5 by 1.2 m at 0.4 m/s, with a swaying heading."""
    turn = 0.3 * seconds
    return np.column_stack([1.5 * np.cos(turn), 1.2 * np.sin(turn), turn + 0.5 * np.pi + 0.3 * np.sin(2.0 * seconds)])


def standing(seconds: Float64) -> Float64:
    """The middle of the room."""
    return np.zeros((len(seconds), 3))


def straight(seconds: Float64) -> Float64:
    """Along x at 0.2 m/s."""
    return np.column_stack([0.2 * seconds - 2.0, 0.0 * seconds, 0.0 * seconds])


def scene_of(way: Callable[[Float64], Float64] = round_about, sensor: SceneSensor = SENSOR, **some: Any) -> Scene:
    """The room with its two cylinders, and a robot that goes this way."""
    path: Any = Drive(way, parked=way is standing)
    return Scene("drawn", sensor, ROOM, path, sweeps=SWEEPS, **some)


def sweeps_of(scene: Scene) -> list[RawSweeps]:
    """The sweeps of a scene, one by one, as a recorder takes them."""
    blocks = [block.raw for block in simulate_blocks(scene, scene.sweeps, 0)]
    return [block.rows(slice(k, k + 1)) for block in blocks for k in range(len(block))]


@cache
def driven() -> list[RawSweeps]:
    """The sweeps of a robot that goes round about."""
    return sweeps_of(scene_of())


def stamps(count: int = SWEEPS, step: float = 0.1) -> Int64:
    """(S,) stamps of poses at so many seconds, of which the first is that of the first sweep."""
    return START_NS + np.rint(np.arange(count) * step * SECOND).astype(np.int64)


def told(poses: Float64, stamp_ns: Int64 | None = None, *, tf: bool = False, **some: Any) -> SimulatedPoses:
    """Odometry that tells poses (S, 3) at stamps, of a laser in the middle of the robot."""
    stamp_ns = stamps(len(poses)) if stamp_ns is None else stamp_ns
    still = np.zeros(len(poses))
    return SimulatedPoses(Odometry(tf=tf), "laser", stamp_ns, poses, still, still, **some)


def write(path: Path, poses: SimulatedPoses | None, scene: Scene | None = None) -> Path:
    """Write the sweeps of a scene with these poses."""
    write_log(path, sweeps_of(scene) if scene else driven(), poses=poses)
    return path


def write_two_mounts(path: Path, poses: SimulatedPoses, mount: tuple[float, float, float]) -> Path:
    """Write a ROS 1 bag in which a second static transform says that the laser is elsewhere."""
    messages = list(outgoing(driven(), poses, ROS1_BYTES))
    assert messages[0].topic == "/tf_static"
    data = ROS1_BYTES.mounting(replace(poses, mount=mount))
    messages.insert(1, Outgoing("/tf_static", messages[0].type, START_NS, START_NS, data))
    return write_messages(path, messages)


def write_messages(path: Path, messages: Iterable[Outgoing]) -> Path:
    """Write messages of ROS 1 into a bag."""
    with bag_writer(path, "none") as writer:
        known: dict[str, Any] = {}
        for message in messages:
            if message.topic not in known:
                known[message.topic] = writer.add_connection(message.topic, message.type, typestore=ROS1)
            writer.write(known[message.topic], message.record_ns, message.data)
    return path


def checked(path: Path, **options: Any) -> dict[tuple[str, str], CheckedPath]:
    """The verdicts on the poses of a log, by topic and frame."""
    with open_log(str(path)) as log:
        found = find_poses(log)
        choice = TopicChoice(options.pop("topics", None), log.topics())
        paths, _ = check_paths(log, None if found is None else found.sources, choice, RangeRules(), **options)
        return {sensor: path for (_, sensor), path in paths.items()}


def away(found: Float64, way: Callable[[Float64], Float64]) -> Float64:
    """(S,) distances of poses (S, 3) of the sweeps from the way, both seen from where they begin [m]."""
    true = way(np.arange(len(found)) / SENSOR.rate)
    first = int(np.flatnonzero(np.isfinite(found[:, 0]))[0])
    apart = relative(found, found[[first]]) - relative(true, true[[first]])
    return np.hypot(apart[:, 0], apart[:, 1])
