cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef Py_ssize_t MAX_SPLITS, PASSES
cdef double BLUNT, SIN_BLUNT, INFINITY
cdef double STRAIGHT, STRAIGHT_NOISE
cdef Py_ssize_t WALL_STRIDE, WALL_POINTS


cdef class Faces:
    cdef list owner
    cdef Py_ssize_t* offset
    cdef Py_ssize_t* segment
    cdef Py_ssize_t* first
    cdef Py_ssize_t* last
    cdef Py_ssize_t* points
    cdef double* middle_x
    cdef double* middle_y
    cdef double* direction_x
    cdef double* direction_y
    cdef double* rms
    cdef double* length
    cdef readonly Py_ssize_t count, begin, end
    cdef bint thinned
    cdef double* thin_x
    cdef double* thin_y
    cdef double* x
    cdef double* y
    cdef Py_ssize_t* index
    cdef Py_ssize_t* inner
    cdef Py_ssize_t* vertex
    cdef double* share
    cdef double* away


cdef void straight(
    Faces faces, Points points, Segments segments, Py_ssize_t j, Py_ssize_t most, double tolerance
) noexcept nogil
@cython.locals(is_split=bint, known=Py_ssize_t, to=Py_ssize_t)
cdef void settled(
    Faces faces, Points points, Segments segments, Py_ssize_t j, double tolerance, Py_ssize_t low, Py_ssize_t high
) noexcept nogil
cdef void between(Faces faces, Points points, Segments segments, Py_ssize_t j, Py_ssize_t* inner) noexcept nogil
@cython.locals(n=Py_ssize_t, k=Py_ssize_t)
cdef void _trace(Faces faces, Points points, Segments segments, Py_ssize_t j, Py_ssize_t most) noexcept nogil
cdef void split(Faces faces, double tolerance) noexcept nogil
cdef void _split(Faces faces, Py_ssize_t begin, Py_ssize_t end, double tolerance, Py_ssize_t levels) noexcept nogil
@cython.locals(best=double, some=double, at=Py_ssize_t, k=Py_ssize_t)
cdef Py_ssize_t _farthest(Faces faces, Py_ssize_t begin, Py_ssize_t end, double tolerance) noexcept nogil
@cython.locals(low=bint, found=bint)
cdef bint _drop_flat(Faces faces, double tolerance) noexcept nogil
@cython.locals(found=bint)
cdef bint _drop_doubled(Faces faces, Py_ssize_t begin) noexcept nogil
@cython.locals(usable=bint)
cdef (bint, double, double) meeting(Faces faces, Py_ssize_t one, Py_ssize_t other) noexcept nogil
cdef double turn(Faces faces, Py_ssize_t one, Py_ssize_t other) noexcept nogil
cdef void _join(Faces faces, Py_ssize_t j) noexcept nogil
cdef void _fit(Faces faces, Py_ssize_t f, Py_ssize_t begin, Py_ssize_t end) noexcept nogil


cdef void mark_vertices(Points points, Segments segments, Py_ssize_t* inner, Py_ssize_t* extremum) noexcept nogil


cdef class Survey:
    cdef list owner
    cdef Py_ssize_t min_beams
    cdef double max_width
    cdef double* chord
    cdef double* tolerance
    cdef double* extent
    cdef Py_ssize_t* protrusion
    cdef Py_ssize_t* wall
    cdef double* thing
    cdef Py_ssize_t* candidate
    cdef Py_ssize_t* loose
    cdef Py_ssize_t* is_object
    cdef Py_ssize_t* label


cdef void measure_chords(Survey survey, Points points, Segments segments) noexcept nogil
cdef void find_faces(Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef void measure_extent(Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
cdef bint is_partial(Segments segments, Py_ssize_t j) noexcept nogil
cdef bint is_end(Py_ssize_t edge) noexcept nogil
