cimport cython
cimport libc.math as math

from lidarcli cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport belief, estimation, observation
from lidarcli.formalism.tracking.estimation cimport Bodies, Sides, Sightings
from lidarcli.formalism.tracking.observation cimport Views

cdef Py_ssize_t STANDING_SIGHTINGS, MERGED_GAIN, DUPLICATE_SIGHTINGS
cdef double INFINITY, GATE, MOST_SIZE_COST, NEWCOMER_COST, CENTROID_SD, CENTROID_SD_SIZE, MOST_SIDE_COST, SIZE_SD
cdef double FARTHEST_VIEW, PART_MARGIN, SEEN_BEFORE, SLIMMEST_LASTING, DUPLICATE_COST
cdef double WALKING_LEG_WIDTH, LEGS_WIDTH, LEG_REACH, LEG_SD, SAME_PERSON, TWO_LEGS_VAR, ONE_LEG_VAR, JOINT_LEGS_VAR
cdef double PERSON_RADIUS, PERSONS_APART


cdef class Pairs:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef Py_ssize_t count
    cdef Py_ssize_t* body
    cdef Py_ssize_t* view
    cdef double* cost
    cdef Py_ssize_t* group
    cdef Py_ssize_t* place
    cdef Py_ssize_t* member
    cdef Py_ssize_t* next
    cdef Py_ssize_t* head


cdef void associate(
    Pairs pairs, Assignment task, Sides sides, Bodies bodies, Views views, Py_ssize_t* owner
) noexcept nogil
cdef void _pair_views(
    Pairs pairs, Sides sides, Bodies bodies, Views views
) noexcept nogil
cdef double _precedence(Bodies bodies, Views views, Py_ssize_t b) noexcept nogil
cdef double _misfit(
    Sides sides, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k
) noexcept nogil
cdef void _chain(Pairs pairs, Bodies bodies) noexcept nogil
cdef Py_ssize_t _root(Pairs pairs, Py_ssize_t at) noexcept nogil
@cython.locals(rows=Py_ssize_t, columns=Py_ssize_t)
cdef void _assign_group(
    Pairs pairs, Assignment task, Bodies bodies, Py_ssize_t* owner, Py_ssize_t root
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef void join_parts(Bodies bodies, Views views, Py_ssize_t* owner) noexcept nogil
cdef bint _has_room(Bodies bodies, Py_ssize_t b, Views views, Py_ssize_t k) noexcept nogil


cdef class Assignment:
    cdef list owner
    cdef readonly Py_ssize_t most_columns
    cdef public Py_ssize_t rows, columns
    cdef double* cost
    cdef Py_ssize_t* column
    cdef double* row_price
    cdef double* column_price
    cdef Py_ssize_t* taken_by
    cdef Py_ssize_t* before
    cdef double* least
    cdef Py_ssize_t* done


cdef void solve(Assignment task, double without) noexcept nogil
@cython.locals(step=double, next_at=Py_ssize_t, cost=double, i=Py_ssize_t, at=Py_ssize_t)
cdef void _augment(Assignment task, Py_ssize_t row, Py_ssize_t wide, double without) noexcept nogil


cdef class Persons:
    cdef list owner
    cdef readonly Py_ssize_t most
    cdef Py_ssize_t count
    cdef Py_ssize_t* person
    cdef Py_ssize_t* view
    cdef double* cost
    cdef Py_ssize_t* entry
    cdef Py_ssize_t* taken


@cython.locals(leg=Py_ssize_t, b=Py_ssize_t)
cdef void follow_persons(
    Persons persons, Bodies bodies, Views views, Scans scans, Py_ssize_t* owner, Sightings log, double time,
    Py_ssize_t sweep
) noexcept nogil
cdef bint _is_person_seen(Bodies bodies, Py_ssize_t b) noexcept nogil
@cython.locals(elder=Py_ssize_t)
cdef void _merge_person(
    Persons persons, Bodies bodies, Views views, Py_ssize_t* owner, Sightings log, Py_ssize_t b
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef Py_ssize_t _without_leg(Bodies bodies, Views views, Py_ssize_t k) noexcept nogil
cdef bint _is_leg(Bodies bodies, Py_ssize_t b) noexcept nogil
@cython.locals(leg=Py_ssize_t)
cdef void _pair_persons(Persons persons, Bodies bodies, Views views, Py_ssize_t* owner) noexcept nogil
cdef bint _may_be_leg(Bodies bodies, Py_ssize_t b) noexcept nogil
cdef void _sort_pairs(Persons persons) noexcept nogil
@cython.locals(legs=Py_ssize_t)
cdef void _assign_view(Persons persons, Bodies bodies, Views views, Py_ssize_t b, Py_ssize_t k) noexcept nogil
@cython.locals(wide=bint)
cdef void _update_person(
    Persons persons, Bodies bodies, Views views, Scans scans, Py_ssize_t* owner, Sightings log, Py_ssize_t b,
    double time, Py_ssize_t sweep
) noexcept nogil
cdef void _join_leg(Bodies bodies, Py_ssize_t leg, Py_ssize_t b) noexcept nogil
cdef void _rename_sighting(Persons persons, Bodies bodies, Sightings log, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _note_person(Bodies bodies, Py_ssize_t b, double x, double y, double time, Py_ssize_t sweep) noexcept nogil
cdef Py_ssize_t _found_person(
    Persons persons, Bodies bodies, Views views, Sightings log, Py_ssize_t leg, Py_ssize_t k, double time,
    Py_ssize_t sweep
) noexcept nogil
