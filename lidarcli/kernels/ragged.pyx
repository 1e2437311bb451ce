"""Index arithmetic for ragged arrays."""

import numpy as np

from lidarcli.kernels.sums cimport reduced

cdef long long MAGNITUDE = 0x7FFFFFFFFFFFFFFF


def spans(begin, size):
    cdef const long long[::1] first = np.ascontiguousarray(begin, np.int64)
    cdef const long long[::1] sizes = np.ascontiguousarray(size, np.int64)
    cdef Py_ssize_t j, k, at = 0, count = sizes.shape[0]
    offsets_ = offsets_of(size)
    cdef const long long[::1] offsets = offsets_
    index_, owner_ = np.empty(offsets[count], np.int64), np.empty(offsets[count], np.int64)
    cdef long long[::1] index = index_, owner = owner_
    with nogil:
        for j in range(count):
            for k in range(sizes[j]):
                index[at] = first[j] + k
                owner[at] = j
                at += 1
    return index_, owner_, offsets_


def span_sum(const double[::1] values, const long long[::1] offsets):
    cdef Py_ssize_t j, spans = offsets.shape[0] - 1
    total = np.empty(spans)
    cdef double[::1] out = total
    with nogil:
        for j in range(spans):
            out[j] = reduced(&values[offsets[j]], offsets[j + 1] - offsets[j])
    return total


def span_max(const double[::1] values, const long long[::1] offsets):
    cdef Py_ssize_t j, k, spans = offsets.shape[0] - 1
    cdef double most
    greatest = np.empty(spans)
    cdef double[::1] out = greatest
    with nogil:
        for j in range(spans):
            most = values[offsets[j]]
            for k in range(offsets[j] + 1, offsets[j + 1]):
                if values[k] > most or values[k] != values[k]:
                    most = values[k]
            out[j] = most
    return greatest


def span_min(const double[::1] values, const long long[::1] offsets):
    cdef Py_ssize_t j, k, spans = offsets.shape[0] - 1
    cdef double least
    smallest = np.empty(spans)
    cdef double[::1] out = smallest
    with nogil:
        for j in range(spans):
            least = values[offsets[j]]
            for k in range(offsets[j] + 1, offsets[j + 1]):
                if values[k] < least or values[k] != values[k]:
                    least = values[k]
            out[j] = least
    return smallest


def span_max_positive(values, const long long[::1] offsets):
    cdef const long long[::1] bits = np.ascontiguousarray(values).view(np.int64)
    cdef Py_ssize_t j, k, spans = offsets.shape[0] - 1
    cdef long long most
    greatest = np.empty(spans)
    cdef long long[::1] out = greatest.view(np.int64)
    with nogil:
        for j in range(spans):
            most = bits[offsets[j]]
            for k in range(offsets[j] + 1, offsets[j + 1]):
                most = bits[k] if bits[k] > most else most
            out[j] = most
    return greatest


def span_bounds(values, const long long[::1] offsets):
    cdef const long long[::1] bits = np.ascontiguousarray(values).view(np.int64)
    cdef Py_ssize_t j, k, spans = offsets.shape[0] - 1
    cdef long long least, most, order
    smallest, greatest = np.empty(spans), np.empty(spans)
    cdef long long[::1] low = smallest.view(np.int64), high = greatest.view(np.int64)
    with nogil:
        for j in range(spans):
            least = most = ordered(bits[offsets[j]])
            for k in range(offsets[j] + 1, offsets[j + 1]):
                order = ordered(bits[k])
                least = order if order < least else least
                most = order if order > most else most
            low[j], high[j] = ordered(least), ordered(most)
    return smallest, greatest


cdef inline long long ordered(long long bits) noexcept nogil:
    return bits ^ ((bits >> 63) & MAGNITUDE)


def span_first(mask, const long long[::1] offsets):
    cdef const unsigned char[::1] hit = np.ascontiguousarray(mask).view(np.uint8)
    cdef Py_ssize_t j, k, stop = hit.shape[0], spans = offsets.shape[0] - 1
    first = np.empty(spans, np.int64)
    cdef long long[::1] out = first
    with nogil:
        for j in range(spans):
            k = offsets[j]
            while k < stop - 1 and not hit[k]:
                k += 1
            out[j] = k
    return first


def offsets_of(sizes):
    cdef const long long[::1] size = np.ascontiguousarray(sizes, np.int64)
    cdef Py_ssize_t j, count = size.shape[0]
    cdef long long total = 0
    offsets = np.empty(count + 1, np.int64)
    cdef long long[::1] out = offsets
    out[0] = 0
    with nogil:
        for j in range(count):
            total += size[j]
            out[j + 1] = total
    return offsets
