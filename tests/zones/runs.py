"""Logs of simulated scenes for zones: several sensors, mounts, velocities and polygons, and what is found in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import lidarcli
from lidarcli.pipeline.zones.summary import ZoneTables
from lidarcli.ros.messages import Outgoing
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, SimulatedPoses, simulate_blocks, simulate_odometry
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Course, Entity, Scene, SceneMotion, SceneSensor
from lidarcli.simulation.writers import ROS1_BYTES, outgoing
from lidarcli.sweeps.types import TURN, Float64, Int64, RawSweeps
from lidarcli.tabular.schemas import SCHEMAS
from tests.pipeline.drawn import write_messages
from tests.pose.pose_messages import Maker
from tests.zones.test_velocities import polygon, twist

ROS1_MAKER = Maker("ros1")
SENSOR = SceneSensor(beams=720, angle_increment=TURN / 720, noise=0.005, range_max=30.0)
"""A full turn at 10 Hz."""
ROOM = (make.wall([[-8.0, -8.0], [8.0, -8.0], [8.0, 8.0], [-8.0, 8.0], [-8.0, -8.0]]),)
PARKED = Course(np.zeros((1, 2)))


def walk(*points: Sequence[float], speed: float = 1.0) -> SceneMotion:
    """A motion through points, with its turns taken standing."""
    route = plan_route(
        [Waypoint(x, y, speed, 0.0, "stop") for x, y in points],
        acceleration=4.0,
        turn_rate=TURN / 2,
        corner_radius=0.3,
        loop=False,
    )
    return SceneMotion(route=route)


def walker(*points: Sequence[float], speed: float = 1.0) -> Entity:
    return make.person(*points[0], motion=walk(*points, speed=speed))


def scene_of(
    *entities: Entity, sensor: SceneSensor = SENSOR, sweeps: int = 100, room: Sequence[Entity] = ROOM, **more: Any
) -> Scene:
    return Scene("drawn", sensor, (*room, *entities), sweeps=sweeps, **({"path": PARKED} | more))


def sweeps_of(scene: Scene, seed: int = 0, **columns: Any) -> list[RawSweeps]:
    blocks = [block.raw for block in simulate_blocks(scene, scene.sweeps, seed)]
    return [replace(block, **columns) for block in blocks]


def times_of(scene: Scene) -> Int64:
    """(S,) stamps of the sweeps."""
    return START_NS + np.rint(np.arange(scene.sweeps) / scene.sensor.rate * 1e9).astype(np.int64)


def where(entity: Entity, scene: Scene) -> Float64:
    """(S, 2) true places of an entity."""
    x, y, _ = entity.motion.route.poses(np.arange(scene.sweeps) / scene.sensor.rate).T
    return np.column_stack([x, y])


def scans(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None, record_after_ns: int = 0) -> list[Outgoing]:
    """Messages of sweeps and poses, recorded so long after their stamps."""
    return [each._replace(record_ns=each.record_ns + record_after_ns) for each in outgoing(blocks, poses, ROS1_BYTES)]


def odometry_of(scene: Scene) -> SimulatedPoses | None:
    return simulate_odometry(scene, scene.sweeps)


def twists(stamps: Iterable[int], velocity: Sequence[float], topic: str = "/cmd_vel") -> list[Outgoing]:
    data = twist(ROS1_MAKER, *velocity)
    return [Outgoing(topic, "geometry_msgs/msg/Twist", int(at), int(at), data) for at in stamps]


def polygon_at(stamp_ns: int, frame: str, corners: list[tuple[float, float]], topic: str) -> Outgoing:
    data = polygon(ROS1_MAKER, stamp_ns, frame, corners)
    return Outgoing(topic, "geometry_msgs/msg/PolygonStamped", stamp_ns, stamp_ns, data)


def transform_at(stamp_ns: int, parent: str, child: str, pose: tuple[float, ...], topic: str = "/tf_static") -> Outgoing:
    data = ROS1_MAKER.transforms((stamp_ns, parent, child, pose))
    return Outgoing(topic, "tf2_msgs/msg/TFMessage", stamp_ns, stamp_ns, data)


def write_bag(path: Path, *messages: Iterable[Outgoing]) -> Path:
    """Write messages in the order of their recording into a ROS 1 bag."""
    return write_messages(path, sorted((one for each in messages for one in each), key=lambda one: one.record_ns))


def zone_file(folder: Path, text: str, name: str = "zones.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def watched(log: Path, zones: str, **options: Any) -> ZoneTables:
    """The tables of zones (TOML) over a log."""
    return sound(lidarcli.zones(log, zones=str(zone_file(log.parent, zones)), **options))


PLACE = ("nearest", "bearing", "x", "y")


def sound(tables: ZoneTables) -> ZoneTables:
    """Assert what is so in all tables of a log."""
    for name, table in tables._asdict().items():
        assert table.schema.equals(SCHEMAS[name])
        table.validate(full=True)
        for field in SCHEMAS[name]:
            assert field.nullable or not table[field.name].null_count, field.name
    events = tables.events.to_pylist()
    assert [event["event"] for event in events] == [*range(1, len(events) + 1)]
    assert [event["start"] for event in events] == sorted(event["start"] for event in events)
    active: Counter[str] = Counter()
    for event in events:
        assert event["start"] <= event["end"]
        lasts = (event["end"] - event["start"]).total_seconds()
        assert event["duration"] == pytest.approx(lasts, abs=1e-6)
        known = {event[name] is not None for name in PLACE}
        assert known == {event["points"] > 0 if event["kind"] == "stop" else event["kind"] not in ("stale", "nav2")}
        assert (event["direction"] is not None) == (event["kind"] == "crossing")
        assert (event["points"] is not None) == (event["kind"] in ("occupied", "approach", "stop"))
        assert (event["ttc"] is not None) <= (event["kind"] == "approach")
        assert (event["track"] is not None) <= (event["set"] in ("A", "O"))
    for row in tables.zones.to_pylist():
        assert (row["nearest"] is None) == (row["points"] == 0)
        assert row["observed"] or row["points"] < 4 or not row["active"]
        active[row["zone"]] += row["active"]
    occupied = {event["zone"] for event in events if event["kind"] in ("occupied", "approach")}
    assert {zone for zone, count in active.items() if count} == occupied
    return tables


def rows(table: pa.Table, **chosen: Any) -> list[dict[str, Any]]:
    """The rows of a table that have some values."""
    return [row for row in table.to_pylist() if all(row[name] == value for name, value in chosen.items())]


def column(table: pa.Table, name: str, **chosen: Any) -> list[Any]:
    return [row[name] for row in rows(table, **chosen)]
