"""What is known of each object of a sweep once its segments are chosen, and where it is written."""

from __future__ import annotations

from lidarcli.formalism import detection
from lidarcli.formalism.description import box as boxes
from lidarcli.formalism.description import outline as outlines
from lidarcli.formalism.description import shape as shapes
from lidarcli.formalism.description.box import Box
from lidarcli.formalism.description.circle import Circle
from lidarcli.formalism.description.columns import Columns
from lidarcli.formalism.description.outline import Outline
from lidarcli.formalism.description.parts import Parts
from lidarcli.formalism.description.shape import Look
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey
from lidarcli.formalism.sweep import breakpoints as breaks
from lidarcli.formalism.sweep import points as sweep
from lidarcli.formalism.sweep import segments as cuts
from lidarcli.formalism.sweep.points import Points
from lidarcli.formalism.sweep.segments import Segments

OBJECT, NOISE = detection.OBJECT, detection.NOISE
LEGGED, WALL = detection.LEGGED, detection.WALL
FULL, START_HIDDEN, END_HIDDEN = detection.FULL, detection.START_HIDDEN, detection.END_HIDDEN
BOTH_HIDDEN, CUT = detection.BOTH_HIDDEN, detection.CUT
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
            columns.d_th[at] = breaks.adaptive_threshold(
                points, points.d_th, columns.r_i[at], columns.s_i[at]
            )
        outlines.trace(description.outline, columns, points, segments, survey, faces, description.parts, k)
        shapes.examine(description.look, faces, description.parts, k, False, False)
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
    first, last = segments.first[first_part], cuts.last_point(segments, last_part)
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
    before = sweep.beam_at(points, points.position[first])
    after = sweep.beam_at(points, points.position[last])
    columns.beam_i[at], columns.beam_f[at] = (after, before) if points.reverse else (before, after)
    columns.theta_i[at], columns.theta_f[at] = parts.theta_i[first_part], parts.theta_f[last_part]
    columns.theta_min[at] = sweep.bearing(points, nearest) + past
    columns.r_i[at], columns.r_f[at] = points.r[first], points.r[last]
    columns.r_min[at] = points.r[nearest]
    columns.s_i[at], columns.s_f[at] = segments.s_start[first_part], segments.s_end[last_part]
    columns.d_th[at] = points.d_th
    columns.x[at], columns.y[at] = sum_x / n, sum_y / n
    columns.width[at] = sweep.distance(points, first, last)


def _visibility(start_edge: int, end_edge: int) -> int:
    """What the two edges of an object say together."""
    if start_edge == cuts.VIEW or end_edge == cuts.VIEW:
        return CUT
    if _is_hidden(start_edge):
        return BOTH_HIDDEN if _is_hidden(end_edge) else START_HIDDEN
    return END_HIDDEN if _is_hidden(end_edge) else FULL


def _is_hidden(edge: int) -> bool:
    """Whether more of a body may lie past an edge."""
    return edge == cuts.HIDDEN or edge == cuts.FLICKERING


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
    whole = boxes.area_along(faces, f, circle.x, circle.y, 0, circle.n)
    shapes.examine(look, faces, parts, k, before > 0, after > 0)
    f = look.longest
    if f >= 0 and boxes.area_along(faces, f, circle.x, circle.y, before, circle.n - after) < HALF * whole:
        circle.n -= before + after
        for p in range(circle.n):
            circle.x[p], circle.y[p] = circle.x[p + before], circle.y[p + before]
        outline.n = 0
    else:
        shapes.examine(look, faces, parts, k, False, False)


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
    shape = shapes.classify(
        look, circle, points.sigma, columns.width[at], columns.x[at], columns.y[at], survey.max_width
    )
    if shape == shapes.ROUND:
        boxes.around_circle(box, circle.centre_x, circle.centre_y, circle.radius)
    elif shape == shapes.PRISMATIC and outline.located and outline.n > 0 and parts == 1:
        # The vertices of a prism scatter less than its points.
        boxes.around_points(box, look, faces, outline.x, outline.y, outline.n)
    else:
        boxes.around_points(box, look, faces, circle.x, circle.y, circle.n)
    columns.box_x[at], columns.box_y[at], columns.box_yaw[at] = box.x, box.y, box.yaw
    columns.box_length[at], columns.box_width[at] = box.length, box.width
    if columns.shape[at] != LEGGED:
        columns.shape[at] = shape


def _mark_beams(columns: Columns, points: Points, segments: Segments, parts: Parts, k: int) -> None:
    """Give every beam of an object its number."""
    if columns.set[columns.objects - 1] != OBJECT:
        return
    row = points.row * columns.beam_width
    for i in range(parts.begin[k], parts.begin[k + 1]):
        j = parts.segment[i]
        for p in range(segments.first[j], segments.first[j] + segments.size[j]):
            columns.beam_object[row + sweep.beam_at(points, points.position[p])] = k + 1
