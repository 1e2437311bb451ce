cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.sweep cimport points
from lidarcli.formalism.sweep.points cimport Scans

cdef double NOISE_FLOOR, MEDIAN_TO_SIGMA, SECOND_DIFFERENCE_GAIN, TO_SIGMA
cdef float ONE, NOTHING, NEAR, FAR, INFINITY
cdef Py_ssize_t FEW


cdef class Noise:
    cdef list owner
    cdef float* u
    cdef float* around
    cdef float* second
    cdef float* some
    cdef float guess


cdef double sigma_of(Noise noise, Scans scans, Py_ssize_t row) noexcept nogil
cdef float middle_second_difference(Noise noise, Scans scans, Py_ssize_t row) noexcept nogil
@cython.locals(numbers=int, below=int, within=int, low=float, high=float, kept=Py_ssize_t, middle=float, margin=float)
cdef float lower_median(Noise noise, Py_ssize_t count) noexcept nogil
@cython.locals(below=int, within=int, low=Py_ssize_t, high=Py_ssize_t)
cdef float smallest(Noise noise, Py_ssize_t count, Py_ssize_t rank) noexcept nogil
