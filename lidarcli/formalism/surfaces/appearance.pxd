cimport cython
cimport libc.math as math

from lidarcli.formalism.surfaces cimport features as clues
from lidarcli.formalism.surfaces.features cimport Features
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments


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
