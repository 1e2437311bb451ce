from lidarcli.formalism.sweep.points cimport Points
from lidarcli.formalism.sweep.segments cimport Segments


cdef void mark(Points points, Segments segments, Py_ssize_t* inner, Py_ssize_t* extremum) noexcept nogil
