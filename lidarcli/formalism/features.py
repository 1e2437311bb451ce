"""Verdict of Definition 5, thing or building: features of a body, and the probability that trees give it by these.

A wall goes on: in the direction of the building, on its own line, behind what hides it. A thing ends: at steps, before free
space. Every feature is one such question, put to the whole sweep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from lidarcli import native
from lidarcli.formalism import forest, segmentation
from lidarcli.formalism.objects import Bodies
from lidarcli.formalism.segmentation import Points, Scans, Segments
from lidarcli.formalism.surfaces import Faces, Survey

NAMES = (
    *(
        "jump_least",
        "jump_most",
        "hidden",
        "open",
        "width",
        "extent",
        "beams",
        "aligned",
        "support",
        "support_near",
        "backing",
    ),
    *("line", "line_behind", "depth_behind", "line_before", "unbroken", "cross_line", "bulge_to", "bulge_away", "walls"),
    *("noise", "grazing", "protrusion", "roughness", "view", "range", "flicker"),
)
"""Names of the features in their order (docs/formalism.md explains them)."""
JUMP_LEAST, JUMP_MOST, HIDDEN, OPEN, WIDTH, EXTENT, BEAMS, ALIGNED, SUPPORT, SUPPORT_NEAR, BACKING = range(11)
LINE, LINE_BEHIND, DEPTH_BEHIND, LINE_BEFORE, UNBROKEN, CROSS_LINE, BULGE_TO, BULGE_AWAY, WALLS = range(11, 20)
NOISE, GRAZING, PROTRUSION, ROUGHNESS, VIEW, RANGE, FLICKER, COUNT = range(20, 28)

FAR, NEARER = 3.0, -2.0
"""[m] Greatest and least jump: the greatest is also that at an edge behind which nothing is seen."""
BINS = 52
"""Depths before and behind a line that are told apart."""


class Features:
    """Bodies of a sweep that may be things, with their features."""

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
        # Of each face: whether it is aligned, with which axis, its offset from the sensor, where it begins and ends.
        self.aligned = native.integers(self.owner, 2 * most)
        self.axis = native.integers(self.owner, 2 * most)
        self.offset = native.doubles(self.owner, 2 * most)
        self.low = native.doubles(self.owner, 2 * most)
        self.high = native.doubles(self.owner, 2 * most)
        self.lines = native.integers(self.owner, 2 * most)
        """Aligned faces that are long enough to be parts of lines, those along the building before those across."""
        self.begin = native.integers(self.owner, 3)
        """(3,) begin of the lines of each axis in `lines`, then their end."""
        self.cos = 1.0
        """Direction of the building."""
        self.sin = 0.0
        self.angle = native.doubles(self.owner, 2 * most)
        self.length = native.doubles(self.owner, 2 * most)
        self.votes = native.doubles(self.owner, 2 * most)
        self.bins = native.doubles(self.owner, BINS)
        """[m] How much of a line is met at each depth."""
        self.sums = native.doubles(self.owner, BINS + 1)
        """Sums of the bins before each one, and of all."""
        self.goes_on = 0.0
        """[m] How far a line goes on past the ends of a body without a beam that passes through it."""
        self.share = 0.0
        """Share of the points of the sweep that are on walls."""


def gather(features: Features, survey: Survey, points: Points, segments: Segments, bodies: Bodies) -> None:
    """List the bodies that may be things: of candidate segments, with enough points and no wider than an object."""
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
    align(features, points, faces)
    for k in range(features.count):
        measure_edges(features, points, segments, bodies, k)
        measure_outline(features, survey, points, segments, bodies, k)
        measure_support(features, points, segments, faces, k)
        measure_line(features, points, segments, faces, scans, k)


# What is seen of a body by itself: its edges, its size, its form.


def _jump(edge: int, s: float) -> float:
    """Return the distance by which the neighbour of an edge is further away [m]."""
    if edge == segmentation.OWN or edge == segmentation.HIDDEN:
        return max(NEARER, min(s, FAR)) if s == s else 0.0
    return FAR


def _is_unseen(edge: int) -> bool:
    """Return whether the beam beside an edge has no range."""
    return edge == segmentation.OPEN or edge == segmentation.UNKNOWN or edge == segmentation.FLICKERING


def measure_edges(features: Features, points: Points, segments: Segments, bodies: Bodies, k: int) -> None:
    """Fill in the features of the two edges of a body."""
    values, at = features.values, k * COUNT
    head, tail = features.member[features.start[k]], features.member[features.start[k + 1] - 1]
    start, end = segments.start_edge[head], segments.end_edge[tail]
    one = _jump(start, -segments.s_start[head])
    other = _jump(end, segments.s_end[tail])
    values[at + JUMP_LEAST], values[at + JUMP_MOST] = min(one, other), max(one, other)
    hidden = (start == segmentation.HIDDEN) + (end == segmentation.HIDDEN)
    unseen = _is_unseen(start) + _is_unseen(end)
    values[at + HIDDEN], values[at + OPEN] = hidden, unseen
    values[at + VIEW] = (start == segmentation.VIEW) + (end == segmentation.VIEW)
    values[at + BEAMS] = math.log(bodies.size[head])
    values[at + EXTENT] = bodies.extent[head]
    values[at + WALLS] = features.share
    values[at + NOISE], values[at + FLICKER] = points.sigma, points.flicker


def measure_outline(features: Features, survey: Survey, points: Points, segments: Segments, bodies: Bodies, k: int) -> None:
    """Fill in the features of the size and form of a body."""
    values, at, x, y = features.values, k * COUNT, points.x, points.y
    head, tail = features.member[features.start[k]], features.member[features.start[k + 1] - 1]
    a, b = segments.first[head], segmentation.last_point(segments, tail)
    dx, dy = x[b] - x[a], y[b] - y[a]
    width = math.sqrt(dx * dx + dy * dy)
    values[at + WIDTH] = width
    middle_x, middle_y = 0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b])
    away = math.sqrt(middle_x * middle_x + middle_y * middle_y)
    values[at + RANGE] = away
    values[at + PROTRUSION] = 1.0 if survey.protrusion[head] else 0.0
    values[at + BULGE_TO] = values[at + BULGE_AWAY] = values[at + ROUGHNESS] = 0.0
    values[at + GRAZING] = 1.0
    if not width > 0.0 or not away > 0.0:
        return
    normal_x, normal_y = dy / width, -dx / width
    # Towards the sensor.
    if normal_x * x[a] + normal_y * y[a] > 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    values[at + GRAZING] = abs(normal_x * middle_x + normal_y * middle_y) / away
    base = normal_x * x[a] + normal_y * y[a]
    towards, behind, rough, number = 0.0, 0.0, 0.0, 0
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        first = segments.first[j]
        for p in range(first, first + segments.size[j]):
            off = normal_x * x[p] + normal_y * y[p] - base
            towards, behind = max(towards, off), max(behind, -off)
            if p > first + 1:
                bend = off - 2.0 * (normal_x * x[p - 1] + normal_y * y[p - 1] - base)
                bend += normal_x * x[p - 2] + normal_y * y[p - 2] - base
                rough += abs(bend)
                number += 1
    values[at + BULGE_TO], values[at + BULGE_AWAY] = towards, behind
    values[at + ROUGHNESS] = rough / number if number > 0 else 0.0


# The directions of a building, and how much of a sweep lies on the lines of a body.

RIGHT_ANGLE = 0.5 * math.pi
KERNEL, CLOSE = math.radians(4.0), math.radians(5.0)
"""[rad] A face speaks for directions up to the first from its own; faces up to the second from the best make it exact."""
DIRECTION_LENGTH, DIRECTION_POINTS = 0.25, 4
"""[m] Shorter faces, and those of fewer points, do not tell directions."""
ALIGNED_LEAST, ALIGNED_MOST = math.tan(math.radians(5.0)), math.tan(math.radians(20.0))
"""Tangents of the angles by which an aligned face may be off, as its noise allows."""
ALIGNED_NOISE = 4.0 * math.sqrt(3.0)
FACE_POINTS, FACE_LENGTH = 3, 0.08
"""[m] Lesser faces give no line."""
FACE_PLANE, FACE_PLANE_NOISE = 0.03, 2.0
"""[m] Faces of one line differ by so much, and by so many times the noise."""
RELIEF = 0.32
"""[m] What stands out from a wall does so by no more than this."""
LINE_NEAR, LINE_BESIDE = 1.3, 0.6
"""[m] along a line: a piece is near; a piece is behind."""


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


def align(features: Features, points: Points, faces: Faces) -> None:
    """Mark the faces that run with or across the building, and compute their places in its axes."""
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
    for axis in range(2):
        number = features.begin[axis]
        for f in range(faces.count):
            is_line = faces.points[f] >= FACE_POINTS and faces.length[f] > FACE_LENGTH
            if is_line and features.aligned[f] and features.axis[f] == axis:
                features.lines[number] = f
                number += 1
        features.begin[axis + 1] = number


def measure_support(features: Features, points: Points, segments: Segments, faces: Faces, k: int) -> None:
    """Fill in the features of the other faces of the sweep on the lines of a body, and a little behind them."""
    values, at = features.values, k * COUNT
    head = features.member[features.start[k]]
    longest, total, aligned = 0.0, 0.0, 0.0
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            total += faces.length[f]
            longest = max(longest, faces.length[f])
            if features.aligned[f]:
                aligned += faces.length[f]
    values[at + ALIGNED] = aligned / total if total > 0.0 else 0.0
    values[at + SUPPORT] = values[at + SUPPORT_NEAR] = values[at + BACKING] = 0.0
    some = False
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if features.aligned[f] and faces.length[f] >= 0.5 * longest:
                some = True
                _add_support(
                    features, points, faces, k, features.axis[f], features.offset[f], features.low[f], features.high[f], 1.0
                )
    if not some:
        nearest = segments.first[head]
        for part in range(features.start[k], features.start[k + 1]):
            j = features.member[part]
            for p in range(segments.first[j], segments.first[j] + segments.size[j]):
                if points.r[p] < points.r[nearest]:
                    nearest = p
        x, y = points.x[nearest], points.y[nearest]
        u, v = x * features.cos + y * features.sin, y * features.cos - x * features.sin
        _add_support(features, points, faces, k, 0, v, u, u, 0.5)
        _add_support(features, points, faces, k, 1, u, v, v, 0.5)
    for i in range(SUPPORT, BACKING + 1):
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
    share: float,
) -> None:
    """Raise the support of a body to that of one of its lines, if that is more."""
    values, at = features.values, k * COUNT
    allowed = FACE_PLANE + FACE_PLANE_NOISE * points.sigma
    everywhere, near, behind = 0.0, 0.0, 0.0
    side = 1.0 if offset > 0.0 else -1.0
    for i in range(features.begin[axis], features.begin[axis + 1]):
        g = features.lines[i]
        depth = (features.offset[g] - offset) * side
        if not (depth >= -allowed and depth <= RELIEF) or features.body[faces.segment[g]] == k:
            continue
        length = faces.length[g]
        gap = max(features.low[g] - high, low - features.high[g])
        if depth <= allowed:
            everywhere += length
            if gap < LINE_NEAR:
                near += length
        elif gap < LINE_BESIDE:
            behind += length
    values[at + SUPPORT] = max(values[at + SUPPORT], share * everywhere)
    values[at + SUPPORT_NEAR] = max(values[at + SUPPORT_NEAR], share * near)
    values[at + BACKING] = max(values[at + BACKING], share * behind)


# What beams meet on the line of a body past both of its ends: wall, free space, or what stands before it.

OWN_LENGTH, OWN_POINTS = 0.4, 6
"""[m] A face that is not aligned has a line of its own from this length on."""
LINE_REACH = 2.5
"""[m] A line is followed this far past either end of a body."""
LINE_PLANE, LINE_NOISE = 0.035, 2.0
"""[m] Points this near to a line, and so many times the noise, are on it."""
TINY = 1e-9
"""Less is rounding."""
LINE_PRIOR = 0.3
"""[m] So much of a line is taken for crossed beforehand."""
BIN = 0.02
"""[m] Depths before and behind a line are told apart by steps of this."""
BINS_BEFORE = 30
"""Of the bins, those before the line."""
SHALLOWEST, DEEPEST = -BIN * BINS_BEFORE, BIN * (BINS - BINS_BEFORE) - 0.5 * BIN
"""[m] What lies further before a line or behind it is in no bin."""
SPACING, MOST_STRIDE = 0.08, 6
"""[m] Beams that meet a line closer together than this are passed over, so many in a row at most."""
BEHIND_FIRST, BEHIND_LAST = 3, 15
"""Bins behind the line in which a wall may lie from which the body stands out: 6 to 30 cm."""
BEFORE_FIRST, BEFORE_LAST = 4, 25
"""Bins before it in which one may lie that has the body in its niche: 8 to 50 cm."""
CROSSED, SLANT, FRONT = 2, 0.015, 0.1
"""So many beams in a row that pass through a line end it; it may turn by so much, m per m; it is not followed where beams
meet it at a lesser sine."""


def measure_line(features: Features, points: Points, segments: Segments, faces: Faces, scans: Scans, k: int) -> None:
    """Fill in the features of the lines of the longest face of a body and of the longest one across it, past its ends."""
    values, at = features.values, k * COUNT
    for i in range(LINE, CROSS_LINE + 1):
        values[at + i] = 0.0
    face, cross = -1, -1
    for part in range(features.start[k], features.start[k + 1]):
        j = features.member[part]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if face < 0 or faces.length[f] > faces.length[face]:
                face = f
    if face < 0:
        return
    values[at + UNBROKEN] = faces.length[face]
    if features.aligned[face]:
        for part in range(features.start[k], features.start[k + 1]):
            j = features.member[part]
            for f in range(faces.offset[j], faces.offset[j + 1]):
                if not features.aligned[f] or features.axis[f] == features.axis[face]:
                    continue
                if faces.points[f] >= FACE_POINTS and (cross < 0 or faces.length[f] > faces.length[cross]):
                    cross = f
    if cross >= 0:
        _measure_face(features, points, segments, faces, scans, k, cross)
        values[at + CROSS_LINE] = max(values[at + LINE], values[at + LINE_BEHIND])
    _measure_face(features, points, segments, faces, scans, k, face)


def _measure_face(
    features: Features, points: Points, segments: Segments, faces: Faces, scans: Scans, k: int, face: int
) -> None:
    """Measure the surfaces on the line of one face of a body, before it and behind it, past both ends of the body."""
    values, at, bins, sums = features.values, k * COUNT, features.bins, features.sums
    for i in range(LINE, UNBROKEN):
        values[at + i] = 0.0
    head, tail = features.member[features.start[k]], features.member[features.start[k + 1] - 1]
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
    for i in range(BINS):
        bins[i] = 0.0
    first, last = segments.first[head], segmentation.last_point(segments, tail)
    features.goes_on = 0.0
    beyond = _follow(features, points, scans, first, -1, normal_x, normal_y, c)
    beyond += _follow(features, points, scans, last, 1, normal_x, normal_y, c)
    values[at + UNBROKEN] = faces.length[face] + features.goes_on
    for i in range(BINS):
        sums[i + 1] = sums[i] + bins[i]
    half = int((LINE_PLANE + LINE_NOISE * points.sigma) / BIN + 0.5)
    values[at + LINE] = _share(sums, beyond, BINS_BEFORE, half)
    behind, depth, before = 0.0, 0.0, 0.0
    for i in range(BEHIND_FIRST, BEHIND_LAST + 1):
        share = _share(sums, beyond, BINS_BEFORE + i, half)
        # Of depths with the same share, which rounding must not tell apart, the least one.
        if share > behind + TINY:
            behind, depth = share, i * BIN
    for i in range(BEFORE_FIRST, BEFORE_LAST + 1):
        before = max(before, _share(sums, beyond, BINS_BEFORE - i, half))
    values[at + LINE_BEHIND], values[at + DEPTH_BEHIND] = behind, depth
    values[at + LINE_BEFORE] = before


def _share(sums: Sequence[float], beyond: float, at: int, half: int) -> float:
    """Return the share of a line that is met around a bin, of what beams have met there or crossed."""
    end = min(at + half + 1, BINS)
    met = sums[end] - sums[max(at - half, 0)]
    return met / (met + sums[BINS] - sums[end] + beyond + LINE_PRIOR)


def _follow(
    features: Features, points: Points, scans: Scans, start: int, sign: int, normal_x: float, normal_y: float, c: float
) -> float:
    """Follow a line past one end of a body: add how much of it [m] is met at which depth to `bins`, and how far it goes on
    without a beam that passes through it to `goes_on`; return how much is crossed by beams that meet nothing near it [m].
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
        p += sign * skip
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
        step = (s - last) * sign
        away = (s - begin) * sign
        if step < 0.0 or away > LINE_REACH:
            break
        last = s
        lost = (position[p] - position[before]) * sign + turn - skip
        depth = q - c
        if lost > 0:
            beam = segmentation.beam_at(points, position[p] - sign)
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


# The verdict: small decision trees ask for the features of a body, and each adds to the log-odds of being a thing.

ASKED, LEAVES = 7, 8
"""Questions and leaves of a tree."""


class Trees:
    """Complete binary trees: each question is whether a feature is above a bound; node n goes on with 2n + 1 or 2n + 2."""

    def __init__(self, trees: forest.Trees, prior: float) -> None:
        """`trees` as `forest` has them, `prior` the log-odds before any tree."""
        self.owner: list[Any] = []
        self.prior = prior
        self.trees = len(trees)
        self.feature = native.integers(self.owner, ASKED * self.trees)
        self.bound = native.doubles(self.owner, ASKED * self.trees)
        self.leaf = native.doubles(self.owner, LEAVES * self.trees)
        for number, (questions, leaves) in enumerate(trees):
            for n, (feature, bound, _) in enumerate(questions):
                self.feature[ASKED * number + n], self.bound[ASKED * number + n] = feature, bound
            for n, value in enumerate(leaves):
                self.leaf[LEAVES * number + n] = value


TREES = Trees(forest.TREES, forest.PRIOR)


class Verdict:
    """Verdicts on the bodies of a sweep."""

    def __init__(self, most: int, least: float) -> None:
        """`most` is the greatest number of beams of a sweep, `least` the least probability of a thing."""
        self.owner: list[Any] = []
        self.trees = TREES
        self.least = least
        self.thing = native.doubles(self.owner, most)
        """Probability of each body."""


def decide(verdict: Verdict, evidence: Features) -> None:
    """Decide the probability of each body to be a thing."""
    for k in range(evidence.count):
        verdict.thing[k] = 1.0 / (1.0 + math.exp(-score(verdict.trees, evidence, k)))


def score(trees: Trees, evidence: Features, k: int) -> float:
    """Return the log-odds of a body: the sum of one leaf of each tree."""
    feature, bound, leaf, values = trees.feature, trees.bound, trees.leaf, evidence.values
    total, begin, root = trees.prior, k * COUNT, 0
    for tree in range(trees.trees):
        # Without branches, which would be guessed wrong.
        n = root + 1 + (values[begin + feature[root]] > bound[root])
        n = 2 * n + 1 - root + (values[begin + feature[n]] > bound[n])
        n = 2 * n + 1 - root + (values[begin + feature[n]] > bound[n])
        total += leaf[n - ASKED + tree]
        root += ASKED
    return total


def choose(survey: Survey, segments: Segments, evidence: Features, verdict: Verdict) -> None:
    """Profile `robust`: mark the segments that are objects or fragments of some, and those that are building."""
    for j in range(segments.count):
        body = evidence.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True
