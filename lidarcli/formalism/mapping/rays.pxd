cimport cython
cimport libc.math as math

from lidarcli.system cimport native


cdef int HIT, SKIPPED
cdef Py_ssize_t ORIGIN
cdef double NAN, ORIGIN_CELLS


@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, row=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t, last=Py_ssize_t)
cpdef place(ranges, use, beams, angle_min, angle_increment, poses, way, end)
@cython.locals(
    sweeps=Py_ssize_t, width=Py_ssize_t, across=Py_ssize_t, sweep=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t,
    begin=Py_ssize_t, cell=Py_ssize_t, line=Py_ssize_t, along=Py_ssize_t, last=Py_ssize_t
)
cpdef trace(beams_of, layers, int stamp, double resolution, Py_ssize_t column, Py_ssize_t row)
@cython.locals(
    column=Py_ssize_t, line=Py_ssize_t, step=Py_ssize_t, steps=Py_ssize_t, _=Py_ssize_t, slope=double
)
cdef void _pass(
    int* passed, int* stamped, int stamp, Py_ssize_t across, Py_ssize_t first, double x, double y, double to_x, double to_y
) noexcept nogil
cdef void _count(int* passed, int* stamped, int stamp, Py_ssize_t cell) noexcept nogil


cdef Py_ssize_t NO_BODY
cdef long long COUNT_BITS


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
    cdef Py_ssize_t* beam
    cdef double* x
    cdef double* y


@cython.locals(
    count=Py_ssize_t, number=Py_ssize_t, k=Py_ssize_t, across=Py_ssize_t, first=Py_ssize_t, last=Py_ssize_t,
    cell=Py_ssize_t, body=Py_ssize_t, owner=Py_ssize_t, is_new=bint
)
cpdef cast(
    Ends ends, rows, vote, long long building, votes, double resolution, Py_ssize_t column, Py_ssize_t row
)
@cython.locals(
    count=Py_ssize_t, number=Py_ssize_t, k=Py_ssize_t, across=Py_ssize_t, first=Py_ssize_t, last=Py_ssize_t,
    cell=Py_ssize_t, body=Py_ssize_t, owner=Py_ssize_t, near=Py_ssize_t, line_step=Py_ssize_t, total=cython.longlong
)
cpdef poll(
    Ends ends, rows, votes, double resolution, Py_ssize_t column, Py_ssize_t row, found
)
@cython.locals(
    count=Py_ssize_t, first=Py_ssize_t, used=Py_ssize_t, k=Py_ssize_t, body=Py_ssize_t, _=Py_ssize_t, at=Py_ssize_t,
    came=bint, goes_on=bint, is_free=bint, is_next_free=bint
)
cdef Py_ssize_t _use(Ends ends, Py_ssize_t sweep, bint surfaces) noexcept nogil
@cython.locals(first=Py_ssize_t, at=Py_ssize_t, k=Py_ssize_t, beam=Py_ssize_t, r=double)
cdef void _lay(Ends ends, Py_ssize_t sweep, Py_ssize_t used) noexcept nogil
@cython.locals(line=Py_ssize_t, along=Py_ssize_t)
cdef Py_ssize_t _cell(Ends ends, Py_ssize_t k, double cells, Py_ssize_t across) noexcept nogil
