"""What is known of an object, in plain words: its parts, vertices, box, circle and shape."""

from __future__ import annotations

from itertools import pairwise, product
from math import atan2, cos, degrees, dist, hypot, inf, log, pi, radians, sin, sqrt

import numpy as np

from tests.formalism.oracles.surfaces import Ambiguous, Face, Place, meeting


def visibility(edges: tuple[str, str]) -> str:
    """What the edges of an object say together."""
    if "view" in edges:
        return "cut"
    return {(True, True): "both_hidden", (True, False): "start_hidden", (False, True): "end_hidden"}.get(
        (edges[0] in ("hidden", "flickering"), edges[1] in ("hidden", "flickering")), "full"
    )


def in_order(spans: list[tuple[float, float]], is_turn: bool) -> list[int]:
    """Parts of one object counter-clockwise: on a full turn the widest gap between two is where it begins."""
    order = sorted(range(len(spans)), key=lambda k: spans[k][0])
    if not is_turn:
        return order
    best, widest = 0, -inf
    for k in range(len(order)):
        begin, end = spans[order[k]][0], spans[order[k - 1]][1]
        gap = begin + 2 * pi - end if k == 0 else begin - end
        if gap > widest:
            best, widest = k, gap
    return order[best:] + order[:best]


def on_line(face: Face, place: Place) -> Place:
    """The nearest point of the line of a face."""
    along = np.dot(np.subtract(place, face.middle), face.direction)
    x, y = np.add(face.middle, along * np.array(face.direction)).tolist()
    return x, y


def overhang(face: Face, place: Place, inner: Place, turned: float) -> float:
    """How far a face goes on to the bearing turned by half a step, at most as far as its last two points [m]."""
    theta = atan2(place[1], place[0]) + turned
    spacing = abs(float(np.dot(np.subtract(place, inner), face.direction)))
    matrix = np.array([face.direction, [-cos(theta), -sin(theta)]]).T
    if abs(np.linalg.det(matrix)) < 1e-12:
        return spacing
    return min(abs(float(np.linalg.solve(matrix, -np.array(place))[0])), spacing)


def outline(
    places: list[Place], faces: list[Face], tolerance: float, ends: tuple[bool, bool], step: float
) -> tuple[list[Place], list[Place], list[float]]:
    """Vertices as they are reported, vertices as the box has them, and lengths of the faces.

    An inner vertex is where the lines of its faces meet, if both have more than two points and meet near it: within the
    tolerance and two beams. At edges where the thing `ends` it goes on for half a beam.
    """
    if not faces:
        return [places[0]], [places[0]], []
    corners = []
    for one, other in pairwise(faces):
        corner = meeting(one, other) if min(one.points, other.points) > 2 else None
        spacing = min(one.length / one.points, other.length / other.points)
        nearest = on_line(one, places[one.last])
        if corner is not None:
            away = dist(corner, nearest) - tolerance - 2 * spacing
            if abs(away) < 1e-9:
                raise Ambiguous
            if away > 0:
                corner = None
        corners.append((places[one.last] if corner is None else corner, nearest if corner is None else corner))
    reported = [places[0], *(corner for corner, _ in corners), places[-1]]
    lengths = [dist(a, b) for a, b in pairwise(reported)]
    drawn = [on_line(faces[0], places[0]), *(corner for _, corner in corners), on_line(faces[-1], places[-1])]
    for end, (face, at, inner, way) in enumerate(((faces[0], 0, 1, -1), (faces[-1], -1, -2, 1))):
        if ends[end]:
            further = overhang(face, places[at], places[inner], way * step / 2)
            lengths[at] += further
            x, y = np.add(drawn[at], way * further * np.array(face.direction)).tolist()
            drawn[at] = (x, y)
    return reported, drawn, lengths


def rectangle(places: list[Place], direction: Place) -> tuple[Place, float, float, float]:
    """Centre, length ≥ width, and yaw of the long side of the rectangle around places with a side in a direction."""
    theta = atan2(direction[1], direction[0])
    turned = np.array(places) @ np.array([[cos(theta), -sin(theta)], [sin(theta), cos(theta)]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    u, v = (low + high) / 2
    size = high - low
    centre = (float(u * cos(theta) - v * sin(theta)), float(u * sin(theta) + v * cos(theta)))
    if size[1] > size[0]:
        return centre, float(size[1]), float(size[0]), theta + pi / 2
    return centre, float(size[0]), float(size[1]), theta


def box(places: list[Place], faces: list[Face]) -> tuple[Place, float, float, float]:
    """Along the longest face, or the second longest if not at right angles (5°) and of smaller area."""
    if not faces:
        chord = (places[-1][0] - places[0][0], places[-1][1] - places[0][1])
        return rectangle(places, chord if hypot(*chord) > 0 else (1.0, 0.0))
    order = sorted(faces, key=lambda face: -face.length)
    if any(a.length - b.length < 1e-9 for a, b in pairwise(order[:3])):
        raise Ambiguous
    first = rectangle(places, order[0].direction)
    if len(order) < 2:
        return first
    angle = degrees(atan2(*reversed(order[0].direction)) - atan2(*reversed(order[1].direction)))
    from_square = abs((angle + 45) % 90 - 45)
    if abs(from_square - 5) < 1e-6:
        raise Ambiguous
    if from_square < 5:
        return first
    second = rectangle(places, order[1].direction)
    one, other = first[1] * first[2], second[1] * second[2]
    if 0 < abs(one - other) <= 1e-6 * one:
        raise Ambiguous
    return second if other < one else first


def algebraic_circle(places: list[Place]) -> tuple[Place, float]:
    """Kåsa's: x² + y² = 2ax + 2by + c by linear least squares."""
    cloud = np.array(places)
    middle = cloud.mean(axis=0)
    near = cloud - middle
    matrix = np.column_stack([2 * near, np.ones(len(near))])
    (a, b, c), *_ = np.linalg.lstsq(matrix, (near**2).sum(axis=1), rcond=None)
    return (float(a + middle[0]), float(b + middle[1])), sqrt(max(c + a * a + b * b, 0.0))


def circle_rms(places: list[Place], centre: Place, radius: float) -> float:
    """Root mean square distance of places from a circle [m]."""
    return sqrt(float(np.mean((np.hypot(*(np.array(places) - centre).T) - radius) ** 2)))


def best_circle(places: list[Place]) -> tuple[Place, float, float]:
    """Least squares of the true distances: centre, radius, rms. A grid around the centre that shrinks wherever it stays.

    For a given centre the best radius is the mean distance.
    """
    centre, size = np.array(algebraic_circle(places)[0]), 0.2
    cloud = np.array(places)

    # The centre itself is the first, so that another one has to be better.
    steps = np.array([(0, 0), *product((-1, -0.3, 0, 0.3, 1), repeat=2)])
    for _ in range(400):
        around = centre + size * steps
        spreads = np.hypot(*(cloud[:, None] - around).T).std(axis=1)
        best = int(np.argmin(spreads))
        if best:
            centre = around[best]
        else:
            size /= 2
        if size < 1e-7:
            break
    away = np.hypot(*(cloud - centre).T)
    return tuple(centre.tolist()), float(away.mean()), float(away.std())


def faces_rms(faces: list[Face]) -> float:
    """Of all points of all faces."""
    total = sum(face.points * face.rms**2 for face in faces)
    return sqrt(total / max(sum(face.points for face in faces), 1))


def without_stray(places: list[Place], faces: list[Face]) -> tuple[list[Place], list[Face]]:
    """Without up to two points at each end that are off the surface, if the box of the others is less than half."""

    def area(some: list[Place], along: Face) -> float:
        _, length, width, _ = rectangle(some, along.direction)
        return max(length, 0.05) * max(width, 0.05)

    def longest(some: list[Face]) -> Face:
        return max(some, key=lambda face: face.length)

    if len(faces) < 2:
        return places, faces
    first = faces[0].points - 1 if faces[0].points <= 3 else 0
    last = faces[-1].points - 1 if faces[-1].points <= 3 else 0
    kept = faces[1 if first else 0 : len(faces) - (1 if last else 0)]
    if first + last == 0 or len(places) - first - last < 3 or not kept:
        return places, faces
    some = places[first : len(places) - last]
    if area(some, longest(kept)) < 0.5 * area(places, longest(faces)):
        return some, kept
    return places, faces


def shape(
    places: list[Place],
    faces: list[Face],
    sigma: float,
    margin: float = 1e-3,
    max_width: float = inf,
    whole: list[Place] | None = None,
) -> str:
    """The category: straight faces against a circle, by n log rms² + p log n. `Ambiguous` within a margin of log rms².

    `whole`: with stray points, if there were any.
    """
    whole = places if whole is None else whole
    count = len(places)
    if count < 5:
        return "unknown"
    level, allowed = max(0.5 * sigma, 0.004), max(2 * sigma, 0.012)
    straight = faces_rms(faces)

    def information(rms: float, parameters: int) -> float:
        return log(max(rms, level) ** 2) + parameters * log(count) / count

    def is_less(a: float, b: float) -> bool:
        if abs(a - b) < margin:
            raise Ambiguous
        return a < b

    by_faces = information(straight, 3 * len(faces) - 1)
    # However well it fits, a circle has one parameter more than a face.
    if information(0.0, 3) < by_faces and abs(np.linalg.det(np.cov(np.array(places).T))) > 1e-13:
        # A circle that fits worse than the faces by half even for its number of parameters is not looked at closer.
        guess = circle_rms(places, *algebraic_circle(places))
        rival = max(straight, level) * sqrt(count ** ((3 * len(faces) - 1 - 3) / count))
        if is_less(log(max(guess, 1e-9) ** 2), log((1.5 * rival) ** 2)):
            centre, radius, rms = best_circle(places)
            wins = is_less(information(rms, 3), by_faces)
            middle = np.mean(np.array(whole), axis=0)
            if (
                wins
                and is_less(radius, 2.0)
                and is_less(log(max(rms, 1e-9) ** 2), log(allowed**2))
                and is_less(hypot(*middle), hypot(*centre))
                and is_less(radius, dist(whole[0], whole[-1]))
                and is_less(2.0 * radius, max_width)
            ):
                return "round"
    if len(faces) <= 3 and straight <= allowed:
        corners = [
            (atan2(*reversed(one.direction)) - atan2(*reversed(other.direction)) + pi) % (2 * pi) - pi
            for one, other in pairwise(faces)
        ]
        if all(abs(corner - pi / 2) <= radians(35) for corner in corners):
            return "prismatic"
    return "irregular"
