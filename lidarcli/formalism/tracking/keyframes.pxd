cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport measurement
from lidarcli.formalism.tracking.kalman cimport Sightings
from lidarcli.formalism.tracking.measurement cimport Measurements

cdef double NAN
cdef int NO_RETURN
cdef Py_ssize_t KEPT, SWEEPS_APART
cdef double SECONDS_APART, FLICKER_WEIGHT, MAX_FLICKER_SHARE, GUARD_ANGLE, GUARD, MAX_BEAMS, LOOK_MARGIN, LOOK_MARGIN_SHARE
cdef double SAME_VIEW, SAME_RANGE, SECONDS_BEFORE, SECONDS_AFTER, MAX_WAY, THINNED, SECONDS_UNPLACED, MAX_LOOKS
cdef double WIDEST_COVER, COVER_STEP


cdef class Keyframes:
    cdef list owner
    cdef readonly Py_ssize_t beams, count, sensors, kept
    cdef double* last_time
    cdef Py_ssize_t* last_sweep
    cdef Py_ssize_t* sensor
    cdef double* farthest
    cdef double* changes
    cdef double* lost
    cdef Py_ssize_t* watched
    cdef Py_ssize_t* before
    cdef double* time
    cdef double* x
    cdef double* y
    cdef double* yaw
    cdef double* motion_x
    cdef double* motion_y
    cdef double* motion_yaw
    cdef double* travelled
    cdef double* side
    cdef double* first
    cdef double* step
    cdef Py_ssize_t* bearings
    cdef Py_ssize_t* period
    cdef float* r
    cdef Py_ssize_t* status
    cdef Py_ssize_t* pose
    cdef Py_ssize_t seen_from, seen_first, seen_last
    cdef bint is_covered
    cdef double place_x, place_y, width, from_x, from_y, seen_at, seen_x, seen_y, nearest, farther, weight

    cpdef grow(self, Keyframes old)
    @cython.locals(row="long long*", out="double*", i=Py_ssize_t, number=Py_ssize_t)
    cpdef count_looks(self, Sightings sightings, object rows, object looks)
    @cython.locals(free=double, hits=double)
    cpdef bint stood(self, Sightings sightings, Py_ssize_t i, double since, double until, bint unknown=*)
    @cython.locals(
        x=double, y=double, dx=double, dy=double, free=double, outside=double, left=double, later=double, i=Py_ssize_t, m=Py_ssize_t, share=double,
        seen=double
    )
    cpdef (double, double, double) uncovered(
        self, Py_ssize_t sensor, double since, double complex begin, double until, double complex end, double width
    )


@cython.locals(changes=Py_ssize_t, lost=Py_ssize_t, now=Py_ssize_t, then=Py_ssize_t, s=Py_ssize_t, last=Py_ssize_t)
cdef void count_flicker(Keyframes keyframes, Measurements meas, Scans scans) noexcept nogil
@cython.locals(elapsed=double, before=Py_ssize_t, m=Py_ssize_t, k=Py_ssize_t, beam=Py_ssize_t, r=double, s=Py_ssize_t)
cdef void store(Keyframes keyframes, Measurements meas, Scans scans) noexcept nogil
@cython.locals(is_there=bint, goes=bint, turns=bint, alike=bint)
cdef bint is_same_pose(Keyframes keyframes, Py_ssize_t m, Py_ssize_t n) noexcept nogil
cdef void aim(Keyframes keyframes, double x, double y, double width, double from_x, double from_y) noexcept nogil
@cython.locals(x=double, y=double, width=double)
cdef void aim_at_sighting(Keyframes keyframes, Sightings sightings, Py_ssize_t i) noexcept nogil
@cython.locals(
    step=double, bearings=Py_ssize_t, share=double, position=double, dx=double, dy=double, moves=bint, yaw=double, angle=double, r=double, beside=double, margin=double
)
cdef void find_place(Keyframes keyframes, Py_ssize_t m) noexcept nogil
@cython.locals(
    bearings=Py_ssize_t, period=Py_ssize_t, begin=Py_ssize_t, open_share=double, r=double, dx=double, dy=double,
    nearest=double, farther=double, most=double, passes=Py_ssize_t, returns=Py_ssize_t, blocked=Py_ssize_t, unknown=Py_ssize_t,
    k=Py_ssize_t, at=Py_ssize_t, s=Py_ssize_t, end=double, own=double, own_x=double, own_y=double
)
cdef double look(Keyframes keyframes, Py_ssize_t m) noexcept nogil
@cython.locals(i=Py_ssize_t, m=Py_ssize_t, free=double, hits=double, seen=double)
cdef (double, double) looks_before(
    Keyframes keyframes, Py_ssize_t sensor, double travelled, double oldest, double until
) noexcept nogil
@cython.locals(oldest=double)
cdef (double, double) looks_at_measurement(
    Keyframes keyframes, Measurements meas, Py_ssize_t k, double until
) noexcept nogil
cdef bint stood_before(Keyframes keyframes, Measurements meas, Py_ssize_t k, double until) noexcept nogil
@cython.locals(
    k=Py_ssize_t, m=Py_ssize_t, first=Py_ssize_t, stop=Py_ssize_t, low=Py_ssize_t, split=Py_ssize_t, begin=Py_ssize_t, side=Py_ssize_t, number=Py_ssize_t,
    apart=double, most=double, off=double, seen=double
)
cdef void count_looks_at(
    Keyframes keyframes, Sightings sightings, Py_ssize_t i, double* out, Py_ssize_t at
) noexcept nogil
@cython.locals(
    r=double, period=Py_ssize_t, bearings=Py_ssize_t, middle=Py_ssize_t, i=Py_ssize_t, before=double, ends=bint, lost=Py_ssize_t,
    k=Py_ssize_t, at=Py_ssize_t, end=double
)
cdef bint is_enclosed(Keyframes keyframes, Py_ssize_t m) noexcept nogil
