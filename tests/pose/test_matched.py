"""The way of a sensor from its sweeps alone, on simulated loops whose true way is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from lidarcli.options.times import SECOND_NS
from lidarcli.pose.matched import MatchedPath
from lidarcli.pose.tracks import PoseTrack, planar
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, simulate_blocks
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Scene, SceneMotion, SceneSensor, load_scene
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Float64, Int64, SweepBatch, concatenate
from tests.places import SAMPLES

SENSOR = SceneSensor(noise=0.01, lost=0.005, mixed_pixels=0.3, range_max=8.0)


def unplaced(path: MatchedPath) -> int:
    """The sweeps without a pose."""
    return int(np.isnan(path.poses[:, 0]).sum())


def slab(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """A thick piece of wall, as a polyline."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def building(sensor: SceneSensor = SENSOR, sweeps: int = 300) -> Scene:
    """A loop of 24 m around a core, with niches and things along the walls, and three people who walk there."""
    walls = [slab(2, 2, 6, 4), slab(-0.8, -0.8, 8.8, -1.0), slab(-0.8, 6.8, 8.8, 7.0)]
    walls += [slab(-0.8, -1, -1, 2.6), slab(-0.8, 3.6, -1, 7), slab(8.8, -1, 9, 4.2), slab(8.8, 5.2, 9, 7)]
    walls += [slab(-4, 2, -1, 2.2), slab(-4, 4, -1, 4.2), slab(-4, 2.2, -4.2, 4), slab(3.2, -0.8, 3.6, -0.5)]
    walls += [slab(1.2, 1.2, 2, 2), slab(6, 4, 6.8, 4.8), slab(6, 1.2, 6.8, 2), slab(1.2, 4, 2, 4.8)]
    things = [make.box(4.6, 6.5, 0.9, 0.4), make.cylinder(8.4, 0.4, 0.2), make.box(10.5, 4.6, 0.5, 2.0, 0.3)]
    people = []
    for number, speed in enumerate((0.6, 0.9, 1.1)):
        ring = [Waypoint(x, y, speed) for x, y in ((-0.4, -0.4), (8.3, -0.4), (8.3, 6.2), (-0.4, 6.2))]
        ring = ring[number + 1 :] + ring[: number + 1]
        route = plan_route(ring if number % 2 else ring[::-1], loop=True, corner_radius=0.3)
        people.append(make.person(ring[0].x, ring[0].y, motion=SceneMotion(route=route)))
    stops = [Waypoint(x, y, 0.9) for x, y in ((4.0, 0.3), (7.6, 0.3), (7.6, 5.6), (0.3, 5.6), (0.3, 0.3))]
    path = plan_route(stops, loop=True, corner_radius=0.6, turn_rate=np.radians(60), acceleration=0.8)
    entities = (*(make.wall(np.array(wall, float)) for wall in walls), *things, *people)
    return Scene("building", sensor, entities, path, sweeps=sweeps)


def simulated(scene: Scene, seed: int = 0) -> tuple[SweepBatch, Float64]:
    """All sweeps of a scene, and (S, 3) where the sensor truly was."""
    blocks = list(simulate_blocks(scene, scene.sweeps, seed))
    raw = concatenate([block.raw for block in blocks])
    batch = normalise(raw, np.arange(len(raw)), RangeRules())
    return batch, np.vstack([block.poses for block in blocks])


def cut(batch: SweepBatch, size: int) -> Iterator[SweepBatch]:
    """The same sweeps in batches of at most `size`."""
    for first in range(0, len(batch), size):
        yield batch.rows(np.arange(first, min(first + size, len(batch))))


def matched(batch: SweepBatch, size: int = 1000) -> PoseTrack:
    """The way that the sweeps of a batch tell."""
    matching = MatchedPath()
    for part in cut(batch, size):
        matching.add(part)
    track = matching.track("/scan", "laser")
    assert track is not None
    return track


def errors(track: PoseTrack, stamp_ns: Int64, true: Float64) -> tuple[Float64, Float64]:
    """How far off [m], [rad] the way is at each stamp, seen from where the first sweep was taken."""
    poses = planar(track.at(stamp_ns))
    cos, sin = np.cos(true[0, 2]), np.sin(true[0, 2])
    x, y = (true[:, :2] - true[0, :2]).T
    away = np.hypot(poses.x - (cos * x + sin * y), poses.y - (cos * y - sin * x))
    turned: Float64 = (poses.yaw - (true[:, 2] - true[0, 2]) + np.pi) % TURN - np.pi
    return away, turned


def rms(values: Float64) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.square(values).mean()))


def same(first: PoseTrack, second: PoseTrack) -> bool:
    """Whether two tracks are equal, bit by bit."""
    pairs = zip((first.stamp_ns, *first.motion), (second.stamp_ns, *second.motion), strict=True)
    return all(a.tobytes() == b.tobytes() for a, b in pairs)


def test_a_loop_through_a_building_is_5_cm_from_the_truth() -> None:
    batch, true = simulated(building())
    track = matched(batch)
    assert (track.topic, track.parent, track.child) == ("/scan", "match", "laser")
    assert not track.static
    assert track.messages == len(track.stamp_ns) == len(batch)
    assert track.motion.position[0].tolist() == [0.0, 0.0, 0.0]
    assert track.motion.rotation[0].tolist() == [0.0, 0.0, 0.0, 1.0]
    away, turned = errors(track, batch.stamp_ns, true)
    assert np.hypot(*np.diff(true[:, :2], axis=0).T).sum() > 20
    assert rms(away) < 0.05
    assert away.max() < 0.12
    assert rms(turned) < np.radians(0.5)


def test_two_runs_and_any_cut_into_batches_give_the_same_bits() -> None:
    batch, _ = simulated(building(sweeps=60))
    whole = matched(batch)
    assert same(whole, matched(batch))
    assert same(whole, matched(batch, 1))
    assert same(whole, matched(batch, 7))


@pytest.mark.parametrize("backwards", [False, True])
def test_sweeps_that_take_time_are_told_at_their_header_stamp(backwards: bool) -> None:
    scene = load_scene(SAMPLES / "drive.toml")
    sensor = replace(scene.sensor, rate=10.0, time_increment=0.1 / 360)
    batch, true = simulated(replace(scene, sensor=sensor, sweeps=200))
    assert batch.duration == pytest.approx(0.1)
    if backwards:
        # The same beams, told from the last to the first.
        last_ns = batch.stamp_ns + SECOND_NS // 10
        batch = replace(
            batch,
            ranges=batch.ranges[:, ::-1].copy(),
            status=batch.status[:, ::-1].copy(),
            angle_min=batch.angle_min + 360 * batch.angle_increment,
            angle_increment=-batch.angle_increment,
            duration=np.full(len(batch), -0.1),
            stamp_ns=last_ns,
        )
        true = scene.sensor_poses((last_ns - START_NS) / 1e9)
    away, turned = errors(matched(batch), batch.stamp_ns, true)
    assert rms(away) < 0.05
    assert rms(turned) < np.radians(0.3)
    # Taken for instants the sweeps lead elsewhere.
    instant, _ = errors(matched(replace(batch, duration=None)), batch.stamp_ns, true)
    assert rms(instant) > rms(away)


def test_sweeps_that_say_nothing_have_no_pose() -> None:
    batch, true = simulated(building(sweeps=40))
    batch.ranges[10:13] = np.nan
    batch.ranges[20, 1:] = np.nan
    matching = MatchedPath()
    matching.add(batch)
    track = matching.track("/scan", "laser")
    assert track is not None
    assert unplaced(matching) == 4
    assert sorted({*batch.stamp_ns.tolist()} - {*track.stamp_ns.tolist()}) == (batch.stamp_ns[[10, 11, 12, 20]].tolist())
    away, _ = errors(track, batch.stamp_ns, true)
    assert away.max() < 0.1


def test_after_a_gap_in_another_place_the_map_begins_anew() -> None:
    batch, _ = simulated(building(sweeps=40))
    there, _ = simulated(replace(load_scene(SAMPLES / "corridor.toml"), sensor=SENSOR, sweeps=40))
    later = replace(there, stamp_ns=there.stamp_ns + 60 * SECOND_NS, topic=batch.topic)
    matching = MatchedPath()
    matching.add(batch)
    before = matching.track("/scan", "laser")
    matching.add(later)
    track = matching.track("/scan", "laser")
    assert before is not None
    assert track is not None
    assert matching.restarts == 1
    assert unplaced(matching) == 9
    gone = track.motion.position[len(before.stamp_ns)] - before.motion.position[-1]
    assert np.hypot(*gone[:2]) == 0.0
