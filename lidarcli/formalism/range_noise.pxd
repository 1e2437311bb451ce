cimport cython
cimport libc.math as math

from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.system cimport native

cdef double NOISE_FLOOR, MEDIAN_TO_SIGMA, SECOND_DIFFERENCE_GAIN, TO_SIGMA
cdef float SINGLE_ONE, SINGLE_NAN, SINGLE_INFINITY, GUESS_LOW, GUESS_HIGH
cdef Py_ssize_t FEW_VALUES


cdef class Noise:
    cdef list owner
    cdef float* u
    cdef float* around
    cdef float* second
    cdef float* some
    cdef float guess


cdef double sigma_of(Noise noise, Scans scans, Py_ssize_t row) noexcept nogil
cdef float middle_second_difference(Noise noise, Scans scans, Py_ssize_t row) noexcept nogil
@cython.locals(
    numbers=int, below=int, within=int, low=float, high=float, kept=Py_ssize_t, margin=float, some_low=float, some_high=float,
    below_some=int, within_some=int, k=Py_ssize_t, last=Py_ssize_t
)
cdef float lower_median(Noise noise, Py_ssize_t count) noexcept nogil
@cython.locals(some=int)
cdef bint _any_between(float* values, Py_ssize_t at, float low, float high) noexcept nogil
@cython.locals(below=int, within=int, low=Py_ssize_t, high=Py_ssize_t)
cdef float smallest(Noise noise, Py_ssize_t count, Py_ssize_t rank) noexcept nogil
