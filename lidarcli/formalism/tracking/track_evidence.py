"""Beliefs about a body: that it moves (set A, Def. 4), that it still exists, and which shape it has.

Two witnesses show motion. The first is a sum of log-odds: by how much a moving body explains the sides better than its twin
that stands still. The second is free space: the body is where beams passed before, or beams pass where it was.

A body that is not seen stops existing where beams pass through its place. In the shadow of others it is kept for a while.
"""

from __future__ import annotations

import math

from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import kalman, measurement, results
from lidarcli.formalism.tracking.kalman import EdgeMeasurement, Targets
from lidarcli.formalism.tracking.measurement import Measurements, RangeHistory

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


def update_motion_evidence(targets: Targets, b: int, sides: EdgeMeasurement, is_whole: bool) -> None:
    """Add the evidence of the sides of a view for and against motion, before they update the estimates."""
    total = 0.0
    if sides.by_centre:
        for i in range(2):
            if not sides.is_doubtful:
                total += _motion_odds(targets, 2 * b + i, sides.z[2 * i], 0.0, sides.var[2 * i], sides.lasting_var)
    else:
        for i in range(2):
            total += _axis_odds(targets, 2 * b + i, sides, 2 * i)
    total = min(max(total, -MOST_SWEEP_EVIDENCE), MOST_SWEEP_EVIDENCE) - EVIDENCE_DECAY
    if targets.kind_hits[b] < SETTLED_SIGHTINGS:
        total = min(total, 0.0)
    elif not is_whole:
        total = min(total, MOST_PARTIAL_EVIDENCE)
    targets.evidence[b] = min(max(targets.evidence[b] + total, 0.0), MOST_EVIDENCE)
    targets.max_evidence[b] = max(targets.max_evidence[b], targets.evidence[b])


def _motion_odds(targets: Targets, a: int, z: float, sign: float, var: float, lasting: float) -> float:
    """Return the log-odds by which a moving body explains a measurement of c + sign h better than its twin.

    `lasting`: variance of the place of the twin that all of its sightings share [m²].
    """
    off, s = kalman.residual(targets, a, z, sign, var)
    static_off, static_s = kalman.static_residual(targets, a, z, sign, var)
    static_s += lasting
    return 0.5 * (static_off * static_off / static_s - off * off / s + math.log(static_s / s))


def _axis_odds(targets: Targets, a: int, sides: EdgeMeasurement, low: int) -> float:
    """Return the log-odds for motion of the two sides of an axis.

    Edges that may be those of returns alone count together or not at all: if only one of them moves, more of the body has
    come into view.
    """
    low_var, high_var = sides.var[low], sides.var[low + 1]
    of_low, of_high = 0.0, 0.0
    if low_var >= 0.0:
        of_low = _motion_odds(targets, a, sides.z[low], -1.0, low_var, 0.0)
    if high_var >= 0.0:
        of_high = _motion_odds(targets, a, sides.z[low + 1], 1.0, high_var, 0.0)
    length = sides.z[low + 1] - sides.z[low]
    if low_var >= 0.0 and high_var >= 0.0 and abs(length - 2.0 * targets.static_h[a]) > SAME_LENGTH:
        # For example another piece of the same wall.
        return 0.0
    if low_var < kalman.OPEN_EDGE_VAR and high_var < kalman.OPEN_EDGE_VAR:
        return of_low + of_high
    if low_var < 0.0 or high_var < 0.0:
        # One of them is not seen, and the other alone is not believed.
        return 0.0
    if abs(length - 2.0 * targets.h[a]) > STEADY_LENGTH:
        return 0.0
    low_off, _ = kalman.static_residual(targets, a, sides.z[low], -1.0, low_var)
    high_off, _ = kalman.static_residual(targets, a, sides.z[low + 1], 1.0, high_var)
    return min(of_low, of_high) if low_off * high_off > 0.0 else min(of_low + of_high, 0.0)


def mark_rest(targets: Targets, b: int, sweep: int) -> None:
    """Remember the place and sweep in which a body was last without evidence of motion."""
    if targets.evidence[b] <= 0.0:
        targets.onset[b] = sweep
        targets.birth_x[b], targets.birth_y[b] = kalman.centre(targets, b)


def is_moving(
    targets: Targets,
    b: int,
    measurements: Measurements,
    scans: Scans,
    k: int,
    history: RangeHistory,
    motion_threshold: float,
    time: float,
) -> bool:
    """Return whether both witnesses show that a body moves by itself."""
    if targets.evidence[b] < motion_threshold:
        return False
    x, y = kalman.centre(targets, b)
    dx, dy = x - targets.birth_x[b], y - targets.birth_y[b]
    if dx * dx + dy * dy < LEAST_WAY * LEAST_WAY:
        return False
    passes, hits, _ = passing_target(measurements, scans, targets, b, targets.birth_x[b], targets.birth_y[b])
    size = 2.0 * max(targets.h[2 * b], targets.h[2 * b + 1])
    if hits > 0.5 and dx * dx + dy * dy > (size + FREE_MARGIN) * (size + FREE_MARGIN):
        # Its old place is still occupied: another leg of the same chair was taken for it.
        return False
    if was_occupied(targets, b, measurements, k, history, time):
        return False
    if was_free(measurements, k, history, time):
        return True
    return passes > 0.5 and hits < 0.2


def was_occupied(targets: Targets, b: int, measurements: Measurements, k: int, history: RangeHistory, time: float) -> bool:
    """Return whether the place of a view was occupied before the body got there, as by a wall that seems to slide."""
    first, stop = measurements.begin[k], measurements.begin[k + 1]
    asked = min(stop - first, MOST_POINTS)
    v_x, v_y = targets.v[2 * b], targets.v[2 * b + 1]
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    clear = 2.0 * max(targets.h[2 * b], targets.h[2 * b + 1]) + LEAST_WAY
    times = 0
    for m in range(min(history.count, measurement.SWEEPS_KEPT)):
        age = time - history.time[m]
        if age < measurement.SWEEPS_APART or age > OLDEST_SWEEP or speed * age < clear:
            continue
        hits = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if measurement.was_hit(history, m, measurements.point_x[p], measurements.point_y[p]):
                hits += 1.0
        if hits >= OCCUPIED_SHARE * asked:
            times += 1
    return times >= OCCUPIED_SWEEPS


def was_free(measurements: Measurements, k: int, history: RangeHistory, time: float) -> bool:
    """Return whether the beams of an earlier sweep passed the place of a view."""
    first, stop = measurements.begin[k], measurements.begin[k + 1]
    asked = min(stop - first, MOST_POINTS)
    for m in range(min(history.count, measurement.SWEEPS_KEPT)):
        age = time - history.time[m]
        if age < measurement.SWEEPS_APART or age > OLDEST_SWEEP:
            continue
        free = 0.0
        for i in range(asked):
            p = first + i * (stop - first) // asked
            if measurement.was_passed(history, m, measurements.point_x[p], measurements.point_y[p], FREE_MARGIN):
                free += 1.0
        if asked > 0 and free >= FREE_SHARE * asked:
            return True
    return False


def passing(
    measurements: Measurements, scans: Scans, x: float, y: float, near: float, beside: float
) -> tuple[float, float, float]:
    """Return the shares of the beams at the core of a place that pass it, end at it, and are outside of the view.

    Parameters
    ----------
    x, y : centre of the place in the world [m]
    near, beside : half extents towards the sensor and to the side [m]
    """
    ahead, left = measurement.to_sensor(measurements, x, y)
    r = math.sqrt(ahead * ahead + left * left)
    if measurements.step < measurement.LEAST_STEP or measurements.bearings < 1:
        return 0.0, 0.0, 1.0
    history = math.atan2(left, ahead) - measurements.first
    history -= measurement.TURN * math.floor(history / measurement.TURN)
    middle = history / measurements.step
    core = 0.5 * math.atan2(beside, max(r, 0.01)) / measurements.step
    # A bearing just before the first one counts as before it, not as nearly a turn behind it.
    if measurements.period == 0 and history > 0.5 * (measurement.TURN + (measurements.bearings - 1) * measurements.step):
        middle -= measurement.TURN / measurements.step
    # C needs a conversion to integers here.
    first, last = int(math.ceil(middle - core)), int(math.floor(middle + core))  # noqa: RUF046
    if last < first:
        first = last = int(math.floor(middle + 0.5))  # noqa: RUF046
    # Never more beams than there are, whatever the header of the sweep says.
    last = min(last, first + measurements.bearings)
    margin = PASSING_MARGIN + 3.5 * measurements.sigma
    passes, hits, unseen, number = 0.0, 0.0, 0.0, 0.0
    for position in range(first, last + 1):
        number += 1.0
        if measurements.period == 0 and (position < 0 or position >= measurements.bearings):
            unseen += 1.0
            continue
        distance = measurement.range_at(measurements, scans, position)
        if distance > r + near + margin:
            passes += 1.0
        elif distance >= r - near - margin:
            hits += 1.0
    return passes / number, hits / number, unseen / number


def passing_target(
    measurements: Measurements, scans: Scans, targets: Targets, b: int, x: float, y: float
) -> tuple[float, float, float]:
    """Return the shares of `passing` for a body, as if its centre were at x, y."""
    dx, dy = x - measurements.x, y - measurements.y
    r = math.sqrt(dx * dx + dy * dy)
    if r <= 0.0:
        return 0.0, 1.0, 0.0
    dx, dy = dx / r, dy / r
    near, beside = kalman.half_extent(targets, b, dx, dy), kalman.half_extent(targets, b, -dy, dx)
    return passing(measurements, scans, x, y, near, beside)


def record_hit(targets: Targets, b: int) -> None:
    """Raise the probability that a body exists, which was seen.

    Only where its elder is seen beside it, it is less likely the same: two bodies of one object are seen in turns.
    """
    targets.existence[b] += EXISTENCE_GAIN * (1.0 - targets.existence[b])
    if targets.inside[b] > 0 and not _is_alone(targets, targets.same_as[b]):
        targets.inside[b] -= 1


def _is_alone(targets: Targets, number: int) -> bool:
    """Return whether the body of this number is followed and not seen in this sweep."""
    for other in range(targets.slots_used):
        if targets.number[other] == number and targets.state[other] == kalman.LIVE:
            return targets.measurement[other] < 0
    return False


def record_miss(targets: Targets, b: int, measurements: Measurements, scans: Scans, time: float) -> None:
    """Lower the probability that a body exists, which was not seen, and end it if it is gone or lost."""
    x, y = kalman.centre(targets, b)
    passes, hits, unseen = passing_target(measurements, scans, targets, b, x, y)
    detect = DETECTION_RATE * passes if passes > LEAST_PASSING else 0.0
    detect += HIT_DOUBT * hits
    e = targets.existence[b]
    targets.existence[b] = e * (1.0 - detect) / (1.0 - e * detect)
    other = covering_target(targets, b, x, y, 0.0)
    if other >= 0:
        targets.inside[b] += 1
        if targets.member[b] == 0:
            # A leg stays that of its person.
            targets.same_as[b] = targets.number[other]
    if targets.existence[b] < LEAST_EXISTENCE:
        terminate(targets, b, FREE)
    elif targets.inside[b] >= DUPLICATE_SWEEPS:
        # It is the same as the other body: nothing is lost.
        terminate(targets, b, LOST)
    else:
        still = targets.moved[b] == 0
        patience = PATIENCE_STILL if still else PATIENCE_MOVING
        astray = 0.5 * (targets.cc[2 * b] + targets.cc[2 * b + 1]) > LOST_VAR and not still
        if time - targets.last_time[b] > patience or astray:
            terminate(targets, b, LEFT_VIEW if unseen > 0.5 else LOST)


def covering_target(targets: Targets, b: int, x: float, y: float, beside: float) -> int:
    """Return an older body that is seen now and covers the centre x, y of another, within a margin [m]; -1 for none."""
    for other in range(targets.slots_used):
        if targets.state[other] != kalman.LIVE or targets.measurement[other] < 0 or other == b:
            continue
        if targets.kind[other] == kalman.PERSON:
            continue
        if targets.number[other] < targets.number[b] and kalman.outside(targets, other, x, y) < beside:
            return other
    return -1


def terminate(targets: Targets, b: int, why: int) -> None:
    """End a body; one that was seen too seldom for a track is forgotten at once."""
    targets.end[b] = why
    targets.state[b] = kalman.ENDED if targets.sightings[b] >= CONFIRMED_SIGHTINGS else kalman.EMPTY


def vote_shape(targets: Targets, b: int, measurements: Measurements, k: int) -> None:
    """Add the vote of a view on the shape of a body."""
    targets.shape_votes[5 * b + measurements.shape[k]] += min(measurements.size[k] * BEAM_VOTE, 1.0)
    if measurements.shape[k] != PRISMATIC:
        return
    for f in range(measurements.face_begin[k], measurements.face_begin[k + 1]):
        if measurements.face_points[f] > 4 and measurements.sigma > 0.0:
            targets.bulge[b] += measurements.bulge[f] / (measurements.sigma * measurements.sigma)
            targets.bulge_points[b] += measurements.face_points[f] - 2


def detect_legs(targets: Targets, b: int, measurements: Measurements, k: int, scans: Scans) -> None:
    """Remember legs around a slim body that stands, which have too few beams to be objects."""
    if (
        targets.moved[b] != 0
        or measurements.length[k] > SLIM_LEG_WIDTH
        or measurements.step < measurement.LEAST_STEP
        or measurements.near[k] <= LEGS_FARTHEST
    ):
        return
    ahead, left = measurement.to_sensor(measurements, measurements.middle_x[k], measurements.middle_y[k])
    history = math.atan2(left, ahead) - measurements.first
    history -= measurement.TURN * math.floor(history / measurement.TURN)
    wide = math.asin(LEGS_FARTHEST / measurements.near[k])
    first, last = int((history - wide) / measurements.step), int((history + wide) / measurements.step)
    last = min(last, first + measurements.bearings)
    run = 0
    measurement.place_sensor(measurements, measurements.share[k])
    before = measurement.range_at(measurements, scans, first - 1)
    for position in range(first, last + 1):
        here, after = (
            measurement.range_at(measurements, scans, position),
            measurement.range_at(measurements, scans, position + 1),
        )
        run = run + 1 if run > 0 and abs(here - before) < SAME_LEG else (1 if before > here + SPECK_DEPTH else 0)
        if 0 < run <= SPECK_BEAMS and here > 0.0 and after > here + SPECK_DEPTH:
            theta = measurements.first + measurements.step * position
            x, y = measurement.to_world(measurements, here * math.cos(theta), here * math.sin(theta))
            dx, dy = x - measurements.middle_x[k], y - measurements.middle_y[k]
            apart = dx * dx + dy * dy
            if LEGS_NEAREST * LEGS_NEAREST < apart < LEGS_FARTHEST * LEGS_FARTHEST:
                _record_leg(targets, b, x, y)
        before = here
    measurement.place_sensor(measurements, 0.0)


def _record_leg(targets: Targets, b: int, x: float, y: float) -> None:
    """Add a sighting to the mean place of a leg."""
    for i in range(kalman.MOST_LEGS * b, kalman.MOST_LEGS * b + kalman.MOST_LEGS):
        hits = targets.leg_hits[i]
        dx, dy = x - targets.leg_x[i], y - targets.leg_y[i]
        if hits == 0 or dx * dx + dy * dy < SAME_LEG * SAME_LEG:
            targets.leg_x[i] += dx / (hits + 1)
            targets.leg_y[i] += dy / (hits + 1)
            targets.leg_hits[i] += 1
            return
