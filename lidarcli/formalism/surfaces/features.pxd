from lidarcli cimport native
from lidarcli.formalism.surfaces.fragments cimport Bodies
from lidarcli.formalism.surfaces.survey cimport Survey
from lidarcli.formalism cimport segmentation
from lidarcli.formalism.segmentation cimport Points, Segments

cdef Py_ssize_t JUMP_LEAST, JUMP_MOST, HIDDEN, OPEN, WIDTH, REACH, BEAMS, ALIGNED, SUPPORT, SUPPORT_NEAR, BACKING, LINE
cdef Py_ssize_t LINE_BEHIND, DEPTH_BEHIND, LINE_BEFORE, UNBROKEN, CROSS_LINE, BULGE_TO, BULGE_AWAY, BEFORE_BACK, WALLS
cdef Py_ssize_t NOISE, GRAZING, PROTRUSION, ROUGHNESS, VIEW, RANGE, FLICKER, FIRST, JUMP_FREE, HIDDEN_BY_WALL
cdef Py_ssize_t HIDDEN_BY_THING, OTHERS, COUNT, BINS
cdef double FAR, NEARER


cdef class Features:
    cdef list owner
    cdef readonly Py_ssize_t count
    cdef Py_ssize_t* head
    cdef Py_ssize_t* tail
    cdef double* values
    cdef Py_ssize_t* body
    cdef Py_ssize_t* aligned
    cdef Py_ssize_t* axis
    cdef double* offset
    cdef double* low
    cdef double* high
    cdef double cos, sin, share, goes_on
    cdef double* angle
    cdef Py_ssize_t* chosen
    cdef double* bins


cdef void gather(Features features, Survey survey, Points points, Segments segments, Bodies bodies) noexcept nogil
