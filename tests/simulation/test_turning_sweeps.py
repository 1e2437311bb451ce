"""Sweeps that take time: each beam is taken at its own moment, of the world and of the sensor."""

from dataclasses import replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_blocks, simulate_sweep_arrays
from lidarcli.simulation.scene import Course, Motion, Scene, Sensor
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import concatenate

INCREMENT = 0.001
SENSOR = Sensor(beams=91, angle_min=-np.pi / 4, angle_increment=np.pi / 180, time_increment=INCREMENT)
BEARINGS = SENSOR.bearings()
PLATE = make.box(4.0, 0.0, 2.0, 30.0, 0.0, Motion(velocity=(-0.8, 0.0)))
"""Its near side is 3 m ahead at first and comes closer."""


def test_a_moving_plate_is_nearer_to_later_beams():
    raw, entity, _ = simulate_sweep_arrays(Scene("", SENSOR, (PLATE,)), 3)
    times = np.arange(3)[:, None] / 10 + INCREMENT * np.arange(91)
    np.testing.assert_allclose(raw.ranges, (3 - 0.8 * times) / np.cos(BEARINGS), rtol=1e-6)
    assert (entity == 0).all()


def test_a_driving_sensor_sees_a_wall_from_where_it_is():
    wall = make.wall([[5, -30], [5, 30]])
    course = Course(np.array([[0.0, 0.0], [4.0, 0.0]]), speed=1.0)
    raw, _, _ = simulate_sweep_arrays(Scene("", SENSOR, (wall,), course), 3)
    times = np.arange(3)[:, None] / 10 + INCREMENT * np.arange(91)
    np.testing.assert_allclose(raw.ranges, (5 - times) / np.cos(BEARINGS), rtol=1e-6)


def test_who_stands_before_a_parked_sensor_is_seen_alike():
    things = (make.wall([[5, -30], [5, 30]]), make.box(2, 0.3, 0.5, 0.4, 0.3))
    slow, _, _ = simulate_sweep_arrays(Scene("", SENSOR, things), 2)
    instant, _, _ = simulate_sweep_arrays(Scene("", replace(SENSOR, time_increment=0.0), things), 2)
    assert np.array_equal(slow.ranges, instant.ranges)


@pytest.mark.parametrize("jitter", [0, 3])
def test_blocks_change_nothing(jitter):
    sensor = replace(SENSOR, noise=0.01, flicker=0.2, beams_jitter=jitter)
    scene = Scene("", sensor, (PLATE, make.cylinder(2, 1, 0.2)))
    whole, _, _ = simulate_sweep_arrays(scene, 11, seed=2)
    parts = concatenate([block.raw for block in simulate_blocks(scene, 11, seed=2, size=3)])
    assert np.array_equal(parts.ranges, whole.ranges, equal_nan=True)
    assert whole.time_increment is not None
    assert np.array_equal(parts.time_increment, whole.time_increment)
    # A sweep takes as long, whatever the number of beams.
    np.testing.assert_allclose(whole.time_increment * whole.beams, 91 * INCREMENT, rtol=1e-6)


@pytest.mark.parametrize("name", ["log.mcap", "log.bag", "log.csv"])
def test_the_log_tells_how_long_it_takes(tmp_path, name):
    scene = Scene("", SENSOR, (PLATE,))
    for sensor, expected in ((SENSOR, (0.001, 0.1)), (replace(SENSOR, time_increment=0.0), (0.0, 0.0))):
        path = tmp_path / f"{expected[1]}" / name
        path.parent.mkdir()
        write_log(path, [block.raw for block in simulate_blocks(replace(scene, sensor=sensor), 2)])
        if name == "log.csv":
            names, first, _ = (line.split(",") for line in path.read_text().splitlines())
            told = [first[names.index(f"field.{key}")] for key in ("time_increment", "scan_time")]
            assert [float(value) for value in told] == pytest.approx(expected)
            continue
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            for connection, _, data in reader.messages():
                scan = reader.deserialize(data, connection.msgtype)
                assert (scan.time_increment, scan.scan_time) == pytest.approx(expected)
