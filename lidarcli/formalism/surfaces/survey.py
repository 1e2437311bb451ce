"""What is known of each segment of a sweep before anybody decides what it is."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces import faces as surfaces
from lidarcli.formalism.surfaces.faces import Faces

STRAIGHT = 0.02
"""[m] A face may leave its chord by this much plus three times the noise."""
STRAIGHT_NOISE = 3.0
WALL_STRIDE, WALL_POINTS = 4, 32
"""Of a segment too wide for an object every fourth point is looked at, or as many as make 32: enough for its lines."""


class Survey:
    """Of each segment, as far as it has been found out."""

    def __init__(self, most: int, min_beams: int, max_width: float) -> None:
        """
        Parameters
        ----------
        most : room for sweeps of so many beams
        min_beams, max_width : what has fewer points or reaches further [m] is no object
        """
        self.owner: list[Any] = []
        self.min_beams = min_beams
        self.max_width = max_width
        self.chord = native.doubles(self.owner, most)
        """Distance of its first and last points [m]."""
        self.tolerance = native.doubles(self.owner, most)
        """By how much a face may leave its chord [m]."""
        self.reach = native.doubles(self.owner, most)
        """Greatest distance of a vertex from its first or last point [m]."""
        self.protrusion = native.integers(self.owner, most)
        """Whether it stands out from a wall that it touches."""
        self.wall = native.integers(self.owner, most)
        self.thing = native.doubles(self.owner, most)
        """How likely it is a thing, and not a piece of building; NaN where nobody asked."""
        self.candidate = native.integers(self.owner, most)
        """Whether it may be an object or a fragment of one."""
        self.loose = native.integers(self.owner, most)
        """Whether it may be joined with its neighbours."""
        self.is_object = native.integers(self.owner, most)
        self.label = native.integers(self.owner, most)
        """Segments of the same label are one object."""


def measure(survey: Survey, points: Points, segments: Segments) -> None:
    """The chord of every segment, and how far its faces may leave theirs."""
    tolerance = STRAIGHT + STRAIGHT_NOISE * points.sigma
    for j in range(segments.count):
        survey.chord[j] = segmentation.chord(segments, points, j)
        survey.tolerance[j] = tolerance
        survey.protrusion[j] = False


def find_faces(survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """The faces of every segment that may be an object, and those of the others as far as their lines need."""
    faces.count = 0
    for j in range(segments.count):
        size = segments.size[j]
        if survey.chord[j] <= survey.max_width:
            most = size if size >= survey.min_beams else 0
        else:
            most = max((size + WALL_STRIDE - 1) // WALL_STRIDE, min(size, WALL_POINTS))
        faces.offset[j] = faces.count
        surfaces.straight(faces, points, segments, j, most, survey.tolerance[j])
    faces.offset[segments.count] = faces.count


def measure_reach(survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """How far every segment reaches [m]: the greatest distance of a vertex from its first or last point."""
    x, y = points.x, points.y
    for j in range(segments.count):
        survey.reach[j] = survey.chord[j]
        if faces.offset[j + 1] - faces.offset[j] < 2:
            continue
        a, b = segments.first[j], segmentation.last_point(segments, j)
        farthest = 0.0
        for f in range(faces.offset[j], faces.offset[j + 1]):
            k = faces.last[f]
            # Where a thing was cut out of a wall a face may go on past its end.
            if k > b:
                continue
            farthest = max(farthest, (x[k] - x[a]) * (x[k] - x[a]) + (y[k] - y[a]) * (y[k] - y[a]))
            farthest = max(farthest, (x[k] - x[b]) * (x[k] - x[b]) + (y[k] - y[b]) * (y[k] - y[b]))
        survey.reach[j] = max(survey.reach[j], math.sqrt(farthest))


def is_partial(segments: Segments, j: int) -> bool:
    """Whether a segment may go on at an edge that is hidden, beyond the view or unknown."""
    return not (is_end(segments.start_edge[j]) and is_end(segments.end_edge[j]))


def is_end(edge: int) -> bool:
    """Whether nothing goes on at an edge."""
    return edge == segmentation.OWN or edge == segmentation.OPEN


def share_of_walls(survey: Survey, points: Points, segments: Segments) -> float:
    """The share of the points of a sweep that lie on walls."""
    on_walls = 0
    for j in range(segments.count):
        if survey.wall[j]:
            on_walls += segments.size[j]
    return on_walls / max(points.count, 1.0)
