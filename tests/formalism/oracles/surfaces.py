"""Definitions 6 and 7, and bodies of profile `robust` in plain words, on lists of places (x, y) [m]."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import dist, hypot, inf, radians, sin, sqrt

import numpy as np

Place = tuple[float, float]
ALIKE = 1e-9
"""[m] Of two points whose distances differ by less, rounding tells which is farther."""


class Ambiguous(Exception):  # noqa: N818
    """Rounding decides."""


def split(places: list[Place], tolerance: float) -> list[int]:
    """Split and merge, first half: the farthest point from the chord divides, as long as it is beyond the tolerance.

    A chord shorter than the tolerance is a point. Raises `Ambiguous` where rounding decides.
    """
    if len(places) < 3:
        return []
    first, last = np.array(places[0]), np.array(places[-1])
    inner = np.array(places[1:-1])
    length = float(np.hypot(*(last - first)))
    if length < tolerance:
        away = np.hypot(*(inner - first).T)
    else:
        across = np.array([-(last - first)[1], (last - first)[0]]) / length
        away = abs((inner - first) @ across)
    order = sorted(away, reverse=True)
    if abs(order[0] - tolerance) < ALIKE or abs(length - tolerance) < ALIKE:
        raise Ambiguous
    if order[0] <= tolerance:
        return []
    if len(order) > 1 and order[0] - order[1] < ALIKE:
        raise Ambiguous
    at = int(np.argmax(away)) + 1
    return [*split(places[: at + 1], tolerance), at, *(at + k for k in split(places[at:], tolerance))]


def chord_distance(a: Place, b: Place, c: Place) -> float:
    """How far b is from the line through a and c: twice the area of the triangle over its base."""
    area = abs(float(np.linalg.det(np.array([[*a, 1.0], [*b, 1.0], [*c, 1.0]]))))
    return area / dist(a, c)


def without_flat(places: list[Place], inner: list[int], tolerance: float) -> list[int]:
    """Drop vertices within the tolerance of their neighbours' chord: each time those flatter than both neighbours."""
    kept = [0, *inner, len(places) - 1]
    for _ in range(4):
        flat = {0: inf, len(kept) - 1: inf}
        for k in range(1, len(kept) - 1):
            a, b, c = (places[kept[k + side]] for side in (-1, 0, 1))
            flat[k] = chord_distance(a, b, c) if dist(a, c) > tolerance else inf
        drop = {k for k in range(1, len(kept) - 1) if flat[k] <= tolerance and flat[k] < min(flat[k - 1], flat[k + 1])}
        for k in range(1, len(kept) - 1):
            if abs(flat[k] - tolerance) < ALIKE or (flat[k] <= tolerance and abs(flat[k] - flat[k + 1]) < ALIKE):
                raise Ambiguous
        if not drop:
            break
        kept = [vertex for k, vertex in enumerate(kept) if k not in drop]
    return kept[1:-1]


@dataclass(frozen=True)
class Face:
    """A straight stretch of points `first` … `last` and its line."""

    first: int
    last: int
    points: int
    middle: Place
    direction: Place
    rms: float
    length: float
    is_sure: bool
    """The direction is determined by the points."""

    def end(self, side: int) -> Place:
        """Where it begins (-1) or ends (1) on its line."""
        half = 0.5 * self.length * side
        return self.middle[0] + half * self.direction[0], self.middle[1] + half * self.direction[1]


def line_through(places: list[Place]) -> tuple[Place, Place, float, float, bool]:
    """Total least squares: middle, direction from the first to the last, rms and length."""
    cloud = np.array(places)
    middle = cloud.mean(axis=0)
    spread, axes = np.linalg.eigh((cloud - middle).T @ (cloud - middle) / len(cloud))
    direction, chord = axes[:, 1], cloud[-1] - cloud[0]
    if chord @ direction < 0:
        direction = -direction
    rms = sqrt(float(np.mean(((cloud - middle) @ axes[:, 0]) ** 2)))
    length = float(chord @ direction)
    sure = spread[1] - spread[0] > 1e-4 * spread[1] and length > 1e-6
    return tuple(middle.tolist()), tuple(direction.tolist()), rms, length, bool(sure)


def faces_between(places: list[Place], vertices: list[int]) -> list[Face]:
    """The faces between consecutive vertices, the first and the last point included."""
    if len(places) < 2:
        return []
    ends = [0, *vertices, len(places) - 1]
    return [Face(a, b, b - a + 1, *line_through(places[a : b + 1])) for a, b in itertools.pairwise(ends)]


def meeting(one: Face, other: Face) -> Place | None:
    """Where two lines meet, if they are not within 20° of parallel."""
    matrix = np.array([one.direction, [-other.direction[0], -other.direction[1]]]).T
    if abs(np.linalg.det(matrix)) <= sin(radians(20)):
        return None
    along = np.linalg.solve(matrix, np.subtract(other.middle, one.middle))[0]
    x, y = np.add(one.middle, along * np.array(one.direction)).tolist()
    return x, y


def without_doubled(places: list[Place], vertices: list[int]) -> list[int]:
    """Of two vertices on neighbouring points, between which two longer faces meet, keep the nearer to the corner.

    The two faces meet between them if the corner is no further from one of them than twice their distance.
    """
    faces, drop = faces_between(places, vertices), set()
    for before, face, after in zip(faces, faces[1:], faces[2:], strict=False):
        if face.points == 2 and before.points > 2 and after.points > 2:
            corner = meeting(before, after)
            if corner is None:
                continue
            a, b = dist(places[face.first], corner), dist(places[face.last], corner)
            if abs(a - b) < ALIKE:
                raise Ambiguous
            if min(a, b) < 2 * dist(places[face.first], places[face.last]):
                drop.add(face.first if a > b else face.last)
    return [vertex for vertex in vertices if vertex not in drop]


def turn(one: Face, other: Face) -> float:
    """Sine of the angle by which the second face turns left: positive at a corner that points away from the sensor."""
    return float(np.linalg.det(np.array([one.direction, other.direction])))


def farthest_vertex(places: list[Place], vertices: Iterable[int]) -> float:
    """How far a segment reaches [m]."""
    return max((dist(places[k], places[end]) for k in [0, *vertices, len(places) - 1] for end in (0, -1)), default=0.0)


def before_line(face: Face, place: Place) -> float:
    """How far a place stands before the line of a face, on the side of the sensor [m]."""
    normal = np.array([-face.direction[1], face.direction[0]])
    if normal @ np.array(face.middle) > 0:
        normal = -normal
    return float(normal @ np.subtract(place, face.middle))


CORNER = sin(radians(25))


def protrusions(
    places: list[Place], faces: list[Face], own: tuple[bool, bool], past: tuple[Place, Place], sigma: float
) -> list[tuple[int, int]]:
    """Things that touch a wall: first and last point of each.

    A stretch between two corners that point away, or between one and an edge of its own (`own`), that stands out by more
    than 10 cm + 2σ from the longest straight face beside it over at most 1.5 m. Between two walls it has a corner that
    points at the sensor; at a free end it has, or is shorter than the wall; there what is seen past the edge (`past`)
    does not lie behind the line of the wall by more than 10 cm + 2σ.
    """
    turns = [turn(a, b) for a, b in itertools.pairwise(faces)]
    if not turns:
        return []
    stretches, group = [], [0]
    for f, value in enumerate(turns, 1):
        if value > CORNER:
            stretches.append(group)
            group = []
        group.append(f)
    stretches.append(group)

    def wall_beside(f: int, way: int) -> Face:
        # Two points cut the corner.
        run = [f + way if faces[f].points == 2 and 0 <= f + way < len(faces) else f]
        while 0 <= run[-1] + way < len(faces) and abs(turns[min(run[-1], run[-1] + way)]) <= CORNER:
            run.append(run[-1] + way)
        return max((faces[k] for k in run), key=lambda face: face.length)

    found = []
    for group in stretches:
        begin, end = group[0], group[-1]
        walls = {
            0: wall_beside(begin - 1, -1) if begin > 0 else None,
            1: wall_beside(end + 1, 1) if end < len(faces) - 1 else None,
        }
        there = {side: wall for side, wall in walls.items() if wall is not None}
        pointed = any(turns[k] < -CORNER for k in range(begin, end))
        if not there or (len(there) == 2 and not pointed):
            continue
        if any(wall is None and not own[side] for side, wall in walls.items()):
            continue
        total = sum(faces[k].length for k in group)
        if any(wall.length < max(0.3, 0.0 if pointed else total) for wall in there.values()):
            continue
        first, last = faces[begin].first, faces[end].last
        corners = [places[k] for k in [first, *(faces[k].last for k in group)]]
        if max(max(dist(corner, places[first]), dist(corner, places[last])) for corner in corners) > 1.5:
            continue
        if any(max(before_line(wall, corner) for corner in corners) <= 0.1 + 2 * sigma for wall in there.values()):
            continue
        if len(there) == 1:
            ((side, wall),) = there.items()
            if before_line(wall, past[1 - side]) < -(0.1 + 2 * sigma):
                continue
        # Up to six points at an end that touches a wall may turn out to be wall.
        for side, wall in there.items():
            for _ in range(6):
                at = last if side else first
                if first >= last or before_line(wall, places[at]) > 0.03 + 2 * sigma:
                    break
                first, last = (first, last - 1) if side else (first + 1, last)
        if last > first:
            found.append((first, last))
    return found


@dataclass(frozen=True)
class Seen:
    """What is known of a segment before it is known whether it is wall."""

    size: int
    chord: float
    reach: float
    edges: tuple[str, str]
    is_protrusion: bool
    faces: list[Face]


def too_wide(seen: list[Seen], min_beams: int, max_width: float) -> list[bool]:
    """Walls by their extent."""
    return [one.size >= min_beams and one.reach > max_width and not one.is_protrusion for one in seen]


def flood(count: int, linked: Callable[[int, int], bool]) -> list[set[int]]:
    """What is linked, directly or through others, whatever the order."""
    left, found = set(range(count)), []
    while left:
        group, edge = set(), {min(left)}
        while edge:
            group |= edge
            edge = {b for a in edge for b in left - group if linked(a, b) or linked(b, a)}
        left -= group
        found.append(group)
    return found


def gap_between(one: list[Place], other: list[Place]) -> float:
    """Distance of the nearest points of two segments [m]."""
    return float(np.min(np.hypot(*(np.array(one)[:, None] - np.array(other)[None]).T)))


@dataclass(frozen=True)
class Body:
    """A segment, or torn ones joined."""

    members: list[int]
    """Segments, counter-clockwise."""
    edges: tuple[str, str]
    size: int
    reach: float


def are_torn(one: Seen, other: Seen, places: list[Place], others: list[Place], lost: int) -> bool:
    """Whether neighbouring segments, the other counter-clockwise next, are one body: 16 cm at the step, 0.9 m across.

    Where beams were `lost` between the two they are three at most, and 10 cm wide.
    """
    is_step = one.edges[1] in ("own", "hidden")
    if max(one.reach, other.reach) >= 0.9 or (lost > 3 and not is_step):
        return False
    return dist(places[-1], others[0]) < (0.16 if is_step else 0.1) and dist(places[0], others[-1]) < 0.9


def bodies(seen: list[Seen], places: list[list[Place]], lost: list[int], may: list[bool], is_turn: bool) -> list[Body]:
    """Torn things joined again; `lost`: beams after each segment that have no range."""
    count = len(seen)

    def next_of(j: int) -> int:
        return (j + 1) % count if is_turn or j + 1 < count else j

    def torn(a: int, b: int) -> bool:
        return b == next_of(a) != a and may[a] and may[b] and are_torn(seen[a], seen[b], places[a], places[b], lost[a])

    found = []
    for group in flood(count, torn):
        starts = [j for j in sorted(group) if not any(torn(k, j) for k in group)]
        members = [starts[0] if starts else min(group)]
        while len(members) < len(group):
            members.append(next_of(members[-1]))
        # A ring all around has no last member.
        last = members[-1] if starts else members[0]
        reach = max(seen[j].reach for j in group)
        if len(group) > 1:
            reach = max(reach, dist(places[members[0]][0], places[last][-1]))
        edges = (seen[members[0]].edges[0], seen[last].edges[1])
        found.append(Body(members, edges, sum(seen[j].size for j in group), reach))
    return found


def length(places: list[Place]) -> float:
    """Of the chord."""
    return hypot(places[-1][0] - places[0][0], places[-1][1] - places[0][1])
