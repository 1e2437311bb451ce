"""What a view says of the sides of a box or the centre of a disc whose place is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.tracking import measurement
from lidarcli.formalism.tracking.measurement import EdgeMeasurement, Measurements
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import SceneSensor
from lidarcli.sweeps.types import TURN
from tests.formalism.tracking.steps.looking import Pose, seen_from

BEAMS = 1440
STEP = TURN / BEAMS
TURNING = SceneSensor(beams=BEAMS, angle_increment=STEP)
CLOCKWISE = SceneSensor(beams=BEAMS, angle_min=math.pi, angle_increment=-STEP)
TWICE = SceneSensor(beams=BEAMS + 1, angle_increment=STEP)
PARTIAL = SceneSensor(beams=1000, angle_min=-500 * STEP, angle_increment=STEP)
ROOM = make.wall([[-6, -6], [6, -6], [6, 6], [-6, 6], [-6, -6]])
LENGTH, WIDTH = 0.8, 0.5
POSES: tuple[Pose, ...] = (
    (0.0, 0.0, 0.0, 1.0),
    (0.4, -0.3, 1.1, 1.0),
    (-0.2, 0.5, math.pi, 1.0),
    (0.0, 0.0, 0.0, -1.0),
    (0.3, 0.2, 2.5, -1.0),
)


def view_at(meas: Measurements, x: float, y: float) -> int:
    """The view of what stands there."""
    far = [math.hypot(meas.middle_x[k] - x, meas.middle_y[k] - y) for k in range(meas.count)]
    assert min(far, default=9.0) < 0.5
    return int(np.argmin(far))


def sides_of(meas: Measurements, k: int, yaw: float) -> tuple[list[float], list[float]]:
    """Where the four sides are along the axes of a box, and their variances."""
    sides = EdgeMeasurement()
    measurement.measure_box(sides, meas, k, math.cos(yaw), math.sin(yaw), 0.0)
    assert not sides.by_centre
    return list(sides.z), list(sides.var)


def true_sides(x: float, y: float, yaw: float) -> list[float]:
    """Where they really are."""
    along, across = math.cos(yaw) * x + math.sin(yaw) * y, math.cos(yaw) * y - math.sin(yaw) * x
    return [along - LENGTH / 2, along + LENGTH / 2, across - WIDTH / 2, across + WIDTH / 2]


def faces_sensor(pose: Pose, x: float, y: float, yaw: float) -> list[bool]:
    """Whether each side of a box looks towards the sensor."""
    true, cos, sin = true_sides(x, y, yaw), math.cos(yaw), math.sin(yaw)
    along, across = cos * pose[0] + sin * pose[1], cos * pose[1] - sin * pose[0]
    return [along < true[0], along > true[1], across < true[2], across > true[3]]


@pytest.mark.parametrize("sensor", [TURNING, CLOCKWISE, TWICE, PARTIAL], ids=["turn", "clockwise", "twice", "part"])
@pytest.mark.parametrize("pose", POSES)
def test_all_sides_that_can_be_known_are_where_they_are(sensor: SceneSensor, pose: Pose) -> None:
    corners = 0
    for bearing in (0.0, 0.9, -1.4, math.pi - 0.05, -math.pi + 0.01):
        if sensor is PARTIAL and abs(bearing) > 1.5:
            continue
        # As the sensor sees it: bearings run clockwise in the world where it hangs head down.
        direction = pose[2] + pose[3] * bearing
        x, y = pose[0] + 2.5 * math.cos(direction), pose[1] + 2.5 * math.sin(direction)
        for turned in (0.0, 0.4, 0.8, 1.2):
            yaw = direction + turned
            meas, _ = seen_from(sensor, pose, ROOM, make.box(x, y, LENGTH, WIDTH, yaw))
            k = view_at(meas, x, y)
            assert (meas.start[k], meas.end[k]) == (measurement.OWN, measurement.OWN)
            z, var = sides_of(meas, k, yaw)
            true, towards = true_sides(x, y, yaw), faces_sensor(pose, x, y, yaw)
            corner = sum(towards) == 2
            corners += corner
            for side in range(4):
                # Of a box seen straight ahead all but the back is seen, of one seen over a corner everything.
                back = not corner and towards[side ^ 1]
                assert (var[side] < 0) == back, (bearing, turned, side)
                if not back:
                    assert abs(z[side] - true[side]) < 4 * math.sqrt(var[side]) < 0.06
                else:
                    # It goes on at least so far, and not further than it does.
                    low, high = sorted((true[side ^ 1], true[side]))
                    assert low - 0.02 < z[side] < high + 0.02
    assert corners >= 6


@pytest.mark.parametrize("pose", POSES)
def test_a_side_behind_something_goes_on_at_least_so_far(pose: Pose) -> None:
    # A post hides the end of the box at smaller bearings of the world.
    direction = pose[2]
    cos, sin = math.cos(direction), math.sin(direction)

    def place(ahead: float, left: float) -> tuple[float, float]:
        return pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left

    x, y = place(3.0, 0.0)
    post = make.cylinder(*place(1.5, -0.17), 0.1)
    meas, _ = seen_from(TURNING, pose, ROOM, make.box(x, y, WIDTH, LENGTH, direction), post)
    k = view_at(meas, *place(2.75, 0.1))
    edges = {meas.start[k], meas.end[k]}
    assert edges == {measurement.HIDDEN, measurement.OWN}
    assert measurement.is_partial(meas, k)
    # The axes of the sensor: behind is not seen, and what the post hides neither.
    sides = EdgeMeasurement()
    measurement.measure_box(sides, meas, k, cos, sin, 0.0)
    origin = cos * x + sin * y, cos * y - sin * x
    assert sides.var[0] > 0
    assert sides.z[0] == pytest.approx(origin[0] - WIDTH / 2, abs=0.01)
    assert sides.var[1] < 0
    assert sides.var[2] < 0
    assert origin[1] - LENGTH / 2 + 0.05 < sides.z[2] < origin[1]
    assert sides.var[3] > 0
    assert sides.z[3] == pytest.approx(origin[1] + LENGTH / 2, abs=0.02)


@pytest.mark.parametrize("sensor", [TURNING, CLOCKWISE, TWICE], ids=["turn", "clockwise", "twice"])
@pytest.mark.parametrize("pose", POSES)
def test_the_centre_of_a_disc_is_behind_what_is_seen_of_it(sensor: SceneSensor, pose: Pose) -> None:
    for bearing in (0.3, -2.0, math.pi - 0.01):
        direction = pose[2] + pose[3] * bearing
        x, y = pose[0] + 2.0 * math.cos(direction), pose[1] + 2.0 * math.sin(direction)
        meas, _ = seen_from(sensor, pose, ROOM, make.cylinder(x, y, 0.15))
        k = view_at(meas, x, y)
        for shape in (measurement.ROUND, measurement.detection.IRREGULAR):
            # By its circle, and by its edges alone.
            meas.shape[k] = shape
            sides = EdgeMeasurement()
            measurement.measure_disc(sides, meas, k, 0.0, measurement.AT_LEAST, 0.0)
            assert sides.by_centre
            for at, true in ((0, x), (2, y)):
                assert abs(sides.z[at] - true) < 0.02
                assert 0 < sides.var[at] < 0.01
            assert sides.half == pytest.approx(0.15, abs=0.02)
            assert sides.half_var > 0
