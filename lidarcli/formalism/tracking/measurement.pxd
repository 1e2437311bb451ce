cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.segmentation cimport Scans

cdef double AT_LEAST, COS_ALONG, CROOKED_SHARE, END_MARGIN, LEGGED_VAR, OPEN_EDGE_VAR, RAGGED_SHARE, SIN_BEHIND, SURFACE_VAR
cdef Py_ssize_t ROUND, LEGGED
cdef int OBJECT, FULL, START_HIDDEN, END_HIDDEN, CUT, OPEN_VIEW, SHARED, VALID, NO_RETURN
cdef Py_ssize_t HIDDEN, OPEN, OWN, MIN_FACE_POINTS
cdef double TURN, BOX_MARGIN, MIN_STEP, NO_RANGE, FREE_RANGE, MAX_RANGE


cdef class Detections:
    cdef list owner
    cdef readonly Py_ssize_t max_objects
    cdef native.Pointers found
    cdef long long* offset
    cdef unsigned char* removed
    cdef unsigned char* placed
    cdef double* poses
    cdef double* seconds
    cdef double* motion
    cdef double* shares


cdef class Measurements:
    cdef list owner
    cdef readonly Py_ssize_t objects, beams
    cdef Py_ssize_t count, bearings, period, row, sweep, sensor
    cdef bint reverse, steady, moves, is_placed
    cdef double start_x, start_y, start_yaw, motion_x, motion_y, motion_yaw
    cdef double x, y, cos, sin, side, first, step, sigma, pose_var, pose_turn_var, time, travelled, farthest
    cdef Py_ssize_t* object
    cdef Py_ssize_t* assigned
    cdef Py_ssize_t* sighting
    cdef Py_ssize_t* shape
    cdef Py_ssize_t* size
    cdef Py_ssize_t* start
    cdef Py_ssize_t* end
    cdef double* middle_x
    cdef double* middle_y
    cdef double* centre_x
    cdef double* centre_y
    cdef double* length
    cdef double* width
    cdef double* chord
    cdef double* near
    cdef double* share
    cdef Py_ssize_t* begin
    cdef Py_ssize_t* face_begin
    cdef double* point_x
    cdef double* point_y
    cdef double* face_x
    cdef double* face_y
    cdef double* along_x
    cdef double* along_y
    cdef Py_ssize_t* face_points
    cdef double* extent
    cdef double* bulge
    cdef Py_ssize_t* face_first
    cdef Py_ssize_t* face_last


cdef void extract(Measurements meas, Detections detections, Scans scans, Py_ssize_t row) noexcept nogil
cdef void classify_edges(Measurements meas) noexcept nogil
cdef double pose_variance(Measurements meas, Py_ssize_t k) noexcept nogil
cdef bint is_partial(Measurements meas, Py_ssize_t k) noexcept nogil
cdef void _set_bearings(Measurements meas, Detections detections, Scans scans, Py_ssize_t row) noexcept nogil
cdef void place_sensor(Measurements meas, double share) noexcept nogil
cdef (double, double) to_world(Measurements meas, double x, double y) noexcept nogil
cdef (double, double) to_sensor(Measurements meas, double x, double y) noexcept nogil
cdef double angle_past_first(Measurements meas, double ahead, double left) noexcept nogil
cdef (double, double) ahead_and_left(Measurements meas, double x, double y) noexcept nogil
cdef Py_ssize_t position_of(Measurements meas, Py_ssize_t beam) noexcept nogil
cdef void _add_measurement(Measurements meas, Detections detections, Scans scans, Py_ssize_t at) noexcept nogil
cdef void _add_points(Measurements meas, Detections detections, Scans scans, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t _end_face(Measurements meas, Py_ssize_t f, Py_ssize_t n) noexcept nogil


cdef double range_at(Measurements meas, Scans scans, Py_ssize_t position) noexcept nogil


cdef class EdgeMeasurement:
    cdef list owner
    cdef double* z
    cdef double* var
    cdef bint by_centre, is_doubtful
    cdef double half, half_var, lasting_var


cdef double _edge_doubt(Py_ssize_t edge) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void measure_box(
    EdgeMeasurement sides, Measurements meas, Py_ssize_t k, double cos, double sin, double pose_var
) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void measure_disc(
    EdgeMeasurement sides, Measurements meas, Py_ssize_t k, double radius, double radius_var, double pose_var
) noexcept nogil
@cython.locals(side=Py_ssize_t)
cdef void _measure_face(EdgeMeasurement sides, Measurements meas, Py_ssize_t f, double cos, double sin, double pose_var) noexcept nogil
@cython.locals(u_x=double, u_y=double, face=Py_ssize_t)
cdef void _measure_end(
    EdgeMeasurement sides, Measurements meas, Py_ssize_t k, Py_ssize_t p, double outwards, double cos, double sin, double pose_var
) noexcept nogil
cdef (double, double) _unit_vector(Measurements meas, double x, double y) noexcept nogil
cdef (double, double) _rotated(double x, double y, double angle) noexcept nogil
