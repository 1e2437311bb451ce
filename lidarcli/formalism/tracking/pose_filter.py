"""Recursive least squares of the error of the poses of the sensor, by the sides of static targets.

A pose with a stamp that is too late shifts every static object by the speed of the sensor times the delay; one of another
point of the robot shifts it as the robot turns. Both are linear in three numbers: the delay, and the place of the sensor
ahead and to the left. The estimate corrects the poses from then on.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism.tracking import results
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.measurement import Measurements
from lidarcli.system import native

LIVE = results.LIVE
DELAY, AHEAD, LEFT = 0, 1, 2
"""Places of the three numbers of a correction."""
DELAY_SD, PLACE_SD = 0.2, 0.1
"""[s], [m] Standard deviations of the delay and of the place of the sensor at first."""
MOUNT_VAR, MOUNT_TURN_VAR = 1e-4, 7.6e-5
"""[m²], [rad²] Variances of the place and of the heading of each of several sensors on a robot: (1 cm)², (0.5 degrees)²."""
MIN_DELAY_VAR, MIN_PLACE_VAR = 1e-4, 1e-5
"""[s²], [m²] Least variances of the delay, (10 ms)², and of the place of the sensor."""
MAX_POSE_RESIDUAL, POSE_SIDE_VAR, MAX_DELAY = 9.0, 1e-4, 0.4
"""Error of the poses: greatest squared residual, as a multiple of its variance, as a larger one is that of a target that
moves; variance that is added to each side, because sightings depend on each other [m²]: (1 cm)²; greatest delay [s]."""


class PoseErrorFilter:
    """Estimated error of the poses, and the motion of the sensor at the current sweep.

    Of several sensors that are followed together the delay alone is estimated: each may have a place of its own.
    """

    def __init__(self, sensors: int = 1) -> None:
        self.owner: list[Any] = []
        self.sensors = sensors
        self.value = native.doubles(self.owner, 3)
        """Delay of the poses [s], and place of the sensor ahead and left of its poses [m]."""
        self.cov = native.doubles(self.owner, 9)
        self.cov[0] = DELAY_SD * DELAY_SD
        self.cov[4] = self.cov[8] = PLACE_SD * PLACE_SD
        self.last = native.doubles(self.owner, 3 * sensors)
        """Pose of each sensor in the log at its sweep before: x, y [m], yaw [rad]."""
        self.elapsed = native.doubles(self.owner, sensors)
        """Time since then [s]; negative before the first pose."""
        self.speed_x = 0.0
        self.speed_y = 0.0
        self.turning = 0.0
        """Velocity [m/s] and turn rate [rad/s] of the sensor."""
        self.travelled = 0.0
        """Distance that the sensor went so far [m]."""
        self.jacobian = native.doubles(self.owner, 6)
        """Effect of the three numbers on the current point, for both axes of its target."""
        self.product = native.doubles(self.owner, 3)
        self.change = native.doubles(self.owner, 3)
        for sensor in range(sensors):
            self.elapsed[sensor] = -1.0

    def estimate(self) -> tuple[float, float, float, float, float]:
        """Return the delay [s], the place ahead and left [m], and the standard deviations of the delay and of the place."""
        return (
            self.value[DELAY],
            self.value[AHEAD],
            self.value[LEFT],
            math.sqrt(self.cov[0]),
            math.sqrt(max(self.cov[4], self.cov[8])),
        )


def pass_time(pose_error: PoseErrorFilter, dt: float) -> None:
    """Let time pass since the last pose of each sensor [s]."""
    for sensor in range(pose_error.sensors):
        if pose_error.elapsed[sensor] >= 0.0:
            pose_error.elapsed[sensor] += dt


def correct_pose(pose_error: PoseErrorFilter, meas: Measurements, x: float, y: float, yaw: float, side: float) -> None:
    """Set the pose of the sensor for a pose x, y, yaw of the log, and its variance."""
    late = pose_error.value[DELAY]
    yaw += pose_error.turning * late
    meas.cos, meas.sin = math.cos(yaw), math.sin(yaw)
    ahead, left = pose_error.value[AHEAD], side * pose_error.value[LEFT]
    meas.x = x + pose_error.speed_x * late + meas.cos * ahead - meas.sin * left
    meas.y = y + pose_error.speed_y * late + meas.sin * ahead + meas.cos * left
    meas.start_x, meas.start_y, meas.start_yaw = meas.x, meas.y, yaw
    var = pose_error.cov[0]
    speed = pose_error.speed_x * pose_error.speed_x + pose_error.speed_y * pose_error.speed_y
    meas.pose_var, meas.pose_turn_var = speed * var, pose_error.turning * pose_error.turning * var
    if pose_error.sensors > 1:
        meas.pose_var += MOUNT_VAR
        meas.pose_turn_var += MOUNT_TURN_VAR


def set_jacobian(
    pose_error: PoseErrorFilter, meas: Measurements, x: float, y: float, u_x: float, u_y: float, axis: int
) -> None:
    """Fill in `jacobian`: the derivative of a point x, y along a direction u, for each of the three numbers."""
    dx, dy = x - meas.x, y - meas.y
    moved_x = pose_error.speed_x - pose_error.turning * dy
    moved_y = pose_error.speed_y + pose_error.turning * dx
    pose_error.jacobian[3 * axis + DELAY] = -(u_x * moved_x + u_y * moved_y)
    if pose_error.sensors > 1:
        pose_error.jacobian[3 * axis + AHEAD] = pose_error.jacobian[3 * axis + LEFT] = 0.0
        return
    pose_error.jacobian[3 * axis + AHEAD] = -(u_x * meas.cos + u_y * meas.sin)
    pose_error.jacobian[3 * axis + LEFT] = -meas.side * (u_y * meas.cos - u_x * meas.sin)


def update_pose_error(pose_error: PoseErrorFilter, targets: Targets, a: int, off: float, var: float, axis: int) -> None:
    """Update the estimate with the residual of a side of a static target [m] along axis a, after `set_jacobian`."""
    s = var + POSE_SIDE_VAR
    expected = 0.0
    for i in range(3):
        pose_error.product[i] = 0.0
        for j in range(3):
            pose_error.product[i] += pose_error.cov[3 * i + j] * (
                pose_error.jacobian[3 * axis + j] - targets.jacobian[3 * a + j]
            )
    for i in range(3):
        s += pose_error.product[i] * (pose_error.jacobian[3 * axis + i] - targets.jacobian[3 * a + i])
        expected += (pose_error.jacobian[3 * axis + i] - targets.jacobian[3 * a + i]) * (pose_error.change[i])
    off -= expected
    if off * off > MAX_POSE_RESIDUAL * s:
        return
    for i in range(3):
        pose_error.change[i] += pose_error.product[i] / s * off
    for i in range(3):
        for j in range(3):
            pose_error.cov[3 * i + j] -= pose_error.product[i] * pose_error.product[j] / s
    pose_error.cov[0] = max(pose_error.cov[0], MIN_DELAY_VAR)
    pose_error.cov[4] = max(pose_error.cov[4], MIN_PLACE_VAR)
    pose_error.cov[8] = max(pose_error.cov[8], MIN_PLACE_VAR)


def mix_jacobian(pose_error: PoseErrorFilter, targets: Targets, a: int, gain: float, axis: int) -> None:
    """Mix the Jacobian of a measurement into that of the static model, with the gain of its update."""
    # Where the extent is not known the gain of the centre may be any; what is mixed again and again would grow for ever.
    gain = min(max(gain, 0.0), 1.0)
    for i in range(3):
        at = 3 * a + i
        targets.jacobian[at] += gain * (pose_error.jacobian[3 * axis + i] - targets.jacobian[at])


def apply_pose_error(pose_error: PoseErrorFilter, targets: Targets) -> None:
    """Correct all targets by the change of a sweep, and the poses from now on."""
    if pose_error.change[0] == 0.0 and pose_error.change[1] == 0.0 and pose_error.change[2] == 0.0:
        return
    for b in range(targets.slots_used):
        if targets.state[b] != LIVE:
            continue
        for a in range(2 * b, 2 * b + 2):
            shift = 0.0
            for i in range(3):
                shift += targets.jacobian[3 * a + i] * pose_error.change[i]
            targets.c[a] -= shift
            targets.static_c[a] -= shift
    for i in range(3):
        pose_error.value[i] += pose_error.change[i]
        pose_error.change[i] = 0.0
    pose_error.value[DELAY] = min(max(pose_error.value[DELAY], -MAX_DELAY), MAX_DELAY)
