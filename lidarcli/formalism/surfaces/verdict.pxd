cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.surfaces cimport appearance, building, sightlines
from lidarcli.formalism.surfaces cimport features as clues
from lidarcli.formalism.surfaces.faces cimport Faces
from lidarcli.formalism.surfaces.features cimport Features
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Scans, Segments

cdef double SURE, PRIOR_THINGS, PRIOR_BODIES


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


cdef void measure(
    Features features, Survey survey, Points points, Segments segments, Faces faces, Bodies bodies,
    Scans scans
) noexcept nogil
cdef void decide(Verdict verdict, Features features, Points points, Segments segments) noexcept nogil
@cython.locals(n=Py_ssize_t)
cdef double score(Trees trees, Features features, Py_ssize_t k) noexcept nogil
@cython.locals(edge=Py_ssize_t, j=Py_ssize_t, step=double, free=double, share=double, some=bint)
cdef void _look_beside(
    Verdict verdict, Features features, Points points, Segments segments, Py_ssize_t k
) noexcept nogil
