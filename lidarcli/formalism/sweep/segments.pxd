from lidarcli cimport native
from lidarcli.formalism.sweep cimport points as sweep
from lidarcli.formalism.sweep.breakpoints cimport Breakpoints
from lidarcli.formalism.sweep.points cimport Points, Scans

cdef Py_ssize_t OWN, HIDDEN, OPEN, UNKNOWN, VIEW, FLICKERING, NO_RETURN
cdef double MOST_FLICKER
cdef double NAN


cdef class Segments:
    cdef list owner
    cdef Py_ssize_t* first
    cdef Py_ssize_t* size
    cdef Py_ssize_t* start_edge
    cdef Py_ssize_t* end_edge
    cdef double* s_start
    cdef double* s_end
    cdef readonly Py_ssize_t count


cdef void cut(Segments segments, Points points, Breakpoints breakpoints, Scans scans) noexcept nogil
cdef void _surround(Segments segments, Points points) noexcept nogil
cdef void _enter(Segments segments, Points points, Breakpoints breakpoints, Scans scans, Py_ssize_t j) noexcept nogil
cdef void _leave(
    Segments segments, Points points, Breakpoints breakpoints, Scans scans, Py_ssize_t j, Py_ssize_t following
) noexcept nogil
cdef Py_ssize_t _beside(Points points, Scans scans, Py_ssize_t position) noexcept nogil
cdef void copy(Segments source, Segments target) noexcept nogil
cdef Py_ssize_t last_point(Segments segments, Py_ssize_t j) noexcept nogil
cdef double chord(Segments segments, Points points, Py_ssize_t j) noexcept nogil
cdef bint surrounds(Segments segments, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t following(Segments segments, Points points, Py_ssize_t j) noexcept nogil
cdef Py_ssize_t preceding(Segments segments, Points points, Py_ssize_t j) noexcept nogil
