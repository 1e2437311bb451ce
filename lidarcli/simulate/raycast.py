"""Casting beams at segments and circles, vectorised over sweeps × beams × primitives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.simulate.scene import Entity
from lidarcli.sweeps import Float64, Int32

_CELLS = 1 << 20
"""Largest number of beam × primitive pairs held at once: what stays near the cache."""
_SLACK = 1e-9
"""Relative overlap of neighbouring segments, so that no beam slips through a shared corner."""


@dataclass(frozen=True, eq=False, slots=True)
class Primitives:
    """What the sensor can see, in its own frame, per sweep; NaN coordinates are not there."""

    segments: Float64
    """(S, K, 4) x0 y0 x1 y1"""
    circles: Float64
    """(S, C, 3) x y radius"""
    segment_entity: Int32
    """(K,)"""
    circle_entity: Int32
    """(C,)"""


def place(entities: tuple[Entity, ...], sensor_poses: Float64, seconds: Float64) -> Primitives:
    """Bring the entities into the sensor's frame at each of the (S,) times, seen from the (S, 3) poses."""
    segments, circles = [np.empty((len(seconds), 0, 4))], [np.empty((len(seconds), 0, 3))]
    segment_counts, circle_counts = [], []
    for entity in entities:
        pose = relative(entity.poses(seconds), sensor_poses)
        pose[~entity.present(seconds)] = np.nan
        cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])

        def moved(
            x: Float64, y: Float64, pose: Float64 = pose, cos: Float64 = cos, sin: Float64 = sin
        ) -> list[Float64]:
            return [pose[:, :1] + cos * x - sin * y, pose[:, 1:2] + sin * x + cos * y]

        sides, rings = entity.segments, entity.circles
        segments.append(np.stack(moved(sides[:, 0], sides[:, 1]) + moved(sides[:, 2], sides[:, 3]), axis=-1))
        swing = np.zeros((len(seconds), len(rings)))
        feet = entity.feet(seconds)
        if feet is None and entity.motion.stride:
            phase = np.pi * 2 * entity.motion.cadence * seconds
            swing = (entity.motion.stride / 2 * np.sin(phase))[:, None] * (
                1 - 2 * (np.arange(len(rings)) % 2)
            )
        radius = np.broadcast_to(rings[:, 2], swing.shape)
        centres = moved(rings[:, 0] + swing, rings[:, 1])
        if feet is not None:
            centres = _seen_from(feet, sensor_poses)
            centres[0][~entity.present(seconds)] = np.nan
        circles.append(np.stack([*centres, radius], axis=-1))
        segment_counts.append(len(sides))
        circle_counts.append(len(rings))
    number = np.arange(len(entities), dtype=np.int32)
    return Primitives(
        segments=np.concatenate(segments, axis=1),
        circles=np.concatenate(circles, axis=1),
        segment_entity=np.repeat(number, np.array(segment_counts, int)),
        circle_entity=np.repeat(number, np.array(circle_counts, int)),
    )


def _seen_from(points: Float64, origin: Float64) -> list[Float64]:
    """(S, C) x and y of (S, C, 2) world points as seen from the (S, 3) poses `origin`."""
    dx, dy = points[..., 0] - origin[:, :1], points[..., 1] - origin[:, 1:2]
    cos, sin = np.cos(origin[:, 2:]), np.sin(origin[:, 2:])
    return [cos * dx + sin * dy, cos * dy - sin * dx]


def relative(poses: Float64, origin: Float64) -> Float64:
    """(S, 3) world poses as seen from the (S, 3) poses `origin`."""
    dx, dy = poses[:, 0] - origin[:, 0], poses[:, 1] - origin[:, 1]
    cos, sin = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, poses[:, 2] - origin[:, 2]])


def cast(primitives: Primitives, bearings: Float64) -> tuple[Float64, Int32]:
    """The nearest hit of every beam: (S, B) range [m], inf for none, and (S, B) entity, -1 for none.

    `bearings` is (B,) or (S, B).
    """
    sweeps = len(primitives.segments)
    bearings = np.broadcast_to(bearings, (sweeps, bearings.shape[-1]))
    beams = bearings.shape[1]
    ranges = np.full((sweeps, beams), np.inf)
    entity = np.full((sweeps, beams), -1, np.int32)
    for hits, shapes, owner in (
        (_hit_segments, primitives.segments, primitives.segment_entity),
        (_hit_circles, primitives.circles, primitives.circle_entity),
    ):
        if not len(owner):
            continue
        # Many primitives leave room for some of the beams at a time; each is cast on its own.
        across = max(1, min(beams, _CELLS // len(owner)))
        step = max(1, _CELLS // (across * len(owner)))
        for first in range(0, sweeps, step):
            for left in range(0, beams, across):
                part = slice(first, first + step), slice(left, left + across)
                angle = bearings[part]
                distance = hits(shapes[part[0]], np.cos(angle), np.sin(angle))
                nearest = distance.argmin(axis=1)
                found = np.take_along_axis(distance, nearest[:, None], axis=1)[:, 0]
                nearer = found < ranges[part]
                ranges[part] = np.where(nearer, found, ranges[part])
                entity[part] = np.where(nearer, owner[nearest], entity[part])
    return ranges, entity


def _hit_segments(segments: Float64, cos: Float64, sin: Float64) -> Float64:
    """(S, K, B) distance along each beam to each segment, inf where it misses."""
    x0, y0, x1, y1 = (segments[:, :, i, None] for i in range(4))
    cos, sin = cos[:, None, :], sin[:, None, :]
    dx, dy = x1 - x0, y1 - y0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1.0 / (cos * dy - sin * dx)
        distance = (x0 * dy - y0 * dx) * inverse
        along = (x0 * sin - y0 * cos) * inverse
        hit = (along >= -_SLACK) & (along <= 1 + _SLACK) & (distance > 0)
    return np.where(hit, distance, np.inf)


def _hit_circles(circles: Float64, cos: Float64, sin: Float64) -> Float64:
    """(S, C, B) distance along each beam to the near side of each circle, inf where it misses."""
    x, y, radius = (circles[:, :, i, None] for i in range(3))
    cos, sin = cos[:, None, :], sin[:, None, :]
    with np.errstate(invalid="ignore", over="ignore"):
        half = np.sqrt(radius**2 - (x * sin - y * cos) ** 2)
        distance = x * cos + y * sin - half
        hit = distance > 0
    return np.where(hit, distance, np.inf)
