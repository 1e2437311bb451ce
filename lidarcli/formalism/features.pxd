cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.objects cimport Bodies
from lidarcli.formalism.segmentation cimport Points, Scans, Segments
from lidarcli.formalism.surfaces cimport Faces, Survey


cdef Py_ssize_t JUMP_LEAST, JUMP_MOST, HIDDEN, OPEN, WIDTH, EXTENT, BEAMS, ALIGNED, SUPPORT, SUPPORT_NEAR, BACKING, LINE
cdef Py_ssize_t LINE_BEHIND, DEPTH_BEHIND, LINE_BEFORE, UNBROKEN, CROSS_LINE, BULGE_TO, BULGE_AWAY, WALLS
cdef Py_ssize_t NOISE, GRAZING, PROTRUSION, ROUGHNESS, VIEW, RANGE, FLICKER, COUNT, BINS
cdef double FAR, NEARER
cdef Py_ssize_t DIRECTION_POINTS, FACE_POINTS
cdef double RIGHT_ANGLE, KERNEL, CLOSE, DIRECTION_LENGTH, ALIGNED_LEAST, ALIGNED_MOST, ALIGNED_NOISE, FACE_LENGTH, FACE_PLANE, FACE_PLANE_NOISE
cdef double RELIEF, LINE_NEAR, LINE_BESIDE
cdef Py_ssize_t OWN_POINTS, BINS_BEFORE, MOST_STRIDE, BEHIND_FIRST, BEHIND_LAST, BEFORE_FIRST, BEFORE_LAST, CROSSED
cdef double OWN_LENGTH, LINE_REACH, LINE_PLANE, LINE_NOISE, TINY, LINE_PRIOR, BIN, SHALLOWEST, DEEPEST, SPACING, SLANT
cdef double FRONT


cdef class Features:
    cdef list owner
    cdef readonly Py_ssize_t count
    cdef Py_ssize_t* member
    cdef Py_ssize_t* start
    cdef double* values
    cdef Py_ssize_t* body
    cdef Py_ssize_t* aligned
    cdef Py_ssize_t* axis
    cdef Py_ssize_t* lines
    cdef Py_ssize_t* begin
    cdef double* offset
    cdef double* low
    cdef double* high
    cdef double cos, sin, share, goes_on
    cdef double* angle
    cdef double* length
    cdef double* votes
    cdef double* bins
    cdef double* sums


cdef void gather(Features features, Survey survey, Points points, Segments segments, Bodies bodies) noexcept nogil
cdef void measure(
    Features features, Survey survey, Points points, Segments segments, Faces faces, Bodies bodies,
    Scans scans
) noexcept nogil


cdef double _jump(Py_ssize_t edge, double s) noexcept nogil
cdef bint _is_unseen(Py_ssize_t edge) noexcept nogil
@cython.locals(hidden=Py_ssize_t, unseen=Py_ssize_t, one=double, other=double)
cdef void measure_edges(
    Features features, Points points, Segments segments, Bodies bodies, Py_ssize_t k
) noexcept nogil
@cython.locals(number=Py_ssize_t, towards=double, behind=double, rough=double, off=double, bend=double)
cdef void measure_outline(
    Features features, Survey survey, Points points, Segments segments, Bodies bodies, Py_ssize_t k
) noexcept nogil


@cython.locals(
    a=Py_ssize_t, b=Py_ssize_t, count=Py_ssize_t, best=double, most=double, off=double, one=double, weight=double,
    kernel=double
)
cdef void find_direction(Features features, Faces faces) noexcept nogil
cdef double _turned(double angle) noexcept nogil
@cython.locals(
    turned=bint, is_line=bint, number=Py_ssize_t, more=double, less=double, allowed=double, u=double, v=double
)
cdef void align(Features features, Points points, Faces faces) noexcept nogil
@cython.locals(some=bint, i=Py_ssize_t, longest=double, total=double, aligned=double)
cdef void measure_support(
    Features features, Points points, Segments segments, Faces faces, Py_ssize_t k
) noexcept nogil
@cython.locals(g=Py_ssize_t, everywhere=double, near=double, behind=double, gap=double, depth=double)
cdef void _add_support(
    Features features, Points points, Faces faces, Py_ssize_t k, Py_ssize_t axis, double offset, double low,
    double high, double share
) noexcept nogil


@cython.locals(face=Py_ssize_t, cross=Py_ssize_t, i=Py_ssize_t)
cdef void measure_line(
    Features features, Points points, Segments segments, Faces faces, Scans scans, Py_ssize_t k
) noexcept nogil
@cython.locals(
    i=Py_ssize_t, half=Py_ssize_t, behind=double, depth=double, before=double, share=double, beyond=double,
    along_x=double, along_y=double
)
cdef void _measure_face(
    Features features, Points points, Segments segments, Faces faces, Scans scans, Py_ssize_t k, Py_ssize_t face
) noexcept nogil
@cython.locals(end=Py_ssize_t)
cdef double _share(double* sums, double beyond, Py_ssize_t at, Py_ssize_t half) noexcept nogil
@cython.locals(
    lost=Py_ssize_t, last=double, begin=double, beyond=double, crossed=Py_ssize_t, far=double, stride=Py_ssize_t,
    left=Py_ssize_t, skip=Py_ssize_t, turn=Py_ssize_t, step=double
)
cdef double _follow(
    Features features, Points points, Scans scans, Py_ssize_t start, int sign, double normal_x, double normal_y,
    double c
) noexcept nogil


cdef Py_ssize_t ASKED, LEAVES


cdef class Trees:
    cdef list owner
    cdef readonly Py_ssize_t trees
    cdef double prior
    cdef Py_ssize_t* feature
    cdef double* bound
    cdef double* leaf


cdef class Verdict:
    cdef list owner
    cdef Trees trees
    cdef double least
    cdef double* thing


cdef void decide(Verdict verdict, Features evidence) noexcept nogil
@cython.locals(n=Py_ssize_t, root=Py_ssize_t)
cdef double score(Trees trees, Features evidence, Py_ssize_t k) noexcept nogil
cdef void choose(Survey survey, Segments segments, Features evidence, Verdict verdict) noexcept nogil
