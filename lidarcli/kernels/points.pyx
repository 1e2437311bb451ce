"""The grid of cells, and the coordinates of the points in it."""

from libc.math cimport fabs
from libc.string cimport memcpy

import numpy as np

cdef enum:
    MARGIN = 4
    OPEN = 0
    SHARED = 2


def bearings_of(angle_min, angle_increment, beams, closure):
    cdef const double[::1] start = np.ascontiguousarray(angle_min)
    cdef const double[::1] increment = np.ascontiguousarray(angle_increment)
    cdef const int[::1] counted = np.ascontiguousarray(beams)
    cdef const unsigned char[::1] closes = np.ascontiguousarray(closure)
    cdef Py_ssize_t i, rows = start.shape[0]
    firsts, steps, periods = np.empty(rows), np.empty(rows), np.empty(rows, np.int64)
    turned, numbers = np.empty(rows, bool), np.empty(rows, np.int32)
    cdef double[::1] first = firsts, step = steps
    cdef long long[::1] period = periods
    cdef unsigned char[::1] reverse = turned.view(np.uint8)
    cdef int[::1] bearings = numbers
    with nogil:
        for i in range(rows):
            reverse[i] = increment[i] < 0
            bearings[i] = counted[i] - (1 if closes[i] == SHARED else 0)
            first[i] = start[i] + <double>(bearings[i] - 1) * increment[i] if reverse[i] else start[i]
            step[i] = fabs(increment[i])
            period[i] = 0 if closes[i] == OPEN else bearings[i]
    return firsts, steps, periods, turned, numbers


def alike(start, increment, last):
    cdef const double[::1] column
    cdef Py_ssize_t i
    for values in (start, increment, last):
        column = np.ascontiguousarray(values)
        for i in range(column.shape[0]):
            if column[i] != column[0]:
                return False
    return True


def lay_out(ranges, bearings, reverse, Py_ssize_t stride):
    cdef const float[:, ::1] raw = np.ascontiguousarray(ranges)
    cdef const int[::1] counted = np.ascontiguousarray(bearings)
    cdef const unsigned char[::1] turned = np.ascontiguousarray(reverse).view(np.uint8)
    cdef Py_ssize_t rows = raw.shape[0], width = raw.shape[1], total = rows * stride
    cdef Py_ssize_t i, k, at, stop, count, stretch = 0, last
    cdef long long points = 0
    cdef unsigned long long now, before
    cdef double nan = float("nan")
    cells, is_valid = np.empty(total), np.empty(total, bool)
    # At most every other cell begins a stretch.
    most = rows * ((width + 1) // 2)
    begins, ends, owners, ranks = (np.empty(most, np.int64) for _ in range(4))
    of_row, starts = np.zeros(rows + 1, np.int64), np.zeros(rows + 1, np.int64)
    if total == 0 or width == 0:
        cells[:] = nan
        is_valid[:] = False
        return cells, is_valid, begins, ends, owners, ranks, of_row, starts
    cdef double[::1] out = cells
    cdef unsigned char[::1] valid = is_valid.view(np.uint8)
    cdef long long[::1] begin = begins, end = ends, row = owners, rank = ranks
    cdef long long[::1] stretches = of_row, start = starts
    cdef const float* source
    cdef const unsigned int* bits
    cdef double* cell
    cdef unsigned char* mark
    with nogil:
        for i in range(rows):
            source, cell, mark = &raw[i, 0], &out[i * stride], &valid[i * stride]
            count = counted[i]
            for k in range(MARGIN):
                cell[k] = nan
            if turned[i]:
                for k in range(count):
                    cell[MARGIN + k] = source[count - 1 - k]
            else:
                for k in range(count):
                    cell[MARGIN + k] = source[k]
            for k in range(MARGIN + count, stride):
                cell[k] = nan
            for k in range(MARGIN):
                mark[k] = 0
            bits = <const unsigned int*> source
            # A float is a number where its bits but the sign are at most those of infinity; integers compare faster.
            if turned[i]:
                for k in range(count):
                    mark[MARGIN + k] = (bits[count - 1 - k] & 0x7FFFFFFF) <= 0x7F800000
            else:
                for k in range(count):
                    mark[MARGIN + k] = (bits[k] & 0x7FFFFFFF) <= 0x7F800000
            for k in range(MARGIN + count, stride):
                mark[k] = 0
            # Eight cells at a time; the margins around a row hold no range, so that begins and ends come in turns.
            last = -1
            k = MARGIN
            while k < stride:
                stop = k + 8
                if stop <= stride:
                    memcpy(&now, mark + k, 8)
                    memcpy(&before, mark + k - 1, 8)
                    if now == before:
                        k = stop
                        continue
                else:
                    stop = stride
                for at in range(k, stop):
                    if mark[at] == mark[at - 1]:
                        continue
                    if mark[at]:
                        begin[stretch] = i * stride + at
                        row[stretch] = i
                        rank[stretch] = points
                        last = at
                    else:
                        end[stretch] = i * stride + at - 1
                        points += at - last
                        stretch += 1
                k = stop
            stretches[i + 1] = stretch
            start[i + 1] = points
    return (
        cells,
        is_valid,
        begins[:stretch].copy(),
        ends[:stretch].copy(),
        owners[:stretch].copy(),
        ranks[:stretch].copy(),
        of_row,
        starts,
    )


def coordinates(
    const double[::1] cells,
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] row,
    const long long[::1] again,
    const double[:, ::1] cos,
    const double[:, ::1] sin,
    const long long[::1] code,
    Py_ssize_t stride,
):
    cdef Py_ssize_t j, k, m = 0, points = 0, size, total
    cdef Py_ssize_t stretches = begin.shape[0], repeated = again.shape[0]
    for j in range(stretches):
        points += end[j] - begin[j] + 1
    total = points + repeated
    numbers, xs, ys = np.empty(total, np.int64), np.empty(total), np.empty(total)
    if total == 0:
        return numbers, xs, ys
    cdef long long[::1] cell = numbers
    cdef double[::1] x = xs, y = ys
    cdef const double* r
    cdef const double* c
    cdef const double* s
    cdef double* to_x
    cdef double* to_y
    cdef long long* to_cell
    with nogil:
        for j in range(stretches):
            r = &cells[begin[j]]
            k = begin[j] - row[j] * stride
            c, s = &cos[code[row[j]], k], &sin[code[row[j]], k]
            to_cell, to_x, to_y = &cell[m], &x[m], &y[m]
            size = end[j] - begin[j] + 1
            for k in range(size):
                to_cell[k] = begin[j] + k
            for k in range(size):
                to_x[k] = r[k] * c[k]
            for k in range(size):
                to_y[k] = r[k] * s[k]
            m += size
        for k in range(repeated):
            cell[m] = cell[again[k]]
            x[m] = x[again[k]]
            y[m] = y[again[k]]
            m += 1
    return numbers, xs, ys
