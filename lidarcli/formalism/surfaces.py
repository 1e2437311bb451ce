"""Definitions 6 and 7 of the segments of a sweep: their vertices, and the faces, straight stretches between these.

Faces are found by splitting and merging: a stretch splits at its point farthest from the chord, as long as that distance
exceeds a tolerance (iterative end point fit; Nguyen et al. 2005); vertices that turn out to be flat between their
neighbours are dropped again, and so is one of two next to the same corner.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.system import native

MAX_SPLITS = 24
"""Levels of splitting; a segment of n points needs log2 n, a jagged one more."""
PASSES = 4
"""Flat vertices are dropped one neighbourhood at a time; more passes than this are never needed in practice."""
BLUNT = math.radians(20.0)
"""[rad] Lines closer to parallel than this meet too far away to say where the corner is."""
SIN_BLUNT = math.sin(BLUNT)
INFINITY = float("inf")


class Faces:
    """The `count` faces of the segments of a sweep, in order; consecutive faces of a segment share a vertex.

    Segment j has the faces `offset[j] … offset[j + 1] - 1`. The straight line of a face is given by its middle and its
    direction, a unit vector from its first to its last point: total least squares over its points.
    """

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.offset = native.integers(self.owner, most + 1)
        self.segment = native.integers(self.owner, 2 * most)
        self.first = native.integers(self.owner, 2 * most)
        self.last = native.integers(self.owner, 2 * most)
        self.points = native.integers(self.owner, 2 * most)
        self.middle_x = native.doubles(self.owner, 2 * most)
        self.middle_y = native.doubles(self.owner, 2 * most)
        self.direction_x = native.doubles(self.owner, 2 * most)
        self.direction_y = native.doubles(self.owner, 2 * most)
        self.rms = native.doubles(self.owner, 2 * most)
        """Root mean square distance of its points from the line [m]."""
        self.length = native.doubles(self.owner, 2 * most)
        """Distance of its end points along the line [m]."""
        self.count = 0
        # The points `begin` to `end` of x and y stand for a segment while its faces are sought: its own, or some of them,
        # `thinned`, with their places in the sweep. Where segments are not thinned, its inner vertices stay marked.
        self.begin = self.end = 0
        self.thinned = False
        self.thin_x = self.x = native.doubles(self.owner, 2 * most)
        self.thin_y = self.y = native.doubles(self.owner, 2 * most)
        self.index = native.integers(self.owner, 2 * most)
        self.inner = native.integers(self.owner, 2 * most)
        self.vertex = native.integers(self.owner, most + 1)
        self.share = native.doubles(self.owner, most + 1)
        self.away = native.doubles(self.owner, 2 * most)


def straight(faces: Faces, points: Points, segments: Segments, j: int, most: int, tolerance: float) -> None:
    """Append the faces of a segment that is split until every point is near the chord of its face, by `tolerance` [m].

    It is thinned evenly to about `most` points before, at least 2; fewer than 2 points have no face.
    """
    size = segments.size[j]
    if most < 2 or size < 2:
        return
    _trace(faces, points, segments, j, most)
    split(faces, tolerance)
    _join(faces, j)


def settled(faces: Faces, points: Points, segments: Segments, j: int, tolerance: float, low: int, high: int) -> None:
    """Append straight faces whose vertices stand out between their neighbours, one for each corner.

    Splitting at the farthest point leaves vertices that are flat once their neighbours are known, and two of them
    where a corner lies between two beams. Of a segment that was split the faces are `low` to `high` - 1.
    """
    if segments.size[j] < 2:
        return
    begin = faces.count
    _trace(faces, points, segments, j, segments.size[j])
    known = 1
    for f in range(low, high):
        known += faces.points[f] - 1
    # Those of all its points, in whose places there are no others yet.
    is_split = known == segments.size[j] and faces.first[low] == segments.first[j]
    if not is_split:
        split(faces, tolerance)
    if _drop_flat(faces, tolerance) or not is_split:
        _join(faces, j)
    else:
        for f in range(low, high):
            to = begin + f - low
            faces.segment[to], faces.points[to] = faces.segment[f], faces.points[f]
            faces.first[to], faces.last[to] = faces.first[f], faces.last[f]
            faces.middle_x[to], faces.middle_y[to] = faces.middle_x[f], faces.middle_y[f]
            faces.direction_x[to], faces.direction_y[to] = faces.direction_x[f], faces.direction_y[f]
            faces.rms[to], faces.length[to] = faces.rms[f], faces.length[f]
        faces.count += high - low
    if _drop_doubled(faces, begin):
        faces.count = begin
        _join(faces, j)


def between(faces: Faces, points: Points, segments: Segments, j: int, inner: Any) -> None:
    """Append the faces between the inner vertices that are marked among the points."""
    if segments.size[j] < 2:
        return
    _trace(faces, points, segments, j, segments.size[j])
    for k in range(faces.begin, faces.end + 1):
        faces.inner[k] = inner[k]
    _join(faces, j)


def _trace(faces: Faces, points: Points, segments: Segments, j: int, most: int) -> None:
    """Let some points of a segment stand for it, with its first and its last: evenly, and the same from either end."""
    first, last = segments.first[j], segments.size[j] - 1
    n = min(most, last + 1)
    # Of an odd number one is the middle, which an even number of points does not have.
    if n % 2 == 1 and last % 2 == 1 and n <= last:
        n += 1
    faces.thinned, faces.begin, faces.end = n <= last, first, first + n - 1
    if not faces.thinned:
        faces.x, faces.y = points.x, points.y
        return
    faces.x, faces.y = faces.thin_x, faces.thin_y
    for i in range(n):
        k = first + (i * last // (n - 1) if 2 * i < n else last - (n - 1 - i) * last // (n - 1))
        faces.index[first + i], faces.x[first + i], faces.y[first + i] = k, points.x[k], points.y[k]


def split(faces: Faces, tolerance: float) -> None:
    """Mark the inner vertices of what stands for a segment: where its faces meet."""
    for k in range(faces.begin, faces.end + 1):
        faces.inner[k] = False
    _split(faces, faces.begin, faces.end, tolerance, MAX_SPLITS)


def _split(faces: Faces, begin: int, end: int, tolerance: float, levels: int) -> None:
    if end - begin < 2 or levels == 0:
        return
    at = _farthest(faces, begin, end, tolerance)
    if at < 0:
        return
    faces.inner[at] = True
    _split(faces, begin, at, tolerance, levels - 1)
    _split(faces, at, end, tolerance, levels - 1)


def _farthest(faces: Faces, begin: int, end: int, tolerance: float) -> int:
    """The first point farthest from the chord of a stretch, -1 where none is beyond the tolerance."""
    x, y, away = faces.x, faces.y, faces.away
    x0, y0 = x[begin], y[begin]
    dx, dy = x[end] - x0, y[end] - y0
    length = math.sqrt(dx * dx + dy * dy)
    if length < tolerance:
        # The chord is a point.
        for k in range(begin + 1, end):
            away[k] = math.sqrt((x[k] - x0) * (x[k] - x0) + (y[k] - y0) * (y[k] - y0))
    else:
        scale = 1.0 / length
        normal_x, normal_y = dy * scale, -dx * scale
        base = x0 * normal_x + y0 * normal_y
        for k in range(begin + 1, end):
            away[k] = abs(normal_x * x[k] + normal_y * y[k] - base)
    best, at, k = tolerance, -1, begin + 1
    while k + 4 <= end:
        some = max(max(away[k], away[k + 1]), max(away[k + 2], away[k + 3]))
        if some > best:
            best, at = some, k
        k += 4
    while k < end:
        if away[k] > best:
            best, at = away[k], k
        k += 1
    # Of the four the first that is so far.
    while at >= 0 and away[at] < best:
        at += 1
    return at


def _drop_flat(faces: Faces, tolerance: float) -> bool:
    """Unmark the vertices within the tolerance of their neighbours' chord and flatter than both; not neighbours at once.

    True if there were any.
    """
    x, y, inner, vertex, share, found = faces.x, faces.y, faces.inner, faces.vertex, faces.share, False
    vertex[0], count = faces.begin, 1
    for k in range(faces.begin + 1, faces.end):
        if inner[k]:
            vertex[count] = k
            count += 1
    vertex[count] = faces.end
    count += 1
    for _ in range(PASSES):
        share[0] = share[count - 1] = INFINITY
        low = False
        for k in range(1, count - 1):
            a, b, c = vertex[k - 1], vertex[k], vertex[k + 1]
            chord_x, chord_y = x[c] - x[a], y[c] - y[a]
            length = math.sqrt(chord_x * chord_x + chord_y * chord_y)
            share[k] = INFINITY
            if length > tolerance:
                share[k] = abs((x[b] - x[a]) * chord_y - (y[b] - y[a]) * chord_x) / length / tolerance
                low = low or share[k] <= 1.0
        if not low:
            break
        kept = 1
        for k in range(1, count):
            if k < count - 1 and share[k] <= 1.0 and share[k] < share[k - 1] and share[k] <= share[k + 1]:
                inner[vertex[k]] = False
            else:
                vertex[kept] = vertex[k]
                kept += 1
        if kept == count:
            break
        count, found = kept, True
    return found


def _drop_doubled(faces: Faces, begin: int) -> bool:
    """Of two vertices on neighbouring points unmark the one further from where the faces next to them meet; True if there
    were any.

    `begin` is the first face of the segment.
    """
    x, y, found = faces.x, faces.y, False
    for f in range(begin + 1, faces.count - 1):
        if faces.points[f] != 2 or faces.points[f - 1] <= 2 or faces.points[f + 1] <= 2:
            continue
        usable, meet_x, meet_y = meeting(faces, f - 1, f + 1)
        a, b = faces.first[f], faces.last[f]
        from_a = (x[a] - meet_x) * (x[a] - meet_x) + (y[a] - meet_y) * (y[a] - meet_y)
        from_b = (x[b] - meet_x) * (x[b] - meet_x) + (y[b] - meet_y) * (y[b] - meet_y)
        if usable and min(from_a, from_b) < 4.0 * faces.length[f] * faces.length[f]:
            faces.inner[a if from_a > from_b else b] = False
            found = True
    return found


def meeting(faces: Faces, one: int, other: int) -> tuple[bool, float, float]:
    """Return whether the lines of two faces meet at a usable angle, and their meeting point x, y [m]."""
    ax, ay = faces.direction_x[one], faces.direction_y[one]
    bx, by = faces.direction_x[other], faces.direction_y[other]
    dx, dy = faces.middle_x[other] - faces.middle_x[one], faces.middle_y[other] - faces.middle_y[one]
    cross = ax * by - ay * bx
    usable = abs(cross) > SIN_BLUNT
    along = (dx * by - dy * bx) / (cross if usable else 1.0)
    return usable, faces.middle_x[one] + along * ax, faces.middle_y[one] + along * ay


def turn(faces: Faces, one: int, other: int) -> float:
    """Sine of the angle by which one face turns left from another."""
    return faces.direction_x[one] * faces.direction_y[other] - faces.direction_y[one] * faces.direction_x[other]


def _join(faces: Faces, j: int) -> None:
    """Append the faces between the vertices that are marked; a vertex between two faces belongs to both."""
    begin, last = faces.begin, faces.end
    while begin < last:
        end = begin + 1
        while end < last and not faces.inner[end]:
            end += 1
        f = faces.count
        faces.segment[f] = j
        faces.first[f] = faces.index[begin] if faces.thinned else begin
        faces.last[f] = faces.index[end] if faces.thinned else end
        faces.points[f] = end - begin + 1
        _fit(faces, f, begin, end)
        faces.count += 1
        begin = end


def _fit(faces: Faces, f: int, begin: int, end: int) -> None:
    """The straight line of a face: total least squares of its points, with moments about the first of them."""
    x, y, x0, y0 = faces.x, faces.y, faces.x[begin], faces.y[begin]
    sum_x, sum_y, sum_xx, sum_xy, sum_yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(begin, end + 1):
        dx, dy = x[k] - x0, y[k] - y0
        sum_x += dx
        sum_y += dy
        sum_xy += dx * dy
        sum_xx += dx * dx
        sum_yy += dy * dy
    share = 1.0 / (end - begin + 1)
    mean_x, mean_y = sum_x * share, sum_y * share
    xy = sum_xy * share - mean_x * mean_y
    xx = sum_xx * share - mean_x * mean_x
    yy = sum_yy * share - mean_y * mean_y
    half = 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    # The line has half the angle of (half, xy); where all points are one, any.
    far = root + abs(half)
    norm = math.sqrt(far * far + xy * xy)
    along, across = 1.0, 0.0
    if norm > 0.0:
        along, across = far * (1.0 / norm), xy * (1.0 / norm)
    direction_x = along if half >= 0.0 else across
    direction_y = across if half >= 0.0 else along
    length = (x[end] - x0) * direction_x + (y[end] - y0) * direction_y
    side = -1.0 if length < 0.0 else 1.0
    faces.middle_x[f], faces.middle_y[f] = x0 + mean_x, y0 + mean_y
    faces.direction_x[f], faces.direction_y[f] = side * direction_x, side * direction_y
    faces.rms[f] = math.sqrt(max(0.5 * (xx + yy) - root, 0.0))
    faces.length[f] = abs(length)


# Definition 6 as printed: the vertices of a segment, where f' = 0 and where f' jumps.


def mark_vertices(points: Points, segments: Segments, inner: Any, extremum: Any) -> None:
    """Mark the inner vertices of all segments, and which of them are extrema of r rather than corners.

    Between beams f is monotone, so f' = 0 shows as a difference s that changes its sign or becomes 0: at local minima and
    maxima of r, and where a level stretch begins. f' jumps where two consecutive differences differ by more than d_th, the
    only threshold the paper has.
    """
    r = points.r
    for j in range(segments.count):
        for k in range(segments.first[j], segments.first[j] + segments.size[j]):
            inner[k] = extremum[k] = False
        for k in range(segments.first[j] + 1, segments.first[j] + segments.size[j] - 1):
            before, after = r[k] - r[k - 1], r[k + 1] - r[k]
            extremum[k] = before != 0 and before * after <= 0
            inner[k] = extremum[k] or abs(after - before) > points.d_th


# What is known of each segment before anybody decides what it is.

STRAIGHT, STRAIGHT_NOISE = 0.02, 3.0
"""A face may leave its chord by this much [m] plus so many times the noise."""
WALL_STRIDE, WALL_POINTS = 4, 32
"""Of a segment too wide for an object every fourth point is looked at, or as many as make 32: enough for its lines."""


class Survey:
    """Results for each segment, as far as they are known."""

    def __init__(self, most: int, min_beams: int, max_width: float) -> None:
        """Drop objects of fewer points than `min_beams` or wider than `max_width` [m]."""
        self.owner: list[Any] = []
        self.min_beams = min_beams
        self.max_width = max_width
        self.chord = native.doubles(self.owner, most)
        """Distance of its first and last points [m]."""
        self.tolerance = native.doubles(self.owner, most)
        """Greatest distance of a face from its chord [m]."""
        self.extent = native.doubles(self.owner, most)
        """Greatest distance of a vertex from its first or last point [m]."""
        self.protrusion = native.integers(self.owner, most)
        """True if it stands out from a wall that it touches."""
        self.wall = native.integers(self.owner, most)
        self.thing = native.doubles(self.owner, most)
        """Probability of being an object and not building; NaN where it was not asked."""
        self.candidate = native.integers(self.owner, most)
        """True if it may be an object or a fragment of one."""
        self.loose = native.integers(self.owner, most)
        """True if it may be joined with its neighbours."""
        self.is_object = native.integers(self.owner, most)
        self.label = native.integers(self.owner, most)
        """Segments of the same label are one object."""


def measure_chords(survey: Survey, points: Points, segments: Segments) -> None:
    """Compute the chord of every segment, and the tolerance of its faces."""
    tolerance = STRAIGHT + STRAIGHT_NOISE * points.sigma
    for j in range(segments.count):
        survey.chord[j] = segmentation.chord(segments, points, j)
        survey.tolerance[j] = tolerance
        survey.protrusion[j] = False


def find_faces(survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Find the faces of every segment that may be an object, and the rough faces of the others."""
    faces.count = 0
    for j in range(segments.count):
        size = segments.size[j]
        if survey.chord[j] <= survey.max_width:
            most = size if size >= survey.min_beams else 0
        else:
            most = max((size + WALL_STRIDE - 1) // WALL_STRIDE, min(size, WALL_POINTS))
        faces.offset[j] = faces.count
        straight(faces, points, segments, j, most, survey.tolerance[j])
    faces.offset[segments.count] = faces.count


def measure_extent(survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Compute the extent of every segment [m]: the greatest distance of a vertex from its first or last point."""
    x, y = points.x, points.y
    for j in range(segments.count):
        survey.extent[j] = survey.chord[j]
        if faces.offset[j + 1] - faces.offset[j] < 2:
            continue
        a, b = segments.first[j], segmentation.last_point(segments, j)
        farthest = 0.0
        for f in range(faces.offset[j], faces.offset[j + 1]):
            k = faces.last[f]
            # Where an object was cut out of a wall a face may go on past its end.
            if k > b:
                continue
            farthest = max(farthest, (x[k] - x[a]) * (x[k] - x[a]) + (y[k] - y[a]) * (y[k] - y[a]))
            farthest = max(farthest, (x[k] - x[b]) * (x[k] - x[b]) + (y[k] - y[b]) * (y[k] - y[b]))
        survey.extent[j] = max(survey.extent[j], math.sqrt(farthest))


def is_partial(segments: Segments, j: int) -> bool:
    """Return whether a segment may go on at an edge that is hidden, beyond the view or unknown."""
    return not (is_end(segments.start_edge[j]) and is_end(segments.end_edge[j]))


def is_end(edge: int) -> bool:
    """Return whether a segment ends at an edge."""
    return edge == segmentation.OWN or edge == segmentation.OPEN
