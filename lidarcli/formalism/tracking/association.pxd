cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.tracking cimport assignment as assignments
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport sides as measures
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.assignment cimport Assignment
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.sides cimport Sides
from lidarcli.formalism.tracking.views cimport Views

cdef double INFINITY, GATE, SIZE_CAP, NEWCOMER, REACH, REACH_SIZE, CAP, SIZE_ERROR, MOST_REACH, JOIN


cdef class Pairs:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef Py_ssize_t count
    cdef Py_ssize_t* body
    cdef Py_ssize_t* view
    cdef double* cost
    cdef Py_ssize_t* group
    cdef Py_ssize_t* place
    cdef Py_ssize_t* member
    cdef Py_ssize_t* next
    cdef Py_ssize_t* head


cdef void associate(
    Pairs pairs, Assignment task, Sides sides, Bodies bodies, Views views, Py_ssize_t* owner
) noexcept nogil
cdef void _collect(
    Pairs pairs, Sides sides, Bodies bodies, Views views
) noexcept nogil
cdef double _misfit(
    Sides sides, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k
) noexcept nogil
cdef void _chain(Pairs pairs, Bodies bodies) noexcept nogil
cdef Py_ssize_t _root(Pairs pairs, Py_ssize_t at) noexcept nogil
@cython.locals(rows=Py_ssize_t, columns=Py_ssize_t)
cdef void _assign_group(
    Pairs pairs, Assignment task, Bodies bodies, Py_ssize_t* owner, Py_ssize_t root
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef void join_parts(Bodies bodies, Views views, Py_ssize_t* owner) noexcept nogil
cdef bint _has_room(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k) noexcept nogil
cdef double outside(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
