"""Features of a body by which Definition 5 is decided: object or building.

A wall goes on: on its own line, past what hides it, in the direction of the building. An object ends: at steps, before free
space. Every feature is one such question, put to the body or to what is around it in the sweep.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import segmentation
from lidarcli.formalism.objects import Bodies
from lidarcli.formalism.segmentation import Points, Scans, Segments
from lidarcli.formalism.surfaces import Faces, Survey
from lidarcli.system import native

NAMES = (
    *("jump", "gap", "flicker"),
    *("beside", "around", "deeper", "bodies", "slim"),
    *("line", "unbroken", "arms", "support", "beyond", "wall_before"),
    *("width", "extent", "range", "bulge_away", "arc"),
)
"""Names of the features in their order (docs/formalism.md explains them)."""
JUMP, GAP, FLICKER, BESIDE, AROUND, DEEPER, BODIES, SLIM = range(8)
LINE, UNBROKEN, ARMS, SUPPORT, BEYOND, WALL_BEFORE = range(8, 14)
WIDTH, EXTENT, RANGE, BULGE_AWAY, ARC, COUNT = range(14, 20)

FAR, NEARER = 3.0, -2.0
"""[m] Greatest and least jump: the greatest is also that at an edge behind which nothing is visible."""


class Features:
    """Bodies of a sweep that may be objects, with their features."""

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.count = 0
        self.member = native.integers(self.owner, most)
        """Segments of the bodies, counter-clockwise: those of body k from `start[k]` to `start[k + 1]` - 1."""
        self.start = native.integers(self.owner, most + 1)
        self.values = native.doubles(self.owner, COUNT * most)
        """`COUNT` features of each body, as `NAMES` lists them."""
        self.body = native.integers(self.owner, most)
        """Body of each segment, -1 for none."""
        self.first = native.integers(self.owner, most)
        self.last = native.integers(self.owner, most)
        """First and last point of each body."""
        self.x = native.doubles(self.owner, most)
        self.y = native.doubles(self.owner, most)
        """Middle of the chord of each body [m]."""
        self.cos = 1.0
        """Direction of the building."""
        self.sin = 0.0
        self.lines = native.integers(self.owner, 2 * most)
        """Faces of enough points to be on a line, `line_count` of them; the long ones are walls."""
        self.walls = native.integers(self.owner, 2 * most)
        self.line_count = self.wall_count = 0
        self.axis = native.integers(self.owner, 2 * most)
        """Of each face: 1 across the building, 0 along it."""
        self.aligned = native.doubles(self.owner, 2 * most)
        """Share of it that counts as such."""
        self.offset = native.doubles(self.owner, 2 * most)
        """Distance of its line from the sensor, to one side [m]."""
        self.angle = native.doubles(self.owner, 2 * most)
        self.length = native.doubles(self.owner, 2 * most)
        self.votes = native.doubles(self.owner, 2 * most)
        # Of the line of a body past its ends [m]: what is met on it and crossed, and how far it goes on.
        self.met = 0.0
        self.crossed = 0.0
        self.goes_on = 0.0
        self.supported = 0.0
        """Length of the aligned faces of other bodies on the line of a face that is aligned [m]."""


def gather(features: Features, survey: Survey, points: Points, segments: Segments, bodies: Bodies) -> None:
    """List the bodies that may be objects: of candidate segments, with enough points and no wider than an object."""
    features.count = features.start[0] = 0
    for j in range(segments.count):
        features.body[j] = -1
    for j in range(segments.count):
        if not survey.candidate[j] or features.body[j] >= 0:
            continue
        if bodies.size[j] < survey.min_beams or not bodies.extent[j] <= survey.max_width:
            continue
        before = segmentation.preceding(segments, points, j)
        # A body begins where none joins it from before; one that goes all around, anywhere.
        if bodies.joins[before] and before != j and bodies.parts[j] < segments.count:
            continue
        k, part = features.count, j
        first = features.start[k]
        features.start[k + 1] = first + bodies.parts[j]
        for i in range(first, features.start[k + 1]):
            features.member[i] = part
            features.body[part] = k
            part = segmentation.following(segments, points, part)
        features.count += 1


def measure(
    features: Features, survey: Survey, points: Points, segments: Segments, faces: Faces, bodies: Bodies, scans: Scans
) -> None:
    """Fill in the features of all bodies."""
    if features.count == 0:
        return
    find_direction(features, faces)
    align(features, faces)
    for k in range(features.count):
        measure_outline(features, points, segments, bodies, k)
    for k in range(features.count):
        measure_edges(features, points, segments, k)
        measure_surroundings(features, points, scans, k)
        measure_lines(features, points, faces, scans, k)
        measure_walls(features, faces, k)


# What is visible of a body by itself: its size, its form, its edges.


def measure_outline(features: Features, points: Points, segments: Segments, bodies: Bodies, k: int) -> None:
    """Fill in the features of the size and form of a body, and where it is."""
    values, at, x, y = features.values, k * COUNT, points.x, points.y
    head, tail = features.member[features.start[k]], features.member[features.start[k + 1] - 1]
    a, b = segments.first[head], segmentation.last_point(segments, tail)
    dx, dy = x[b] - x[a], y[b] - y[a]
    width = math.sqrt(dx * dx + dy * dy)
    features.first[k], features.last[k] = a, b
    features.x[k], features.y[k] = 0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b])
    values[at + WIDTH], values[at + EXTENT] = width, bodies.extent[head]
    values[at + RANGE] = math.sqrt(features.x[k] * features.x[k] + features.y[k] * features.y[k])
    values[at + FLICKER] = points.flicker
    # The normal points away from the sensor.
    normal_x, normal_y, base = 0.0, 0.0, 0.0
    if width > 0.0:
        normal_x, normal_y = dy / width, -dx / width
        base = normal_x * x[a] + normal_y * y[a]
        # A chord that passes through the sensor has no far side.
        if abs(base) < SHORTEST:
            normal_x, normal_y, base = 0.0, 0.0, 0.0
        elif base < 0.0:
            normal_x, normal_y, base = -normal_x, -normal_y, -base
    behind, steps = 0.0, 0.0
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        first = segments.first[j]
        for p in range(first, first + segments.size[j]):
            behind = max(behind, normal_x * x[p] + normal_y * y[p] - base)
            if p > first:
                steps += (x[p] - x[p - 1]) * (x[p] - x[p - 1]) + (y[p] - y[p - 1]) * (y[p] - y[p - 1])
    values[at + BULGE_AWAY] = behind
    # The length of equal steps with these squares.
    values[at + ARC] = min(math.sqrt(bodies.size[head] * steps) / max(width, SHORTEST), LONGEST)


SHORTEST, LONGEST = 0.01, 5.0
"""[m] Least chord that an outline is compared with, and least distance of one that has a far side; greatest ratio of the
two."""


def _jump(edge: int, s: float) -> float:
    """Return the distance by which the neighbour of an edge is further away [m]."""
    if edge == segmentation.OWN or edge == segmentation.HIDDEN:
        return max(NEARER, min(s, FAR)) if s == s else 0.0
    return FAR


def measure_edges(features: Features, points: Points, segments: Segments, k: int) -> None:
    """Fill in the features of the two edges of a body."""
    values, at = features.values, k * COUNT
    head, tail = features.member[features.start[k]], features.member[features.start[k + 1] - 1]
    one = _jump(segments.start_edge[head], -segments.s_start[head])
    other = _jump(segments.end_edge[tail], segments.s_end[tail])
    values[at + JUMP] = min(one, other)
    values[at + GAP] = min(_gap(points, features.first[k], -1), _gap(points, features.last[k], 1))


def _gap(points: Points, p: int, step: int) -> float:
    """Return the distance of a point to the next one in a direction [m], at most `FAR`."""
    q = p + step
    if points.period > 0:
        if q < 0:
            q += points.count
        elif q >= points.count:
            q -= points.count
    if q < 0 or q >= points.count:
        return FAR
    return min(segmentation.distance(points, p, q), FAR)


# What is around a body: the surfaces past both of its ends, and other bodies.

OUTSIDE, DEEPEST = -4.0, 5.0
"""[m] Depths behind a body: beyond the view, and the greatest one, which is also that of nothing; the least is -`FAR`."""
BESIDE_ANGLE, AROUND_ANGLE = math.radians(1.0), math.radians(4.0)
"""[rad] So far past both ends one beam is looked at."""
DEEPER_ANGLE, LOOKS, DEEPER_BY = math.radians(20.0), 5, 0.4
"""[rad], beams to each side, about, [m]: how many of these end so much deeper."""
NEAR_BODIES, SLIM_WIDTH, NO_SLIM = 3.0, 0.3, 2.0
"""[m] Bodies that near are counted; the nearest slim one, of a lesser width, is no further away than that."""


def measure_surroundings(features: Features, points: Points, scans: Scans, k: int) -> None:
    """Fill in the features of the depths past both ends of a body, and of other bodies."""
    values, at = features.values, k * COUNT
    a, b = features.first[k], features.last[k]
    from_a, from_b = points.position[a], points.position[b]
    ra, rb = points.r[a], points.r[b]
    steps = _steps(points, BESIDE_ANGLE)
    values[at + BESIDE] = min(_depth(points, scans, from_a - steps, ra), _depth(points, scans, from_b + steps, rb))
    steps = _steps(points, AROUND_ANGLE)
    values[at + AROUND] = min(_depth(points, scans, from_a - steps, ra), _depth(points, scans, from_b + steps, rb))
    steps = _steps(points, DEEPER_ANGLE)
    stride = max(steps // LOOKS, 1)
    deeper, per_depth, looks, i = 0.0, 1.0 / DEEPER_BY, 0, 1
    while i <= steps:
        one, other = _depth(points, scans, from_a - i, ra), _depth(points, scans, from_b + i, rb)
        looks += (one > OUTSIDE) + (other > OUTSIDE)
        deeper += 2.0 - _share(per_depth * max(one, 0.0)) - _share(per_depth * max(other, 0.0))
        i += stride
    values[at + DEEPER] = deeper / max(looks, 1.0)
    bodies, slim = 0.0, NO_SLIM * NO_SLIM
    for i in range(features.count):
        dx, dy = features.x[i] - features.x[k], features.y[i] - features.y[k]
        off = dx * dx + dy * dy
        if off < 2.25 * NEAR_BODIES * NEAR_BODIES:
            bodies += _share(math.sqrt(off) / NEAR_BODIES)
        if i != k and values[i * COUNT + WIDTH] < SLIM_WIDTH:
            slim = min(slim, off)
    values[at + BODIES], values[at + SLIM] = bodies, math.sqrt(slim)


def _steps(points: Points, angle: float) -> int:
    """Return the number of beams within an angle, at least one and no more than there are."""
    if angle >= points.step * points.bearings:
        return points.bearings
    steps = int(angle / points.step + 0.5)
    return max(steps, 1)


def _depth(points: Points, scans: Scans, position: int, r: float) -> float:
    """Return how much further away than r the beam at a position ends [m], at most one turn beyond the seam."""
    if position < 0 or position >= points.bearings:
        if points.period == 0:
            return OUTSIDE
        position += points.bearings if position < 0 else -points.bearings
    if points.reverse:
        position = points.bearings - 1 - position
    away = scans.ranges[points.row * scans.width + position] - r
    return max(-FAR, min(away, DEEPEST)) if away == away else DEEPEST


# The direction of a building, and how much of a sweep lies on the lines of a body.

RIGHT_ANGLE = 0.5 * math.pi
KERNEL, CLOSE = math.radians(4.0), math.radians(5.0)
"""[rad] A face speaks for directions up to the first from its own; faces up to the second from the best make it exact."""
DIRECTION_LENGTH, DIRECTION_POINTS = 0.25, 4
"""[m] Shorter faces, and those of fewer points, do not tell directions."""
ALIGNED = math.sin(math.radians(10.0))
"""Sine of the angle by which an aligned face may be off."""
PLANE, PLANE_NOISE = 0.04, 2.0
"""[m] Surfaces of one line differ by so much, and by so many times the noise."""


def find_direction(features: Features, faces: Faces) -> None:
    """Find the direction of the building: that of most of its faces, modulo a right angle.

    Each face that tells one votes for those of a like direction; the best and those close to it make the mean.
    """
    angle, length, votes, count = features.angle, features.length, features.votes, 0
    for f in range(faces.count):
        if faces.length[f] >= DIRECTION_LENGTH and faces.points[f] >= DIRECTION_POINTS:
            angle[count] = _turned(math.atan2(faces.direction_y[f], faces.direction_x[f]))
            length[count], votes[count] = faces.length[f], 0.0
            count += 1
    kernel = KERNEL
    for a in range(count):
        one, weight = angle[a], length[a]
        for b in range(count):
            off = abs(angle[b] - one)
            votes[b] += weight * max(kernel - min(off, RIGHT_ANGLE - off), 0.0)
    best, most = 0.0, 0.0
    for a in range(count):
        if votes[a] > most:
            best, most = angle[a], votes[a]
    total, mean = 0.0, 0.0
    for b in range(count):
        off = _turned(angle[b] - best)
        if abs(off) <= CLOSE:
            total += length[b]
            mean += length[b] * off
    beta = best + (mean / total if total > 0.0 else 0.0)
    features.cos, features.sin = math.cos(beta), math.sin(beta)


def _turned(angle: float) -> float:
    """Return an angle modulo a right angle, from -45 to 45 degrees [rad]."""
    return angle - RIGHT_ANGLE * math.floor(angle / RIGHT_ANGLE + 0.5)


def align(features: Features, faces: Faces) -> None:
    """List the faces that may be on lines and the walls; mark those along the building or across it, and where they are."""
    cos, sin = features.cos, features.sin
    features.line_count = features.wall_count = 0
    for f in range(faces.count):
        along = abs(faces.direction_x[f] * cos + faces.direction_y[f] * sin)
        across = abs(faces.direction_y[f] * cos - faces.direction_x[f] * sin)
        features.axis[f] = across > along
        features.aligned[f] = _share(min(along, across) / ALIGNED)
        features.offset[f] = faces.middle_y[f] * cos - faces.middle_x[f] * sin
        if across > along:
            features.offset[f] = faces.middle_x[f] * cos + faces.middle_y[f] * sin
        if faces.points[f] >= LINE_POINTS:
            features.lines[features.line_count] = f
            features.line_count += 1
        if faces.length[f] >= WALL_LENGTH:
            features.walls[features.wall_count] = f
            features.wall_count += 1


def measure_lines(features: Features, points: Points, faces: Faces, scans: Scans, k: int) -> None:
    """Fill in the features of the lines of the two longest faces of a body."""
    values, at = features.values, k * COUNT
    for i in range(LINE, WALL_BEFORE):
        values[at + i] = 0.0
    face, arm = -1, -1
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if face < 0 or faces.length[f] > faces.length[face]:
                face, arm = f, face
            elif arm < 0 or faces.length[f] > faces.length[arm]:
                arm = f
    if face < 0:
        return
    own_line = _on_line(features, points, faces, k, face)
    aligned, support, told = features.aligned[face], features.supported, 0.0
    # All points of a body may lie on one place.
    if arm >= 0 and faces.length[face] > 0.0:
        told = 1.0 - _share(faces.length[arm] / (ARM * faces.length[face]))
    # A second face that is much shorter tells nothing.
    if told > 0.0:
        beyond = values[at + BEYOND]
        values[at + ARMS] = told * _on_line(features, points, faces, k, arm)
        values[at + BEYOND] = beyond
        support, aligned = max(support, told * features.supported), max(aligned, told * features.aligned[arm])
    if aligned < 1.0:
        support = max(support, min(1.0 - aligned, 0.5) * _supported(features, points, faces, k))
    values[at + ARMS] = max(values[at + ARMS], own_line)
    values[at + SUPPORT] = math.log(1.0 + support / LOG_SCALE)
    _measure_face(features, points, faces, scans, k, face)


ARM = 0.5
"""Least length of a second face that tells anything, as a share of the longest."""
LINE_POINTS, SLANTED = 3, 0.15
"""Faces of fewer points, or turned by more than this sine, are on no line."""
SHORT, SHORT_SLANT, LONG_SLANT, WIDEST = 0.4, 0.06, 0.03, 0.2
"""[m], m per m, m per m, [m]: the line of a shorter face may turn by the first slant, others by the second; in all by no
more than the last."""
BEYOND_BY, LOG_SCALE = 0.3, 0.3
"""[m] What is further behind a line is beyond it; lengths are given as log(1 + length / scale)."""


def _on_line(features: Features, points: Points, faces: Faces, k: int, face: int) -> float:
    """Return how much of the faces of other bodies is on the line of a face, as a logarithm; write what share is beyond,
    and how much of those that are aligned is on it if it is.
    """
    plane = PLANE + PLANE_NOISE * points.sigma
    slack = SHORT_SLANT if faces.length[face] < SHORT else LONG_SLANT
    normal_x, normal_y = faces.direction_y[face], -faces.direction_x[face]
    c = normal_x * faces.middle_x[face] + normal_y * faces.middle_y[face]
    if c < 0.0:
        normal_x, normal_y, c = -normal_x, -normal_y, -c
    on, beyond, whole, per_depth = 0.0, 0.0, 0.0, 1.0 / BEYOND_BY
    axis, offset, most, supported = features.axis[face], features.offset[face], 1.5 * plane, 0.0
    for i in range(features.line_count):
        f = features.lines[i]
        if features.body[faces.segment[f]] == k:
            continue
        length = faces.length[f]
        off = normal_x * faces.middle_x[f] + normal_y * faces.middle_y[f] - c
        whole += length
        if per_depth * off > 0.5:
            beyond += length * (1.0 - _share(per_depth * off))
        aside = features.offset[f] - offset
        if abs(aside) < most and features.axis[f] == axis:
            supported += features.aligned[f] * length * _share(aside / plane)
        if not abs(off) < WIDEST:
            continue
        along = normal_y * (faces.middle_x[f] - faces.middle_x[face]) - normal_x * (
            faces.middle_y[f] - faces.middle_y[face]
        )
        turned = abs(normal_x * faces.direction_x[f] + normal_y * faces.direction_y[f])
        if turned < SLANTED:
            on += length * _share(off / (plane + slack * abs(along)))
    features.values[k * COUNT + BEYOND] = beyond / whole if whole > 0.0 else 0.0
    features.supported = features.aligned[face] * supported
    return math.log(1.0 + on / LOG_SCALE)


def _supported(features: Features, points: Points, faces: Faces, k: int) -> float:
    """Return how much of the aligned faces of others is on a line along the building or across it through a body [m]."""
    x, y = features.x[k], features.y[k]
    along, across = y * features.cos - x * features.sin, x * features.cos + y * features.sin
    plane = PLANE + PLANE_NOISE * points.sigma
    most, one, other = 1.5 * plane, 0.0, 0.0
    for i in range(features.line_count):
        f = features.lines[i]
        off = features.offset[f] - (across if features.axis[f] else along)
        if abs(off) < most and features.body[faces.segment[f]] != k:
            on = features.aligned[f] * faces.length[f] * _share(off / plane)
            if features.axis[f]:
                other += on
            else:
                one += on
    return max(one, other)


def _share(off: float) -> float:
    """Return how much counts as on a line [0 to 1], by a distance as a multiple of what is allowed.

    All does up to half of that, nothing from once and a half on.
    """
    return min(1.0, max(0.0, 1.5 - abs(off)))


WALL_LENGTH, WALL_BEHIND = 1.0, -1.0
"""[m] A wall is a face that long; how far a body is before it ends at the second, which is behind it, and at `FAR`."""


TIE = 1e-9
"""[m²] Walls whose squared distances differ by less are equally near."""


def measure_walls(features: Features, faces: Faces, k: int) -> None:
    """Fill in the features of long faces near a body."""
    values, at = features.values, k * COUNT
    nearest, before = FAR * FAR, FAR
    for i in range(features.wall_count):
        f = features.walls[i]
        if features.body[faces.segment[f]] == k:
            continue
        dx, dy = features.x[k] - faces.middle_x[f], features.y[k] - faces.middle_y[f]
        along = abs(dx * faces.direction_x[f] + dy * faces.direction_y[f]) - 0.5 * faces.length[f]
        off = dx * faces.direction_y[f] - dy * faces.direction_x[f]
        if faces.middle_y[f] * faces.direction_x[f] < faces.middle_x[f] * faces.direction_y[f]:
            off = -off
        past = max(along, 0.0)
        apart = off * off + past * past
        # Of two faces that meet there the one that it is less before, whichever comes first.
        if apart < nearest - TIE or (apart < nearest + TIE and off < before):
            nearest, before = min(apart, nearest), off
    values[at + WALL_BEFORE] = max(WALL_BEHIND, min(before, FAR))


# What beams meet on the line of a body past both of its ends: wall, free space, or what is before it.

FEW_POINTS = 6
"""A face that is short, or of fewer points, has the direction of the building."""
LINE_REACH = 2.5
"""[m] A line is followed this far past either end of a body."""
LINE_PRIOR = 0.3
"""[m] So much of a line is taken for crossed beforehand."""
HIDDEN_BY = 0.6
"""[m] What is further before a line hides it."""
SPACING, MAX_STRIDE = 0.08, 6
"""[m] Beams that meet a line closer together than this are passed over, so many in a row at most."""
CROSSED, SLANT, FRONT = 2, 0.015, 0.1
"""So many beams in a row that pass through a line end it; it may turn by so much, m per m; it is not followed where beams
meet it at a lesser sine."""
NEAREST_LINE = 0.02
"""[m] A line nearer to the sensor is not followed."""


def _measure_face(features: Features, points: Points, faces: Faces, scans: Scans, k: int, face: int) -> None:
    """Measure how much of the line of one face of a body is met past both ends of the body, and how far it goes on."""
    values, at = features.values, k * COUNT
    along_x, along_y = faces.direction_x[face], faces.direction_y[face]
    if features.aligned[face] >= 0.5 or faces.length[face] < SHORT or faces.points[face] < FEW_POINTS:
        ahead = abs(along_x * features.cos + along_y * features.sin)
        aside = abs(along_y * features.cos - along_x * features.sin)
        along_x, along_y = features.cos, features.sin
        if aside > ahead:
            along_x, along_y = -features.sin, features.cos
    normal_x, normal_y = along_y, -along_x
    c = normal_x * faces.middle_x[face] + normal_y * faces.middle_y[face]
    if c < 0.0:
        normal_x, normal_y, c = -normal_x, -normal_y, -c
    features.met = features.crossed = features.goes_on = 0.0
    if c >= NEAREST_LINE:
        _follow(features, points, scans, features.first[k], -1, normal_x, normal_y, c)
        _follow(features, points, scans, features.last[k], 1, normal_x, normal_y, c)
    values[at + UNBROKEN] = faces.length[face] + features.goes_on
    values[at + LINE] = features.met / (features.met + features.crossed + LINE_PRIOR)


def _is_lost(points: Points, scans: Scans, position: int) -> bool:
    """Return whether the beam at a position, at most one turn beyond the seam, has no return."""
    if position < 0 or position >= points.bearings:
        position += points.bearings if position < 0 else -points.bearings
    if points.reverse:
        position = points.bearings - 1 - position
    return scans.status[points.row * scans.width + position] == segmentation.NO_RETURN


def _follow(
    features: Features, points: Points, scans: Scans, start: int, sign: int, normal_x: float, normal_y: float, c: float
) -> None:
    """Follow a line past one end of a body, and add what is met, what is crossed, and how far it goes on before two beams
    pass through it.
    """
    x, y, r, position, count = points.x, points.y, points.r, points.position, points.count
    p = start - count if start >= count else start
    q = normal_x * x[p] + normal_y * y[p]
    if q < FRONT * r[p]:
        return
    # Along the line, in the direction of the walk.
    along_x, along_y = -sign * normal_y, sign * normal_x
    begin = (along_y * y[p] + along_x * x[p]) * c / q
    last, through, far, met, crossed = begin, 0, 0.0, features.met, features.crossed
    plane = PLANE + PLANE_NOISE * points.sigma
    per_plane = 1.0 / plane
    # Where beams meet the line close together, not all of them are looked at.
    stride = 1
    while stride < MAX_STRIDE and (stride + 1) * c * points.step <= SPACING:
        stride += 1
    left, here, ahead = count - 1, position[p], sign * stride
    while left > 0:
        if stride > left:
            stride, ahead = left, sign * left
        left -= stride
        p += ahead
        expected = here + ahead
        if p < 0 or p >= count:
            if points.period == 0:
                break
            expected -= sign * points.period
            p += count if p < 0 else -count
        here = position[p]
        q = normal_x * x[p] + normal_y * y[p]
        if q < FRONT * r[p]:
            break
        s = (along_y * y[p] + along_x * x[p]) * c / q
        past = s - begin
        if s < last or past > LINE_REACH:
            break
        step, depth = s - last, q - c
        last = s
        if here != expected:
            lost = (here - expected) * sign
            if _is_lost(points, scans, here - sign):
                crossed += step * lost / (lost + stride)
            # Where beams were lost what is on the line is unknown.
            step = 0.0
        if through < CROSSED:
            allowed = plane + SLANT * past
            if depth > allowed:
                through += stride
            else:
                through = 0
                if depth >= -allowed:
                    far = past
        if per_plane * depth >= 1.5:
            crossed += step
        elif depth > -HIDDEN_BY:
            on = _share(per_plane * depth)
            met += step * on
            crossed += step * (1.0 - on)
    features.met, features.crossed = met, crossed
    features.goes_on += far
