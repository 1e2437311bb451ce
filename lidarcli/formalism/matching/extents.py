"""Extents of static objects by what their run observed of the space around them.

A track measures an object sweep by sweep. Of one that is partly hidden, or observed from many places, all hits together say
more. A side ends where free space was observed beyond it; where nothing was observed there, it may go on.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from lidarcli.formalism.mapping.grid import pieces
from lidarcli.formalism.matching.alignment import StaticObjects
from lidarcli.formalism.matching.catalogue import MAX_SIZE
from lidarcli.formalism.matching.free_space import OBSERVED_FREE, Buckets, SpaceMap
from lidarcli.sweeps.types import Bool, Float64, Int64

BESIDE, OUTSIDE = 0.05, 0.1
"""[m] Points this far around a box belong to its object; hits of an object farther outside show that its track measured too
little."""
LINKED = 0.11
"""[m] Greatest step between the hits of one object, along each axis; of coarse cells a little over two."""
MIN_SIDE, UNKNOWN_WIDTH = 0.06, 0.2
"""[m] Least side of a box, and width of an object of which only one side was observed, or its length if that is less."""
MIN_HITS = 3
"""Least number of occupied cells by which an object is measured."""
MEASURED_SD = 0.01
"""[m] Standard deviation of a side that was measured by occupied cells."""
EDGE_CELLS = 1.5
"""Cells at the edges of a face that may be observed free next to the object."""
THIN = 0.15
"""[m] Hits of several objects are those of one thin wall if they lie within this width."""
SIZES = ("length", "width")
NEAR_EDGE = 0.1
"""[m] Points farther from all edges of a rectangle count as this."""
TURNS = (np.radians(np.arange(-45.0, 45.0, 1.5)), np.radians(np.arange(-1.5, 1.75, 0.25)))
"""[rad] Directions of a rectangle that are tried, and then those around the best one."""


def box_of(things: StaticObjects, yaw: Float64, k: int) -> Float64:
    """Return x, y, yaw, length and width of an object; sizes that are unknown are guessed."""
    length, width = float(things.length[k]), float(things.width[k])
    length = MIN_SIDE if not length > MIN_SIDE else length
    width = min(length, UNKNOWN_WIDTH) if not width > 0 else max(width, MIN_SIDE)
    return np.array([things.x[k], things.y[k], yaw[k], length, width])


def boxes_of(things: StaticObjects, yaw: Float64) -> Float64:
    """Return (N, 5) the boxes of objects, as of `box_of`."""
    return np.array([box_of(things, yaw, k) for k in range(len(things))]).reshape(-1, 5)


def contained(boxes: Float64, points: Float64, around: float) -> tuple[Int64, Int64]:
    """Return (P,) indices of boxes (N, 5) and of the points (K, 2) that are `within` them, ascending."""
    reach = 0.5 * np.hypot(boxes[:, 3], boxes[:, 4]) + 2.0 * around
    box, point = Buckets(points).near(boxes[:, :2], reach)
    x, y = points[point, 0] - boxes[box, 0], points[point, 1] - boxes[box, 1]
    cos, sin = (np.array([turn(yaw) for yaw in boxes[:, 2].tolist()])[box] for turn in (math.cos, math.sin))
    inside = (np.abs(cos * x + sin * y) <= 0.5 * boxes[box, 3] + around) & (
        np.abs(cos * y - sin * x) <= 0.5 * boxes[box, 4] + around
    )
    return box[inside], point[inside]


def each_of(box: Int64, point: Int64, boxes: int) -> list[Int64]:
    """Return what belongs to each of so many boxes, of pairs that ascend."""
    return np.split(point, np.searchsorted(box, np.arange(1, boxes)))[:boxes]


def within(points: Float64, box: Float64, around: float) -> Bool:
    """Return (K,) whether points are in a box (x, y, yaw, length, width), or this far around it [m]."""
    x, y = points[:, 0] - box[0], points[:, 1] - box[1]
    cos, sin = math.cos(box[2]), math.sin(box[2])
    inside: Bool = (np.abs(cos * x + sin * y) <= 0.5 * box[3] + around) & (
        np.abs(cos * y - sin * x) <= 0.5 * box[4] + around
    )
    return inside


def measured(things: StaticObjects, yaw: Float64, ground: SpaceMap) -> tuple[StaticObjects, Float64, Int64]:
    """Return objects and the directions of their longer sides by all that their run hit of them, and their indices.

    One whose hits go on into those of another one or of the building stays as it is. Faces of one thin wall are one object.
    """
    if not len(ground.points):
        return things, yaw, np.arange(len(things))
    owner = np.empty(len(ground.points), np.int64)
    groups = clusters(ground.points, max(LINKED, 2.1 * ground.resolution))
    for number, group in enumerate(groups):
        owner[group] = number
    inside = each_of(*contained(boxes_of(things, yaw), ground.points, BESIDE), len(things))
    hit = [np.unique(owner[mine]).tolist() for mine in inside]
    claims: dict[int, list[int]] = {}
    for k, mine in enumerate(hit):
        for number in mine:
            claims.setdefault(number, []).append(k)
    sizes = {name: getattr(things, name).copy() for name in ("x", "y", *SIZES, "length_sd", "width_sd")}
    yaw = yaw.copy()
    dropped: set[int] = set()
    for k, mine in enumerate(hit):
        points = ground.points[np.concatenate([groups[number] for number in mine])] if mine else np.empty((0, 2))
        if k in dropped or len(points) < MIN_HITS or np.ptp(points, axis=0).max() > MAX_SIZE:
            continue
        others = {other for number in mine for other in claims[number]} - {k}
        if not others and within(points, box_of(things, yaw, k), OUTSIDE).all():
            continue
        box = rectangles(points, np.zeros(1, np.int64))[0]
        if others and (box[4] > THIN or any(hit[other] != mine for other in others)):
            continue
        dropped |= others
        for name, value in zip(("x", "y", "yaw", *SIZES), box.tolist(), strict=True):
            (yaw if name == "yaw" else sizes[name])[k] = value
        sizes["length_sd"][k] = sizes["width_sd"][k] = MEASURED_SD
    kept = np.array([k for k in range(len(things)) if k not in dropped], np.int64)
    found = {name: getattr(things, name) for name in StaticObjects.__dataclass_fields__} | sizes
    return StaticObjects(**{name: values[kept] for name, values in found.items()}), yaw[kept], kept


def rectangles(points: Float64, starts: Int64) -> Float64:
    """Return (G, 5) x, y, yaw, length, width of rectangles near whose edges the points of groups lie; `starts` of these."""
    sizes = np.diff(np.append(starts, len(points)))
    angle, best = np.zeros(len(starts)), np.full(len(starts), np.inf)
    for turns in TURNS:
        for tried in angle + turns[:, None]:
            off = np.full(len(points), NEAR_EDGE)
            for values in _turned(points, tried, sizes):
                low, high = (np.repeat(each.reduceat(values, starts), sizes) for each in (np.minimum, np.maximum))
                off = np.minimum(off, np.minimum(values - low, high - values))
            cost = np.add.reduceat(off, starts) / sizes
            angle, best = np.where(cost < best, [tried, cost], [angle, best])
    turned = _turned(points, angle, sizes)
    low, high = (np.array([each.reduceat(u, starts) for u in turned]) for each in (np.minimum, np.maximum))
    (along, across), (length, width) = 0.5 * (low + high), high - low
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = cos * along - sin * across, sin * along + cos * across
    angle = np.where(width > length, angle + 0.5 * np.pi, angle)
    return np.column_stack([x, y, angle, np.maximum(length, width), np.minimum(length, width)])


def _turned(points: Float64, angle: Float64, sizes: Int64) -> tuple[Float64, Float64]:
    """Return the coordinates of points along and across the direction of each group."""
    cos, sin = np.repeat(np.cos(angle), sizes), np.repeat(np.sin(angle), sizes)
    return cos * points[:, 0] + sin * points[:, 1], cos * points[:, 1] - sin * points[:, 0]


def unseen_ends(things: StaticObjects, yaw: Float64, ground: SpaceMap | None) -> Float64:
    """Return (N, 2) how far length and width of objects may go on, at both ends together, until free space [m].

    `ground` is what their own run observed, in their coordinates; without one nothing is known to go on.
    """
    found = np.zeros((len(things), 2))
    if ground is None:
        return found
    step = 0.5 * ground.resolution
    past = np.arange(0.5, MAX_SIZE / step) * step
    for k, axis in itertools.product(range(len(things)), (0, 1)):
        box = box_of(things, yaw, k)
        along, across = 0.5 * box[3 + axis], 0.5 * box[4 - axis]
        cos, sin = math.cos(box[2] + 0.5 * axis * math.pi), math.sin(box[2] + 0.5 * axis * math.pi)
        wide = max(across - EDGE_CELLS * ground.resolution, 0.0)
        sideways = np.linspace(-wide, wide, 2 * int(wide / step) + 1)
        more = 0.0
        for side in (-1.0, 1.0):
            u, v = np.repeat(side * (along + past), len(sideways)), np.tile(sideways, len(past))
            x, y = box[0] + cos * u - sin * v, box[1] + sin * u + cos * v
            free = (ground.passed(x, y) >= OBSERVED_FREE).reshape(len(past), -1).any(axis=1)
            more += float(past[int(np.argmax(free))]) if free.any() else MAX_SIZE
        found[k, axis] = min(more, max(MAX_SIZE - 2.0 * along, 0.0))
    return found


def clusters(points: Float64, linked: float) -> list[Int64]:
    """Return the indices of the points of each cluster, whose steps are `linked` along each axis at most [m]."""
    if not len(points):
        return []
    cell = np.floor(points / linked).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    across = int(cell[:, 0].max()) + 2
    keys, which = np.unique(cell[:, 1] * across + cell[:, 0], return_inverse=True)
    cluster = pieces(keys, across)[which]
    order = np.argsort(cluster, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1)
