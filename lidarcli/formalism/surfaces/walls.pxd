cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.surfaces cimport survey as surveys
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.sweep cimport segments as cuts
from lidarcli.formalism.sweep.points cimport Points
from lidarcli.formalism.sweep.segments cimport Segments

cdef double FEW_WALLS, UNKNOWN_WIDTH, LINE_LENGTH, COLLINEAR, NOISE_GAIN, WALL_THICKNESS, DOORWAY, NEXT_PIECE
cdef double PAIR_ERROR, REACH_LIMIT, INFINITY
cdef Py_ssize_t LINE_POINTS


cdef class Lines:
    cdef list owner
    cdef readonly Py_ssize_t count
    cdef Py_ssize_t* face
    cdef Py_ssize_t* matched
    cdef double* balance
    cdef bint on_line, jamb
    cdef double reach, beyond, error


@cython.locals(unknown=bint, doorways=bint)
cdef void by_extent(Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
@cython.locals(gives=bint)
cdef void by_lines(Lines lines, Survey survey, Points points, Segments segments, Faces faces) noexcept nogil
@cython.locals(on_line=bint, pair=bint)
cdef void _match(Lines lines, Survey survey, Points points, Faces faces, Py_ssize_t line) noexcept nogil
@cython.locals(inside=bint, nearest=double, farthest=double, line_error=double, share=double)
cdef void _place(Lines lines, Points points, Faces faces, Py_ssize_t line, Py_ssize_t face) noexcept nogil
