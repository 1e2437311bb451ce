"""Views: the objects of one sweep in the world frame, and the sweeps of the last seconds.

A view has the points, faces and edges of an object. The sweeps that are remembered tell where space was free or occupied.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli import native, sweeps
from lidarcli.formalism import detection
from lidarcli.formalism.detection import COLUMNS, REQUIRED, Detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.sweeps import Bool

OBJECT, REMOVED = detection.OBJECT, detection.REMOVED
FULL, START_HIDDEN, END_HIDDEN, CUT = (detection.FULL, detection.START_HIDDEN, detection.END_HIDDEN, detection.CUT)
OPEN_VIEW, SHARED = sweeps.Closure.OPEN.value, sweeps.Closure.SHARED.value
VALID, NO_RETURN = sweeps.Status.VALID.value, sweeps.Status.NO_RETURN.value
TURN = sweeps.TURN
HIDDEN, OPEN, OWN = 0, 1, 2
"""Kinds of edges: hidden by a nearer object or the end of the view; beside beams without a return; the object's own."""
BOX_MARGIN = 0.05
"""[m] Points outside of the box by more than this, and four times the noise, belong to an object between its parts."""
LEAST_FACE_POINTS = 3
"""Least number of points for the line of a face."""
SWEEPS_KEPT = 16
"""Number of sweeps that are remembered."""
SWEEPS_APART = 0.3
"""[s] Least time between two sweeps that are remembered."""
FLICKER_WEIGHT = 0.02
"""Weight of one sweep in the mean number of beams that flicker."""
MOST_FLICKER_SHARE = 0.2
"""Share of the beams without a return that may have one a sweep later. Above it no such beam proves free space."""
HIT_MARGIN = 0.08
"""[m] A beam has hit a point that is this close to its end, with twice the noise on top."""
LEAST_STEP = 1e-6
"""[rad] Beams that are closer together than this are not told apart."""
NO_RANGE = -1.0
"""Range of a beam that tells nothing."""
FREE_RANGE = 1e9
"""Range of a beam without a return, which proves free space."""


class Seen:
    """Columns of a detection of K objects, and the poses of its S sweeps, for the loops over one sweep."""

    def __init__(self, found: Detection, poses: Any, seconds: Any, way: Any, shares: Any, placed: Bool) -> None:
        """
        Parameters
        ----------
        found : result of `detect`
        poses : (S, 4) x, y, yaw, side of the sensor; the side is -1 where it hangs head down
        seconds : (S,) times of the sweeps [s]
        way : (S, 3) way of the sensor in x, y, yaw during each sweep
        shares : (K,) share of the time of its sweep that had passed when each object was seen
        placed : (S,) True where the place of the sensor is known
        """
        arrays = {name: np.require(getattr(found, name), COLUMNS[name].dtype, ["C", "A"]) for name in REQUIRED}
        change = np.full(len(found), -1, np.int8) if found.change is None else found.change
        offset = np.searchsorted(found.row, np.arange(len(found.noise) + 1)).astype(np.int64)
        numbers = (poses, seconds, way, shares)
        more = [np.require(values, np.float64, ["C", "A"]) for values in numbers]
        marks = [(change == REMOVED).astype(np.uint8), placed.astype(np.uint8)]
        self.owner: list[Any] = [offset, *marks, *more, arrays]
        self.most = int(np.diff(offset).max(initial=0))
        """Greatest number of objects in one sweep."""
        self.found = native.pointers(arrays)
        """The arrays of the detection."""
        self.offset = native.at_longs(self.owner[0])
        self.removed = native.at_bytes(self.owner[1])
        self.placed = native.at_bytes(self.owner[2])
        self.poses = native.at_doubles(self.owner[3])
        self.seconds = native.at_doubles(self.owner[4])
        self.way = native.at_doubles(self.owner[5])
        self.shares = native.at_doubles(self.owner[6])


class Views:
    """The `count` views of one sweep. View k has the points `begin[k]` to `begin[k + 1]` - 1; its faces likewise."""

    def __init__(self, objects: int, beams: int) -> None:
        """Make room for so many objects and beams of a sweep."""
        self.owner: list[Any] = []
        self.objects = objects
        self.beams = beams
        self.count = 0
        # Pose of the sensor at the first beam, and its way until the last one.
        self.start_x = 0.0
        self.start_y = 0.0
        self.start_yaw = 0.0
        self.way_x = 0.0
        self.way_y = 0.0
        self.way_yaw = 0.0
        self.goes = False
        """True if the sensor moves during the sweep."""
        # Pose that `place_sensor` has set.
        self.x = 0.0
        self.y = 0.0
        self.cos = 1.0
        self.sin = 0.0
        self.side = 1.0
        self.is_placed = True
        """True if the place of the sensor is known: then a body is one object from sweep to sweep."""
        self.first = 0.0
        self.step = 0.0
        self.bearings = 0
        self.period = 0
        self.reverse = False
        self.row = 0
        self.sigma = 0.0
        self.steady = True
        """True if beams without a return prove free space."""
        self.pose_var = 0.0
        self.pose_turn_var = 0.0
        """Variance of a point from the error of the pose [m²], and its growth with the squared range [m²/m²]."""
        # Of each view.
        self.object = native.integers(self.owner, objects)
        """Index of the object in the detection."""
        self.shape = native.integers(self.owner, objects)
        self.size = native.integers(self.owner, objects)
        """Number of beams."""
        self.start = native.integers(self.owner, objects)
        self.end = native.integers(self.owner, objects)
        """Kinds of the two edges."""
        self.middle_x = native.doubles(self.owner, objects)
        self.middle_y = native.doubles(self.owner, objects)
        """Centroid of the points [m]."""
        self.centre_x = native.doubles(self.owner, objects)
        self.centre_y = native.doubles(self.owner, objects)
        """Centre of the box [m]; of a round object, that of its circle."""
        self.length = native.doubles(self.owner, objects)
        self.width = native.doubles(self.owner, objects)
        """Sides of the box [m]."""
        self.chord = native.doubles(self.owner, objects)
        self.near = native.doubles(self.owner, objects)
        """Least range [m]."""
        self.share = native.doubles(self.owner, objects)
        """Share of the time of the sweep that had passed when it was seen."""
        self.begin = native.integers(self.owner, objects + 1)
        self.face_begin = native.integers(self.owner, objects + 1)
        # Of each point.
        self.point_x = native.doubles(self.owner, 2 * beams + objects)
        self.point_y = native.doubles(self.owner, 2 * beams + objects)
        # Of each face: a point of its line, its direction counter-clockwise as seen by the sensor, how many points.
        self.face_x = native.doubles(self.owner, beams)
        self.face_y = native.doubles(self.owner, beams)
        self.along_x = native.doubles(self.owner, beams)
        self.along_y = native.doubles(self.owner, beams)
        self.face_points = native.integers(self.owner, beams)
        self.extent = native.doubles(self.owner, beams)
        """Extent of the points along the face [m]."""
        self.bulge = native.doubles(self.owner, beams)
        """Sum of the squared distances of the points from the line [m²]."""
        self.face_first = native.integers(self.owner, beams)
        self.face_last = native.integers(self.owner, beams)
        """First and last point of the face."""


def observe(views: Views, seen: Seen, scans: Scans, row: int) -> None:
    """Fill in the views of the sweep in a row of a batch; `x`, `y`, `cos` and `sin` hold the pose of the sensor."""
    _place(views, seen, scans, row)
    views.count = 0
    views.begin[0] = views.face_begin[0] = 0
    for at in range(seen.offset[row], seen.offset[row + 1]):
        if seen.found.set[at] == OBJECT and not seen.removed[at]:
            _add(views, seen, scans, at)


def judge_edges(views: Views) -> None:
    """Make edges beside beams without a return the object's own, if such beams prove free space."""
    for k in range(views.count):
        if views.steady and views.start[k] == OPEN:
            views.start[k] = OWN
        if views.steady and views.end[k] == OPEN:
            views.end[k] = OWN


def pose_variance(views: Views, k: int) -> float:
    """Return the variance of the points of a view from the error of the pose [m²]."""
    return views.pose_var + views.pose_turn_var * views.near[k] * views.near[k]


def is_partial(views: Views, k: int) -> bool:
    """Return whether a view may not reach both ends of an object."""
    return views.start[k] != OWN or views.end[k] != OWN


def _place(views: Views, seen: Seen, scans: Scans, row: int) -> None:
    """Set the bearings of the beams."""
    increment = scans.angle_increment[row]
    views.row = row
    views.bearings = scans.beams[row] - (scans.closure[row] == SHARED)
    views.period = 0 if scans.closure[row] == OPEN_VIEW else views.bearings
    views.reverse = increment < 0
    views.step = abs(increment)
    views.first = scans.angle_min[row]
    if views.reverse:
        views.first += (views.bearings - 1) * increment
    views.side = seen.poses[4 * row + 3]
    views.is_placed = seen.placed[row] != 0
    views.sigma = seen.found.noise[row]


def place_sensor(views: Views, share: float) -> None:
    """Set the pose of the sensor to that after a share of the time of the sweep."""
    if not views.goes:
        return
    yaw = views.start_yaw + share * views.way_yaw
    views.x, views.y = views.start_x + share * views.way_x, views.start_y + share * views.way_y
    views.cos, views.sin = math.cos(yaw), math.sin(yaw)


def to_world(views: Views, x: float, y: float) -> tuple[float, float]:
    """Return a point of the sensor frame in the world [m]."""
    left = views.side * y
    return views.x + views.cos * x - views.sin * left, views.y + views.sin * x + views.cos * left


def to_sensor(views: Views, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the sensor frame [m], at the time when the sensor looked there."""
    ahead, left = _ahead_and_left(views, x, y)
    if views.goes and views.bearings > 1 and views.step > 0.0:
        past = math.atan2(left, ahead) - views.first
        past -= TURN * math.floor(past / TURN)
        share = min(past / (views.step * (views.bearings - 1)), 1.0)
        place_sensor(views, 1.0 - share if views.reverse else share)
        ahead, left = _ahead_and_left(views, x, y)
        place_sensor(views, 0.0)
    return ahead, left


def _ahead_and_left(views: Views, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the frame of the current pose of the sensor [m]."""
    dx, dy = x - views.x, y - views.y
    return views.cos * dx + views.sin * dy, views.side * (views.cos * dy - views.sin * dx)


def position_of(views: Views, beam: int) -> int:
    """Return the index of a beam by increasing bearing."""
    return views.bearings - 1 - beam if views.reverse else beam


def _add(views: Views, seen: Seen, scans: Scans, at: int) -> None:
    """Add the view of an object."""
    k = views.count
    views.share[k] = seen.shares[at]
    place_sensor(views, views.share[k])
    views.object[k], views.shape[k], views.size[k] = at, seen.found.shape[at], seen.found.beams[at]
    views.middle_x[k], views.middle_y[k] = to_world(views, seen.found.x[at], seen.found.y[at])
    views.centre_x[k], views.centre_y[k] = to_world(views, seen.found.box_x[at], seen.found.box_y[at])
    views.length[k], views.width[k] = seen.found.box_length[at], seen.found.box_width[at]
    views.chord[k], views.near[k] = seen.found.width[at], seen.found.r_min[at]
    visibility = seen.found.visibility[at]
    views.start[k] = views.end[k] = HIDDEN
    if visibility in (FULL, END_HIDDEN):
        # A known difference means that the neighbour has a range, a farther one.
        views.start[k] = OWN if seen.found.s_i[at] == seen.found.s_i[at] else OPEN
    if visibility in (FULL, START_HIDDEN):
        views.end[k] = OWN if seen.found.s_f[at] == seen.found.s_f[at] else OPEN
    _add_points(views, seen, scans, at)
    place_sensor(views, 0.0)
    views.count += 1


def _add_points(views: Views, seen: Seen, scans: Scans, at: int) -> None:
    """Add the points of an object, and the lines of its faces."""
    k = views.count
    n, f = views.begin[k], views.face_begin[k]
    face, last_face = seen.found.face_offsets[at], seen.found.face_offsets[at + 1]
    first = position_of(views, seen.found.beam_f[at] if views.reverse else seen.found.beam_i[at])
    last = position_of(views, seen.found.beam_i[at] if views.reverse else seen.found.beam_f[at])
    if last < first:
        last += views.bearings
    cos, sin = math.cos(seen.found.box_yaw[at]), math.sin(seen.found.box_yaw[at])
    beside = BOX_MARGIN + 4.0 * views.sigma
    half_length = 0.5 * seen.found.box_length[at] + beside
    half_width = 0.5 * seen.found.box_width[at] + beside
    begin = views.row * scans.width
    directions = scans.direction[views.row] * scans.width
    views.face_first[f] = n
    for position in range(first, last + 1):
        k = position - views.bearings if position >= views.bearings else position
        beam = views.bearings - 1 - k if views.reverse else k
        r = scans.ranges[begin + beam]
        if r != r or n >= 2 * views.bearings:
            continue
        x, y = r * scans.cos[directions + k], r * scans.sin[directions + k]
        dx, dy = x - seen.found.box_x[at], y - seen.found.box_y[at]
        if abs(dx * cos + dy * sin) > half_length or abs(dy * cos - dx * sin) > half_width:
            continue
        theta = views.first + views.step * position
        while face < last_face and theta > seen.found.face_theta_f[face] + 0.25 * views.step:
            f = _end_face(views, f, n)
            face += 1
        # Beams of an object across the seam were taken at the end and at the start of the sweep.
        place_sensor(views, beam / (1.0 * max(views.bearings - 1, 1)))
        views.point_x[n], views.point_y[n] = to_world(views, x, y)
        n += 1
    place_sensor(views, views.share[views.count])
    if face < last_face:
        f = _end_face(views, f, n)
    if n == views.begin[views.count]:
        # Without points, as among too many objects that overlap, its middle stands for it.
        views.point_x[n], views.point_y[n] = views.middle_x[views.count], views.middle_y[views.count]
        n += 1
    views.begin[views.count + 1], views.face_begin[views.count + 1] = n, f


def _end_face(views: Views, f: int, n: int) -> int:
    """Fit a line to the points of a face, which ends before point n; return the index of the next face."""
    first = views.face_first[f]
    count = n - first
    views.face_first[f + 1] = n
    if count < LEAST_FACE_POINTS:
        views.face_first[f] = n
        return f
    mean_x, mean_y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, n):
        mean_x += views.point_x[p]
        mean_y += views.point_y[p]
    mean_x, mean_y = mean_x / count, mean_y / count
    for p in range(first, n):
        dx, dy = views.point_x[p] - mean_x, views.point_y[p] - mean_y
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    half = 0.5 * math.atan2(2.0 * xy, xx - yy)
    along_x, along_y = math.cos(half), math.sin(half)
    low = (views.point_x[first] - mean_x) * along_x + (views.point_y[first] - mean_y) * along_y
    high = (views.point_x[n - 1] - mean_x) * along_x + (views.point_y[n - 1] - mean_y) * along_y
    if high < low:
        along_x, along_y, low, high = -along_x, -along_y, -low, -high
    views.face_x[f], views.face_y[f] = mean_x, mean_y
    views.along_x[f], views.along_y[f] = along_x, along_y
    views.face_points[f], views.extent[f] = count, high - low
    spread = math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    views.bulge[f] = max(0.5 * (xx + yy) - spread, 0.0)
    views.face_last[f] = n - 1
    return f + 1


class Memory:
    """The latest `SWEEPS_KEPT` sweeps and the poses of the sensor; the newest replaces the oldest."""

    def __init__(self, beams: int) -> None:
        """Make room for sweeps of so many beams."""
        self.owner: list[Any] = []
        self.beams = beams
        self.count = 0
        """Number of sweeps that were remembered so far."""
        self.time = native.doubles(self.owner, SWEEPS_KEPT)
        self.x = native.doubles(self.owner, SWEEPS_KEPT)
        self.y = native.doubles(self.owner, SWEEPS_KEPT)
        self.cos = native.doubles(self.owner, SWEEPS_KEPT)
        self.sin = native.doubles(self.owner, SWEEPS_KEPT)
        self.side = native.doubles(self.owner, SWEEPS_KEPT)
        self.first = native.doubles(self.owner, SWEEPS_KEPT)
        self.step = native.doubles(self.owner, SWEEPS_KEPT)
        self.bearings = native.integers(self.owner, SWEEPS_KEPT)
        self.period = native.integers(self.owner, SWEEPS_KEPT)
        self.sigma = native.doubles(self.owner, SWEEPS_KEPT)
        self.r = native.singles(self.owner, SWEEPS_KEPT * beams)
        self.changes = 0.0
        """Mean number of beams that change between a range and no return from sweep to sweep."""
        self.lost = 0.0
        """Mean number of beams without a return in either sweep."""
        self.status = native.integers(self.owner, beams)
        """Status of each beam in the sweep before."""
        self.watched = 0
        self.before = 0
        """Number of beams of the sweep before."""

    def grow(self, old: Memory) -> None:
        """Copy the sweeps of a smaller memory."""
        copy_memory(self, old)


def copy_memory(memory: Memory, old: Memory) -> None:
    """Copy the sweeps of a smaller memory."""
    memory.count, memory.changes, memory.lost = old.count, old.changes, old.lost
    memory.watched, memory.before = old.watched, old.before
    for beam in range(old.before):
        memory.status[beam] = old.status[beam]
    for m in range(SWEEPS_KEPT):
        memory.time[m], memory.x[m], memory.y[m] = old.time[m], old.x[m], old.y[m]
        memory.cos[m], memory.sin[m], memory.side[m] = old.cos[m], old.sin[m], old.side[m]
        memory.first[m], memory.step[m], memory.sigma[m] = old.first[m], old.step[m], old.sigma[m]
        memory.bearings[m], memory.period[m] = old.bearings[m], old.period[m]
        for k in range(old.bearings[m]):
            memory.r[m * memory.beams + k] = old.r[m * old.beams + k]


def count_flicker(memory: Memory, views: Views, scans: Scans) -> None:
    """Count the beams that change between a range and no return."""
    begin, beams = views.row * scans.width, scans.beams[views.row]
    changes, lost = 0, 0
    if memory.before == beams:
        for beam in range(beams):
            now, then = scans.status[begin + beam], memory.status[beam]
            if now == NO_RETURN or then == NO_RETURN:
                lost += 1
                if now + then == NO_RETURN:
                    changes += 1
        # At first a plain mean of all sweeps so far.
        memory.watched += 1
        share = max(FLICKER_WEIGHT, 1.0 / memory.watched)
        memory.changes += share * (changes - memory.changes)
        memory.lost += share * (lost - memory.lost)
    for beam in range(beams):
        memory.status[beam] = scans.status[begin + beam]
    memory.before = beams


def is_steady(memory: Memory) -> bool:
    """Return whether beams without a return prove free space."""
    return memory.changes <= MOST_FLICKER_SHARE * memory.lost


def range_at(views: Views, scans: Scans, position: int) -> float:
    """Return the range of the beam at a position [m]; `FREE_RANGE` for free space, `NO_RANGE` if unknown."""
    if views.period > 0:
        # C and Python disagree about remainders of negative numbers.
        position = (position + views.period) % views.period
    if position < 0 or position >= views.bearings:
        return NO_RANGE
    beam = views.row * scans.width + (views.bearings - 1 - position if views.reverse else position)
    if scans.status[beam] == VALID:
        return scans.ranges[beam]
    return FREE_RANGE if views.steady and scans.status[beam] == NO_RETURN else NO_RANGE


def remember(memory: Memory, views: Views, scans: Scans, time: float) -> None:
    """Remember a sweep, unless the last one is too recent."""
    last = (memory.count + SWEEPS_KEPT - 1) % SWEEPS_KEPT
    if memory.count > 0 and 0.0 <= time - memory.time[last] < SWEEPS_APART:
        return
    m = memory.count % SWEEPS_KEPT
    memory.time[m] = time
    # The pose in the middle of the sweep stands for all of its beams.
    place_sensor(views, 0.5)
    memory.x[m], memory.y[m], memory.cos[m], memory.sin[m] = views.x, views.y, views.cos, views.sin
    place_sensor(views, 0.0)
    memory.side[m], memory.first[m], memory.step[m] = views.side, views.first, views.step
    memory.bearings[m], memory.period[m], memory.sigma[m] = views.bearings, views.period, views.sigma
    for k in range(views.bearings):
        memory.r[m * memory.beams + k] = range_at(views, scans, k)
    memory.count += 1


def was_hit(memory: Memory, m: int, x: float, y: float) -> bool:
    """Return whether a beam of a remembered sweep ended at a point of the world."""
    dx, dy = x - memory.x[m], y - memory.y[m]
    ahead = memory.cos[m] * dx + memory.sin[m] * dy
    left = memory.side[m] * (memory.cos[m] * dy - memory.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    past = math.atan2(left, ahead) - memory.first[m]
    past -= TURN * math.floor(past / TURN)
    if memory.step[m] < LEAST_STEP:
        return False
    at = int(past / memory.step[m] + 0.5)
    if memory.period[m] > 0:
        at %= memory.period[m]
    if at >= memory.bearings[m]:
        return False
    return abs(memory.r[m * memory.beams + at] - r) < HIT_MARGIN + 2.0 * memory.sigma[m]


def was_passed(memory: Memory, m: int, x: float, y: float, beside: float) -> bool:
    """Return whether all four beams around a point of the world passed it, in a remembered sweep.

    `beside`: least distance by which they end behind it [m]; noise and the spacing of beams come on top.
    """
    dx, dy = x - memory.x[m], y - memory.y[m]
    ahead = memory.cos[m] * dx + memory.sin[m] * dy
    left = memory.side[m] * (memory.cos[m] * dy - memory.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    # Angle past the first bearing, within a turn.
    past = math.atan2(left, ahead) - memory.first[m]
    past -= TURN * math.floor(past / TURN)
    if memory.step[m] < LEAST_STEP:
        return False
    position = int(past / memory.step[m])
    need = r + beside + 3.5 * memory.sigma[m] + r * memory.step[m]
    for k in range(position - 1, position + 3):
        at = (k + memory.period[m]) % memory.period[m] if memory.period[m] > 0 else k
        if at < 0 or at >= memory.bearings[m] or memory.r[m * memory.beams + at] < need:
            return False
    return True
