"""Definition 2: differences between neighbouring points, and the steps that may be discontinuities."""

from libc.math cimport NAN, fabs

import numpy as np

cdef long long NEVER = 1 << 40


def before_stretches(
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] stretches,
    const long long[::1] period,
):
    cdef Py_ssize_t i, j, first, last, rows = period.shape[0], count = begin.shape[0]
    cells, lost = np.empty(count, np.int64), np.empty(count, np.int64)
    cdef long long[::1] before = cells, missing = lost
    with nogil:
        for j in range(1, count):
            before[j] = end[j - 1]
            missing[j] = begin[j] - end[j - 1] - 1
        for i in range(rows):
            first, last = stretches[i], stretches[i + 1] - 1
            if first > last:
                continue
            before[first] = end[last]
            if period[i] > 0 and end[last] > begin[first]:
                missing[first] = begin[first] + period[i] - end[last] - 1
            else:
                missing[first] = NEVER
    return cells, lost


def sizes(const double[::1] cells):
    cdef Py_ssize_t k, count = cells.shape[0]
    cdef double size
    result = np.empty(count)
    if count == 0:
        return result
    cdef double[::1] out = result
    with nogil:
        out[0] = 0.0
        for k in range(1, count):
            size = fabs(cells[k] - cells[k - 1])
            out[k] = size if size > 0.0 else 0.0
    return result


def following(
    const double[::1] cells,
    const double[::1] size,
    const double[::1] least,
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] row,
    const long long[::1] before,
    const long long[::1] missing,
):
    cdef Py_ssize_t j, k, e, count = 0, stretches = begin.shape[0]
    cdef double bound
    cdef long long[::1] found = np.empty(cells.shape[0] + 1, np.int64)
    with nogil:
        for j in range(stretches):
            bound = least[row[j]]
            found[count] = begin[j]
            count += 1
            for k in range(begin[j] + 1, end[j] + 1):
                found[count] = k
                count += size[k] > bound
    cell_, row_, stretch_, before_, missing_ = (np.empty(count, np.int64) for _ in range(5))
    s_ = np.empty(count)
    cdef long long[::1] to_cell = cell_, to_row = row_, to_stretch = stretch_
    cdef long long[::1] to_before = before_, to_missing = missing_
    cdef double[::1] s = s_
    with nogil:
        j = -1
        for e in range(count):
            k = found[e]
            to_cell[e] = k
            if j + 1 < stretches and k == begin[j + 1]:
                j += 1
                to_before[e] = before[j]
                to_missing[e] = missing[j]
                s[e] = NAN if missing[j] == NEVER else cells[k] - cells[before[j]]
            else:
                to_before[e] = k - 1
                to_missing[e] = 0
                s[e] = cells[k] - cells[k - 1]
            to_row[e] = row[j]
            to_stretch[e] = j
    return cell_, row_, stretch_, before_, missing_, s_
