cimport cython
cimport libc.math as math

from lidarcli.system cimport native

cdef double TURN, TINY, NEAREST_RANGE, FARTHEST_RANGE, GRAIN, LINE_REACH, GAP, GAP_BEAMS, LINE_VAR, LINE_VAR_GROWS
cdef double STRETCHED, EVEN, LONGEST_CHORD
cdef Py_ssize_t MAX_POINTS, MAX_NEIGHBOURS, MIN_NEIGHBOURS


cdef class Outline:
    cdef list owner
    cdef Py_ssize_t most, count, takes_time
    cdef double* x
    cdef double* y
    cdef double* nx
    cdef double* ny
    cdef double* late
    cdef double* r
    cdef Py_ssize_t* line
    cdef double* at_x
    cdef double* at_y
    cdef double* at_nx
    cdef double* at_ny
    cdef double* beam_x
    cdef double* beam_y
    cdef double* beam_r


@cython.locals(closed=Py_ssize_t, last=Py_ssize_t, k=Py_ssize_t, i=Py_ssize_t)
cdef void read_outline(
    Outline points, float* r, Py_ssize_t at, Py_ssize_t beams, double first, double step, double begin, double end
) noexcept nogil
@cython.locals(
    most=Py_ssize_t, number=Py_ssize_t, fewest=Py_ssize_t, side=Py_ssize_t, d=Py_ssize_t, before=Py_ssize_t,
    taken=Py_ssize_t, q=Py_ssize_t, j=Py_ssize_t, u=Py_ssize_t, v=Py_ssize_t
)
cdef Py_ssize_t fit_line(
    Outline points, Py_ssize_t i, Py_ssize_t k, Py_ssize_t beams, Py_ssize_t closed, double turn
) noexcept nogil
cdef Py_ssize_t adjacent_beam(Py_ssize_t k, Py_ssize_t beams, Py_ssize_t closed) noexcept nogil
cdef Py_ssize_t is_even(
    Outline points, Py_ssize_t one, Py_ssize_t middle, Py_ssize_t other, double turn
) noexcept nogil
cdef void set_normal(Outline points, Py_ssize_t i, double nx, double ny) noexcept nogil
cdef void deskew(Outline points, double vx, double vy, double vyaw) noexcept nogil
cdef (double, double, double) driven(double vx, double vy, double vyaw, double seconds) noexcept nogil
cdef (double, double, double) velocity_of(double x, double y, double yaw, double seconds) noexcept nogil
cdef (double, double, double) step_between(
    double x, double y, double yaw, double to_x, double to_y, double to_yaw
) noexcept nogil
cdef (double, double, double) pose_after(
    double x, double y, double yaw, double dx, double dy, double turn
) noexcept nogil
@cython.locals(i=Py_ssize_t)
cdef void copy_outline(Outline to, Outline of) noexcept nogil
