cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport association, belief, estimation, observation
from lidarcli.formalism.tracking.association cimport Assignment, Pairs, Persons
from lidarcli.formalism.tracking.estimation cimport Bodies, Sides, Sightings
from lidarcli.formalism.tracking.observation cimport Memory, Seen, Views

cdef Py_ssize_t PRISMATIC, UNKNOWN, BOX_BEAMS, BOX_SIGHTINGS, SIZE_BEAMS, YAW_POINTS, DELAY, AHEAD, LEFT, POSE_SIGHTINGS
cdef double SLIMMEST_BOX, LEAST_YAW_VAR, FARTHEST_DRIFT, POSE_DRIFT, YAW_DRIFT, TURN_DRIFT, PAST_SIDE, AT_LEAST_VAR, MOST_PAUSE, SHORTEST_STEP
cdef double EXTENT_VAR, SIZE_OUTLIER
cdef double DELAY_SD, PLACE_SD, LEAST_DELAY_VAR, LEAST_PLACE_VAR, MOST_POSE_RESIDUAL, MOST_POSE_EVIDENCE
cdef double POSE_SIDE_VAR, MOST_DELAY


cdef class Fold:
    cdef list owner, taken_room
    cdef double alarm, stamp, usual, lapse, way, turned
    cdef readonly double clock
    cdef public Py_ssize_t sweeps, objects
    cdef public bint moves
    cdef Sides sides
    cdef readonly Sightings log
    cdef readonly Bodies bodies
    cdef readonly Views views
    cdef readonly Memory past
    cdef Pairs pairs
    cdef Persons persons
    cdef Assignment task
    cdef readonly Correction correction
    cdef Py_ssize_t* taken

    cpdef fit(self, Bodies bodies, Views views, Memory past)
    cpdef Py_ssize_t follow(self, Seen seen, Scans scans, Py_ssize_t row, Py_ssize_t stop, object number) except -1


cdef bint has_room(Fold fold, Seen seen, Py_ssize_t row) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef void step(Fold fold, Seen seen, Scans scans, Py_ssize_t row, long long* number) noexcept nogil
cdef double _tick(Fold fold, double stamp) noexcept nogil
cdef double _creep(Fold fold, Py_ssize_t b) noexcept nogil
cdef void _judge_pose(Fold fold, Seen seen, Py_ssize_t row, double dt) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef Py_ssize_t _begin(Fold fold, Bodies bodies, Views views, Py_ssize_t k) noexcept nogil
cdef void _make_box(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _make_disc(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _depend_on_pose(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef (double, double) _face_direction(Views views, Py_ssize_t k) noexcept nogil
@cython.locals(is_whole=bint)
cdef void _take(Fold fold, Bodies bodies, Views views, Scans scans, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef bint _is_boxy(Views views, Py_ssize_t k) noexcept nogil
cdef void _consider_box(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(tells=bint)
cdef void _learn_from_body(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _update_disc(Bodies bodies, Sides sides, Correction correction, Py_ssize_t b) noexcept nogil
cdef void _update_box(Bodies bodies, Sides sides, Correction correction, Py_ssize_t b) noexcept nogil
cdef void _note_extent(Bodies bodies, Py_ssize_t a, double length, double var) noexcept nogil
cdef void _note_view(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil


cdef class Correction:
    cdef list owner
    cdef double* value
    cdef double* cov
    cdef double* last
    cdef double speed_x, speed_y, turning
    cdef public double way
    cdef bint has_pose
    cdef double* effect
    cdef double* product
    cdef double* change

    cpdef tuple estimate(self)


cdef void correct_pose(Correction correction, Views views, double x, double y, double yaw, double side) noexcept nogil
cdef void set_effect(Correction correction, Views views, double x, double y, double u_x, double u_y, Py_ssize_t axis
) noexcept nogil
cdef void learn_pose_error(Correction correction, Bodies bodies, Py_ssize_t a, double off, double var, Py_ssize_t axis
) noexcept nogil
cdef void follow_effect(Correction correction, Bodies bodies, Py_ssize_t a, double gain, Py_ssize_t axis) noexcept nogil
cdef void apply_correction(Correction correction, Bodies bodies) noexcept nogil
