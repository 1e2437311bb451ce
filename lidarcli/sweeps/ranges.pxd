cimport cython

from lidarcli.system cimport native

cdef float NAN, INFINITY
cdef Py_ssize_t IS_NAN, IS_INF, IS_MINUS_INF, IS_NEGATIVE, IS_ZERO, IS_BELOW, IS_MAX, IS_ABOVE, IS_PADDING


@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, count=Py_ssize_t, at=Py_ssize_t, end=Py_ssize_t, last=Py_ssize_t)
cpdef judge(ranges, beams, low, most, limit, verdicts, clean, status)
cdef void judge_row(
    float* raw, float* clean, unsigned char* status, Py_ssize_t begin, Py_ssize_t count, float least, float most
) noexcept nogil
@cython.locals(some=cython.uchar)
cdef bint any_of_32(unsigned char* codes, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t _kind(float value, float least, float limit) noexcept nogil
@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, zeros=int, at=Py_ssize_t, end=Py_ssize_t, last=Py_ssize_t)
cpdef count_statuses(status, counts)
