cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport association, life, memory, motion, shapes, sightings
from lidarcli.formalism.tracking cimport bodies as things
from lidarcli.formalism.tracking cimport correction as corrections
from lidarcli.formalism.tracking cimport persons as walkers
from lidarcli.formalism.tracking cimport sides as measures
from lidarcli.formalism.tracking cimport views as looks
from lidarcli.formalism.tracking.assignment cimport Assignment
from lidarcli.formalism.tracking.association cimport Pairs
from lidarcli.formalism.tracking.bodies cimport Bodies
from lidarcli.formalism.tracking.correction cimport Correction
from lidarcli.formalism.tracking.memory cimport Memory
from lidarcli.formalism.tracking.persons cimport Persons
from lidarcli.formalism.tracking.sides cimport Sides
from lidarcli.formalism.tracking.sightings cimport Sightings
from lidarcli.formalism.tracking.views cimport Seen, Views

cdef Py_ssize_t PRISMATIC, UNKNOWN, ENOUGH_BEAMS, BOXY, SIZE_BEAMS, FACE_POINTS
cdef double SLIMMEST_BOX, YAW_FLOOR, FARTHEST, DRIFT, DRIFT_YAW, DRIFT_TURN, BEYOND, LEAST_VAR, MOST_PAUSE, SIDE_ERROR, OUTLIER


cdef class Fold:
    cdef list owner, taken_room
    cdef double alarm, stamp, usual, lapse, way, turned
    cdef readonly double clock
    cdef public Py_ssize_t sweeps, objects
    cdef public bint moves
    cdef Sides sides
    cdef readonly Sightings log
    cdef readonly Bodies bodies
    cdef readonly Views views
    cdef readonly Memory past
    cdef Pairs pairs
    cdef Persons persons
    cdef Assignment task
    cdef readonly Correction correction
    cdef Py_ssize_t* taken

    cpdef fit(self, Bodies bodies, Views views, Memory past)
    cpdef Py_ssize_t follow(self, Seen seen, Scans scans, Py_ssize_t row, Py_ssize_t stop, object number) except -1


cdef bint has_room(Fold fold, Seen seen, Py_ssize_t row) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef void step(Fold fold, Seen seen, Scans scans, Py_ssize_t row, long long* number) noexcept nogil
cdef double _tick(Fold fold, double stamp) noexcept nogil
cdef double _creep(Fold fold, Py_ssize_t b) noexcept nogil
cdef void _judge_pose(Fold fold, Seen seen, Py_ssize_t row, double dt) noexcept nogil
@cython.locals(b=Py_ssize_t)
cdef Py_ssize_t _begin(Fold fold, Bodies bodies, Views views, Py_ssize_t k) noexcept nogil
cdef void _make_box(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _make_disc(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _depend_on_pose(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef (double, double) _direction(Views views, Py_ssize_t k) noexcept nogil
@cython.locals(is_whole=bint)
cdef void _take(Fold fold, Bodies bodies, Views views, Scans scans, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef bint _is_boxy(Views views, Py_ssize_t k) noexcept nogil
cdef void _consider_box(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(tells=bint)
cdef void _learn(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _update_disc(Bodies bodies, Sides sides, Correction correction, Py_ssize_t b) noexcept nogil
cdef void _update_box(Bodies bodies, Sides sides, Correction correction, Py_ssize_t b) noexcept nogil
cdef void _note_extent(Bodies bodies, Py_ssize_t a, double length, double var) noexcept nogil
cdef void _note_view(Fold fold, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
