"""Definition 5: the runs between two discontinuities."""

from libc.math cimport NAN

import numpy as np

cdef long long NEVER = 1 << 40

cdef enum:
    MARGIN = 4
    OWN = 0
    HIDDEN = 1
    OPEN = 2
    UNKNOWN = 3
    VIEW = 4
    NO_RETURN = 1


def cut(
    jump,
    const long long[::1] step_cell,
    const long long[::1] step_row,
    const long long[::1] step_stretch,
    const long long[::1] step_before,
    const long long[::1] step_missing,
    const double[::1] step_s,
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] rank,
    const long long[::1] stretches,
    const long long[::1] start,
    Py_ssize_t stride,
    const long long[::1] period,
    reverse,
    const int[::1] bearings,
    beams,
    status,
    long long max_gap,
):
    cdef const unsigned char[::1] breaks = jump.view(np.uint8)
    cdef const unsigned char[::1] turned = reverse.view(np.uint8)
    cdef const int[::1] counted = np.ascontiguousarray(beams)
    cdef const unsigned char[:, ::1] says = np.ascontiguousarray(status)
    cdef Py_ssize_t e, i, j, k, lead, run = 0, crossing = 0, at = 0
    cdef Py_ssize_t count = step_cell.shape[0], rows = start.shape[0] - 1
    cdef long long points = start[rows], over, repeated = 0
    cdef bint turn
    # Besides the runs that begin at a step, there may be one on each full turn without a discontinuity.
    row_, first_, size_ = (np.empty(count + rows, np.int64) for _ in range(3))
    start_, end_ = (np.empty(count + rows, np.uint8) for _ in range(2))
    s_start_, s_end_ = (np.empty(count + rows) for _ in range(2))
    crosses_ = np.empty(rows, np.int64)
    cdef long long[::1] row = row_, first = first_, size = size_, crosses = crosses_
    cdef unsigned char[::1] start_edge = start_, end_edge = end_
    cdef double[::1] s_start = s_start_, s_end = s_end_
    with nogil:
        e = 0
        for i in range(rows):
            turn = period[i] > 0
            lead = run
            while e < count and step_row[e] == i:
                if not breaks[e] and step_missing[e] <= max_gap:
                    e += 1
                    continue
                row[run] = i
                j = step_stretch[e]
                first[run] = rank[j] + step_cell[e] - begin[j]
                if run > lead:
                    size[run - 1] = first[run] - first[run - 1]
                    leave(e, run - 1, i, max_gap, step_before, step_missing, step_s, stride, period, turned,
                          bearings, counted, says, end_edge, s_end)
                if step_missing[e] > max_gap:
                    s_start[run] = NAN
                    start_edge[run] = beside(i, step_cell[e] - (i * stride + MARGIN) - 1, period, turned, bearings,
                                             counted, says)
                else:
                    s_start[run] = step_s[e]
                    start_edge[run] = OWN if step_s[e] < 0 else HIDDEN
                if run == lead:
                    # The first discontinuity of the row also ends the last run of a full turn.
                    k = e
                run += 1
                e += 1
            if run > lead:
                if turn:
                    size[run - 1] = start[i + 1] + first[lead] - start[i] - first[run - 1]
                    leave(k, run - 1, i, max_gap, step_before, step_missing, step_s, stride, period, turned,
                          bearings, counted, says, end_edge, s_end)
                else:
                    size[run - 1] = start[i + 1] - first[run - 1]
                    s_end[run - 1] = NAN
                    end_edge[run - 1] = beside(i, end[stretches[i + 1] - 1] - (i * stride + MARGIN) + 1, period,
                                               turned, bearings, counted, says)
            elif start[i + 1] > start[i]:
                row[run] = i
                first[run] = start[i]
                size[run] = start[i + 1] - start[i]
                s_start[run] = s_end[run] = NAN
                start_edge[run] = end_edge[run] = HIDDEN
                run += 1
            if run > lead and first[run - 1] + size[run - 1] > start[i + 1]:
                crosses[crossing] = run - 1
                crossing += 1
                repeated += size[run - 1]
    again_, beyond_ = np.empty(repeated, np.int64), np.empty(repeated, bool)
    cdef long long[::1] again = again_
    cdef unsigned char[::1] beyond = beyond_.view(np.uint8)
    with nogil:
        for j in range(crossing):
            k = crosses[j]
            i = row[k]
            over = first[k]
            first[k] = points + at
            for e in range(size[k]):
                beyond[at] = over + e >= start[i + 1]
                again[at] = over + e - (start[i + 1] - start[i] if beyond[at] else 0)
                at += 1
    return (
        row_[:run].copy(),
        first_[:run].copy(),
        size_[:run].copy(),
        start_[:run].copy(),
        end_[:run].copy(),
        s_start_[:run].copy(),
        s_end_[:run].copy(),
        again_,
        beyond_,
    )


cdef inline void leave(
    Py_ssize_t e,
    Py_ssize_t run,
    Py_ssize_t row,
    long long max_gap,
    const long long[::1] step_before,
    const long long[::1] step_missing,
    const double[::1] step_s,
    Py_ssize_t stride,
    const long long[::1] period,
    const unsigned char[::1] turned,
    const int[::1] bearings,
    const int[::1] counted,
    const unsigned char[:, ::1] says,
    unsigned char[::1] end_edge,
    double[::1] s_end,
) noexcept nogil:
    """End a run at the point before the step `e`."""
    if step_missing[e] > max_gap:
        s_end[run] = NAN
        end_edge[run] = beside(row, step_before[e] - (row * stride + MARGIN) + 1, period, turned, bearings, counted,
                               says)
    else:
        s_end[run] = step_s[e]
        end_edge[run] = OWN if step_s[e] > 0 else HIDDEN


cdef inline unsigned char beside(
    Py_ssize_t row,
    long long position,
    const long long[::1] period,
    const unsigned char[::1] turned,
    const int[::1] bearings,
    const int[::1] counted,
    const unsigned char[:, ::1] says,
) noexcept nogil:
    """What the beam at a position beside a run says."""
    if period[row] > 0:
        if position >= period[row]:
            position -= period[row]
        elif position < 0:
            position += period[row]
    if turned[row]:
        position = bearings[row] - 1 - position
    if position < 0 or position >= counted[row]:
        return VIEW
    return OPEN if says[row, position] == NO_RETURN else UNKNOWN
