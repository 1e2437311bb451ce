"""Set A (Def. 4): whose motion is shown by two witnesses.

The first is a sum of log-odds: how much better a moving body explains the sides that are seen than one that stands still.
The second is free space: it is now where beams passed before, or beams pass now where it was.
"""

from __future__ import annotations

import math

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import life, memory
from lidarcli.formalism.tracking import sides as measures
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.memory import Memory
from lidarcli.formalism.tracking.sides import Sides
from lidarcli.formalism.tracking.views import Views

STEADY = 0.06
"""[m] What changes its size by more than this is not seen as it is."""
SAME_SIZE = 0.2
"""[m] … and what changes it by more than this is not the same."""
CLIP = 3.0
"""One sweep says no more than this, either way."""
DRIFT = 0.05
"""The evidence loses this much every sweep."""
PARTIAL = 2.0
"""A view of which an edge is hidden speaks for motion no more than this."""
SETTLED = 2
"""A body speaks once its kind has been the same for so many sightings."""
MOST = 60.0
"""More evidence than this is not kept."""
WAY = 0.2
"""[m] What has gone less far was not shown to move."""
SHARE = 0.3
"""Of its points so many have to be where it was free."""
STOOD = 0.5
"""Of its points so many have to be where something stood before …"""
OFTEN = 2
"""… in so many sweeps, so that it was not somebody who passed by."""
PASSED = 0.1
"""[m] Beams passed a point that they left so far behind, or more."""
LATEST = 4.8
"""[s] Sweeps that are older tell nothing about now."""
POINTS = 16
"""Points of a view that are asked about, at most about so many."""


def weigh(bodies: Bodies, b: int, sides: Sides, is_whole: bool) -> None:
    """Add what the sides of a view say for and against motion; before they are taken into the estimates."""
    total = 0.0
    if sides.by_centre:
        for i in range(2):
            if not sides.is_doubtful:
                total += _odds(bodies, 2 * b + i, sides.z[2 * i], 0.0, sides.var[2 * i], sides.lasting_var)
    else:
        for i in range(2):
            total += _axis_odds(bodies, 2 * b + i, sides, 2 * i)
    total = min(max(total, -CLIP), CLIP) - DRIFT
    if bodies.settled[b] < SETTLED:
        total = min(total, 0.0)
    elif not is_whole:
        total = min(total, PARTIAL)
    bodies.evidence[b] = min(max(bodies.evidence[b] + total, 0.0), MOST)
    bodies.evidence_most[b] = max(bodies.evidence_most[b], bodies.evidence[b])


def _odds(bodies: Bodies, a: int, z: float, sign: float, var: float, lasting: float) -> float:
    """How much better a moving body explains a measurement of c + sign h than one that stands, as log-odds.

    `lasting`: variance of where the one that stands is that its sightings had in common [m²].
    """
    off, s = things.residual(bodies, a, z, sign, var)
    still_off, still_s = things.still_residual(bodies, a, z, sign, var)
    still_s += lasting
    return 0.5 * (still_off * still_off / still_s - off * off / s + math.log(still_s / s))


def _axis_odds(bodies: Bodies, a: int, sides: Sides, low: int) -> float:
    """The same of the two sides of an axis.

    Edges that may be those of returns alone speak together or not at all: where one of them moves and the other does not,
    more of a thing has come into view.
    """
    low_var, high_var = sides.var[low], sides.var[low + 1]
    of_low, of_high = 0.0, 0.0
    if low_var >= 0.0:
        of_low = _odds(bodies, a, sides.z[low], -1.0, low_var, 0.0)
    if high_var >= 0.0:
        of_high = _odds(bodies, a, sides.z[low + 1], 1.0, high_var, 0.0)
    length = sides.z[low + 1] - sides.z[low]
    if low_var >= 0.0 and high_var >= 0.0 and abs(length - 2.0 * bodies.still_h[a]) > SAME_SIZE:
        # Another piece of the same wall, say.
        return 0.0
    if low_var < measures.OPEN_VAR and high_var < measures.OPEN_VAR:
        return of_low + of_high
    if low_var < 0.0 or high_var < 0.0:
        # One of them is of no use, and the other alone is not believed.
        return 0.0
    if abs(length - 2.0 * bodies.h[a]) > STEADY:
        return 0.0
    low_off, _ = things.still_residual(bodies, a, sides.z[low], -1.0, low_var)
    high_off, _ = things.still_residual(bodies, a, sides.z[low + 1], 1.0, high_var)
    return min(of_low, of_high) if low_off * high_off > 0.0 else min(of_low + of_high, 0.0)


def note_rest(bodies: Bodies, b: int, sweep: int) -> None:
    """Remember where and when a body was last without evidence of motion."""
    if bodies.evidence[b] <= 0.0:
        bodies.onset[b] = sweep
        bodies.birth_x[b], bodies.birth_y[b] = things.centre(bodies, b)


def is_shown(
    bodies: Bodies, b: int, views: Views, scans: Scans, k: int, past: Memory, alarm: float, time: float
) -> bool:
    """Whether both witnesses say that a body moves by itself."""
    if bodies.evidence[b] < alarm:
        return False
    x, y = things.centre(bodies, b)
    dx, dy = x - bodies.birth_x[b], y - bodies.birth_y[b]
    if dx * dx + dy * dy < WAY * WAY:
        return False
    passes, hits, _ = life.passing_body(views, scans, bodies, b, bodies.birth_x[b], bodies.birth_y[b])
    size = 2.0 * max(bodies.h[2 * b], bodies.h[2 * b + 1])
    if hits > 0.5 and dx * dx + dy * dy > (size + PASSED) * (size + PASSED):
        # Something still stands where it was: another leg of the same chair was taken for it.
        return False
    if stood_there(bodies, b, views, k, past, time):
        return False
    if was_free(views, k, past, time):
        return True
    return passes > 0.5 and hits < 0.2


def stood_there(bodies: Bodies, b: int, views: Views, k: int, past: Memory, time: float) -> bool:
    """Whether something was where a view is now when the body was not there yet: a wall, of which pieces seem to slide."""
    first, stop = views.begin[k], views.begin[k + 1]
    asked = min(stop - first, POINTS)
    v_x, v_y = bodies.v[2 * b], bodies.v[2 * b + 1]
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    clear = 2.0 * max(bodies.h[2 * b], bodies.h[2 * b + 1]) + WAY
    times = 0
    for m in range(min(past.count, memory.KEPT)):
        age = time - past.time[m]
        if age < memory.APART or age > LATEST or speed * age < clear:
            continue
        hits = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if memory.was_hit(past, m, views.point_x[p], views.point_y[p]):
                hits += 1.0
        if hits >= STOOD * asked:
            times += 1
    return times >= OFTEN


def was_free(views: Views, k: int, past: Memory, time: float) -> bool:
    """Whether a view is where the beams of an earlier sweep passed."""
    first, stop = views.begin[k], views.begin[k + 1]
    asked = min(stop - first, POINTS)
    for m in range(min(past.count, memory.KEPT)):
        age = time - past.time[m]
        if age < memory.APART or age > LATEST:
            continue
        free = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if memory.was_passed(past, m, views.point_x[p], views.point_y[p], PASSED):
                free += 1.0
        if asked > 0 and free >= SHARE * asked:
            return True
    return False
