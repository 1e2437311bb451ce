cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.tracking cimport measurement
from lidarcli.formalism.tracking.measurement cimport EdgeMeasurement, Measurements

cdef Py_ssize_t MAX_LEGS, EMPTY, LIVE, ENDED, DISC, BOX, PERSON
cdef double ACCELERATION, EXTENT_GROWTH, STANDING_GROWTH, SPEED_SD, ANGULAR_ACCELERATION, TURN_RATE_SD, MAX_TURN, FASTEST_TURN
cdef double UNSEEN_VAR, MAX_RESIDUAL, MIN_VAR, QUARTER_TURN, NEW_EXTENT


cdef class Targets:
    cdef readonly dict arrays
    cdef readonly Py_ssize_t capacity
    cdef public Py_ssize_t slots_used, last_number
    cdef long long* state
    cdef long long* number
    cdef long long* kind
    cdef long long* sightings
    cdef long long* kind_hits
    cdef long long* boxy
    cdef long long* whole
    cdef long long* moved
    cdef long long* inside
    cdef long long* same_as
    cdef long long* member
    cdef long long* sensors
    cdef long long* measurement
    cdef long long* first_sweep
    cdef long long* last_sweep
    cdef long long* onset
    cdef long long* end
    cdef double* size
    cdef double* existence
    cdef double* last_time
    cdef double* first_time
    cdef double* evidence
    cdef double* max_evidence
    cdef double* yaw
    cdef double* yaw_rate
    cdef double* yaw_var
    cdef double* yaw_cov
    cdef double* rate_var
    cdef double* cos
    cdef double* sin
    cdef double* middle_x
    cdef double* middle_y
    cdef double* from_x
    cdef double* from_y
    cdef double* birth_x
    cdef double* birth_y
    cdef double* c
    cdef double* v
    cdef double* h
    cdef double* cc
    cdef double* cv
    cdef double* ch
    cdef double* vv
    cdef double* vh
    cdef double* hh
    cdef double* static_c
    cdef double* static_h
    cdef double* static_cc
    cdef double* static_ch
    cdef double* static_hh
    cdef double* jacobian
    cdef double* side
    cdef double* side_weight
    cdef double* least
    cdef double* bulge
    cdef double* bulge_points
    cdef double* leg_x
    cdef double* leg_y
    cdef long long* leg_hits
    cdef double* shape_votes

    cpdef grow(self, Targets old)


cdef Py_ssize_t allocate(Targets targets) noexcept nogil
cdef void reset(Targets targets, Py_ssize_t b) noexcept nogil
cdef (double, double) centre(Targets targets, Py_ssize_t b) noexcept nogil
cdef (double, double) to_world(Targets targets, Py_ssize_t b, double along, double across) noexcept nogil
cdef (double, double) to_axes(Targets targets, Py_ssize_t b, double x, double y) noexcept nogil
cdef double half_extent(Targets targets, Py_ssize_t b, double x, double y) noexcept nogil
cdef double outside(Targets targets, Py_ssize_t b, double x, double y) noexcept nogil
cdef void turn(Targets targets, Py_ssize_t b, double angle) noexcept nogil
cdef void _rotate(double* values, Py_ssize_t one, Py_ssize_t other, double cos, double sin) noexcept nogil
cdef void _mix(double* values, Py_ssize_t at, double keep, double give) noexcept nogil
cdef void predict(Targets targets, Py_ssize_t b, double dt, double drift_var) noexcept nogil
cdef void hold_still(Targets targets, Py_ssize_t b) noexcept nogil
cdef (double, double) residual(Targets targets, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef (double, double) static_residual(Targets targets, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef void update(Targets targets, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef double update_static(Targets targets, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef void update_extent(Targets targets, Py_ssize_t a, double half, double var) noexcept nogil
cdef void update_yaw(Targets targets, Py_ssize_t b, double yaw, double var) noexcept nogil
cdef void initiate_axis(
    Targets targets, Py_ssize_t a, double low, double high, double low_var, double high_var
) noexcept nogil
cdef void reset_static(Targets targets, Py_ssize_t a) noexcept nogil


cdef void measure(
    EdgeMeasurement sides, Measurements meas, Py_ssize_t k, Targets targets, Py_ssize_t b, double pose_var
) noexcept nogil


cdef class Sightings:
    cdef readonly dict arrays
    cdef public Py_ssize_t count
    cdef readonly Py_ssize_t capacity
    cdef long long* number
    cdef long long* sensor
    cdef long long* sweep
    cdef long long* object
    cdef long long* centred
    cdef long long* whole
    cdef double* time
    cdef double* x
    cdef double* y
    cdef double* cos
    cdef double* sin
    cdef double* chord
    cdef double* half_1
    cdef double* half_2
    cdef double* middle_x
    cdef double* middle_y
    cdef double* ahead
    cdef double* left
    cdef double* sensor_x
    cdef double* sensor_y
    cdef double* travelled
    cdef double* z
    cdef double* var


@cython.locals(one="long long")
cdef void mark_seen(Targets targets, Py_ssize_t b, Py_ssize_t sensor) noexcept nogil
cdef bint has_seen(Targets targets, Py_ssize_t b, Py_ssize_t sensor) noexcept nogil
cdef void record_sighting(
    Sightings sightings, Targets targets, Py_ssize_t b, EdgeMeasurement sides, Measurements meas, Py_ssize_t k,
    Py_ssize_t objects
) noexcept nogil
