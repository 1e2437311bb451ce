cimport cython

from lidarcli.formalism.surfaces cimport survey as surveys
from lidarcli.formalism.surfaces.features cimport Features
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.surfaces.verdict cimport Verdict
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Segments


cdef void fully_visible(Survey survey, Segments segments) noexcept nogil
cdef void known(Survey survey, Segments segments) noexcept nogil
cdef bint _may_be(Survey survey, Segments segments, Py_ssize_t j) noexcept nogil
@cython.locals(wide=bint)
cdef void pieces(Survey survey, Segments segments) noexcept nogil
cdef void known_bodies(Survey survey, Segments segments, Bodies bodies) noexcept nogil
cdef void choose(Survey survey, Segments segments, Features features, Verdict verdict) noexcept nogil
cdef bint _is_whole(Survey survey, Bodies bodies, Py_ssize_t j) noexcept nogil
