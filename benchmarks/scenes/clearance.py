"""How far things of a scene are from each other."""

from __future__ import annotations

import numpy as np

from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Entity
from lidarcli.sweeps.types import Float64


def outline(entity: Entity) -> Float64:
    """(K, 4) sides of a wall, or of the bounding rectangle of anything else, in the world."""
    local = entity.segments if entity.wall else make.rectangle(entity.length, entity.width)
    cos, sin = np.cos(entity.yaw), np.sin(entity.yaw)
    turn = np.array([[cos, sin], [-sin, cos]])
    ends = local.reshape(-1, 2) @ turn + [entity.x, entity.y]
    sides: Float64 = ends.reshape(-1, 4)
    return sides


def covers(entity: Entity, point: tuple[float, float]) -> bool:
    """True where the point lies in the bounding rectangle."""
    cos, sin = np.cos(entity.yaw), np.sin(entity.yaw)
    dx, dy = point[0] - entity.x, point[1] - entity.y
    return bool(abs(cos * dx + sin * dy) <= entity.length / 2 and abs(cos * dy - sin * dx) <= entity.width / 2)


def in_polygon(point: Float64, corners: Float64) -> bool:
    """True where the point lies in the polygon (even number of crossings is outside)."""
    start, end = corners, np.roll(corners, -1, axis=0)
    crosses = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = start[:, 0] + (point[1] - start[:, 1]) / (end[:, 1] - start[:, 1]) * (end[:, 0] - start[:, 0])
    return bool(np.count_nonzero(crosses & (at > point[0])) % 2)


def distance(a: Float64, b: Float64) -> float:
    """Least distance between any segment of (K, 4) and any of (L, 4); 0 where two cross."""
    p, r = a[:, None, :2], a[:, None, 2:] - a[:, None, :2]
    q, s = b[None, :, :2], b[None, :, 2:] - b[None, :, :2]
    area = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    gap = q - p
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (gap[..., 0] * s[..., 1] - gap[..., 1] * s[..., 0]) / area
        u = (gap[..., 0] * r[..., 1] - gap[..., 1] * r[..., 0]) / area
        if ((t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)).any():
            return 0.0
    ends = [to_segments(b[:, :2], a), to_segments(b[:, 2:], a), to_segments(a[:, :2], b), to_segments(a[:, 2:], b)]
    return float(min(end.min() for end in ends))


def to_segments(points: Float64, segments: Float64) -> Float64:
    """(P,) least distance of each of (P, 2) points to (K, 4) segments; infinite without any."""
    if not len(segments):
        return np.full(len(points), np.inf)
    start, step = segments[None, :, :2], segments[None, :, 2:] - segments[None, :, :2]
    gap = points[:, None] - start
    length = np.maximum((step**2).sum(-1), 1e-18)
    foot = np.clip((gap * step).sum(-1) / length, 0, 1)
    least: Float64 = np.sqrt(((gap - foot[..., None] * step) ** 2).sum(-1).min(axis=1))
    return least
