cimport cython
cimport libc.math as math

from lidarcli cimport native

cdef int HIT, SKIPPED
cdef Py_ssize_t ORIGIN
cdef double NAN, ORIGIN_CELLS


@cython.locals(rows=Py_ssize_t, width=Py_ssize_t, row=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t, last=Py_ssize_t)
cpdef place(ranges, use, beams, angle_min, angle_increment, poses, way, end)
@cython.locals(
    sweeps=Py_ssize_t, width=Py_ssize_t, across=Py_ssize_t, sweep=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t,
    begin=Py_ssize_t, cell=Py_ssize_t, line=Py_ssize_t, along=Py_ssize_t, last=Py_ssize_t
)
cpdef trace(
    end, use, beams, poses, way, hits, passes, stamps, int stamp, double resolution, Py_ssize_t column, Py_ssize_t row
)
@cython.locals(
    column=Py_ssize_t, line=Py_ssize_t, step=Py_ssize_t, steps=Py_ssize_t, _=Py_ssize_t, slope=double
)
cdef void _pass(
    int* passed, int* seen, int stamp, Py_ssize_t across, Py_ssize_t first, double x, double y, double to_x, double to_y
) noexcept nogil
cdef void _count(int* passed, int* seen, int stamp, Py_ssize_t cell) noexcept nogil
