cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism cimport features, segmentation
from lidarcli.formalism.features cimport Features
from lidarcli.formalism.segmentation cimport Points, Segments
from lidarcli.formalism.surfaces cimport Survey

cdef double SURE_ODDS, PRIOR_THINGS, PRIOR_BODIES


cdef class Trees:
    cdef list owner
    cdef readonly Py_ssize_t trees
    cdef double prior
    cdef Py_ssize_t* root
    cdef Py_ssize_t* feature
    cdef double* bound
    cdef Py_ssize_t* above


cdef class Verdict:
    cdef list owner
    cdef Trees first, second
    cdef double least
    cdef double* odds
    cdef double* thing


cdef void decide(Verdict verdict, Features evidence, Points points, Segments segments) noexcept nogil
@cython.locals(n=Py_ssize_t)
cdef double score(Trees trees, Features evidence, Py_ssize_t k) noexcept nogil
@cython.locals(edge=Py_ssize_t, j=Py_ssize_t, step=double, free=double, share=double, some=bint)
cdef void _look_beside(
    Verdict verdict, Features evidence, Points points, Segments segments, Py_ssize_t k
) noexcept nogil
cdef void choose(Survey survey, Segments segments, Features evidence, Verdict verdict) noexcept nogil
