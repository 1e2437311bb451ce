"""The tracker of one sensor, or of several in one world, sweep after sweep: predict, associate, update or miss, initiate.

`kalman` holds the filters of the targets, `pose_filter` that of the error of the poses, `measurement` what a sweep measures
of the targets; `association` assigns measurements to them, `track_evidence` weighs whether a target moves and exists.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import association, kalman, keyframes, measurement, pose_filter, results, track_evidence
from lidarcli.formalism.tracking.association import Candidates, Persons
from lidarcli.formalism.tracking.kalman import Sightings, Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import Detections, EdgeMeasurement, Measurements
from lidarcli.formalism.tracking.pose_filter import PoseErrorFilter
from lidarcli.system import native

PRISMATIC, UNKNOWN = detection.PRISMATIC, detection.UNKNOWN
SIZE_OUTLIER = results.SIZE_OUTLIER
BOX_BEAMS, SLIMMEST_BOX, BOX_SIGHTINGS = 8, 0.2, 3
"""Least number of beams and least length [m] of a measurement that makes a box, as legs look alike from all sides, and
sightings as a box that make one of a disc."""
SIZE_BEAMS = 5
"""Least number of beams of a measurement that measures the size of a target."""
YAW_POINTS, MIN_YAW_VAR = 5, 7e-4
"""Least number of points of a face that measures the direction of its target, and least variance of that [rad²]:
(1.5°)²."""
FARTHEST_DRIFT = 100.0
"""[m] Distance from which on the error of the heading does not shift targets further."""
POSE_DRIFT, YAW_DRIFT = 2e-4, 4e-5
"""[m²/m], [rad²/m] Growth of the variances of a pose as the sensor moves: (1.4 cm)² and (0.36 degrees)² on a metre."""
TURN_DRIFT = 1e-4
"""[rad²/rad] Growth of the variance of the heading as the sensor turns."""
PAST_SIDE, AT_LEAST_VAR = 0.02, 9e-4
"""A point so far past a side moves it [m]; variance of a side that goes on at least so far [m²]: (3 cm)²."""
SHORTEST_STEP, MAX_PAUSE = 1e-3, 60.0
"""[s] Least time between two sweeps that tells the speed of the sensor, as stamps may be equal or a nanosecond apart, and
longest pause; a longer one counts as this."""
EXTENT_VAR = 1e-4
"""[m²] Variance that is added to each measured extent: (1 cm)²."""
POSE_SIGHTINGS, MAX_POSE_EVIDENCE = 5, 3.0
"""Least number of sightings of a target that measures the error of the poses, and its greatest evidence of motion [log-
odds]."""


class SweepTracker:
    """State of the tracker after the latest sweep."""

    def __init__(self, targets: Targets, meas: Measurements, frames: Keyframes) -> None:
        self.owner: list[Any] = []
        self.time = 0.0
        self.stamp = 0.0
        self.sweeps = 0
        self.seen = 0
        """Number of objects of all sweeps so far."""
        self.objects = 0
        """The same before the first row of the batch, if there were no other batch."""
        self.sensor = 0
        """Index of the sensor whose sweeps are processed."""
        self.travelled = 0.0
        """Distance that the robot went since the sweep before [m]."""
        self.rotated = 0.0
        """Turn of the robot since the sweep before [rad]."""
        self.elapsed = 0.0
        """Time since the last sweep with a pose [s]."""
        self.typical_dt = 0.1
        """Usual time from sweep to sweep [s]."""
        self.sides = EdgeMeasurement()
        self.sightings = Sightings()
        self.pose_error = PoseErrorFilter(frames.sensors)
        self.moves = False
        """True if the log has poses of the sensor."""
        self.resize(targets, meas, frames)

    def resize(self, targets: Targets, meas: Measurements, frames: Keyframes) -> None:
        """Continue with larger arrays."""
        self.targets = targets
        self.measurements = meas
        self.frames = frames
        self.candidates = Candidates(targets.capacity, meas.objects)
        self.persons = Persons(meas.objects)

    def process(self, detections: Detections, scans: Scans, row: int, stop: int, track_ids: Any) -> int:
        """Process the sweeps from a row on; return the first row for which there is no capacity, or `stop`.

        Parameters
        ----------
        detections, scans : objects and beams of the batch
        row, stop : rows of the batch
        track_ids : (K,) int64 to fill in: number of the target of each object, 0 for none
        """
        out = native.at_longs(track_ids)
        lock = native.release()
        while row < stop and _has_capacity(self, detections, row):
            step(self, detections, scans, row, out)
            row += 1
        native.resume(lock)
        return row


def _has_capacity(tracker: SweepTracker, detections: Detections, row: int) -> bool:
    """Return whether there is capacity if all objects of a sweep are new targets."""
    objects = detections.offset[row + 1] - detections.offset[row]
    return (
        tracker.targets.slots_used + 2 * objects <= tracker.targets.capacity
        and objects <= tracker.measurements.objects
        and tracker.sightings.count + objects <= tracker.sightings.capacity
    )


def step(tracker: SweepTracker, detections: Detections, scans: Scans, row: int, track_ids: Any) -> None:
    """Process one sweep. One without a pose of the sensor only advances the clock."""
    for at in range(detections.offset[row], detections.offset[row + 1]):
        track_ids[at] = 0
    dt = advance_clock(tracker, detections.seconds[row])
    tracker.elapsed += dt
    pose_filter.pass_time(tracker.pose_error, dt)
    tracker.sweeps += 1
    tracker.objects = tracker.seen - detections.offset[row]
    tracker.seen += detections.offset[row + 1] - detections.offset[row]
    if detections.poses[4 * row] == detections.poses[4 * row]:
        _correct_sensor_pose(tracker, tracker.pose_error, tracker.measurements, detections, row, tracker.elapsed)
        _track(tracker, tracker.targets, tracker.measurements, detections, scans, row, tracker.elapsed)
        for k in range(tracker.measurements.count):
            at = tracker.measurements.object[k]
            track_ids[at] = tracker.targets.number[tracker.measurements.assigned[k]]
        tracker.elapsed = 0.0


def _track(
    tracker: SweepTracker, targets: Targets, meas: Measurements, detections: Detections, scans: Scans, row: int, dt: float
) -> None:
    """Predict all targets, associate the measurements, update or miss each target, and initiate new ones."""
    # Measurements of the sweep.
    meas.time, meas.sweep, meas.sensor = tracker.time, tracker.sweeps - 1, tracker.sensor
    measurement.extract(meas, detections, scans, row)
    keyframes.count_flicker(tracker.frames, meas, scans)
    measurement.classify_edges(meas)
    # Predict.
    for b in range(targets.slots_used):
        if targets.state[b] == kalman.LIVE:
            kalman.predict(targets, b, dt, _drift_variance(tracker, targets, meas, b))
    # Associate.
    association.associate(tracker.candidates, tracker.sides, targets, meas, tracker.frames)
    association.merge_fragments(targets, meas)
    for k in range(meas.count):
        meas.sighting[k] = -1
    # Update targets that have a measurement; count a miss of the others, which drops dead ones. Persons follow below: of
    # these `association` counts misses, for both legs together.
    for b in range(targets.slots_used):
        if targets.state[b] != kalman.LIVE or targets.kind[b] == kalman.PERSON:
            continue
        if targets.measurement[b] >= 0:
            _update(tracker, targets, meas, scans, b, targets.measurement[b])
        else:
            track_evidence.record_miss(targets, b, meas, scans)
            if track_evidence.stands(targets, b):
                kalman.hold_still(targets, b)
    # Initiate targets for measurements without one.
    for k in range(meas.count):
        if meas.assigned[k] == -1:
            meas.assigned[k] = _initiate(tracker, targets, meas, k)
        elif meas.assigned[k] < -1:
            meas.assigned[k] = -2 - meas.assigned[k]
    association.track_persons(tracker.persons, targets, meas, scans, tracker.sightings)
    pose_filter.apply_pose_error(tracker.pose_error, targets)
    keyframes.store(tracker.frames, meas, scans)


def advance_clock(tracker: SweepTracker, stamp: float) -> float:
    """Advance the clock to the stamp of a sweep [s], and return by how much; it never goes back."""
    dt = 0.0
    if tracker.sweeps > 0:
        dt = stamp - tracker.stamp
        if dt < 0.0:
            dt = tracker.typical_dt
        elif dt > MAX_PAUSE:
            dt = MAX_PAUSE
        elif 0.0 < dt < 1.0:
            tracker.typical_dt += 0.05 * (dt - tracker.typical_dt)
    tracker.stamp = stamp
    tracker.time += dt
    return dt


def _correct_sensor_pose(
    tracker: SweepTracker, pose_error: PoseErrorFilter, meas: Measurements, detections: Detections, row: int, dt: float
) -> None:
    """Set the pose of the sensor at a sweep, corrected by the estimated error."""
    x, y, yaw = detections.poses[4 * row], detections.poses[4 * row + 1], detections.poses[4 * row + 2]
    tracker.travelled = tracker.rotated = 0.0
    pose_error.speed_x = pose_error.speed_y = pose_error.turning = 0.0
    own, last = pose_error.elapsed[tracker.sensor], 3 * tracker.sensor
    if tracker.moves and own > 0.0:
        dx, dy, rotated = x - pose_error.last[last], y - pose_error.last[last + 1], yaw - pose_error.last[last + 2]
        rotated -= measurement.TURN * math.floor(rotated / measurement.TURN + 0.5)
        # Of the time since the last sweep of this sensor others may have observed the robot go most.
        share = dt / own
        tracker.travelled, tracker.rotated = share * math.sqrt(dx * dx + dy * dy), share * abs(rotated)
        if own >= SHORTEST_STEP:
            pose_error.speed_x, pose_error.speed_y, pose_error.turning = dx / own, dy / own, rotated / own
    pose_error.last[last], pose_error.last[last + 1], pose_error.last[last + 2] = x, y, yaw
    pose_error.elapsed[tracker.sensor] = 0.0
    pose_error.travelled += tracker.travelled
    meas.travelled = pose_error.travelled
    at = 3 * row
    meas.motion_x, meas.motion_y = detections.motion[at], detections.motion[at + 1]
    meas.motion_yaw = detections.motion[at + 2]
    meas.moves = meas.motion_x != 0.0 or meas.motion_y != 0.0 or meas.motion_yaw != 0.0
    pose_filter.correct_pose(pose_error, meas, x, y, yaw, detections.poses[4 * row + 3])


def _drift_variance(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int) -> float:
    """Return the variance by which a static target seems to move, because poses drift as the sensor moves [m²]."""
    dx, dy = targets.from_x[b] - meas.x, targets.from_y[b] - meas.y
    distance2 = min(dx * dx + dy * dy, FARTHEST_DRIFT * FARTHEST_DRIFT)
    return tracker.travelled * (POSE_DRIFT + YAW_DRIFT * distance2) + tracker.rotated * TURN_DRIFT * distance2


def _initiate(tracker: SweepTracker, targets: Targets, meas: Measurements, k: int) -> int:
    """Initiate a target with a measurement that is assigned to none; return its slot."""
    b = kalman.allocate(targets)
    kalman.reset(targets, b)
    targets.first_sweep[b] = meas.sweep
    targets.existence[b] = track_evidence.EXISTENCE_AT_FIRST
    targets.first_time[b] = meas.time
    if _is_boxy(meas, k):
        _make_box(tracker, targets, meas, b, k)
    else:
        _make_disc(tracker, targets, meas, b, k)
    # A new target inside of a known one may be a piece of it.
    x, y = kalman.centre(targets, b)
    other = track_evidence.covering_target(
        targets, b, x, y, association.PART_MARGIN if measurement.is_partial(meas, k) else 0.0
    )
    if other >= 0:
        targets.same_as[b] = targets.number[other]
    _count_measurement(tracker, targets, meas, b, k)
    track_evidence.mark_rest(targets, b, meas.sweep)
    return b


def _make_box(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Make a target a box, by a measurement."""
    targets.kind[b], targets.kind_hits[b] = kalman.BOX, 0
    yaw, var = _face_direction(meas, k)
    targets.yaw[b], targets.yaw_rate[b] = yaw, 0.0
    targets.yaw_var[b], targets.yaw_cov[b] = var, 0.0
    targets.rate_var[b] = kalman.TURN_RATE_SD * kalman.TURN_RATE_SD
    targets.cos[b], targets.sin[b] = math.cos(yaw), math.sin(yaw)
    pose_var = measurement.pose_variance(meas, k)
    measurement.measure_box(tracker.sides, meas, k, targets.cos[b], targets.sin[b], pose_var)
    for i in range(2):
        kalman.initiate_axis(
            targets,
            2 * b + i,
            tracker.sides.z[2 * i],
            tracker.sides.z[2 * i + 1],
            tracker.sides.var[2 * i],
            tracker.sides.var[2 * i + 1],
        )
    _initiate_jacobian(tracker, targets, meas, b, k)


def _make_disc(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Make a target a disc, by a measurement; its axes are those of the world."""
    targets.kind[b] = kalman.DISC
    pose_var = measurement.pose_variance(meas, k)
    measurement.measure_disc(tracker.sides, meas, k, 0.0, measurement.AT_LEAST, pose_var)
    half, half_var = max(0.5 * meas.chord[k], 0.02), 0.01
    if tracker.sides.half_var >= 0.0:
        half, half_var = tracker.sides.half, tracker.sides.half_var
    for i in range(2):
        a, var = 2 * b + i, tracker.sides.var[2 * i]
        c = tracker.sides.z[2 * i]
        kalman.initiate_axis(targets, a, c - half, c + half, 2.0 * var, 2.0 * var)
        targets.hh[a], targets.ch[a] = half_var, 0.0
        kalman.reset_static(targets, a)
    _initiate_jacobian(tracker, targets, meas, b, k)


def _initiate_jacobian(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Set the Jacobian of a new target by the error of the pose of its sweep."""
    for i in range(2):
        u_x, u_y = kalman.to_world(targets, b, 1.0 - i, 1.0 * i)
        pose_filter.set_jacobian(tracker.pose_error, meas, meas.middle_x[k], meas.middle_y[k], u_x, u_y, i)
        pose_filter.mix_jacobian(tracker.pose_error, targets, 2 * b + i, 1.0, i)


def _face_direction(meas: Measurements, k: int) -> tuple[float, float]:
    """Return the direction of the longest face [rad] and its variance, negative without a good face."""
    best = -1
    for f in range(meas.face_begin[k], meas.face_begin[k + 1]):
        if meas.face_points[f] >= YAW_POINTS and (best < 0 or meas.extent[f] > meas.extent[best]):
            best = f
    if best < 0:
        first, last = meas.begin[k], meas.begin[k + 1] - 1
        return (math.atan2(meas.point_y[last] - meas.point_y[first], meas.point_x[last] - meas.point_x[first]), -1.0)
    length = max(meas.extent[best], 0.01)
    var = 12.0 * meas.sigma * meas.sigma / (meas.face_points[best] * length * length)
    return math.atan2(meas.along_y[best], meas.along_x[best]), var + MIN_YAW_VAR


def _update(tracker: SweepTracker, targets: Targets, meas: Measurements, scans: Scans, b: int, k: int) -> None:
    """Update a target with its measurement."""
    if targets.kind[b] == kalman.DISC:
        _try_box(tracker, targets, meas, b, k)
    if targets.kind[b] == kalman.BOX:
        yaw, var = _face_direction(meas, k)
        if var >= 0.0:
            kalman.update_yaw(targets, b, yaw, var)
    pose_var = measurement.pose_variance(meas, k)
    kalman.measure(tracker.sides, meas, k, targets, b, pose_var)
    is_whole = not measurement.is_partial(meas, k)
    track_evidence.update_motion_evidence(targets, b, tracker.sides, is_whole)
    if tracker.moves:
        _observe_pose_error(tracker, targets, meas, b, k)
    if tracker.sides.by_centre:
        _update_disc(targets, tracker.sides, tracker.pose_error, b)
    else:
        _update_box(targets, tracker.sides, tracker.pose_error, b)
    if is_whole and meas.size[k] >= SIZE_BEAMS:
        diagonal = math.sqrt(meas.length[k] * meas.length[k] + meas.width[k] * meas.width[k])
        targets.whole[b] += 1
        targets.size[b] += (diagonal - targets.size[b]) / min(targets.whole[b], 20)
    track_evidence.record_hit(targets, b)
    _count_measurement(tracker, targets, meas, b, k)
    track_evidence.detect_legs(targets, b, meas, k, scans)
    if targets.moved[b] == 0:
        track_evidence.mark_rest(targets, b, meas.sweep)
        is_certain = targets.evidence[b] >= track_evidence.MIN_EVIDENCE
        if is_certain and track_evidence.has_left(targets, b, meas, scans, k, tracker.frames):
            targets.moved[b] = 1


def _is_boxy(meas: Measurements, k: int) -> bool:
    """Return whether a measurement shows a box well enough."""
    return meas.shape[k] == PRISMATIC and meas.size[k] >= BOX_BEAMS and meas.length[k] >= SLIMMEST_BOX


def _try_box(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Make a disc a box once it was measured as one several times; its velocity stays."""
    if not _is_boxy(meas, k):
        return
    targets.boxy[b] += 1
    if targets.boxy[b] < BOX_SIGHTINGS or measurement.is_partial(meas, k):
        return
    v_x, v_y, var = targets.v[2 * b], targets.v[2 * b + 1], targets.vv[2 * b]
    _make_box(tracker, targets, meas, b, k)
    targets.v[2 * b], targets.v[2 * b + 1] = kalman.to_axes(targets, b, v_x, v_y)
    targets.vv[2 * b] = targets.vv[2 * b + 1] = var
    targets.evidence[b] = 0.0
    targets.side_weight[2 * b] = targets.side_weight[2 * b + 1] = 0.0


def _observe_pose_error(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Learn the error of the poses from the sides of a target that is static."""
    tells = targets.moved[b] == 0 and targets.kind_hits[b] >= POSE_SIGHTINGS and targets.evidence[b] < MAX_POSE_EVIDENCE
    for i in range(2):
        u_x, u_y = kalman.to_world(targets, b, 1.0 - i, 1.0 * i)
        a = 2 * b + i
        pose_filter.set_jacobian(tracker.pose_error, meas, meas.middle_x[k], meas.middle_y[k], u_x, u_y, i)
        for side in range(2 * i, 2 * i + 2):
            if not tells or tracker.sides.var[side] < 0.0 or (tracker.sides.by_centre and side > 2 * i):
                continue
            sign = 0.0 if tracker.sides.by_centre else (1.0 if side > 2 * i else -1.0)
            off, var = kalman.static_residual(targets, a, tracker.sides.z[side], sign, tracker.sides.var[side])
            pose_filter.update_pose_error(tracker.pose_error, targets, a, off, var, i)


def _update_disc(targets: Targets, sides: EdgeMeasurement, pose_error: PoseErrorFilter, b: int) -> None:
    """Update a disc with its measured centre and radius."""
    for i in range(2):
        a = 2 * b + i
        kalman.update(targets, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        gain = kalman.update_static(targets, a, sides.z[2 * i], 0.0, sides.var[2 * i])
        pose_filter.mix_jacobian(pose_error, targets, a, gain, i)
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
                if sign * (z - targets.c[a]) <= targets.h[a] + PAST_SIDE:
                    continue
                var = AT_LEAST_VAR
            kalman.update(targets, a, z, sign, var)
            gain = kalman.update_static(targets, a, z, sign, var)
            pose_filter.mix_jacobian(pose_error, targets, a, gain, i)
        length = sides.z[2 * i + 1] - sides.z[2 * i]
        if sides.var[2 * i] >= 0.0 and sides.var[2 * i + 1] >= 0.0:
            _average_extent(targets, a, length, sides.var[2 * i] + sides.var[2 * i + 1])
        targets.least[a] = max(targets.least[a], length - 2.0 * PAST_SIDE)


def _average_extent(targets: Targets, a: int, length: float, var: float) -> None:
    """Add an extent that was measured from end to end to its mean; one that differs much counts little."""
    length = max(length, 0.0)
    weight = 1.0 / (var + EXTENT_VAR)
    if targets.side_weight[a] > 0.0:
        off = length - targets.side[a]
        weight /= 1.0 + off * off / (SIZE_OUTLIER + var)
    targets.side_weight[a] += weight
    targets.side[a] += weight / targets.side_weight[a] * (length - targets.side[a])


def _count_measurement(tracker: SweepTracker, targets: Targets, meas: Measurements, b: int, k: int) -> None:
    """Count a measurement of a target, and record the sighting."""
    targets.measurement[b] = k
    targets.sightings[b] += 1
    targets.kind_hits[b] += 1
    targets.last_sweep[b], targets.last_time[b] = meas.sweep, meas.time
    kalman.mark_seen(targets, b, meas.sensor)
    targets.middle_x[b], targets.middle_y[b] = meas.middle_x[k], meas.middle_y[k]
    targets.from_x[b], targets.from_y[b] = kalman.centre(targets, b)
    track_evidence.vote_shape(targets, b, meas, k)
    kalman.record_sighting(tracker.sightings, targets, b, tracker.sides, meas, k, tracker.objects)
