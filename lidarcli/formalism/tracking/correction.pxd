cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.views cimport Views

cdef Py_ssize_t DELAY, AHEAD, LEFT, ENOUGH
cdef double DELAY_AT_FIRST, DELAY_LEFT, PLACE_AT_FIRST, DELAY_FLOOR, PLACE_FLOOR, BELIEVED, DOUBT, SIDE_VAR, MOST_DELAY


cdef class Correction:
    cdef list owner
    cdef double* value
    cdef double* cov
    cdef double* told
    cdef double speed_x, speed_y, turning
    cdef public double way
    cdef bint has_pose
    cdef double* effect
    cdef double* product
    cdef double* change

    cpdef trust(self)
    cpdef tuple estimate(self)


cdef void place(Correction correction, Views views, double x, double y, double yaw, double side) noexcept nogil
cdef void effect_on(Correction correction, Views views, double x, double y, double u_x, double u_y, Py_ssize_t axis
) noexcept nogil
cdef void learn(Correction correction, Bodies bodies, Py_ssize_t a, double off, double var, Py_ssize_t axis
) noexcept nogil
cdef void follow(Correction correction, Bodies bodies, Py_ssize_t a, double gain, Py_ssize_t axis) noexcept nogil
cdef void apply(Correction correction, Bodies bodies) noexcept nogil
