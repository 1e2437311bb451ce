from lidarcli cimport native
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef double GAP, EXTENT


cdef class Bodies:
    cdef list owner
    cdef Py_ssize_t* joins
    cdef Py_ssize_t* label
    cdef Py_ssize_t* start_edge
    cdef Py_ssize_t* end_edge
    cdef Py_ssize_t* size
    cdef double* reach
    cdef Py_ssize_t* parts


cdef void join(Bodies bodies, Survey survey, Points points, Segments segments, Py_ssize_t* may) noexcept nogil
cdef bint _belongs(Survey survey, Points points, Segments segments, Py_ssize_t* may, Py_ssize_t j) noexcept nogil
cdef void _collect(
    Bodies bodies, Survey survey, Points points, Segments segments, Py_ssize_t first, bint ring
) noexcept nogil
