"""How well straight faces explain the points of objects, and how well circles."""

import numpy as np

from libc.math cimport sqrt

cdef double FIT_FLOOR = 0.004
cdef double STRAIGHT_FIT = 0.012
cdef double WORSE = 1.5
cdef double ARC = 0.6

cdef enum:
    ENOUGH_BEAMS = 5
    MOST_FACES = 3
    PRISMATIC = 0
    ROUND = 1
    IRREGULAR = 3
    UNKNOWN = 4


cdef inline double _most(double a, double b) noexcept nogil:
    return a if a > b else b


def by_faces(
    faces,
    const long long[::1] face,
    const long long[::1] offsets,
    const long long[::1] beams,
    const double[::1] sigma,
    const double[::1] handicap,
    double least,
):
    cdef const long long[::1] points = faces.points
    cdef const double[::1] rms = faces.rms
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef Py_ssize_t k, i, objects = offsets.shape[0] - 1
    cdef long long at, before, count
    cdef double total, weight, n, scatter
    cdef bint square
    shapes, rivals, bounds = np.empty(objects, np.uint8), np.empty(objects), np.empty(objects)
    cdef unsigned char[::1] code = shapes
    cdef double[::1] rival = rivals, within = bounds
    with nogil:
        for k in range(objects):
            total, weight, square = 0.0, 0.0, True
            for i in range(offsets[k], offsets[k + 1]):
                at = face[i]
                n = <double>points[at]
                total += n * (rms[at] * rms[at])
                weight += n
                if i > offsets[k]:
                    before = face[i - 1]
                    square = square and (
                        direction_y[before] * direction_x[at] - direction_x[before] * direction_y[at] >= least
                    )
            count = offsets[k + 1] - offsets[k]
            scatter = sqrt(total / _most(weight, 1.0))
            rival[k] = _most(scatter, _most(0.5 * sigma[k], FIT_FLOOR)) * handicap[k]
            if beams[k] < ENOUGH_BEAMS:
                code[k], within[k] = UNKNOWN, -1.0
                continue
            within[k] = WORSE * rival[k] if count > 1 or scatter > FIT_FLOOR else -1.0
            if square and count <= MOST_FACES and scatter <= _most(2.0 * sigma[k], STRAIGHT_FIT):
                code[k] = PRISMATIC
            else:
                code[k] = IRREGULAR
    return shapes, rivals, bounds


def better_as_arcs(members, circles, const double[::1] sigma, const double[::1] rival):
    cdef const double[::1] mean_x = members.x
    cdef const double[::1] mean_y = members.y
    cdef const double[::1] width = members.width
    cdef const double[::1] x = circles.x
    cdef const double[::1] y = circles.y
    cdef const double[::1] radius = circles.radius
    cdef const double[::1] rms = circles.rms
    cdef Py_ssize_t k, objects = rival.shape[0]
    arcs = np.empty(objects, bool)
    cdef unsigned char[::1] arc = arcs.view(np.uint8)
    with nogil:
        for k in range(objects):
            arc[k] = (
                _most(rms[k], _most(0.5 * sigma[k], FIT_FLOOR)) < rival[k]
                and x[k] * x[k] + y[k] * y[k] > mean_x[k] * mean_x[k] + mean_y[k] * mean_y[k]
                and rms[k] <= _most(2.0 * sigma[k], STRAIGHT_FIT)
                and width[k] > ARC * radius[k]
            )
    return arcs
