cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.objects cimport Bodies
from lidarcli.formalism.segmentation cimport Points, Scans, Segments
from lidarcli.formalism.surfaces cimport Faces, Survey


cdef Py_ssize_t JUMP, GAP, FLICKER, BESIDE, AROUND, DEEPER, BODIES, SLIM
cdef Py_ssize_t LINE, UNBROKEN, ARMS, SUPPORT, BEYOND, WALL_BEFORE
cdef Py_ssize_t WIDTH, EXTENT, RANGE, BULGE_AWAY, ARC, COUNT
cdef double FAR, NEARER, SHORTEST, LONGEST
cdef double OUTSIDE, DEEPEST, BESIDE_ANGLE, AROUND_ANGLE, DEEPER_ANGLE, DEEPER_BY
cdef double NEAR_BODIES, SLIM_WIDTH, NO_SLIM
cdef Py_ssize_t LOOKS, DIRECTION_POINTS, LINE_POINTS, FEW_POINTS, MAX_STRIDE, CROSSED
cdef double RIGHT_ANGLE, KERNEL, CLOSE, DIRECTION_LENGTH, PLANE, PLANE_NOISE
cdef double SLANTED, SHORT, SHORT_SLANT, LONG_SLANT, WIDEST, BEYOND_BY, LOG_SCALE
cdef double WALL_LENGTH, WALL_BEHIND, TIE
cdef double ALIGNED, ARM, LINE_REACH, LINE_PRIOR, HIDDEN_BY, SPACING, SLANT, FRONT, NEAREST_LINE


cdef class Features:
    cdef list owner
    cdef readonly Py_ssize_t count
    cdef Py_ssize_t* member
    cdef Py_ssize_t* start
    cdef double* values
    cdef Py_ssize_t* body
    cdef Py_ssize_t* first
    cdef Py_ssize_t* last
    cdef double* x
    cdef double* y
    cdef double cos, sin, met, goes_on, crossed, supported
    cdef Py_ssize_t* lines
    cdef Py_ssize_t* walls
    cdef Py_ssize_t line_count, wall_count
    cdef Py_ssize_t* axis
    cdef double* aligned
    cdef double* offset
    cdef double* angle
    cdef double* length
    cdef double* votes


cdef void gather(Features features, Survey survey, Points points, Segments segments, Bodies bodies) noexcept nogil
cdef void measure(
    Features features, Survey survey, Points points, Segments segments, Faces faces, Bodies bodies,
    Scans scans
) noexcept nogil


@cython.locals(a=Py_ssize_t, b=Py_ssize_t, width=double, base=double, behind=double, steps=double)
cdef void measure_outline(
    Features features, Points points, Segments segments, Bodies bodies, Py_ssize_t k
) noexcept nogil
cdef double _jump(Py_ssize_t edge, double s) noexcept nogil
@cython.locals(one=double, other=double)
cdef void measure_edges(Features features, Points points, Segments segments, Py_ssize_t k) noexcept nogil
@cython.locals(q=Py_ssize_t)
cdef double _gap(Points points, Py_ssize_t p, int step) noexcept nogil


@cython.locals(
    a=Py_ssize_t, b=Py_ssize_t, from_a=Py_ssize_t, from_b=Py_ssize_t, ra=double, rb=double, steps=Py_ssize_t,
    stride=Py_ssize_t, i=Py_ssize_t, one=double, other=double, deeper=double, per_depth=double, looks=Py_ssize_t, bodies=double,
    slim=double, off=double
)
cdef void measure_surroundings(Features features, Points points, Scans scans, Py_ssize_t k) noexcept nogil
@cython.locals(steps=Py_ssize_t)
cdef Py_ssize_t _steps(Points points, double angle) noexcept nogil
@cython.locals(away=double)
cdef double _depth(Points points, Scans scans, Py_ssize_t position, double r) noexcept nogil


@cython.locals(
    a=Py_ssize_t, b=Py_ssize_t, count=Py_ssize_t, best=double, most=double, off=double, one=double, weight=double,
    kernel=double
)
cdef void find_direction(Features features, Faces faces) noexcept nogil
cdef double _turned(double angle) noexcept nogil
@cython.locals(along=double, across=double)
cdef void align(Features features, Faces faces) noexcept nogil
@cython.locals(
    face=Py_ssize_t, arm=Py_ssize_t, i=Py_ssize_t, support=double, aligned=double, told=double, beyond=double,
    own_line=double
)
cdef void measure_lines(
    Features features, Points points, Faces faces, Scans scans, Py_ssize_t k
) noexcept nogil
@cython.locals(
    i=Py_ssize_t, plane=double, slack=double, on=double, beyond=double, whole=double, per_depth=double, axis=Py_ssize_t, offset=double,
    most=double, supported=double, aside=double, length=double, off=double, along=double,
    turned=double
)
cdef double _on_line(
    Features features, Points points, Faces faces, Py_ssize_t k, Py_ssize_t face
) noexcept nogil
@cython.locals(
    i=Py_ssize_t, plane=double, most=double, one=double, other=double, off=double, on=double,
    x=double, y=double, along=double, across=double
)
cdef double _supported(Features features, Points points, Faces faces, Py_ssize_t k) noexcept nogil
cdef double _share(double off) noexcept nogil
@cython.locals(i=Py_ssize_t, nearest=double, before=double, off=double, along=double, past=double, apart=double)
cdef void measure_walls(Features features, Faces faces, Py_ssize_t k) noexcept nogil


@cython.locals(along_x=double, along_y=double, ahead=double, aside=double)
cdef void _measure_face(
    Features features, Points points, Faces faces, Scans scans, Py_ssize_t k, Py_ssize_t face
) noexcept nogil
cdef bint _is_lost(Points points, Scans scans, Py_ssize_t position) noexcept nogil
@cython.locals(
    count=Py_ssize_t, p=Py_ssize_t, lost=Py_ssize_t, last=double, begin=double, through=Py_ssize_t, far=double, met=double,
    crossed=double, stride=Py_ssize_t, left=Py_ssize_t, here=Py_ssize_t, expected=Py_ssize_t, ahead=Py_ssize_t, step=double,
    on=double, past=double, per_plane=double
)
cdef void _follow(
    Features features, Points points, Scans scans, Py_ssize_t start, int sign, double normal_x, double normal_y,
    double c
) noexcept nogil
