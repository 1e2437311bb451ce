cimport cython
cimport libc.math as math

from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport association, memory
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.views cimport Views

cdef Py_ssize_t LEFT_VIEW, PASSED, LOST, WITHIN, CONFIRMED
cdef double AT_FIRST, AT_SIGHT, SEEN_AT_ALL, FEW, HITS, DEAD, MARGIN, PATIENCE_STILL, PATIENCE_MOVING, ASTRAY


@cython.locals(first=Py_ssize_t, last=Py_ssize_t, position=Py_ssize_t)
cdef (double, double, double) passing(
    Views views, Scans scans, double x, double y, double near, double beside
) noexcept nogil
cdef (double, double, double) passing_body(
    Views views, Scans scans, Bodies bodies, Py_ssize_t b, double x, double y
) noexcept nogil
cdef void see(Bodies bodies, Py_ssize_t b) noexcept nogil
@cython.locals(still=bint, astray=bint)
cdef void miss(Bodies bodies, Py_ssize_t b, Views views, Scans scans, double time) noexcept nogil
cdef Py_ssize_t around(Bodies bodies, Py_ssize_t b, double x, double y, double beside) noexcept nogil
cdef void finish(Bodies bodies, Py_ssize_t b, Py_ssize_t why) noexcept nogil
