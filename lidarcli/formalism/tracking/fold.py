"""One sweep after the other: predict, associate, update, and let go of what is seen to be gone."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import association, life, memory, motion, shapes, sightings
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import correction as corrections
from lidarcli.formalism.tracking import persons as walkers
from lidarcli.formalism.tracking import sides as measures
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.assignment import Assignment
from lidarcli.formalism.tracking.association import Pairs
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.correction import Correction
from lidarcli.formalism.tracking.memory import Memory
from lidarcli.formalism.tracking.persons import Persons
from lidarcli.formalism.tracking.sides import Sides
from lidarcli.formalism.tracking.sightings import Sightings
from lidarcli.formalism.tracking.views import Seen, Views

PRISMATIC, UNKNOWN = detection.PRISMATIC, detection.UNKNOWN
ENOUGH_BEAMS = 8
"""A view with fewer beams does not make a box of a disc …"""
SLIMMEST_BOX = 0.2
"""[m] … nor one that is smaller: legs look alike from all sides."""
SIZE_BEAMS = 5
"""A view with fewer beams does not tell the size of a body."""
BOXY = 3
"""Sightings as a box that do."""
FACE_POINTS = 5
"""Points of a face that tell the direction of its body."""
YAW_FLOOR = 7e-4
"""[rad²] No face tells it better: (1.5 degrees)²."""
FARTHEST = 100.0
"""[m] What is further away tells no more of the drift."""
DRIFT, DRIFT_YAW = 2e-4, 4e-5
"""[m²/m], [rad²/m] By how much the variances of a pose grow on its way: (1.4 cm)² and (0.36 degrees)² on a metre …"""
DRIFT_TURN = 1e-4
"""[rad²/rad] … and that of its yaw as it turns."""
BEYOND = 0.02
"""[m] What is seen past a side moves that side, if it is this far past it."""
LEAST_VAR = 9e-4
"""[m²] Variance of a side that is known to go on at least so far."""
MOST_PAUSE = 60.0
"""[s] A longer pause between two sweeps counts as this one."""
SIDE_ERROR = 1e-4
"""[m²] Further variance of an extent: (1 cm)²."""
OUTLIER = 9e-4
"""[m²] An extent that differs by (3 cm)² from those before counts half."""


class Fold:
    """What is known after the latest sweep of a topic."""

    def __init__(self, alarm: float, bodies: Bodies, views: Views, past: Memory) -> None:
        """`alarm`: evidence of motion that is enough, as log-odds."""
        self.owner: list[Any] = []
        self.alarm = alarm
        self.clock = 0.0
        self.stamp = 0.0
        self.sweeps = 0
        self.objects = 0
        """Objects of all batches before the one at hand."""
        self.way = 0.0
        """How far the sensor has gone since the sweep before [m] …"""
        self.turned = 0.0
        """… and turned [rad]."""
        self.lapse = 0.0
        """Time since the last sweep whose pose was known [s]."""
        self.usual = 0.1
        """How long a sweep usually takes [s]."""
        self.sides = Sides()
        self.log = Sightings()
        self.correction = Correction()
        self.moves = False
        """Whether poses tell where the sensor is."""
        self.fit(bodies, views, past)

    def fit(self, bodies: Bodies, views: Views, past: Memory) -> None:
        """Go on with more room."""
        self.bodies = bodies
        self.views = views
        self.past = past
        self.pairs = Pairs(bodies.most, views.objects)
        self.task = Assignment(bodies.most, views.objects)
        self.persons = Persons(views.objects)
        self.taken_room: list[Any] = []
        self.taken = native.integers(self.taken_room, views.objects)

    def follow(self, seen: Seen, scans: Scans, row: int, stop: int, number: Any) -> int:
        """Take the sweeps from a row on; returns the row for which there is no room, or `stop`.

        Parameters
        ----------
        number : (K,) int64, to be filled: the number of the body of each object, 0 for none
        """
        out = native.at_longs(number)
        lock = native.release()
        while row < stop and has_room(self, seen, row):
            step(self, seen, scans, row, out)
            row += 1
        native.resume(lock)
        return row


def has_room(fold: Fold, seen: Seen, row: int) -> bool:
    """Whether all objects of a sweep could be new bodies."""
    objects = seen.offset[row + 1] - seen.offset[row]
    return (
        fold.bodies.high + 2 * objects <= fold.bodies.most
        and objects <= fold.views.objects
        and fold.log.count + objects <= fold.log.room
    )


def step(fold: Fold, seen: Seen, scans: Scans, row: int, number: Any) -> None:
    """One sweep."""
    for at in range(seen.offset[row], seen.offset[row + 1]):
        number[at] = 0
    fold.lapse += _tick(fold, seen.seconds[row])
    fold.sweeps += 1
    if seen.poses[4 * row] != seen.poses[4 * row]:
        return
    # Since the last sweep whose place was known.
    dt = fold.lapse
    fold.lapse = 0.0
    _judge_pose(fold, seen, row, dt)
    looks.look(fold.views, seen, scans, row)
    memory.watch(fold.past, fold.views, scans)
    fold.views.steady = memory.is_steady(fold.past)
    looks.judge_edges(fold.views)
    for b in range(fold.bodies.high):
        if fold.bodies.state[b] == things.LIVE:
            things.predict(fold.bodies, b, dt, _creep(fold, b))
    association.associate(fold.pairs, fold.task, fold.sides, fold.bodies, fold.views, fold.taken)
    association.join_parts(fold.bodies, fold.views, fold.taken)
    for k in range(fold.views.count):
        fold.persons.entry[k] = -1
    for b in range(fold.bodies.high):
        if fold.bodies.state[b] != things.LIVE or fold.bodies.kind[b] == things.PERSON:
            continue
        if fold.bodies.view[b] >= 0:
            _take(fold, fold.bodies, fold.views, scans, b, fold.bodies.view[b])
        else:
            life.miss(fold.bodies, b, fold.views, scans, fold.clock)
            if fold.bodies.moved[b] == 0:
                things.rest(fold.bodies, b)
    for k in range(fold.views.count):
        if fold.taken[k] == -1:
            fold.taken[k] = _begin(fold, fold.bodies, fold.views, k)
        elif fold.taken[k] < -1:
            fold.taken[k] = -2 - fold.taken[k]
    walkers.follow(
        fold.persons, fold.bodies, fold.views, scans, fold.taken, fold.log, fold.clock, fold.sweeps - 1
    )
    for k in range(fold.views.count):
        number[fold.views.object[k]] = fold.bodies.number[fold.taken[k]]
    corrections.apply(fold.correction, fold.bodies)
    memory.remember(fold.past, fold.views, scans, fold.clock)


def _tick(fold: Fold, stamp: float) -> float:
    """Let the clock go on to the stamp of a sweep [s]; stamps that jump back do not turn it back."""
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
    """Where the sensor is at a sweep, by its pose and what that is off by."""
    x, y, yaw = seen.poses[4 * row], seen.poses[4 * row + 1], seen.poses[4 * row + 2]
    fold.way = fold.turned = fold.correction.speed_x = fold.correction.speed_y = fold.correction.turning = 0.0
    if fold.moves and fold.correction.has_pose and dt > 0.0:
        dx, dy, turned = (
            x - fold.correction.told[0],
            y - fold.correction.told[1],
            yaw - fold.correction.told[2],
        )
        turned -= looks.TURN * math.floor(turned / looks.TURN + 0.5)
        fold.way, fold.turned = math.sqrt(dx * dx + dy * dy), abs(turned)
        fold.correction.speed_x, fold.correction.speed_y, fold.correction.turning = (
            dx / dt,
            dy / dt,
            turned / dt,
        )
    fold.correction.told[0], fold.correction.told[1], fold.correction.told[2], fold.correction.has_pose = (
        x,
        y,
        yaw,
        True,
    )
    fold.correction.way += fold.way
    at = 3 * row
    fold.views.way_x, fold.views.way_y = seen.way[at], seen.way[at + 1]
    fold.views.way_yaw = seen.way[at + 2]
    fold.views.goes = seen.way[at] != 0.0 or seen.way[at + 1] != 0.0 or seen.way[at + 2] != 0.0
    corrections.place(fold.correction, fold.views, x, y, yaw, seen.poses[4 * row + 3])


def _creep(fold: Fold, b: int) -> float:
    """Variance by which a standing body seems to move while the sensor does, for poses that drift [m²]."""
    dx, dy = fold.bodies.from_x[b] - fold.views.x, fold.bodies.from_y[b] - fold.views.y
    far = min(dx * dx + dy * dy, FARTHEST * FARTHEST)
    return fold.way * (DRIFT + DRIFT_YAW * far) + fold.turned * DRIFT_TURN * far


def _begin(fold: Fold, bodies: Bodies, views: Views, k: int) -> int:
    """A view that nobody took is a new body; returns its slot."""
    b = things.free_slot(bodies)
    things.clear(bodies, b)
    bodies.first_sweep[b] = bodies.last_sweep[b] = fold.sweeps - 1
    bodies.existence[b] = life.AT_FIRST
    bodies.first_at[b] = bodies.seen_at[b] = fold.clock
    if _is_boxy(views, k):
        _make_box(fold, bodies, views, b, k)
    else:
        _make_disc(fold, bodies, views, b, k)
    # What appears inside of a body that is known may be a piece of it.
    x, y = things.centre(bodies, b)
    other = life.around(bodies, b, x, y, association.JOIN if measures.is_partial(views, k) else 0.0)
    if other >= 0:
        bodies.same_as[b] = bodies.number[other]
    _note_view(fold, bodies, views, b, k)
    motion.note_rest(bodies, b, fold.sweeps - 1)
    return b


def _make_box(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Let a body be a box as a view shows it."""
    bodies.kind[b], bodies.settled[b] = things.BOX, 0
    yaw, var = _direction(views, k)
    bodies.yaw[b], bodies.yaw_rate[b] = yaw, 0.0
    bodies.yaw_var[b], bodies.yaw_cov[b] = var, 0.0
    bodies.rate_var[b] = things.TURN_AT_FIRST * things.TURN_AT_FIRST
    bodies.cos[b], bodies.sin[b] = math.cos(yaw), math.sin(yaw)
    pose_var = looks.pose_variance(views, k)
    measures.of_box(fold.sides, views, k, bodies.cos[b], bodies.sin[b], pose_var)
    for i in range(2):
        things.begin_axis(
            bodies,
            2 * b + i,
            fold.sides.z[2 * i],
            fold.sides.z[2 * i + 1],
            fold.sides.var[2 * i],
            fold.sides.var[2 * i + 1],
        )
    _depend_on_pose(fold, bodies, views, b, k)


def _make_disc(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Let a body be a disc as a view shows it; its axes are those of the world."""
    bodies.kind[b] = things.DISC
    pose_var = looks.pose_variance(views, k)
    measures.of_disc(fold.sides, views, k, 0.0, measures.AT_LEAST, pose_var)
    half, half_var = max(0.5 * views.chord[k], 0.02), 0.01
    if fold.sides.half_var >= 0.0:
        half, half_var = fold.sides.half, fold.sides.half_var
    for i in range(2):
        a, var = 2 * b + i, fold.sides.var[2 * i]
        c = fold.sides.z[2 * i]
        things.begin_axis(bodies, a, c - half, c + half, 2.0 * var, 2.0 * var)
        bodies.hh[a], bodies.ch[a] = half_var, 0.0
        things.stand_still(bodies, a)
    _depend_on_pose(fold, bodies, views, b, k)


def _depend_on_pose(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """A body that is taken from one view is off by all that the pose of that sweep is off by."""
    for i in range(2):
        u_x, u_y = things.to_world(bodies, b, 1.0 - i, 1.0 * i)
        corrections.effect_on(fold.correction, views, views.middle_x[k], views.middle_y[k], u_x, u_y, i)
        corrections.follow(fold.correction, bodies, 2 * b + i, 1.0, i)


def _direction(views: Views, k: int) -> tuple[float, float]:
    """Direction of the longest face of a view [rad], and its variance; negative where there is none that tells."""
    best = -1
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_points[f] >= FACE_POINTS and (best < 0 or views.extent[f] > views.extent[best]):
            best = f
    if best < 0:
        first, last = views.begin[k], views.begin[k + 1] - 1
        return (
            math.atan2(
                views.point_y[last] - views.point_y[first], views.point_x[last] - views.point_x[first]
            ),
            -1.0,
        )
    length = max(views.extent[best], 0.01)
    var = 12.0 * views.sigma * views.sigma / (views.face_points[best] * length * length)
    return math.atan2(views.along_y[best], views.along_x[best]), var + YAW_FLOOR


def _take(fold: Fold, bodies: Bodies, views: Views, scans: Scans, b: int, k: int) -> None:
    """Update a body by its view."""
    if bodies.kind[b] == things.DISC:
        _consider_box(fold, bodies, views, b, k)
    if bodies.kind[b] == things.BOX:
        yaw, var = _direction(views, k)
        if var >= 0.0:
            things.update_yaw(bodies, b, yaw, var)
    pose_var = looks.pose_variance(views, k)
    measures.measure(fold.sides, views, k, bodies, b, pose_var)
    is_whole = not measures.is_partial(views, k)
    motion.weigh(bodies, b, fold.sides, is_whole)
    if fold.moves:
        _learn(fold, bodies, views, b, k)
    if fold.sides.by_centre:
        _update_disc(bodies, fold.sides, fold.correction, b)
    else:
        _update_box(bodies, fold.sides, fold.correction, b)
    if is_whole and views.size[k] >= SIZE_BEAMS:
        diagonal = math.sqrt(views.length[k] * views.length[k] + views.width[k] * views.width[k])
        bodies.whole[b] += 1
        bodies.size[b] += (diagonal - bodies.size[b]) / min(bodies.whole[b], 20)
    life.see(bodies, b)
    _note_view(fold, bodies, views, b, k)
    shapes.note_legs(bodies, b, views, k, scans)
    if bodies.moved[b] == 0:
        motion.note_rest(bodies, b, fold.sweeps - 1)
        if motion.is_shown(bodies, b, views, scans, k, fold.past, fold.alarm, fold.clock):
            bodies.moved[b] = 1


def _is_boxy(views: Views, k: int) -> bool:
    """Whether a view shows a box well enough."""
    return views.shape[k] == PRISMATIC and views.size[k] >= ENOUGH_BEAMS and views.length[k] >= SLIMMEST_BOX


def _consider_box(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """What was seen as a box several times is one; how fast it is stays."""
    if not _is_boxy(views, k):
        return
    bodies.boxy[b] += 1
    if bodies.boxy[b] < BOXY or measures.is_partial(views, k):
        return
    v_x, v_y, var = bodies.v[2 * b], bodies.v[2 * b + 1], bodies.vv[2 * b]
    _make_box(fold, bodies, views, b, k)
    bodies.v[2 * b], bodies.v[2 * b + 1] = things.to_axes(bodies, b, v_x, v_y)
    bodies.vv[2 * b] = bodies.vv[2 * b + 1] = var
    bodies.evidence[b] = 0.0
    bodies.side_weight[2 * b] = bodies.side_weight[2 * b + 1] = 0.0


def _learn(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """What the sides of a body that stands say of the poses."""
    tells = (
        bodies.moved[b] == 0
        and bodies.settled[b] >= corrections.ENOUGH
        and bodies.evidence[b] < corrections.DOUBT
    )
    for i in range(2):
        u_x, u_y = things.to_world(bodies, b, 1.0 - i, 1.0 * i)
        a = 2 * b + i
        corrections.effect_on(fold.correction, views, views.middle_x[k], views.middle_y[k], u_x, u_y, i)
        for side in range(2 * i, 2 * i + 2):
            if not tells or fold.sides.var[side] < 0.0 or (fold.sides.by_centre and side > 2 * i):
                continue
            sign = 0.0 if fold.sides.by_centre else (1.0 if side > 2 * i else -1.0)
            off, var = things.still_residual(bodies, a, fold.sides.z[side], sign, fold.sides.var[side])
            corrections.learn(fold.correction, bodies, a, off, var, i)


def _update_disc(bodies: Bodies, sides: Sides, correction: Correction, b: int) -> None:
    for i in range(2):
        a = 2 * b + i
        things.update(bodies, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        gain = things.update_still(bodies, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        corrections.follow(correction, bodies, a, gain, i)
        if sides.half_var >= 0.0:
            things.update_extent(bodies, a, sides.half, sides.half_var)
            _note_extent(bodies, a, 2.0 * sides.half, 4.0 * sides.half_var)


def _update_box(bodies: Bodies, sides: Sides, correction: Correction, b: int) -> None:
    for i in range(2):
        a = 2 * b + i
        for side in range(2 * i, 2 * i + 2):
            sign = 1.0 if side == 2 * i + 1 else -1.0
            z, var = sides.z[side], sides.var[side]
            if var < 0.0:
                # It goes on at least so far.
                if sign * (z - bodies.c[a]) > bodies.h[a] + BEYOND:
                    things.update(bodies, a, z, sign, LEAST_VAR)
                    gain = things.update_still(bodies, a, z, sign, LEAST_VAR)
                    corrections.follow(correction, bodies, a, gain, i)
                continue
            things.update(bodies, a, z, sign, var)
            gain = things.update_still(bodies, a, z, sign, var)
            corrections.follow(correction, bodies, a, gain, i)
        length = sides.z[2 * i + 1] - sides.z[2 * i]
        if sides.var[2 * i] >= 0.0 and sides.var[2 * i + 1] >= 0.0:
            _note_extent(bodies, a, length, sides.var[2 * i] + sides.var[2 * i + 1])
        bodies.least[a] = max(bodies.least[a], length - 2.0 * BEYOND)


def _note_extent(bodies: Bodies, a: int, length: float, var: float) -> None:
    """Add an extent that was seen from end to end to the mean of such; what differs much counts little."""
    length = max(length, 0.0)
    weight = 1.0 / (var + SIDE_ERROR)
    if bodies.side_weight[a] > 0.0:
        off = length - bodies.side[a]
        weight /= 1.0 + off * off / (OUTLIER + var)
    bodies.side_weight[a] += weight
    bodies.side[a] += weight / bodies.side_weight[a] * (length - bodies.side[a])


def _note_view(fold: Fold, bodies: Bodies, views: Views, b: int, k: int) -> None:
    """Write down that a body was seen."""
    bodies.view[b] = k
    bodies.sightings[b] += 1
    bodies.settled[b] += 1
    bodies.last_sweep[b] = fold.sweeps - 1
    bodies.seen_at[b] = fold.clock
    bodies.middle_x[b], bodies.middle_y[b] = views.middle_x[k], views.middle_y[k]
    bodies.from_x[b], bodies.from_y[b] = things.centre(bodies, b)
    shapes.note(bodies, b, views, k)
    fold.persons.entry[k] = fold.log.count
    sightings.note(
        fold.log,
        bodies,
        b,
        fold.sides,
        fold.sweeps - 1,
        fold.clock,
        fold.objects + views.object[k],
        views.odds[k],
    )
