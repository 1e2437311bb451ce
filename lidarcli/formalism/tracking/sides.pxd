cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.views cimport Views

cdef Py_ssize_t ROUND, LEGGED
cdef double AT_LEAST, COS_ALONG, SIN_BEHIND, AT_END, FLOOR, CROOKED, RAGGED, LEGGED_VAR, OPEN_VAR


cdef class Sides:
    cdef list owner
    cdef double* z
    cdef double* var
    cdef bint by_centre, is_doubtful
    cdef double half, half_var, lasting_var


cdef void measure(
    Sides sides, Views views, Py_ssize_t k, Bodies bodies, Py_ssize_t b, double pose_var
) noexcept nogil
cdef double _doubt(Py_ssize_t edge) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void of_box(
    Sides sides, Views views, Py_ssize_t k, double cos, double sin, double pose_var
) noexcept nogil
@cython.locals(side=Py_ssize_t)
cdef void _face_at(Sides sides, Views views, Py_ssize_t f, double cos, double sin, double pose_var) noexcept nogil
@cython.locals(u_x=double, u_y=double, face=Py_ssize_t)
cdef void _end_at(
    Sides sides, Views views, Py_ssize_t k, Py_ssize_t p, double way, double cos, double sin, double pose_var
) noexcept nogil
@cython.locals(own_start=bint, own_end=bint)
cdef void of_disc(
    Sides sides, Views views, Py_ssize_t k, double radius, double radius_var, double pose_var
) noexcept nogil
cdef (double, double) _direction(Views views, double x, double y) noexcept nogil
cdef (double, double) _turned(double x, double y, double angle) noexcept nogil
cdef bint is_partial(Views views, Py_ssize_t k) noexcept nogil
