cimport cython

from lidarcli cimport native

cdef double ACCELERATION, SPEED_AT_FIRST


cdef class Smoother:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef double* x
    cdef double* v
    cdef double* xx
    cdef double* xv
    cdef double* vv

    cpdef smooth(self, object time, object z, object var, object v, object v_var, object state, Py_ssize_t keep)


@cython.locals(known=bint, i=Py_ssize_t)
cdef void run(
    Smoother room, double* time, double* z, double* var, double* v, double* v_var, double* state, Py_ssize_t count,
    Py_ssize_t keep
) noexcept nogil
