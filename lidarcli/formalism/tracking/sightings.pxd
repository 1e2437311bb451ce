from lidarcli cimport native
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.sides cimport Sides


cdef class Sightings:
    cdef public Py_ssize_t count
    cdef readonly Py_ssize_t room
    cdef long long* number
    cdef long long* sweep
    cdef long long* object
    cdef long long* centred
    cdef double* time
    cdef double* x
    cdef double* y
    cdef double* cos
    cdef double* sin
    cdef double* half_1
    cdef double* half_2
    cdef double* odds
    cdef double* z
    cdef double* var


cdef void note(
    Sightings log, Bodies bodies, Py_ssize_t b, Sides sides, Py_ssize_t sweep, double time, Py_ssize_t at,
    double odds
) noexcept nogil
