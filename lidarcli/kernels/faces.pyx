"""Definition 7: the faces of runs."""

import numpy as np

from lidarcli.kernels.lines cimport Lines, columns, join, split, stride_of, thin


def straight(
    const long long[::1] first,
    const long long[::1] size,
    const long long[::1] most,
    const double[::1] x,
    const double[::1] y,
    const double[::1] tolerance,
):
    cdef Py_ssize_t j, n, runs = first.shape[0], room = 1, longest = 1
    cdef long long stride
    cdef const double* from_x
    cdef const double* from_y
    for j in range(runs):
        if stride_of(size[j], most[j]):
            n = size[j] if size[j] < most[j] else most[j]
            room += n
            longest = n + 1 if n + 1 > longest else longest
    integers, floats, offset = np.empty((4, room), np.int64), np.empty((6, room)), np.empty(runs + 1, np.int64)
    cdef long long[::1] offsets = offset
    cdef double[::1] buffer = np.empty(2 * longest)
    cdef unsigned char[::1] marks = np.empty(longest, np.uint8)
    cdef double* to_x = &buffer[0]
    cdef double* to_y = to_x + longest
    cdef Lines lines = columns(integers, floats)
    with nogil:
        for j in range(runs):
            offsets[j] = lines.count
            stride = stride_of(size[j], most[j])
            if not stride:
                continue
            n, from_x, from_y = size[j], &x[first[j]], &y[first[j]]
            if stride > 1:
                n = thin(from_x, from_y, size[j], stride, to_x, to_y)
                from_x, from_y = to_x, to_y
            split(from_x, from_y, n, tolerance[j], &marks[0])
            join(from_x, from_y, &marks[0], n, j, first[j], size[j], stride, &lines)
        offsets[runs] = lines.count
    n = lines.count
    return *integers[:, :n], *floats[:, :n], offset


def between(
    const long long[::1] first, const long long[::1] size, const double[::1] x, const double[::1] y, inner
):
    cdef const unsigned char[::1] marks = inner.view(np.uint8)
    cdef Py_ssize_t j, n, i, runs = first.shape[0], room = 1
    for j in range(runs):
        room += 1
        for i in range(first[j], first[j] + size[j]):
            room += marks[i]
    integers, floats, offset = np.empty((4, room), np.int64), np.empty((6, room)), np.empty(runs + 1, np.int64)
    cdef long long[::1] offsets = offset
    cdef Lines lines = columns(integers, floats)
    with nogil:
        for j in range(runs):
            offsets[j] = lines.count
            n = first[j]
            join(&x[n], &y[n], &marks[n], size[j], j, first[j], size[j], 1, &lines)
        offsets[runs] = lines.count
    n = lines.count
    return *integers[:, :n], *floats[:, :n], offset
