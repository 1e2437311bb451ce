"""How well straight faces explain the points of objects."""

import numpy as np

from libc.math cimport sqrt


def straightness(faces, const long long[::1] face, const long long[::1] offsets, double least):
    cdef const long long[::1] points = faces.points
    cdef const double[::1] rms = faces.rms
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef Py_ssize_t k, i, objects = offsets.shape[0] - 1
    cdef long long at, before
    cdef double total, weight, n
    cdef bint right
    scatter, squares = np.empty(objects), np.empty(objects, bool)
    cdef double[::1] scattered = scatter
    cdef unsigned char[::1] square = squares.view(np.uint8)
    with nogil:
        for k in range(objects):
            total, weight, right = 0.0, 0.0, True
            for i in range(offsets[k], offsets[k + 1]):
                at = face[i]
                n = <double>points[at]
                total += n * (rms[at] * rms[at])
                weight += n
                if i > offsets[k]:
                    before = face[i - 1]
                    right = right and direction_y[before] * direction_x[at] - direction_x[before] * direction_y[at] >= least
            scattered[k] = sqrt(total / (weight if weight > 1.0 else 1.0))
            square[k] = right
    return scatter, squares
