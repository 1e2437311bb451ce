"""The rules of Nav2's Collision Monitor as plain loops, for comparison."""

from __future__ import annotations

import math
from collections.abc import Sequence

Point = tuple[float, float]


def is_in_polygon(corners: Sequence[Point], point: Point) -> bool:
    """Cast a ray towards +x from the point; an edge counts from just above its lower end up to its upper end."""
    x, y = point
    within = False
    for k in range(len(corners)):
        x0, y0 = corners[k - 1]
        x1, y1 = corners[k]
        if (y <= y0) == (y > y1):
            crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
            if crossing > x:
                within = not within
    return within


def is_in_circle(radius: float, point: Point) -> bool:
    return point[0] * point[0] + point[1] * point[1] < radius * radius


def is_covered(velocity: tuple[float, float, float], linear: Point, turning: Point, direction: Point | None) -> bool:
    """Tell whether a case of a velocity polygon is for a velocity; only holonomic robots have a direction."""
    ahead, left, turn = velocity
    if not turning[0] <= turn <= turning[1]:
        return False
    if direction is None:
        return linear[0] <= ahead <= linear[1]
    speed = math.hypot(ahead, left)
    if not linear[0] <= speed <= linear[1]:
        return False
    heading = math.atan2(left, ahead) if speed > 0 else 0.0
    first, last = direction
    if first <= last:
        return first <= heading <= last
    return heading >= first or heading <= last


def counts_on_the_way(
    corners: Sequence[Point] | float,
    points: Sequence[Point],
    velocity: tuple[float, float, float],
    time_before_collision: float,
    time_step: float,
) -> list[int]:
    """Count the points inside at each tested time; a number in place of corners is the radius of a circle."""
    x = y = yaw = 0.0
    ahead, left, turn = velocity
    counts = []
    time = 0.0
    while time <= time_before_collision:
        x, y, yaw = x + ahead * time_step, y + left * time_step, yaw + turn * time_step
        cos, sin = math.cos(turn * time_step), math.sin(turn * time_step)
        ahead, left = ahead * cos - left * sin, ahead * sin + left * cos
        cos, sin = math.cos(yaw), math.sin(yaw)
        number = 0
        for px, py in points:
            dx, dy = px - x, py - y
            moved = dx * cos + dy * sin, -dx * sin + dy * cos
            if isinstance(corners, float):
                number += is_in_circle(corners, moved)
            else:
                number += is_in_polygon(corners, moved)
        counts.append(number)
        time += time_step
    return counts
