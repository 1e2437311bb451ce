cimport libc.math as math

from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.segmentation cimport Points, Segments

cdef double LEG_WIDTH


cdef void group(Survey survey, Points points, Segments segments, double gap) noexcept nogil
cdef bint _is_leg(Survey survey, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t _root(Survey survey, Py_ssize_t j) noexcept nogil
cdef bint _are_close(Points points, Segments segments, Py_ssize_t a, Py_ssize_t b, double gap) noexcept nogil
