cimport cython
cimport libc.math as math

from lidarcli.formalism.surfaces cimport features as clues
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.features cimport Features
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef Py_ssize_t DIRECTION_POINTS, FACE_POINTS
cdef double RIGHT_ANGLE, KERNEL, CLOSE, DIRECTION_LENGTH, ALIGNED_LEAST, ALIGNED_MOST, ALIGNED_NOISE, FACE_LENGTH, PLANE, PLANE_NOISE
cdef double RELIEF, NEAR, BESIDE


@cython.locals(a=Py_ssize_t, b=Py_ssize_t, count=Py_ssize_t, best=double, most=double, votes=double, off=double)
cdef void find_direction(Features features, Faces faces) noexcept nogil
cdef double _turned(double angle) noexcept nogil
@cython.locals(turned=bint, more=double, less=double, allowed=double, u=double, v=double)
cdef void align(Features features, Points points, Faces faces) noexcept nogil
@cython.locals(some=bint, i=Py_ssize_t, longest=double, total=double, aligned=double)
cdef void measure_support(
    Features features, Points points, Segments segments, Faces faces, Py_ssize_t k
) noexcept nogil
@cython.locals(everywhere=double, near=double, behind=double, gap=double, depth=double)
cdef void _add_support(
    Features features, Points points, Faces faces, Py_ssize_t k, Py_ssize_t axis, double offset, double low,
    double high, double weight
) noexcept nogil
