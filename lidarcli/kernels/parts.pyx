"""The objects as lists of runs."""

import numpy as np

from libc.math cimport INFINITY

from lidarcli.kernels.cloud cimport TURN, Sight, bearing, sight_of


cdef inline bint _tagged_before(
    Py_ssize_t a,
    Py_ssize_t b,
    const long long* row,
    const unsigned char* wall,
    const long long* tag,
    const double* theta,
) noexcept nogil:
    if row[a] != row[b]:
        return row[a] < row[b]
    if wall[a] != wall[b]:
        return wall[a] < wall[b]
    if tag[a] != tag[b]:
        return tag[a] < tag[b]
    return theta[a] < theta[b]


def assembled(runs, is_object, is_wall_run, const long long[::1] label):
    cloud = runs.points
    cdef const long long[::1] run_row = runs.row
    cdef const long long[::1] first_point = runs.first
    cdef const long long[::1] size = runs.size
    cdef const long long[::1] period = cloud.geometry.period
    cdef const unsigned char[::1] as_object = is_object.view(np.uint8)
    cdef const unsigned char[::1] as_wall = is_wall_run.view(np.uint8)
    cdef Sight sight = sight_of(cloud)
    cdef Py_ssize_t r, parts = 0
    for r in range(run_row.shape[0]):
        parts += as_object[r] or as_wall[r]
    indices, ends = np.empty((1, parts), np.int64), np.empty((3, parts))
    if not parts:
        return indices[0], *ends, np.zeros(1, np.int64)
    cdef unsigned char[:, ::1] flags = np.empty((2, parts), np.uint8)
    cdef long long[::1] run = np.empty(parts, np.int64)
    cdef long long[::1] row = np.empty(parts, np.int64)
    cdef long long[::1] tag = np.empty(parts, np.int64)
    cdef double[::1] theta_i = np.empty(parts)
    cdef double[::1] theta_f = np.empty(parts)
    cdef unsigned char[::1] is_wall = flags[0]
    cdef unsigned char[::1] turns = flags[1]
    with nogil:
        parts = 0
        for r in range(run_row.shape[0]):
            if not (as_object[r] or as_wall[r]):
                continue
            run[parts], row[parts] = r, run_row[r]
            is_wall[parts], turns[parts] = as_wall[r], period[run_row[r]] > 0
            tag[parts] = label[r] if as_object[r] else r
            theta_i[parts] = bearing(&sight, first_point[r], run_row[r])
            theta_f[parts] = bearing(&sight, first_point[r] + size[r] - 1, run_row[r])
            parts += 1
    cdef Py_ssize_t i, j, k, at, objects = 0, most, first, last, n, moved
    cdef double gap, widest, least
    cdef long long[::1] order = np.empty(parts, np.int64)
    scratch = np.empty((4, parts + 1), np.int64)
    cdef long long[::1] sorting = scratch[0]
    cdef long long[::1] begin = scratch[1]
    cdef long long[::1] rank = scratch[2]
    cdef double[::1] beyond = np.empty(parts)
    cdef double[::1] leasts = np.empty(parts)
    cdef const long long* rows = &row[0]
    cdef const unsigned char* walls = &is_wall[0]
    cdef const long long* tags = &tag[0]
    cdef const double* thetas = &theta_i[0]
    with nogil:
        # By insertion: the runs are nearly in order already.
        for i in range(parts):
            j = i
            while j > 0 and _tagged_before(i, sorting[j - 1], rows, walls, tags, thetas):
                sorting[j] = sorting[j - 1]
                j -= 1
            sorting[j] = i
        for i in range(parts):
            if (
                i == 0
                or tag[sorting[i]] != tag[sorting[i - 1]]
                or is_wall[sorting[i]] != is_wall[sorting[i - 1]]
            ):
                begin[objects] = i
                objects += 1
        begin[objects] = parts
        for k in range(objects):
            first, last = begin[k], begin[k + 1] - 1
            most = first
            if last > first:
                # The parts before the widest gap lie past the seam, where that is not the gap.
                widest = INFINITY
                if turns[sorting[first]]:
                    widest = theta_i[sorting[first]] + TURN - theta_f[sorting[last]]
                for i in range(first + 1, last + 1):
                    gap = theta_i[sorting[i]] - theta_f[sorting[i - 1]]
                    if gap > widest:
                        widest = gap
                        most = i
            least = INFINITY
            for i in range(first, last + 1):
                at = sorting[i]
                beyond[at] = TURN * (i < most)
                if theta_i[at] + beyond[at] < least:
                    least = theta_i[at] + beyond[at]
            leasts[k] = least
        # The objects by row, kind and least bearing, and the parts of each by bearing.
        for k in range(objects):
            i = sorting[begin[k]]
            j = k
            while j > 0:
                at = sorting[begin[rank[j - 1]]]
                if row[at] != row[i]:
                    if row[at] < row[i]:
                        break
                elif is_wall[at] != is_wall[i]:
                    if is_wall[at] < is_wall[i]:
                        break
                elif not leasts[k] < leasts[rank[j - 1]]:
                    break
                rank[j] = rank[j - 1]
                j -= 1
            rank[j] = k
    cdef long long[::1] out_run = indices[0]
    cdef double[:, ::1] out = ends
    offset = np.empty(objects + 1, np.int64)
    cdef long long[::1] offsets = offset
    with nogil:
        n = 0
        for k in range(objects):
            offsets[k] = n
            first = n
            for i in range(begin[rank[k]], begin[rank[k] + 1]):
                at = sorting[i]
                j = n
                while j > first and theta_i[at] + beyond[at] < theta_i[order[j - 1]] + beyond[order[j - 1]]:
                    order[j] = order[j - 1]
                    j -= 1
                order[j] = at
                n += 1
        offsets[objects] = n
        for i in range(parts):
            at = order[i]
            out_run[i] = run[at]
            out[0, i], out[1, i], out[2, i] = theta_i[at] + beyond[at], theta_f[at] + beyond[at], beyond[at]
    return indices[0], *ends, offset
