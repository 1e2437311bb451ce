cimport cython

from lidarcli.system cimport native

cdef float NAN, INFINITY
cdef Py_ssize_t IS_NAN, IS_INF, IS_MINUS_INF, IS_NEGATIVE, IS_ZERO, IS_BELOW, IS_MAX, IS_ABOVE, IS_PADDING


@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, count=Py_ssize_t)
cpdef judge(ranges, beams, low, most, limit, verdicts, clean, status)
cdef void judge_row(
    float* raw, float* clean, unsigned char* status, Py_ssize_t begin, Py_ssize_t count, float least, float most
) noexcept nogil
cdef Py_ssize_t _kind(float value, float least, float limit) noexcept nogil
@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, kinds=Py_ssize_t, code=cython.uchar, left=int, found=int)
cpdef count_statuses(status, counts)
