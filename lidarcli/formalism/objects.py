"""Definition 5: objects of one segment, of several together, or of a part of one.

Objects that touch a wall are cut out of its segment, fragments of one object are joined, and so are the legs of a chair
where that is asked for. What profile `robust` takes for an object is for `verdict` to say."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import segmentation, surfaces
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import Faces, Survey
from lidarcli.system import native

# Objects that touch a wall: where no step divides the two, the corner between them does.

CORNER_TURN = math.radians(25.0)
"""[rad] Faces that turn less than this do not make a corner."""
SIN_CORNER_TURN = math.sin(CORNER_TURN)
BACKING = 0.3
"""[m] A face at least this long, next to which an object stands, is wall."""
MIN_RELIEF, WIDEST, BEHIND, PLANE = 0.1, 1.5, 0.1, 0.03
"""[m] An object stands out from its wall by more than the first, as mouldings do not, over no more than the second; what is
observed past its free edge lies no further than the third behind the line of the wall; points on the wall stand out less
than the last."""
TRIM = 6
"""At each end so many points may turn out to be wall: the corner is only known to every few points."""


class Protrusions:
    """The `count` stretches of segments that stand out from a wall, in order: points `first` to `last`."""

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.segment = native.integers(self.owner, most)
        self.first = native.integers(self.owner, most)
        self.last = native.integers(self.owner, most)
        self.count = 0
        # The segments as they are divided, and where the parts of one of them begin.
        self.parts = Segments(most)
        self.stands_out = native.integers(self.owner, most)
        self.begin = native.integers(self.owner, 2 * most + 1)
        self.is_protrusion = native.integers(self.owner, 2 * most + 1)


def find_protrusions(protrusions: Protrusions, survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Find stretches that stand out: between corners that point away, with corners that point at the sensor."""
    protrusions.count = 0
    for j in range(segments.count):
        low, high = faces.offset[j], faces.offset[j + 1]
        if segments.size[j] < survey.min_beams or high - low < 2:
            continue
        end = low
        while end < high:
            begin = end
            end = begin + 1
            pointed = False
            while end < high and not surfaces.turn(faces, end - 1, end) > SIN_CORNER_TURN:
                pointed = pointed or surfaces.turn(faces, end - 1, end) < -SIN_CORNER_TURN
                end += 1
            _add(protrusions, points, segments, faces, j, begin, end, pointed)


def _add(
    protrusions: Protrusions, points: Points, segments: Segments, faces: Faces, j: int, begin: int, end: int, pointed: bool
) -> None:
    """Add the faces `begin` … `end` - 1 of a segment, if they stand out; `pointed`: a corner between them points at the
    sensor.
    """
    low, high = faces.offset[j], faces.offset[j + 1]
    has_wall_before, has_wall_after = begin > low, end < high
    if not (has_wall_before or has_wall_after) or not (pointed or not has_wall_before or not has_wall_after):
        return
    # Of two straight faces without another corner the longer one is the wall.
    least = BACKING
    if not pointed:
        total = 0.0
        for f in range(begin, end):
            total += faces.length[f]
        least = max(BACKING, total)
    before, after = begin, begin
    if has_wall_before:
        before = _longest(faces, begin - 1, low, -1)
        if not faces.length[before] >= least:
            return
    elif segments.start_edge[j] != segmentation.OWN:
        return
    if has_wall_after:
        after = _longest(faces, end, high - 1, 1)
        if not faces.length[after] >= least:
            return
    elif segments.end_edge[j] != segmentation.OWN:
        return

    margin = 2.0 * points.sigma
    first, last = faces.first[begin], faces.last[end - 1]
    if not _is_small(points, faces, begin, end):
        return
    if has_wall_before and not _relief(points, faces, begin, end, before) > MIN_RELIEF + margin:
        return
    if has_wall_after and not _relief(points, faces, begin, end, after) > MIN_RELIEF + margin:
        return
    # At a free end the wall goes on, or is visible through a doorway.
    if not has_wall_after:
        beyond = segments.first[segmentation.following(segments, points, j)]
        if not depth(points, faces, before, beyond) >= -(BEHIND + margin):
            return
    if not has_wall_before:
        beyond = segmentation.last_point(segments, segmentation.preceding(segments, points, j))
        if not depth(points, faces, after, beyond) >= -(BEHIND + margin):
            return
    if has_wall_before:
        first = _trimmed(points, faces, before, first, last, 1, PLANE + margin)
    if has_wall_after:
        last = _trimmed(points, faces, after, last, first, -1, PLANE + margin)
    if last > first:
        k = protrusions.count
        protrusions.segment[k], protrusions.first[k], protrusions.last[k] = j, first, last
        protrusions.count += 1


def _longest(faces: Faces, at: int, end: int, step: int) -> int:
    """Return the first of the longest run of faces from `at` towards `end` that has no corner."""
    # Two points only cut the corner that they lie at.
    if at != end and faces.points[at] == 2:
        at += step
    longest, f = at, at
    while f != end and not abs(surfaces.turn(faces, f, f + step)) > SIN_CORNER_TURN:
        f += step
        if faces.length[f] > faces.length[longest] or (step < 0 and faces.length[f] == faces.length[longest]):
            longest = f
    return longest


def _is_small(points: Points, faces: Faces, begin: int, end: int) -> bool:
    """Return whether all vertices of some faces are near their first and their last one."""
    first, last = faces.first[begin], faces.last[end - 1]
    if not segmentation.distance(points, first, last) <= WIDEST:
        return False
    for f in range(begin, end):
        at = faces.last[f]
        if not (segmentation.distance(points, first, at) <= WIDEST and segmentation.distance(points, at, last) <= WIDEST):
            return False
    return True


def _relief(points: Points, faces: Faces, begin: int, end: int, wall: int) -> float:
    """Return the distance of the foremost vertex of some faces before a wall [m]."""
    foremost = depth(points, faces, wall, faces.first[begin])
    for f in range(begin, end):
        foremost = max(foremost, depth(points, faces, wall, faces.last[f]))
    return foremost


def depth(points: Points, faces: Faces, wall: int, at: int) -> float:
    """Return the distance of a point before the line of a face, towards the sensor [m]."""
    middle_x, middle_y = faces.middle_x[wall], faces.middle_y[wall]
    direction_x, direction_y = faces.direction_x[wall], faces.direction_y[wall]
    side = 1.0 if middle_y * direction_x - middle_x * direction_y > 0 else -1.0
    return ((points.x[at] - middle_x) * direction_y - (points.y[at] - middle_y) * direction_x) * side


def _trimmed(points: Points, faces: Faces, wall: int, at: int, other: int, step: int, tolerance: float) -> int:
    """Return an end of a stretch, moved inwards past the points that lie on the wall next to it."""
    for _ in range(TRIM):
        if (other - at) * step <= 0 or not depth(points, faces, wall, at) <= tolerance:
            break
        at += step
    return at


def divide(protrusions: Protrusions, survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Divide the segments at the protrusions that were found, and their faces with them."""
    if protrusions.count == 0:
        return
    number = 0
    protrusions.parts.count = 0
    for j in range(segments.count):
        begins = 1
        protrusions.begin[0], protrusions.is_protrusion[0] = segments.first[j], False
        while number < protrusions.count and protrusions.segment[number] == j:
            _insert_part(protrusions, begins, protrusions.first[number], True)
            _insert_part(protrusions, begins + 1, protrusions.last[number] + 1, False)
            begins += 2
            number += 1
        last = segmentation.last_point(segments, j)
        for k in range(begins):
            stop = protrusions.begin[k + 1] - 1 if k + 1 < begins else last
            if stop >= protrusions.begin[k]:
                protrusions.stands_out[protrusions.parts.count] = protrusions.is_protrusion[k]
                _append(
                    protrusions.parts, points, segments, j, protrusions.begin[k], stop, protrusions.is_protrusion[k] != 0
                )
    segmentation.copy_segments(protrusions.parts, segments)
    for p in range(segments.count):
        survey.protrusion[p] = protrusions.stands_out[p]
        survey.tolerance[p] = survey.tolerance[0]
        survey.chord[p] = segmentation.chord(segments, points, p)
    _assign(faces, segments)


def _insert_part(protrusions: Protrusions, count: int, begin: int, is_protrusion: bool) -> None:
    """Put the begin of a part in its place among `count` others, what stands out after what does not."""
    k = count
    while k > 0 and (
        protrusions.begin[k - 1] > begin
        or (protrusions.begin[k - 1] == begin and protrusions.is_protrusion[k - 1] and not is_protrusion)
    ):
        protrusions.begin[k] = protrusions.begin[k - 1]
        protrusions.is_protrusion[k] = protrusions.is_protrusion[k - 1]
        k -= 1
    protrusions.begin[k], protrusions.is_protrusion[k] = begin, is_protrusion


def _append(parts: Segments, points: Points, segments: Segments, j: int, begin: int, stop: int, stands_out: bool) -> None:
    """Append the points `begin` to `stop` of a segment as a part: at an inner edge what stands out is nearer."""
    p, r, edge = parts.count, points.r, segmentation.OWN if stands_out else segmentation.HIDDEN
    parts.first[p], parts.size[p] = begin, stop - begin + 1
    if begin == segments.first[j]:
        parts.start_edge[p], parts.s_start[p] = segments.start_edge[j], segments.s_start[j]
    else:
        parts.start_edge[p], parts.s_start[p] = edge, r[begin] - r[begin - 1]
    if stop == segmentation.last_point(segments, j):
        parts.end_edge[p], parts.s_end[p] = segments.end_edge[j], segments.s_end[j]
    else:
        parts.end_edge[p], parts.s_end[p] = edge, r[stop + 1] - r[stop]
    parts.count += 1


def _assign(faces: Faces, segments: Segments) -> None:
    """Give every face to the segment that holds its middle."""
    f = 0
    for j in range(segments.count):
        faces.offset[j] = f
        stop = segments.first[j] + segments.size[j]
        while f < faces.count and (faces.first[f] + faces.last[f]) // 2 < stop:
            faces.segment[f] = j
            f += 1
    faces.offset[segments.count] = f


# Fragments of one object that a step of its own surface tore apart, or lost beams: a leaf before a stem, front and side of
# a box, a dark stripe.

FRAGMENT_GAP, FRAGMENT_EXTENT = 0.16, 0.9
"""[m] Objects stand further apart than this, steps below it are within one; greatest distance between the far ends of two
fragments."""


class Bodies:
    """Segments joined to bodies where they were torn apart; every field is equal for all segments of a body."""

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.joins = native.integers(self.owner, most)
        """True if the next segment belongs to the same body."""
        self.label = native.integers(self.owner, most)
        """Least segment of the body."""
        self.start_edge = native.integers(self.owner, most)
        self.end_edge = native.integers(self.owner, most)
        self.size = native.integers(self.owner, most)
        """Number of points."""
        self.extent = native.doubles(self.owner, most)
        """Extent [m]."""
        self.parts = native.integers(self.owner, most)
        """Number of segments."""


def join_fragments(bodies: Bodies, survey: Survey, points: Points, segments: Segments, may: Any) -> None:
    """Join neighbouring segments that a small step or few lost beams divide, of those that `may` be fragments."""
    for j in range(segments.count):
        bodies.joins[j] = _belongs(survey, points, segments, may, j)
        bodies.parts[j] = 0
    for j in range(segments.count):
        before = segmentation.preceding(segments, points, j)
        if before == j or not bodies.joins[before]:
            _collect(bodies, survey, points, segments, j, False)
    for j in range(segments.count):
        if bodies.parts[j] == 0:
            _collect(bodies, survey, points, segments, j, True)


def _belongs(survey: Survey, points: Points, segments: Segments, may: Any, j: int) -> bool:
    """Return whether the next segment belongs to the same body."""
    after, edge = segmentation.following(segments, points, j), segments.end_edge[j]
    if after == j or not (may[j] and may[after]):
        return False
    is_step = edge == segmentation.OWN or edge == segmentation.HIDDEN
    if not is_step and points.missing[segments.first[after]] > segmentation.LONGEST_GAP:
        return False
    if not (survey.extent[j] < FRAGMENT_EXTENT and survey.extent[after] < FRAGMENT_EXTENT):
        return False
    most = FRAGMENT_GAP if is_step else segmentation.GAP_STEP
    gap = segmentation.distance(points, segments.first[after], segmentation.last_point(segments, j))
    span = segmentation.distance(points, segmentation.last_point(segments, after), segments.first[j])
    return gap < most and span < FRAGMENT_EXTENT


def _collect(bodies: Bodies, survey: Survey, points: Points, segments: Segments, first: int, ring: bool) -> None:
    """Make one body of a segment and all that join it; in a ring of segments all around none comes last."""
    label, last, size, parts, extent = first, first, 0, 0, 0.0
    j = first
    while parts == 0 or (bodies.joins[last] and j != first):
        label, last = min(label, j), j
        size += segments.size[j]
        extent = max(extent, survey.extent[j])
        parts += 1
        j = segmentation.following(segments, points, j)
    if ring:
        last = first
    if parts > 1:
        across = segmentation.distance(points, segments.first[first], segmentation.last_point(segments, last))
        extent = max(extent, across)
    j = first
    for _ in range(parts):
        bodies.label[j], bodies.size[j], bodies.extent[j], bodies.parts[j] = label, size, extent, parts
        bodies.start_edge[j], bodies.end_edge[j] = segments.start_edge[first], segments.end_edge[last]
        j = segmentation.following(segments, points, j)


# Which segments are objects, or may be some.


def fully_visible(survey: Survey, segments: Segments, is_known: bool) -> None:
    """Profile `paper`: segments with points enough and no wider than an object, whose edges are both their own.

    Next to a beam without a return the background is beyond range. With a background, `is_known`, the segments that belong
    to objects are the candidates, whatever their edges.
    """
    for j in range(segments.count):
        may = survey.candidate[j] if is_known else not surfaces.is_partial(segments, j)
        survey.is_object[j] = may and segments.size[j] >= survey.min_beams and survey.extent[j] <= survey.max_width


def pieces(survey: Survey, segments: Segments) -> None:
    """Profile `robust`: mark the segments that are too large for objects, and those that may be objects or fragments."""
    for j in range(segments.count):
        wide = not survey.extent[j] <= survey.max_width and not survey.protrusion[j]
        survey.wall[j] = segments.size[j] >= survey.min_beams and wide
        # A full turn without a breakpoint hides no edge by a step: the sensor cannot be inside of an object.
        hidden = segments.start_edge[j] == segmentation.HIDDEN and segments.end_edge[j] == segmentation.HIDDEN
        surrounds = hidden and segments.s_start[j] != segments.s_start[j]
        survey.candidate[j] = survey.chord[j] <= survey.max_width and not survey.wall[j] and not surrounds
        survey.loose[j] = survey.candidate[j] and not survey.protrusion[j]


def known_bodies(survey: Survey, segments: Segments, bodies: Bodies) -> None:
    """Mark the objects among the segments that differ from a background, joined to bodies."""
    for j in range(segments.count):
        is_whole = bodies.size[j] >= survey.min_beams and bodies.extent[j] <= survey.max_width
        survey.is_object[j] = survey.candidate[j] and is_whole


# §3, Fig. 8: objects of several legs that are static close together, such as a chair.

LEG_WIDTH = 0.2
"""[m] Legs are no wider than this; what is stands by itself."""


def group_legs(survey: Survey, points: Points, segments: Segments, gap: float) -> None:
    """Give objects that are narrow as legs and come closer together than `gap` [m] the same label."""
    for a in range(segments.count):
        if not _is_leg(survey, a):
            continue
        for b in range(a + 1, segments.count):
            if _is_leg(survey, b) and _are_close(points, segments, a, b, gap):
                one, other = _root(survey, a), _root(survey, b)
                survey.label[max(one, other)] = min(one, other)
    for j in range(segments.count):
        survey.label[j] = _root(survey, j)


def _is_leg(survey: Survey, j: int) -> bool:
    return survey.is_object[j] != 0 and survey.chord[j] <= LEG_WIDTH


def _root(survey: Survey, j: int) -> int:
    """Return the least segment that one is linked to, directly or through others."""
    while survey.label[j] != j:
        j = survey.label[j]
    return j


def _are_close(points: Points, segments: Segments, a: int, b: int, gap: float) -> bool:
    """Return whether the nearest points of two segments are no further apart than a gap [m]."""
    x, y, begin, end = points.x, points.y, segments.first[b], segments.first[b] + segments.size[b]
    # No point of b is further from its first one than this: most pairs are ruled out by that alone.
    radius = 0.0
    for k in range(begin, end):
        dx, dy = x[k] - x[begin], y[k] - y[begin]
        radius = max(radius, math.sqrt(dx * dx + dy * dy))
    for i in range(segments.first[a], segments.first[a] + segments.size[a]):
        dx, dy = x[i] - x[begin], y[i] - y[begin]
        if math.sqrt(dx * dx + dy * dy) > gap + radius + 1e-9:
            continue
        for k in range(begin, end):
            dx, dy = x[k] - x[i], y[k] - y[i]
            if math.sqrt(dx * dx + dy * dy) <= gap:
                return True
    return False


# The objects of a sweep as lists of segments: one segment each, or the parts of an object in the order of their bearings.

INFINITY = float("inf")


class Parts:
    """The `count` segments that make up `objects` objects, ordered by (walls last, theta_i).

    Object k has the parts `segment[i]` with i from `begin[k]` to `begin[k + 1]` - 1.
    """

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.count = 0
        self.objects = 0
        self.segment = native.integers(self.owner, most)
        self.begin = native.integers(self.owner, most + 1)
        # In the order of their labels, and what is known of each then.
        self.sorted = native.integers(self.owner, most)
        self.starts = native.integers(self.owner, most + 1)
        self.rank = native.integers(self.owner, most)
        self.least = native.doubles(self.owner, most)
        # Of each segment that is a part.
        self.theta_i = native.doubles(self.owner, most)
        """Bearing of the first point [rad], growing past the seam within an object."""
        self.theta_f = native.doubles(self.owner, most)
        """Bearing of the last point [rad]."""
        self.past_seam = native.doubles(self.owner, most)
        """Part of these bearings that is for lying past the seam: a full turn or 0 [rad]."""


def assemble(parts: Parts, survey: Survey, points: Points, segments: Segments, walls: bool) -> None:
    """Order the segments that are objects, and walls where these are wanted; those of one label are one object."""
    # By kind, label and bearing.
    parts.count = 0
    _insert(parts, survey, points, segments, True)
    if walls:
        _insert(parts, survey, points, segments, False)
    _group(parts, survey)
    for k in range(parts.objects):
        _unwrap(parts, points, k)
    _rank(parts, survey)
    count = 0
    for k in range(parts.objects):
        parts.begin[k] = count
        begin, end = parts.starts[parts.rank[k]], parts.starts[parts.rank[k] + 1]
        for i in range(begin, end):
            j, at = parts.sorted[i], count
            while at > parts.begin[k] and parts.theta_i[j] < parts.theta_i[parts.segment[at - 1]]:
                parts.segment[at] = parts.segment[at - 1]
                at -= 1
            parts.segment[at] = j
            count += 1
    parts.begin[parts.objects] = count


def _insert(parts: Parts, survey: Survey, points: Points, segments: Segments, objects: bool) -> None:
    """Add the objects, or the walls, in their order: by insertion, as they are nearly in order already."""
    count = parts.count
    for j in range(segments.count):
        if survey.is_object[j] != objects or not (objects or survey.wall[j]):
            continue
        if not survey.is_object[j]:
            survey.label[j] = j
        parts.theta_i[j] = segmentation.bearing(points, segments.first[j])
        parts.theta_f[j] = segmentation.bearing(points, segmentation.last_point(segments, j))
        k = count
        while k > 0 and _comes_before(parts, survey, j, parts.sorted[k - 1]):
            parts.sorted[k] = parts.sorted[k - 1]
            k -= 1
        parts.sorted[k] = j
        count += 1
    parts.count = count


def _comes_before(parts: Parts, survey: Survey, a: int, b: int) -> bool:
    if survey.is_object[a] != survey.is_object[b]:
        return survey.is_object[a] != 0
    if survey.label[a] != survey.label[b]:
        return survey.label[a] < survey.label[b]
    return parts.theta_i[a] < parts.theta_i[b]


def _group(parts: Parts, survey: Survey) -> None:
    """Find the first part of each object among the sorted ones."""
    parts.objects = 0
    for i in range(parts.count):
        a, b = parts.sorted[i], parts.sorted[i - 1] if i > 0 else -1
        if i == 0 or survey.is_object[a] != survey.is_object[b] or survey.label[a] != survey.label[b]:
            parts.starts[parts.objects] = i
            parts.objects += 1
    parts.starts[parts.objects] = parts.count


def _unwrap(parts: Parts, points: Points, k: int) -> None:
    """Let the bearings of an object grow past the seam: those before its widest gap do, where that is not the seam."""
    begin, end = parts.starts[k], parts.starts[k + 1]
    first, last = parts.sorted[begin], parts.sorted[end - 1]
    most = begin
    if end - begin > 1 and points.period > 0:
        widest = parts.theta_i[first] + segmentation.TURN - parts.theta_f[last]
        for i in range(begin + 1, end):
            gap = parts.theta_i[parts.sorted[i]] - parts.theta_f[parts.sorted[i - 1]]
            if gap > widest:
                widest, most = gap, i
    parts.least[k] = INFINITY
    for i in range(begin, end):
        j = parts.sorted[i]
        parts.past_seam[j] = segmentation.TURN if i < most else 0.0
        parts.theta_i[j] += parts.past_seam[j]
        parts.theta_f[j] += parts.past_seam[j]
        parts.least[k] = min(parts.least[k], parts.theta_i[j])


def _rank(parts: Parts, survey: Survey) -> None:
    """Sort the objects by kind and least bearing."""
    for k in range(parts.objects):
        at = k
        while at > 0 and _is_earlier(parts, survey, k, parts.rank[at - 1]):
            parts.rank[at] = parts.rank[at - 1]
            at -= 1
        parts.rank[at] = k


def _is_earlier(parts: Parts, survey: Survey, a: int, b: int) -> bool:
    """Return whether one object comes before another."""
    one, other = parts.sorted[parts.starts[a]], parts.sorted[parts.starts[b]]
    if survey.is_object[one] != survey.is_object[other]:
        return survey.is_object[one] != 0
    return parts.least[a] < parts.least[b]
