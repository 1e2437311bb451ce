cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.views cimport Views

cdef Py_ssize_t KEPT
cdef int VALID, NO_RETURN
cdef double LEAST_STEP, HIT, APART, TURN, FLICKER_SHARE, FLICKERS, NOTHING, FAR


cdef class Memory:
    cdef list owner
    cdef readonly Py_ssize_t beams
    cdef Py_ssize_t count, before, watched
    cdef double changes, lost
    cdef double* time
    cdef double* x
    cdef double* y
    cdef double* cos
    cdef double* sin
    cdef double* side
    cdef double* first
    cdef double* step
    cdef Py_ssize_t* bearings
    cdef Py_ssize_t* period
    cdef double* sigma
    cdef float* r
    cdef Py_ssize_t* status

    cpdef grow(self, Memory old)


cdef void take_over(Memory memory, Memory old) noexcept nogil
@cython.locals(changes=Py_ssize_t, lost=Py_ssize_t, now=Py_ssize_t, then=Py_ssize_t)
cdef void watch(Memory memory, Views views, Scans scans) noexcept nogil
cdef bint is_steady(Memory memory) noexcept nogil
cdef double range_at(Views views, Scans scans, Py_ssize_t position) noexcept nogil
cdef void remember(Memory memory, Views views, Scans scans, double time) noexcept nogil
@cython.locals(at=Py_ssize_t)
cdef bint was_hit(Memory memory, Py_ssize_t m, double x, double y) noexcept nogil
@cython.locals(position=Py_ssize_t, at=Py_ssize_t, k=Py_ssize_t)
cdef bint was_passed(Memory memory, Py_ssize_t m, double x, double y, double beside) noexcept nogil
