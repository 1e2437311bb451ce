"""One sweep after the other: predict, associate, update, and end bodies that are gone.

Beside the bodies the fold estimates the error of the poses. A pose that is told too late shifts everything that stands by
the speed of the sensor times the delay. A pose of another point of the robot shifts it as the robot turns. Both shifts are
linear in three numbers: the delay, and the place of the sensor ahead and to the left. Recursive least squares finds these
from the sides of standing bodies, and they correct the poses from then on.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import association, belief, estimation, observation, results
from lidarcli.formalism.tracking.association import Assignment, Pairs, Persons
from lidarcli.formalism.tracking.estimation import Bodies, Sides, Sightings
from lidarcli.formalism.tracking.observation import Memory, Seen, Views

PRISMATIC, UNKNOWN = detection.PRISMATIC, detection.UNKNOWN
SIZE_OUTLIER = results.SIZE_OUTLIER
BOX_BEAMS = 8
"""Least number of beams of a view that makes a box of a disc."""
SLIMMEST_BOX = 0.2
"""[m] Least length of such a view: legs look alike from all sides."""
SIZE_BEAMS = 5
"""Least number of beams of a view that measures the size of a body."""
BOX_SIGHTINGS = 3
"""Sightings as a box that make one of a disc."""
YAW_POINTS = 5
"""Least number of points of a face that measures the direction of its body."""
LEAST_YAW_VAR = 7e-4
"""[rad²] Least variance of that direction: (1.5 degrees)²."""
FARTHEST_DRIFT = 100.0
"""[m] Distance from which on the error of the heading does not shift bodies further."""
POSE_DRIFT, YAW_DRIFT = 2e-4, 4e-5
"""[m²/m], [rad²/m] Growth of the variances of a pose on its way: (1.4 cm)² and (0.36 degrees)² on a metre."""
TURN_DRIFT = 1e-4
"""[rad²/rad] Growth of the variance of the heading as the sensor turns."""
PAST_SIDE = 0.02
"""[m] Distance past a side from which on a point moves the side."""
AT_LEAST_VAR = 9e-4
"""[m²] Variance of a side that goes on at least so far: (3 cm)²."""
SHORTEST_STEP = 1e-3
"""[s] Least time between two sweeps that tells how fast the sensor goes: stamps may be equal, or a nanosecond apart."""
MOST_PAUSE = 60.0
"""[s] Longest pause between two sweeps; a longer one counts as this."""
EXTENT_VAR = 1e-4
"""[m²] Variance that is added to each measured extent: (1 cm)²."""
DELAY, AHEAD, LEFT = 0, 1, 2
"""Places of the three numbers of a correction."""
DELAY_SD = 0.2
"""[s] Standard deviation of the delay at first."""
PLACE_SD = 0.1
"""[m] Standard deviation of the place of the sensor at first."""
LEAST_DELAY_VAR = 1e-4
"""[s²] Least variance of the delay: (10 ms)²."""
LEAST_PLACE_VAR = 1e-5
"""[m²] Least variance of the place of the sensor."""
MOST_POSE_RESIDUAL = 9.0
"""Greatest squared residual, as a multiple of its variance. A larger one is that of a body that moves."""
POSE_SIGHTINGS = 5
"""Least number of sightings of a body that measures the error of the poses."""
MOST_POSE_EVIDENCE = 3.0
"""[log-odds] Greatest evidence of motion of such a body."""
POSE_SIDE_VAR = 1e-4
"""[m²] Variance that is added to each side, because consecutive sightings depend on each other: (1 cm)²."""
MOST_DELAY = 0.4
"""[s] Greatest delay."""


class Fold:
    """State of the tracking after the latest sweep of a topic."""

    def __init__(self, alarm: float, bodies: Bodies, views: Views, past: Memory) -> None:
        """`alarm`: least evidence of motion of a body that moves [log-odds]."""
        self.owner: list[Any] = []
        self.alarm = alarm
        self.clock = 0.0
        self.stamp = 0.0
        self.sweeps = 0
        self.objects = 0
        """Number of objects of all batches before the current one."""
        self.way = 0.0
        """Way of the sensor since the sweep before [m]."""
        self.turned = 0.0
        """Turn of the sensor since the sweep before [rad]."""
        self.lapse = 0.0
        """Time since the last sweep with a pose [s]."""
        self.usual = 0.1
        """Usual time from sweep to sweep [s]."""
        self.sides = Sides()
        self.log = Sightings()
        self.correction = Correction()
        self.moves = False
        """True if the log has poses of the sensor."""
        self.fit(bodies, views, past)

    def fit(self, bodies: Bodies, views: Views, past: Memory) -> None:
        """Continue with larger arrays."""
        self.bodies = bodies
        self.views = views
        self.past = past
        self.pairs = Pairs(bodies.most, views.objects)
        self.task = Assignment(bodies.most, views.objects)
        self.persons = Persons(views.objects)
        self.taken_room: list[Any] = []
        self.taken = native.integers(self.taken_room, views.objects)

    def follow(self, seen: Seen, scans: Scans, row: int, stop: int, number: Any) -> int:
        """Take the sweeps from a row on; return the first row for which there is no room, or `stop`.

        Parameters
        ----------
        seen, scans : objects and beams of the batch
        row, stop : rows of the batch
        number : (K,) int64 to fill in: number of the body of each object, 0 for none
        """
        out = native.at_longs(number)
        lock = native.release()
        while row < stop and has_room(self, seen, row):
            step(self, seen, scans, row, out)
            row += 1
        native.resume(lock)
        return row


def has_room(fold: Fold, seen: Seen, row: int) -> bool:
    """Return whether there is room if all objects of a sweep are new bodies."""
    objects = seen.offset[row + 1] - seen.offset[row]
    return (
        fold.bodies.high + 2 * objects <= fold.bodies.most
        and objects <= fold.views.objects
        and fold.log.count + objects <= fold.log.room
    )


def step(fold: Fold, seen: Seen, scans: Scans, row: int, number: Any) -> None:
    """Take one sweep: predict, associate, update, end."""
    for at in range(seen.offset[row], seen.offset[row + 1]):
        number[at] = 0
    fold.lapse += _tick(fold, seen.seconds[row])
    fold.sweeps += 1
    if seen.poses[4 * row] != seen.poses[4 * row]:
        return
    # Time since the last sweep with a pose.
    dt = fold.lapse
    fold.lapse = 0.0
    _judge_pose(fold, seen, row, dt)
    observation.observe(fold.views, seen, scans, row)
    observation.count_flicker(fold.past, fold.views, scans)
    fold.views.steady = observation.is_steady(fold.past)
    observation.judge_edges(fold.views)
    for b in range(fold.bodies.high):
        if fold.bodies.state[b] == estimation.LIVE:
            estimation.predict(fold.bodies, b, dt, _creep(fold, b))
    association.associate(fold.pairs, fold.task, fold.sides, fold.bodies, fold.views, fold.taken)
    association.join_parts(fold.bodies, fold.views, fold.taken)
    for k in range(fold.views.count):
        fold.persons.entry[k] = -1
    for b in range(fold.bodies.high):
        if fold.bodies.state[b] != estimation.LIVE or fold.bodies.kind[b] == estimation.PERSON:
            continue
        if fold.bodies.view[b] >= 0:
            _take(fold, fold.bodies, fold.views, scans, b, fold.bodies.view[b])
        else:
            belief.note_missed(fold.bodies, b, fold.views, scans, fold.clock)
            if fold.bodies.moved[b] == 0:
                estimation.rest(fold.bodies, b)
    for k in range(fold.views.count):
        if fold.taken[k] == -1:
            fold.taken[k] = _begin(fold, fold.bodies, fold.views, k)
        elif fold.taken[k] < -1:
            fold.taken[k] = -2 - fold.taken[k]
    association.follow_persons(
        fold.persons, fold.bodies, fold.views, scans, fold.taken, fold.log, fold.clock, fold.sweeps - 1
    )
    for k in range(fold.views.count):
        number[fold.views.object[k]] = fold.bodies.number[fold.taken[k]]
    apply_correction(fold.correction, fold.bodies)
    observation.remember(fold.past, fold.views, scans, fold.clock)


def _tick(fold: Fold, stamp: float) -> float:
    """Advance the clock to the stamp of a sweep [s], and return by how much; it never goes back."""
    dt = 0.0
    if fold.sweeps > 0:
        dt = stamp - fold.stamp
        if dt < 0.0:
            dt = fold.usual
        elif dt > MOST_PAUSE:
            dt = MOST_PAUSE
        elif 0.0 < dt < 1.0:
            fold.usual += 0.05 * (dt - fold.usual)
    fold.stamp = stamp
    fold.clock += dt
    return dt


def _judge_pose(fold: Fold, seen: Seen, row: int, dt: float) -> None:
    """Set the pose of the sensor at a sweep, corrected by the estimated error."""
    x, y, yaw = seen.poses[4 * row], seen.poses[4 * row + 1], seen.poses[4 * row + 2]
    fold.way = fold.turned = fold.correction.speed_x = fold.correction.speed_y = fold.correction.turning = 0.0
    if fold.moves and fold.correction.has_pose and dt > 0.0:
        dx, dy, turned = (x - fold.correction.last[0], y - fold.correction.last[1], yaw - fold.correction.last[2])
        turned -= observation.TURN * math.floor(turned / observation.TURN + 0.5)
        fold.way, fold.turned = math.sqrt(dx * dx + dy * dy), abs(turned)
        if dt >= SHORTEST_STEP:
            fold.correction.speed_x, fold.correction.speed_y = dx / dt, dy / dt
            fold.correction.turning = turned / dt
    fold.correction.last[0], fold.correction.last[1], fold.correction.last[2], fold.correction.has_pose = (x, y, yaw, True)
    fold.correction.way += fold.way
    at = 3 * row
    fold.views.way_x, fold.views.way_y = seen.way[at], seen.way[at + 1]
    fold.views.way_yaw = seen.way[at + 2]
    fold.views.goes = seen.way[at] != 0.0 or seen.way[at + 1] != 0.0 or seen.way[at + 2] != 0.0
    correct_pose(fold.correction, fold.views, x, y, yaw, seen.poses[4 * row + 3])


def _creep(fold: Fold, b: int) -> float:
    """Return the variance by which a standing body seems to move, because poses drift as the sensor moves [m²]."""
    dx, dy = fold.bodies.from_x[b] - fold.views.x, fold.bodies.from_y[b] - fold.views.y
    far = min(dx * dx + dy * dy, FARTHEST_DRIFT * FARTHEST_DRIFT)
    return fold.way * (POSE_DRIFT + YAW_DRIFT * far) + fold.turned * TURN_DRIFT * far


def _begin(fold: Fold, bodies: Bodies, views: Views, k: int) -> int:
    """Begin a new body with a view that no body took; return its slot."""
    b = estimation.free_slot(bodies)
    estimation.clear(bodies, b)
    bodies.first_sweep[b] = bodies.last_sweep[b] = fold.sweeps - 1
    bodies.existence[b] = belief.EXISTENCE_AT_FIRST
    bodies.first_at[b] = bodies.seen_at[b] = fold.clock
    if _is_boxy(views, k):
        _make_box(fold, bodies, views, b, k)
    else:
        _make_disc(fold, bodies, views, b, k)
    # A new body inside of a known one may be a piece of it.
    x, y = estimation.centre(bodies, b)
    other = belief.covering_body(bodies, b, x, y, association.PART_MARGIN if observation.is_partial(views, k) else 0.0)
    if other >= 0:
        bodies.same_as[b] = bodies.number[other]
    _note_view(fold, bodies, views, b, k)
    belief.note_rest(bodies, b, fold.sweeps - 1)
    return b


def _make_box(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Make a body a box, by a view."""
    bodies.kind[b], bodies.settled[b] = estimation.BOX, 0
    yaw, var = _face_direction(views, k)
    bodies.yaw[b], bodies.yaw_rate[b] = yaw, 0.0
    bodies.yaw_var[b], bodies.yaw_cov[b] = var, 0.0
    bodies.rate_var[b] = estimation.TURN_RATE_SD * estimation.TURN_RATE_SD
    bodies.cos[b], bodies.sin[b] = math.cos(yaw), math.sin(yaw)
    pose_var = observation.pose_variance(views, k)
    estimation.measure_box(fold.sides, views, k, bodies.cos[b], bodies.sin[b], pose_var)
    for i in range(2):
        estimation.begin_axis(
            bodies,
            2 * b + i,
            fold.sides.z[2 * i],
            fold.sides.z[2 * i + 1],
            fold.sides.var[2 * i],
            fold.sides.var[2 * i + 1],
        )
    _depend_on_pose(fold, bodies, views, b, k)


def _make_disc(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Make a body a disc, by a view; its axes are those of the world."""
    bodies.kind[b] = estimation.DISC
    pose_var = observation.pose_variance(views, k)
    estimation.measure_disc(fold.sides, views, k, 0.0, estimation.AT_LEAST, pose_var)
    half, half_var = max(0.5 * views.chord[k], 0.02), 0.01
    if fold.sides.half_var >= 0.0:
        half, half_var = fold.sides.half, fold.sides.half_var
    for i in range(2):
        a, var = 2 * b + i, fold.sides.var[2 * i]
        c = fold.sides.z[2 * i]
        estimation.begin_axis(bodies, a, c - half, c + half, 2.0 * var, 2.0 * var)
        bodies.hh[a], bodies.ch[a] = half_var, 0.0
        estimation.stand_still(bodies, a)
    _depend_on_pose(fold, bodies, views, b, k)


def _depend_on_pose(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Let a new body depend on the whole error of the pose of its sweep."""
    for i in range(2):
        u_x, u_y = estimation.to_world(bodies, b, 1.0 - i, 1.0 * i)
        set_effect(fold.correction, views, views.middle_x[k], views.middle_y[k], u_x, u_y, i)
        follow_effect(fold.correction, bodies, 2 * b + i, 1.0, i)


def _face_direction(views: Views, k: int) -> tuple[float, float]:
    """Return the direction of the longest face of a view [rad] and its variance, negative without a face that is good."""
    best = -1
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_points[f] >= YAW_POINTS and (best < 0 or views.extent[f] > views.extent[best]):
            best = f
    if best < 0:
        first, last = views.begin[k], views.begin[k + 1] - 1
        return (math.atan2(views.point_y[last] - views.point_y[first], views.point_x[last] - views.point_x[first]), -1.0)
    length = max(views.extent[best], 0.01)
    var = 12.0 * views.sigma * views.sigma / (views.face_points[best] * length * length)
    return math.atan2(views.along_y[best], views.along_x[best]), var + LEAST_YAW_VAR


def _take(fold: Fold, bodies: Bodies, views: Views, scans: Scans, b: int, k: int) -> None:
    """Update a body with its view."""
    if bodies.kind[b] == estimation.DISC:
        _consider_box(fold, bodies, views, b, k)
    if bodies.kind[b] == estimation.BOX:
        yaw, var = _face_direction(views, k)
        if var >= 0.0:
            estimation.update_yaw(bodies, b, yaw, var)
    pose_var = observation.pose_variance(views, k)
    estimation.measure(fold.sides, views, k, bodies, b, pose_var)
    is_whole = not observation.is_partial(views, k)
    belief.weigh_motion(bodies, b, fold.sides, is_whole)
    if fold.moves:
        _learn_from_body(fold, bodies, views, b, k)
    if fold.sides.by_centre:
        _update_disc(bodies, fold.sides, fold.correction, b)
    else:
        _update_box(bodies, fold.sides, fold.correction, b)
    if is_whole and views.size[k] >= SIZE_BEAMS:
        diagonal = math.sqrt(views.length[k] * views.length[k] + views.width[k] * views.width[k])
        bodies.whole[b] += 1
        bodies.size[b] += (diagonal - bodies.size[b]) / min(bodies.whole[b], 20)
    belief.note_seen(bodies, b)
    _note_view(fold, bodies, views, b, k)
    belief.note_legs(bodies, b, views, k, scans)
    if bodies.moved[b] == 0:
        belief.note_rest(bodies, b, fold.sweeps - 1)
        if belief.is_moving(bodies, b, views, scans, k, fold.past, fold.alarm, fold.clock):
            bodies.moved[b] = 1


def _is_boxy(views: Views, k: int) -> bool:
    """Return whether a view shows a box well enough."""
    return views.shape[k] == PRISMATIC and views.size[k] >= BOX_BEAMS and views.length[k] >= SLIMMEST_BOX


def _consider_box(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Make a disc a box once it was seen as one several times; its velocity stays."""
    if not _is_boxy(views, k):
        return
    bodies.boxy[b] += 1
    if bodies.boxy[b] < BOX_SIGHTINGS or observation.is_partial(views, k):
        return
    v_x, v_y, var = bodies.v[2 * b], bodies.v[2 * b + 1], bodies.vv[2 * b]
    _make_box(fold, bodies, views, b, k)
    bodies.v[2 * b], bodies.v[2 * b + 1] = estimation.to_axes(bodies, b, v_x, v_y)
    bodies.vv[2 * b] = bodies.vv[2 * b + 1] = var
    bodies.evidence[b] = 0.0
    bodies.side_weight[2 * b] = bodies.side_weight[2 * b + 1] = 0.0


def _learn_from_body(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Learn the error of the poses from the sides of a body that stands."""
    tells = bodies.moved[b] == 0 and bodies.settled[b] >= POSE_SIGHTINGS and bodies.evidence[b] < MOST_POSE_EVIDENCE
    for i in range(2):
        u_x, u_y = estimation.to_world(bodies, b, 1.0 - i, 1.0 * i)
        a = 2 * b + i
        set_effect(fold.correction, views, views.middle_x[k], views.middle_y[k], u_x, u_y, i)
        for side in range(2 * i, 2 * i + 2):
            if not tells or fold.sides.var[side] < 0.0 or (fold.sides.by_centre and side > 2 * i):
                continue
            sign = 0.0 if fold.sides.by_centre else (1.0 if side > 2 * i else -1.0)
            off, var = estimation.still_residual(bodies, a, fold.sides.z[side], sign, fold.sides.var[side])
            learn_pose_error(fold.correction, bodies, a, off, var, i)


def _update_disc(bodies: Bodies, sides: Sides, correction: Correction, b: int) -> None:
    """Update a disc with its measured centre and radius."""
    for i in range(2):
        a = 2 * b + i
        estimation.update(bodies, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        gain = estimation.update_still(bodies, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        follow_effect(correction, bodies, a, gain, i)
        if sides.half_var >= 0.0:
            estimation.update_extent(bodies, a, sides.half, sides.half_var)
            _note_extent(bodies, a, 2.0 * sides.half, 4.0 * sides.half_var)


def _update_box(bodies: Bodies, sides: Sides, correction: Correction, b: int) -> None:
    """Update a box with its measured sides."""
    for i in range(2):
        a = 2 * b + i
        for side in range(2 * i, 2 * i + 2):
            sign = 1.0 if side == 2 * i + 1 else -1.0
            z, var = sides.z[side], sides.var[side]
            if var < 0.0:
                # The side goes on at least so far.
                if sign * (z - bodies.c[a]) > bodies.h[a] + PAST_SIDE:
                    estimation.update(bodies, a, z, sign, AT_LEAST_VAR)
                    gain = estimation.update_still(bodies, a, z, sign, AT_LEAST_VAR)
                    follow_effect(correction, bodies, a, gain, i)
                continue
            estimation.update(bodies, a, z, sign, var)
            gain = estimation.update_still(bodies, a, z, sign, var)
            follow_effect(correction, bodies, a, gain, i)
        length = sides.z[2 * i + 1] - sides.z[2 * i]
        if sides.var[2 * i] >= 0.0 and sides.var[2 * i + 1] >= 0.0:
            _note_extent(bodies, a, length, sides.var[2 * i] + sides.var[2 * i + 1])
        bodies.least[a] = max(bodies.least[a], length - 2.0 * PAST_SIDE)


def _note_extent(bodies: Bodies, a: int, length: float, var: float) -> None:
    """Add an extent that was seen from end to end to its mean; one that differs much counts little."""
    length = max(length, 0.0)
    weight = 1.0 / (var + EXTENT_VAR)
    if bodies.side_weight[a] > 0.0:
        off = length - bodies.side[a]
        weight /= 1.0 + off * off / (SIZE_OUTLIER + var)
    bodies.side_weight[a] += weight
    bodies.side[a] += weight / bodies.side_weight[a] * (length - bodies.side[a])


def _note_view(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Note that a body was seen, and log the sighting."""
    bodies.view[b] = k
    bodies.sightings[b] += 1
    bodies.settled[b] += 1
    bodies.last_sweep[b] = fold.sweeps - 1
    bodies.seen_at[b] = fold.clock
    bodies.middle_x[b], bodies.middle_y[b] = views.middle_x[k], views.middle_y[k]
    bodies.from_x[b], bodies.from_y[b] = estimation.centre(bodies, b)
    belief.note_shape(bodies, b, views, k)
    fold.persons.entry[k] = fold.log.count
    estimation.log_sighting(
        fold.log, bodies, b, fold.sides, views, k, fold.sweeps - 1, fold.clock, fold.objects + views.object[k]
    )


class Correction:
    """Estimated error of the poses, and the motion of the sensor at the current sweep."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.value = native.doubles(self.owner, 3)
        """Delay of the poses [s], and place of the sensor ahead and left of its poses [m]."""
        self.cov = native.doubles(self.owner, 9)
        self.cov[0] = DELAY_SD * DELAY_SD
        self.cov[4] = self.cov[8] = PLACE_SD * PLACE_SD
        self.last = native.doubles(self.owner, 3)
        """Pose of the sweep before in the log: x, y [m], yaw [rad]."""
        self.speed_x = 0.0
        self.speed_y = 0.0
        self.turning = 0.0
        """Velocity [m/s] and turn rate [rad/s] of the sensor."""
        self.has_pose = False
        self.way = 0.0
        """Way of the sensor so far [m]."""
        self.effect = native.doubles(self.owner, 6)
        """Effect of the three numbers on the current point, for both axes of its body."""
        self.product = native.doubles(self.owner, 3)
        self.change = native.doubles(self.owner, 3)

    def estimate(self) -> tuple[float, float, float, float, float]:
        """Return the delay [s], the place ahead and left [m], and the standard deviations of the delay and of the place."""
        return (
            self.value[DELAY],
            self.value[AHEAD],
            self.value[LEFT],
            math.sqrt(self.cov[0]),
            math.sqrt(max(self.cov[4], self.cov[8])),
        )


def correct_pose(correction: Correction, views: Views, x: float, y: float, yaw: float, side: float) -> None:
    """Set the pose of the sensor for a pose x, y, yaw of the log, and its variance."""
    late = correction.value[DELAY]
    yaw += correction.turning * late
    views.cos, views.sin = math.cos(yaw), math.sin(yaw)
    ahead, left = correction.value[AHEAD], side * correction.value[LEFT]
    views.x = x + correction.speed_x * late + views.cos * ahead - views.sin * left
    views.y = y + correction.speed_y * late + views.sin * ahead + views.cos * left
    views.start_x, views.start_y, views.start_yaw = views.x, views.y, yaw
    var = correction.cov[0]
    speed = correction.speed_x * correction.speed_x + correction.speed_y * correction.speed_y
    views.pose_var, views.pose_turn_var = speed * var, correction.turning * correction.turning * var


def set_effect(correction: Correction, views: Views, x: float, y: float, u_x: float, u_y: float, axis: int) -> None:
    """Fill in `effect`: the derivative of a point x, y along a direction u, for each of the three numbers."""
    dx, dy = x - views.x, y - views.y
    moved_x = correction.speed_x - correction.turning * dy
    moved_y = correction.speed_y + correction.turning * dx
    correction.effect[3 * axis + DELAY] = -(u_x * moved_x + u_y * moved_y)
    correction.effect[3 * axis + AHEAD] = -(u_x * views.cos + u_y * views.sin)
    correction.effect[3 * axis + LEFT] = -views.side * (u_y * views.cos - u_x * views.sin)


def learn_pose_error(correction: Correction, bodies: Bodies, a: int, off: float, var: float, axis: int) -> None:
    """Update the estimate with the residual of a side of a standing body [m] along axis a, after `set_effect`."""
    s = var + POSE_SIDE_VAR
    expected = 0.0
    for i in range(3):
        correction.product[i] = 0.0
        for j in range(3):
            correction.product[i] += correction.cov[3 * i + j] * (
                correction.effect[3 * axis + j] - bodies.effect[3 * a + j]
            )
    for i in range(3):
        s += correction.product[i] * (correction.effect[3 * axis + i] - bodies.effect[3 * a + i])
        expected += (correction.effect[3 * axis + i] - bodies.effect[3 * a + i]) * (correction.change[i])
    off -= expected
    if off * off > MOST_POSE_RESIDUAL * s:
        return
    for i in range(3):
        correction.change[i] += correction.product[i] / s * off
    for i in range(3):
        for j in range(3):
            correction.cov[3 * i + j] -= correction.product[i] * correction.product[j] / s
    correction.cov[0] = max(correction.cov[0], LEAST_DELAY_VAR)
    correction.cov[4] = max(correction.cov[4], LEAST_PLACE_VAR)
    correction.cov[8] = max(correction.cov[8], LEAST_PLACE_VAR)


def follow_effect(correction: Correction, bodies: Bodies, a: int, gain: float, axis: int) -> None:
    """Mix the effect of a measurement into that of the twin, with the gain of its update."""
    # Where the extent is not known the gain of the centre may be any; what is mixed again and again would grow for ever.
    gain = min(max(gain, 0.0), 1.0)
    for i in range(3):
        at = 3 * a + i
        bodies.effect[at] += gain * (correction.effect[3 * axis + i] - bodies.effect[at])


def apply_correction(correction: Correction, bodies: Bodies) -> None:
    """Correct all bodies by what was learned from a sweep, and the poses from now on."""
    if correction.change[0] == 0.0 and correction.change[1] == 0.0 and correction.change[2] == 0.0:
        return
    for b in range(bodies.high):
        if bodies.state[b] != estimation.LIVE:
            continue
        for a in range(2 * b, 2 * b + 2):
            shift = 0.0
            for i in range(3):
                shift += bodies.effect[3 * a + i] * correction.change[i]
            bodies.c[a] -= shift
            bodies.still_c[a] -= shift
    for i in range(3):
        correction.value[i] += correction.change[i]
        correction.change[i] = 0.0
    correction.value[DELAY] = min(max(correction.value[DELAY], -MOST_DELAY), MOST_DELAY)
