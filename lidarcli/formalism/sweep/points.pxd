cimport cython
cimport libc.math as math

from lidarcli cimport native

cdef Py_ssize_t NEVER
cdef double NAN, INFINITE, TURN
cdef int OPEN, SHARED, NO_RETURN
cdef Py_ssize_t LONGEST_GAP
cdef double GAP_STEP, GAP_STEP_GROWS


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
    cdef readonly Py_ssize_t most, row, count, beams, bearings, period
    cdef bint reverse
    cdef double first, step, cos_half, sin_half, sigma, d_th, flicker
    cdef Py_ssize_t* position
    cdef Py_ssize_t* missing
    cdef double* r
    cdef double* x
    cdef double* y
    cdef double* s


@cython.locals(count=Py_ssize_t)
cdef void load(Points points, Scans scans, Py_ssize_t row) noexcept nogil
cdef void repeat(Points points, Py_ssize_t lead) noexcept nogil
cdef double bearing(Points points, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t beam_at(Points points, Py_ssize_t position) noexcept nogil
cdef double distance(Points points, Py_ssize_t a, Py_ssize_t b) noexcept nogil
@cython.locals(at=Py_ssize_t, least=double)
cdef Py_ssize_t nearest(Points points) noexcept nogil
cdef void differences(Points points) noexcept nogil
@cython.locals(gone=Py_ssize_t, lost=Py_ssize_t)
cdef double flicker(Points points, Scans scans) noexcept nogil
@cython.locals(number=Py_ssize_t, total=double)
cdef double mean_difference(Points points) noexcept nogil
