cimport cython
cimport libc.math as math

from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport life, memory
from lidarcli.formalism.tracking cimport sides as measures
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.memory cimport Memory
from lidarcli.formalism.tracking.sides cimport Sides
from lidarcli.formalism.tracking.views cimport Views

cdef double STEADY, SAME_SIZE, CLIP, DRIFT, PARTIAL, MOST, WAY, SHARE, STOOD, PASSED, LATEST
cdef Py_ssize_t OFTEN, SETTLED, POINTS


cdef void weigh(Bodies bodies, Py_ssize_t b, Sides sides, bint is_whole) noexcept nogil
cdef double _odds(
    Bodies bodies, Py_ssize_t a, double z, double sign, double var, double lasting
) noexcept nogil
cdef double _axis_odds(Bodies bodies, Py_ssize_t a, Sides sides, Py_ssize_t low) noexcept nogil
cdef void note_rest(Bodies bodies, Py_ssize_t b, Py_ssize_t sweep) noexcept nogil
cdef bint is_shown(
    Bodies bodies, Py_ssize_t b, Views views, Scans scans, Py_ssize_t k, Memory past, double alarm, double time
) noexcept nogil
@cython.locals(times=Py_ssize_t, p=Py_ssize_t)
cdef bint stood_there(
    Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k, Memory past, double time
) noexcept nogil
cdef bint was_free(Views views, Py_ssize_t k, Memory past, double time) noexcept nogil
