"""§3, Fig. 8: the category of an object by the topology of the faces that join its vertices.

The simpler of straight faces and a circle that explains the points. Both are compared by their Bayesian information:
n log rms² + p log n, with p parameters.
"""

from __future__ import annotations

import math

from lidarcli.formalism import detection
from lidarcli.formalism.description import circle as circles
from lidarcli.formalism.description.circle import Circle
from lidarcli.formalism.description.parts import Parts
from lidarcli.formalism.surfaces import faces as surfaces
from lidarcli.formalism.surfaces.faces import Faces

PRISMATIC, ROUND, IRREGULAR, UNKNOWN = (
    detection.PRISMATIC,
    detection.ROUND,
    detection.IRREGULAR,
    detection.UNKNOWN,
)
ENOUGH_BEAMS = 5
"""Fewer beams cannot tell a corner from an arc."""
FIT_FLOOR = 0.004
"""[m] Fits better than this are equally good."""
STRAIGHT_FIT = 0.012
"""[m] Points of a face may scatter this much, or twice the noise."""
SQUARE = math.radians(35.0)
"""[rad] Faces of a prism meet within this of a right angle, and point their corner at the sensor."""
COS_SQUARE = math.cos(SQUARE)
MOST_FACES = 3
"""Of a box no more are seen, be it from its inside."""
WORSE = 1.5
"""The algebraic circle may fit this much worse than the best one."""
ARC = 1.0
"""A circle is believed where the chord of its arc is longer than this share of its radius: else any flat piece is one."""


class Look:
    """How well the faces of one object explain its points."""

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


def examine(look: Look, faces: Faces, parts: Parts, k: int, without_first: bool, without_last: bool) -> None:
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
    look: Look, circle: Circle, sigma: float, chord: float, mean_x: float, mean_y: float, max_width: float
) -> int:
    """The shape of an object, whose circle is fitted where it may win.

    Parameters
    ----------
    sigma : noise of the ranges [m]
    chord : distance of its first point from its last [m]
    mean_x, mean_y : mean of its points [m]
    max_width : nothing is wider [m]

    Returns
    -------
    PRISMATIC, ROUND, IRREGULAR or UNKNOWN
    """
    n, allowed, level = circle.n, max(2.0 * sigma, STRAIGHT_FIT), max(0.5 * sigma, FIT_FLOOR)
    if n < ENOUGH_BEAMS:
        return UNKNOWN
    if look.count > 1 or look.rms > FIT_FLOOR:
        # A circle has three parameters, c faces have 3c - 1: so many times worse may it fit to be simpler.
        handicap = math.exp((1.5 * look.count - 2.0) * math.log(n) / n)
        rival = max(look.rms, level) * handicap
        circles.fit(circle, WORSE * rival)
        x, y = circle.centre_x, circle.centre_y
        if (
            max(circle.rms, level) < rival
            and circle.rms <= allowed
            and x * x + y * y > mean_x * mean_x + mean_y * mean_y
            and chord > ARC * circle.radius
            and 2.0 * circle.radius <= max_width
        ):
            return ROUND
    if look.square and look.count <= MOST_FACES and look.rms <= allowed:
        return PRISMATIC
    return IRREGULAR
