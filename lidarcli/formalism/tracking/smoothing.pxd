cimport cython
cimport libc.math as math

from lidarcli cimport native

cdef Py_ssize_t BOX, AROUND_SIGHTINGS, LIVELINESSES
cdef double INFINITY, LIVELIER_GAIN, FIRST_SPEED_SD, UNKNOWN_VAR, PART_VAR, CHANGE_VAR, MOST_MISFIT, LEAST_SPEED, MOVING_SDS


cdef class Smoother:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef double* z
    cdef double* var
    cdef double* v
    cdef double* v_var
    cdef double* liveliness
    cdef double* acceleration
    cdef double* misfit
    cdef double* x
    cdef double* speed
    cdef double* xx
    cdef double* xv
    cdef double* vv

    cpdef Py_ssize_t locate(
        self, Py_ssize_t begin, dict sighted, object half, object half_var, Py_ssize_t kind, bint several
    ) except -1
    cpdef smooth(
        self, object order, object time, object state, Py_ssize_t keep, Py_ssize_t onset, object vx, object vy,
        object moving
    )


cdef void locate_sightings(
    Smoother room, Py_ssize_t begin, Py_ssize_t count, long long* centred, double* cos, double* sin, double* half_1,
    double* half_2, double* z, double* var, double* half, double* half_var, Py_ssize_t kind, double more
) noexcept nogil
cdef (double, double) centre_of(
    double low, double high, double low_var, double high_var, double half, double half_var
) noexcept nogil
cdef void smooth_axis(
    Smoother room, Py_ssize_t axis, long long* order, double* time, double* state, Py_ssize_t count, Py_ssize_t keep
) noexcept nogil
@cython.locals(total=double, best=Py_ssize_t, first=Py_ssize_t, stop=Py_ssize_t)
cdef void choose_accelerations(Smoother room, Py_ssize_t count) noexcept nogil
@cython.locals(known=bint, i=Py_ssize_t, at=Py_ssize_t)
cdef void filter_forward(
    Smoother room, Py_ssize_t axis, long long* order, double* time, double* state, Py_ssize_t count, Py_ssize_t keep,
    Py_ssize_t trial
) noexcept nogil
@cython.locals(i=Py_ssize_t, at=Py_ssize_t)
cdef void smooth_backward(Smoother room, Py_ssize_t axis, double* time, Py_ssize_t count) noexcept nogil
cdef void decide_motion(
    Smoother room, Py_ssize_t count, Py_ssize_t onset, double* vx, double* vy, unsigned char* moving
) noexcept nogil
