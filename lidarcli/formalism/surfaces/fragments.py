"""Fragments of one thing that a step of its own surface tore apart: a leaf before a stem, front and side of a box."""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces.survey import Survey

GAP = 0.16
"""[m] Things stand further apart than this; steps below it are within one."""
EXTENT = 0.9
"""[m] Greatest distance between the far ends of two fragments."""


class Bodies:
    """The segments with what tore them apart undone; every field is equal for all segments of a body."""

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.joins = native.integers(self.owner, most)
        """Whether the next segment belongs to the same body."""
        self.label = native.integers(self.owner, most)
        """Least segment of the body."""
        self.start_edge = native.integers(self.owner, most)
        self.end_edge = native.integers(self.owner, most)
        self.size = native.integers(self.owner, most)
        """Number of points."""
        self.reach = native.doubles(self.owner, most)
        """Extent [m]."""
        self.parts = native.integers(self.owner, most)
        """Number of segments."""


def join(bodies: Bodies, survey: Survey, points: Points, segments: Segments, may: Any) -> None:
    """Join neighbouring segments that a small step divides.

    Parameters
    ----------
    may : of each segment whether it may be a fragment
    """
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
    """Whether the next segment belongs to the same thing."""
    after = segmentation.following(segments, points, j)
    edge = segments.end_edge[j]
    if (
        after == j
        or not (may[j] and may[after])
        or not (edge == segmentation.OWN or edge == segmentation.HIDDEN)
    ):
        return False
    if not (survey.reach[j] < EXTENT and survey.reach[after] < EXTENT):
        return False
    gap = segmentation.distance(points, segments.first[after], segmentation.last_point(segments, j))
    span = segmentation.distance(points, segmentation.last_point(segments, after), segments.first[j])
    return gap < GAP and span < EXTENT


def _collect(
    bodies: Bodies, survey: Survey, points: Points, segments: Segments, first: int, ring: bool
) -> None:
    """Make one body of a segment and all that join it; in a ring of segments all around none comes last."""
    label, last, size, parts, reach = first, first, 0, 0, 0.0
    j = first
    while parts == 0 or (bodies.joins[last] and j != first):
        label, last = min(label, j), j
        size += segments.size[j]
        reach = max(reach, survey.reach[j])
        parts += 1
        j = segmentation.following(segments, points, j)
    if ring:
        last = first
    if parts > 1:
        across = segmentation.distance(points, segments.first[first], segmentation.last_point(segments, last))
        reach = max(reach, across)
    j = first
    for _ in range(parts):
        bodies.label[j], bodies.size[j], bodies.reach[j], bodies.parts[j] = label, size, reach, parts
        bodies.start_edge[j], bodies.end_edge[j] = segments.start_edge[first], segments.end_edge[last]
        j = segmentation.following(segments, points, j)
