"""Definition 3: the mean difference and the noise of sweeps."""

from libc.math cimport NAN, fabs, fabsf, sqrtf
from libc.string cimport memcpy

import numpy as np

from lidarcli.kernels.sums cimport pairwise

cdef enum:
    BLOCK = 32
    OPEN = 0
    SHARED = 2
    FEW = 24


def mean_size(
    const double[::1] cells,
    const double[::1] size,
    Py_ssize_t stride,
    const long long[::1] begin,
    const long long[::1] stretches,
    const long long[::1] start,
    const long long[::1] before,
    const long long[::1] missing,
):
    cdef Py_ssize_t i, first, rows = start.shape[0] - 1
    cdef long long count
    cdef double total
    cdef double lanes[BLOCK]
    result = np.empty(rows)
    cdef double[::1] mean = result
    with nogil:
        for i in range(rows):
            total = pairwise(across(&size[i * stride], stride // BLOCK, lanes), BLOCK)
            first = stretches[i]
            count = (start[i + 1] - start[i]) - (stretches[i + 1] - first)
            # A stretch with nothing missing before it is the first of a turn: others would be one with the last.
            if first < stretches[i + 1] and missing[first] == 0:
                total += fabs(cells[begin[first]] - cells[before[first]])
                count += 1
            mean[i] = total / (count if count > 1 else 1)
    return result


cdef inline double* across(const double* values, Py_ssize_t blocks, double* lanes) noexcept nogil:
    """Add up the blocks, one onto the other."""
    cdef Py_ssize_t k, j
    for j in range(BLOCK):
        lanes[j] = values[j]
    for k in range(1, blocks):
        for j in range(BLOCK):
            lanes[j] += values[k * BLOCK + j]
    return lanes


def middle_second_difference(ranges, cosine, beams, closure):
    cdef const float[:, ::1] table = np.ascontiguousarray(ranges)
    cdef const float[::1] cosines = cosine
    cdef const int[::1] counts = np.ascontiguousarray(beams)
    cdef const unsigned char[::1] closes = np.ascontiguousarray(closure)
    cdef Py_ssize_t i, k, last, rows = table.shape[0], width = table.shape[1]
    cdef const float* r
    cdef float c
    cdef float guess = 0.0
    result = np.zeros(rows, np.float32)
    if not rows or width < 3:
        return result
    cdef float[::1] median = result
    cdef float[::1] scratch = np.empty(3 * width, np.float32)
    cdef float* u = &scratch[0]
    cdef float* second = u + width
    cdef float* some = second + width
    with nogil:
        for i in range(rows):
            r, c = &table[i, 0], cosines[i]
            for k in range(width):
                u[k] = <float> 1.0 / r[k]
            second[0] = second[width - 1] = NAN
            for k in range(1, width - 1):
                second[k] = (u[k - 1] + u[k + 1]) - c * u[k]
            if closes[i] != OPEN:
                last = counts[i] - 1
                if closes[i] == SHARED:
                    second[last] = NAN
                    last -= 1
                second[0] = (u[last] + u[1]) - c * u[0]
                second[last] = (u[last - 1] + u[0]) - c * u[last]
            for k in range(width):
                second[k] = fabsf(second[k] * (r[k] * r[k]))
            median[i] = lower_median(second, some, width, guess)
            guess = median[i]
    return result


cdef float lower_median(const float* values, float* some, Py_ssize_t count, float guess) noexcept nogil:
    """The lower median of the values that are numbers, 0 where there is none; `some` has room for all of them.

    A good guess saves most of the work: sweeps of one sensor are alike.
    """
    cdef float low = guess * <float> 0.8, high = guess * <float> 1.25, middle, margin
    cdef int numbers = 0, below = 0, within = 0, position
    cdef Py_ssize_t k, n = 0
    for k in range(count):
        numbers += values[k] == values[k]
        below += values[k] < low
        within += values[k] <= high
    if numbers == 0:
        return 0.0
    position = (numbers - 1) // 2
    if not below <= position < within:
        for k in range(count):
            some[n] = values[k]
            n += values[k] == values[k]
        return smallest(some, n, position)
    n = kept(values, some, count, low, high)
    position -= below
    if n > FEW:
        # Where in there it is likely to be: as far as its position, give or take two standard deviations.
        middle = low + (high - low) * (position + <float> 0.5) / n
        margin = (high - low) / sqrtf(n)
        low, high = max(middle - margin, <float> 0.0), middle + margin
        below = within = 0
        for k in range(n):
            below += some[k] < low
            within += some[k] <= high
        if below <= position < within:
            n = kept(some, some, n, low, high)
            position -= below
    return smallest(some, n, position)


cdef inline Py_ssize_t kept(
    const float* values, float* some, Py_ssize_t count, float low, float high
) noexcept nogil:
    """Copy the values within limits that are not negative, and count them.

    The bits of numbers that are not negative are ordered as they are, those of NaN come last: one comparison does.
    """
    cdef Py_ssize_t k, n = 0
    cdef unsigned int value, least, most
    memcpy(&least, &low, 4)
    memcpy(&most, &high, 4)
    most -= least
    for k in range(count):
        memcpy(&value, values + k, 4)
        memcpy(some + n, &value, 4)
        n += value - least <= most
    return n


cdef float smallest(float* values, Py_ssize_t count, Py_ssize_t position) noexcept nogil:
    """The value that has this position among numbers in order; leaves them in another order."""
    cdef Py_ssize_t low = 0, high = count - 1, i, j
    cdef float pivot, a, b, c
    cdef int below, within
    while low < high:
        if high - low < FEW:
            # The value that has as many below it: without a branch per value this is faster than putting them in order.
            for i in range(low, high + 1):
                pivot = values[i]
                below = within = low
                for j in range(low, high + 1):
                    below += values[j] < pivot
                    within += values[j] <= pivot
                if below <= position < within:
                    return pivot
        a, b, c = values[low], values[(low + high) // 2], values[high]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if position <= j:
            high = j
        elif position >= i:
            low = i
        else:
            break
    return values[position]
