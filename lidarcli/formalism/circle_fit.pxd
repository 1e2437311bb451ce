cimport libc.math as math

from lidarcli.system cimport native

cdef Py_ssize_t REFINEMENTS
cdef double LARGEST, INFINITY


cdef class Circle:
    cdef list owner
    cdef public Py_ssize_t n
    cdef double* x
    cdef double* y
    cdef double centre_x, centre_y, radius, rms, middle_x, middle_y
    cdef bint known
    cdef double* u
    cdef double* v
    cdef double* from_x
    cdef double* from_y
    cdef double* distance


cdef void fit_circle(Circle circle, double within) noexcept nogil
cdef void _algebraic(Circle circle) noexcept nogil
cdef void _measure(Circle circle) noexcept nogil
cdef double _rms(Circle circle) noexcept nogil
cdef void _refine(Circle circle) noexcept nogil
