"""The directions of a building, and how much of a sweep lies on the lines of a body."""

from __future__ import annotations

import math

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import features as clues
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.features import Features

RIGHT_ANGLE = 0.5 * math.pi
KERNEL = math.radians(4.0)
"""[rad] A face speaks for directions up to this far from its own."""
CLOSE = math.radians(5.0)
"""[rad] Faces this near to the best direction make it exact."""
DIRECTION_LENGTH, DIRECTION_POINTS = 0.25, 4
"""[m] Shorter faces, and those of fewer points, do not tell directions."""
ALIGNED_LEAST, ALIGNED_MOST = math.tan(math.radians(5.0)), math.tan(math.radians(20.0))
"""Tangents of the angles by which an aligned face may be off, as its noise allows."""
ALIGNED_NOISE = 4.0 * math.sqrt(3.0)
FACE_POINTS, FACE_LENGTH = 3, 0.08
"""[m] Lesser faces give no line."""
PLANE, PLANE_NOISE = 0.03, 2.0
"""[m] Faces of one line differ by so much, and by so many times the noise."""
RELIEF = 0.32
"""[m] What stands out from a wall does so by no more than this."""
NEAR, BESIDE = 1.3, 0.6
"""[m] along a line: a piece is near; a piece is behind."""


def find_direction(features: Features, faces: Faces) -> None:
    """The direction of the building: that of most of its faces, modulo a right angle.

    Each face that tells one votes for those of a like direction; the best and those close to it make the mean.
    """
    angle, chosen, count = features.angle, features.chosen, 0
    for f in range(faces.count):
        if faces.length[f] >= DIRECTION_LENGTH and faces.points[f] >= DIRECTION_POINTS:
            angle[count] = math.atan2(faces.direction_y[f], faces.direction_x[f])
            chosen[count] = f
            count += 1
    best, most = 0.0, 0.0
    for a in range(count):
        votes = 0.0
        for b in range(count):
            off = abs(_turned(angle[b] - angle[a]))
            if off < KERNEL:
                votes += faces.length[chosen[b]] * (KERNEL - off)
        if votes > most:
            best, most = angle[a], votes
    total, mean = 0.0, 0.0
    for b in range(count):
        off = _turned(angle[b] - best)
        if abs(off) <= CLOSE:
            total += faces.length[chosen[b]]
            mean += faces.length[chosen[b]] * off
    beta = best + (mean / total if total > 0.0 else 0.0)
    features.cos, features.sin = math.cos(beta), math.sin(beta)


def _turned(angle: float) -> float:
    """An angle modulo a right angle, from -45 to 45 degrees [rad]."""
    return angle - RIGHT_ANGLE * math.floor(angle / RIGHT_ANGLE + 0.5)


def align(features: Features, points: Points, faces: Faces) -> None:
    """Which faces run with or across the building, and where they are in its axes."""
    cos, sin = features.cos, features.sin
    for f in range(faces.count):
        along = faces.direction_x[f] * cos + faces.direction_y[f] * sin
        across = faces.direction_y[f] * cos - faces.direction_x[f] * sin
        u = faces.middle_x[f] * cos + faces.middle_y[f] * sin
        v = faces.middle_y[f] * cos - faces.middle_x[f] * sin
        turned = abs(across) > abs(along)
        features.axis[f] = turned
        more, less = abs(along), abs(across)
        if turned:
            more, less = less, more
            u, v = v, u
        features.offset[f] = v
        half = 0.5 * faces.length[f]
        features.low[f], features.high[f] = u - half, u + half
        allowed = ALIGNED_LEAST
        if faces.length[f] > 0.0:
            noise = ALIGNED_NOISE * points.sigma / (math.sqrt(faces.points[f]) * faces.length[f])
            allowed = max(ALIGNED_LEAST, min(ALIGNED_MOST, noise))
        features.aligned[f] = less < allowed * more


def measure_support(features: Features, points: Points, segments: Segments, faces: Faces, k: int) -> None:
    """How much of the rest of the sweep lies on the lines of a body, and how much a little behind them."""
    values, at = features.values, k * clues.COUNT
    head, tail = features.head[k], features.tail[k]
    longest, total, aligned = 0.0, 0.0, 0.0
    j = head
    while True:
        for f in range(faces.offset[j], faces.offset[j + 1]):
            total += faces.length[f]
            longest = max(longest, faces.length[f])
            if features.aligned[f]:
                aligned += faces.length[f]
        if j == tail:
            break
        j = segmentation.following(segments, points, j)
    values[at + clues.ALIGNED] = aligned / total if total > 0.0 else 0.0
    values[at + clues.SUPPORT] = values[at + clues.SUPPORT_NEAR] = values[at + clues.BACKING] = 0.0
    some = False
    j = head
    while True:
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if features.aligned[f] and faces.length[f] >= 0.5 * longest:
                some = True
                _add_support(
                    features,
                    points,
                    faces,
                    k,
                    features.axis[f],
                    features.offset[f],
                    features.low[f],
                    features.high[f],
                    1.0,
                )
        if j == tail:
            break
        j = segmentation.following(segments, points, j)
    if not some:
        nearest = segments.first[head]
        j = head
        while True:
            for p in range(segments.first[j], segments.first[j] + segments.size[j]):
                if points.r[p] < points.r[nearest]:
                    nearest = p
            if j == tail:
                break
            j = segmentation.following(segments, points, j)
        x, y = points.x[nearest], points.y[nearest]
        u, v = x * features.cos + y * features.sin, y * features.cos - x * features.sin
        _add_support(features, points, faces, k, 0, v, u, u, 0.5)
        _add_support(features, points, faces, k, 1, u, v, v, 0.5)
    for i in range(clues.SUPPORT, clues.BACKING + 1):
        values[at + i] = math.log(1.0 + values[at + i] / 0.3)


def _add_support(
    features: Features,
    points: Points,
    faces: Faces,
    k: int,
    axis: int,
    offset: float,
    low: float,
    high: float,
    weight: float,
) -> None:
    """Raise the support of a body to what one of its lines has, if that is more."""
    values, at = features.values, k * clues.COUNT
    allowed = PLANE + PLANE_NOISE * points.sigma
    everywhere, near, behind = 0.0, 0.0, 0.0
    side = 1.0 if offset > 0.0 else -1.0
    for g in range(faces.count):
        if not features.aligned[g] or features.axis[g] != axis:
            continue
        depth = (features.offset[g] - offset) * side
        if not (depth >= -allowed and depth <= RELIEF):
            continue
        length = faces.length[g]
        if faces.points[g] < FACE_POINTS or length <= FACE_LENGTH or features.body[faces.segment[g]] == k:
            continue
        gap = max(features.low[g] - high, low - features.high[g])
        if depth <= allowed:
            everywhere += length
            if gap < NEAR:
                near += length
        elif gap < BESIDE:
            behind += length
    values[at + clues.SUPPORT] = max(values[at + clues.SUPPORT], weight * everywhere)
    values[at + clues.SUPPORT_NEAR] = max(values[at + clues.SUPPORT_NEAR], weight * near)
    values[at + clues.BACKING] = max(values[at + clues.BACKING], weight * behind)
