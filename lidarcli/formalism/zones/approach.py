"""Points that a moving shape will meet: the steps of the Collision Monitor's action `approach`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lidarcli.masks import Circle, Polygon
from lidarcli.sweeps import Float64, Int32
from lidarcli.zone import inside

_ROUNDING = 1e-6
"""Share of its reach by which the bounding circle of a shape is wider, for no rounding to leave a point out."""


def times(time_before_collision: float, time_step: float) -> Float64:
    """Return the times (K,) [s] that are tested, 0 the first; each is the sum of the steps before it."""
    tested: list[float] = []
    time = 0.0
    while time <= time_before_collision:
        tested.append(time)
        time += time_step
    return np.array(tested)


def collision_steps(
    shape: Circle | Polygon,
    x: Float64,
    y: Float64,
    row: NDArray[np.intp],
    velocity: Float64,
    time_before_collision: float,
    time_step: float,
    point_velocity: Float64 | None = None,
) -> Int32:
    """Count the points that are inside of a shape at each tested time, while it moves with the robot.

    The robot moves by a step before each test, the first one too, and its velocity turns with it; so does
    `getCollisionTime`, hence a contact counts that lies up to one step beyond the time that it is told for.

    Parameters
    ----------
    shape : in the frame of the robot [m]
    x, y : (N,) points in the frame of the robot before it moves [m]
    row : (N,) the sweep of each
    velocity : (S, 3) ahead, left [m/s], turning [rad/s]; where one is NaN, nothing is met
    time_before_collision, time_step : how far to look ahead, and in which steps [s]
    point_velocity : (N, 2) velocity of each point in the frame of x and y [m/s]; they stand by default

    Returns
    -------
    (S, K) points inside at each of the K `times`
    """
    steps = len(times(time_before_collision, time_step))
    counts = np.zeros((len(velocity), steps), np.int32)
    for step, met in enumerate(_met(shape, x, y, row, velocity, steps, time_step, point_velocity)):
        counts[:, step] = np.bincount(row[met], minlength=len(velocity))
    return counts


def meeting(
    shape: Circle | Polygon,
    x: Float64,
    y: Float64,
    row: NDArray[np.intp],
    velocity: Float64,
    step: NDArray[np.intp],
    time_step: float,
    point_velocity: Float64 | None = None,
) -> NDArray[np.intp]:
    """Return the points that are inside of a shape at one tested time of each sweep, `step` (S,): -1 for none.

    The other parameters are those of `collision_steps`; the points come by index, in ascending order.
    """
    moves = _met(shape, x, y, row, velocity, int(step.max(initial=-1)) + 1, time_step, point_velocity)
    met = [inside_now[step[row[inside_now]] == number] for number, inside_now in enumerate(moves)]
    return np.sort(np.concatenate(met)) if met else np.zeros(0, np.intp)


def _met(
    shape: Circle | Polygon,
    x: Float64,
    y: Float64,
    row: NDArray[np.intp],
    velocity: Float64,
    steps: int,
    time_step: float,
    point_velocity: Float64 | None,
) -> Iterator[NDArray[np.intp]]:
    """Yield the points that are inside of the shape after each step, by index."""
    reach = _reach(shape)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])[row]
    if point_velocity is not None:
        speed = speed + np.hypot(point_velocity[:, 0], point_velocity[:, 1])
    near = np.flatnonzero(np.hypot(x, y) <= reach + speed * (time_step * steps * (1.0 + _ROUNDING)))
    x, y, row = x[near], y[near], row[near]
    if point_velocity is not None:
        point_velocity = point_velocity[near]
    ahead, left, turning = velocity.T
    at_x, at_y, yaw = np.zeros((3, len(velocity)))
    turn = turning * time_step
    cos_turn, sin_turn = np.cos(turn), np.sin(turn)
    for step in range(steps):
        at_x, at_y, yaw = at_x + ahead * time_step, at_y + left * time_step, yaw + turn
        ahead, left = ahead * cos_turn - left * sin_turn, ahead * sin_turn + left * cos_turn
        now_x, now_y = x - at_x[row], y - at_y[row]
        if point_velocity is not None:
            now_x += point_velocity[:, 0] * (time_step * (step + 1))
            now_y += point_velocity[:, 1] * (time_step * (step + 1))
        close = np.flatnonzero(now_x * now_x + now_y * now_y <= reach * reach)
        now_x, now_y, rows = now_x[close], now_y[close], row[close]
        cos, sin = np.cos(yaw)[rows], np.sin(yaw)[rows]
        yield near[close[inside(shape, now_x * cos + now_y * sin, -now_x * sin + now_y * cos)]]


def _reach(shape: Circle | Polygon) -> float:
    """Return the radius about the robot beyond which nothing is inside [m]."""
    if isinstance(shape, Circle):
        reach = float(np.hypot(shape.x, shape.y)) + shape.radius
    else:
        reach = float(np.hypot(*np.array(shape.corners).T).max())
    return reach * (1.0 + _ROUNDING)
