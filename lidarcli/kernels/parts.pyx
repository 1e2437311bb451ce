"""The objects as lists of runs."""

import numpy as np

from libc.math cimport INFINITY

from lidarcli.kernels.cloud cimport TURN


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


def ordered(
    const long long[::1] row, wall, const long long[::1] tag, turning, const double[::1] theta_i, const double[::1] theta_f
):
    cdef const unsigned char[::1] is_wall = wall.view(np.uint8)
    cdef const unsigned char[::1] turns = turning.view(np.uint8)
    cdef Py_ssize_t parts = row.shape[0], i, j, k, at, objects = 0, most, first, last, n, moved
    cdef double gap, widest, least
    orders, sorted_past = np.empty(parts, np.int64), np.empty(parts)
    cdef long long[::1] order = orders
    cdef double[::1] past = sorted_past
    if not parts:
        return orders, sorted_past, np.zeros(1, np.int64)
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
            past[i] = beyond[order[i]]
    return orders, sorted_past, offset
