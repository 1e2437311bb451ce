"""Ranges of sweeps that a log holds as points: the frame of the points, and the beam of each.

The documentation of ARIA says that points are in the frame of the robot. Its loggers write them from the laser on: in the
laser's frame since version 4, along the axes of the robot before. Bearings tell which of them holds for a log.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.planar import wrapped
from lidarcli.sweeps import TURN, Bool, Float64, Int64

_FAR_ENOUGH = 0.2
"""Least range of a point whose bearing counts [m]: points are whole millimetres."""
_ENOUGH = 20
"""Least points by which the frame is found."""
_LEAST_MISS = 0.02
"""Greatest error of bearings in the right frame [rad]."""
_LASERS_AXES = 4
"""First version whose points have the axes of the laser."""


class Reading(NamedTuple):
    """Frame and order of the points of a laser."""

    robot: bool
    """True where they start at the robot, not at the laser."""
    turned: bool
    """True where they have the axes of the robot, not of the laser."""
    backwards: bool
    """True where the last beam comes first."""
    in_order: bool = True
    """True where the place in a line is that of the beam; otherwise the bearing gives the beam."""


class Points(NamedTuple):
    """The points of S sweeps, one after the other."""

    x: Float64
    """(P,) Coordinate ahead [m]."""
    y: Float64
    """(P,) Coordinate to the left [m]."""
    row: Int64
    """(P,) Sweep of each."""
    place: Int64
    """(P,) Place among those of its sweep."""
    mount: Float64
    """(S, 3) x, y [m] and yaw [rad] of the laser on the robot."""

    @property
    def there(self) -> Bool:
        """(P,) False for a beam without a return, which is 0 0."""
        there: Bool = (self.x != 0) | (self.y != 0)
        return there

    def seen(self, how: Reading) -> tuple[Float64, Float64]:
        """Return range and bearing (P,) of each point from the laser on."""
        x, y, yaw = (self.mount[self.row, column] for column in range(3))
        ahead, left = (self.x - x, self.y - y) if how.robot else (self.x, self.y)
        bearing = np.arctan2(left, ahead) - (yaw if how.turned else 0.0)
        return np.hypot(ahead, left), bearing


@dataclass(slots=True)
class Readings:
    """Reading of each laser: decided by the first block that shows it, and kept."""

    report: ReadReport
    _known: dict[str, Reading] = field(default_factory=dict)

    def of(self, topic: str, version: int, points: Points, expected: Float64, mirrored: Float64) -> Reading:
        """Decide by bearings: they should be `expected` (P,), or `mirrored` where the last beam comes first."""
        usual = Reading(False, version < _LASERS_AXES, False)
        if topic in self._known:
            return self._known[topic]
        use = points.there & (np.hypot(points.x, points.y) > _FAR_ENOUGH) & ~np.isnan(expected)
        if np.count_nonzero(use) < _ENOUGH:
            return usual
        best, least = usual, np.inf
        for robot, turned in ((False, usual.turned), (False, not usual.turned), (True, True)):
            _, bearing = points.seen(Reading(robot, turned, False))
            for backwards, wanted in ((False, expected), (True, mirrored)):
                miss = float(np.median(np.abs(wrapped((bearing - wanted)[use]))))
                # What is usual is left only for what fits better by far.
                if miss < least - 1e-3:
                    best, least = Reading(robot, turned, backwards), miss
        if least > _LEAST_MISS:
            best = usual._replace(in_order=False)
            self.report.notes.append(
                f"{topic}: points do not lie in the order of the beams; each is put where its bearing says"
            )
        elif best.robot:
            self.report.notes.append(f"{topic}: points are told from the robot on, not from the laser")
        self._known[topic] = best
        return best


def by_bearing(
    ranges: Float64, bearing: Float64, points: Points, first: Float64, step: Float64, beams: Int64
) -> tuple[Float64, Int64]:
    """Return ranges of S sweeps of `beams` each, one after the other, by the bearings of points.

    Of several points on one beam the nearest counts. Also returns the number (S,) of points beside the view.
    """
    off = bearing - first[points.row]
    step_of = step[points.row]
    with np.errstate(invalid="ignore", divide="ignore"):
        beam = np.rint(np.where(step_of > 0, (off + 1e-9) % TURN, -((-off + 1e-9) % TURN)) / step_of)
        turn = np.rint(TURN / np.abs(step_of))
    # A point just before the first beam is one turn behind it.
    beam = np.where(beam >= turn, beam - turn, beam)
    inside = points.there & (beam >= 0) & (beam < beams[points.row])
    begin = np.cumsum(beams) - beams
    flat = np.full(int(beams.sum()), np.inf)
    place = (begin[points.row] + np.where(inside, beam, 0).astype(np.int64))[inside]
    np.minimum.at(flat, place, ranges[inside])
    lost = np.bincount(points.row[points.there & ~inside], minlength=len(beams))
    return np.where(np.isinf(flat), 0.0, flat), lost.astype(np.int64)
