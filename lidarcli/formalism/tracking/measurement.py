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


class Detections:
    """Columns of a detection of K objects, and the poses of its S sweeps, for the loops over one sweep."""

    def __init__(self, found: Detection, poses: Any, seconds: Any, motion: Any, shares: Any, placed: Bool) -> None:
        """
        Parameters
        ----------
        found : result of `detect`
        poses : (S, 4) x, y, yaw, side of the sensor; the side is -1 where it hangs head down
        seconds : (S,) times of the sweeps [s]
        motion : (S, 3) motion of the sensor in x, y, yaw during each sweep
        shares : (K,) share of the time of its sweep that had passed when each object was seen
        placed : (S,) True where the place of the sensor is known
        """
        arrays = {name: np.require(getattr(found, name), COLUMNS[name].dtype, ["C", "A"]) for name in REQUIRED}
        change = np.full(len(found), -1, np.int8) if found.change is None else found.change
        offset = np.searchsorted(found.row, np.arange(len(found.noise) + 1)).astype(np.int64)
        numbers = (poses, seconds, motion, shares)
        more = [np.require(values, np.float64, ["C", "A"]) for values in numbers]
        marks = [(change == REMOVED).astype(np.uint8), placed.astype(np.uint8)]
        self.owner: list[Any] = [offset, *marks, *more, arrays]
        self.max_objects = int(np.diff(offset).max(initial=0))
        """Greatest number of objects in one sweep."""
        self.found = native.pointers(arrays)
        """The arrays of the detection."""
        self.offset = native.at_longs(self.owner[0])
        self.removed = native.at_bytes(self.owner[1])
        self.placed = native.at_bytes(self.owner[2])
        self.poses = native.at_doubles(self.owner[3])
        self.seconds = native.at_doubles(self.owner[4])
        self.motion = native.at_doubles(self.owner[5])
        self.shares = native.at_doubles(self.owner[6])


class Measurements:
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
        self.motion_x = 0.0
        self.motion_y = 0.0
        self.motion_yaw = 0.0
        self.moves = False
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


def extract(measurements: Measurements, detections: Detections, scans: Scans, row: int) -> None:
    """Fill in the views of the sweep in a row of a batch; `x`, `y`, `cos` and `sin` hold the pose of the sensor."""
    _set_bearings(measurements, detections, scans, row)
    measurements.count = 0
    measurements.begin[0] = measurements.face_begin[0] = 0
    for at in range(detections.offset[row], detections.offset[row + 1]):
        if detections.found.set[at] == OBJECT and not detections.removed[at]:
            _add_measurement(measurements, detections, scans, at)


def classify_edges(measurements: Measurements) -> None:
    """Make edges beside beams without a return the object's own, if such beams prove free space."""
    for k in range(measurements.count):
        if measurements.steady and measurements.start[k] == OPEN:
            measurements.start[k] = OWN
        if measurements.steady and measurements.end[k] == OPEN:
            measurements.end[k] = OWN


def pose_variance(measurements: Measurements, k: int) -> float:
    """Return the variance of the points of a view from the error of the pose [m²]."""
    return measurements.pose_var + measurements.pose_turn_var * measurements.near[k] * measurements.near[k]


def is_partial(measurements: Measurements, k: int) -> bool:
    """Return whether a view may not reach both ends of an object."""
    return measurements.start[k] != OWN or measurements.end[k] != OWN


def _set_bearings(measurements: Measurements, detections: Detections, scans: Scans, row: int) -> None:
    """Set the bearings of the beams."""
    increment = scans.angle_increment[row]
    measurements.row = row
    measurements.bearings = scans.beams[row] - (scans.closure[row] == SHARED)
    measurements.period = 0 if scans.closure[row] == OPEN_VIEW else measurements.bearings
    measurements.reverse = increment < 0
    measurements.step = abs(increment)
    measurements.first = scans.angle_min[row]
    if measurements.reverse:
        measurements.first += (measurements.bearings - 1) * increment
    measurements.side = detections.poses[4 * row + 3]
    measurements.is_placed = detections.placed[row] != 0
    measurements.sigma = detections.found.noise[row]


def place_sensor(measurements: Measurements, share: float) -> None:
    """Set the pose of the sensor to that after a share of the time of the sweep."""
    if not measurements.moves:
        return
    yaw = measurements.start_yaw + share * measurements.motion_yaw
    measurements.x, measurements.y = (
        measurements.start_x + share * measurements.motion_x,
        measurements.start_y + share * measurements.motion_y,
    )
    measurements.cos, measurements.sin = math.cos(yaw), math.sin(yaw)


def to_world(measurements: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the sensor frame in the world [m]."""
    left = measurements.side * y
    return (
        measurements.x + measurements.cos * x - measurements.sin * left,
        measurements.y + measurements.sin * x + measurements.cos * left,
    )


def to_sensor(measurements: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the sensor frame [m], at the time when the sensor looked there."""
    ahead, left = _ahead_and_left(measurements, x, y)
    if measurements.moves and measurements.bearings > 1 and measurements.step > 0.0:
        angle = math.atan2(left, ahead) - measurements.first
        angle -= TURN * math.floor(angle / TURN)
        share = min(angle / (measurements.step * (measurements.bearings - 1)), 1.0)
        place_sensor(measurements, 1.0 - share if measurements.reverse else share)
        ahead, left = _ahead_and_left(measurements, x, y)
        place_sensor(measurements, 0.0)
    return ahead, left


def _ahead_and_left(measurements: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the frame of the current pose of the sensor [m]."""
    dx, dy = x - measurements.x, y - measurements.y
    return measurements.cos * dx + measurements.sin * dy, measurements.side * (
        measurements.cos * dy - measurements.sin * dx
    )


def position_of(measurements: Measurements, beam: int) -> int:
    """Return the index of a beam by increasing bearing."""
    return measurements.bearings - 1 - beam if measurements.reverse else beam


def _add_measurement(measurements: Measurements, detections: Detections, scans: Scans, at: int) -> None:
    """Add the view of an object."""
    k = measurements.count
    measurements.share[k] = detections.shares[at]
    place_sensor(measurements, measurements.share[k])
    measurements.object[k], measurements.shape[k], measurements.size[k] = (
        at,
        detections.found.shape[at],
        detections.found.beams[at],
    )
    measurements.middle_x[k], measurements.middle_y[k] = to_world(
        measurements, detections.found.x[at], detections.found.y[at]
    )
    measurements.centre_x[k], measurements.centre_y[k] = to_world(
        measurements, detections.found.box_x[at], detections.found.box_y[at]
    )
    measurements.length[k], measurements.width[k] = detections.found.box_length[at], detections.found.box_width[at]
    measurements.chord[k], measurements.near[k] = detections.found.width[at], detections.found.r_min[at]
    visibility = detections.found.visibility[at]
    measurements.start[k] = measurements.end[k] = HIDDEN
    if visibility in (FULL, END_HIDDEN):
        # A known difference means that the neighbour has a range, a farther one.
        measurements.start[k] = OWN if detections.found.s_i[at] == detections.found.s_i[at] else OPEN
    if visibility in (FULL, START_HIDDEN):
        measurements.end[k] = OWN if detections.found.s_f[at] == detections.found.s_f[at] else OPEN
    _add_points(measurements, detections, scans, at)
    place_sensor(measurements, 0.0)
    measurements.count += 1


def _add_points(measurements: Measurements, detections: Detections, scans: Scans, at: int) -> None:
    """Add the points of an object, and the lines of its faces."""
    k = measurements.count
    n, f = measurements.begin[k], measurements.face_begin[k]
    face, last_face = detections.found.face_offsets[at], detections.found.face_offsets[at + 1]
    first = position_of(measurements, detections.found.beam_f[at] if measurements.reverse else detections.found.beam_i[at])
    last = position_of(measurements, detections.found.beam_i[at] if measurements.reverse else detections.found.beam_f[at])
    if last < first:
        last += measurements.bearings
    cos, sin = math.cos(detections.found.box_yaw[at]), math.sin(detections.found.box_yaw[at])
    beside = BOX_MARGIN + 4.0 * measurements.sigma
    half_length = 0.5 * detections.found.box_length[at] + beside
    half_width = 0.5 * detections.found.box_width[at] + beside
    begin = measurements.row * scans.width
    directions = scans.direction[measurements.row] * scans.width
    measurements.face_first[f] = n
    for position in range(first, last + 1):
        k = position - measurements.bearings if position >= measurements.bearings else position
        beam = measurements.bearings - 1 - k if measurements.reverse else k
        r = scans.ranges[begin + beam]
        if r != r or n >= 2 * measurements.bearings:
            continue
        x, y = r * scans.cos[directions + k], r * scans.sin[directions + k]
        dx, dy = x - detections.found.box_x[at], y - detections.found.box_y[at]
        if abs(dx * cos + dy * sin) > half_length or abs(dy * cos - dx * sin) > half_width:
            continue
        theta = measurements.first + measurements.step * position
        while face < last_face and theta > detections.found.face_theta_f[face] + 0.25 * measurements.step:
            f = _end_face(measurements, f, n)
            face += 1
        # Beams of an object across the seam were taken at the end and at the start of the sweep.
        place_sensor(measurements, beam / (1.0 * max(measurements.bearings - 1, 1)))
        measurements.point_x[n], measurements.point_y[n] = to_world(measurements, x, y)
        n += 1
    place_sensor(measurements, measurements.share[measurements.count])
    if face < last_face:
        f = _end_face(measurements, f, n)
    if n == measurements.begin[measurements.count]:
        # Without points, as among too many objects that overlap, its middle stands for it.
        measurements.point_x[n], measurements.point_y[n] = (
            measurements.middle_x[measurements.count],
            measurements.middle_y[measurements.count],
        )
        n += 1
    measurements.begin[measurements.count + 1], measurements.face_begin[measurements.count + 1] = n, f


def _end_face(measurements: Measurements, f: int, n: int) -> int:
    """Fit a line to the points of a face, which ends before point n; return the index of the next face."""
    first = measurements.face_first[f]
    count = n - first
    measurements.face_first[f + 1] = n
    if count < LEAST_FACE_POINTS:
        measurements.face_first[f] = n
        return f
    mean_x, mean_y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, n):
        mean_x += measurements.point_x[p]
        mean_y += measurements.point_y[p]
    mean_x, mean_y = mean_x / count, mean_y / count
    for p in range(first, n):
        dx, dy = measurements.point_x[p] - mean_x, measurements.point_y[p] - mean_y
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    half = 0.5 * math.atan2(2.0 * xy, xx - yy)
    along_x, along_y = math.cos(half), math.sin(half)
    low = (measurements.point_x[first] - mean_x) * along_x + (measurements.point_y[first] - mean_y) * along_y
    high = (measurements.point_x[n - 1] - mean_x) * along_x + (measurements.point_y[n - 1] - mean_y) * along_y
    if high < low:
        along_x, along_y, low, high = -along_x, -along_y, -low, -high
    measurements.face_x[f], measurements.face_y[f] = mean_x, mean_y
    measurements.along_x[f], measurements.along_y[f] = along_x, along_y
    measurements.face_points[f], measurements.extent[f] = count, high - low
    spread = math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    measurements.bulge[f] = max(0.5 * (xx + yy) - spread, 0.0)
    measurements.face_last[f] = n - 1
    return f + 1


class RangeHistory:
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

    def grow(self, old: RangeHistory) -> None:
        """Copy the sweeps of a smaller memory."""
        copy_memory(self, old)


def copy_memory(history: RangeHistory, old: RangeHistory) -> None:
    """Copy the sweeps of a smaller memory."""
    history.count, history.changes, history.lost = old.count, old.changes, old.lost
    history.watched, history.before = old.watched, old.before
    for beam in range(old.before):
        history.status[beam] = old.status[beam]
    for m in range(SWEEPS_KEPT):
        history.time[m], history.x[m], history.y[m] = old.time[m], old.x[m], old.y[m]
        history.cos[m], history.sin[m], history.side[m] = old.cos[m], old.sin[m], old.side[m]
        history.first[m], history.step[m], history.sigma[m] = old.first[m], old.step[m], old.sigma[m]
        history.bearings[m], history.period[m] = old.bearings[m], old.period[m]
        for k in range(old.bearings[m]):
            history.r[m * history.beams + k] = old.r[m * old.beams + k]


def count_flicker(history: RangeHistory, measurements: Measurements, scans: Scans) -> None:
    """Count the beams that change between a range and no return."""
    begin, beams = measurements.row * scans.width, scans.beams[measurements.row]
    changes, lost = 0, 0
    if history.before == beams:
        for beam in range(beams):
            now, then = scans.status[begin + beam], history.status[beam]
            if now == NO_RETURN or then == NO_RETURN:
                lost += 1
                if now + then == NO_RETURN:
                    changes += 1
        # At first a plain mean of all sweeps so far.
        history.watched += 1
        share = max(FLICKER_WEIGHT, 1.0 / history.watched)
        history.changes += share * (changes - history.changes)
        history.lost += share * (lost - history.lost)
    for beam in range(beams):
        history.status[beam] = scans.status[begin + beam]
    history.before = beams


def is_steady(history: RangeHistory) -> bool:
    """Return whether beams without a return prove free space."""
    return history.changes <= MOST_FLICKER_SHARE * history.lost


def range_at(measurements: Measurements, scans: Scans, position: int) -> float:
    """Return the range of the beam at a position [m]; `FREE_RANGE` for free space, `NO_RANGE` if unknown."""
    if measurements.period > 0:
        # C and Python disagree about remainders of negative numbers.
        position = (position + measurements.period) % measurements.period
    if position < 0 or position >= measurements.bearings:
        return NO_RANGE
    beam = measurements.row * scans.width + (measurements.bearings - 1 - position if measurements.reverse else position)
    if scans.status[beam] == VALID:
        return scans.ranges[beam]
    return FREE_RANGE if measurements.steady and scans.status[beam] == NO_RETURN else NO_RANGE


def store_sweep(history: RangeHistory, measurements: Measurements, scans: Scans, time: float) -> None:
    """Remember a sweep, unless the last one is too recent."""
    last = (history.count + SWEEPS_KEPT - 1) % SWEEPS_KEPT
    if history.count > 0 and 0.0 <= time - history.time[last] < SWEEPS_APART:
        return
    m = history.count % SWEEPS_KEPT
    history.time[m] = time
    # The pose in the middle of the sweep stands for all of its beams.
    place_sensor(measurements, 0.5)
    history.x[m], history.y[m], history.cos[m], history.sin[m] = (
        measurements.x,
        measurements.y,
        measurements.cos,
        measurements.sin,
    )
    place_sensor(measurements, 0.0)
    history.side[m], history.first[m], history.step[m] = measurements.side, measurements.first, measurements.step
    history.bearings[m], history.period[m], history.sigma[m] = (
        measurements.bearings,
        measurements.period,
        measurements.sigma,
    )
    for k in range(measurements.bearings):
        history.r[m * history.beams + k] = range_at(measurements, scans, k)
    history.count += 1


def was_hit(history: RangeHistory, m: int, x: float, y: float) -> bool:
    """Return whether a beam of a remembered sweep ended at a point of the world."""
    dx, dy = x - history.x[m], y - history.y[m]
    ahead = history.cos[m] * dx + history.sin[m] * dy
    left = history.side[m] * (history.cos[m] * dy - history.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    angle = math.atan2(left, ahead) - history.first[m]
    angle -= TURN * math.floor(angle / TURN)
    if history.step[m] < LEAST_STEP:
        return False
    at = int(angle / history.step[m] + 0.5)
    if history.period[m] > 0:
        at %= history.period[m]
    if at >= history.bearings[m]:
        return False
    return abs(history.r[m * history.beams + at] - r) < HIT_MARGIN + 2.0 * history.sigma[m]


def was_passed(history: RangeHistory, m: int, x: float, y: float, beside: float) -> bool:
    """Return whether all four beams around a point of the world passed it, in a remembered sweep.

    `beside`: least distance by which they end behind it [m]; noise and the spacing of beams come on top.
    """
    dx, dy = x - history.x[m], y - history.y[m]
    ahead = history.cos[m] * dx + history.sin[m] * dy
    left = history.side[m] * (history.cos[m] * dy - history.sin[m] * dx)
    r = math.sqrt(ahead * ahead + left * left)
    # Angle past the first bearing, within a turn.
    angle = math.atan2(left, ahead) - history.first[m]
    angle -= TURN * math.floor(angle / TURN)
    if history.step[m] < LEAST_STEP:
        return False
    position = int(angle / history.step[m])
    need = r + beside + 3.5 * history.sigma[m] + r * history.step[m]
    for k in range(position - 1, position + 3):
        at = (k + history.period[m]) % history.period[m] if history.period[m] > 0 else k
        if at < 0 or at >= history.bearings[m] or history.r[m * history.beams + at] < need:
            return False
    return True
