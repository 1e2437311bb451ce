"""Ranges judged once."""

from libc.math cimport INFINITY, NAN, nextafterf
from libc.string cimport memcpy

import numpy as np

cdef enum:
    VALID = 0
    NO_RETURN = 1
    TOO_CLOSE = 2
    INVALID = 3
    PADDING = 4


def judge(ranges, beams, const float[::1] low, const float[::1] high, words):
    # Messages lie in a log as they like.
    cdef const float[:, ::1] raw = np.require(ranges, np.float32, "CA")
    cdef const int[::1] counted = np.ascontiguousarray(beams, np.int32)
    cdef bint nan = "nan" in words, inf = "inf" in words, zero = "zero" in words, negative = "negative" in words
    cdef bint below = "below" in words, at_max = "max" in words, above = "above" in words
    cdef Py_ssize_t i, k, stop, count, rows = raw.shape[0], width = raw.shape[1]
    cdef unsigned long long eight
    cdef float least, most, limit, value
    clean_, status_ = np.empty((rows, width), np.float32), np.empty((rows, width), np.uint8)
    if not rows or not width:
        return clean_, status_
    cdef float[:, ::1] clean = clean_
    cdef unsigned char[:, ::1] status = status_
    cdef const float* source
    cdef float* target
    cdef unsigned char* says
    with nogil:
        for i in range(rows):
            source, target, says = &raw[i, 0], &clean[i, 0], &status[i, 0]
            count = min(counted[i], width)
            least, limit = low[i], high[i]
            most = nextafterf(limit, -INFINITY) if at_max else limit
            for k in range(count):
                value = source[k]
                target[k] = value if (value >= least) & (value <= most) else NAN
            for k in range(count):
                says[k] = (not source[k] >= least) | (not source[k] <= most)
            for k in range(count, width):
                target[k] = NAN
                says[k] = PADDING
            # Few beams are lost, or none.
            k = 0
            while k < count:
                stop = k + 8
                if stop <= count:
                    memcpy(&eight, says + k, 8)
                    if eight == 0:
                        k = stop
                        continue
                else:
                    stop = count
                for k in range(k, stop):
                    if not says[k]:
                        continue
                    value = source[k]
                    if value != value:
                        says[k] = NO_RETURN if nan else INVALID
                    elif value == INFINITY:
                        says[k] = NO_RETURN if inf else INVALID
                    elif value == -INFINITY:
                        says[k] = TOO_CLOSE
                    elif value < 0:
                        says[k] = NO_RETURN if negative else INVALID
                    elif value == 0:
                        says[k] = NO_RETURN if zero else INVALID
                    elif value < least:
                        # A limit may be below the nearest range.
                        says[k] = NO_RETURN if below or above and value > limit else TOO_CLOSE
                        if at_max and value == limit:
                            says[k] = NO_RETURN
                    elif value == limit:
                        says[k] = NO_RETURN if at_max else INVALID
                    else:
                        says[k] = NO_RETURN if above else INVALID
                k = stop
    return clean_, status_


def count_statuses(status):
    cdef const unsigned char[:, ::1] says = np.ascontiguousarray(status)
    cdef Py_ssize_t i, k, j, rows = says.shape[0], width = says.shape[1]
    cdef unsigned long long eight
    cdef int valid
    counts_ = np.zeros((PADDING + 1, rows), np.int32)
    cdef int[:, ::1] counts = counts_
    with nogil:
        for i in range(rows):
            valid = 0
            k = 0
            while k + 8 <= width:
                memcpy(&eight, &says[i, k], 8)
                if eight == 0:
                    valid += 8
                else:
                    for j in range(k, k + 8):
                        counts[says[i, j], i] += 1
                k += 8
            for j in range(k, width):
                counts[says[i, j], i] += 1
            counts[VALID, i] += valid
    return counts_
