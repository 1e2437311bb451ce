"""What the poses of the log are off by: how late they are, and where on the robot the sensor really is.

A pose that is told too late shifts everything that stands by the speed of the sensor times the delay; one that is told
of another point of the robot shifts it as the robot turns. Both shifts are linear in three numbers: the delay, and the
place of the sensor ahead and to the left. They follow from the sides of standing bodies by recursive least squares, and
correct the poses from then on.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.views import Views

DELAY, AHEAD, LEFT = 0, 1, 2
DELAY_AT_FIRST = 0.2
"""[s] Standard deviation of the delay before anything is known."""
DELAY_LEFT = 0.03
"""[s] The same where a delay was found beforehand."""
PLACE_AT_FIRST = 0.1
"""[m] The same of where the sensor is."""
DELAY_FLOOR = 1e-4
"""[s²] The delay varies by at least this: (10 ms)²."""
PLACE_FLOOR = 1e-5
"""[m²]"""
BELIEVED = 9.0
"""A residual of more than this squared number of standard deviations is that of a body that moves."""
ENOUGH = 5
"""Sightings of a body that tells."""
DOUBT = 3.0
"""A body with more evidence of motion tells nothing."""
SIDE_VAR = 1e-4
"""[m²] Further variance of a side, as sightings that follow each other are not independent: (1 cm)²."""
MOST_DELAY = 0.4
"""[s] No delay is longer."""


class Correction:
    """The estimate, and how the sensor moves at the sweep at hand."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.value = native.doubles(self.owner, 3)
        """Delay [s], place of the sensor ahead and left of where its poses are [m]."""
        self.cov = native.doubles(self.owner, 9)
        self.cov[0] = DELAY_AT_FIRST * DELAY_AT_FIRST
        self.cov[4] = self.cov[8] = PLACE_AT_FIRST * PLACE_AT_FIRST
        self.told = native.doubles(self.owner, 3)
        """Pose that the log tells for the sweep before: x, y [m], yaw [rad]."""
        self.speed_x = 0.0
        self.speed_y = 0.0
        self.turning = 0.0
        """[m/s], [rad/s] How the sensor moves."""
        self.has_pose = False
        self.way = 0.0
        """Of the sensor so far [m]."""
        self.effect = native.doubles(self.owner, 6)
        """Of the side at hand, for both axes of its body."""
        self.product = native.doubles(self.owner, 3)
        self.change = native.doubles(self.owner, 3)

    def trust(self) -> None:
        """Poses whose delay was found beforehand are off by little."""
        self.cov[0] = DELAY_LEFT * DELAY_LEFT

    def estimate(self) -> tuple[float, float, float, float, float]:
        """Delay [s], place ahead and left [m], and the standard deviations of the delay and of the place."""
        return (
            self.value[DELAY],
            self.value[AHEAD],
            self.value[LEFT],
            math.sqrt(self.cov[0]),
            math.sqrt(max(self.cov[4], self.cov[8])),
        )


def place(correction: Correction, views: Views, x: float, y: float, yaw: float, side: float) -> None:
    """Where the sensor is when its pose is told as x, y, yaw."""
    late = correction.value[DELAY]
    yaw += correction.turning * late
    views.cos, views.sin = math.cos(yaw), math.sin(yaw)
    ahead, left = correction.value[AHEAD], side * correction.value[LEFT]
    views.x = x + correction.speed_x * late + views.cos * ahead - views.sin * left
    views.y = y + correction.speed_y * late + views.sin * ahead + views.cos * left
    views.start_x, views.start_y, views.start_yaw = views.x, views.y, yaw
    var = correction.cov[0]
    speed = correction.speed_x * correction.speed_x + correction.speed_y * correction.speed_y
    views.pose_var, views.pose_turn_var = speed * var, correction.turning * correction.turning * var


def effect_on(
    correction: Correction, views: Views, x: float, y: float, u_x: float, u_y: float, axis: int
) -> None:
    """Fill `effect`: how a point x, y is off along a direction, for each number that is wrong."""
    dx, dy = x - views.x, y - views.y
    moved_x = correction.speed_x - correction.turning * dy
    moved_y = correction.speed_y + correction.turning * dx
    correction.effect[3 * axis + DELAY] = -(u_x * moved_x + u_y * moved_y)
    correction.effect[3 * axis + AHEAD] = -(u_x * views.cos + u_y * views.sin)
    correction.effect[3 * axis + LEFT] = -views.side * (u_y * views.cos - u_x * views.sin)


def learn(correction: Correction, bodies: Bodies, a: int, off: float, var: float, axis: int) -> None:
    """Take what a side of a standing body is off by [m] along axis a, whose effect is filled in."""
    s = var + SIDE_VAR
    expected = 0.0
    for i in range(3):
        correction.product[i] = 0.0
        for j in range(3):
            correction.product[i] += correction.cov[3 * i + j] * (
                correction.effect[3 * axis + j] - bodies.effect[3 * a + j]
            )
    for i in range(3):
        s += correction.product[i] * (correction.effect[3 * axis + i] - bodies.effect[3 * a + i])
        expected += (correction.effect[3 * axis + i] - bodies.effect[3 * a + i]) * (correction.change[i])
    off -= expected
    if off * off > BELIEVED * s:
        return
    for i in range(3):
        correction.change[i] += correction.product[i] / s * off
    for i in range(3):
        for j in range(3):
            correction.cov[3 * i + j] -= correction.product[i] * correction.product[j] / s
    correction.cov[0] = max(correction.cov[0], DELAY_FLOOR)
    correction.cov[4] = max(correction.cov[4], PLACE_FLOOR)
    correction.cov[8] = max(correction.cov[8], PLACE_FLOOR)


def follow(correction: Correction, bodies: Bodies, a: int, gain: float, axis: int) -> None:
    """The twin has taken a share `gain` of a side: its place is off by as much of what that is."""
    for i in range(3):
        at = 3 * a + i
        bodies.effect[at] += gain * (correction.effect[3 * axis + i] - bodies.effect[at])


def apply(correction: Correction, bodies: Bodies) -> None:
    """Let what was learned from a sweep correct all bodies, and the poses from now on."""
    if correction.change[0] == 0.0 and correction.change[1] == 0.0 and correction.change[2] == 0.0:
        return
    for b in range(bodies.high):
        if bodies.state[b] != things.LIVE:
            continue
        for a in range(2 * b, 2 * b + 2):
            shift = 0.0
            for i in range(3):
                shift += bodies.effect[3 * a + i] * correction.change[i]
            bodies.c[a] -= shift
            bodies.still_c[a] -= shift
    for i in range(3):
        correction.value[i] += correction.change[i]
        correction.change[i] = 0.0
    correction.value[DELAY] = min(max(correction.value[DELAY], -MOST_DELAY), MOST_DELAY)
