"""Definition 5: which segments are objects."""

from __future__ import annotations

import math

from lidarcli.formalism.surfaces import survey as surveys
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey
from lidarcli.formalism.sweep import segments as cuts
from lidarcli.formalism.sweep.points import Points
from lidarcli.formalism.sweep.segments import Segments

END_WIDTH = 0.5
"""[m] What ends in the open between walls is a thing if it is narrower than this, else the end of a wall."""
POINTED_WIDTH = 0.8
"""[m] Wider than this, a corner that points at the sensor may be one of a wall, and a straight free end is one."""
HIDDEN_WIDTH = 0.5
"""[m] What is straight, wider than this and hidden on both sides is wall."""
GRAZING = math.radians(15.0)
"""[rad] Between walls what is straight, wide and seen at a smaller angle is wall: a thing would show its front as well."""
TAN_GRAZING = math.tan(GRAZING)
PARTLY_HIDDEN_WIDTH = 0.65
"""Greatest visible extent of a straight partly hidden object, as a share of `max_width`: some of it is out of sight."""
ENCLOSED = 0.35
"""Walls surround the sensor where they give more than this share of its returns."""


def fully_visible(survey: Survey, segments: Segments) -> None:
    """Profile `paper`: segments whose edges are both their own, with points enough and no wider than an object.

    Beside a beam without a return the background is beyond range.
    """
    for j in range(segments.count):
        survey.is_object[j] = not surveys.is_partial(segments, j) and _may_be(survey, segments, j)


def known(survey: Survey, segments: Segments) -> None:
    """The same of the segments of which the background tells (`candidate`), whatever their edges."""
    for j in range(segments.count):
        survey.is_object[j] = survey.candidate[j] and _may_be(survey, segments, j)


def _may_be(survey: Survey, segments: Segments, j: int) -> bool:
    return segments.size[j] >= survey.min_beams and survey.reach[j] <= survey.max_width


def pieces(survey: Survey, segments: Segments) -> None:
    """Profile `robust`: which segments may be objects or fragments of some, by themselves (`candidate`)."""
    for j in range(segments.count):
        survey.candidate[j] = (
            survey.chord[j] <= survey.max_width
            and not survey.wall[j]
            and not survey.protrusion[j]
            and not cuts.surrounds(segments, j)
        )


def known_bodies(survey: Survey, segments: Segments, bodies: Bodies) -> None:
    """Which of the segments of which the background tells are objects, with what tore them apart undone."""
    for j in range(segments.count):
        survey.is_object[j] = survey.candidate[j] and _is_whole(survey, bodies, j)


def choose(survey: Survey, points: Points, segments: Segments, bodies: Bodies) -> None:
    """Profile `robust`: which segments are objects, or fragments of some."""
    enclosed = surveys.share_of_walls(survey, points, segments) > ENCLOSED
    for j in range(segments.count):
        if survey.protrusion[j] and segments.size[j] >= survey.min_beams:
            survey.is_object[j] = True
        else:
            survey.is_object[j] = (
                survey.candidate[j]
                and _is_whole(survey, bodies, j)
                and _is_recognisable(survey, points, segments, bodies, j, enclosed)
            )


def _is_whole(survey: Survey, bodies: Bodies, j: int) -> bool:
    return bodies.size[j] >= survey.min_beams and bodies.reach[j] <= survey.max_width


def _is_recognisable(
    survey: Survey, points: Points, segments: Segments, bodies: Bodies, j: int, enclosed: bool
) -> bool:
    """Whether a body shows enough of its outline to be more than a piece of the background.

    An edge of its own tells a body from the background, and so does a corner that points at the sensor: walls point
    theirs away. Between walls all else is wall, unless both ends are in the open, or one is and the body is slight.
    Where no walls surround the sensor, the rest are things too, if they are not as straight and long as a wall.
    """
    start, end, reach, bend = bodies.start_edge[j], bodies.end_edge[j], bodies.reach[j], survey.bend[j]
    whole = bodies.parts[j] == 1
    own = start == cuts.OWN or end == cuts.OWN
    open_start, open_end = _is_open(start), _is_open(end)
    straight = bend == surveys.FLAT and whole
    wide = straight and reach > HIDDEN_WIDTH
    slight = reach < END_WIDTH and (open_start or open_end) and start != cuts.VIEW and end != cuts.VIEW
    free = (open_start and open_end) or slight
    pointed = bend == surveys.CONVEX and reach < POINTED_WIDTH
    if not (own or free or pointed or not enclosed):
        return False
    if start == cuts.HIDDEN and end == cuts.HIDDEN and whole and (wide or bend == surveys.CONCAVE):
        return False
    if wide and enclosed and _is_grazing(points, segments, j):
        return False
    goes_on = straight and not (surveys.is_end(start) and surveys.is_end(end))
    goes_on = goes_on or (enclosed and (open_start or open_end))
    return not (goes_on and reach > PARTLY_HIDDEN_WIDTH * survey.max_width)


def _is_open(edge: int) -> bool:
    """Whether beside an edge is no range: nothing is seen behind it, or the beam that grazes it is lost, too."""
    return edge == cuts.OPEN or edge == cuts.UNKNOWN


def _is_grazing(points: Points, segments: Segments, j: int) -> bool:
    """Whether the chord of a segment points at the sensor."""
    x, y, a, b = points.x, points.y, segments.first[j], cuts.last_point(segments, j)
    dx, dy, mx, my = x[b] - x[a], y[b] - y[a], x[b] + x[a], y[b] + y[a]
    return abs(dx * my - dy * mx) < TAN_GRAZING * abs(dx * mx + dy * my)
