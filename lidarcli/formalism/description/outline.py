"""Definitions 6 and 7: the vertices of an object, and the faces between them.

Of each part that is its first point, the points between its faces, and its last point; a segment of a single point has
one vertex. An inner vertex is where its faces meet, which noise moves less than the point. And a thing ends somewhere
between the last beam that hits it and the next one, which passes it.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import detection
from lidarcli.formalism.description.columns import Columns
from lidarcli.formalism.description.parts import Parts
from lidarcli.formalism.surfaces import faces as surfaces
from lidarcli.formalism.surfaces import survey as surveys
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.survey import Survey
from lidarcli.formalism.sweep import points as sweep
from lidarcli.formalism.sweep import segments as cuts
from lidarcli.formalism.sweep.points import Points
from lidarcli.formalism.sweep.segments import Segments

START, END, CORNER, EXTREMUM = detection.START, detection.END, detection.CORNER, detection.EXTREMUM


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
        theta = sweep.bearing(points, at) + parts.past[j]
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
    first, last = segments.first[j], cuts.last_point(segments, j)
    if surveys.is_end(segments.start_edge[j]):
        f = faces.offset[j]
        way = _overhang(points, faces, f, first, first + 1, -1.0)
        columns.face_length[first_face] += way
        outline.x[begin] -= way * faces.direction_x[f]
        outline.y[begin] -= way * faces.direction_y[f]
    if surveys.is_end(segments.end_edge[j]):
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
