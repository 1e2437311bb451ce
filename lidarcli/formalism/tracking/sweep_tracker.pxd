cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport association, kalman, keyframes, measurement, pose_filter, track_evidence
from lidarcli.formalism.tracking.association cimport Candidates, Persons
from lidarcli.formalism.tracking.kalman cimport Sightings, Targets
from lidarcli.formalism.tracking.pose_filter cimport PoseErrorFilter
from lidarcli.formalism.tracking.keyframes cimport Keyframes
from lidarcli.formalism.tracking.measurement cimport Detections, EdgeMeasurement, Measurements

cdef Py_ssize_t PRISMATIC, UNKNOWN, BOX_BEAMS, BOX_SIGHTINGS, SIZE_BEAMS, YAW_POINTS, POSE_SIGHTINGS
cdef double SLIMMEST_BOX, MIN_YAW_VAR, FARTHEST_DRIFT, POSE_DRIFT, YAW_DRIFT, TURN_DRIFT, PAST_SIDE, AT_LEAST_VAR, MAX_PAUSE, SHORTEST_STEP
cdef double EXTENT_VAR, SIZE_OUTLIER
cdef double MAX_POSE_EVIDENCE


cdef class SweepTracker:
    cdef list owner
    cdef double stamp, typical_dt, elapsed, travelled, rotated
    cdef readonly double time
    cdef public Py_ssize_t sweeps, sensor
    cdef Py_ssize_t objects, seen
    cdef public bint moves
    cdef EdgeMeasurement sides
    cdef readonly Sightings sightings
    cdef readonly Targets targets
    cdef readonly Measurements measurements
    cdef readonly Keyframes frames
    cdef Candidates candidates
    cdef Persons persons
    cdef readonly PoseErrorFilter pose_error

    cpdef resize(self, Targets targets, Measurements meas, Keyframes frames)
    cpdef Py_ssize_t process(self, Detections detections, Scans scans, Py_ssize_t row, Py_ssize_t stop, object track_ids) except -1


cdef bint _has_capacity(SweepTracker tracker, Detections detections, Py_ssize_t row) noexcept nogil
@cython.locals(at=Py_ssize_t, dt=double)
cdef void step(SweepTracker tracker, Detections detections, Scans scans, Py_ssize_t row, long long* track_ids) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef void _track(
    SweepTracker tracker, Targets targets, Measurements meas, Detections detections, Scans scans, Py_ssize_t row, double dt
) noexcept nogil
cdef double advance_clock(SweepTracker tracker, double stamp) noexcept nogil
cdef double _drift_variance(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b) noexcept nogil
@cython.locals(last=Py_ssize_t, own=double, share=double)
cdef void _correct_sensor_pose(
    SweepTracker tracker, PoseErrorFilter pose_error, Measurements meas, Detections detections, Py_ssize_t row, double dt
) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef Py_ssize_t _initiate(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t k) noexcept nogil
cdef void _make_box(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _make_disc(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _initiate_jacobian(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef (double, double) _face_direction(Measurements meas, Py_ssize_t k) noexcept nogil
@cython.locals(is_whole=bint, is_certain=bint)
cdef void _update(SweepTracker tracker, Targets targets, Measurements meas, Scans scans, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef bint _is_boxy(Measurements meas, Py_ssize_t k) noexcept nogil
cdef void _try_box(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(tells=bint)
cdef void _observe_pose_error(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _update_disc(Targets targets, EdgeMeasurement sides, PoseErrorFilter pose_error, Py_ssize_t b) noexcept nogil
cdef void _update_box(Targets targets, EdgeMeasurement sides, PoseErrorFilter pose_error, Py_ssize_t b) noexcept nogil
cdef void _average_extent(Targets targets, Py_ssize_t a, double length, double var) noexcept nogil
cdef void _count_measurement(SweepTracker tracker, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k) noexcept nogil


