cimport cython
cimport libc.math as math

from lidarcli.system cimport native

cdef double CELL, BEFORE_HIT, BEFORE_HIT_GROWS, STEP
cdef Py_ssize_t NEAR, BITS, COLUMN


cdef class Marks:
    cdef list owner
    cdef readonly Py_ssize_t size, words, cells
    cdef Py_ssize_t* keys
    cdef Py_ssize_t* number
    cdef Py_ssize_t* confirmed
    cdef Py_ssize_t* denied


@cython.locals(sweeps=Py_ssize_t, beams=Py_ssize_t, s=Py_ssize_t, b=Py_ssize_t, word=Py_ssize_t, bit=Py_ssize_t,
               r=cython.p_double, angle=cython.p_double, increment=cython.p_double, pose=cython.p_double, parts="long long*",
               out=cython.p_double, bearing=double, x=double, y=double, reach=double, moved=cython.p_double, share=double, late=double, cos=double, sin=double, key=Py_ssize_t,
               turn=Py_ssize_t)
cpdef void count(
    object ranges, object first, object step, object poses, object motion, object part, Marks marks, object sums
)
@cython.locals(column=Py_ssize_t, row=Py_ssize_t)
cdef Py_ssize_t key_of(double x, double y) noexcept nogil
@cython.locals(slot=Py_ssize_t)
cdef Py_ssize_t slot_of(Marks marks, Py_ssize_t key) noexcept nogil
@cython.locals(slot=Py_ssize_t)
cdef void add_cell(Marks marks, Py_ssize_t key) noexcept nogil
@cython.locals(slot=Py_ssize_t)
cdef Py_ssize_t cell_at(Marks marks, Py_ssize_t key) noexcept nogil
@cython.locals(one=Py_ssize_t)
cdef Py_ssize_t bit_of(Py_ssize_t number) noexcept nogil
@cython.locals(key=Py_ssize_t, k=Py_ssize_t, cell=Py_ssize_t, end=double, at=double)
cdef void mark_beam(Marks marks, double x, double y, double cos, double sin, double reach, Py_ssize_t word, Py_ssize_t bit) noexcept nogil
@cython.locals(confirmed=Py_ssize_t, denied=Py_ssize_t, near_confirmed=Py_ssize_t, near_denied=Py_ssize_t, k=Py_ssize_t,
               other=Py_ssize_t, word=Py_ssize_t, is_confirmed=Py_ssize_t, is_denied=Py_ssize_t)
cdef void compare(Marks marks, Py_ssize_t at, Py_ssize_t part, double* out) noexcept nogil
cdef void add_share(double* out, Py_ssize_t at, Py_ssize_t confirmed, Py_ssize_t denied) noexcept nogil
@cython.locals(found=Py_ssize_t)
cdef Py_ssize_t ones(Py_ssize_t number) noexcept nogil
