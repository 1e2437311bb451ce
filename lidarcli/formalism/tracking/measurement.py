"""Measurements of one sweep: objects with points, faces and edges in the world frame, and what they measure of a target.

A measurement gives the sides of a target along its axes. A side that faces the sensor is where its face is, and a side
that ends in view is where its edge is. Of any other side the last point is only a lower bound.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli.formalism import detection
from lidarcli.formalism.detection import COLUMNS, REQUIRED, Detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.sweeps import types
from lidarcli.sweeps.types import Bool
from lidarcli.system import native

OBJECT, REMOVED = detection.OBJECT, detection.REMOVED
ROUND, LEGGED = detection.ROUND, detection.LEGGED
FULL, START_HIDDEN, END_HIDDEN, CUT = (detection.FULL, detection.START_HIDDEN, detection.END_HIDDEN, detection.CUT)
OPEN_VIEW, SHARED = types.Closure.OPEN.value, types.Closure.SHARED.value
VALID, NO_RETURN = types.Status.VALID.value, types.Status.NO_RETURN.value
TURN = types.TURN
HIDDEN, OPEN, OWN = 0, 1, 2
"""Kinds of edges: hidden by a nearer object or the end of the view; next to beams without a return; the object's own."""
BOX_MARGIN = 0.05
"""[m] Points outside of the box by more than this, and four times the noise, belong to an object between its parts."""
MIN_FACE_POINTS = 3
"""Least number of points for the line of a face."""
MIN_STEP = 1e-6
"""[rad] Beams that are closer together than this are not distinguished."""
NO_RANGE, FREE_RANGE, MAX_RANGE = -1.0, 1e9, 1e8
"""Range of a beam without information, and of one without a return, which may prove free space; what is more than the last
one is no range [m]."""
AT_LEAST = -1.0
"""Mark in place of a variance: the side goes on at least so far."""
COS_ALONG = math.cos(math.radians(20.0))
"""Cosine of the greatest angle between the normal of a face and that of the side it belongs to."""
SIN_BEHIND = math.sin(math.radians(10.0))
"""Sine of an angle: a side that looks away from the sensor by more may go on behind the last point."""
END_MARGIN = 0.03
"""[m] An end of the points that is this close to the outermost point ends the side."""
SURFACE_VAR = 1.6e-5
"""[m²] Least variance of a side, for the roughness of surfaces and the error of scanners: (4 mm)²."""
CROOKED_SHARE = 0.25
"""Share of the mean squared distance of points from their face that adds to the variance of its place."""
RAGGED_SHARE = 0.12
"""Standard deviation of the middle of an object without faces, as a share of its size."""
OPEN_EDGE_VAR = 0.01
"""[m²] Variance of an edge next to beams that come and go: (10 cm)²."""
LEGGED_VAR = 0.0081
"""[m²] Variance of the middle of a group of legs: (9 cm)²."""


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
        shares : (K,) share of the time of its sweep that had passed when each object was observed
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
    """The `count` measurements of one sweep. Measurement k has points `begin[k]` to `begin[k + 1]` - 1; faces likewise."""

    def __init__(self, objects: int, beams: int) -> None:
        """Make room for so many objects and beams of a sweep."""
        self.owner: list[Any] = []
        self.objects = objects
        self.beams = beams
        self.count = 0
        # Pose of the sensor at the first beam, and its motion until the last one.
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
        """True if the place of the sensor is known: then a target is one object from sweep to sweep."""
        self.first = 0.0
        self.step = 0.0
        self.bearings = 0
        self.period = 0
        self.reverse = False
        self.row = 0
        self.time = 0.0
        """Time of the sweep [s]."""
        self.travelled = 0.0
        """Distance that the sensor has gone so far [m]."""
        self.sweep = 0
        """Number of sweeps before it."""
        self.sensor = 0
        """Index of the sensor, of those that are followed together."""
        self.sigma = 0.0
        self.steady = True
        """True if beams without a return prove free space."""
        self.farthest = 0.0
        """Greatest range of the sensor so far [m]."""
        self.pose_var = 0.0
        self.pose_turn_var = 0.0
        """Variance of a point from the error of the pose [m²], and its growth with the squared range [m²/m²]."""
        # Of each measurement.
        self.object = native.integers(self.owner, objects)
        """Index of the object in the detection."""
        self.assigned = native.integers(self.owner, objects)
        """Slot of its target; -1 for none, -2 - slot for a fragment of that target."""
        self.sighting = native.integers(self.owner, objects)
        """Its index among the sightings that are recorded; -1 for none."""
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
        """Share of the time of the sweep that had passed when it was observed."""
        self.begin = native.integers(self.owner, objects + 1)
        self.face_begin = native.integers(self.owner, objects + 1)
        # Of each point.
        self.point_x = native.doubles(self.owner, 2 * beams + objects)
        self.point_y = native.doubles(self.owner, 2 * beams + objects)
        # Of each face: a point of its line, its direction counter-clockwise as observed by the sensor, how many points.
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


def extract(meas: Measurements, detections: Detections, scans: Scans, row: int) -> None:
    """Fill in the measurements of the sweep in a row of a batch; `x`, `y`, `cos` and `sin` hold the pose of the sensor."""
    _set_bearings(meas, detections, scans, row)
    meas.count = 0
    meas.begin[0] = meas.face_begin[0] = 0
    for at in range(detections.offset[row], detections.offset[row + 1]):
        if detections.found.set[at] == OBJECT and not detections.removed[at]:
            _add_measurement(meas, detections, scans, at)


def classify_edges(meas: Measurements) -> None:
    """Make edges next to beams without a return the object's own, if such beams prove free space."""
    for k in range(meas.count):
        if meas.steady and meas.start[k] == OPEN:
            meas.start[k] = OWN
        if meas.steady and meas.end[k] == OPEN:
            meas.end[k] = OWN


def pose_variance(meas: Measurements, k: int) -> float:
    """Return the variance of the points of a measurement from the error of the pose [m²]."""
    return meas.pose_var + meas.pose_turn_var * meas.near[k] * meas.near[k]


def is_partial(meas: Measurements, k: int) -> bool:
    """Return whether a measurement may not reach both ends of an object."""
    return meas.start[k] != OWN or meas.end[k] != OWN


def _set_bearings(meas: Measurements, detections: Detections, scans: Scans, row: int) -> None:
    """Set the bearings of the beams."""
    increment = scans.angle_increment[row]
    meas.row = row
    meas.bearings = scans.beams[row] - (scans.closure[row] == SHARED)
    meas.period = 0 if scans.closure[row] == OPEN_VIEW else meas.bearings
    meas.reverse = increment < 0
    meas.step = abs(increment)
    meas.first = scans.angle_min[row]
    if meas.reverse:
        meas.first += (meas.bearings - 1) * increment
    meas.side = detections.poses[4 * row + 3]
    meas.is_placed = detections.placed[row] != 0
    meas.sigma = detections.found.noise[row]


def place_sensor(meas: Measurements, share: float) -> None:
    """Set the pose of the sensor to that after a share of the time of the sweep."""
    if not meas.moves:
        return
    yaw = meas.start_yaw + share * meas.motion_yaw
    meas.x, meas.y = (meas.start_x + share * meas.motion_x, meas.start_y + share * meas.motion_y)
    meas.cos, meas.sin = math.cos(yaw), math.sin(yaw)


def to_world(meas: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the sensor frame in the world [m]."""
    left = meas.side * y
    return (meas.x + meas.cos * x - meas.sin * left, meas.y + meas.sin * x + meas.cos * left)


def to_sensor(meas: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the sensor frame [m], at the time when the sensor looked there."""
    ahead, left = ahead_and_left(meas, x, y)
    if meas.moves and meas.bearings > 1 and meas.step > 0.0:
        angle = angle_past_first(meas, ahead, left)
        share = min(angle / (meas.step * (meas.bearings - 1)), 1.0)
        place_sensor(meas, 1.0 - share if meas.reverse else share)
        ahead, left = ahead_and_left(meas, x, y)
        place_sensor(meas, 0.0)
    return ahead, left


def angle_past_first(meas: Measurements, ahead: float, left: float) -> float:
    """Return the angle of a point of the sensor frame past the first bearing, within a turn [rad]."""
    angle = math.atan2(left, ahead) - meas.first
    return angle - TURN * math.floor(angle / TURN)


def ahead_and_left(meas: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the frame of the current pose of the sensor [m]."""
    dx, dy = x - meas.x, y - meas.y
    return meas.cos * dx + meas.sin * dy, meas.side * (meas.cos * dy - meas.sin * dx)


def position_of(meas: Measurements, beam: int) -> int:
    """Return the index of a beam by increasing bearing, or the beam at such an index."""
    return meas.bearings - 1 - beam if meas.reverse else beam


def _add_measurement(meas: Measurements, detections: Detections, scans: Scans, at: int) -> None:
    """Add the measurement of an object."""
    k = meas.count
    meas.share[k] = detections.shares[at]
    place_sensor(meas, meas.share[k])
    meas.object[k], meas.shape[k], meas.size[k] = (at, detections.found.shape[at], detections.found.beams[at])
    meas.middle_x[k], meas.middle_y[k] = to_world(meas, detections.found.x[at], detections.found.y[at])
    meas.centre_x[k], meas.centre_y[k] = to_world(meas, detections.found.box_x[at], detections.found.box_y[at])
    meas.length[k], meas.width[k] = detections.found.box_length[at], detections.found.box_width[at]
    meas.chord[k], meas.near[k] = detections.found.width[at], detections.found.r_min[at]
    visibility = detections.found.visibility[at]
    meas.start[k] = meas.end[k] = HIDDEN
    if visibility in (FULL, END_HIDDEN):
        # A known difference means that the neighbour has a range, a farther one.
        meas.start[k] = OWN if detections.found.s_i[at] == detections.found.s_i[at] else OPEN
    if visibility in (FULL, START_HIDDEN):
        meas.end[k] = OWN if detections.found.s_f[at] == detections.found.s_f[at] else OPEN
    _add_points(meas, detections, scans, at)
    place_sensor(meas, 0.0)
    meas.count += 1


def _add_points(meas: Measurements, detections: Detections, scans: Scans, at: int) -> None:
    """Add the points of an object, and the lines of its faces."""
    k = meas.count
    n, f = meas.begin[k], meas.face_begin[k]
    face, last_face = detections.found.face_offsets[at], detections.found.face_offsets[at + 1]
    first = position_of(meas, detections.found.beam_f[at] if meas.reverse else detections.found.beam_i[at])
    last = position_of(meas, detections.found.beam_i[at] if meas.reverse else detections.found.beam_f[at])
    if last < first:
        last += meas.bearings
    cos, sin = math.cos(detections.found.box_yaw[at]), math.sin(detections.found.box_yaw[at])
    margin = BOX_MARGIN + 4.0 * meas.sigma
    half_length = 0.5 * detections.found.box_length[at] + margin
    half_width = 0.5 * detections.found.box_width[at] + margin
    begin = meas.row * scans.width
    directions = scans.direction[meas.row] * scans.width
    meas.face_first[f] = n
    for position in range(first, last + 1):
        k = position - meas.bearings if position >= meas.bearings else position
        beam = position_of(meas, k)
        r = scans.ranges[begin + beam]
        if r != r or n >= 2 * meas.bearings:
            continue
        x, y = r * scans.cos[directions + k], r * scans.sin[directions + k]
        dx, dy = x - detections.found.box_x[at], y - detections.found.box_y[at]
        if abs(dx * cos + dy * sin) > half_length or abs(dy * cos - dx * sin) > half_width:
            continue
        theta = meas.first + meas.step * position
        while face < last_face and theta > detections.found.face_theta_f[face] + 0.25 * meas.step:
            f = _end_face(meas, f, n)
            face += 1
        # Beams of an object across the seam were taken at the end and at the start of the sweep.
        place_sensor(meas, beam / (1.0 * max(meas.bearings - 1, 1)))
        meas.point_x[n], meas.point_y[n] = to_world(meas, x, y)
        n += 1
    place_sensor(meas, meas.share[meas.count])
    if face < last_face:
        f = _end_face(meas, f, n)
    if n == meas.begin[meas.count]:
        # Without points, as among too many objects that overlap, its middle stands for it.
        meas.point_x[n], meas.point_y[n] = (meas.middle_x[meas.count], meas.middle_y[meas.count])
        n += 1
    meas.begin[meas.count + 1], meas.face_begin[meas.count + 1] = n, f


def _end_face(meas: Measurements, f: int, n: int) -> int:
    """Fit a line to the points of a face, which ends before point n; return the index of the next face."""
    first = meas.face_first[f]
    count = n - first
    meas.face_first[f + 1] = n
    if count < MIN_FACE_POINTS:
        meas.face_first[f] = n
        return f
    mean_x, mean_y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, n):
        mean_x += meas.point_x[p]
        mean_y += meas.point_y[p]
    mean_x, mean_y = mean_x / count, mean_y / count
    for p in range(first, n):
        dx, dy = meas.point_x[p] - mean_x, meas.point_y[p] - mean_y
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    half = 0.5 * math.atan2(2.0 * xy, xx - yy)
    along_x, along_y = math.cos(half), math.sin(half)
    low = (meas.point_x[first] - mean_x) * along_x + (meas.point_y[first] - mean_y) * along_y
    high = (meas.point_x[n - 1] - mean_x) * along_x + (meas.point_y[n - 1] - mean_y) * along_y
    if high < low:
        along_x, along_y, low, high = -along_x, -along_y, -low, -high
    meas.face_x[f], meas.face_y[f] = mean_x, mean_y
    meas.along_x[f], meas.along_y[f] = along_x, along_y
    meas.face_points[f], meas.extent[f] = count, high - low
    spread = math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    meas.bulge[f] = max(0.5 * (xx + yy) - spread, 0.0)
    meas.face_last[f] = n - 1
    return f + 1


def range_at(meas: Measurements, scans: Scans, position: int) -> float:
    """Return the range of the beam at a position [m]; `FREE_RANGE` for free space, `NO_RANGE` if unknown."""
    if meas.period > 0:
        # C and Python disagree about remainders of negative numbers.
        position = (position + meas.period) % meas.period
    if position < 0 or position >= meas.bearings:
        return NO_RANGE
    beam = meas.row * scans.width + (meas.bearings - 1 - position if meas.reverse else position)
    if scans.status[beam] == VALID:
        return scans.ranges[beam]
    return FREE_RANGE if meas.steady and scans.status[beam] == NO_RETURN else NO_RANGE


class EdgeMeasurement:
    """Measured sides 0 to 3 of a target (axis 0 low and high, axis 1 low and high), or its centre."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.z = native.doubles(self.owner, 4)
        """Place of each side along its axis [m]."""
        self.var = native.doubles(self.owner, 4)
        """Variance of that place [m²], or `AT_LEAST`."""
        self.by_centre = False
        """True if z[0] and z[2] are the centre of a disc; then `half` is its radius with the variance `half_var`."""
        self.lasting_var = 0.0
        """Variance of the centre that more sightings do not reduce, as they see the same ragged outline [m²]."""
        self.is_doubtful = False
        """True if the centre is that of returns which come and go."""
        self.half = 0.0
        self.half_var = 0.0


def measure_box(sides: EdgeMeasurement, meas: Measurements, k: int, cos: float, sin: float, pose_var: float) -> None:
    """Measure the sides of a rectangle whose first axis has the direction cos, sin."""
    sides.by_centre = False
    place_sensor(meas, meas.share[k])
    first, last = meas.begin[k], meas.begin[k + 1] - 1
    for side in range(4):
        sides.var[side] = AT_LEAST
    for p in range(first, last + 1):
        along = cos * meas.point_x[p] + sin * meas.point_y[p]
        across = cos * meas.point_y[p] - sin * meas.point_x[p]
        if p == first:
            sides.z[0] = sides.z[1] = along
            sides.z[2] = sides.z[3] = across
        sides.z[0], sides.z[1] = min(sides.z[0], along), max(sides.z[1], along)
        sides.z[2], sides.z[3] = min(sides.z[2], across), max(sides.z[3], across)
    own_start = meas.start[k] != HIDDEN
    own_end = meas.end[k] != HIDDEN
    if own_start:
        _measure_end(sides, meas, k, first, -1.0, cos, sin, pose_var + _edge_doubt(meas.start[k]))
    if own_end:
        _measure_end(sides, meas, k, last, 1.0, cos, sin, pose_var + _edge_doubt(meas.end[k]))
    for f in range(meas.face_begin[k], meas.face_begin[k + 1]):
        _measure_face(sides, meas, f, cos, sin, pose_var)
    place_sensor(meas, 0.0)


def _edge_doubt(edge: int) -> float:
    """Return the variance to add for an edge next to beams without a return that come and go [m²]."""
    return OPEN_EDGE_VAR if edge == OPEN else 0.0


def _measure_face(sides: EdgeMeasurement, meas: Measurements, f: int, cos: float, sin: float, pose_var: float) -> None:
    """Measure the near side of an axis by a face."""
    x, y = meas.face_x[f], meas.face_y[f]
    normal_x, normal_y = meas.along_y[f], -meas.along_x[f]
    if normal_x * (meas.x - x) + normal_y * (meas.y - y) < 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    along, across = cos * normal_x + sin * normal_y, cos * normal_y - sin * normal_x
    var = meas.sigma * meas.sigma / meas.face_points[f] + SURFACE_VAR + pose_var
    # A crooked face is not exactly where its line is.
    var += CROOKED_SHARE * meas.bulge[f] / meas.face_points[f]
    if abs(along) > COS_ALONG:
        side = 1 if along > 0.0 else 0
        sides.z[side], sides.var[side] = cos * x + sin * y, var
    elif abs(across) > COS_ALONG:
        side = 3 if across > 0.0 else 2
        sides.z[side], sides.var[side] = cos * y - sin * x, var


def _measure_end(
    sides: EdgeMeasurement, meas: Measurements, k: int, p: int, outwards: float, cos: float, sin: float, pose_var: float
) -> None:
    """Measure the sides that end at an edge, half a beam past the last point on average."""
    x, y = meas.point_x[p], meas.point_y[p]
    far_x, far_y = x - meas.x, y - meas.y
    r = math.sqrt(far_x * far_x + far_y * far_y)
    if r <= 0.0:
        return
    far_x, far_y = far_x / r, far_y / r
    # Outwards, in the direction of the bearings.
    outwards *= meas.side
    out_x, out_y = -outwards * far_y, outwards * far_x
    # The face that ends there, if any.
    face = -1
    for f in range(meas.face_begin[k], meas.face_begin[k + 1]):
        if meas.face_first[f] == p or meas.face_last[f] == p:
            face = f
    for side in range(4):
        u_x, u_y = (cos, sin) if side < 2 else (-sin, cos)
        if side == 0 or side == 2:
            u_x, u_y = -u_x, -u_y
        sign = 1.0 if side == 1 or side == 3 else -1.0
        if u_x * x + u_y * y < sign * sides.z[side] - END_MARGIN:
            continue
        if face >= 0 and abs(meas.along_x[face] * u_x + meas.along_y[face] * u_y) > COS_ALONG:
            gap = meas.extent[face] / (meas.face_points[face] - 1)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + SURFACE_VAR + pose_var
        elif u_x * far_x + u_y * far_y <= SIN_BEHIND:
            gap = max(u_x * out_x + u_y * out_y, 0.0) * r * meas.step
            depth = meas.sigma * (u_x * far_x + u_y * far_y)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + depth * depth + SURFACE_VAR + pose_var


def measure_disc(
    sides: EdgeMeasurement, meas: Measurements, k: int, radius: float, radius_var: float, pose_var: float
) -> None:
    """Measure the centre of a disc, in the axes of the world.

    Parameters
    ----------
    radius, radius_var : estimate of its radius and variance [m, m²]; a negative variance without an estimate
    """
    sides.by_centre = True
    place_sensor(meas, meas.share[k])
    first, last = meas.begin[k], meas.begin[k + 1] - 1
    sigma = meas.sigma
    own_start = meas.start[k] != HIDDEN
    own_end = meas.end[k] != HIDDEN
    first_x, first_y = _unit_vector(meas, meas.point_x[first], meas.point_y[first])
    last_x, last_y = _unit_vector(meas, meas.point_x[last], meas.point_y[last])
    near = meas.near[k]
    half_angle = 0.5 * (
        math.atan2(abs(first_x * last_y - first_y * last_x), first_x * last_x + first_y * last_y) + meas.step
    )
    gap = near * meas.step
    sine = math.sin(min(half_angle, 1.2))
    visible_radius = near * sine / (1.0 - sine)
    visible_radius = min(visible_radius, 0.6 * max(meas.length[k], meas.chord[k]) + gap)
    sides.half_var = AT_LEAST
    if own_start and own_end:
        sides.half, sides.half_var = (
            visible_radius,
            gap * gap / 24.0 + SURFACE_VAR + RAGGED_SHARE * RAGGED_SHARE * visible_radius * visible_radius,
        )
    if radius_var < 0.0:
        radius, radius_var = visible_radius, 0.0025
        if sides.half_var >= 0.0:
            radius_var = sides.half_var
    mid_x, mid_y = first_x + last_x, first_y + last_y
    norm = math.sqrt(mid_x * mid_x + mid_y * mid_y)
    if norm > 0.0:
        mid_x, mid_y = mid_x / norm, mid_y / norm
    else:
        mid_x, mid_y = first_x, first_y
    across_var = 0.0
    if own_start and own_end:
        across_var = gap * gap / 24.0
    elif own_start or own_end:
        # The centre is a radius away from the edge that is its own.
        inwards = math.asin(min(radius / (near + radius), 1.0)) - 0.5 * meas.step
        if own_start:
            mid_x, mid_y = _rotated(first_x, first_y, meas.side * inwards)
        else:
            mid_x, mid_y = _rotated(last_x, last_y, -meas.side * inwards)
        across_var = gap * gap / 12.0 + radius_var
    else:
        across_var = 0.25 * meas.chord[k] * meas.chord[k] + radius_var + 0.01
    centre_x, centre_y = meas.x + mid_x * (near + radius), meas.y + mid_y * (near + radius)
    depth_var = sigma * sigma + radius_var
    if meas.shape[k] == ROUND and own_start and own_end:
        centre_x, centre_y = meas.centre_x[k], meas.centre_y[k]
        sides.half = 0.5 * meas.length[k]
        sides.half_var = 4.0 * sigma * sigma / meas.size[k] + SURFACE_VAR
        depth_var = sides.half_var
    elif meas.shape[k] == LEGGED:
        centre_x, centre_y = meas.middle_x[k], meas.middle_y[k]
        depth_var = across_var = LEGGED_VAR
    ragged = 0.0 if meas.shape[k] == ROUND else RAGGED_SHARE * meas.length[k]
    sides.lasting_var = ragged * ragged
    more = SURFACE_VAR + pose_var + sides.lasting_var
    across_var += more
    # The arc of a round object gives its middle, wherever the arc ends.
    sides.is_doubtful = meas.shape[k] != ROUND and (meas.start[k] == OPEN or meas.end[k] == OPEN)
    if sides.is_doubtful:
        across_var += _edge_doubt(meas.start[k]) + _edge_doubt(meas.end[k])
    depth_var += more
    sides.z[0] = sides.z[1] = centre_x
    sides.z[2] = sides.z[3] = centre_y
    sides.var[0] = sides.var[1] = mid_x * mid_x * depth_var + mid_y * mid_y * across_var
    sides.var[2] = sides.var[3] = mid_y * mid_y * depth_var + mid_x * mid_x * across_var
    place_sensor(meas, 0.0)


def _unit_vector(meas: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return the unit vector from the sensor to a point."""
    dx, dy = x - meas.x, y - meas.y
    r = math.sqrt(dx * dx + dy * dy)
    return (dx / r, dy / r) if r > 0.0 else (1.0, 0.0)


def _rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y
