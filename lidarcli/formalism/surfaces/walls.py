"""§2.2: walls, told from objects by their extent and by the lines they share."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.surfaces import survey as surveys
from lidarcli.formalism.surfaces.faces import Faces
from lidarcli.formalism.surfaces.survey import Survey
from lidarcli.formalism.sweep import segments as cuts
from lidarcli.formalism.sweep.points import Points
from lidarcli.formalism.sweep.segments import Segments

FEW_WALLS = 0.1
"""Where segments too wide for an object give no more than this share of a sweep, there are no doorways between them."""
UNKNOWN_WIDTH = 0.4
"""[m] What is no wider than this, beside beams that say nothing, is no wall, whatever line it is on: it may be a leg."""
LINE_LENGTH = 0.5
"""[m] A shorter face says too little about the direction of a wall."""
LINE_POINTS = 4
"""A face of fewer points does, too."""
COLLINEAR = 0.03
"""[m] Walls are as plane as this; skirting boards and door frames stand out less."""
NOISE_GAIN = 3.0
"""The mean of many ranges exceeds this many of its standard deviations in 3 of 1,000 faces."""
WALL_THICKNESS = 0.5
"""[m] A door jamb reaches no further behind the line of its wall."""
DOORWAY = 2.0
"""[m] A jamb is no further than this from the nearest part of its wall."""
NEXT_PIECE = 3.0
"""[m] A fully visible piece further than this from a wall lies on its line by chance."""
PAIR_ERROR = 0.1
"""[m] Two pieces prove a wall only where the line of one is known better than this at the other."""
REACH_LIMIT = 0.1
"""[m] Greatest distance at which a piece still counts as on the line, however uncertain the line is."""


INFINITY = float("inf")


class Lines:
    """The faces of a sweep that give the lines of walls, and how one face lies to one of them."""

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.face = native.integers(self.owner, 2 * most)
        self.count = 0
        self.matched = native.integers(self.owner, 2 * most)
        """Whether a face lies on the line of another that is a wall, or gives it."""
        self.balance = native.doubles(self.owner, most)
        """By how much more of a segment is on such lines than not [m]."""
        self.on_line = False
        """Both ends of the face lie on the line, within what is known of it."""
        self.jamb = False
        """One end lies on the line close to its face, the other behind it by no more than a wall is thick."""
        self.reach = 0.0
        """How far the two reach together along the line [m]."""
        self.beyond = 0.0
        """How far the face is from the nearest part of the line's own [m]."""
        self.error = 0.0
        """Uncertainty of the line at the face [m]."""


def by_extent(survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Which segments are walls because they reach too far, and which of the others may be pieces of one."""
    for j in range(segments.count):
        survey.partial[j] = surveys.is_partial(segments, j)
        survey.bend[j] = surveys.bend_of(faces, j)
        survey.wall[j] = (
            segments.size[j] >= survey.min_beams
            and not survey.reach[j] <= survey.max_width
            and not survey.protrusion[j]
        )
    doorways = surveys.share_of_walls(survey, points, segments) > FEW_WALLS
    for j in range(segments.count):
        # Walls point their corners at the sensor at the jambs of doorways only. And where a neighbour is unknown, a
        # slight segment may show all there is of it.
        unknown = segments.start_edge[j] == cuts.UNKNOWN or segments.end_edge[j] == cuts.UNKNOWN
        survey.candidate[j] = (
            segments.size[j] >= survey.min_beams
            and survey.reach[j] <= survey.max_width
            and not survey.protrusion[j]
            and not (survey.bend[j] == surveys.CONVEX and not doorways)
            and not (unknown and survey.reach[j] <= UNKNOWN_WIDTH)
        )


def by_lines(lines: Lines, survey: Survey, points: Points, segments: Segments, faces: Faces) -> None:
    """Which candidates lie on the line of a wall: a wall between two doorways is short, but continues its neighbours.

    Most of the length of its faces has to. Two candidates that are partly hidden and on one line are one wall, too,
    where together they reach further than an object may.
    """
    lines.count = 0
    for f in range(faces.count):
        lines.matched[f] = False
        j = faces.segment[f]
        gives = survey.wall[j] or (survey.candidate[j] and survey.partial[j])
        if gives and faces.length[f] >= LINE_LENGTH and faces.points[f] >= LINE_POINTS:
            lines.face[lines.count] = f
            lines.count += 1
    for k in range(lines.count):
        _match(lines, survey, points, faces, lines.face[k])
    for j in range(segments.count):
        lines.balance[j] = 0.0
    for f in range(faces.count):
        lines.balance[faces.segment[f]] += faces.length[f] if lines.matched[f] else -faces.length[f]
    for j in range(segments.count):
        if survey.candidate[j] and lines.balance[j] > 0:
            survey.wall[j] = True


def _match(lines: Lines, survey: Survey, points: Points, faces: Faces, line: int) -> None:
    """Mark the faces of candidates that lie on the line of a face, and that face with them."""
    wall = faces.segment[line]
    normal_x, normal_y = faces.direction_y[line], -faces.direction_x[line]
    away = faces.middle_x[line] * normal_x + faces.middle_y[line] * normal_y
    if not away > 0:
        normal_x, normal_y, away = -normal_x, -normal_y, -away
    allowed = COLLINEAR + REACH_LIMIT + NOISE_GAIN * points.sigma
    deepest = max(allowed, WALL_THICKNESS)
    for f in range(faces.count):
        j = faces.segment[f]
        if not survey.candidate[j]:
            continue
        # The middle is as deep as the two ends on average, and both are wanted in these bounds.
        depth = faces.middle_x[f] * normal_x + faces.middle_y[f] * normal_y - away
        if not (depth >= -allowed and depth <= deepest):
            continue
        _place(lines, points, faces, line, f)
        on_line = lines.on_line and (survey.partial[j] or lines.beyond < NEXT_PIECE)
        pair = survey.partial[j] and wall != j and lines.reach > survey.max_width and lines.error < PAIR_ERROR
        if ((on_line or lines.jamb) and survey.wall[wall]) or (on_line and pair):
            lines.matched[line] = lines.matched[f] = True


def _place(lines: Lines, points: Points, faces: Faces, line: int, face: int) -> None:
    """How a face lies to the line of another."""
    direction_x, direction_y = faces.direction_x[line], faces.direction_y[line]
    length = faces.length[line]
    side = 1.0 if faces.middle_x[line] * direction_y - faces.middle_y[line] * direction_x > 0 else -1.0
    spread = max(faces.rms[line], points.sigma) / math.sqrt(faces.points[line])
    own_error = NOISE_GAIN * points.sigma * min(1.0, 2.0 / math.sqrt(faces.points[face]))
    lines.on_line, lines.jamb, lines.error = True, False, 0.0
    inside, nearest, farthest = True, INFINITY, 0.0
    half = -0.5 * faces.length[face]
    for _ in range(2):
        dx = faces.middle_x[face] + half * faces.direction_x[face] - faces.middle_x[line]
        dy = faces.middle_y[face] + half * faces.direction_y[face] - faces.middle_y[line]
        depth = (dx * direction_y - dy * direction_x) * side
        along = abs(dx * direction_x + dy * direction_y)
        share = along / length
        line_error = NOISE_GAIN * spread * math.sqrt(1.0 + 12.0 * (share * share))
        allowed = COLLINEAR + own_error + min(line_error, REACH_LIMIT)
        if abs(depth) <= allowed:
            lines.jamb = True
        else:
            lines.on_line = False
        inside = inside and depth >= -allowed and depth <= WALL_THICKNESS
        lines.error = max(lines.error, line_error)
        nearest, farthest = min(nearest, along), max(farthest, along)
        half = -half
    lines.reach = farthest + 0.5 * length
    lines.beyond = nearest - 0.5 * length
    lines.jamb = lines.jamb and inside and lines.beyond < DOORWAY
