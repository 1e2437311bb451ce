cimport cython

from lidarcli cimport native
from lidarcli.formalism.surfaces cimport faces as surfaces
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef double TURN, SIN_TURN, BACKING, RELIEF, WIDEST, BEHIND, PLANE
cdef Py_ssize_t TRIM


cdef class Protrusions:
    cdef list owner
    cdef readonly Py_ssize_t count
    cdef Py_ssize_t* segment
    cdef Py_ssize_t* first
    cdef Py_ssize_t* last
    cdef Segments parts
    cdef Py_ssize_t* stands_out
    cdef Py_ssize_t* begin
    cdef Py_ssize_t* is_protrusion


@cython.locals(pointed=bint)
cdef void find(Protrusions protrusions, Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
@cython.locals(has_wall_before=bint, has_wall_after=bint)
cdef void _add(
    Protrusions protrusions, Points points, Segments segments, Faces faces, Py_ssize_t j, Py_ssize_t begin,
    Py_ssize_t end, bint pointed
) noexcept nogil
cdef Py_ssize_t _longest_before(Faces faces, Py_ssize_t at, Py_ssize_t low) noexcept nogil
cdef Py_ssize_t _longest_after(Faces faces, Py_ssize_t at, Py_ssize_t high) noexcept nogil
cdef bint _is_small(Points points, Faces faces, Py_ssize_t begin, Py_ssize_t end) noexcept nogil
cdef double _relief(Points points, Faces faces, Py_ssize_t begin, Py_ssize_t end, Py_ssize_t wall) noexcept nogil
cdef double depth(Points points, Faces faces, Py_ssize_t wall, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t _trimmed(
    Points points, Faces faces, Py_ssize_t wall, Py_ssize_t at, Py_ssize_t other, Py_ssize_t way, double tolerance
) noexcept nogil
cdef void divide(Protrusions protrusions, Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef void _insert(Protrusions protrusions, Py_ssize_t count, Py_ssize_t begin, bint is_protrusion) noexcept nogil
cdef void _append(
    Segments parts, Points points, Segments segments, Py_ssize_t j, Py_ssize_t begin, Py_ssize_t stop, bint stands_out
) noexcept nogil
cdef void _assign(Faces faces, Segments segments) noexcept nogil
