cimport cython
cimport libc.math as math

from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport estimation, observation
from lidarcli.formalism.tracking.estimation cimport Bodies, Sides
from lidarcli.formalism.tracking.observation cimport Memory, Views

cdef Py_ssize_t PRISMATIC, LEFT_VIEW, FREE, LOST, CONFIRMED_SIGHTINGS
cdef Py_ssize_t OCCUPIED_SWEEPS, SETTLED_SIGHTINGS, MOST_POINTS, DUPLICATE_SWEEPS, SPECK_BEAMS
cdef double STEADY_LENGTH, SAME_LENGTH, MOST_SWEEP_EVIDENCE, EVIDENCE_DECAY, MOST_PARTIAL_EVIDENCE, MOST_EVIDENCE
cdef double LEAST_WAY, FREE_SHARE, OCCUPIED_SHARE, FREE_MARGIN, OLDEST_SWEEP
cdef double EXISTENCE_AT_FIRST, EXISTENCE_GAIN, DETECTION_RATE, LEAST_PASSING, HIT_DOUBT, LEAST_EXISTENCE, PASSING_MARGIN
cdef double PATIENCE_STILL, PATIENCE_MOVING, LOST_VAR
cdef double BEAM_VOTE, SLIM_LEG_WIDTH, LEGS_FARTHEST, LEGS_NEAREST, SPECK_DEPTH, SAME_LEG


cdef void weigh_motion(Bodies bodies, Py_ssize_t b, Sides sides, bint is_whole) noexcept nogil
cdef double _motion_odds(
    Bodies bodies, Py_ssize_t a, double z, double sign, double var, double lasting
) noexcept nogil
cdef double _axis_odds(Bodies bodies, Py_ssize_t a, Sides sides, Py_ssize_t low) noexcept nogil
cdef void note_rest(Bodies bodies, Py_ssize_t b, Py_ssize_t sweep) noexcept nogil
cdef bint is_moving(
    Bodies bodies, Py_ssize_t b, Views views, Scans scans, Py_ssize_t k, Memory past, double alarm, double time
) noexcept nogil
@cython.locals(times=Py_ssize_t, p=Py_ssize_t)
cdef bint was_occupied(
    Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k, Memory past, double time
) noexcept nogil
cdef bint was_free(Views views, Py_ssize_t k, Memory past, double time) noexcept nogil


@cython.locals(first=Py_ssize_t, last=Py_ssize_t, position=Py_ssize_t)
cdef (double, double, double) passing(
    Views views, Scans scans, double x, double y, double near, double beside
) noexcept nogil
cdef (double, double, double) passing_body(
    Views views, Scans scans, Bodies bodies, Py_ssize_t b, double x, double y
) noexcept nogil
cdef void note_seen(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef bint _is_alone(Bodies bodies, Py_ssize_t number) noexcept nogil
@cython.locals(still=bint, astray=bint)
cdef void note_missed(Bodies bodies, Py_ssize_t b, Views views, Scans scans, double time) noexcept nogil
cdef Py_ssize_t covering_body(Bodies bodies, Py_ssize_t b, double x, double y, double beside) noexcept nogil
cdef void finish(Bodies bodies, Py_ssize_t b, Py_ssize_t why) noexcept nogil


cdef void note_shape(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k) noexcept nogil
@cython.locals(first=Py_ssize_t, last=Py_ssize_t, run=Py_ssize_t, here=double, before=double, after=double)
cdef void note_legs(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k, Scans scans) noexcept nogil
cdef void _note_leg(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
