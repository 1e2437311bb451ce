"""Evidence on a target: that it moves (set A, Def. 4), that it exists, and which shape it has.

Two tests show motion. The first is a CUSUM of log-odds: how much better a moving target explains the sides than its
static model. The second is free space: the target is where beams passed before, or beams pass where it was.

The existence of a target that is missed falls where beams pass through its place. In the shadow of others it is kept for
a while.
"""

from __future__ import annotations

import math

from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import kalman, keyframes, measurement, results
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import EdgeMeasurement, Measurements

PRISMATIC = detection.PRISMATIC
LEFT_VIEW, FREE, LOST = results.LEFT_VIEW, results.FREE, results.LOST
CONFIRMED_SIGHTINGS, MIN_WAY, SHORTEST_STAND = results.CONFIRMED_SIGHTINGS, results.MIN_WAY, results.SHORTEST_STAND
STEADY_LENGTH, SAME_LENGTH = 0.06, 0.2
"""[m] A target whose length seems to change by more than the first is not observed as it is; by more than the second it is
another piece, of a wall for example."""
MAX_SWEEP_EVIDENCE, MAX_PARTIAL_EVIDENCE = 3.0, 2.0
"""[log-odds] Greatest evidence of one sweep, for or against motion, and of one with a hidden edge, for motion."""
EVIDENCE_DECAY, MIN_EVIDENCE, MAX_EVIDENCE = 0.05, 11.5, 60.0
"""[log-odds] Evidence of motion that is lost in every sweep, least evidence of a target that seems to move, and greatest
evidence that is kept."""
SETTLED_SIGHTINGS = 2
"""Sightings of the same kind after which a target gathers evidence."""
MIN_LOOKS = 1.0
"""Least weight of looks at a place before, which then decide whether a target got there."""
FREE_MARGIN = 0.1
"""[m] Least distance by which beams end behind a point that they have passed."""
EXISTENCE_AT_FIRST, EXISTENCE_GAIN = 0.3, 0.3
"""Probability that a new target exists, and the share of the doubt that each sighting takes away."""
DETECTION_RATE, MIN_PASSING, HIT_DOUBT, MIN_EXISTENCE = 0.9, 0.3, 0.1, 0.03
"""Probability that a target is visible where its place is in view; share of the beams at its core that have to pass before
they speak against it; probability that it was missed although beams hit its place; probability below which it ends."""
PASSING_MARGIN = 0.1
"""[m] Least distance by which beams end behind a target that they have passed."""
PATIENCE_OUTSIDE, PATIENCE_STILL = 0.3, 30.0
"""[s] Longest time unobserved of a person out of view, and in the shadow of a target that was static for so long before;
one that moves is lost by `LOST_VAR` after 2 s."""
MOSTLY_OUTSIDE, REACH = 0.5, 0.9
"""Share of its beams out of view above which a target that is lost has left the view; share of the greatest range so far
from which on a beam without a return is out of view."""
LOST_VAR = 1.44
"""[m²] Variance of its place above which a moving target is lost: (1.2 m)²."""
DUPLICATE_SWEEPS = 8
"""Sweeps unobserved inside an older target that is visible after which both are the same."""
BEAM_VOTE = 0.05
"""Weight of each beam of a measurement in the vote on its shape; a measurement has at most one vote."""
SLIM_LEG_WIDTH = 0.15
"""[m] Greatest width of a leg of furniture."""
LEGS_NEAREST, LEGS_FARTHEST = 0.1, 0.75
"""[m] Least and greatest distance between two legs of one object."""
SPECK_BEAMS, SPECK_DEPTH = 2, 0.25
"""A leg that is too slim to be an object has so few beams, and is so much nearer than its neighbours [m]."""
SAME_LEG = 0.08
"""[m] Greatest distance between two sightings of the same leg."""


def update_motion_evidence(targets: Targets, b: int, sides: EdgeMeasurement, is_whole: bool) -> None:
    """Add the evidence of the sides of a measurement for and against motion, before they update the estimates."""
    total = 0.0
    if sides.by_centre:
        for i in range(2):
            if not sides.is_doubtful:
                total += _motion_odds(targets, 2 * b + i, sides.z[2 * i], 0.0, sides.var[2 * i], sides.lasting_var)
    else:
        for i in range(2):
            total += _axis_odds(targets, 2 * b + i, sides, 2 * i)
    total = min(max(total, -MAX_SWEEP_EVIDENCE), MAX_SWEEP_EVIDENCE) - EVIDENCE_DECAY
    if targets.kind_hits[b] < SETTLED_SIGHTINGS:
        total = min(total, 0.0)
    elif not is_whole:
        total = min(total, MAX_PARTIAL_EVIDENCE)
    targets.evidence[b] = min(max(targets.evidence[b] + total, 0.0), MAX_EVIDENCE)
    targets.max_evidence[b] = max(targets.max_evidence[b], targets.evidence[b])


def _motion_odds(targets: Targets, a: int, z: float, sign: float, var: float, lasting: float) -> float:
    """Return the log-odds by which a moving target explains a measurement of c + sign h better than its static model."""
    off, s = kalman.residual(targets, a, z, sign, var)
    static_off, static_s = kalman.static_residual(targets, a, z, sign, var)
    static_s += lasting
    return 0.5 * (static_off * static_off / static_s - off * off / s + math.log(static_s / s))


def _axis_odds(targets: Targets, a: int, sides: EdgeMeasurement, low: int) -> float:
    """Return the log-odds for motion of the two sides of an axis."""
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
    if low_var < measurement.OPEN_EDGE_VAR and high_var < measurement.OPEN_EDGE_VAR:
        return of_low + of_high
    if low_var < 0.0 or high_var < 0.0:
        # One of them is not measured, and the other alone does not count.
        return 0.0
    if abs(length - 2.0 * targets.h[a]) > STEADY_LENGTH:
        return 0.0
    low_off, _ = kalman.static_residual(targets, a, sides.z[low], -1.0, low_var)
    high_off, _ = kalman.static_residual(targets, a, sides.z[low + 1], 1.0, high_var)
    return min(of_low, of_high) if low_off * high_off > 0.0 else min(of_low + of_high, 0.0)


def mark_rest(targets: Targets, b: int, sweep: int) -> None:
    """Store the place and sweep in which a target was last without evidence of motion."""
    if targets.evidence[b] <= 0.0:
        targets.onset[b] = sweep
        targets.birth_x[b], targets.birth_y[b] = kalman.centre(targets, b)


def has_left(targets: Targets, b: int, meas: Measurements, scans: Scans, k: int, frames: Keyframes) -> bool:
    """Return whether free space shows that a target left the place where it had no evidence of motion last."""
    x, y = kalman.centre(targets, b)
    dx, dy = x - targets.birth_x[b], y - targets.birth_y[b]
    away = math.sqrt(dx * dx + dy * dy)
    if away < MIN_WAY:
        return False
    size = 2.0 * max(targets.h[2 * b], targets.h[2 * b + 1])
    passes, hits, _ = passing(meas, scans, targets, b, targets.birth_x[b], targets.birth_y[b])
    if hits > 0.5 and away > size + FREE_MARGIN:
        # Its old place is still occupied: another object was taken for it.
        return False
    v_x, v_y = targets.v[2 * b], targets.v[2 * b + 1]
    speed = math.sqrt(v_x * v_x + v_y * v_y)
    # Before, it was not yet there.
    until = meas.time - (size + MIN_WAY) / max(speed, 1e-3)
    free, hit = keyframes.looks_at_measurement(frames, meas, k, until)
    if free + hit < MIN_LOOKS:
        return passes > 0.5 and hits < 0.2
    return free > hit


def passing(meas: Measurements, scans: Scans, targets: Targets, b: int, x: float, y: float) -> tuple[float, float, float]:
    """Return the shares of the beams at the core of a target at x, y that pass it, end at it, and are outside of the view.

    Beams without a return are outside, too, where the target is as far away as the sensor ever observed something; in a
    sweep without a geometry all of them are."""
    dx, dy = x - meas.x, y - meas.y
    r = math.sqrt(dx * dx + dy * dy)
    if r <= 0.0:
        return 0.0, 1.0, 0.0
    dx, dy = dx / r, dy / r
    half_depth, half_width = kalman.half_extent(targets, b, dx, dy), kalman.half_extent(targets, b, -dy, dx)
    ahead, left = measurement.to_sensor(meas, x, y)
    r = math.sqrt(ahead * ahead + left * left)
    if meas.step < measurement.MIN_STEP or meas.bearings < 1:
        return 0.0, 0.0, 1.0
    angle = measurement.angle_past_first(meas, ahead, left)
    middle = angle / meas.step
    core = 0.5 * math.atan2(half_width, max(r, 0.01)) / meas.step
    # A bearing just before the first one counts as before it, not as nearly a turn behind it.
    if meas.period == 0 and angle > 0.5 * (measurement.TURN + (meas.bearings - 1) * meas.step):
        middle -= measurement.TURN / meas.step
    # C needs a conversion to integers here.
    first, last = int(math.ceil(middle - core)), int(math.floor(middle + core))  # noqa: RUF046
    if last < first:
        first = last = int(math.floor(middle + 0.5))  # noqa: RUF046
    # Never more beams than there are, whatever the header of the sweep says.
    last = min(last, first + meas.bearings)
    margin = PASSING_MARGIN + 3.5 * meas.sigma
    passes, hits, outside, number = 0.0, 0.0, 0.0, 0.0
    for position in range(first, last + 1):
        number += 1.0
        if meas.period == 0 and (position < 0 or position >= meas.bearings):
            outside += 1.0
            continue
        distance = measurement.range_at(meas, scans, position)
        if distance > r + half_depth + margin:
            passes += 1.0
            if distance > measurement.MAX_RANGE and r > REACH * meas.farthest:
                outside += 1.0
        elif distance >= r - half_depth - margin:
            hits += 1.0
    return passes / number, hits / number, outside / number


def record_hit(targets: Targets, b: int) -> None:
    """Raise the existence of a target that was measured.

    An elder that is missed in this sweep may still be the same object: two targets of one object are hit in turns.
    """
    targets.existence[b] += EXISTENCE_GAIN * (1.0 - targets.existence[b])
    if targets.inside[b] == 0:
        return
    for other in range(targets.slots_used):
        is_elder = targets.number[other] == targets.same_as[b] and targets.state[other] == kalman.LIVE
        if is_elder and targets.measurement[other] < 0:
            return
    targets.inside[b] -= 1


def record_miss(targets: Targets, b: int, meas: Measurements, scans: Scans) -> None:
    """Lower the existence of a target that was missed, and terminate it if it is gone or lost."""
    x, y = kalman.centre(targets, b)
    passes, hits, outside = passing(meas, scans, targets, b, x, y)
    detect = 0.0
    if kalman.has_seen(targets, b, meas.sensor):
        detect = DETECTION_RATE * passes if passes > MIN_PASSING else 0.0
        detect += HIT_DOUBT * hits
    e = targets.existence[b]
    targets.existence[b] = e * (1.0 - detect) / (1.0 - e * detect)
    other = covering_target(targets, b, x, y, 0.0)
    if other >= 0:
        targets.inside[b] += 1
        if targets.member[b] == 0:
            # A leg stays that of its person.
            targets.same_as[b] = targets.number[other]
    if targets.existence[b] < MIN_EXISTENCE:
        terminate(targets, b, LEFT_VIEW if outside > MOSTLY_OUTSIDE else FREE)
    elif targets.inside[b] >= DUPLICATE_SWEEPS:
        # It is the same as the other target: nothing is lost.
        terminate(targets, b, LOST)
    else:
        if stands(targets, b):
            stood = targets.last_time[b] - targets.first_time[b]
            lost = meas.time - targets.last_time[b] > min(max(stood, SHORTEST_STAND), PATIENCE_STILL)
        elif targets.kind[b] == kalman.PERSON and outside > MOSTLY_OUTSIDE:
            # Who comes in there next looks the same.
            lost = meas.time - targets.last_time[b] > PATIENCE_OUTSIDE
        else:
            lost = 0.5 * (targets.cc[2 * b] + targets.cc[2 * b + 1]) > LOST_VAR
        if lost:
            terminate(targets, b, LEFT_VIEW if outside > MOSTLY_OUTSIDE else LOST)


def stands(targets: Targets, b: int) -> bool:
    """Return whether a target that is missed is still at its place: it never moved, and is no leg of a person."""
    return targets.moved[b] == 0 and targets.member[b] == 0


def covering_target(targets: Targets, b: int, x: float, y: float, margin: float) -> int:
    """Return an older target that is measured now and covers the centre x, y of another, within a margin [m], else -1."""
    for other in range(targets.slots_used):
        if targets.state[other] != kalman.LIVE or targets.measurement[other] < 0 or other == b:
            continue
        if targets.kind[other] == kalman.PERSON:
            continue
        if targets.number[other] < targets.number[b] and kalman.outside(targets, other, x, y) < margin:
            return other
    return -1


def terminate(targets: Targets, b: int, why: int) -> None:
    """Terminate a target; one with too few sightings for a track is dropped at once."""
    targets.end[b] = why
    targets.state[b] = kalman.ENDED if targets.sightings[b] >= CONFIRMED_SIGHTINGS else kalman.EMPTY


def vote_shape(targets: Targets, b: int, meas: Measurements, k: int) -> None:
    """Add the vote of a measurement on the shape of a target."""
    targets.shape_votes[5 * b + meas.shape[k]] += min(meas.size[k] * BEAM_VOTE, 1.0)
    if meas.shape[k] != PRISMATIC:
        return
    for f in range(meas.face_begin[k], meas.face_begin[k + 1]):
        if meas.face_points[f] > 4 and meas.sigma > 0.0:
            targets.bulge[b] += meas.bulge[f] / (meas.sigma * meas.sigma)
            targets.bulge_points[b] += meas.face_points[f] - 2


def detect_legs(targets: Targets, b: int, meas: Measurements, k: int, scans: Scans) -> None:
    """Detect legs around a slim static target, which have too few beams to be objects."""
    if (
        targets.moved[b] != 0
        or meas.length[k] > SLIM_LEG_WIDTH
        or meas.step < measurement.MIN_STEP
        or meas.near[k] <= LEGS_FARTHEST
    ):
        return
    ahead, left = measurement.to_sensor(meas, meas.middle_x[k], meas.middle_y[k])
    angle = measurement.angle_past_first(meas, ahead, left)
    wide = math.asin(LEGS_FARTHEST / meas.near[k])
    first, last = int((angle - wide) / meas.step), int((angle + wide) / meas.step)
    last = min(last, first + meas.bearings)
    run = 0
    measurement.place_sensor(meas, meas.share[k])
    before = measurement.range_at(meas, scans, first - 1)
    for position in range(first, last + 1):
        here, after = (measurement.range_at(meas, scans, position), measurement.range_at(meas, scans, position + 1))
        run = run + 1 if run > 0 and abs(here - before) < SAME_LEG else (1 if before > here + SPECK_DEPTH else 0)
        if 0 < run <= SPECK_BEAMS and here > 0.0 and after > here + SPECK_DEPTH:
            theta = meas.first + meas.step * position
            x, y = measurement.to_world(meas, here * math.cos(theta), here * math.sin(theta))
            dx, dy = x - meas.middle_x[k], y - meas.middle_y[k]
            apart = dx * dx + dy * dy
            if LEGS_NEAREST * LEGS_NEAREST < apart < LEGS_FARTHEST * LEGS_FARTHEST:
                _record_leg(targets, b, x, y)
        before = here
    measurement.place_sensor(meas, 0.0)


def _record_leg(targets: Targets, b: int, x: float, y: float) -> None:
    """Add a sighting to the mean place of a leg."""
    for i in range(kalman.MAX_LEGS * b, kalman.MAX_LEGS * b + kalman.MAX_LEGS):
        hits = targets.leg_hits[i]
        dx, dy = x - targets.leg_x[i], y - targets.leg_y[i]
        if hits == 0 or dx * dx + dy * dy < SAME_LEG * SAME_LEG:
            targets.leg_x[i] += dx / (hits + 1)
            targets.leg_y[i] += dy / (hits + 1)
            targets.leg_hits[i] += 1
            return
