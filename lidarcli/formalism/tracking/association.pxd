cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.segmentation cimport Scans
from lidarcli.formalism.tracking cimport kalman, keyframes, measurement, track_evidence
from lidarcli.formalism.tracking.kalman cimport Sightings, Targets
from lidarcli.formalism.tracking.keyframes cimport Keyframes
from lidarcli.formalism.tracking.measurement cimport EdgeMeasurement, Measurements

cdef Py_ssize_t STANDING_SIGHTINGS, MERGED_GAIN, DUPLICATE_SIGHTINGS
cdef double INFINITY, MIN_WAY, GATE, MAX_SIZE_COST, NEWCOMER_COST, CENTROID_SD, CENTROID_SD_SIZE, MAX_SIDE_COST, SIZE_SD
cdef double FARTHEST_VIEW, PART_MARGIN, SEEN_BEFORE, SLIMMEST_LASTING, DUPLICATE_COST
cdef double WALKING_LEG_WIDTH, LEGS_WIDTH, LEG_REACH, LEG_SD, SAME_PERSON, TWO_LEGS_VAR, ONE_LEG_VAR, JOINT_LEGS_VAR
cdef double PERSON_RADIUS, PERSONS_APART


cdef class Assignment


cdef class Candidates:
    cdef list owner
    cdef readonly Py_ssize_t capacity
    cdef Py_ssize_t count
    cdef Py_ssize_t* target
    cdef Py_ssize_t* measurement
    cdef double* cost
    cdef Py_ssize_t* group
    cdef Py_ssize_t* place
    cdef Py_ssize_t* member
    cdef Py_ssize_t* next
    cdef Py_ssize_t* head
    cdef Assignment assignment


cdef void associate(
    Candidates candidates, EdgeMeasurement sides, Targets targets, Measurements meas, Keyframes frames
) noexcept nogil
@cython.locals(is_away=bint)
cdef void _gate(
    Candidates candidates, EdgeMeasurement sides, Targets targets, Measurements meas, Keyframes frames
) noexcept nogil
cdef double precedence(Targets targets, Measurements meas, Py_ssize_t b) noexcept nogil
cdef double _assignment_cost(
    EdgeMeasurement sides, Targets targets, Measurements meas, Py_ssize_t b, Py_ssize_t k
) noexcept nogil
cdef void _cluster(Candidates candidates, Targets targets) noexcept nogil
cdef Py_ssize_t _root(Candidates candidates, Py_ssize_t at) noexcept nogil
@cython.locals(rows=Py_ssize_t, columns=Py_ssize_t)
cdef void _assign_group(
    Candidates candidates, Assignment assignment, Targets targets, Measurements meas, Py_ssize_t root
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef void merge_fragments(Targets targets, Measurements meas) noexcept nogil


cdef class Assignment:
    cdef list owner
    cdef readonly Py_ssize_t most_columns
    cdef public Py_ssize_t rows, columns
    cdef double* cost
    cdef Py_ssize_t* column
    cdef double* row_price
    cdef double* column_price
    cdef Py_ssize_t* assigned_row
    cdef Py_ssize_t* before
    cdef double* least
    cdef Py_ssize_t* done


cdef void solve(Assignment assignment, double without) noexcept nogil
@cython.locals(step=double, next_at=Py_ssize_t, cost=double, i=Py_ssize_t, at=Py_ssize_t)
cdef void _augment(Assignment assignment, Py_ssize_t row, Py_ssize_t wide, double without) noexcept nogil


cdef class Persons:
    cdef list owner
    cdef readonly Py_ssize_t capacity
    cdef Py_ssize_t count
    cdef Py_ssize_t* person
    cdef Py_ssize_t* measurement
    cdef double* cost
    cdef Py_ssize_t* assigned


@cython.locals(leg=Py_ssize_t, b=Py_ssize_t, k=Py_ssize_t, legs=Py_ssize_t)
cdef void track_persons(
    Persons persons, Targets targets, Measurements meas, Scans scans, Sightings sightings
) noexcept nogil
cdef bint _is_person_hit(Targets targets, Py_ssize_t b) noexcept nogil
@cython.locals(elder=Py_ssize_t)
cdef void merge_person(
    Persons persons, Targets targets, Measurements meas, Sightings sightings, Py_ssize_t b
) noexcept nogil
@cython.locals(best=Py_ssize_t)
cdef Py_ssize_t _person_missing_leg(Targets targets, Measurements meas, Py_ssize_t k) noexcept nogil
cdef bint _is_leg(Targets targets, Py_ssize_t b) noexcept nogil
@cython.locals(leg=Py_ssize_t, stands=bint)
cdef void _pair_persons(Persons persons, Targets targets, Measurements meas) noexcept nogil
cdef void sort_pairs(Persons persons) noexcept nogil
@cython.locals(wide=bint)
cdef void _update_person(
    Persons persons, Targets targets, Measurements meas, Scans scans, Sightings sightings, Py_ssize_t b
) noexcept nogil
cdef void _join_leg(Targets targets, Py_ssize_t leg, Py_ssize_t b) noexcept nogil
cdef void _give(Targets targets, Measurements meas, Sightings sightings, Py_ssize_t b, Py_ssize_t k) noexcept nogil
cdef void _record_person_hit(Targets targets, Py_ssize_t b, Measurements meas, double x, double y) noexcept nogil
cdef void _initiate_person(
    Persons persons, Targets targets, Measurements meas, Sightings sightings, Py_ssize_t leg, Py_ssize_t k
) noexcept nogil
