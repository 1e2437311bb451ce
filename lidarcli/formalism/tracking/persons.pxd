cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport life
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.sightings cimport Sightings
from lidarcli.formalism.tracking.views cimport Views

cdef double SLIM, WIDE, REACH, SPREAD, LOYALTY, PAIR_VAR, ONE_VAR, WIDE_VAR, RADIUS
cdef Py_ssize_t STANDS


cdef class Persons:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef Py_ssize_t count
    cdef Py_ssize_t* person
    cdef Py_ssize_t* view
    cdef double* cost
    cdef Py_ssize_t* entry
    cdef Py_ssize_t* taken


@cython.locals(leg=Py_ssize_t, b=Py_ssize_t)
cdef void follow(
    Persons persons, Bodies bodies, Views views, Scans scans, Py_ssize_t* owner, Sightings log, double time,
    Py_ssize_t sweep
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef Py_ssize_t _without_leg(Bodies bodies, Views views, Py_ssize_t k) noexcept nogil
cdef bint _is_leg(Bodies bodies, Py_ssize_t b) noexcept nogil
@cython.locals(leg=Py_ssize_t)
cdef void _collect(Persons persons, Bodies bodies, Views views, Py_ssize_t* owner) noexcept nogil
cdef bint _may_be_leg(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef void _sort(Persons persons) noexcept nogil
@cython.locals(legs=Py_ssize_t)
cdef void _give(Persons persons, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(wide=bint)
cdef void _update(
    Persons persons, Bodies bodies, Views views, Scans scans, Py_ssize_t* owner, Sightings log, Py_ssize_t b,
    double time, Py_ssize_t sweep
) noexcept nogil
cdef void _join(Bodies bodies, Py_ssize_t leg, Py_ssize_t b) noexcept nogil
cdef void _rename(Persons persons, Bodies bodies, Sightings log, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _note(Bodies bodies, Py_ssize_t b, double x, double y, double time, Py_ssize_t sweep) noexcept nogil
cdef Py_ssize_t _found(
    Persons persons, Bodies bodies, Views views, Sightings log, Py_ssize_t leg, Py_ssize_t k, double time,
    Py_ssize_t sweep
) noexcept nogil
