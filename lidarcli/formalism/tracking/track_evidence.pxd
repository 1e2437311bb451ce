cimport cython
cimport libc.math as math

from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport kalman, keyframes, measurement
from lidarcli.formalism.tracking.kalman cimport Targets
from lidarcli.formalism.tracking.keyframes cimport Keyframes
from lidarcli.formalism.tracking.measurement cimport EdgeMeasurement, Measurements

cdef Py_ssize_t PRISMATIC, LEFT_VIEW, FREE, LOST, CONFIRMED_SIGHTINGS
cdef Py_ssize_t SETTLED_SIGHTINGS, DUPLICATE_SWEEPS, SPECK_BEAMS
cdef double STEADY_LENGTH, SAME_LENGTH, MAX_SWEEP_EVIDENCE, EVIDENCE_DECAY, MIN_EVIDENCE, MAX_PARTIAL_EVIDENCE, MAX_EVIDENCE
cdef double MIN_WAY, MIN_LOOKS, FREE_MARGIN
cdef double EXISTENCE_AT_FIRST, EXISTENCE_GAIN, DETECTION_RATE, MIN_PASSING, HIT_DOUBT, MIN_EXISTENCE, PASSING_MARGIN
cdef double PATIENCE_OUTSIDE, PATIENCE_STILL, SHORTEST_STAND, MOSTLY_OUTSIDE, REACH, LOST_VAR
cdef double BEAM_VOTE, SLIM_LEG_WIDTH, LEGS_FARTHEST, LEGS_NEAREST, SPECK_DEPTH, SAME_LEG


cdef void update_motion_evidence(Targets targets, Py_ssize_t b, EdgeMeasurement sides, bint is_whole) noexcept nogil
cdef double _motion_odds(
    Targets targets, Py_ssize_t a, double z, double sign, double var, double lasting
) noexcept nogil
cdef double _axis_odds(Targets targets, Py_ssize_t a, EdgeMeasurement sides, Py_ssize_t low) noexcept nogil
cdef void mark_rest(Targets targets, Py_ssize_t b, Py_ssize_t sweep) noexcept nogil
cdef bint has_left(
    Targets targets, Py_ssize_t b, Measurements meas, Scans scans, Py_ssize_t k, Keyframes frames
) noexcept nogil


@cython.locals(first=Py_ssize_t, last=Py_ssize_t, position=Py_ssize_t)
cdef (double, double, double) passing(
    Measurements meas, Scans scans, Targets targets, Py_ssize_t b, double x, double y
) noexcept nogil
@cython.locals(is_elder=bint)
cdef void record_hit(Targets targets, Py_ssize_t b) noexcept nogil
@cython.locals(lost=bint, stood=double)
cdef void record_miss(Targets targets, Py_ssize_t b, Measurements meas, Scans scans) noexcept nogil
cdef bint stands(Targets targets, Py_ssize_t b) noexcept nogil
cdef Py_ssize_t covering_target(Targets targets, Py_ssize_t b, double x, double y, double margin) noexcept nogil
cdef void terminate(Targets targets, Py_ssize_t b, Py_ssize_t why) noexcept nogil


cdef void vote_shape(Targets targets, Py_ssize_t b, Measurements meas, Py_ssize_t k) noexcept nogil
@cython.locals(first=Py_ssize_t, last=Py_ssize_t, run=Py_ssize_t, here=double, before=double, after=double)
cdef void detect_legs(Targets targets, Py_ssize_t b, Measurements meas, Py_ssize_t k, Scans scans) noexcept nogil
cdef void _record_leg(Targets targets, Py_ssize_t b, double x, double y) noexcept nogil
