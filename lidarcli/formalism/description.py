"""What is known of each object of a sweep once its segments are chosen, and the columns that it is written to.

Definitions 6 and 7 give the vertices of an object, and the faces between them. Of each part that is its first point, the
points between its faces, and its last point; a segment of a single point has one vertex. An inner vertex is where its
faces meet, which noise moves less than the point. And a thing ends somewhere between the last beam that hits it and the
next one, which passes it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli import native
from lidarcli.formalism import detection, segmentation, shape, surfaces
from lidarcli.formalism.objects import Bodies, Parts
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.shape import Box, Circle, Look
from lidarcli.formalism.surfaces import Faces, Survey

OBJECT, NOISE = detection.OBJECT, detection.NOISE
LEGGED, WALL = detection.LEGGED, detection.WALL
FULL, START_HIDDEN, END_HIDDEN = detection.FULL, detection.START_HIDDEN, detection.END_HIDDEN
BOTH_HIDDEN, CUT = detection.BOTH_HIDDEN, detection.CUT
START, END, CORNER, EXTREMUM = detection.START, detection.END, detection.CORNER, detection.EXTREMUM

_WHOLE: dict[str, Any] = {"row": np.int64, "object": np.int32, "set": np.uint8, "shape": np.uint8}
_WHOLE |= {"visibility": np.uint8, "beam_i": np.int32, "beam_f": np.int32, "beams": np.int32}
_MEASURED = (
    *("theta_i", "theta_f", "r_i", "r_f", "s_i", "s_f", "d_th", "theta_min", "r_min", "x", "y", "width"),
    *("box_x", "box_y", "box_length", "box_width", "box_yaw", "thing"),
)
OBJECT_COLUMNS: dict[str, Any] = _WHOLE | dict.fromkeys(_MEASURED, np.float64)
OFFSET_COLUMNS: dict[str, Any] = {"vertex_offsets": np.int32, "face_offsets": np.int32}
VERTEX_COLUMNS: dict[str, Any] = {"vertex_theta": np.float64, "vertex_r": np.float64, "vertex_kind": np.uint8}
FACE_COLUMNS: dict[str, Any] = dict.fromkeys(
    ("face_theta_i", "face_theta_f", "face_length", "face_rms"), np.float64
)
SWEEP_COLUMNS: dict[str, Any] = dict.fromkeys(
    ("nearest", "nearest_theta", "d_mean", "sweep_d_th", "noise"), np.float64
)
SWEEP_COLUMNS |= dict.fromkeys(("objects", "object_beams"), np.int32)
BEAM_COLUMNS: dict[str, Any] = {"beam_object": np.int32, "beam_s": np.float64}


class Columns:
    """Columns of a `Detection`, of which `objects`, `vertices` and `faces` entries are filled."""

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
        """Write to these arrays from now on, which are to be kept as long."""
        self.room_objects = len(arrays["row"])
        self.room_vertices = len(arrays["vertex_r"])
        self.room_faces = len(arrays["face_rms"])
        self.per_beam = per_beam
        self.row = native.at_longs(arrays["row"])
        self.object = native.at_ints(arrays["object"])
        self.set = native.at_bytes(arrays["set"])
        self.shape = native.at_bytes(arrays["shape"])
        self.visibility = native.at_bytes(arrays["visibility"])
        self.beam_i = native.at_ints(arrays["beam_i"])
        self.beam_f = native.at_ints(arrays["beam_f"])
        self.beams = native.at_ints(arrays["beams"])
        self.theta_i = native.at_doubles(arrays["theta_i"])
        self.theta_f = native.at_doubles(arrays["theta_f"])
        self.r_i = native.at_doubles(arrays["r_i"])
        self.r_f = native.at_doubles(arrays["r_f"])
        self.s_i = native.at_doubles(arrays["s_i"])
        self.s_f = native.at_doubles(arrays["s_f"])
        self.d_th = native.at_doubles(arrays["d_th"])
        self.theta_min = native.at_doubles(arrays["theta_min"])
        self.r_min = native.at_doubles(arrays["r_min"])
        self.x = native.at_doubles(arrays["x"])
        self.y = native.at_doubles(arrays["y"])
        self.width = native.at_doubles(arrays["width"])
        self.box_x = native.at_doubles(arrays["box_x"])
        self.box_y = native.at_doubles(arrays["box_y"])
        self.box_length = native.at_doubles(arrays["box_length"])
        self.box_width = native.at_doubles(arrays["box_width"])
        self.box_yaw = native.at_doubles(arrays["box_yaw"])
        self.thing = native.at_doubles(arrays["thing"])
        self.vertex_offsets = native.at_ints(arrays["vertex_offsets"])
        self.vertex_theta = native.at_doubles(arrays["vertex_theta"])
        self.vertex_r = native.at_doubles(arrays["vertex_r"])
        self.vertex_kind = native.at_bytes(arrays["vertex_kind"])
        self.face_offsets = native.at_ints(arrays["face_offsets"])
        self.face_theta_i = native.at_doubles(arrays["face_theta_i"])
        self.face_theta_f = native.at_doubles(arrays["face_theta_f"])
        self.face_length = native.at_doubles(arrays["face_length"])
        self.face_rms = native.at_doubles(arrays["face_rms"])
        self.nearest = native.at_doubles(arrays["nearest"])
        self.nearest_theta = native.at_doubles(arrays["nearest_theta"])
        self.d_mean = native.at_doubles(arrays["d_mean"])
        self.sweep_d_th = native.at_doubles(arrays["sweep_d_th"])
        self.noise = native.at_doubles(arrays["noise"])
        self.sweep_objects = native.at_ints(arrays["objects"])
        self.object_beams = native.at_ints(arrays["object_beams"])
        self.explained = "features" in arrays
        if self.explained:
            self.features = native.at_doubles(arrays["features"])
        if per_beam:
            self.beam_object = native.at_ints(arrays["beam_object"])
            self.beam_s = native.at_doubles(arrays["beam_s"])
            self.beam_width = arrays["beam_s"].shape[1]


def has_room(columns: Columns, beams: int) -> bool:
    """Whether all objects of another sweep of so many beams can be added, however many there are."""
    return (
        columns.objects + beams <= columns.room_objects
        and columns.vertices + 2 * beams <= columns.room_vertices
        and columns.faces + beams <= columns.room_faces
    )


class Outline:
    """The vertices of one object and its faces, as the shape and the box see them."""

    def __init__(self, most: int, located: bool) -> None:
        """
        Parameters
        ----------
        most : room for sweeps of so many beams
        located : whether vertices are where faces meet and edges are, not at their points
        """
        self.owner: list[Any] = []
        self.located = located
        self.n = 0
        self.x = native.doubles(self.owner, 2 * most)
        """The vertices, on the lines of their faces: forward [m]."""
        self.y = native.doubles(self.owner, 2 * most)
        self.extremum = native.integers(self.owner, 2 * most)
        """Of each point of the sweep, whether it is an inner vertex at an extremum of r rather than at a corner."""


def trace(
    outline: Outline,
    columns: Columns,
    points: Points,
    segments: Segments,
    survey: Survey,
    faces: Faces,
    parts: Parts,
    k: int,
) -> None:
    """Write the vertices and faces of an object (Def. 6)."""
    outline.n = 0
    begin = columns.vertices
    for i in range(parts.begin[k], parts.begin[k + 1]):
        _trace_part(outline, columns, points, segments, survey, faces, parts, parts.segment[i])
    columns.vertex_kind[columns.vertices - 1] = END
    columns.vertex_kind[begin] = START


def _trace_part(
    outline: Outline,
    columns: Columns,
    points: Points,
    segments: Segments,
    survey: Survey,
    faces: Faces,
    parts: Parts,
    j: int,
) -> None:
    """Write the vertices and faces of one part of an object."""
    low, high = faces.offset[j], faces.offset[j + 1]
    begin, first_vertex, first_face = outline.n, columns.vertices, columns.faces
    last_x, last_y = 0.0, 0.0
    for f in range(low - 1, high):
        at = faces.last[f] if f >= low else segments.first[j]
        x, y, r = points.x[at], points.y[at], points.r[at]
        theta = segmentation.bearing(points, at) + parts.past[j]
        n, v = outline.n, columns.vertices
        outline.x[n], outline.y[n] = x, y
        if outline.located and high > low:
            outline.x[n], outline.y[n] = _on_line(faces, max(f, low), x, y)
            if f >= low and f + 1 < high and faces.points[f] > 2 and faces.points[f + 1] > 2:
                moves, meet_x, meet_y = surfaces.meeting(faces, f, f + 1)
                spacing = min(faces.length[f] / faces.points[f], faces.length[f + 1] / faces.points[f + 1])
                dx, dy = meet_x - outline.x[n], meet_y - outline.y[n]
                if moves and math.sqrt(dx * dx + dy * dy) <= survey.tolerance[j] + 2.0 * spacing:
                    theta += math.atan2(meet_y * x - meet_x * y, meet_x * x + meet_y * y)
                    x, y = meet_x, meet_y
                    r = math.sqrt(x * x + y * y)
                    outline.x[n], outline.y[n] = x, y
        columns.vertex_theta[v], columns.vertex_r[v] = theta, r
        columns.vertex_kind[v] = EXTREMUM if outline.extremum[at] else CORNER
        if f >= low:
            _add_face(
                columns, faces, f, v, math.sqrt((x - last_x) * (x - last_x) + (y - last_y) * (y - last_y))
            )
        last_x, last_y = x, y
        outline.n += 1
        columns.vertices += 1
    columns.vertex_kind[first_vertex] = columns.vertex_kind[columns.vertices - 1] = CORNER
    if outline.located and high > low:
        _extend(outline, columns, points, segments, faces, j, begin, first_face)


def _on_line(faces: Faces, f: int, x: float, y: float) -> tuple[float, float]:
    """The point of the line of a face that is nearest to x, y [m]."""
    direction_x, direction_y = faces.direction_x[f], faces.direction_y[f]
    along = (x - faces.middle_x[f]) * direction_x + (y - faces.middle_y[f]) * direction_y
    return faces.middle_x[f] + along * direction_x, faces.middle_y[f] + along * direction_y


def _add_face(columns: Columns, faces: Faces, f: int, v: int, length: float) -> None:
    """Write a face of so many metres, which ends at a vertex that is written already."""
    at = columns.faces
    columns.face_theta_i[at], columns.face_theta_f[at] = columns.vertex_theta[v - 1], columns.vertex_theta[v]
    columns.face_length[at], columns.face_rms[at] = length, faces.rms[f]
    columns.faces += 1


def _extend(
    outline: Outline,
    columns: Columns,
    points: Points,
    segments: Segments,
    faces: Faces,
    j: int,
    begin: int,
    first_face: int,
) -> None:
    """Let a part go on past its first and its last point, half a beam on average, where the thing ends there.

    What is hidden may go on for longer; nobody knows.

    Parameters
    ----------
    begin, first_face : its first vertex in the outline, its first face in the columns
    """
    first, last = segments.first[j], segmentation.last_point(segments, j)
    if surfaces.is_end(segments.start_edge[j]):
        f = faces.offset[j]
        way = _overhang(points, faces, f, first, first + 1, -1.0)
        columns.face_length[first_face] += way
        outline.x[begin] -= way * faces.direction_x[f]
        outline.y[begin] -= way * faces.direction_y[f]
    if surfaces.is_end(segments.end_edge[j]):
        f = faces.offset[j + 1] - 1
        way = _overhang(points, faces, f, last, last - 1, 1.0)
        columns.face_length[columns.faces - 1] += way
        outline.x[outline.n - 1] += way * faces.direction_x[f]
        outline.y[outline.n - 1] += way * faces.direction_y[f]


def _overhang(points: Points, faces: Faces, f: int, at: int, inner: int, side: float) -> float:
    """Way along a face from its last point to the bearing half a step past it [m]; `inner` is the point before.

    Seen at a grazing angle, the line of a face may meet that bearing anywhere: not further than its last two points.
    """
    x, y, along_x, along_y = points.x[at], points.y[at], faces.direction_x[f], faces.direction_y[f]
    cos, sin = points.cos_half, side * points.sin_half
    ray_x, ray_y = x * cos - y * sin, x * sin + y * cos
    across = abs(along_x * ray_y - along_y * ray_x)
    spacing = abs((x - points.x[inner]) * along_x + (y - points.y[inner]) * along_y)
    way = abs((x * x + y * y) * sin)
    return way / across if way < spacing * across else spacing


STRAY = 2
"""So many points at an end of an object may be off its surface …"""
LEFT = 3
"""… if so many are left."""
HALF = 0.5
"""They are left out if the box of the others has less than this share of its area."""


class Description:
    """Everything about the object at hand."""

    def __init__(self, most: int, robust: bool, adaptive: bool) -> None:
        """
        Parameters
        ----------
        most : room for sweeps of so many beams
        robust : whether vertices are where faces meet and edges are, not at their points
        adaptive : whether the threshold grows with range
        """
        self.robust = robust
        self.adaptive = adaptive
        self.parts = Parts(most)
        self.outline = Outline(most, robust)
        self.circle = Circle(2 * most)
        self.look = Look()
        self.box = Box()


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
            columns.d_th[at] = segmentation.adaptive_threshold(
                points, points.d_th, columns.r_i[at], columns.s_i[at]
            )
        trace(description.outline, columns, points, segments, survey, faces, description.parts, k)
        shape.examine(description.look, faces, description.parts, k, False, False)
        if description.robust:
            _drop_stray(
                faces, description.parts, description.circle, description.look, description.outline, k
            )
        _describe_shape(
            columns,
            points,
            survey,
            faces,
            description.outline,
            description.circle,
            description.look,
            description.box,
            description.parts.begin[k + 1] - description.parts.begin[k],
        )
        columns.thing[at] = survey.thing[description.parts.segment[description.parts.begin[k]]]
        if survey.is_object[description.parts.segment[description.parts.begin[k]]]:
            columns.set[at] = OBJECT
        else:
            columns.set[at], columns.shape[at] = NOISE, WALL
        columns.object[at] = k + 1
        columns.objects += 1
        columns.vertex_offsets[at + 1], columns.face_offsets[at + 1] = columns.vertices, columns.faces
        if columns.set[at] == OBJECT:
            objects += 1
            beams += columns.beams[at]
        if columns.per_beam:
            _mark_beams(columns, points, segments, description.parts, k)
    columns.sweep_objects[row], columns.object_beams[row] = objects, beams


def _describe_points(
    columns: Columns, points: Points, segments: Segments, bodies: Bodies, parts: Parts, circle: Circle, k: int
) -> None:
    """Join the points of an object, and write what they say without its faces."""
    at = columns.objects
    first_part, last_part = parts.segment[parts.begin[k]], parts.segment[parts.begin[k + 1] - 1]
    first, last = segments.first[first_part], segmentation.last_point(segments, last_part)
    nearest, past, n = first, parts.past[first_part], 0
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
                nearest, past = p, parts.past[j]
    circle.n = n
    columns.row[at], columns.beams[at] = points.row, n
    columns.shape[at] = LEGGED if several else 0
    columns.visibility[at] = _visibility(segments.start_edge[first_part], segments.end_edge[last_part])
    before = segmentation.beam_at(points, points.position[first])
    after = segmentation.beam_at(points, points.position[last])
    columns.beam_i[at], columns.beam_f[at] = (after, before) if points.reverse else (before, after)
    columns.theta_i[at], columns.theta_f[at] = parts.theta_i[first_part], parts.theta_f[last_part]
    columns.theta_min[at] = segmentation.bearing(points, nearest) + past
    columns.r_i[at], columns.r_f[at] = points.r[first], points.r[last]
    columns.r_min[at] = points.r[nearest]
    columns.s_i[at], columns.s_f[at] = segments.s_start[first_part], segments.s_end[last_part]
    columns.d_th[at] = points.d_th
    columns.x[at], columns.y[at] = sum_x / n, sum_y / n
    columns.width[at] = segmentation.distance(points, first, last)


def _visibility(start_edge: int, end_edge: int) -> int:
    """What the two edges of an object say together."""
    if start_edge == segmentation.VIEW or end_edge == segmentation.VIEW:
        return CUT
    if _is_hidden(start_edge):
        return BOTH_HIDDEN if _is_hidden(end_edge) else START_HIDDEN
    return END_HIDDEN if _is_hidden(end_edge) else FULL


def _is_hidden(edge: int) -> bool:
    """Whether more of a body may lie past an edge."""
    return edge == segmentation.HIDDEN or edge == segmentation.FLICKERING


def _drop_stray(faces: Faces, parts: Parts, circle: Circle, look: Look, outline: Outline, k: int) -> None:
    """Leave out the few points at an end of an object that are off its surface, if without them its box is half as large.

    Where a beam meets the edge of a thing and what is behind, its range lies between the two.
    """
    if parts.begin[k + 1] - parts.begin[k] > 1 or look.count < 2:
        return
    j = parts.segment[parts.begin[k]]
    low, high = faces.offset[j], faces.offset[j + 1] - 1
    before = faces.points[low] - 1 if faces.points[low] <= STRAY + 1 else 0
    after = faces.points[high] - 1 if faces.points[high] <= STRAY + 1 and high > low else 0
    if before + after == 0 or circle.n - before - after < LEFT:
        return
    f = look.longest
    whole = shape.area_along(faces, f, circle.x, circle.y, 0, circle.n)
    shape.examine(look, faces, parts, k, before > 0, after > 0)
    f = look.longest
    if f >= 0 and shape.area_along(faces, f, circle.x, circle.y, before, circle.n - after) < HALF * whole:
        circle.n -= before + after
        for p in range(circle.n):
            circle.x[p], circle.y[p] = circle.x[p + before], circle.y[p + before]
        outline.n = 0
    else:
        shape.examine(look, faces, parts, k, False, False)


def _describe_shape(
    columns: Columns,
    points: Points,
    survey: Survey,
    faces: Faces,
    outline: Outline,
    circle: Circle,
    look: Look,
    box: Box,
    parts: int,
) -> None:
    """Write the shape of an object of so many parts, whose outline is traced, and its box."""
    at = columns.objects
    kind = shape.classify(
        look, circle, points.sigma, columns.width[at], columns.x[at], columns.y[at], survey.max_width
    )
    if kind == shape.ROUND:
        shape.around_circle(box, circle.centre_x, circle.centre_y, circle.radius)
    elif kind == shape.PRISMATIC and outline.located and outline.n > 0 and parts == 1:
        # The vertices of a prism scatter less than its points.
        shape.around_points(box, look, faces, outline.x, outline.y, outline.n)
    else:
        shape.around_points(box, look, faces, circle.x, circle.y, circle.n)
    columns.box_x[at], columns.box_y[at], columns.box_yaw[at] = box.x, box.y, box.yaw
    columns.box_length[at], columns.box_width[at] = box.length, box.width
    if columns.shape[at] != LEGGED:
        columns.shape[at] = kind


def _mark_beams(columns: Columns, points: Points, segments: Segments, parts: Parts, k: int) -> None:
    """Give every beam of an object its number."""
    if columns.set[columns.objects - 1] != OBJECT:
        return
    row = points.row * columns.beam_width
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        for p in range(segments.first[j], segments.first[j] + segments.size[j]):
            columns.beam_object[row + segmentation.beam_at(points, points.position[p])] = k + 1
