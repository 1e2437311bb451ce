"""Whether a body that is not seen is still there: gone where beams pass through its place, kept in the shadow."""

from __future__ import annotations

import math

from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import association, memory, tracked
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.views import Views

LEFT_VIEW, PASSED, LOST = tracked.LEFT_VIEW, tracked.FREE, tracked.LOST
AT_FIRST = 0.3
"""How likely it is that something seen once is a thing."""
AT_SIGHT = 0.3
"""Each sighting takes this share of the doubt away."""
SEEN_AT_ALL = 0.9
"""How likely a thing is seen whose place is."""
FEW = 0.3
"""Beams that pass prove nothing where fewer than this share of those at its core do."""
HITS = 0.1
"""How much it speaks against a thing that beams hit its place and yet it was not found."""
DEAD = 0.03
"""A body less likely than this is gone."""
MARGIN = 0.1
"""[m] Beams that end so far behind a body, or more, have passed it."""
PATIENCE_STILL = 30.0
"""[s] A thing that stands is kept so long in the shadow …"""
PATIENCE_MOVING = 6.0
"""… and one that moves."""
ASTRAY = 1.44
"""[m²] A body whose place is less certain than this is lost."""
WITHIN = 8
"""A body that was so often unseen within an older one that was seen is the same thing once more."""
CONFIRMED = tracked.CONFIRMED


def passing(
    views: Views, scans: Scans, x: float, y: float, near: float, beside: float
) -> tuple[float, float, float]:
    """Shares of the beams at the core of a place that pass it, end at it, and are outside of the view.

    Parameters
    ----------
    x, y : its centre in the world [m]
    near, beside : how far it reaches towards the sensor and to the side [m]
    """
    ahead, left = looks.to_sensor(views, x, y)
    r = math.sqrt(ahead * ahead + left * left)
    if views.step < memory.LEAST_STEP or views.bearings < 1:
        return 0.0, 0.0, 1.0
    past = math.atan2(left, ahead) - views.first
    past -= looks.TURN * math.floor(past / looks.TURN)
    middle = past / views.step
    core = 0.5 * math.atan2(beside, max(r, 0.01)) / views.step
    # Half a turn past the first bearing or more before the last: a bearing just before the first is near it.
    if views.period == 0 and past > 0.5 * (looks.TURN + (views.bearings - 1) * views.step):
        middle -= looks.TURN / views.step
    # In C these are floating-point numbers still.
    first, last = int(math.ceil(middle - core)), int(math.floor(middle + core))  # noqa: RUF046
    if last < first:
        first = last = int(math.floor(middle + 0.5))  # noqa: RUF046
    # No header makes more beams of it than there are.
    last = min(last, first + views.bearings)
    margin = MARGIN + 3.5 * views.sigma
    passes, hits, unseen, number = 0.0, 0.0, 0.0, 0.0
    for position in range(first, last + 1):
        number += 1.0
        if views.period == 0 and (position < 0 or position >= views.bearings):
            unseen += 1.0
            continue
        distance = memory.range_at(views, scans, position)
        if distance > r + near + margin:
            passes += 1.0
        elif distance >= r - near - margin:
            hits += 1.0
    return passes / number, hits / number, unseen / number


def passing_body(
    views: Views, scans: Scans, bodies: Bodies, b: int, x: float, y: float
) -> tuple[float, float, float]:
    """The same of a body, as if its centre were at x, y."""
    dx, dy = x - views.x, y - views.y
    r = math.sqrt(dx * dx + dy * dy)
    if r <= 0.0:
        return 0.0, 1.0, 0.0
    dx, dy = dx / r, dy / r
    near, beside = things.half_extent(bodies, b, dx, dy), things.half_extent(bodies, b, -dy, dx)
    return passing(views, scans, x, y, near, beside)


def see(bodies: Bodies, b: int) -> None:
    """A body was seen."""
    bodies.existence[b] += AT_SIGHT * (1.0 - bodies.existence[b])
    bodies.inside[b] = max(bodies.inside[b] - 1, 0)


def miss(bodies: Bodies, b: int, views: Views, scans: Scans, time: float) -> None:
    """A body was not seen: does that speak against it?"""
    x, y = things.centre(bodies, b)
    passes, hits, unseen = passing_body(views, scans, bodies, b, x, y)
    detect = SEEN_AT_ALL * passes if passes > FEW else 0.0
    detect += HITS * hits
    e = bodies.existence[b]
    bodies.existence[b] = e * (1.0 - detect) / (1.0 - e * detect)
    other = around(bodies, b, x, y, 0.0)
    if other >= 0:
        bodies.inside[b] += 1
        bodies.same_as[b] = bodies.number[other]
    if bodies.existence[b] < DEAD:
        finish(bodies, b, PASSED)
    elif bodies.inside[b] >= WITHIN:
        # What it was is the other one: nothing is lost.
        finish(bodies, b, LOST)
    else:
        still = bodies.moved[b] == 0
        patience = PATIENCE_STILL if still else PATIENCE_MOVING
        astray = 0.5 * (bodies.cc[2 * b] + bodies.cc[2 * b + 1]) > ASTRAY and not still
        if time - bodies.seen_at[b] > patience or astray:
            finish(bodies, b, LEFT_VIEW if unseen > 0.5 else LOST)


def around(bodies: Bodies, b: int, x: float, y: float, beside: float) -> int:
    """An older body that is seen now and has the centre x, y of another in it, or so near [m]; -1 for none."""
    for other in range(bodies.high):
        if bodies.state[other] != things.LIVE or bodies.view[other] < 0 or other == b:
            continue
        if bodies.kind[other] == things.PERSON:
            continue
        if bodies.number[other] < bodies.number[b] and association.outside(bodies, other, x, y) < beside:
            return other
    return -1


def finish(bodies: Bodies, b: int, why: int) -> None:
    """End a body; what was seen too seldom to be a track is forgotten at once."""
    bodies.end[b] = why
    bodies.state[b] = things.ENDED if bodies.sightings[b] >= CONFIRMED else things.EMPTY
