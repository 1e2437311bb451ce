"""Where a thing ends, between the last beam that hits it and the next one."""

import numpy as np

from libc.math cimport fabs

cdef enum:
    OWN = 0
    OPEN = 2


def stretched(runs, faces, corners, const long long[::1] chosen, const double[::1] cos, const double[::1] sin):
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const unsigned char[::1] start_edge = runs.start_edge
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const double[::1] x = runs.points.x
    cdef const double[::1] y = runs.points.y
    cdef const long long[::1] face_offsets = faces.offsets
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const long long[::1] offsets = corners.offsets
    cdef Py_ssize_t k, count = chosen.shape[0]
    cdef long long j, f, at, vertex
    cdef double way
    starts, ends, xs, ys = np.zeros(count), np.zeros(count), corners.x.copy(), corners.y.copy()
    cdef double[::1] before = starts, after = ends, corner_x = xs, corner_y = ys
    with nogil:
        for k in range(count):
            j = chosen[k]
            if face_offsets[j + 1] == face_offsets[j]:
                continue
            f, at, vertex = face_offsets[j], first[j], offsets[j]
            if start_edge[j] == OWN or start_edge[j] == OPEN:
                way = _past(
                    x[at], y[at], x[at + 1], y[at + 1], direction_x[f], direction_y[f], cos[row[j]], -sin[row[j]]
                )
                before[k] = way
                corner_x[vertex] -= way * direction_x[f]
                corner_y[vertex] -= way * direction_y[f]
            f, at, vertex = face_offsets[j + 1] - 1, first[j] + size[j] - 1, offsets[j + 1] - 1
            if end_edge[j] == OWN or end_edge[j] == OPEN:
                way = _past(
                    x[at], y[at], x[at - 1], y[at - 1], direction_x[f], direction_y[f], cos[row[j]], sin[row[j]]
                )
                after[k] = way
                corner_x[vertex] += way * direction_x[f]
                corner_y[vertex] += way * direction_y[f]
    return starts, ends, xs, ys


cdef inline double _past(
    double x, double y, double inner_x, double inner_y, double along_x, double along_y, double cos, double sin
) noexcept nogil:
    """Way along a face from a point to the bearing past it, no further than to the next point."""
    cdef double ray_x = x * cos - y * sin, ray_y = x * sin + y * cos
    cdef double across = along_x * ray_y - along_y * ray_x
    cdef double way = fabs((x * x + y * y) * sin / across)
    cdef double spacing = fabs((x - inner_x) * along_x + (y - inner_y) * along_y)
    return way if way < spacing else spacing


def lengthen(
    double[::1] length,
    const long long[::1] offsets,
    const long long[::1] chosen,
    const double[::1] before,
    const double[::1] after,
):
    cdef Py_ssize_t k, f = 0
    cdef long long faces
    with nogil:
        for k in range(chosen.shape[0]):
            faces = offsets[chosen[k] + 1] - offsets[chosen[k]]
            if not faces:
                continue
            length[f] += before[k]
            f += faces
            length[f - 1] += after[k]
