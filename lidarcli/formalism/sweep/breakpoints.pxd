cimport cython

from lidarcli cimport native
from lidarcli.formalism.sweep cimport points as sweep
from lidarcli.formalism.sweep.points cimport Points, Scans

cdef double ROUGHNESS, NOISE_GAIN, ROOT_2, SPACING_GAIN, TINY
cdef Py_ssize_t REACH


cdef class Breakpoints:
    cdef list owner
    cdef Py_ssize_t* at
    cdef readonly Py_ssize_t count
    cdef bint adaptive
    cdef Py_ssize_t max_gap


cdef double noise_threshold(double sigma) noexcept nogil
cdef double adaptive_threshold(Points points, double explained, double r, double s) noexcept nogil
@cython.locals(breaks=bint)
cdef void find(Breakpoints breakpoints, Points points, Scans scans) noexcept nogil
cdef bint is_within(Points points, Scans scans, Py_ssize_t at) noexcept nogil
cdef bint is_unexplained(Points points, Py_ssize_t at, Py_ssize_t max_gap) noexcept nogil
@cython.locals(lag=Py_ssize_t, some=bint, span=Py_ssize_t)
cdef double slope(Points points, Py_ssize_t at, int way, Py_ssize_t max_gap) noexcept nogil
