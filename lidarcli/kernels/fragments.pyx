"""Parts of one thing that a step of its own surface tore apart."""

import numpy as np

cdef double GAP = 0.16
cdef double EXTENT = 0.9

cdef enum:
    OWN = 0
    HIDDEN = 1


def torn(runs, piece, const double[::1] reach):
    cloud = runs.points
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const double[::1] x = cloud.x
    cdef const double[::1] y = cloud.y
    cdef const long long[::1] period = cloud.geometry.period
    cdef const unsigned char[::1] may = piece.view(np.uint8)
    cdef Py_ssize_t a, b, begin = 0, count = row.shape[0], pairs = 0
    cdef long long ends, starts
    cdef double gap, span
    ones, others = np.empty(count, np.int64), np.empty(count, np.int64)
    cdef long long[::1] one = ones, other = others
    with nogil:
        for a in range(count):
            if a and row[a] != row[a - 1]:
                begin = a
            b = a + 1
            if b == count or row[b] != row[a]:
                if begin == a or period[row[a]] <= 0:
                    continue
                b = begin
            if not (may[a] and may[b] and (end_edge[a] == OWN or end_edge[a] == HIDDEN)):
                continue
            if not (reach[a] < EXTENT and reach[b] < EXTENT):
                continue
            ends, starts = first[a] + size[a] - 1, first[b]
            gap = (x[ends] - x[starts]) * (x[ends] - x[starts]) + (y[ends] - y[starts]) * (y[ends] - y[starts])
            ends, starts = first[b] + size[b] - 1, first[a]
            span = (x[starts] - x[ends]) * (x[starts] - x[ends]) + (y[starts] - y[ends]) * (y[starts] - y[ends])
            if gap < GAP * GAP and span < EXTENT * EXTENT:
                one[pairs], other[pairs] = a, b
                pairs += 1
    return ones[:pairs].copy(), others[:pairs].copy()
