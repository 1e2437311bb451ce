cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.description.columns cimport Columns
from lidarcli.formalism.description.parts cimport Parts
from lidarcli.formalism.surfaces cimport faces as surfaces
from lidarcli.formalism.surfaces cimport survey as surveys
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism.sweep cimport points as sweep
from lidarcli.formalism.sweep cimport segments as cuts
from lidarcli.formalism.sweep.points cimport Points
from lidarcli.formalism.sweep.segments cimport Segments

cdef unsigned char START, END, CORNER, EXTREMUM


cdef class Outline:
    cdef list owner
    cdef bint located
    cdef readonly Py_ssize_t n
    cdef double* x
    cdef double* y
    cdef Py_ssize_t* extremum


cdef void trace(
    Outline outline, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Parts parts,
    Py_ssize_t k
) noexcept nogil
cdef void _trace_part(
    Outline outline, Columns columns, Points points, Segments segments, Survey survey, Faces faces, Parts parts,
    Py_ssize_t j
) noexcept nogil
cdef (double, double) _on_line(Faces faces, Py_ssize_t f, double x, double y) noexcept nogil
cdef void _add_face(Columns columns, Faces faces, Py_ssize_t f, Py_ssize_t v, double length) noexcept nogil
cdef void _extend(
    Outline outline, Columns columns, Points points, Segments segments, Faces faces, Py_ssize_t j, Py_ssize_t begin,
    Py_ssize_t first_face
) noexcept nogil
cdef double _overhang(
    Points points, Faces faces, Py_ssize_t f, Py_ssize_t at, Py_ssize_t inner, double side
) noexcept nogil
