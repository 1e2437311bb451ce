cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism cimport outline
from lidarcli.formalism.outline cimport Outline

cdef double NAN, TURN, TINY, FARTHEST_RANGE, GRAIN, CELL, MAX_HITS, SAME_SIDE, SMALL_STEP, MAX_STEP, MAX_TURN
cdef double LIES_OFF, SPEEDS_UP, TURNS_UP, FINE_REACH, FINE_KERNEL, SMALL_BEND, POINT_WEIGHT, HALF_WEIGHT_HITS, MIN_WEIGHT
cdef double SLIDES, SPINS, FITS, FITS_POINT, FITS_GROWS, SHARP, GOOD_FIT, MIN_FIT, BETTER
cdef double TRIED_TURN, TRIED_REACH, TRIED_KERNEL, APART, FARTHEST_STEP, WIDEST_STEP, HORIZON
cdef Py_ssize_t MAX_POINTS, MIN_POINTS, SIDE, MAX_SURFELS, MAX_STEPS, MAX_BENDS, TRIED_POINTS, TRIED_TURNS, PATIENCE, COLUMNS


cdef class Surfels:
    cdef list owner
    cdef Py_ssize_t count
    cdef double* x
    cdef double* y
    cdef double* nx
    cdef double* ny
    cdef double* hits
    cdef Py_ssize_t* line
    cdef Py_ssize_t* column
    cdef Py_ssize_t* row
    cdef Py_ssize_t* next
    cdef Py_ssize_t* head


cdef class Placement:
    cdef double x, y, yaw, fit, sharp, least, along_x, along_y


cdef class Sums:
    cdef double hxx, hxy, hyy, hxt, hyt, htt, gx, gy, gt, total, arms
    cdef Py_ssize_t fits, sharp


cdef class Matcher:
    cdef readonly Py_ssize_t beams, columns, pieces
    cdef Outline points, first
    cdef Surfels map
    cdef Placement found, best
    cdef Sums sums
    cdef bint begun, moves, alone, stepped
    cdef double x, y, yaw, vx, vy, vyaw, step_x, step_y, step_yaw, time, prior_x, prior_y, prior_yaw, prior_part
    cdef Py_ssize_t misses, passed

    @cython.locals(rows=Py_ssize_t, width=Py_ssize_t, row=Py_ssize_t, k=Py_ssize_t)
    cpdef follow(self, ranges, beams, angle_min, angle_increment, timing, prior, found)


@cython.locals(
    column=Py_ssize_t, row=Py_ssize_t, around=Py_ssize_t, found=Py_ssize_t, ring=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t,
    at=Py_ssize_t, edge=bint
)
cdef Py_ssize_t nearest_surfel(
    Surfels surfels, double x, double y, double nx, double ny, Py_ssize_t line, double reach
) noexcept nogil
@cython.locals(at=Py_ssize_t, column=Py_ssize_t, row=Py_ssize_t)
cdef void add_surfel(Surfels surfels, double x, double y, double nx, double ny, Py_ssize_t line) noexcept nogil
cdef void chain_surfel(Surfels surfels, Py_ssize_t at) noexcept nogil
@cython.locals(kept=Py_ssize_t, at=Py_ssize_t, cell=Py_ssize_t)
cdef void forget_far(Surfels surfels, double x, double y, double reach) noexcept nogil
@cython.locals(i=Py_ssize_t, reach=double)
cdef void enter_sweep(Matcher matcher, Outline points, double vx, double vy, double vyaw) noexcept nogil
@cython.locals(scale=Py_ssize_t, reach=double, kernel=double)
cdef (double, double, double) align(
    Matcher matcher, double x, double y, double yaw, double vx, double vy, double vyaw, double seconds, Py_ssize_t wide
) noexcept nogil
@cython.locals(number=Py_ssize_t)
cdef void refine(
    Outline points, Surfels surfels, Placement found, Sums sums, double reach, double kernel, Py_ssize_t every
) noexcept nogil
@cython.locals(i=Py_ssize_t)
cdef (double, double, double) bend(
    Outline points, Surfels surfels, Placement found, Sums sums, double vx, double vy, double vyaw
) noexcept nogil
@cython.locals(fits=Py_ssize_t, sharp=Py_ssize_t, number=Py_ssize_t, at=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t)
cdef void sum_up(
    Outline points, Surfels surfels, Placement found, Sums sums, double reach, double kernel, Py_ssize_t every,
    Py_ssize_t bends, double middle
) noexcept nogil
cdef void copy_placement(Placement to, Placement of) noexcept nogil
cdef void begin_map(Matcher matcher, double time) noexcept nogil
@cython.locals(seconds=double, follows=bint, guided=bint, wide=Py_ssize_t)
cdef void place_sweep(
    Matcher matcher, double time, double* prior, Py_ssize_t at, double* out, Py_ssize_t to
) noexcept nogil
cdef (double, double, double) start_of(
    Matcher matcher, double x, double y, double yaw, double seconds
) noexcept nogil
cdef (double, double, double) velocity_to(
    Matcher matcher, double x, double y, double yaw, double seconds
) noexcept nogil
@cython.locals(every=Py_ssize_t)
cdef void try_pose(Matcher matcher, double x, double y, double yaw, double seconds) noexcept nogil
@cython.locals(place=Py_ssize_t, k=Py_ssize_t, fit=double)
cdef (double, double, double) look_around(
    Matcher matcher, double x, double y, double yaw, double vx, double vy, double vyaw, double seconds
) noexcept nogil
