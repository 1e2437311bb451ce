"""Passes over columns of tables."""

from libc.string cimport memcpy

import numpy as np


def any_nan(const double[::1] values):
    cdef Py_ssize_t k, count = values.shape[0], nan = 0
    with nogil:
        for k in range(count):
            nan += values[k] != values[k]
    return nan > 0


def spelled(const unsigned char[::1] codes, names):
    cdef Py_ssize_t k, j, at = 0, count = codes.shape[0], widest = max(map(len, names)) + 7 & ~7
    # The names are copied by eight bytes: the next one takes back what is too many.
    cdef const unsigned char[::1] letters = b"".join([name.ljust(widest, b"\0") for name in names])
    cdef const int[::1] length = np.array([*map(len, names)], np.int32)
    offsets_ = np.empty(count + 1, np.int32)
    cdef int[::1] offsets = offsets_
    with nogil:
        for k in range(count):
            offsets[k] = at
            at += length[codes[k]]
        offsets[count] = at
    text_ = np.empty(at + widest, np.uint8)
    cdef unsigned char[::1] text = text_
    with nogil:
        for k in range(count):
            for j in range(0, length[codes[k]], 8):
                memcpy(&text[offsets[k] + j], &letters[codes[k] * widest + j], 8)
    return offsets_, text_[:at]
