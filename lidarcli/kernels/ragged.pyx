"""Index arithmetic for ragged arrays."""

import numpy as np

from lidarcli.kernels.sums cimport reduced


def span_sum(const double[::1] values, const long long[::1] offsets):
    cdef Py_ssize_t j, spans = offsets.shape[0] - 1
    total = np.empty(spans)
    cdef double[::1] out = total
    with nogil:
        for j in range(spans):
            out[j] = reduced(&values[offsets[j]], offsets[j + 1] - offsets[j])
    return total
