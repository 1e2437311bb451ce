cimport cython
cimport libc.math as math

from lidarcli.system cimport native

cdef Py_ssize_t NEVER, LONGEST_GAP
cdef double NAN, INFINITE, TURN, GAP_STEP, GAP_STEP_GROWS
cdef int OPEN_TURN, SHARED_TURN
cdef double ROUGHNESS, NOISE_GAIN, ROOT_2, SPACING_GAIN, TINY
cdef Py_ssize_t SLOPE_REACH
cdef Py_ssize_t OWN, HIDDEN, OPEN, UNKNOWN, VIEW, FLICKERING, NO_RETURN
cdef double MAX_FLICKER


cdef class Scans:
    cdef list owner
    cdef readonly Py_ssize_t rows, width
    cdef float* ranges
    cdef unsigned char* status
    cdef int* beams
    cdef unsigned char* closure
    cdef double* angle_min
    cdef double* angle_increment
    cdef double* cos
    cdef double* sin
    cdef long long* direction
    cdef unsigned char* within
    cdef double* sigma
    cdef bint has_within, has_sigma


cdef class Points:
    cdef list owner
    cdef readonly Py_ssize_t most, row, count, gaps, nearest, beams, bearings, period
    cdef bint reverse
    cdef double first, step, cos_half, sin_half, sigma, d_th, flicker
    cdef int* position
    cdef int* missing
    cdef Py_ssize_t* gap
    cdef double* r
    cdef double* x
    cdef double* y
    cdef double* s


@cython.locals(
    count=Py_ssize_t, gaps=Py_ssize_t, k=Py_ssize_t, last=Py_ssize_t, first=Py_ssize_t, at=Py_ssize_t, here=Py_ssize_t,
    size=Py_ssize_t, stride=Py_ssize_t, some=float, away=double, i=Py_ssize_t
)
cdef void load(Points points, Scans scans, Py_ssize_t row) noexcept nogil
cdef void repeat(Points points, Py_ssize_t lead) noexcept nogil
cdef double bearing(Points points, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t beam_at(Points points, Py_ssize_t position) noexcept nogil
cdef double distance(Points points, Py_ssize_t a, Py_ssize_t b) noexcept nogil
@cython.locals(count=Py_ssize_t, last=Py_ssize_t, least=double, k=Py_ssize_t, at=Py_ssize_t, fours=Py_ssize_t, some=double)
cdef void differences(Points points) noexcept nogil
@cython.locals(gone=Py_ssize_t, lost=Py_ssize_t)
cdef double flicker(Points points, Scans scans) noexcept nogil
@cython.locals(total=double, begin=Py_ssize_t)
cdef double mean_difference(Points points) noexcept nogil


cdef class Breakpoints:
    cdef list owner
    cdef Py_ssize_t* at
    cdef readonly Py_ssize_t count
    cdef bint adaptive
    cdef Py_ssize_t max_gap


cdef double noise_threshold(double sigma) noexcept nogil
cdef double adaptive_threshold(Points points, double explained, double r, double s) noexcept nogil
@cython.locals(
    breaks=bint, count=Py_ssize_t, begin=Py_ssize_t, k=Py_ssize_t, end=Py_ssize_t, last=Py_ssize_t, before=Py_ssize_t, max_gap=int
)
cdef void find_breakpoints(Breakpoints breakpoints, Points points, Scans scans) noexcept nogil
cdef bint _all_small(double* s, Py_ssize_t k, double d_th) noexcept nogil
cdef bint is_within(Points points, Scans scans, Py_ssize_t at) noexcept nogil
cdef bint is_unexplained(Points points, Py_ssize_t at, Py_ssize_t max_gap) noexcept nogil
@cython.locals(lag=Py_ssize_t, some=bint, span=Py_ssize_t)
cdef double slope(Points points, Py_ssize_t at, int sign, Py_ssize_t max_gap) noexcept nogil


cdef class Segments:
    cdef list owner
    cdef Py_ssize_t* first
    cdef Py_ssize_t* size
    cdef Py_ssize_t* start_edge
    cdef Py_ssize_t* end_edge
    cdef double* s_start
    cdef double* s_end
    cdef readonly Py_ssize_t count


cdef void cut(Segments segments, Points points, Breakpoints breakpoints, Scans scans) noexcept nogil
cdef void _enter(Segments segments, Points points, Breakpoints breakpoints, Scans scans, Py_ssize_t j) noexcept nogil
cdef void _leave(
    Segments segments, Points points, Breakpoints breakpoints, Scans scans, Py_ssize_t j, Py_ssize_t following
) noexcept nogil
cdef Py_ssize_t _beside(Points points, Scans scans, Py_ssize_t position) noexcept nogil
cdef void copy_segments(Segments source, Segments target) noexcept nogil
cdef Py_ssize_t last_point(Segments segments, Py_ssize_t j) noexcept nogil
cdef double chord(Segments segments, Points points, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t following(Segments segments, Points points, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t preceding(Segments segments, Points points, Py_ssize_t j) noexcept nogil
