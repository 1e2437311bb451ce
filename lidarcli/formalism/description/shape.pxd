cimport libc.math as math

from lidarcli.formalism.description cimport circle as circles
from lidarcli.formalism.description.circle cimport Circle
from lidarcli.formalism.description.parts cimport Parts
from lidarcli.formalism.surfaces cimport faces as surfaces
from lidarcli.formalism.surfaces.faces cimport Faces

cdef Py_ssize_t PRISMATIC, ROUND, IRREGULAR, UNKNOWN, ENOUGH_BEAMS, MOST_FACES
cdef double FIT_FLOOR, STRAIGHT_FIT, SQUARE, COS_SQUARE, WORSE, ARC


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
