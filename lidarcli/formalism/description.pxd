cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism cimport segmentation, shape, surfaces
from lidarcli.formalism.objects cimport Bodies, Parts
from lidarcli.formalism.segmentation cimport Points, Segments
from lidarcli.formalism.shape cimport Box, Circle, Look
from lidarcli.formalism.surfaces cimport Faces, Survey

cdef unsigned char START, END, CORNER, EXTREMUM
cdef Py_ssize_t STRAY, LEFT
cdef double HALF
cdef Py_ssize_t OBJECT, NOISE, LEGGED, WALL, FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN, CUT


cdef class Columns:
    cdef readonly Py_ssize_t objects, vertices, faces, room_objects, room_vertices, room_faces, beam_width
    cdef readonly bint per_beam, explained
    cdef native.Pointers out


cdef bint has_room(Columns columns, Py_ssize_t beams) noexcept nogil


cdef class Outline:
    cdef list owner
    cdef bint located
    cdef readonly Py_ssize_t n
    cdef double* x
    cdef double* y
    cdef Py_ssize_t* extremum


cdef void trace(
    Outline outline, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Parts parts,
    Py_ssize_t k
) noexcept nogil
cdef void _trace_part(
    Outline outline, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Parts parts,
    Py_ssize_t j
) noexcept nogil
cdef (double, double) _on_line(Faces faces, Py_ssize_t f, double x, double y) noexcept nogil
cdef void _add_face(Columns columns, Faces faces, Py_ssize_t f, Py_ssize_t v, double length) noexcept nogil
cdef void _extend(
    Outline outline, Columns columns, Points points, Segments segments, Faces faces, Py_ssize_t j, Py_ssize_t begin,
    Py_ssize_t first_face
) noexcept nogil
cdef double _overhang(
    Points points, Faces faces, Py_ssize_t f, Py_ssize_t at, Py_ssize_t inner, double side
) noexcept nogil


cdef class Description:
    cdef bint adaptive, robust
    cdef Parts parts
    cdef Outline outline
    cdef Circle circle
    cdef Look look
    cdef Box box


cdef void describe(
    Description description, Columns columns, Points points, Segments segments, Survey survey, Bodies bodies,
    Faces faces
) noexcept nogil
@cython.locals(several=bint)
cdef void _describe_points(
    Columns columns, Points points, Segments segments, Bodies bodies, Parts parts, Circle circle, Py_ssize_t k
) noexcept nogil
cdef bint _is_hidden(Py_ssize_t edge) noexcept nogil
cdef Py_ssize_t _visibility(Py_ssize_t start_edge, Py_ssize_t end_edge) noexcept nogil
@cython.locals(before=Py_ssize_t, after=Py_ssize_t, whole=double)
cdef void _drop_stray(
    Faces faces, Parts parts, Circle circle, Look look, Outline outline, Py_ssize_t k
) noexcept nogil
cdef void _describe_shape(
    Columns columns, Points points, Survey survey, Faces faces, Outline outline, Circle circle, Look look, Box box, Py_ssize_t parts
) noexcept nogil
cdef void _mark_beams(Columns columns, Points points, Segments segments, Parts parts, Py_ssize_t k) noexcept nogil
