"""Definition 5: which runs are objects."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.detection import BOTH_HIDDEN, CUT, END_HIDDEN, FULL, START_HIDDEN
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.fragments import Bodies
from lidarcli.formalism.runs import EDGES, HIDDEN, OPEN, OWN, UNKNOWN, VIEW, Runs
from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int8, UInt8

STRAIGHT, CONVEX, CONCAVE = range(3)
END_WIDTH = 0.5
"""[m] What ends in the open between walls is a thing if it is narrower than this, else the end of a wall."""
POINTED_WIDTH = 0.8
"""[m] Wider than this, a corner that points at the sensor may be one of a wall, and a straight free end is one."""
HIDDEN_WIDTH = 0.5
"""[m] What is straight, wider than this and hidden on both sides is wall."""
UNKNOWN_WIDTH = 0.4
"""[m] What is no wider than this, beside beams that say nothing, is no wall, whatever line it is on: it may be a leg."""
GRAZING = np.deg2rad(15.0)
"""Between walls what is straight, wide and seen at a smaller angle is wall: a thing would show its front as well."""
PARTLY_HIDDEN_WIDTH = 0.65
"""Greatest visible extent of a straight partly hidden object, as a share of `max_width`: some of it is out of sight."""
ENCLOSED = 0.35
"""Walls surround the sensor where they give more than this share of its returns."""
FEW_WALLS = 0.1
"""Where runs too wide for an object give no more than this share, there are no doorways between them."""
NO_NEIGHBOUR = (OPEN, UNKNOWN)
"""Beside the run is no range at all: nothing is seen behind it, and scanners also lose the beam that grazes an edge."""


def fully_visible(runs: Runs) -> Bool:
    """Profile `paper`: runs whose edges are both their own; beside a beam without a return the background is beyond range.

    (R,)
    """
    own_start = (runs.start_edge == OWN) | (runs.start_edge == OPEN)
    own_end = (runs.end_edge == OWN) | (runs.end_edge == OPEN)
    both: Bool = own_start & own_end
    return both


@compiled
def by_extent(
    runs: Runs, faces: Faces, reach: Float64, thing: Bool, min_beams: int, max_width: float
) -> tuple[Bool, Bool, Bool, Int8]:
    """Profile `robust`: which runs are walls because they reach too far, and which of the others may be pieces of one.

    Parameters
    ----------
    runs, faces : R runs and their faces
    reach : (R,) their extent [m]
    thing : (R,) runs that are things, whatever their extent
    min_beams, max_width : what has fewer points or reaches further [m] is no object

    Returns
    -------
    wall : (R,)
    candidate : (R,) runs that may be pieces of walls
    partial : (R,) see `partly_hidden`
    bend : (R,) see `bends`
    """
    enough = runs.size >= min_beams
    small = enough & (reach <= max_width)
    wall = enough & ~small & ~thing
    bend = bends(faces)
    doorways = share(runs, wall) > FEW_WALLS
    candidate = small & ~thing & ~stands_alone(runs, reach, bend, doorways)
    return wall, candidate, partly_hidden(runs), bend


@compiled
def pieces(runs: Runs, ends: Float64, wall: Bool, thing: Bool, max_width: float) -> Bool:
    """Profile `robust`: which runs may be objects or parts of some, by themselves.

    Parameters
    ----------
    runs : R runs
    ends : (R,) distance of their first and last points [m]
    wall, thing : (R,) which of them are known as walls, or as things
    max_width : greatest extent of an object [m]

    Returns
    -------
    (R,)
    """
    return (ends <= max_width) & ~wall & ~thing & ~surrounding(runs)


@compiled
def chosen(
    runs: Runs,
    wall: Bool,
    piece: Bool,
    thing: Bool,
    bodies: Bodies,
    bend: Int8,
    min_beams: int,
    max_width: float,
) -> Bool:
    """Profile `robust`: which runs are objects, or parts of some.

    Parameters
    ----------
    runs : R runs
    wall : (R,) known walls
    piece : (R,) runs that may be objects
    thing : (R,) runs that are some if they have points enough
    bodies : the runs as parts of bodies
    bend : (R,) see `bends`
    min_beams, max_width : what has fewer points or reaches further [m] is no object

    Returns
    -------
    (R,)
    """
    is_object = piece & (bodies.size >= min_beams) & (bodies.reach <= max_width)
    is_object &= recognisable(bodies, bend, grazing(runs), share(runs, wall) > ENCLOSED, max_width)
    return is_object | thing & (runs.size >= min_beams)


def share(runs: Runs, wall: Bool) -> Float64:
    """(R,) share of the points of its sweep that lie on walls."""
    on_walls = np.bincount(runs.row, runs.size * wall, minlength=len(runs.points.start) - 1)
    share: Float64 = (on_walls / np.maximum(np.diff(runs.points.start), 1))[runs.row]
    return share


def recognisable(bodies: Bodies, bend: Int8, along: Bool, enclosed: Bool, max_width: float) -> Bool:
    """Profile `robust`: bodies that show enough of their outline to be more than a piece of the background.

    An edge of its own tells a body from the background, and so does a corner that points at the sensor: walls point
    theirs away. Between walls all else is wall, unless both ends are in the open, or one is and the body is slight.
    Where no walls surround the sensor, the rest are things too, if they are not as straight and long as a wall.

    Parameters
    ----------
    bodies : R runs as parts of bodies
    bend : (R,) sign of the corners of each run, see `bends`
    along : (R,) runs that are seen at a grazing angle, see `grazing`
    enclosed : (R,) whether walls surround the sensor
    max_width : greatest extent of an object [m]

    Returns
    -------
    (R,)
    """
    start, end, reach = bodies.start_edge, bodies.end_edge, bodies.reach
    own = (start == OWN) | (end == OWN)
    open_start, open_end = _is_one_of(start, NO_NEIGHBOUR), _is_one_of(end, NO_NEIGHBOUR)
    hidden = (start == HIDDEN) & (end == HIDDEN)
    whole = bodies.parts == 1
    straight = (bend == STRAIGHT) & whole
    slight = (reach < END_WIDTH) & (open_start | open_end) & (start != VIEW) & (end != VIEW)
    free = open_start & open_end | slight
    pointed = (bend == CONVEX) & (reach < POINTED_WIDTH)
    wide = straight & (reach > HIDDEN_WIDTH)
    background = hidden & whole & (wide | (bend == CONCAVE)) | wide & along & enclosed
    goes_on = straight & ~_is_seen(start, end) | enclosed & (open_start | open_end)
    too_long = goes_on & (reach > PARTLY_HIDDEN_WIDTH * max_width)
    visible: Bool = (own | free | pointed | ~enclosed) & ~background & ~too_long
    return visible


def grazing(runs: Runs) -> Bool:
    """(R,) runs whose chord points at the sensor, give or take `GRAZING`."""
    x, y = runs.points.x, runs.points.y
    dx, dy = x[runs.last] - x[runs.first], y[runs.last] - y[runs.first]
    mx, my = x[runs.last] + x[runs.first], y[runs.last] + y[runs.first]
    along: Bool = np.abs(dx * my - dy * mx) < np.tan(GRAZING) * np.abs(dx * mx + dy * my)
    return along


def stands_alone(runs: Runs, reach: Float64, bend: Int8, doorways: Bool) -> Bool:
    """Runs that are no piece of a wall even if they lie on its line.

    Walls point their corners at the sensor at the jambs of doorways only. And where a neighbour is unknown, a slight run
    may show all there is of it.

    Parameters
    ----------
    runs : R runs
    reach : (R,) their extent [m]
    bend : (R,) sign of their corners, see `bends`
    doorways : (R,) whether there are walls enough for doorways

    Returns
    -------
    (R,)
    """
    unknown = (runs.start_edge == UNKNOWN) | (runs.end_edge == UNKNOWN)
    alone: Bool = (bend == CONVEX) & ~doorways | unknown & (reach <= UNKNOWN_WIDTH)
    return alone


def bends(faces: Faces) -> Int8:
    """(R,) CONVEX where all corners of a run point at the sensor, CONCAVE where one points away, STRAIGHT without any."""
    turn = faces.turn(np.arange(len(faces) - 1), np.arange(1, len(faces)))
    same = faces.run[1:] == faces.run[:-1]
    away = np.bincount(faces.run[1:][same & (turn > 0)], minlength=len(faces.offsets) - 1) > 0
    bend = np.where(np.diff(faces.offsets) > 1, CONVEX, STRAIGHT).astype(np.int8)
    bend[away] = CONCAVE
    return bend


def partly_hidden(runs: Runs) -> Bool:
    """Runs that may go on where an edge is hidden, beyond the view or unknown. (R,)"""
    return ~_is_seen(runs.start_edge, runs.end_edge)


def _is_seen(start_edge: UInt8, end_edge: UInt8) -> Bool:
    """Whether nothing goes on at either edge."""
    seen = (OWN, OPEN)
    return _is_one_of(start_edge, seen) & _is_one_of(end_edge, seen)


def surrounding(runs: Runs) -> Bool:
    """(R,) turns without any discontinuity: both edges are hidden, by no step at all."""
    around: Bool = (runs.start_edge == HIDDEN) & (runs.end_edge == HIDDEN) & np.isnan(runs.s_start)
    return around


def _is_one_of(edge: UInt8, kinds: tuple[int, int]) -> Bool:
    """Which edges are of one of two kinds."""
    result: Bool = (edge == kinds[0]) | (edge == kinds[1])
    return result


def _together() -> UInt8:
    """(5, 5) what every start edge (row) and end edge (column) say together."""
    codes = np.full((len(EDGES), len(EDGES)), FULL, np.uint8)
    codes[HIDDEN] = START_HIDDEN
    codes[:, HIDDEN] = END_HIDDEN
    codes[HIDDEN, HIDDEN] = BOTH_HIDDEN
    codes[VIEW] = CUT
    codes[:, VIEW] = CUT
    return codes


_TOGETHER = _together()


def visibility(start_edge: UInt8, end_edge: UInt8) -> UInt8:
    """(K,) codes into `VISIBILITIES`: what the two edges of an object say together."""
    hidden_start, hidden_end = start_edge == HIDDEN, end_edge == HIDDEN
    codes = np.full(len(start_edge), FULL, np.uint8)
    codes[hidden_start] = START_HIDDEN
    codes[hidden_end] = END_HIDDEN
    codes[hidden_start & hidden_end] = BOTH_HIDDEN
    codes[(start_edge == VIEW) | (end_edge == VIEW)] = CUT
    return codes
