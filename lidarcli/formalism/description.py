"""Description of the objects of a sweep, whose segments are chosen: vertices, faces, shape and box.

Definitions 6 and 7 give the vertices of an object, and the faces between them. The vertices of a part are its first point,
the points between its faces, and its last point; a segment of a single point has one vertex. An inner vertex lies where
its faces meet, which noise moves less than the point. An object ends somewhere between the last beam that hits it and the
next one, which passes it.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from lidarcli.formalism import circle_fit, detection, segmentation, surfaces
from lidarcli.formalism.circle_fit import Circle
from lidarcli.formalism.objects import Bodies, Parts
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import Faces, Survey
from lidarcli.system import native

# §3: the shape of an object (Fig. 8) and the oriented box around it (Fig. 6). The shape is the simpler of straight faces
# and a circle that explains the points. Both are compared by their Bayesian information: n log rms² + p log n, with p
# parameters.

PRISMATIC, ROUND = detection.PRISMATIC, detection.ROUND
IRREGULAR, UNKNOWN = detection.IRREGULAR, detection.UNKNOWN

# The category of an object by the topology of the faces that join its vertices.

ENOUGH_BEAMS = 5
"""Least number of beams that tell a corner from an arc."""
FIT_FLOOR, STRAIGHT_FIT = 0.004, 0.012
"""[m] Fits better than this count as equally good; points of a face may scatter this much, or twice the noise."""
SQUARE = math.radians(35.0)
"""[rad] Faces of a prism meet within this of a right angle, and point their corner at the sensor."""
COS_SQUARE = math.cos(SQUARE)
MAX_FACES = 3
"""Greatest number of faces of a box that are visible, even from its inside."""
WORSE = 1.5
"""Factor by which the algebraic circle may fit worse than the best one."""
ARC = 1.0
"""A circle is believed where the chord of its arc is longer than this share of its radius: else any flat piece is one."""


class FaceFit:
    """Fit of the faces of one object to its points."""

    def __init__(self) -> None:
        self.count = 0
        """Number of faces."""
        self.rms = 0.0
        """Root mean square distance of the points from the faces [m]; 0 without faces."""
        self.square = True
        """All faces meet at right angles that point at the sensor."""
        self.longest = -1
        """The longest face and the next longest; -1 where there is none."""
        self.second = -1


def examine(look: FaceFit, faces: Faces, parts: Parts, k: int, without_first: bool, without_last: bool) -> None:
    """Look at the faces of an object, all of them or without the first or the last one."""
    total, weight, before = 0.0, 0.0, -1
    first = faces.offset[parts.segment[parts.begin[k]]]
    last = faces.offset[parts.segment[parts.begin[k + 1] - 1] + 1] - 1
    look.count, look.square, look.longest, look.second = 0, True, -1, -1
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        for f in range(faces.offset[j], faces.offset[j + 1]):
            if (without_first and f == first) or (without_last and f == last):
                continue
            total += faces.points[f] * (faces.rms[f] * faces.rms[f])
            weight += faces.points[f]
            # Walking counter-clockwise around the sensor, the outline turns right at a corner that points at it.
            if before >= 0 and not surfaces.turn(faces, f, before) >= COS_SQUARE:
                look.square = False
            if look.longest < 0 or faces.length[f] > faces.length[look.longest]:
                look.longest, look.second = f, look.longest
            elif look.second < 0 or faces.length[f] > faces.length[look.second]:
                look.second = f
            before = f
            look.count += 1
    look.rms = math.sqrt(total / max(weight, 1.0))


def classify(
    look: FaceFit, circle: Circle, sigma: float, chord: float, mean_x: float, mean_y: float, max_width: float
) -> int:
    """Return PRISMATIC, ROUND, IRREGULAR or UNKNOWN; the circle is fitted where it may win.

    `chord` is the distance of the first point from the last one, `mean_x`, `mean_y` the mean of the points, all in metres.
    """
    n, allowed, level = circle.n, max(2.0 * sigma, STRAIGHT_FIT), max(0.5 * sigma, FIT_FLOOR)
    if n < ENOUGH_BEAMS:
        return UNKNOWN
    if look.count > 1 or look.rms > FIT_FLOOR:
        # A circle has three parameters, c faces have 3c - 1: so many times worse may it fit to be simpler.
        handicap = math.exp((1.5 * look.count - 2.0) * math.log(n) / n)
        rival = max(look.rms, level) * handicap
        circle_fit.fit_circle(circle, WORSE * rival)
        x, y = circle.centre_x, circle.centre_y
        if (
            max(circle.rms, level) < rival
            and circle.rms <= allowed
            and x * x + y * y > mean_x * mean_x + mean_y * mean_y
            and chord > ARC * circle.radius
            and 2.0 * circle.radius <= max_width
        ):
            return ROUND
    if look.square and look.count <= MAX_FACES and look.rms <= allowed:
        return PRISMATIC
    return IRREGULAR


# The oriented bounding box: the smaller of those with a side along one of its two longest faces.

RIGHT_ANGLE_TOLERANCE = math.radians(5.0)
"""[rad] Faces closer to a right angle than this propose the same box."""
SIN_TWICE = math.sin(2.0 * RIGHT_ANGLE_TOLERANCE)
SLIM = 0.05
"""[m] Where areas are compared, no side counts as less."""
TIE = 1e-9
"""Areas that differ by less than this share are equal, as for any two sides of a triangle: rounding must not choose."""


class Box:
    """A rectangle: centre [m], length ≥ width [m], yaw of the long side in (-π/2, π/2] [rad]."""

    def __init__(self) -> None:
        self.x = 0.0
        self.y = 0.0
        self.length = 0.0
        self.width = 0.0
        self.yaw = 0.0
        # Its bounds along and across a direction while it is sought.
        self.low_u = 0.0
        self.high_u = 0.0
        self.low_v = 0.0
        self.high_v = 0.0


def around_points(box: Box, look: FaceFit, faces: Faces, x: Any, y: Any, n: int) -> None:
    """Set the smaller of the rectangles around n points [m] that have a side along one of the two longest faces of an
    object.

    Without a face the first and the last point tell the direction.
    """
    if look.longest >= 0:
        along_x, along_y = faces.direction_x[look.longest], faces.direction_y[look.longest]
    else:
        along_x, along_y = x[n - 1] - x[0], y[n - 1] - y[0]
        far = math.sqrt(along_x * along_x + along_y * along_y)
        if far > 0.0:
            along_x, along_y = along_x / far, along_y / far
        else:
            along_x, along_y = 1.0, 0.0
    _bound(box, x, y, 0, n, along_x, along_y)
    if look.second >= 0:
        other_x, other_y = faces.direction_x[look.second], faces.direction_y[look.second]
        across, along = along_x * other_y - along_y * other_x, along_x * other_x + along_y * other_y
        if abs(2.0 * across * along) > SIN_TWICE:
            area = _area(box)
            _bound(box, x, y, 0, n, other_x, other_y)
            if _area(box) < (1.0 - TIE) * area:
                along_x, along_y = other_x, other_y
            else:
                _bound(box, x, y, 0, n, along_x, along_y)
    u, v = 0.5 * (box.low_u + box.high_u), 0.5 * (box.low_v + box.high_v)
    box.x, box.y = u * along_x - v * along_y + 0.0, u * along_y + v * along_x + 0.0
    box.length, box.width = box.high_u - box.low_u, box.high_v - box.low_v
    if box.width > box.length:
        box.length, box.width = box.width, box.length
        along_x, along_y = -along_y, along_x
    box.yaw = _yaw(along_x, along_y)


def _bound(box: Box, x: Any, y: Any, begin: int, end: int, along_x: float, along_y: float) -> None:
    """Compute the bounds of the points `begin` to `end` - 1 along a direction and across it [m]."""
    low_u = high_u = x[begin] * along_x + y[begin] * along_y
    low_v = high_v = y[begin] * along_x - x[begin] * along_y
    for k in range(begin + 1, end):
        u, v = x[k] * along_x + y[k] * along_y, y[k] * along_x - x[k] * along_y
        low_u, high_u = min(u, low_u), max(u, high_u)
        low_v, high_v = min(v, low_v), max(v, high_v)
    box.low_u, box.high_u, box.low_v, box.high_v = low_u, high_u, low_v, high_v


def _area(box: Box) -> float:
    return (box.high_u - box.low_u) * (box.high_v - box.low_v)


def _slim_area(box: Box, circle: Circle, faces: Faces, f: int, begin: int, end: int) -> float:
    """Return the area of the rectangle along a face around some points [m²], no side below `SLIM`."""
    _bound(box, circle.x, circle.y, begin, end, faces.direction_x[f], faces.direction_y[f])
    return max(box.high_u - box.low_u, SLIM) * max(box.high_v - box.low_v, SLIM)


def _yaw(x: float, y: float) -> float:
    """Return the direction of a side [rad]; of a side and its opposite, the one that points forward."""
    if x < 0.0 or (x == 0.0 and y < 0.0):
        x, y = -x, -y
    return math.atan2(y + 0.0, x + 0.0)


OBJECT, NOISE = detection.OBJECT, detection.NOISE
LEGGED, WALL = detection.LEGGED, detection.WALL
FULL, START_HIDDEN, END_HIDDEN = detection.FULL, detection.START_HIDDEN, detection.END_HIDDEN
BOTH_HIDDEN, CUT = detection.BOTH_HIDDEN, detection.CUT
START, END, CORNER, EXTREMUM = detection.START, detection.END, detection.CORNER, detection.EXTREMUM


class Columns:
    """The arrays of a `Detection`, of which `objects`, `vertices` and `faces` entries are filled.

    `out` has a pointer for each of its fields, of the type that is declared there (setup.py).
    """

    def __init__(self) -> None:
        self.objects = 0
        self.vertices = 0
        self.faces = 0
        self.room_objects = 0
        self.room_vertices = 0
        self.room_faces = 0
        self.per_beam = False
        self.explained = False
        self.beam_width = 0

    def attach(self, arrays: dict[str, NDArray[Any]], per_beam: bool) -> None:
        """Write to these arrays from now on (field of a `Detection` → array); keep them as long."""
        self.room_objects = len(arrays["row"])
        self.room_vertices = len(arrays["vertex_r"])
        self.room_faces = len(arrays["face_rms"])
        self.per_beam = per_beam
        self.explained = "features" in arrays
        self.beam_width = arrays["beam_s"].shape[1] if per_beam else 0
        self.out = native.pointers(arrays)


def has_room(columns: Columns, beams: int) -> bool:
    """Return if all objects of another sweep of so many beams can be added, however many there are."""
    return (
        columns.objects + beams <= columns.room_objects
        and columns.vertices + 2 * beams <= columns.room_vertices
        and columns.faces + beams <= columns.room_faces
    )


def trace(
    description: Description, columns: Columns, points: Points, segments: Segments, survey: Survey, faces: Faces, k: int
) -> None:
    """Write the vertices and faces of an object (Def. 6)."""
    description.n = 0
    begin = columns.vertices
    for i in range(description.parts.begin[k], description.parts.begin[k + 1]):
        _trace_part(description, columns, points, segments, survey, faces, description.parts.segment[i])
    columns.out.vertex_kind[columns.vertices - 1] = END
    columns.out.vertex_kind[begin] = START


def _trace_part(
    description: Description, columns: Columns, points: Points, segments: Segments, survey: Survey, faces: Faces, j: int
) -> None:
    """Write the vertices and faces of one part of an object."""
    low, high = faces.offset[j], faces.offset[j + 1]
    first_vertex = columns.vertices
    last_x, last_y, last_theta = 0.0, 0.0, 0.0
    for f in range(low - 1, high):
        at = faces.last[f] if f >= low else segments.first[j]
        x, y, r = points.x[at], points.y[at], points.r[at]
        theta = segmentation.bearing(points, at) + description.parts.past_seam[j]
        n, v = description.n, columns.vertices
        description.x[n], description.y[n] = x, y
        if description.robust and high > low:
            # The nearest point on the line of the face.
            g = max(f, low)
            away_x, away_y = x - faces.middle_x[g], y - faces.middle_y[g]
            along = away_x * faces.direction_x[g] + away_y * faces.direction_y[g]
            description.x[n] = faces.middle_x[g] + along * faces.direction_x[g]
            description.y[n] = faces.middle_y[g] + along * faces.direction_y[g]
            if f >= low and f + 1 < high and faces.points[f] > 2 and faces.points[f + 1] > 2:
                moves, meet_x, meet_y = surfaces.meeting(faces, f, f + 1)
                spacing = min(faces.length[f] / faces.points[f], faces.length[f + 1] / faces.points[f + 1])
                dx, dy = meet_x - description.x[n], meet_y - description.y[n]
                if moves and math.sqrt(dx * dx + dy * dy) <= survey.tolerance[j] + 2.0 * spacing:
                    theta += math.atan2(meet_y * x - meet_x * y, meet_x * x + meet_y * y)
                    x, y = meet_x, meet_y
                    r = math.sqrt(x * x + y * y)
                    description.x[n], description.y[n] = x, y
        columns.out.vertex_theta[v], columns.out.vertex_r[v] = theta, r
        columns.out.vertex_kind[v] = EXTREMUM if description.extremum[at] else CORNER
        if f >= low:
            length = math.sqrt((x - last_x) * (x - last_x) + (y - last_y) * (y - last_y))
            columns.out.face_theta_i[columns.faces], columns.out.face_theta_f[columns.faces] = last_theta, theta
            columns.out.face_length[columns.faces], columns.out.face_rms[columns.faces] = length, faces.rms[f]
            columns.faces += 1
        last_x, last_y, last_theta = x, y, theta
        description.n += 1
        columns.vertices += 1
    columns.out.vertex_kind[first_vertex] = columns.out.vertex_kind[columns.vertices - 1] = CORNER
    if description.robust and high > low:
        _extend(description, columns, points, segments, faces, j)


def _extend(description: Description, columns: Columns, points: Points, segments: Segments, faces: Faces, j: int) -> None:
    """Extend a part past its first and its last vertex, by half a beam on average, if the object ends there."""
    count = faces.offset[j + 1] - faces.offset[j]
    first, last = segments.first[j], segmentation.last_point(segments, j)
    if surfaces.is_end(segments.start_edge[j]):
        f = faces.offset[j]
        more = _overhang(points, faces, f, first, first + 1, -1.0)
        columns.out.face_length[columns.faces - count] += more
        description.x[description.n - 1 - count] -= more * faces.direction_x[f]
        description.y[description.n - 1 - count] -= more * faces.direction_y[f]
    if surfaces.is_end(segments.end_edge[j]):
        f = faces.offset[j + 1] - 1
        more = _overhang(points, faces, f, last, last - 1, 1.0)
        columns.out.face_length[columns.faces - 1] += more
        description.x[description.n - 1] += more * faces.direction_x[f]
        description.y[description.n - 1] += more * faces.direction_y[f]


def _overhang(points: Points, faces: Faces, f: int, at: int, inner: int, side: float) -> float:
    """Return the path along a face to the bearing half a step past its last point [m]; `inner` is the point before."""
    # At a grazing angle the line may meet that bearing anywhere: the distance of the last two points is the most.
    x, y, along_x, along_y = points.x[at], points.y[at], faces.direction_x[f], faces.direction_y[f]
    cos, sin = points.cos_half, side * points.sin_half
    ray_x, ray_y = x * cos - y * sin, x * sin + y * cos
    across = abs(along_x * ray_y - along_y * ray_x)
    spacing = abs((x - points.x[inner]) * along_x + (y - points.y[inner]) * along_y)
    length = abs((x * x + y * y) * sin)
    return length / across if length < spacing * across else spacing


STRAY, LEFT, HALF = 2, 3, 0.5
"""Most points at an end of an object that may be left out as off its surface, fewest that have to be left then, and share
of the area of the whole box that the box of these has at most."""


class Description:
    """Memory for describing one object after the other: its outline, from which shape and box are made."""

    def __init__(self, most: int, robust: bool, adaptive: bool) -> None:
        """`robust`: put vertices where faces meet and edges are, not at their points; `adaptive`: d_th grows with range."""
        self.owner: list[Any] = []
        self.robust = robust
        self.adaptive = adaptive
        self.parts = Parts(most)
        self.circle = Circle(2 * most)
        self.look = FaceFit()
        self.box = Box()
        self.n = 0
        self.x = native.doubles(self.owner, 2 * most)
        """(x, y) of the n vertices, on the lines of their faces [m]."""
        self.y = native.doubles(self.owner, 2 * most)
        self.extremum = native.integers(self.owner, 2 * most)
        """1 for a point of the sweep that is an inner vertex at an extremum of r rather than at a corner."""


def describe(
    description: Description,
    columns: Columns,
    points: Points,
    segments: Segments,
    survey: Survey,
    bodies: Bodies,
    faces: Faces,
) -> None:
    """Write all objects of a sweep, whose parts are assembled."""
    row, objects, beams = points.row, 0, 0
    for k in range(description.parts.objects):
        at = columns.objects
        _describe_points(columns, points, segments, bodies, description.parts, description.circle, k)
        if description.adaptive:
            columns.out.d_th[at] = segmentation.adaptive_threshold(
                points, points.d_th, columns.out.r_i[at], columns.out.s_i[at]
            )
        trace(description, columns, points, segments, survey, faces, k)
        examine(description.look, faces, description.parts, k, False, False)
        if description.robust:
            _drop_stray(description, faces, description.parts, description.circle, description.box, description.look, k)
        _describe_shape(description, columns, points.sigma, survey.max_width, faces, description.circle, description.box, k)
        columns.out.thing[at] = survey.thing[description.parts.segment[description.parts.begin[k]]]
        if survey.is_object[description.parts.segment[description.parts.begin[k]]]:
            columns.out.set[at] = OBJECT
        else:
            columns.out.set[at], columns.out.shape[at] = NOISE, WALL
        columns.out.object[at] = k + 1
        columns.objects += 1
        columns.out.vertex_offsets[at + 1] = columns.vertices
        columns.out.face_offsets[at + 1] = columns.faces
        if columns.out.set[at] == OBJECT:
            objects += 1
            beams += columns.out.beams[at]
            if columns.per_beam:
                _mark_beams(columns, points, segments, description.parts, k)
    columns.out.objects[row], columns.out.object_beams[row] = objects, beams


def _describe_points(
    columns: Columns, points: Points, segments: Segments, bodies: Bodies, parts: Parts, circle: Circle, k: int
) -> None:
    """Join the points of an object, and write all that follows from points without faces."""
    at = columns.objects
    first_part, last_part = parts.segment[parts.begin[k]], parts.segment[parts.begin[k + 1] - 1]
    first, last = segments.first[first_part], segmentation.last_point(segments, last_part)
    nearest, past_seam, n = first, parts.past_seam[first_part], 0
    sum_x, sum_y = 0.0, 0.0
    several = False
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        several = several or bodies.label[j] != bodies.label[first_part]
        for p in range(segments.first[j], segments.first[j] + segments.size[j]):
            circle.x[n], circle.y[n] = points.x[p], points.y[p]
            sum_x += points.x[p]
            sum_y += points.y[p]
            n += 1
            if points.r[p] < points.r[nearest]:
                nearest, past_seam = p, parts.past_seam[j]
    circle.n = n
    columns.out.row[at], columns.out.beams[at] = points.row, n
    columns.out.shape[at] = LEGGED if several else 0
    columns.out.visibility[at] = _visibility(segments.start_edge[first_part], segments.end_edge[last_part])
    before = segmentation.beam_at(points, points.position[first])
    after = segmentation.beam_at(points, points.position[last])
    columns.out.beam_i[at], columns.out.beam_f[at] = (after, before) if points.reverse else (before, after)
    columns.out.theta_i[at], columns.out.theta_f[at] = parts.theta_i[first_part], parts.theta_f[last_part]
    columns.out.theta_min[at] = segmentation.bearing(points, nearest) + past_seam
    columns.out.r_i[at], columns.out.r_f[at] = points.r[first], points.r[last]
    columns.out.r_min[at] = points.r[nearest]
    columns.out.s_i[at], columns.out.s_f[at] = segments.s_start[first_part], segments.s_end[last_part]
    columns.out.d_th[at] = points.d_th
    columns.out.x[at], columns.out.y[at] = sum_x / n, sum_y / n
    columns.out.width[at] = segmentation.distance(points, first, last)


def _visibility(start_edge: int, end_edge: int) -> int:
    """Return the visibility of an object by its two edges."""
    if start_edge == segmentation.VIEW or end_edge == segmentation.VIEW:
        return CUT
    if _is_hidden(start_edge):
        return BOTH_HIDDEN if _is_hidden(end_edge) else START_HIDDEN
    return END_HIDDEN if _is_hidden(end_edge) else FULL


def _is_hidden(edge: int) -> bool:
    """Return if more of a body may lie past an edge."""
    return edge == segmentation.HIDDEN or edge == segmentation.FLICKERING


def _drop_stray(
    description: Description, faces: Faces, parts: Parts, circle: Circle, box: Box, look: FaceFit, k: int
) -> None:
    """Leave out the few points at an end that lie between an object and what is behind it, if its box halves then."""
    if parts.begin[k + 1] - parts.begin[k] > 1 or look.count < 2:
        return
    j = parts.segment[parts.begin[k]]
    low, high = faces.offset[j], faces.offset[j + 1] - 1
    before = faces.points[low] - 1 if faces.points[low] <= STRAY + 1 else 0
    after = faces.points[high] - 1 if faces.points[high] <= STRAY + 1 and high > low else 0
    if before + after == 0 or circle.n - before - after < LEFT:
        return
    whole = _slim_area(box, circle, faces, look.longest, 0, circle.n)
    examine(look, faces, parts, k, before > 0, after > 0)
    f = look.longest
    if f >= 0 and _slim_area(box, circle, faces, f, before, circle.n - after) < HALF * whole:
        circle.n -= before + after
        for p in range(circle.n):
            circle.x[p], circle.y[p] = circle.x[p + before], circle.y[p + before]
        description.n = 0
    else:
        examine(look, faces, parts, k, False, False)


def _describe_shape(
    description: Description, columns: Columns, sigma: float, most: float, faces: Faces, circle: Circle, box: Box, k: int
) -> None:
    """Write the shape of an object, whose outline is traced, and its box; a circle is no wider than `most` [m]."""
    at, parts = columns.objects, description.parts.begin[k + 1] - description.parts.begin[k]
    chord, x, y = columns.out.width[at], columns.out.x[at], columns.out.y[at]
    kind = classify(description.look, circle, sigma, chord, x, y, most)
    if kind == ROUND:
        # The square around the circle that faces the sensor.
        box.x, box.y, box.yaw = circle.centre_x, circle.centre_y, _yaw(circle.centre_x, circle.centre_y)
        box.length = box.width = 2.0 * circle.radius
    elif kind == PRISMATIC and description.robust and description.n > 0 and parts == 1:
        # The vertices of a prism scatter less than its points.
        around_points(box, description.look, faces, description.x, description.y, description.n)
    else:
        around_points(box, description.look, faces, circle.x, circle.y, circle.n)
    columns.out.box_x[at], columns.out.box_y[at], columns.out.box_yaw[at] = box.x, box.y, box.yaw
    columns.out.box_length[at], columns.out.box_width[at] = box.length, box.width
    if columns.out.shape[at] != LEGGED:
        columns.out.shape[at] = kind


def _mark_beams(columns: Columns, points: Points, segments: Segments, parts: Parts, k: int) -> None:
    """Give every beam of an object its number."""
    row = points.row * columns.beam_width
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        for p in range(segments.first[j], segments.first[j] + segments.size[j]):
            columns.out.beam_object[row + segmentation.beam_at(points, points.position[p])] = k + 1
