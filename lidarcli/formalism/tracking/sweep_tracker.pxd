cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport association, track_evidence, kalman, measurement
from lidarcli.formalism.tracking.association cimport Assignment, Candidates, Persons
from lidarcli.formalism.tracking.kalman cimport Targets, EdgeMeasurement, Sightings
from lidarcli.formalism.tracking.measurement cimport RangeHistory, Detections, Measurements

cdef Py_ssize_t PRISMATIC, UNKNOWN, BOX_BEAMS, BOX_SIGHTINGS, SIZE_BEAMS, YAW_POINTS, DELAY, AHEAD, LEFT, POSE_SIGHTINGS
cdef double SLIMMEST_BOX, LEAST_YAW_VAR, FARTHEST_DRIFT, POSE_DRIFT, YAW_DRIFT, TURN_DRIFT, PAST_SIDE, AT_LEAST_VAR, MOST_PAUSE, SHORTEST_STEP
cdef double EXTENT_VAR, SIZE_OUTLIER
cdef double DELAY_SD, PLACE_SD, LEAST_DELAY_VAR, LEAST_PLACE_VAR, MOST_POSE_RESIDUAL, MOST_POSE_EVIDENCE
cdef double POSE_SIDE_VAR, MOST_DELAY


cdef class SweepTracker:
    cdef list owner, assigned_buffer
    cdef double motion_threshold, stamp, typical_dt, elapsed, travelled, rotated
    cdef readonly double time
    cdef public Py_ssize_t sweeps, objects
    cdef public bint moves
    cdef EdgeMeasurement sides
    cdef readonly Sightings sightings
    cdef readonly Targets targets
    cdef readonly Measurements measurements
    cdef readonly RangeHistory range_history
    cdef Candidates candidates
    cdef Persons persons
    cdef Assignment assignment
    cdef readonly PoseErrorFilter pose_error
    cdef Py_ssize_t* assigned

    cpdef resize(self, Targets targets, Measurements measurements, RangeHistory range_history)
    cpdef Py_ssize_t process(self, Detections detections, Scans scans, Py_ssize_t row, Py_ssize_t stop, object track_ids) except -1


cdef bint has_capacity(SweepTracker tracker, Detections detections, Py_ssize_t row) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef void step(SweepTracker tracker, Detections detections, Scans scans, Py_ssize_t row, long long* track_ids) noexcept nogil
cdef double _advance_clock(SweepTracker tracker, double stamp) noexcept nogil
cdef double _drift_variance(SweepTracker tracker, Py_ssize_t b) noexcept nogil
cdef void _correct_sensor_pose(SweepTracker tracker, Detections detections, Py_ssize_t row, double dt) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef Py_ssize_t _initiate(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t k) noexcept nogil
cdef void _make_box(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _make_disc(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _initiate_jacobian(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef (double, double) _face_direction(Measurements measurements, Py_ssize_t k) noexcept nogil
@cython.locals(is_whole=bint)
cdef void _update(SweepTracker tracker, Targets targets, Measurements measurements, Scans scans, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef bint _is_boxy(Measurements measurements, Py_ssize_t k) noexcept nogil
cdef void _try_box(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(tells=bint)
cdef void _observe_pose_error(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _update_disc(Targets targets, EdgeMeasurement sides, PoseErrorFilter pose_error, Py_ssize_t b) noexcept nogil
cdef void _update_box(Targets targets, EdgeMeasurement sides, PoseErrorFilter pose_error, Py_ssize_t b) noexcept nogil
cdef void _average_extent(Targets targets, Py_ssize_t a, double length, double var) noexcept nogil
cdef void _count_measurement(SweepTracker tracker, Targets targets, Measurements measurements, Py_ssize_t b, Py_ssize_t k) noexcept nogil


cdef class PoseErrorFilter:
    cdef list owner
    cdef double* value
    cdef double* cov
    cdef double* last
    cdef double speed_x, speed_y, turning
    cdef public double travelled
    cdef bint has_pose
    cdef double* jacobian
    cdef double* product
    cdef double* change

    cpdef tuple estimate(self)


cdef void correct_pose(PoseErrorFilter pose_error, Measurements measurements, double x, double y, double yaw, double side) noexcept nogil
cdef void set_jacobian(PoseErrorFilter pose_error, Measurements measurements, double x, double y, double u_x, double u_y, Py_ssize_t axis
) noexcept nogil
cdef void update_pose_error(PoseErrorFilter pose_error, Targets targets, Py_ssize_t a, double off, double var, Py_ssize_t axis
) noexcept nogil
cdef void mix_jacobian(PoseErrorFilter pose_error, Targets targets, Py_ssize_t a, double gain, Py_ssize_t axis) noexcept nogil
cdef void apply_pose_error(PoseErrorFilter pose_error, Targets targets) noexcept nogil
