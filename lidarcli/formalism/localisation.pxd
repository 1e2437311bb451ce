
cimport cython
cimport libc.math as math

from lidarcli.system cimport native

cdef double FIELD_CELL, UNIT, BESIDE, EXPLAINED, SHARP, WIDE, FLAT, STEP, STEP_TURN, MIN_STEP, DOUBTFUL, HALF_KNOWN
cdef double STRIDE, STRIDE_TURN, BETTER, SHORT, NEAREST
cdef Py_ssize_t FARTHEST, OCCUPIED, KNOWN, SIZES, MAX_STEPS, PLACES, TURNS, TRIED_POINTS, CLIMBED, COLUMNS


cdef class Field:
    cdef list owner
    cdef unsigned char* cells
    cdef readonly Py_ssize_t height, width, columns
    cdef readonly double x, y
    cdef double* sharp
    cdef double* wide
    cdef double* best
    cdef double* found
    cdef Py_ssize_t* near
    cdef Py_ssize_t total, begin, end
    cdef double pivot_x, pivot_y


@cython.locals(count=Py_ssize_t, window=Py_ssize_t)
cpdef judge(Field field, points, windows, found)
@cython.locals(
    n=double, near=double, known=double, worth=double, x=double, y=double, turn=double, k=Py_ssize_t
)
cdef void judge_window(Field field, double* p, double* out, Py_ssize_t to) noexcept nogil
@cython.locals(row=Py_ssize_t, column=Py_ssize_t, value=Py_ssize_t)
cdef Py_ssize_t value_at(Field field, double x, double y) noexcept nogil
@cython.locals(k=Py_ssize_t, near=Py_ssize_t, known=Py_ssize_t, value=Py_ssize_t)
cdef (double, double) explained(Field field, double* p, double x, double y, double turn) noexcept nogil
@cython.locals(k=Py_ssize_t, count=Py_ssize_t)
cdef double worth_of(
    Field field, double* p, double* worths, Py_ssize_t every, double x, double y, double turn
) noexcept nogil
@cython.locals(found="double*", k=Py_ssize_t, moved=bint)
cdef void climb(Field field, double* p, double x, double y, double turn) noexcept nogil
@cython.locals(
    best="double*", k=Py_ssize_t, every=Py_ssize_t, turned=Py_ssize_t, column=Py_ssize_t, row=Py_ssize_t, at=Py_ssize_t
)
cdef void look_around(Field field, double* p) noexcept nogil
@cython.locals(passing=Py_ssize_t, k=Py_ssize_t, at=double)
cdef double through_walls(Field field, double* p) noexcept nogil
