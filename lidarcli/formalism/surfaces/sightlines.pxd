cimport cython
cimport libc.math as math

from lidarcli.formalism.surfaces cimport building
from lidarcli.formalism.surfaces cimport features as clues
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.features cimport Features
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Scans, Segments

cdef Py_ssize_t OWN_POINTS, BINS_BEFORE, MOST_STRIDE, BEHIND_FIRST, BEHIND_LAST, BEFORE_FIRST, BEFORE_LAST, CROSSED
cdef Py_ssize_t BACK_LEAST, BACK_MOST
cdef double OWN_LENGTH, LINE_REACH, LINE_PLANE, LINE_NOISE, TINY, LINE_PRIOR, BIN, SHALLOWEST, DEEPEST, SPACING, SLANT
cdef double FRONT, BACK_SURFACE, BACK_PLANE, BACK_NOISE


@cython.locals(face=Py_ssize_t, cross=Py_ssize_t, i=Py_ssize_t)
cdef void measure_line(
    Features features, Points points, Segments segments, Faces faces, Scans scans, Py_ssize_t k
) noexcept nogil
@cython.locals(
    i=Py_ssize_t, half=Py_ssize_t, off=Py_ssize_t, line=double, behind=double, depth=double, before=double,
    beyond=double, occupied=double, crossed=double, along_x=double, along_y=double
)
cdef void _measure_face(
    Features features, Points points, Segments segments, Faces faces, Scans scans, Py_ssize_t k, Py_ssize_t face
) noexcept nogil
@cython.locals(
    lost=Py_ssize_t, last=double, begin=double, beyond=double, crossed=Py_ssize_t, far=double, stride=Py_ssize_t,
    left=Py_ssize_t, skip=Py_ssize_t, turn=Py_ssize_t, step=double
)
cdef double _follow(
    Features features, Points points, Scans scans, Py_ssize_t start, int way, double normal_x, double normal_y,
    double c
) noexcept nogil
@cython.locals(number=Py_ssize_t)
cdef void measure_back(Features features, Points points, Segments segments, Py_ssize_t k) noexcept nogil
