"""What beams meet on the line of a body past both of its ends: wall, free space, or what stands before it."""

from __future__ import annotations

import math

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Scans, Segments
from lidarcli.formalism.surfaces import building
from lidarcli.formalism.surfaces import features as clues
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.features import Features

OWN_LENGTH, OWN_POINTS = 0.4, 6
"""[m] A face that is not aligned has a line of its own from this length on."""
LINE_REACH = 2.5
"""[m] A line is followed this far past either end of a body."""
LINE_PLANE, LINE_NOISE = 0.035, 2.0
"""[m] Points this near to a line, and so many times the noise, are on it."""
TINY = 1e-6
"""[m] Less is rounding."""
LINE_PRIOR = 0.3
"""[m] So much of a line is taken for crossed beforehand."""
BIN = 0.02
"""[m] Depths before and behind a line are told apart by steps of this."""
BINS_BEFORE = 30
"""Of the bins, those before the line."""
SHALLOWEST, DEEPEST = -BIN * BINS_BEFORE, BIN * (clues.BINS - BINS_BEFORE) - 0.5 * BIN
"""[m] What lies further before a line or behind it is in no bin."""
SPACING, MOST_STRIDE = 0.04, 6
"""[m] Beams that meet a line closer together than this are passed over, so many in a row at most."""
BEHIND_FIRST, BEHIND_LAST = 3, 15
"""Bins behind the line in which a wall may lie from which the body stands out: 6 to 30 cm."""
BEFORE_FIRST, BEFORE_LAST = 4, 25
"""Bins before it in which one may lie that has the body in its niche: 8 to 50 cm."""
CROSSED = 2
"""So many beams in a row that pass through a line end it."""
SLANT = 0.015
"""By so much a line may turn: m per m."""
FRONT = 0.1
"""A line is not followed where beams meet it at a lesser sine."""
BACK_SURFACE = 0.25
"""[m] of surface on either side of a body that tell the wall behind it."""
BACK_LEAST, BACK_MOST = 6, 15
"""Beams on either side."""
BACK_PLANE, BACK_NOISE = 0.03, 2.0
"""[m] rms of a wall behind."""


def measure_line(
    features: Features, points: Points, segments: Segments, faces: Faces, scans: Scans, k: int
) -> None:
    """What beams meet past both ends of a body on the line of its longest face, and on that of its longest one across."""
    values, at = features.values, k * clues.COUNT
    for i in range(clues.LINE, clues.CROSS_LINE + 1):
        values[at + i] = 0.0
    head, tail = features.head[k], features.tail[k]
    face, cross = -1, -1
    j = head
    while True:
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if face < 0 or faces.length[f] > faces.length[face]:
                face = f
        if j == tail:
            break
        j = segmentation.following(segments, points, j)
    if face < 0:
        return
    values[at + clues.UNBROKEN] = faces.length[face]
    if features.aligned[face]:
        j = head
        while True:
            for f in range(faces.offset[j], faces.offset[j + 1]):
                if not features.aligned[f] or features.axis[f] == features.axis[face]:
                    continue
                if faces.points[f] >= building.FACE_POINTS and (
                    cross < 0 or faces.length[f] > faces.length[cross]
                ):
                    cross = f
            if j == tail:
                break
            j = segmentation.following(segments, points, j)
    if cross >= 0:
        _measure_face(features, points, segments, faces, scans, k, cross)
        values[at + clues.CROSS_LINE] = max(values[at + clues.LINE], values[at + clues.LINE_BEHIND])
    _measure_face(features, points, segments, faces, scans, k, face)


def _measure_face(
    features: Features, points: Points, segments: Segments, faces: Faces, scans: Scans, k: int, face: int
) -> None:
    """What beams meet on the line of one face of a body, before it and behind it, past both ends of the body."""
    values, at, bins = features.values, k * clues.COUNT, features.bins
    for i in range(clues.LINE, clues.UNBROKEN):
        values[at + i] = 0.0
    along_x, along_y = faces.direction_x[face], faces.direction_y[face]
    # What is too short to have a direction gets that of the building.
    if features.aligned[face] or faces.length[face] < OWN_LENGTH or faces.points[face] < OWN_POINTS:
        along_x, along_y = features.cos, features.sin
        if features.axis[face]:
            along_x, along_y = -features.sin, features.cos
    normal_x, normal_y = along_y, -along_x
    c = normal_x * faces.middle_x[face] + normal_y * faces.middle_y[face]
    if c < 0.0:
        normal_x, normal_y, c = -normal_x, -normal_y, -c
    if c < BIN:
        return
    for i in range(clues.BINS + 1):
        bins[i] = 0.0
    first, last = segments.first[features.head[k]], segmentation.last_point(segments, features.tail[k])
    features.goes_on = 0.0
    beyond = _follow(features, points, scans, first, -1, normal_x, normal_y, c)
    beyond += _follow(features, points, scans, last, 1, normal_x, normal_y, c)
    values[at + clues.UNBROKEN] = faces.length[face] + features.goes_on
    half = int((LINE_PLANE + LINE_NOISE * points.sigma) / BIN + 0.5)
    line, behind, depth, before = 0.0, 0.0, 0.0, 0.0
    # Sums of the bins around one, and of those beyond them: what beams have crossed to get there.
    occupied, crossed = 0.0, beyond
    for i in range(clues.BINS):
        crossed += bins[i]
    for i in range(min(half, clues.BINS)):
        occupied += bins[i]
        crossed -= bins[i]
    for i in range(clues.BINS):
        if i + half < clues.BINS:
            occupied += bins[i + half]
            crossed -= bins[i + half]
        if i - half - 1 >= 0:
            occupied -= bins[i - half - 1]
        if occupied < TINY:
            continue
        share = occupied / (occupied + max(crossed, 0.0) + LINE_PRIOR)
        off = i - BINS_BEFORE
        if off == 0:
            line = share
        elif off >= BEHIND_FIRST and off <= BEHIND_LAST:
            if share > behind:
                behind, depth = share, off * BIN
        elif off <= -BEFORE_FIRST and off >= -BEFORE_LAST:
            before = max(before, share)
    values[at + clues.LINE], values[at + clues.LINE_BEHIND] = line, behind
    values[at + clues.DEPTH_BEHIND], values[at + clues.LINE_BEFORE] = depth, before


def _follow(
    features: Features,
    points: Points,
    scans: Scans,
    start: int,
    way: int,
    normal_x: float,
    normal_y: float,
    c: float,
) -> float:
    """Follow a line past one end of a body: how much of it [m] is met at which depth (`bins`).

    How far it goes on without a beam that passes through it is added to `goes_on`.

    Returns
    -------
    How much of it is crossed by beams that meet nothing near it [m]
    """
    bins, x, y, r, position = features.bins, points.x, points.y, points.r, points.position
    if start >= points.count:
        start -= points.count
    p, beyond = start, 0.0
    q = normal_x * x[p] + normal_y * y[p]
    if q < FRONT * r[p]:
        return 0.0
    begin = (normal_x * y[p] - normal_y * x[p]) * c / q
    last, crossed, far = begin, 0, 0.0
    plane = LINE_PLANE + LINE_NOISE * points.sigma
    # Where beams meet the line close together, not all of them are looked at.
    stride = 1
    while stride < MOST_STRIDE and (stride + 1) * c * points.step <= SPACING:
        stride += 1
    left = points.count - 1
    while left > 0:
        skip = min(stride, left)
        left -= skip
        before = p
        p += way * skip
        turn = 0
        if p < 0 or p >= points.count:
            if points.period == 0:
                break
            turn = points.period
            p += points.count if p < 0 else -points.count
        q = normal_x * x[p] + normal_y * y[p]
        if q < FRONT * r[p]:
            break
        s = (normal_x * y[p] - normal_y * x[p]) * c / q
        step = (s - last) * way
        away = (s - begin) * way
        if step < 0.0 or away > LINE_REACH:
            break
        last = s
        lost = (position[p] - position[before]) * way + turn - skip
        depth = q - c
        if lost > 0:
            beam = segmentation.beam_at(points, position[p] - way)
            if beam >= 0 and scans.status[points.row * scans.width + beam] == segmentation.NO_RETURN:
                beyond += step * lost / (lost + skip)
            # Where beams were lost nobody knows what is on the line.
            step = 0.0
        if crossed < CROSSED:
            allowed = plane + SLANT * away
            if depth > allowed:
                crossed += skip
            else:
                crossed = 0
                if depth >= -allowed:
                    far = away
        if depth >= DEEPEST:
            beyond += step
        elif depth > SHALLOWEST:
            bins[int(depth / BIN + BINS_BEFORE + 0.5)] += step
    features.goes_on += far
    return beyond


def measure_back(features: Features, points: Points, segments: Segments, k: int) -> None:
    """How far a body stands before the surface that is seen on both of its sides [m], 0 where there is none."""
    values, at, x, y = features.values, k * clues.COUNT, points.x, points.y
    values[at + clues.BEFORE_BACK] = 0.0
    head, tail = features.head[k], features.tail[k]
    a, b = segments.first[head], segmentation.last_point(segments, tail)
    spacing = 0.5 * (points.r[a] + points.r[b]) * points.step
    number = BACK_LEAST
    while number < BACK_MOST and (number + 1) * spacing <= BACK_SURFACE:
        number += 1
    low, high = a - number, b + number
    if points.period == 0 and (low < 0 or high >= points.count):
        return
    if b - a + 1 + 2 * number > points.count:
        return
    sum_x, sum_y, sum_xx, sum_xy, sum_yy = 0.0, 0.0, 0.0, 0.0, 0.0
    x0, y0 = x[a], y[a]
    for i in range(2 * number):
        p = low + i if i < number else b + 1 + i - number
        if p < 0:
            p += points.count
        while p >= points.count:
            p -= points.count
        dx, dy = x[p] - x0, y[p] - y0
        sum_x += dx
        sum_y += dy
        sum_xx += dx * dx
        sum_xy += dx * dy
        sum_yy += dy * dy
    share = 1.0 / (2 * number)
    mean_x, mean_y = sum_x * share, sum_y * share
    xx, xy, yy = (
        sum_xx * share - mean_x * mean_x,
        sum_xy * share - mean_x * mean_y,
        sum_yy * share - mean_y * mean_y,
    )
    half = 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    rms = math.sqrt(max(0.5 * (xx + yy) - root, 0.0))
    if rms > BACK_PLANE + BACK_NOISE * points.sigma or not root > 0.0:
        return
    angle = 0.5 * math.atan2(xy, half)
    normal_x, normal_y = -math.sin(angle), math.cos(angle)
    c = normal_x * (x0 + mean_x) + normal_y * (y0 + mean_y)
    if c < 0.0:
        normal_x, normal_y, c = -normal_x, -normal_y, -c
    middle = normal_x * 0.5 * (x[a] + x[b]) + normal_y * 0.5 * (y[a] + y[b])
    values[at + clues.BEFORE_BACK] = max(clues.NEARER, min(c - middle, clues.FAR))
