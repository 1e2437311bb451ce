cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.surfaces cimport faces as surfaces
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef double STRAIGHT, STRAIGHT_NOISE
cdef Py_ssize_t WALL_STRIDE, WALL_POINTS


cdef class Survey:
    cdef list owner
    cdef Py_ssize_t min_beams
    cdef double max_width
    cdef double* chord
    cdef double* tolerance
    cdef double* reach
    cdef Py_ssize_t* protrusion
    cdef Py_ssize_t* wall
    cdef double* thing
    cdef Py_ssize_t* candidate
    cdef Py_ssize_t* loose
    cdef Py_ssize_t* is_object
    cdef Py_ssize_t* label


cdef void measure(Survey survey, Points points, Segments segments) noexcept nogil
cdef void find_faces(Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef void measure_reach(Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef bint is_partial(Segments segments, Py_ssize_t j) noexcept nogil
cdef bint is_end(Py_ssize_t edge) noexcept nogil
cdef double share_of_walls(Survey survey, Points points, Segments segments) noexcept nogil
