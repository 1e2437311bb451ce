cimport cython

from lidarcli.formalism.surfaces cimport survey as surveys
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.sweep cimport segments as cuts
from lidarcli.formalism.sweep.points cimport Points
from lidarcli.formalism.sweep.segments cimport Segments

cdef double END_WIDTH, POINTED_WIDTH, HIDDEN_WIDTH, GRAZING, TAN_GRAZING, PARTLY_HIDDEN_WIDTH, ENCLOSED


cdef void fully_visible(Survey survey, Segments segments) noexcept nogil
cdef void known(Survey survey, Segments segments) noexcept nogil
cdef bint _may_be(Survey survey, Segments segments, Py_ssize_t j) noexcept nogil
cdef void pieces(Survey survey, Segments segments) noexcept nogil
cdef void known_bodies(Survey survey, Segments segments, Bodies bodies) noexcept nogil
@cython.locals(enclosed=bint)
cdef void choose(Survey survey, Points points, Segments segments, Bodies bodies) noexcept nogil
cdef bint _is_whole(Survey survey, Bodies bodies, Py_ssize_t j) noexcept nogil
@cython.locals(
    whole=bint, own=bint, open_start=bint, open_end=bint, straight=bint, wide=bint, slight=bint, free=bint, pointed=bint,
    goes_on=bint
)
cdef bint _is_recognisable(
    Survey survey, Points points, Segments segments, Bodies bodies, Py_ssize_t j, bint enclosed
) noexcept nogil
cdef bint _is_open(Py_ssize_t edge) noexcept nogil
cdef bint _is_grazing(Points points, Segments segments, Py_ssize_t j) noexcept nogil
