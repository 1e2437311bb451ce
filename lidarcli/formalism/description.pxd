cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport circle_fit, segmentation, surfaces
from lidarcli.formalism.circle_fit cimport Circle
from lidarcli.formalism.objects cimport Bodies, Parts
from lidarcli.formalism.segmentation cimport Points, Segments
from lidarcli.formalism.surfaces cimport Faces, Survey


cdef Py_ssize_t PRISMATIC, ROUND, IRREGULAR, UNKNOWN, ENOUGH_BEAMS, MAX_FACES
cdef double FIT_FLOOR, STRAIGHT_FIT, SQUARE, COS_SQUARE, WORSE, ARC
cdef double RIGHT_ANGLE_TOLERANCE, SIN_TWICE, TIE, SLIM


cdef class FaceFit:
    cdef readonly Py_ssize_t count, longest, second
    cdef readonly double rms
    cdef readonly bint square


cdef void examine(
    FaceFit look, Faces faces, Parts parts, Py_ssize_t k, bint without_first, bint without_last
) noexcept nogil
cdef Py_ssize_t classify(
    FaceFit look, Circle circle, double sigma, double chord, double mean_x, double mean_y,
    double max_width
) noexcept nogil


cdef class Box:
    cdef readonly double x, y, length, width, yaw
    cdef double low_u, high_u, low_v, high_v


cdef void around_points(Box box, FaceFit look, Faces faces, double* x, double* y, Py_ssize_t n) noexcept nogil
cdef void _bound(
    Box box, double* x, double* y, Py_ssize_t begin, Py_ssize_t end, double along_x, double along_y
) noexcept nogil
cdef double _area(Box box) noexcept nogil
cdef double _slim_area(
    Box box, Circle circle, Faces faces, Py_ssize_t f, Py_ssize_t begin, Py_ssize_t end
) noexcept nogil
cdef double _yaw(double x, double y) noexcept nogil


cdef unsigned char START, END, CORNER, EXTREMUM
cdef Py_ssize_t STRAY, LEFT
cdef double HALF
cdef Py_ssize_t OBJECT, NOISE, LEGGED, WALL, FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN, CUT


cdef class Columns:
    cdef readonly Py_ssize_t objects, vertices, faces, room_objects, room_vertices, room_faces, beam_width
    cdef readonly bint per_beam, explained
    cdef native.Pointers out


cdef bint has_room(Columns columns, Py_ssize_t beams) noexcept nogil


cdef double _overhang(
    Points points, Faces faces, Py_ssize_t f, Py_ssize_t at, Py_ssize_t inner, double side
) noexcept nogil


cdef class Description:
    cdef list owner
    cdef bint adaptive, robust
    cdef Parts parts
    cdef Circle circle
    cdef FaceFit look
    cdef Box box
    cdef readonly Py_ssize_t n
    cdef double* x
    cdef double* y
    cdef Py_ssize_t* extremum


cdef void describe(
    Description description, Columns columns, Points points, Segments segments, Survey survey, Bodies bodies, Faces faces
) noexcept nogil
@cython.locals(several=bint)
cdef void _describe_points(
    Columns columns, Points points, Segments segments, Bodies bodies, Parts parts, Circle circle, Py_ssize_t k
) noexcept nogil
cdef void trace(
    Description description, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Py_ssize_t k
) noexcept nogil
@cython.locals(along=double, g=Py_ssize_t)
cdef void _trace_part(
    Description description, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Py_ssize_t j
) noexcept nogil
cdef void _extend(
    Description description, Columns columns, Points points, Segments segments, Faces faces, Py_ssize_t j
) noexcept nogil
cdef bint _is_hidden(Py_ssize_t edge) noexcept nogil
cdef Py_ssize_t _visibility(Py_ssize_t start_edge, Py_ssize_t end_edge) noexcept nogil
@cython.locals(before=Py_ssize_t, after=Py_ssize_t, whole=double)
cdef void _drop_stray(
    Description description, Faces faces, Parts parts, Circle circle, Box box, FaceFit look, Py_ssize_t k
) noexcept nogil
@cython.locals(chord=double, x=double, y=double)
cdef void _describe_shape(
    Description description, Columns columns, double sigma, double most, Faces faces, Circle circle, Box box, Py_ssize_t k
) noexcept nogil
cdef void _mark_beams(Columns columns, Points points, Segments segments, Parts parts, Py_ssize_t k) noexcept nogil
