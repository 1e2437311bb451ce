"""The things a scene can hold, each drawn as segments and circles in its own frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lidarcli.simulation.route import STEPS
from lidarcli.simulation.scene import STILL, Entity, Motion
from lidarcli.sweeps import TURN, Float64


def closed(points: Float64) -> Float64:
    """Return (P, 4) the sides of a polygon with the corners (P, 2)."""
    return np.hstack([points, np.roll(points, -1, axis=0)])


def rectangle(length: float, width: float, x: float = 0.0, y: float = 0.0) -> Float64:
    """Return (4, 4) the sides of an upright rectangle around (x, y)."""
    half = np.array([length / 2, width / 2])
    return closed(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + [x, y])


def wall(points: Sequence[Sequence[float]] | Float64) -> Entity:
    """Return a polyline of the building, fixed in the world."""
    corners = np.asarray(points, float)
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre = (low + high) / 2
    local = corners - centre
    length, width = high - low
    sides: Float64 = np.hstack([local[:-1], local[1:]])
    return Entity("wall", float(centre[0]), float(centre[1]), 0.0, float(length), float(width), segments=sides)


def box(x: float, y: float, length: float, width: float, yaw: float = 0.0, motion: Motion = STILL) -> Entity:
    """Return a closed rectangular box."""
    return Entity("box", x, y, yaw, length, width, segments=rectangle(length, width), motion=motion)


def cylinder(x: float, y: float, radius: float, motion: Motion = STILL) -> Entity:
    """Return a round thing: a pillar, a bin, a pole."""
    return Entity("cylinder", x, y, 0.0, 2 * radius, 2 * radius, circles=np.array([[0, 0, radius]]), motion=motion)


def legged(
    kind: str, x: float, y: float, length: float, width: float, leg: float, yaw: float = 0.0, motion: Motion = STILL
) -> Entity:
    """Return a thing on four legs of the thickness `leg`, in the corners of length × width.

    A ladder's legs are rails, twice as deep as thick; a chair's are round, a table's square.
    """
    depth = 2 * leg if kind == "ladder" else leg
    ax, ay = (length - depth) / 2, (width - leg) / 2
    corners = [(-ax, -ay), (ax, -ay), (ax, ay), (-ax, ay)]
    if kind == "chair":
        circles = np.array([[cx, cy, leg / 2] for cx, cy in corners])
        return Entity(kind, x, y, yaw, length, width, circles=circles, motion=motion)
    segments = np.vstack([rectangle(depth, leg, cx, cy) for cx, cy in corners])
    return Entity(kind, x, y, yaw, length, width, segments=segments, motion=motion)


def person(x: float, y: float, yaw: float = 0.0, gap: float = 0.25, leg: float = 0.12, motion: Motion = STILL) -> Entity:
    """Return two round legs of the diameter `leg`, their axes `gap` apart, facing `yaw`.

    A stride swings them; on a route they step.
    """
    if motion.route and not motion.stride:
        motion = replace(motion, stride=STEPS[1])
    circles = np.array([[0, gap / 2, leg / 2], [0, -gap / 2, leg / 2]])
    return Entity("person", x, y, yaw, motion.stride + leg, gap + leg, circles=circles, motion=motion)


def plant(x: float, y: float, radius: float, seed: int = 0, yaw: float = 0.0, motion: Motion = STILL) -> Entity:
    """Return a plant: a ragged star polygon whose tips lie between half and all of the radius."""
    rng = np.random.Generator(np.random.PCG64(seed))
    leaves = int(rng.integers(9, 16))
    angle = (np.arange(2 * leaves) + rng.uniform(-0.3, 0.3, 2 * leaves)) * (TURN / (2 * leaves))
    reach = radius * rng.uniform(0.5, 1.0, 2 * leaves)
    reach[1::2] *= 0.5
    points = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    extent = np.abs(points).max(axis=0)
    return Entity("plant", x, y, yaw, 2 * extent[0], 2 * extent[1], segments=closed(points), motion=motion)
