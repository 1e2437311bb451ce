cimport libc.math as math

from lidarcli.formalism.description.shape cimport Look
from lidarcli.formalism.surfaces.faces cimport Faces

cdef double RIGHT_ANGLE, SIN_TWICE, TIE, SLIM


cdef class Box:
    cdef readonly double x, y, length, width, yaw
    cdef double low_u, high_u, low_v, high_v


cdef void around_circle(Box box, double x, double y, double radius) noexcept nogil
cdef void around_points(Box box, Look look, Faces faces, double* x, double* y, Py_ssize_t n) noexcept nogil
cdef double area_along(
    Faces faces, Py_ssize_t f, double* x, double* y, Py_ssize_t begin, Py_ssize_t end
) noexcept nogil
cdef void _bound(Box box, double* x, double* y, Py_ssize_t n, double along_x, double along_y) noexcept nogil
cdef double _area(Box box) noexcept nogil
cdef double _yaw(double x, double y) noexcept nogil
