"""Sweeps of a scene: the sensor's faults, beams that flicker, sweeps that take time, and odometry."""

from dataclasses import replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, simulate_blocks, simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Course, Odometry, Scene, SceneMotion, SceneMount, SceneSensor
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import concatenate

ROOM = (make.wall([[-3, -3], [3, -3], [3, 3], [-3, 3], [-3, -3]]),)
HALF = (make.wall([[3, -30], [3, 30]]),)


def scene(entities=ROOM, **sensor):
    return Scene("test", replace(SceneSensor(), **sensor), entities)


def test_a_perfect_sensor_reports_the_geometry():
    raw, entity, things = simulate_sweep_arrays(scene(), 3)
    bearing = np.radians(np.arange(-180, 181))
    expected = 3 / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))
    np.testing.assert_allclose(raw.ranges, np.tile(expected, (3, 1)), rtol=1e-6)
    assert (entity == 0).all()
    assert things == ROOM
    assert raw.stamp_ns.tolist() == [START_NS, START_NS + 100_000_000, START_NS + 200_000_000]
    assert raw.beams.tolist() == [361] * 3
    assert raw.frame_ids == ("laser",)


@pytest.mark.parametrize(
    ("lost_as", "value"), [("inf", np.inf), ("nan", np.nan), ("zero", 0.0), ("max", 12.0), ("mixed", np.inf)]
)
def test_where_nothing_is_the_sensor_says_so_in_its_way(lost_as, value):
    raw, entity, _ = simulate_sweep_arrays(scene(HALF, lost_as=lost_as, angle_min=-np.pi), 1)
    behind = raw.ranges[0, 0]
    assert np.array_equal(behind, np.float32(value), equal_nan=True)
    assert entity[0, 0] == -1
    assert raw.ranges[0, 180] == 3.0


def test_what_is_too_close_is_minus_infinity():
    raw, entity, _ = simulate_sweep_arrays(scene((make.cylinder(0.1, 0, 0.05),)), 1)
    assert raw.ranges[0, 180] == -np.inf
    assert entity[0, 180] == -1


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("jitter", [0, 3])
def test_neither_blocks_nor_the_length_of_the_run_change_a_sweep(moving, jitter):
    motion = SceneMotion(velocity=(0.2, 0.1)) if moving else SceneMotion()
    things = (*HALF, make.box(1.5, 0, 0.4, 0.3, 0.2, motion))
    faulty = scene(things, noise=0.01, lost=0.05, mixed_pixels=0.5, beams_jitter=jitter)
    whole, entity, _ = simulate_sweep_arrays(faulty, 20, seed=5)
    for size in (1, 7):
        blocks = list(simulate_blocks(faulty, 13, seed=5, size=size))
        joined = concatenate([block.raw for block in blocks])
        width = joined.ranges.shape[1]
        assert np.array_equal(joined.ranges, whole.ranges[:13, :width], equal_nan=True)
        assert np.array_equal(joined.angle_increment, whole.angle_increment[:13])
        owners = [np.pad(b.entity, ((0, 0), (0, width - b.entity.shape[1])), constant_values=-1) for b in blocks]
        assert np.array_equal(np.concatenate(owners), entity[:13, :width])


def test_changing_beam_counts_keep_the_view():
    raw, entity, _ = simulate_sweep_arrays(scene(beams=360, beams_jitter=4), 50)
    assert raw.beams.min() == 356
    assert raw.beams.max() == 364
    np.testing.assert_allclose(raw.angle_increment * raw.beams, np.radians(1) * 360, rtol=1e-6)
    padding = np.arange(raw.ranges.shape[1]) >= raw.beams[:, None]
    assert np.isnan(raw.ranges[padding]).all()
    assert (entity[padding] == -1).all()
    assert (entity[~padding] == 0).all()


def test_mixed_pixels_lie_between_the_surfaces_and_belong_to_nobody():
    things = (*ROOM, make.box(1.5, 0, 0.4, 0.4))
    clean, owner, _ = simulate_sweep_arrays(scene(things), 1)
    raw, entity, _ = simulate_sweep_arrays(scene(things, mixed_pixels=1.0), 1)
    changed = np.flatnonzero(raw.ranges[0] != clean.ranges[0])
    edges = np.flatnonzero(owner[0] == 1)[[0, -1]]
    assert changed.tolist() == edges.tolist()
    assert ((raw.ranges[0, edges] > clean.ranges[0, edges]) & (raw.ranges[0, edges] < 3.1)).all()
    assert (entity[0, edges] == -1).all()


LONG_ROOM = make.wall([[-8, -2], [8, -2], [8, 2], [-8, 2], [-8, -2]])
FLICKERING = SceneSensor(beams=720, angle_increment=2 * np.pi / 720, flicker=0.2)


def gone_of(sensor, things=(LONG_ROOM,), sweeps=200, seed=0):
    raw, entity, _ = simulate_sweep_arrays(Scene("", sensor, things), sweeps, seed)
    gone = ~np.isfinite(raw.ranges)
    assert (entity[gone] == -1).all()
    assert (entity[~gone] >= 0).all()
    return gone


@pytest.mark.parametrize("share", [0.05, 0.2, 0.6])
def test_so_many_as_wanted_in_every_sweep(share):
    gone = gone_of(replace(FLICKERING, flicker=share))
    assert gone.mean() == pytest.approx(share, rel=0.03)


def test_only_what_would_return_counts():
    # Half of the view holds nothing: of the other half, a fifth flickers.
    wall = make.wall([[2, -300], [2, 300]])
    gone = gone_of(replace(FLICKERING, range_max=500.0), (wall,))
    bearing = np.abs(FLICKERING.bearings)
    assert gone[:, bearing > np.pi / 2].all()
    assert gone[:, bearing < 1.55].mean() == pytest.approx(0.2, rel=0.05)


def test_far_beams_flicker_more_than_near_ones():
    quiet = replace(FLICKERING, flicker=0.0)
    raw, _, _ = simulate_sweep_arrays(Scene("", quiet, (LONG_ROOM,)), 1)
    ratio = []
    for seed in range(20):
        gone = gone_of(FLICKERING, sweeps=20, seed=seed)
        ratio.append((gone[:, raw.ranges[0] > 6].mean(), gone[:, raw.ranges[0] < 3].mean()))
    far, near = np.mean(ratio, axis=0)
    assert far > 2.5 * near


def test_dark_things_flicker_more():
    things = [make.cylinder(3 * np.cos(a), 3 * np.sin(a), 0.5) for a in np.arange(8) * np.pi / 4]
    _, entity, _ = simulate_sweep_arrays(Scene("", replace(FLICKERING, flicker=0.0), tuple(things)), 1)
    gone = gone_of(FLICKERING, tuple(things), seed=3)
    shares = [gone[:, entity[0] == number].mean() for number in range(8)]
    assert max(shares) > 2 * np.median(shares)


INCREMENT = 0.001
TURNING = SceneSensor(beams=91, angle_min=-np.pi / 4, angle_increment=np.pi / 180, time_increment=INCREMENT)
BEARINGS = TURNING.bearings
PLATE = make.box(4.0, 0.0, 2.0, 30.0, 0.0, SceneMotion(velocity=(-0.8, 0.0)))
"""Its near side is 3 m ahead at first and comes closer."""


def test_a_moving_plate_is_nearer_to_later_beams():
    raw, entity, _ = simulate_sweep_arrays(Scene("", TURNING, (PLATE,)), 3)
    times = np.arange(3)[:, None] / 10 + INCREMENT * np.arange(91)
    np.testing.assert_allclose(raw.ranges, (3 - 0.8 * times) / np.cos(BEARINGS), rtol=1e-6)
    assert (entity == 0).all()


def test_a_driving_sensor_sees_a_wall_from_where_it_is():
    wall = make.wall([[5, -30], [5, 30]])
    course = Course(np.array([[0.0, 0.0], [4.0, 0.0]]), speed=1.0)
    raw, _, _ = simulate_sweep_arrays(Scene("", TURNING, (wall,), course), 3)
    times = np.arange(3)[:, None] / 10 + INCREMENT * np.arange(91)
    np.testing.assert_allclose(raw.ranges, (5 - times) / np.cos(BEARINGS), rtol=1e-6)


def test_who_stands_before_a_parked_sensor_is_seen_alike():
    things = (make.wall([[5, -30], [5, 30]]), make.box(2, 0.3, 0.5, 0.4, 0.3))
    slow, _, _ = simulate_sweep_arrays(Scene("", TURNING, things), 2)
    instant, _, _ = simulate_sweep_arrays(Scene("", replace(TURNING, time_increment=0.0), things), 2)
    assert np.array_equal(slow.ranges, instant.ranges)


@pytest.mark.parametrize("jitter", [0, 3])
def test_blocks_of_turning_sweeps_change_nothing(jitter):
    sensor = replace(TURNING, noise=0.01, flicker=0.2, beams_jitter=jitter)
    of_plate = Scene("", sensor, (PLATE, make.cylinder(2, 1, 0.2)))
    whole, _, _ = simulate_sweep_arrays(of_plate, 11, seed=2)
    parts = concatenate([block.raw for block in simulate_blocks(of_plate, 11, seed=2, size=3)])
    assert np.array_equal(parts.ranges, whole.ranges, equal_nan=True)
    assert whole.time_increment is not None
    assert np.array_equal(parts.time_increment, whole.time_increment)
    # A sweep takes as long, whatever the number of beams.
    np.testing.assert_allclose(whole.time_increment * whole.beams, 91 * INCREMENT, rtol=1e-6)


@pytest.mark.parametrize("name", ["log.mcap", "log.bag", "log.csv"])
def test_the_log_tells_how_long_it_takes(tmp_path, name):
    of_plate = Scene("", TURNING, (PLATE,))
    for sensor, expected in ((TURNING, (0.001, 0.1)), (replace(TURNING, time_increment=0.0), (0.0, 0.0))):
        path = tmp_path / f"{expected[1]}" / name
        path.parent.mkdir()
        write_log(path, [block.raw for block in simulate_blocks(replace(of_plate, sensor=sensor), 2)])
        if name == "log.csv":
            names, first, _ = (line.split(",") for line in path.read_text().splitlines())
            told = [first[names.index(f"field.{key}")] for key in ("time_increment", "scan_time")]
            assert [float(value) for value in told] == pytest.approx(expected)
            continue
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            for connection, _, data in reader.messages():
                scan = reader.deserialize(data, connection.msgtype)
                assert (scan.time_increment, scan.scan_time) == pytest.approx(expected)


CORNER = plan_route([Waypoint(0, 0, 0.5), Waypoint(3, 0, 0.5), Waypoint(3, 3, 0.5)])
DRIVEN = Scene("", SceneSensor(), (make.wall([[9, -30], [9, 30]]),), CORNER, Odometry())


@pytest.mark.parametrize("delay", [0.0, 0.15, -0.15])
def test_late_stamps_tell_where_the_robot_was(delay):
    rows = simulate_odometry(replace(DRIVEN, odometry=Odometry(delay=delay)), 100)
    assert rows is not None
    true = (rows.stamp_ns - START_NS) / 1e9 - delay
    np.testing.assert_allclose(rows.poses, CORNER.poses(true), atol=1e-9)
    np.testing.assert_allclose(rows.speed, CORNER.speeds(true), atol=1e-6)
    # Every sweep has a pose before and after it, as far as the robot can know.
    assert rows.stamp_ns[0] <= START_NS
    assert rows.stamp_ns[-1] >= START_NS + 9_900_000_000
    assert len(rows) == 100 + (2 if delay else 0)


def test_a_mounted_laser_sees_from_its_own_place():
    mount = SceneMount((0.3, -0.1, np.pi / 2))
    scene = replace(DRIVEN, mount=mount)
    seconds = np.array([0.0, 2.0, 30.0])
    # The robot heads along +x at first, and along +y, from (3, 3), at the end.
    poses = scene.sensor_poses(seconds)
    np.testing.assert_allclose(poses[0], [0.3, -0.1, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(poses[2], [3.1, 3.3, np.pi], atol=1e-9)
    raw, _, _ = simulate_sweep_arrays(scene, 1)
    # The wall at x = 9 lies to the right of a laser that looks along +y.
    assert raw.ranges[0, 90] == pytest.approx(9 - 0.3, rel=1e-6)


def test_the_log_tells_the_mount_or_not():
    told, kept = (simulate_odometry(replace(DRIVEN, mount=SceneMount((0.3, -0.1, 0.2), told)), 3) for told in (True, False))
    assert told is not None
    assert kept is not None
    assert told.mount == (0.3, -0.1, 0.2)
    assert kept.mount == (0.0, 0.0, 0.0)
    assert np.array_equal(told.poses, kept.poses)
