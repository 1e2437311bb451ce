cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.tracking cimport observation
from lidarcli.formalism.tracking.observation cimport Views

cdef Py_ssize_t MOST_LEGS, EMPTY, LIVE, ENDED, DISC, BOX, PERSON, ROUND, LEGGED
cdef double ACCELERATION, EXTENT_GROWTH, STANDING_GROWTH, SPEED_SD, ANGULAR_ACCELERATION, TURN_RATE_SD, MOST_TURN, FASTEST_TURN
cdef double UNSEEN_VAR, MOST_RESIDUAL, LEAST_VAR, QUARTER_TURN, NEW_EXTENT
cdef double AT_LEAST, COS_ALONG, SIN_BEHIND, END_MARGIN, SURFACE_VAR, CROOKED_SHARE, RAGGED_SHARE, LEGGED_VAR, OPEN_EDGE_VAR


cdef class Bodies:
    cdef readonly dict arrays
    cdef readonly Py_ssize_t most
    cdef public Py_ssize_t high, born
    cdef long long* state
    cdef long long* number
    cdef long long* kind
    cdef long long* sightings
    cdef long long* settled
    cdef long long* boxy
    cdef long long* whole
    cdef long long* moved
    cdef long long* inside
    cdef long long* same_as
    cdef long long* member
    cdef long long* view
    cdef long long* first_sweep
    cdef long long* last_sweep
    cdef long long* onset
    cdef long long* end
    cdef double* size
    cdef double* existence
    cdef double* seen_at
    cdef double* first_at
    cdef double* evidence
    cdef double* evidence_most
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
    cdef double* still_c
    cdef double* still_h
    cdef double* still_cc
    cdef double* still_ch
    cdef double* still_hh
    cdef double* effect
    cdef double* side
    cdef double* side_weight
    cdef double* least
    cdef double* bulge
    cdef double* bulge_points
    cdef double* leg_x
    cdef double* leg_y
    cdef long long* leg_seen
    cdef double* shape_votes

    cpdef grow(self, Bodies old)


cdef Py_ssize_t free_slot(Bodies bodies) noexcept nogil
cdef void clear(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef (double, double) centre(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef (double, double) to_world(Bodies bodies, Py_ssize_t b, double along, double across) noexcept nogil
cdef (double, double) to_axes(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
cdef double half_extent(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
cdef double outside(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
cdef void turn(Bodies bodies, Py_ssize_t b, double angle) noexcept nogil
cdef void _mix(double* values, Py_ssize_t at, double keep, double give) noexcept nogil
cdef void predict(Bodies bodies, Py_ssize_t b, double dt, double creep) noexcept nogil
cdef void rest(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef (double, double) residual(Bodies bodies, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef (double, double) still_residual(Bodies bodies, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef void update(Bodies bodies, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef double update_still(Bodies bodies, Py_ssize_t a, double z, double sign, double var) noexcept nogil
cdef void update_extent(Bodies bodies, Py_ssize_t a, double half, double var) noexcept nogil
cdef void update_yaw(Bodies bodies, Py_ssize_t b, double yaw, double var) noexcept nogil
cdef void begin_axis(
    Bodies bodies, Py_ssize_t a, double low, double high, double low_var, double high_var
) noexcept nogil
cdef void stand_still(Bodies bodies, Py_ssize_t a) noexcept nogil


cdef class Sides:
    cdef list owner
    cdef double* z
    cdef double* var
    cdef bint by_centre, is_doubtful
    cdef double half, half_var, lasting_var


cdef void measure(
    Sides sides, Views views, Py_ssize_t k, Bodies bodies, Py_ssize_t b, double pose_var
) noexcept nogil
cdef double _edge_doubt(Py_ssize_t edge) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void measure_box(
    Sides sides, Views views, Py_ssize_t k, double cos, double sin, double pose_var
) noexcept nogil
@cython.locals(side=Py_ssize_t)
cdef void _measure_face(Sides sides, Views views, Py_ssize_t f, double cos, double sin, double pose_var) noexcept nogil
@cython.locals(u_x=double, u_y=double, face=Py_ssize_t)
cdef void _measure_end(
    Sides sides, Views views, Py_ssize_t k, Py_ssize_t p, double way, double cos, double sin, double pose_var
) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void measure_disc(
    Sides sides, Views views, Py_ssize_t k, double radius, double radius_var, double pose_var
) noexcept nogil
cdef (double, double) _unit_vector(Views views, double x, double y) noexcept nogil
cdef (double, double) _turned(double x, double y, double angle) noexcept nogil


cdef class Sightings:
    cdef public Py_ssize_t count
    cdef readonly Py_ssize_t room
    cdef long long* number
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
    cdef double* z
    cdef double* var


cdef void log_sighting(
    Sightings log, Bodies bodies, Py_ssize_t b, Sides sides, Views views, Py_ssize_t k, Py_ssize_t sweep, double time,
    Py_ssize_t at
) noexcept nogil
