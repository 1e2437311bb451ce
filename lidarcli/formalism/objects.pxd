cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport segmentation, surfaces
from lidarcli.formalism.segmentation cimport Points, Segments
from lidarcli.formalism.surfaces cimport Faces, Survey

cdef double CORNER_TURN, SIN_CORNER_TURN, BACKING, MIN_RELIEF, WIDEST, BEHIND, PLANE
cdef Py_ssize_t TRIM
cdef double FRAGMENT_GAP, FRAGMENT_EXTENT
cdef double LEG_WIDTH
cdef double INFINITY


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
cdef void find_protrusions(Protrusions protrusions, Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
@cython.locals(has_wall_before=bint, has_wall_after=bint)
cdef void _add(
    Protrusions protrusions, Points points, Segments segments, Faces faces, Py_ssize_t j, Py_ssize_t begin,
    Py_ssize_t end, bint pointed
) noexcept nogil
cdef Py_ssize_t _longest(Faces faces, Py_ssize_t at, Py_ssize_t end, Py_ssize_t step) noexcept nogil
cdef bint _is_small(Points points, Faces faces, Py_ssize_t begin, Py_ssize_t end) noexcept nogil
cdef double _relief(Points points, Faces faces, Py_ssize_t begin, Py_ssize_t end, Py_ssize_t wall) noexcept nogil
cdef double depth(Points points, Faces faces, Py_ssize_t wall, Py_ssize_t at) noexcept nogil
cdef Py_ssize_t _trimmed(
    Points points, Faces faces, Py_ssize_t wall, Py_ssize_t at, Py_ssize_t other, Py_ssize_t step, double tolerance
) noexcept nogil
cdef void divide(Protrusions protrusions, Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef void _insert_part(Protrusions protrusions, Py_ssize_t count, Py_ssize_t begin, bint is_protrusion) noexcept nogil
cdef void _append(
    Segments parts, Points points, Segments segments, Py_ssize_t j, Py_ssize_t begin, Py_ssize_t stop, bint stands_out
) noexcept nogil
cdef void _assign(Faces faces, Segments segments) noexcept nogil


cdef class Bodies:
    cdef list owner
    cdef Py_ssize_t* joins
    cdef Py_ssize_t* label
    cdef Py_ssize_t* start_edge
    cdef Py_ssize_t* end_edge
    cdef Py_ssize_t* size
    cdef double* extent
    cdef Py_ssize_t* parts


cdef void join_fragments(Bodies bodies, Survey survey, Points points, Segments segments, Py_ssize_t* may) noexcept nogil
@cython.locals(is_step=bint)
cdef bint _belongs(Survey survey, Points points, Segments segments, Py_ssize_t* may, Py_ssize_t j) noexcept nogil
cdef void _collect(
    Bodies bodies, Survey survey, Points points, Segments segments, Py_ssize_t first, bint ring
) noexcept nogil


@cython.locals(may=bint)
cdef void fully_visible(Survey survey, Segments segments, bint is_known) noexcept nogil
@cython.locals(wide=bint)
@cython.locals(wide=bint, hidden=bint, surrounds=bint)
cdef void pieces(Survey survey, Segments segments) noexcept nogil
@cython.locals(is_whole=bint)
cdef void known_bodies(Survey survey, Segments segments, Bodies bodies) noexcept nogil


cdef void group_legs(Survey survey, Points points, Segments segments, double gap) noexcept nogil
cdef bint _is_leg(Survey survey, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t _root(Survey survey, Py_ssize_t j) noexcept nogil
cdef bint _are_close(Points points, Segments segments, Py_ssize_t a, Py_ssize_t b, double gap) noexcept nogil


cdef class Parts:
    cdef list owner
    cdef readonly Py_ssize_t count, objects
    cdef Py_ssize_t* segment
    cdef Py_ssize_t* begin
    cdef Py_ssize_t* sorted
    cdef Py_ssize_t* starts
    cdef Py_ssize_t* rank
    cdef double* least
    cdef double* theta_i
    cdef double* theta_f
    cdef double* past_seam


cdef void assemble(Parts parts, Survey survey, Points points, Segments segments, bint walls) noexcept nogil
cdef void _insert(Parts parts, Survey survey, Points points, Segments segments, bint objects) noexcept nogil
cdef bint _comes_before(Parts parts, Survey survey, Py_ssize_t a, Py_ssize_t b) noexcept nogil
cdef void _group(Parts parts, Survey survey) noexcept nogil
cdef void _unwrap(Parts parts, Points points, Py_ssize_t k) noexcept nogil
cdef void _rank(Parts parts, Survey survey) noexcept nogil
cdef bint _is_earlier(Parts parts, Survey survey, Py_ssize_t a, Py_ssize_t b) noexcept nogil
