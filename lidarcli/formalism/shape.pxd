cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism cimport surfaces
from lidarcli.formalism.objects cimport Parts
from lidarcli.formalism.surfaces cimport Faces

cdef Py_ssize_t REFINEMENTS
cdef double LARGEST, INFINITY
cdef Py_ssize_t PRISMATIC, ROUND, IRREGULAR, UNKNOWN, ENOUGH_BEAMS, MOST_FACES
cdef double FIT_FLOOR, STRAIGHT_FIT, SQUARE, COS_SQUARE, WORSE, ARC
cdef double RIGHT_ANGLE_TOLERANCE, SIN_TWICE, TIE, SLIM


cdef class Circle:
    cdef list owner
    cdef public Py_ssize_t n
    cdef double* x
    cdef double* y
    cdef double centre_x, centre_y, radius, rms, middle_x, middle_y
    cdef bint known
    cdef double* u
    cdef double* v
    cdef double* from_x
    cdef double* from_y
    cdef double* distance


cdef void fit_circle(Circle circle, double within) noexcept nogil
cdef void _algebraic(Circle circle) noexcept nogil
cdef void _measure(Circle circle) noexcept nogil
cdef double _rms(Circle circle) noexcept nogil
cdef void _refine(Circle circle) noexcept nogil


cdef class Look:
    cdef readonly Py_ssize_t count, longest, second
    cdef readonly double rms
    cdef readonly bint square


cdef void examine(
    Look look, Faces faces, Parts parts, Py_ssize_t k, bint without_first, bint without_last
) noexcept nogil
cdef Py_ssize_t classify(
    Look look, Circle circle, double sigma, double chord, double mean_x, double mean_y,
    double max_width
) noexcept nogil


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
