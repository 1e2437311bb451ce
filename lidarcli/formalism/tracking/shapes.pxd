cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport memory
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.views cimport Views

cdef Py_ssize_t PRISMATIC, SPECK
cdef double PER_BEAM, SLIM, AROUND, BESIDE, BEHIND, SAME



cdef void note(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k) noexcept nogil
@cython.locals(first=Py_ssize_t, last=Py_ssize_t, run=Py_ssize_t, here=double, before=double, after=double)
cdef void note_legs(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k, Scans scans) noexcept nogil
cdef void _note_leg(Bodies bodies, Py_ssize_t b, double x, double y) noexcept nogil
