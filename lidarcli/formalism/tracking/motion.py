"""Set A (Def. 4): whose motion is shown by two witnesses.

The first is a sum of log-odds: how much better a moving body explains the sides that are seen than one that stands still.
The second is free space: it is now where beams passed before, or beams pass now where it was.
"""

from __future__ import annotations

import math

from lidarcli.formalism.sweep.points import Scans
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import life, memory
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.memory import Memory
from lidarcli.formalism.tracking.sides import Sides
from lidarcli.formalism.tracking.views import Views

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
PASSED = 0.1
"""[m] Beams passed a point that they left so far behind, or more."""
LATEST = 4.8
"""[s] Sweeps that are older tell nothing about now."""
POINTS = 16
"""Points of a view that are asked about, at most about so many."""


def weigh(bodies: Bodies, b: int, sides: Sides, is_whole: bool) -> None:
    """Add what the sides of a view say for and against motion; before they are taken into the estimates."""
    total = 0.0
    for side in range(4):
        if sides.var[side] < 0.0 or (sides.by_centre and (side == 1 or side == 3)):
            continue
        sign = 0.0 if sides.by_centre else (1.0 if side == 1 or side == 3 else -1.0)
        a = 2 * b + side // 2
        off, s = things.residual(bodies, a, sides.z[side], sign, sides.var[side])
        still_off, still_s = things.still_residual(bodies, a, sides.z[side], sign, sides.var[side])
        total += 0.5 * (still_off * still_off / still_s - off * off / s + math.log(still_s / s))
    total = min(max(total, -CLIP), CLIP) - DRIFT
    if bodies.settled[b] < SETTLED:
        total = min(total, 0.0)
    elif not is_whole:
        total = min(total, PARTIAL)
    bodies.evidence[b] = min(max(bodies.evidence[b] + total, 0.0), MOST)
    bodies.evidence_most[b] = max(bodies.evidence_most[b], bodies.evidence[b])


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
    if was_free(views, k, past, time):
        return True
    passes, hits, _ = life.passing_body(views, scans, bodies, b, bodies.birth_x[b], bodies.birth_y[b])
    return passes > 0.5 and hits < 0.2


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
