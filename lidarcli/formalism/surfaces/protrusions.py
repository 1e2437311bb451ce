"""Things that touch a wall: where no step divides the two, the corner between them does."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import faces as surfaces
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.survey import Survey

TURN = math.radians(25.0)
"""[rad] Faces that turn less than this do not make a corner."""
SIN_TURN = math.sin(TURN)
BACKING = 0.4
"""[m] A face at least this long, beside which a thing stands, is wall."""
RELIEF = 0.1
"""[m] A thing stands out from its wall by more than this: mouldings and skirting boards do not."""
WIDEST = 1.5
"""[m] What stands out over more than this is a part of the building."""
BEHIND = 0.1
"""[m] What is seen past the free edge of a thing lies no further than this behind the line of its wall."""
PLANE = 0.03
"""[m] Points stand out less than this from the wall that they are on."""
TRIM = 6
"""At each end so many points may turn out to be wall: the corner is only known to every few points."""


class Protrusions:
    """The `count` stretches of segments that stand out from a wall, in order: points `first` to `last`."""

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
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


def find(protrusions: Protrusions, survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
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
            while end < high and not surfaces.turn(faces, end - 1, end) > SIN_TURN:
                pointed = pointed or surfaces.turn(faces, end - 1, end) < -SIN_TURN
                end += 1
            _add(protrusions, points, segments, faces, j, begin, end, pointed)


def _add(
    protrusions: Protrusions,
    points: Points,
    segments: Segments,
    faces: Faces,
    j: int,
    begin: int,
    end: int,
    pointed: bool,
) -> None:
    """Add the faces `begin` … `end` - 1 of a segment, if they stand out.

    Parameters
    ----------
    pointed : whether a corner between them points at the sensor
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
        before = _longest_before(faces, begin - 1, low)
        if not faces.length[before] >= least:
            return
    elif segments.start_edge[j] != segmentation.OWN:
        return
    if has_wall_after:
        after = _longest_after(faces, end, high)
        if not faces.length[after] >= least:
            return
    elif segments.end_edge[j] != segmentation.OWN:
        return

    margin = 2.0 * points.sigma
    first, last = faces.first[begin], faces.last[end - 1]
    if not _is_small(points, faces, begin, end):
        return
    if has_wall_before and not _relief(points, faces, begin, end, before) > RELIEF + margin:
        return
    if has_wall_after and not _relief(points, faces, begin, end, after) > RELIEF + margin:
        return
    # At a free end the wall goes on, or is seen through a doorway.
    if not has_wall_after:
        seen = segments.first[segmentation.following(segments, points, j)]
        if not depth(points, faces, before, seen) >= -(BEHIND + margin):
            return
    if not has_wall_before:
        seen = segmentation.last_point(segments, segmentation.preceding(segments, points, j))
        if not depth(points, faces, after, seen) >= -(BEHIND + margin):
            return
    if has_wall_before:
        first = _trimmed(points, faces, before, first, last, 1, PLANE + margin)
    if has_wall_after:
        last = _trimmed(points, faces, after, last, first, -1, PLANE + margin)
    if last > first:
        k = protrusions.count
        protrusions.segment[k], protrusions.first[k], protrusions.last[k] = j, first, last
        protrusions.count += 1


def _longest_before(faces: Faces, at: int, low: int) -> int:
    """The first of the longest faces that end with `at` and have no corner between them."""
    longest, f = at, at
    while f > low and not abs(surfaces.turn(faces, f - 1, f)) > SIN_TURN:
        f -= 1
        if faces.length[f] >= faces.length[longest]:
            longest = f
    return longest


def _longest_after(faces: Faces, at: int, high: int) -> int:
    """The first of the longest faces that begin with `at` and have no corner between them."""
    longest, f = at, at
    while f + 1 < high and not abs(surfaces.turn(faces, f, f + 1)) > SIN_TURN:
        f += 1
        if faces.length[f] > faces.length[longest]:
            longest = f
    return longest


def _is_small(points: Points, faces: Faces, begin: int, end: int) -> bool:
    """Whether all vertices of some faces are near their first and their last one."""
    first, last = faces.first[begin], faces.last[end - 1]
    if not segmentation.distance(points, first, last) <= WIDEST:
        return False
    for f in range(begin, end):
        at = faces.last[f]
        if not (
            segmentation.distance(points, first, at) <= WIDEST
            and segmentation.distance(points, at, last) <= WIDEST
        ):
            return False
    return True


def _relief(points: Points, faces: Faces, begin: int, end: int, wall: int) -> float:
    """How far the foremost vertex of some faces stands before a wall [m]."""
    foremost = depth(points, faces, wall, faces.first[begin])
    for f in range(begin, end):
        foremost = max(foremost, depth(points, faces, wall, faces.last[f]))
    return foremost


def depth(points: Points, faces: Faces, wall: int, at: int) -> float:
    """How far a point stands before the line of a face, towards the sensor [m]."""
    middle_x, middle_y = faces.middle_x[wall], faces.middle_y[wall]
    direction_x, direction_y = faces.direction_x[wall], faces.direction_y[wall]
    side = 1.0 if middle_y * direction_x - middle_x * direction_y > 0 else -1.0
    return ((points.x[at] - middle_x) * direction_y - (points.y[at] - middle_y) * direction_x) * side


def _trimmed(points: Points, faces: Faces, wall: int, at: int, other: int, way: int, tolerance: float) -> int:
    """An end of a stretch, moved towards the other past the points that lie on the wall beside it."""
    for _ in range(TRIM):
        if (other - at) * way <= 0 or not depth(points, faces, wall, at) <= tolerance:
            break
        at += way
    return at


def divide(
    protrusions: Protrusions, survey: Survey, points: Points, segments: Segments, faces: Faces
) -> None:
    """Divide the segments at the protrusions that were found, and their faces with them."""
    if protrusions.count == 0:
        return
    taken = 0
    protrusions.parts.count = 0
    for j in range(segments.count):
        begins = 1
        protrusions.begin[0], protrusions.is_protrusion[0] = segments.first[j], False
        while taken < protrusions.count and protrusions.segment[taken] == j:
            _insert(protrusions, begins, protrusions.first[taken], True)
            _insert(protrusions, begins + 1, protrusions.last[taken] + 1, False)
            begins += 2
            taken += 1
        last = segmentation.last_point(segments, j)
        for k in range(begins):
            stop = protrusions.begin[k + 1] - 1 if k + 1 < begins else last
            if stop >= protrusions.begin[k]:
                protrusions.stands_out[protrusions.parts.count] = protrusions.is_protrusion[k]
                _append(
                    protrusions.parts,
                    points,
                    segments,
                    j,
                    protrusions.begin[k],
                    stop,
                    protrusions.is_protrusion[k] != 0,
                )
    segmentation.copy_segments(protrusions.parts, segments)
    for p in range(segments.count):
        survey.protrusion[p] = protrusions.stands_out[p]
        survey.tolerance[p] = survey.tolerance[0]
        survey.chord[p] = segmentation.chord(segments, points, p)
    _assign(faces, segments)


def _insert(protrusions: Protrusions, count: int, begin: int, is_protrusion: bool) -> None:
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


def _append(
    parts: Segments, points: Points, segments: Segments, j: int, begin: int, stop: int, stands_out: bool
) -> None:
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
