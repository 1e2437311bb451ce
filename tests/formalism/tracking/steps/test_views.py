"""Each object of a sweep that takes time is seen from where the sensor was when it came to it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.tracking import measurement
from lidarcli.formalism.tracking.measurement import Measurements
from lidarcli.simulation import scene as make
from lidarcli.sweeps.types import SweepBatch
from tests.formalism.tracking.steps.looking import Pose, look_at
from tests.going import SENSORS, Drive, seen_going

ROOM = make.wall([[-6, -6], [6, -6], [6, 6], [-6, 6], [-6, -6]])
RADIUS = 0.25
PLACES = ((2.5, 0.6), (0.5, 2.4), (0.3, -2.6), (-1.5, 1.9))
"""Where columns stand; all but the last also where a sensor looks that sees no full turn."""
THINGS = tuple(make.cylinder(x, y, RADIUS) for x, y in PLACES)
DRIVES = {
    "ahead": Drive((0.1, -0.2, 0.0), (1.0, 0.0, 0.0)),
    "turning": Drive((0.0, 0.0, 0.1), (0.0, 0.0, math.radians(60))),
    "both": Drive((-0.1, 0.1, -0.2), (0.8, 0.6, math.radians(-90))),
}


@pytest.fixture(params=[False, True], ids=["upright", "head down"])
def hangs(request: pytest.FixtureRequest) -> bool:
    """Whether the sensor hangs head down."""
    return bool(request.param)


def detections(drive: Drive, sensor: str, hangs: bool, *things: Any) -> tuple[Measurements, SweepBatch]:
    batch = seen_going(SENSORS[sensor], drive, ROOM, *(things or THINGS), upside_down=hangs)
    return looked(batch, hangs), batch


def looked(batch: SweepBatch, hangs: bool) -> Measurements:
    """The objects of a sweep that tells of its own poses."""
    assert batch.poses is not None
    assert batch.poses.way is not None
    x, y, yaw = (float(values[0]) for values in (batch.poses.x, batch.poses.y, batch.poses.yaw))
    pose: Pose = (x, y, yaw, -1.0 if hangs else 1.0)
    way = batch.poses.way[0].tolist()
    return look_at(batch, pose, way=(way[0], way[1], way[2]))[0]


def at(measurements: Measurements, x: float, y: float) -> int:
    """The view of what stands there."""
    far = [math.hypot(measurements.middle_x[k] - x, measurements.middle_y[k] - y) for k in range(measurements.count)]
    assert min(far, default=9.0) < 0.5
    return int(np.argmin(far))


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("drive", DRIVES)
def test_a_place_of_the_world_lies_where_the_beams_found_it(drive: str, sensor: str, hangs: bool) -> None:
    measurements, batch = detections(DRIVES[drive], sensor, hangs)
    bearings = batch.bearings[0]
    for x, y in PLACES[: 3 if sensor == "part of a turn" else 4]:
        k = at(measurements, x, y)
        ahead, left = measurement.to_sensor(measurements, measurements.middle_x[k], measurements.middle_y[k])
        beam = measurements.share[k] * (batch.beams[0] - 1)
        off = math.remainder(math.atan2(left, ahead) - float(np.interp(beam, np.arange(len(bearings)), bearings)), math.tau)
        assert abs(off) < 3 * abs(batch.angle_increment[0])
        # And it is as far away as its nearest point and a bit.
        assert 0.0 < math.hypot(ahead, left) - measurements.near[k] < RADIUS
        # Afterwards the sensor stands at its start again.
        assert (measurements.x, measurements.y) == DRIVES[drive].start[:2]


def test_a_sensor_that_stays_takes_one_stand_alone() -> None:
    still = Drive((0.3, 0.2, 0.4), (0.0, 0.0, 0.0))
    measurements, batch = detections(still, "full turn", False)
    assert not measurements.moves
    assert batch.duration is not None
    for x, y in PLACES:
        k = at(measurements, x, y)
        assert 0.0 < measurements.share[k] < 1.0
        ahead, left = measurement.to_sensor(measurements, x, y)
        turned = measurement.to_world(measurements, ahead, left)
        assert turned == pytest.approx((x, y), abs=1e-12)
