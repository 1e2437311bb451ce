"""What is seen of a body by itself: its edges, its size, its form."""

from __future__ import annotations

import math

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import features as clues
from lidarcli.formalism.surfaces.features import Features
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey


def _jump(edge: int, s: float) -> float:
    """By how much what is seen beside an edge is further away [m]."""
    if edge == segmentation.OWN or edge == segmentation.HIDDEN:
        return max(clues.NEARER, min(s, clues.FAR)) if s == s else 0.0
    return clues.FAR


def _is_unseen(edge: int) -> bool:
    """Whether beside an edge is no range."""
    return edge == segmentation.OPEN or edge == segmentation.UNKNOWN or edge == segmentation.FLICKERING


def measure_edges(features: Features, points: Points, segments: Segments, bodies: Bodies, k: int) -> None:
    """What the two edges of a body say."""
    values, at = features.values, k * clues.COUNT
    head, tail = features.head[k], features.tail[k]
    start, end = segments.start_edge[head], segments.end_edge[tail]
    one = _jump(start, -segments.s_start[head])
    other = _jump(end, segments.s_end[tail])
    values[at + clues.JUMP_LEAST], values[at + clues.JUMP_MOST] = min(one, other), max(one, other)
    hidden = (start == segmentation.HIDDEN) + (end == segmentation.HIDDEN)
    unseen = _is_unseen(start) + _is_unseen(end)
    values[at + clues.HIDDEN], values[at + clues.OPEN] = hidden, unseen
    values[at + clues.VIEW] = (start == segmentation.VIEW) + (end == segmentation.VIEW)
    values[at + clues.BEAMS] = math.log(bodies.size[head])
    values[at + clues.REACH] = bodies.reach[head]
    values[at + clues.WALLS] = features.share
    values[at + clues.NOISE], values[at + clues.FLICKER] = points.sigma, points.flicker


def measure_outline(
    features: Features, survey: Survey, points: Points, segments: Segments, bodies: Bodies, k: int
) -> None:
    """Size and form of what is seen of a body."""
    values, at, x, y = features.values, k * clues.COUNT, points.x, points.y
    head, tail = features.head[k], features.tail[k]
    a, b = segments.first[head], segmentation.last_point(segments, tail)
    dx, dy = x[b] - x[a], y[b] - y[a]
    width = math.sqrt(dx * dx + dy * dy)
    values[at + clues.WIDTH] = width
    middle_x, middle_y = 0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b])
    away = math.sqrt(middle_x * middle_x + middle_y * middle_y)
    values[at + clues.RANGE] = away
    values[at + clues.PROTRUSION] = 1.0 if survey.protrusion[head] else 0.0
    values[at + clues.BULGE_TO] = values[at + clues.BULGE_AWAY] = values[at + clues.ROUGHNESS] = 0.0
    values[at + clues.GRAZING] = 1.0
    if not width > 0.0 or not away > 0.0:
        return
    normal_x, normal_y = dy / width, -dx / width
    # Towards the sensor.
    if normal_x * x[a] + normal_y * y[a] > 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    values[at + clues.GRAZING] = abs(normal_x * middle_x + normal_y * middle_y) / away
    base = normal_x * x[a] + normal_y * y[a]
    towards, behind, rough, number = 0.0, 0.0, 0.0, 0
    j = head
    for part in range(bodies.parts[head]):
        first = segments.first[j]
        for p in range(first, first + segments.size[j]):
            off = normal_x * x[p] + normal_y * y[p] - base
            towards, behind = max(towards, off), max(behind, -off)
            if p > first + 1:
                bend = off - 2.0 * (normal_x * x[p - 1] + normal_y * y[p - 1] - base)
                bend += normal_x * x[p - 2] + normal_y * y[p - 2] - base
                rough += abs(bend)
                number += 1
        if part + 1 < bodies.parts[head]:
            j = segmentation.following(segments, points, j)
    values[at + clues.BULGE_TO], values[at + clues.BULGE_AWAY] = towards, behind
    values[at + clues.ROUGHNESS] = rough / number if number > 0 else 0.0
