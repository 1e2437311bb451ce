"""Beliefs about a body: that it moves (set A, Def. 4), that it still exists, and which shape it has.

Two witnesses show motion. The first is a sum of log-odds: by how much a moving body explains the sides better than its twin
that stands still. The second is free space: the body is where beams passed before, or beams pass where it was.

A body that is not seen stops existing where beams pass through its place. In the shadow of others it is kept for a while.
"""

from __future__ import annotations

import math

from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import estimation, observation, results
from lidarcli.formalism.tracking.estimation import Bodies, Sides
from lidarcli.formalism.tracking.observation import Memory, Views

PRISMATIC = detection.PRISMATIC
LEFT_VIEW, FREE, LOST = results.LEFT_VIEW, results.FREE, results.LOST
CONFIRMED_SIGHTINGS, LEAST_WAY = results.CONFIRMED_SIGHTINGS, results.LEAST_WAY
STEADY_LENGTH = 0.06
"""[m] A body whose length seems to change by more than this is not seen as it is."""
SAME_LENGTH = 0.2
"""[m] A view whose length differs by more than this shows another piece, of a wall for example."""
MOST_SWEEP_EVIDENCE = 3.0
"""[log-odds] Greatest evidence of one sweep, for or against motion."""
EVIDENCE_DECAY = 0.05
"""[log-odds] Evidence that is lost in every sweep."""
MOST_PARTIAL_EVIDENCE = 2.0
"""[log-odds] Greatest evidence for motion of a view with a hidden edge."""
SETTLED_SIGHTINGS = 2
"""Sightings of the same kind after which a body gathers evidence."""
MOST_EVIDENCE = 60.0
"""[log-odds] Greatest evidence that is kept."""
FREE_SHARE = 0.3
"""Least share of the points of a moving body that lie in space that was free."""
OCCUPIED_SHARE = 0.5
"""Share of its points above which an earlier sweep shows that something stood there already."""
OCCUPIED_SWEEPS = 2
"""Number of such sweeps that refute motion. One alone may show somebody who passed by."""
FREE_MARGIN = 0.1
"""[m] Least distance by which beams end behind a point that they have passed."""
OLDEST_SWEEP = 4.8
"""[s] Older sweeps tell nothing about free space."""
MOST_POINTS = 16
"""Greatest number of points of a view that are compared with earlier sweeps."""
EXISTENCE_AT_FIRST = 0.3
"""Probability that a new body exists."""
EXISTENCE_GAIN = 0.3
"""Share of the doubt that each sighting takes away."""
DETECTION_RATE = 0.9
"""Probability that a body is seen where its place is in view."""
LEAST_PASSING = 0.3
"""Share of the beams at the core of a body that have to pass before they speak against it."""
HIT_DOUBT = 0.1
"""Probability that a body was missed although beams hit its place."""
LEAST_EXISTENCE = 0.03
"""Probability below which a body ends."""
PASSING_MARGIN = 0.1
"""[m] Least distance by which beams end behind a body that they have passed."""
PATIENCE_STILL = 30.0
"""[s] Longest time in the shadow of a body that stands."""
PATIENCE_MOVING = 6.0
"""[s] Longest time in the shadow of a body that moves."""
LOST_VAR = 1.44
"""[m²] Variance of its place above which a moving body is lost: (1.2 m)²."""
DUPLICATE_SWEEPS = 8
"""Sweeps unseen inside an older body that is seen after which both are the same."""
BEAM_VOTE = 0.05
"""Weight of each beam of a view in the vote on its shape; a view has at most one vote."""
SLIM_LEG_WIDTH = 0.15
"""[m] Greatest width of a leg of furniture."""
LEGS_FARTHEST = 0.75
"""[m] Greatest distance between two legs of one thing."""
LEGS_NEAREST = 0.1
"""[m] Least distance between two legs of one thing."""
SPECK_BEAMS = 2
"""Greatest number of beams of a leg that is too slim to be an object."""
SPECK_DEPTH = 0.25
"""[m] Least distance by which such a leg is nearer than its neighbours."""
SAME_LEG = 0.08
"""[m] Greatest distance between two sightings of the same leg."""


def weigh_motion(bodies: Bodies, b: int, sides: Sides, is_whole: bool) -> None:
    """Add the evidence of the sides of a view for and against motion, before they update the estimates."""
    total = 0.0
    if sides.by_centre:
        for i in range(2):
            if not sides.is_doubtful:
                total += _motion_odds(bodies, 2 * b + i, sides.z[2 * i], 0.0, sides.var[2 * i], sides.lasting_var)
    else:
        for i in range(2):
            total += _axis_odds(bodies, 2 * b + i, sides, 2 * i)
    total = min(max(total, -MOST_SWEEP_EVIDENCE), MOST_SWEEP_EVIDENCE) - EVIDENCE_DECAY
    if bodies.settled[b] < SETTLED_SIGHTINGS:
        total = min(total, 0.0)
    elif not is_whole:
        total = min(total, MOST_PARTIAL_EVIDENCE)
    bodies.evidence[b] = min(max(bodies.evidence[b] + total, 0.0), MOST_EVIDENCE)
    bodies.evidence_most[b] = max(bodies.evidence_most[b], bodies.evidence[b])


def _motion_odds(bodies: Bodies, a: int, z: float, sign: float, var: float, lasting: float) -> float:
    """Return the log-odds by which a moving body explains a measurement of c + sign h better than its twin.

    `lasting`: variance of the place of the twin that all of its sightings share [m²].
    """
    off, s = estimation.residual(bodies, a, z, sign, var)
    still_off, still_s = estimation.still_residual(bodies, a, z, sign, var)
    still_s += lasting
    return 0.5 * (still_off * still_off / still_s - off * off / s + math.log(still_s / s))


def _axis_odds(bodies: Bodies, a: int, sides: Sides, low: int) -> float:
    """Return the log-odds for motion of the two sides of an axis.

    Edges that may be those of returns alone count together or not at all: if only one of them moves, more of the body has
    come into view.
    """
    low_var, high_var = sides.var[low], sides.var[low + 1]
    of_low, of_high = 0.0, 0.0
    if low_var >= 0.0:
        of_low = _motion_odds(bodies, a, sides.z[low], -1.0, low_var, 0.0)
    if high_var >= 0.0:
        of_high = _motion_odds(bodies, a, sides.z[low + 1], 1.0, high_var, 0.0)
    length = sides.z[low + 1] - sides.z[low]
    if low_var >= 0.0 and high_var >= 0.0 and abs(length - 2.0 * bodies.still_h[a]) > SAME_LENGTH:
        # For example another piece of the same wall.
        return 0.0
    if low_var < estimation.OPEN_EDGE_VAR and high_var < estimation.OPEN_EDGE_VAR:
        return of_low + of_high
    if low_var < 0.0 or high_var < 0.0:
        # One of them is not seen, and the other alone is not believed.
        return 0.0
    if abs(length - 2.0 * bodies.h[a]) > STEADY_LENGTH:
        return 0.0
    low_off, _ = estimation.still_residual(bodies, a, sides.z[low], -1.0, low_var)
    high_off, _ = estimation.still_residual(bodies, a, sides.z[low + 1], 1.0, high_var)
    return min(of_low, of_high) if low_off * high_off > 0.0 else min(of_low + of_high, 0.0)


def note_rest(bodies: Bodies, b: int, sweep: int) -> None:
    """Remember the place and sweep in which a body was last without evidence of motion."""
    if bodies.evidence[b] <= 0.0:
        bodies.onset[b] = sweep
        bodies.birth_x[b], bodies.birth_y[b] = estimation.centre(bodies, b)


def is_moving(bodies: Bodies, b: int, views: Views, scans: Scans, k: int, past: Memory, alarm: float, time: float) -> bool:
    """Return whether both witnesses show that a body moves by itself."""
    if bodies.evidence[b] < alarm:
        return False
    x, y = estimation.centre(bodies, b)
    dx, dy = x - bodies.birth_x[b], y - bodies.birth_y[b]
    if dx * dx + dy * dy < LEAST_WAY * LEAST_WAY:
        return False
    passes, hits, _ = passing_body(views, scans, bodies, b, bodies.birth_x[b], bodies.birth_y[b])
    size = 2.0 * max(bodies.h[2 * b], bodies.h[2 * b + 1])
    if hits > 0.5 and dx * dx + dy * dy > (size + FREE_MARGIN) * (size + FREE_MARGIN):
        # Its old place is still occupied: another leg of the same chair was taken for it.
        return False
    if was_occupied(bodies, b, views, k, past, time):
        return False
    if was_free(views, k, past, time):
        return True
    return passes > 0.5 and hits < 0.2


def was_occupied(bodies: Bodies, b: int, views: Views, k: int, past: Memory, time: float) -> bool:
    """Return whether the place of a view was occupied before the body got there, as by a wall that seems to slide."""
    first, stop = views.begin[k], views.begin[k + 1]
    asked = min(stop - first, MOST_POINTS)
    v_x, v_y = bodies.v[2 * b], bodies.v[2 * b + 1]
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    clear = 2.0 * max(bodies.h[2 * b], bodies.h[2 * b + 1]) + LEAST_WAY
    times = 0
    for m in range(min(past.count, observation.SWEEPS_KEPT)):
        age = time - past.time[m]
        if age < observation.SWEEPS_APART or age > OLDEST_SWEEP or speed * age < clear:
            continue
        hits = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if observation.was_hit(past, m, views.point_x[p], views.point_y[p]):
                hits += 1.0
        if hits >= OCCUPIED_SHARE * asked:
            times += 1
    return times >= OCCUPIED_SWEEPS


def was_free(views: Views, k: int, past: Memory, time: float) -> bool:
    """Return whether the beams of an earlier sweep passed the place of a view."""
    first, stop = views.begin[k], views.begin[k + 1]
    asked = min(stop - first, MOST_POINTS)
    for m in range(min(past.count, observation.SWEEPS_KEPT)):
        age = time - past.time[m]
        if age < observation.SWEEPS_APART or age > OLDEST_SWEEP:
            continue
        free = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if observation.was_passed(past, m, views.point_x[p], views.point_y[p], FREE_MARGIN):
                free += 1.0
        if asked > 0 and free >= FREE_SHARE * asked:
            return True
    return False


def passing(views: Views, scans: Scans, x: float, y: float, near: float, beside: float) -> tuple[float, float, float]:
    """Return the shares of the beams at the core of a place that pass it, end at it, and are outside of the view.

    Parameters
    ----------
    x, y : centre of the place in the world [m]
    near, beside : half extents towards the sensor and to the side [m]
    """
    ahead, left = observation.to_sensor(views, x, y)
    r = math.sqrt(ahead * ahead + left * left)
    if views.step < observation.LEAST_STEP or views.bearings < 1:
        return 0.0, 0.0, 1.0
    past = math.atan2(left, ahead) - views.first
    past -= observation.TURN * math.floor(past / observation.TURN)
    middle = past / views.step
    core = 0.5 * math.atan2(beside, max(r, 0.01)) / views.step
    # A bearing just before the first one counts as before it, not as nearly a turn behind it.
    if views.period == 0 and past > 0.5 * (observation.TURN + (views.bearings - 1) * views.step):
        middle -= observation.TURN / views.step
    # C needs a conversion to integers here.
    first, last = int(math.ceil(middle - core)), int(math.floor(middle + core))  # noqa: RUF046
    if last < first:
        first = last = int(math.floor(middle + 0.5))  # noqa: RUF046
    # Never more beams than there are, whatever the header of the sweep says.
    last = min(last, first + views.bearings)
    margin = PASSING_MARGIN + 3.5 * views.sigma
    passes, hits, unseen, number = 0.0, 0.0, 0.0, 0.0
    for position in range(first, last + 1):
        number += 1.0
        if views.period == 0 and (position < 0 or position >= views.bearings):
            unseen += 1.0
            continue
        distance = observation.range_at(views, scans, position)
        if distance > r + near + margin:
            passes += 1.0
        elif distance >= r - near - margin:
            hits += 1.0
    return passes / number, hits / number, unseen / number


def passing_body(views: Views, scans: Scans, bodies: Bodies, b: int, x: float, y: float) -> tuple[float, float, float]:
    """Return the shares of `passing` for a body, as if its centre were at x, y."""
    dx, dy = x - views.x, y - views.y
    r = math.sqrt(dx * dx + dy * dy)
    if r <= 0.0:
        return 0.0, 1.0, 0.0
    dx, dy = dx / r, dy / r
    near, beside = estimation.half_extent(bodies, b, dx, dy), estimation.half_extent(bodies, b, -dy, dx)
    return passing(views, scans, x, y, near, beside)


def note_seen(bodies: Bodies, b: int) -> None:
    """Raise the probability that a body exists, which was seen.

    Only where its elder is seen beside it, it is less likely the same: two bodies of one object are seen in turns.
    """
    bodies.existence[b] += EXISTENCE_GAIN * (1.0 - bodies.existence[b])
    if bodies.inside[b] > 0 and not _is_alone(bodies, bodies.same_as[b]):
        bodies.inside[b] -= 1


def _is_alone(bodies: Bodies, number: int) -> bool:
    """Return whether the body of this number is followed and not seen in this sweep."""
    for other in range(bodies.high):
        if bodies.number[other] == number and bodies.state[other] == estimation.LIVE:
            return bodies.view[other] < 0
    return False


def note_missed(bodies: Bodies, b: int, views: Views, scans: Scans, time: float) -> None:
    """Lower the probability that a body exists, which was not seen, and end it if it is gone or lost."""
    x, y = estimation.centre(bodies, b)
    passes, hits, unseen = passing_body(views, scans, bodies, b, x, y)
    detect = DETECTION_RATE * passes if passes > LEAST_PASSING else 0.0
    detect += HIT_DOUBT * hits
    e = bodies.existence[b]
    bodies.existence[b] = e * (1.0 - detect) / (1.0 - e * detect)
    other = covering_body(bodies, b, x, y, 0.0)
    if other >= 0:
        bodies.inside[b] += 1
        if bodies.member[b] == 0:
            # A leg stays that of its person.
            bodies.same_as[b] = bodies.number[other]
    if bodies.existence[b] < LEAST_EXISTENCE:
        finish(bodies, b, FREE)
    elif bodies.inside[b] >= DUPLICATE_SWEEPS:
        # It is the same as the other body: nothing is lost.
        finish(bodies, b, LOST)
    else:
        still = bodies.moved[b] == 0
        patience = PATIENCE_STILL if still else PATIENCE_MOVING
        astray = 0.5 * (bodies.cc[2 * b] + bodies.cc[2 * b + 1]) > LOST_VAR and not still
        if time - bodies.seen_at[b] > patience or astray:
            finish(bodies, b, LEFT_VIEW if unseen > 0.5 else LOST)


def covering_body(bodies: Bodies, b: int, x: float, y: float, beside: float) -> int:
    """Return an older body that is seen now and covers the centre x, y of another, within a margin [m]; -1 for none."""
    for other in range(bodies.high):
        if bodies.state[other] != estimation.LIVE or bodies.view[other] < 0 or other == b:
            continue
        if bodies.kind[other] == estimation.PERSON:
            continue
        if bodies.number[other] < bodies.number[b] and estimation.outside(bodies, other, x, y) < beside:
            return other
    return -1


def finish(bodies: Bodies, b: int, why: int) -> None:
    """End a body; one that was seen too seldom for a track is forgotten at once."""
    bodies.end[b] = why
    bodies.state[b] = estimation.ENDED if bodies.sightings[b] >= CONFIRMED_SIGHTINGS else estimation.EMPTY


def note_shape(bodies: Bodies, b: int, views: Views, k: int) -> None:
    """Add the vote of a view on the shape of a body."""
    bodies.shape_votes[5 * b + views.shape[k]] += min(views.size[k] * BEAM_VOTE, 1.0)
    if views.shape[k] != PRISMATIC:
        return
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_points[f] > 4 and views.sigma > 0.0:
            bodies.bulge[b] += views.bulge[f] / (views.sigma * views.sigma)
            bodies.bulge_points[b] += views.face_points[f] - 2


def note_legs(bodies: Bodies, b: int, views: Views, k: int, scans: Scans) -> None:
    """Remember legs around a slim body that stands, which have too few beams to be objects."""
    if (
        bodies.moved[b] != 0
        or views.length[k] > SLIM_LEG_WIDTH
        or views.step < observation.LEAST_STEP
        or views.near[k] <= LEGS_FARTHEST
    ):
        return
    ahead, left = observation.to_sensor(views, views.middle_x[k], views.middle_y[k])
    past = math.atan2(left, ahead) - views.first
    past -= observation.TURN * math.floor(past / observation.TURN)
    wide = math.asin(LEGS_FARTHEST / views.near[k])
    first, last = int((past - wide) / views.step), int((past + wide) / views.step)
    last = min(last, first + views.bearings)
    run = 0
    observation.place_sensor(views, views.share[k])
    before = observation.range_at(views, scans, first - 1)
    for position in range(first, last + 1):
        here, after = (observation.range_at(views, scans, position), observation.range_at(views, scans, position + 1))
        run = run + 1 if run > 0 and abs(here - before) < SAME_LEG else (1 if before > here + SPECK_DEPTH else 0)
        if 0 < run <= SPECK_BEAMS and here > 0.0 and after > here + SPECK_DEPTH:
            theta = views.first + views.step * position
            x, y = observation.to_world(views, here * math.cos(theta), here * math.sin(theta))
            dx, dy = x - views.middle_x[k], y - views.middle_y[k]
            apart = dx * dx + dy * dy
            if LEGS_NEAREST * LEGS_NEAREST < apart < LEGS_FARTHEST * LEGS_FARTHEST:
                _note_leg(bodies, b, x, y)
        before = here
    observation.place_sensor(views, 0.0)


def _note_leg(bodies: Bodies, b: int, x: float, y: float) -> None:
    """Add a sighting to the mean place of a leg."""
    for i in range(estimation.MOST_LEGS * b, estimation.MOST_LEGS * b + estimation.MOST_LEGS):
        seen = bodies.leg_seen[i]
        dx, dy = x - bodies.leg_x[i], y - bodies.leg_y[i]
        if seen == 0 or dx * dx + dy * dy < SAME_LEG * SAME_LEG:
            bodies.leg_x[i] += dx / (seen + 1)
            bodies.leg_y[i] += dy / (seen + 1)
            bodies.leg_seen[i] += 1
            return
