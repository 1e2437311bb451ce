from lidarcli cimport native
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef double INFINITY


cdef class Parts:
    cdef list owner
    cdef readonly Py_ssize_t count, objects
    cdef Py_ssize_t* segment
    cdef Py_ssize_t* begin
    cdef Py_ssize_t* sorted
    cdef Py_ssize_t* starts
    cdef Py_ssize_t* rank
    cdef double* least
    cdef double* theta_i
    cdef double* theta_f
    cdef double* past


cdef void assemble(Parts parts, Survey survey, Points points, Segments segments, bint walls) noexcept nogil
cdef void _sort(Parts parts, Survey survey, Points points, Segments segments, bint walls) noexcept nogil
cdef void _insert(Parts parts, Survey survey, Points points, Segments segments, bint objects) noexcept nogil
cdef bint _comes_before(Parts parts, Survey survey, Py_ssize_t a, Py_ssize_t b) noexcept nogil
cdef void _divide(Parts parts, Survey survey) noexcept nogil
cdef void _unwrap(Parts parts, Points points, Py_ssize_t k) noexcept nogil
cdef void _rank(Parts parts, Survey survey) noexcept nogil
cdef bint _is_earlier(Parts parts, Survey survey, Py_ssize_t a, Py_ssize_t b) noexcept nogil
