cimport cython

from lidarcli.formalism.description cimport box as boxes
from lidarcli.formalism.description cimport outline as outlines
from lidarcli.formalism.description cimport shape as shapes
from lidarcli.formalism.description.box cimport Box
from lidarcli.formalism.description.circle cimport Circle
from lidarcli.formalism.description.columns cimport Columns
from lidarcli.formalism.description.outline cimport Outline
from lidarcli.formalism.description.parts cimport Parts
from lidarcli.formalism.description.shape cimport Look
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.sweep cimport breakpoints as breaks
from lidarcli.formalism.sweep cimport points as sweep
from lidarcli.formalism.sweep cimport segments as cuts
from lidarcli.formalism.sweep.points cimport Points
from lidarcli.formalism.sweep.segments cimport Segments

cdef Py_ssize_t STRAY, LEFT
cdef double HALF
cdef Py_ssize_t OBJECT, NOISE, LEGGED, WALL, FULL, START_HIDDEN, END_HIDDEN, BOTH_HIDDEN, CUT


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
