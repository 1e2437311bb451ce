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
from lidarcli.formalism.tracking import association, kalman, measurement, results, track_evidence
from lidarcli.formalism.tracking.association import Assignment, Candidates, Persons
from lidarcli.formalism.tracking.kalman import EdgeMeasurement, Sightings, Targets
from lidarcli.formalism.tracking.measurement import Detections, Measurements, RangeHistory

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


class SweepTracker:
    """State of the tracking after the latest sweep of a topic."""

    def __init__(
        self, motion_threshold: float, targets: Targets, measurements: Measurements, range_history: RangeHistory
    ) -> None:
        """`alarm`: least evidence of motion of a body that moves [log-odds]."""
        self.owner: list[Any] = []
        self.motion_threshold = motion_threshold
        self.time = 0.0
        self.stamp = 0.0
        self.sweeps = 0
        self.objects = 0
        """Number of objects of all batches before the current one."""
        self.travelled = 0.0
        """Way of the sensor since the sweep before [m]."""
        self.rotated = 0.0
        """Turn of the sensor since the sweep before [rad]."""
        self.elapsed = 0.0
        """Time since the last sweep with a pose [s]."""
        self.typical_dt = 0.1
        """Usual time from sweep to sweep [s]."""
        self.sides = EdgeMeasurement()
        self.sightings = Sightings()
        self.pose_error = PoseErrorFilter()
        self.moves = False
        """True if the log has poses of the sensor."""
        self.resize(targets, measurements, range_history)

    def resize(self, targets: Targets, measurements: Measurements, range_history: RangeHistory) -> None:
        """Continue with larger arrays."""
        self.targets = targets
        self.measurements = measurements
        self.range_history = range_history
        self.candidates = Candidates(targets.capacity, measurements.objects)
        self.assignment = Assignment(targets.capacity, measurements.objects)
        self.persons = Persons(measurements.objects)
        self.assigned_buffer: list[Any] = []
        self.assigned = native.integers(self.assigned_buffer, measurements.objects)

    def process(self, detections: Detections, scans: Scans, row: int, stop: int, track_ids: Any) -> int:
        """Take the sweeps from a row on; return the first row for which there is no room, or `stop`.

        Parameters
        ----------
        seen, scans : objects and beams of the batch
        row, stop : rows of the batch
        number : (K,) int64 to fill in: number of the body of each object, 0 for none
        """
        out = native.at_longs(track_ids)
        lock = native.release()
        while row < stop and has_capacity(self, detections, row):
            step(self, detections, scans, row, out)
            row += 1
        native.resume(lock)
        return row


def has_capacity(tracker: SweepTracker, detections: Detections, row: int) -> bool:
    """Return whether there is room if all objects of a sweep are new bodies."""
    objects = detections.offset[row + 1] - detections.offset[row]
    return (
        tracker.targets.slots_used + 2 * objects <= tracker.targets.capacity
        and objects <= tracker.measurements.objects
        and tracker.sightings.count + objects <= tracker.sightings.capacity
    )


def step(tracker: SweepTracker, detections: Detections, scans: Scans, row: int, track_ids: Any) -> None:
    """Take one sweep: predict, associate, update, end."""
    for at in range(detections.offset[row], detections.offset[row + 1]):
        track_ids[at] = 0
    tracker.elapsed += _advance_clock(tracker, detections.seconds[row])
    tracker.sweeps += 1
    if detections.poses[4 * row] != detections.poses[4 * row]:
        return
    # Time since the last sweep with a pose.
    dt = tracker.elapsed
    tracker.elapsed = 0.0
    _correct_sensor_pose(tracker, detections, row, dt)
    measurement.extract(tracker.measurements, detections, scans, row)
    measurement.count_flicker(tracker.range_history, tracker.measurements, scans)
    tracker.measurements.steady = measurement.is_steady(tracker.range_history)
    measurement.classify_edges(tracker.measurements)
    for b in range(tracker.targets.slots_used):
        if tracker.targets.state[b] == kalman.LIVE:
            kalman.predict(tracker.targets, b, dt, _drift_variance(tracker, b))
    association.associate(
        tracker.candidates, tracker.assignment, tracker.sides, tracker.targets, tracker.measurements, tracker.assigned
    )
    association.merge_fragments(tracker.targets, tracker.measurements, tracker.assigned)
    for k in range(tracker.measurements.count):
        tracker.persons.entry[k] = -1
    for b in range(tracker.targets.slots_used):
        if tracker.targets.state[b] != kalman.LIVE or tracker.targets.kind[b] == kalman.PERSON:
            continue
        if tracker.targets.measurement[b] >= 0:
            _update(tracker, tracker.targets, tracker.measurements, scans, b, tracker.targets.measurement[b])
        else:
            track_evidence.record_miss(tracker.targets, b, tracker.measurements, scans, tracker.time)
            if tracker.targets.moved[b] == 0:
                kalman.hold_still(tracker.targets, b)
    for k in range(tracker.measurements.count):
        if tracker.assigned[k] == -1:
            tracker.assigned[k] = _initiate(tracker, tracker.targets, tracker.measurements, k)
        elif tracker.assigned[k] < -1:
            tracker.assigned[k] = -2 - tracker.assigned[k]
    association.track_persons(
        tracker.persons,
        tracker.targets,
        tracker.measurements,
        scans,
        tracker.assigned,
        tracker.sightings,
        tracker.time,
        tracker.sweeps - 1,
    )
    for k in range(tracker.measurements.count):
        track_ids[tracker.measurements.object[k]] = tracker.targets.number[tracker.assigned[k]]
    apply_pose_error(tracker.pose_error, tracker.targets)
    measurement.store_sweep(tracker.range_history, tracker.measurements, scans, tracker.time)


def _advance_clock(tracker: SweepTracker, stamp: float) -> float:
    """Advance the clock to the stamp of a sweep [s], and return by how much; it never goes back."""
    dt = 0.0
    if tracker.sweeps > 0:
        dt = stamp - tracker.stamp
        if dt < 0.0:
            dt = tracker.typical_dt
        elif dt > MOST_PAUSE:
            dt = MOST_PAUSE
        elif 0.0 < dt < 1.0:
            tracker.typical_dt += 0.05 * (dt - tracker.typical_dt)
    tracker.stamp = stamp
    tracker.time += dt
    return dt


def _correct_sensor_pose(tracker: SweepTracker, detections: Detections, row: int, dt: float) -> None:
    """Set the pose of the sensor at a sweep, corrected by the estimated error."""
    x, y, yaw = detections.poses[4 * row], detections.poses[4 * row + 1], detections.poses[4 * row + 2]
    tracker.travelled = tracker.rotated = tracker.pose_error.speed_x = tracker.pose_error.speed_y = (
        tracker.pose_error.turning
    ) = 0.0
    if tracker.moves and tracker.pose_error.has_pose and dt > 0.0:
        dx, dy, rotated = (x - tracker.pose_error.last[0], y - tracker.pose_error.last[1], yaw - tracker.pose_error.last[2])
        rotated -= measurement.TURN * math.floor(rotated / measurement.TURN + 0.5)
        tracker.travelled, tracker.rotated = math.sqrt(dx * dx + dy * dy), abs(rotated)
        if dt >= SHORTEST_STEP:
            tracker.pose_error.speed_x, tracker.pose_error.speed_y = dx / dt, dy / dt
            tracker.pose_error.turning = rotated / dt
    tracker.pose_error.last[0], tracker.pose_error.last[1], tracker.pose_error.last[2], tracker.pose_error.has_pose = (
        x,
        y,
        yaw,
        True,
    )
    tracker.pose_error.travelled += tracker.travelled
    at = 3 * row
    tracker.measurements.motion_x, tracker.measurements.motion_y = detections.motion[at], detections.motion[at + 1]
    tracker.measurements.motion_yaw = detections.motion[at + 2]
    tracker.measurements.moves = (
        detections.motion[at] != 0.0 or detections.motion[at + 1] != 0.0 or detections.motion[at + 2] != 0.0
    )
    correct_pose(tracker.pose_error, tracker.measurements, x, y, yaw, detections.poses[4 * row + 3])


def _drift_variance(tracker: SweepTracker, b: int) -> float:
    """Return the variance by which a standing body seems to move, because poses drift as the sensor moves [m²]."""
    dx, dy = tracker.targets.from_x[b] - tracker.measurements.x, tracker.targets.from_y[b] - tracker.measurements.y
    distance2 = min(dx * dx + dy * dy, FARTHEST_DRIFT * FARTHEST_DRIFT)
    return tracker.travelled * (POSE_DRIFT + YAW_DRIFT * distance2) + tracker.rotated * TURN_DRIFT * distance2


def _initiate(tracker: SweepTracker, targets: Targets, measurements: Measurements, k: int) -> int:
    """Begin a new body with a view that no body took; return its slot."""
    b = kalman.allocate(targets)
    kalman.reset(targets, b)
    targets.first_sweep[b] = targets.last_sweep[b] = tracker.sweeps - 1
    targets.existence[b] = track_evidence.EXISTENCE_AT_FIRST
    targets.first_time[b] = targets.last_time[b] = tracker.time
    if _is_boxy(measurements, k):
        _make_box(tracker, targets, measurements, b, k)
    else:
        _make_disc(tracker, targets, measurements, b, k)
    # A new body inside of a known one may be a piece of it.
    x, y = kalman.centre(targets, b)
    other = track_evidence.covering_target(
        targets, b, x, y, association.PART_MARGIN if measurement.is_partial(measurements, k) else 0.0
    )
    if other >= 0:
        targets.same_as[b] = targets.number[other]
    _count_measurement(tracker, targets, measurements, b, k)
    track_evidence.mark_rest(targets, b, tracker.sweeps - 1)
    return b


def _make_box(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Make a body a box, by a view."""
    targets.kind[b], targets.kind_hits[b] = kalman.BOX, 0
    yaw, var = _face_direction(measurements, k)
    targets.yaw[b], targets.yaw_rate[b] = yaw, 0.0
    targets.yaw_var[b], targets.yaw_cov[b] = var, 0.0
    targets.rate_var[b] = kalman.TURN_RATE_SD * kalman.TURN_RATE_SD
    targets.cos[b], targets.sin[b] = math.cos(yaw), math.sin(yaw)
    pose_var = measurement.pose_variance(measurements, k)
    kalman.measure_box(tracker.sides, measurements, k, targets.cos[b], targets.sin[b], pose_var)
    for i in range(2):
        kalman.initiate_axis(
            targets,
            2 * b + i,
            tracker.sides.z[2 * i],
            tracker.sides.z[2 * i + 1],
            tracker.sides.var[2 * i],
            tracker.sides.var[2 * i + 1],
        )
    _initiate_jacobian(tracker, targets, measurements, b, k)


def _make_disc(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Make a body a disc, by a view; its axes are those of the world."""
    targets.kind[b] = kalman.DISC
    pose_var = measurement.pose_variance(measurements, k)
    kalman.measure_disc(tracker.sides, measurements, k, 0.0, kalman.AT_LEAST, pose_var)
    half, half_var = max(0.5 * measurements.chord[k], 0.02), 0.01
    if tracker.sides.half_var >= 0.0:
        half, half_var = tracker.sides.half, tracker.sides.half_var
    for i in range(2):
        a, var = 2 * b + i, tracker.sides.var[2 * i]
        c = tracker.sides.z[2 * i]
        kalman.initiate_axis(targets, a, c - half, c + half, 2.0 * var, 2.0 * var)
        targets.hh[a], targets.ch[a] = half_var, 0.0
        kalman.reset_static(targets, a)
    _initiate_jacobian(tracker, targets, measurements, b, k)


def _initiate_jacobian(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Let a new body depend on the whole error of the pose of its sweep."""
    for i in range(2):
        u_x, u_y = kalman.to_world(targets, b, 1.0 - i, 1.0 * i)
        set_jacobian(tracker.pose_error, measurements, measurements.middle_x[k], measurements.middle_y[k], u_x, u_y, i)
        mix_jacobian(tracker.pose_error, targets, 2 * b + i, 1.0, i)


def _face_direction(measurements: Measurements, k: int) -> tuple[float, float]:
    """Return the direction of the longest face of a view [rad] and its variance, negative without a face that is good."""
    best = -1
    for f in range(measurements.face_begin[k], measurements.face_begin[k + 1]):
        if measurements.face_points[f] >= YAW_POINTS and (best < 0 or measurements.extent[f] > measurements.extent[best]):
            best = f
    if best < 0:
        first, last = measurements.begin[k], measurements.begin[k + 1] - 1
        return (
            math.atan2(
                measurements.point_y[last] - measurements.point_y[first],
                measurements.point_x[last] - measurements.point_x[first],
            ),
            -1.0,
        )
    length = max(measurements.extent[best], 0.01)
    var = 12.0 * measurements.sigma * measurements.sigma / (measurements.face_points[best] * length * length)
    return math.atan2(measurements.along_y[best], measurements.along_x[best]), var + LEAST_YAW_VAR


def _update(tracker: SweepTracker, targets: Targets, measurements: Measurements, scans: Scans, b: int, k: int) -> None:
    """Update a body with its view."""
    if targets.kind[b] == kalman.DISC:
        _try_box(tracker, targets, measurements, b, k)
    if targets.kind[b] == kalman.BOX:
        yaw, var = _face_direction(measurements, k)
        if var >= 0.0:
            kalman.update_yaw(targets, b, yaw, var)
    pose_var = measurement.pose_variance(measurements, k)
    kalman.measure(tracker.sides, measurements, k, targets, b, pose_var)
    is_whole = not measurement.is_partial(measurements, k)
    track_evidence.update_motion_evidence(targets, b, tracker.sides, is_whole)
    if tracker.moves:
        _observe_pose_error(tracker, targets, measurements, b, k)
    if tracker.sides.by_centre:
        _update_disc(targets, tracker.sides, tracker.pose_error, b)
    else:
        _update_box(targets, tracker.sides, tracker.pose_error, b)
    if is_whole and measurements.size[k] >= SIZE_BEAMS:
        diagonal = math.sqrt(
            measurements.length[k] * measurements.length[k] + measurements.width[k] * measurements.width[k]
        )
        targets.whole[b] += 1
        targets.size[b] += (diagonal - targets.size[b]) / min(targets.whole[b], 20)
    track_evidence.record_hit(targets, b)
    _count_measurement(tracker, targets, measurements, b, k)
    track_evidence.detect_legs(targets, b, measurements, k, scans)
    if targets.moved[b] == 0:
        track_evidence.mark_rest(targets, b, tracker.sweeps - 1)
        if track_evidence.is_moving(
            targets, b, measurements, scans, k, tracker.range_history, tracker.motion_threshold, tracker.time
        ):
            targets.moved[b] = 1


def _is_boxy(measurements: Measurements, k: int) -> bool:
    """Return whether a view shows a box well enough."""
    return (
        measurements.shape[k] == PRISMATIC and measurements.size[k] >= BOX_BEAMS and measurements.length[k] >= SLIMMEST_BOX
    )


def _try_box(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Make a disc a box once it was seen as one several times; its velocity stays."""
    if not _is_boxy(measurements, k):
        return
    targets.boxy[b] += 1
    if targets.boxy[b] < BOX_SIGHTINGS or measurement.is_partial(measurements, k):
        return
    v_x, v_y, var = targets.v[2 * b], targets.v[2 * b + 1], targets.vv[2 * b]
    _make_box(tracker, targets, measurements, b, k)
    targets.v[2 * b], targets.v[2 * b + 1] = kalman.to_axes(targets, b, v_x, v_y)
    targets.vv[2 * b] = targets.vv[2 * b + 1] = var
    targets.evidence[b] = 0.0
    targets.side_weight[2 * b] = targets.side_weight[2 * b + 1] = 0.0


def _observe_pose_error(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Learn the error of the poses from the sides of a body that stands."""
    tells = targets.moved[b] == 0 and targets.kind_hits[b] >= POSE_SIGHTINGS and targets.evidence[b] < MOST_POSE_EVIDENCE
    for i in range(2):
        u_x, u_y = kalman.to_world(targets, b, 1.0 - i, 1.0 * i)
        a = 2 * b + i
        set_jacobian(tracker.pose_error, measurements, measurements.middle_x[k], measurements.middle_y[k], u_x, u_y, i)
        for side in range(2 * i, 2 * i + 2):
            if not tells or tracker.sides.var[side] < 0.0 or (tracker.sides.by_centre and side > 2 * i):
                continue
            sign = 0.0 if tracker.sides.by_centre else (1.0 if side > 2 * i else -1.0)
            off, var = kalman.static_residual(targets, a, tracker.sides.z[side], sign, tracker.sides.var[side])
            update_pose_error(tracker.pose_error, targets, a, off, var, i)


def _update_disc(targets: Targets, sides: EdgeMeasurement, pose_error: PoseErrorFilter, b: int) -> None:
    """Update a disc with its measured centre and radius."""
    for i in range(2):
        a = 2 * b + i
        kalman.update(targets, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        gain = kalman.update_static(targets, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        mix_jacobian(pose_error, targets, a, gain, i)
        if sides.half_var >= 0.0:
            kalman.update_extent(targets, a, sides.half, sides.half_var)
            _average_extent(targets, a, 2.0 * sides.half, 4.0 * sides.half_var)


def _update_box(targets: Targets, sides: EdgeMeasurement, pose_error: PoseErrorFilter, b: int) -> None:
    """Update a box with its measured sides."""
    for i in range(2):
        a = 2 * b + i
        for side in range(2 * i, 2 * i + 2):
            sign = 1.0 if side == 2 * i + 1 else -1.0
            z, var = sides.z[side], sides.var[side]
            if var < 0.0:
                # The side goes on at least so far.
                if sign * (z - targets.c[a]) > targets.h[a] + PAST_SIDE:
                    kalman.update(targets, a, z, sign, AT_LEAST_VAR)
                    gain = kalman.update_static(targets, a, z, sign, AT_LEAST_VAR)
                    mix_jacobian(pose_error, targets, a, gain, i)
                continue
            kalman.update(targets, a, z, sign, var)
            gain = kalman.update_static(targets, a, z, sign, var)
            mix_jacobian(pose_error, targets, a, gain, i)
        length = sides.z[2 * i + 1] - sides.z[2 * i]
        if sides.var[2 * i] >= 0.0 and sides.var[2 * i + 1] >= 0.0:
            _average_extent(targets, a, length, sides.var[2 * i] + sides.var[2 * i + 1])
        targets.least[a] = max(targets.least[a], length - 2.0 * PAST_SIDE)


def _average_extent(targets: Targets, a: int, length: float, var: float) -> None:
    """Add an extent that was seen from end to end to its mean; one that differs much counts little."""
    length = max(length, 0.0)
    weight = 1.0 / (var + EXTENT_VAR)
    if targets.side_weight[a] > 0.0:
        off = length - targets.side[a]
        weight /= 1.0 + off * off / (SIZE_OUTLIER + var)
    targets.side_weight[a] += weight
    targets.side[a] += weight / targets.side_weight[a] * (length - targets.side[a])


def _count_measurement(tracker: SweepTracker, targets: Targets, measurements: Measurements, b: int, k: int) -> None:
    """Note that a body was seen, and log the sighting."""
    targets.measurement[b] = k
    targets.sightings[b] += 1
    targets.kind_hits[b] += 1
    targets.last_sweep[b] = tracker.sweeps - 1
    targets.last_time[b] = tracker.time
    targets.middle_x[b], targets.middle_y[b] = measurements.middle_x[k], measurements.middle_y[k]
    targets.from_x[b], targets.from_y[b] = kalman.centre(targets, b)
    track_evidence.vote_shape(targets, b, measurements, k)
    tracker.persons.entry[k] = tracker.sightings.count
    kalman.record_sighting(
        tracker.sightings,
        targets,
        b,
        tracker.sides,
        measurements,
        k,
        tracker.sweeps - 1,
        tracker.time,
        tracker.objects + measurements.object[k],
    )


class PoseErrorFilter:
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
        self.travelled = 0.0
        """Way of the sensor so far [m]."""
        self.jacobian = native.doubles(self.owner, 6)
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


def correct_pose(
    pose_error: PoseErrorFilter, measurements: Measurements, x: float, y: float, yaw: float, side: float
) -> None:
    """Set the pose of the sensor for a pose x, y, yaw of the log, and its variance."""
    late = pose_error.value[DELAY]
    yaw += pose_error.turning * late
    measurements.cos, measurements.sin = math.cos(yaw), math.sin(yaw)
    ahead, left = pose_error.value[AHEAD], side * pose_error.value[LEFT]
    measurements.x = x + pose_error.speed_x * late + measurements.cos * ahead - measurements.sin * left
    measurements.y = y + pose_error.speed_y * late + measurements.sin * ahead + measurements.cos * left
    measurements.start_x, measurements.start_y, measurements.start_yaw = measurements.x, measurements.y, yaw
    var = pose_error.cov[0]
    speed = pose_error.speed_x * pose_error.speed_x + pose_error.speed_y * pose_error.speed_y
    measurements.pose_var, measurements.pose_turn_var = speed * var, pose_error.turning * pose_error.turning * var


def set_jacobian(
    pose_error: PoseErrorFilter, measurements: Measurements, x: float, y: float, u_x: float, u_y: float, axis: int
) -> None:
    """Fill in `effect`: the derivative of a point x, y along a direction u, for each of the three numbers."""
    dx, dy = x - measurements.x, y - measurements.y
    moved_x = pose_error.speed_x - pose_error.turning * dy
    moved_y = pose_error.speed_y + pose_error.turning * dx
    pose_error.jacobian[3 * axis + DELAY] = -(u_x * moved_x + u_y * moved_y)
    pose_error.jacobian[3 * axis + AHEAD] = -(u_x * measurements.cos + u_y * measurements.sin)
    pose_error.jacobian[3 * axis + LEFT] = -measurements.side * (u_y * measurements.cos - u_x * measurements.sin)


def update_pose_error(pose_error: PoseErrorFilter, targets: Targets, a: int, off: float, var: float, axis: int) -> None:
    """Update the estimate with the residual of a side of a standing body [m] along axis a, after `set_effect`."""
    s = var + POSE_SIDE_VAR
    expected = 0.0
    for i in range(3):
        pose_error.product[i] = 0.0
        for j in range(3):
            pose_error.product[i] += pose_error.cov[3 * i + j] * (
                pose_error.jacobian[3 * axis + j] - targets.jacobian[3 * a + j]
            )
    for i in range(3):
        s += pose_error.product[i] * (pose_error.jacobian[3 * axis + i] - targets.jacobian[3 * a + i])
        expected += (pose_error.jacobian[3 * axis + i] - targets.jacobian[3 * a + i]) * (pose_error.change[i])
    off -= expected
    if off * off > MOST_POSE_RESIDUAL * s:
        return
    for i in range(3):
        pose_error.change[i] += pose_error.product[i] / s * off
    for i in range(3):
        for j in range(3):
            pose_error.cov[3 * i + j] -= pose_error.product[i] * pose_error.product[j] / s
    pose_error.cov[0] = max(pose_error.cov[0], LEAST_DELAY_VAR)
    pose_error.cov[4] = max(pose_error.cov[4], LEAST_PLACE_VAR)
    pose_error.cov[8] = max(pose_error.cov[8], LEAST_PLACE_VAR)


def mix_jacobian(pose_error: PoseErrorFilter, targets: Targets, a: int, gain: float, axis: int) -> None:
    """Mix the effect of a measurement into that of the twin, with the gain of its update."""
    # Where the extent is not known the gain of the centre may be any; what is mixed again and again would grow for ever.
    gain = min(max(gain, 0.0), 1.0)
    for i in range(3):
        at = 3 * a + i
        targets.jacobian[at] += gain * (pose_error.jacobian[3 * axis + i] - targets.jacobian[at])


def apply_pose_error(pose_error: PoseErrorFilter, targets: Targets) -> None:
    """Correct all bodies by what was learned from a sweep, and the poses from now on."""
    if pose_error.change[0] == 0.0 and pose_error.change[1] == 0.0 and pose_error.change[2] == 0.0:
        return
    for b in range(targets.slots_used):
        if targets.state[b] != kalman.LIVE:
            continue
        for a in range(2 * b, 2 * b + 2):
            shift = 0.0
            for i in range(3):
                shift += targets.jacobian[3 * a + i] * pose_error.change[i]
            targets.c[a] -= shift
            targets.static_c[a] -= shift
    for i in range(3):
        pose_error.value[i] += pose_error.change[i]
        pose_error.change[i] = 0.0
    pose_error.value[DELAY] = min(max(pose_error.value[DELAY], -MOST_DELAY), MOST_DELAY)
