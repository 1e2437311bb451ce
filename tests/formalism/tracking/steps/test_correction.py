"""What poses are off by is found from what stands, while the sensor moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.formalism.tracking import pose_filter, tracker
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, SceneMount, super_ellipse
from lidarcli.sweeps.types import TURN, SweepBatch, SweepPoses
from tests.formalism.tracking.following import SENSOR, TrackedLog, follow, scene_of, simulated

PARKED_WORLD = (
    make.box(1.5, 0.3, 0.6, 0.4, 0.4),
    make.box(-1.4, -0.5, 0.5, 0.5, 0.1),
    make.cylinder(0.0, 0.0, 0.15),
    make.box(0.2, 3.4, 0.8, 0.4, 0.2),
    make.box(-3.9, 3.2, 0.6, 0.5, 0.9),
    make.box(4.3, -3.2, 0.6, 0.5, 0.5),
)
SWEEPS = 260


def driven(mount: SceneMount, delay: float) -> SweepBatch:
    """A drive around; the log tells poses too late, and of the robot instead of the sensor."""
    sensor = replace(SENSOR, beams=180, angle_increment=TURN / 180, noise=0.005)
    # Fine enough that the heading does not come in steps.
    path = Course(super_ellipse(3.0, 2.2, 2.5, points=36_000), speed=0.8)
    scene = replace(scene_of(*PARKED_WORLD, path=path, sensor=sensor), mount=mount)
    batch = simulated(scene, SWEEPS, poses=False)
    told = path.poses(np.arange(SWEEPS) / sensor.rate - delay)
    return replace(batch, poses=SweepPoses(told[:, 0], told[:, 1], np.unwrap(told[:, 2]), np.zeros(SWEEPS, np.bool_)))


def value_of(told: TrackedLog) -> list[float]:
    return list(told.tracker._followers[0].tracker.pose_error.value)


@pytest.mark.parametrize("delay", [0.1, -0.06])
def test_how_late_poses_are_is_found(delay: float) -> None:
    told = follow(driven(SceneMount(), delay))
    late, ahead, left = value_of(told)
    assert late == pytest.approx(delay, abs=0.025)
    assert abs(ahead) < 0.03
    assert abs(left) < 0.03
    assert len(told.agents) == 0


def test_where_the_sensor_is_on_the_robot_is_found_and_not_taken_for_less() -> None:
    told = follow(driven(SceneMount((0.15, -0.1, 0.0)), 0.0))
    late, ahead, left = value_of(told)
    assert abs(late) < 0.03
    assert (ahead, left) == (pytest.approx(0.15, abs=0.012), pytest.approx(-0.1, abs=0.012))
    assert len(told.agents) == 0


def test_right_poses_are_left_as_they_are() -> None:
    told = follow(driven(SceneMount(), 0.0))
    assert np.abs(value_of(told)).max() < 0.02
    assert len(told.agents) == 0


def test_no_delay_is_longer_than_the_longest() -> None:
    told = follow(driven(SceneMount(), 1.5))
    assert abs(value_of(told)[0]) <= pose_filter.MAX_DELAY


def test_without_poses_nothing_is_learned() -> None:
    assert tracker.WINDOW < SWEEPS
    told = follow(replace(driven(SceneMount(), 0.1), poses=None))
    assert value_of(told) == [0.0, 0.0, 0.0]


def test_a_sensor_that_stands_learns_nothing() -> None:
    batch = simulated(scene_of(*PARKED_WORLD), SWEEPS, poses=True)
    # Of a turn of a body's axes not all is kept account of: no more than a tenth of a millimetre comes from it.
    assert np.abs(value_of(follow(batch))).max() < 1e-4
