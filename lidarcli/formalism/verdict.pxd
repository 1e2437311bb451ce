cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport features
from lidarcli.formalism.features cimport Features
from lidarcli.formalism.segmentation cimport Segments
from lidarcli.formalism.surfaces cimport Survey

cdef Py_ssize_t COUNT


cdef class Trees:
    cdef list owner
    cdef readonly Py_ssize_t trees
    cdef double prior
    cdef Py_ssize_t* feature
    cdef double* bound
    cdef double* leaf


cdef class Verdict:
    cdef list owner
    cdef Trees trees
    cdef double least
    cdef double* asked
    cdef double* thing


cdef void decide(Verdict verdict, Features evidence) noexcept nogil
@cython.locals(n=Py_ssize_t)
cdef double score(Trees trees, double* values) noexcept nogil
cdef void choose(Survey survey, Segments segments, Features evidence, Verdict verdict) noexcept nogil
