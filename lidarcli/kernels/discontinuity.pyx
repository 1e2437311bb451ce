"""Definition 3 with the one-sided limits of f."""

from libc.math cimport fabs

import numpy as np

cdef enum:
    REACH = 3

cdef long long NEVER = 1 << 40
cdef double SPACING_GAIN = 1.0
cdef double TINY = np.finfo(np.float64).tiny


def unexplained(
    const double[::1] cells,
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] stretches,
    const long long[::1] gap_missing,
    const double[::1] bearing_step,
    const double[::1] explained,
    const long long[::1] cell,
    const long long[::1] row,
    const long long[::1] stretch,
    const long long[::1] before,
    const long long[::1] missing,
    const double[::1] difference,
    long long max_gap,
):
    cdef Py_ssize_t e, i, q, count = cell.shape[0]
    cdef double s, r, r_before, allowed, step, left, right, upper, lower
    result = np.zeros(count, bool)
    cdef unsigned char[::1] jump = result.view(np.uint8)
    with nogil:
        for e in range(count):
            s, i, r = difference[e], row[e], cells[cell[e]]
            r_before = r - s
            allowed = explained[i] + SPACING_GAIN * bearing_step[i] * (r_before if r_before < r else r)
            if not fabs(s) > allowed or missing[e] >= NEVER:
                continue
            r_before = cells[before[e]]
            step = <double> (missing[e] + 1)
            q = stretch[e]
            right = slope(cells, begin, end, gap_missing, stretches[i], stretches[i + 1], cell[e], q, 1, max_gap)
            if cell[e] == begin[q]:
                q = q - 1 if q > stretches[i] else stretches[i + 1] - 1
            left = slope(cells, begin, end, gap_missing, stretches[i], stretches[i + 1], before[e], q, -1, max_gap)
            left = 1.0 / larger(1.0 / r_before + step * left, TINY) - r_before
            right = r - 1.0 / larger(1.0 / r - step * right, TINY)
            upper = larger(larger(left, right), 0.0)
            lower = smaller(smaller(left, right), 0.0)
            jump[e] = s > upper + allowed or s < lower - allowed
    return result


cdef inline double larger(double a, double b) noexcept nogil:
    return a if a > b else b


cdef inline double smaller(double a, double b) noexcept nogil:
    return a if a < b else b


cdef inline double slope(
    const double[::1] cells,
    const long long[::1] begin,
    const long long[::1] end,
    const long long[::1] gap_missing,
    Py_ssize_t first,
    Py_ssize_t stop,
    Py_ssize_t at,
    Py_ssize_t stretch,
    int direction,
    long long max_gap,
) noexcept nogil:
    """du/dk that the points on one side of a step support; the stretches of the row are `first … stop - 1`."""
    cdef double u_at = 1.0 / cells[at], value, least = 0.0, greatest = 0.0
    cdef long long span = 0
    cdef bint some = False
    cdef int lag
    for lag in range(1, REACH + 1):
        span += 1
        if direction < 0:
            if at > begin[stretch]:
                at -= 1
            else:
                span += gap_missing[stretch]
                stretch = stretch - 1 if stretch > first else stop - 1
                at = end[stretch]
        elif at < end[stretch]:
            at += 1
        else:
            stretch = stretch + 1 if stretch < stop - 1 else first
            span += gap_missing[stretch]
            at = begin[stretch]
        if span > lag + max_gap:
            continue
        value = (1.0 / cells[at] - u_at) / <double> (span * direction)
        least = smaller(least, value) if some else value
        greatest = larger(greatest, value) if some else value
        some = True
    return larger(least, 0.0) + smaller(greatest, 0.0)
