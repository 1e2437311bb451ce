cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.tracking.kalman cimport Sightings

cdef Py_ssize_t BOX, AROUND_SIGHTINGS, LIVELINESSES, STATE, SQUARE, GAIN
cdef double INFINITY, LIVELIER_GAIN, FIRST_SPEED_SD, UNKNOWN_VAR, PART_VAR, LEGS_VAR, LEG_VAR, LEG_SECONDS, CHANGE_VAR
cdef double MAX_MISFIT, MIN_SPEED, MOVING_SDS


cdef class Smoother:
    cdef list owner
    cdef readonly Py_ssize_t sweeps
    cdef double* place
    cdef double* noise
    cdef double* common
    cdef double* z
    cdef double* r
    cdef double* lasting
    cdef double* liveliness
    cdef double* acceleration
    cdef double* misfit
    cdef double* x
    cdef double* p
    cdef double* off
    cdef double* inverse
    cdef double* gain
    cdef double* step
    cdef double* adjoint
    cdef double* matrix
    cdef double* product

    cpdef Py_ssize_t locate(
        self, Py_ssize_t begin, Sightings sightings, object rows, object half, object half_var, Py_ssize_t kind, bint several
    ) except -1
    cpdef measure(self, object order, object sweep, object parts, object legs)
    cpdef smooth(
        self, object time, object parts, object legs, object state, Py_ssize_t keep, object path,
        object moving
    )


@cython.locals(cov=Py_ssize_t, at=Py_ssize_t, row=Py_ssize_t, side=Py_ssize_t)
cdef void locate_sightings(
    Smoother smoother, Py_ssize_t begin, Py_ssize_t count, long long* rows, Sightings sightings, double* half,
    double* half_var, Py_ssize_t kind, double more
) noexcept nogil
cdef (double, double, double) centre_of(
    Sightings sightings, Py_ssize_t side, double half, double half_var
) noexcept nogil
@cython.locals(i=Py_ssize_t, at=Py_ssize_t, c=Py_ssize_t, k=Py_ssize_t)
cdef void average_parts(
    Smoother smoother, Py_ssize_t sightings, Py_ssize_t sweeps, long long* order, long long* sweep, long long* parts,
    unsigned char* legs
) noexcept nogil
cdef void smooth_path(
    Smoother smoother, double* time, long long* parts, unsigned char* legs, double* state, Py_ssize_t count, Py_ssize_t keep,
    double* path
) noexcept nogil
@cython.locals(total=double, best=Py_ssize_t, first=Py_ssize_t, stop=Py_ssize_t)
cdef void choose_accelerations(Smoother smoother, long long* parts, unsigned char* legs, Py_ssize_t count) noexcept nogil
@cython.locals(known=bint, i=Py_ssize_t, k=Py_ssize_t)
cdef void filter_forward(
    Smoother smoother, double* time, long long* parts, unsigned char* legs, double* state, Py_ssize_t count, Py_ssize_t keep,
    Py_ssize_t trial
) noexcept nogil
@cython.locals(a=Py_ssize_t, k=Py_ssize_t)
cdef void begin_path(Smoother smoother, Py_ssize_t legs) noexcept nogil
@cython.locals(a=Py_ssize_t, k=Py_ssize_t, x=Py_ssize_t, p=Py_ssize_t)
cdef void predict_state(Smoother smoother, Py_ssize_t i, double* state, double dt) noexcept nogil
@cython.locals(a=Py_ssize_t, k=Py_ssize_t, m=Py_ssize_t, x=Py_ssize_t, p=Py_ssize_t, g=Py_ssize_t)
cdef double update_state(Smoother smoother, Py_ssize_t i, Py_ssize_t legs) noexcept nogil
@cython.locals(back=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
cdef void smooth_backward(
    Smoother smoother, long long* parts, unsigned char* legs, Py_ssize_t count, double* path
) noexcept nogil
@cython.locals(x=Py_ssize_t, p=Py_ssize_t, k=Py_ssize_t, n=Py_ssize_t, o=Py_ssize_t, c=Py_ssize_t)
cdef void write_path(Smoother smoother, Py_ssize_t i, double* path) noexcept nogil
@cython.locals(
    g=Py_ssize_t, a=Py_ssize_t, b=Py_ssize_t, k=Py_ssize_t, n=Py_ssize_t, one=double, other=double, first=double,
    second=double, xx=double, xy=double, yy=double, more=double
)
cdef void adjoin_update(Smoother smoother, Py_ssize_t i, Py_ssize_t legs) noexcept nogil
@cython.locals(a=Py_ssize_t, n=Py_ssize_t)
cdef void adjoin_step(Smoother smoother, Py_ssize_t i) noexcept nogil
@cython.locals(at=Py_ssize_t)
cdef void decide_motion(Py_ssize_t count, double* path, unsigned char* moving) noexcept nogil
