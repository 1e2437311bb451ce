"""The points of each object, and what they say of it without its faces."""

import numpy as np

from libc.math cimport sqrt

from lidarcli.kernels.cloud cimport Sight, bearing, position, sight_of


def gathered(runs, parts, is_wall, const long long[::1] body):
    cloud = runs.points
    cdef const long long[::1] run_row = runs.row
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const unsigned char[::1] start_edge = runs.start_edge
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const double[::1] s_start = runs.s_start
    cdef const double[::1] s_end = runs.s_end
    cdef const unsigned char[::1] run_wall = is_wall.view(np.uint8)
    cdef const long long[::1] part_run = parts.run
    cdef const long long[::1] part_offsets = parts.offsets
    cdef const double[::1] part_theta_i = parts.theta_i
    cdef const double[::1] part_theta_f = parts.theta_f
    cdef const double[::1] past = parts.past
    cdef const double[::1] cloud_x = cloud.x
    cdef const double[::1] cloud_y = cloud.y
    cdef const double[::1] ranges = cloud.grid.range
    cdef const unsigned char[::1] reverse = cloud.geometry.reverse.view(np.uint8)
    cdef const int[::1] bearings = cloud.geometry.bearings
    cdef Sight sight = sight_of(cloud)
    cdef Py_ssize_t k, p, i, n = 0, objects = part_offsets.shape[0] - 1
    cdef long long at, j, last, nearest, part, before, after
    cdef double r, least, sum_x, sum_y, dx, dy
    for p in range(part_run.shape[0]):
        n += size[part_run[p]]
    longs, ints, bytes_ = np.empty(objects, np.int64), np.empty((3, objects), np.int32), np.empty((4, objects), np.uint8)
    floats, points, offset = np.empty((11, objects)), np.empty((2, n)), np.empty(objects + 1, np.int64)
    cdef long long[::1] row = longs
    cdef int[:, ::1] whole = ints
    cdef unsigned char[:, ::1] codes = bytes_
    cdef double[:, ::1] out = floats
    cdef double[::1] to_x = points[0]
    cdef double[::1] to_y = points[1]
    cdef long long[::1] offsets = offset
    with nogil:
        n = 0
        for k in range(objects):
            offsets[k] = n
            nearest, part, least = -1, -1, 0.0
            sum_x = sum_y = 0.0
            codes[1, k] = False
            j = -1
            for p in range(part_offsets[k], part_offsets[k + 1]):
                if j >= 0 and body[part_run[p]] != body[j]:
                    codes[1, k] = True
                j = part_run[p]
                at = first[j]
                for i in range(size[j]):
                    r = ranges[sight.cell[at]]
                    if nearest < 0 or r < least:
                        least, nearest, part = r, at, p
                    sum_x += cloud_x[at]
                    sum_y += cloud_y[at]
                    to_x[n] = cloud_x[at]
                    to_y[n] = cloud_y[at]
                    at += 1
                    n += 1
            last = first[j] + size[j] - 1
            codes[3, k] = end_edge[j]
            out[1, k] = part_theta_f[part_offsets[k + 1] - 1]
            out[7, k] = s_end[j]
            j = part_run[part_offsets[k]]
            at = first[j]
            row[k] = run_row[j]
            codes[0, k] = run_wall[j]
            codes[2, k] = start_edge[j]
            whole[0, k] = whole[0, k - 1] + 1 if k and row[k] == row[k - 1] else 1
            before, after = position(&sight, at, row[k]), position(&sight, last, row[k])
            if reverse[row[k]]:
                before, after = bearings[row[k]] - 1 - after, bearings[row[k]] - 1 - before
            whole[1, k], whole[2, k] = <int>before, <int>after
            out[0, k] = part_theta_i[part_offsets[k]]
            out[2, k] = bearing(&sight, nearest, row[k]) + past[part]
            out[3, k], out[4, k], out[5, k] = ranges[sight.cell[at]], ranges[sight.cell[last]], least
            out[6, k] = s_start[j]
            out[8, k], out[9, k] = sum_x / <double>(n - offsets[k]), sum_y / <double>(n - offsets[k])
            dx = cloud_x[last] - cloud_x[at]
            dy = cloud_y[last] - cloud_y[at]
            out[10, k] = sqrt(dx * dx + dy * dy)
        offsets[objects] = n
    return (
        longs,
        bytes_[0].view(bool),
        ints[0],
        bytes_[1].view(bool),
        bytes_[2],
        bytes_[3],
        ints[1],
        ints[2],
        *floats,
        offset,
        *points,
    )
