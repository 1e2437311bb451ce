cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.mapping cimport rays

cdef Py_ssize_t SURFACE, NOTHING
cdef int MOST_VOTES


cdef class Ends:
    cdef list owner
    cdef readonly Py_ssize_t width
    cdef Py_ssize_t directions
    cdef double farthest, step
    cdef float* ranges
    cdef int* beams
    cdef long long* offsets
    cdef int* beam_i
    cdef int* beam_f
    cdef double* cos
    cdef double* sin
    cdef double* angle_min
    cdef double* angle_increment
    cdef double* poses
    cdef double* heading
    cdef double* way
    cdef unsigned char* going
    cdef Py_ssize_t* body


@cython.locals(count=Py_ssize_t, width=Py_ssize_t, number=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t)
cpdef place(Ends ends, rows, end)
@cython.locals(
    count=Py_ssize_t, number=Py_ssize_t, k=Py_ssize_t, across=Py_ssize_t, first=Py_ssize_t, last=Py_ssize_t,
    line=Py_ssize_t, along=Py_ssize_t, cell=Py_ssize_t, body=Py_ssize_t, owner=Py_ssize_t
)
cpdef cast(
    Ends ends, rows, vote, int building, odds, votes, double resolution, Py_ssize_t column, Py_ssize_t row
)
@cython.locals(
    count=Py_ssize_t, number=Py_ssize_t, k=Py_ssize_t, across=Py_ssize_t, first=Py_ssize_t, last=Py_ssize_t,
    high=Py_ssize_t, along=Py_ssize_t, cell=Py_ssize_t, body=Py_ssize_t, owner=Py_ssize_t, beside=Py_ssize_t,
    near=Py_ssize_t
)
cpdef poll(
    Ends ends, rows, odds, votes, line, double resolution, Py_ssize_t column, Py_ssize_t row, found
)
@cython.locals(count=Py_ssize_t, k=Py_ssize_t, body=Py_ssize_t, _=Py_ssize_t)
cdef void _own(Ends ends, Py_ssize_t sweep) noexcept nogil
cdef Py_ssize_t _owner(Ends ends, Py_ssize_t sweep, Py_ssize_t k) noexcept nogil
cdef (double, double) _end(Ends ends, Py_ssize_t sweep, Py_ssize_t k) noexcept nogil
