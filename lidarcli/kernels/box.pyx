"""The oriented bounding boxes of objects."""

import numpy as np

from libc.math cimport fabs, sqrt

cdef double TIE = 1e-9


cdef struct Rectangle:
    double low_u
    double high_u
    double low_v
    double high_v


cdef inline Rectangle _around(
    const double* x, const double* y, Py_ssize_t n, double along_x, double along_y
) noexcept nogil:
    cdef Py_ssize_t i
    cdef double u, v
    cdef Rectangle r
    r.low_u = r.high_u = x[0] * along_x + y[0] * along_y
    r.low_v = r.high_v = y[0] * along_x - x[0] * along_y
    for i in range(1, n):
        u, v = x[i] * along_x + y[i] * along_y, y[i] * along_x - x[i] * along_y
        r.low_u = u if u < r.low_u else r.low_u
        r.high_u = u if u > r.high_u else r.high_u
        r.low_v = v if v < r.low_v else r.low_v
        r.high_v = v if v > r.high_v else r.high_v
    return r


cdef inline double _area(Rectangle r) noexcept nogil:
    return (r.high_u - r.low_u) * (r.high_v - r.low_v)


def rectangles(
    const double[::1] x,
    const double[::1] y,
    const long long[::1] begin,
    const long long[::1] size,
    const double[::1] length,
    const double[::1] direction_x,
    const double[::1] direction_y,
    const long long[::1] face,
    const long long[::1] offsets,
    double oblique,
):
    cdef Py_ssize_t k, i, objects = begin.shape[0]
    cdef const double* from_x
    cdef const double* from_y
    cdef long long longest, second, last
    cdef double ux, uy, wx, wy, far, u, v, along, across
    cdef Rectangle r, other
    found = np.empty((6, objects))
    cdef double[:, ::1] out = found
    with nogil:
        for k in range(objects):
            from_x, from_y = &x[begin[k]], &y[begin[k]]
            last = size[k] - 1
            longest = second = -1
            for i in range(offsets[k], offsets[k + 1]):
                if longest < 0 or length[face[i]] > length[longest]:
                    longest, second = face[i], longest
                elif second < 0 or length[face[i]] > length[second]:
                    second = face[i]
            if longest >= 0:
                ux, uy = direction_x[longest], direction_y[longest]
            else:
                ux, uy = from_x[last] - from_x[0], from_y[last] - from_y[0]
                far = sqrt(ux * ux + uy * uy)
                if far > 0.0:
                    ux, uy = ux / far, uy / far
                else:
                    ux, uy = 1.0, 0.0
            r = _around(from_x, from_y, size[k], ux, uy)
            if second >= 0:
                wx, wy = direction_x[second], direction_y[second]
                if fabs(2.0 * (ux * wy - uy * wx) * (ux * wx + uy * wy)) > oblique:
                    other = _around(from_x, from_y, size[k], wx, wy)
                    if _area(other) < (1.0 - TIE) * _area(r):
                        r, ux, uy = other, wx, wy
            u, v = 0.5 * (r.low_u + r.high_u), 0.5 * (r.low_v + r.high_v)
            along, across = r.high_u - r.low_u, r.high_v - r.low_v
            out[0, k] = u * ux - v * uy + 0.0
            out[1, k] = u * uy + v * ux + 0.0
            if across > along:
                along, across = across, along
                ux, uy = -uy, ux
            out[2, k], out[3, k], out[4, k], out[5, k] = along, across, ux, uy
    return tuple(found)
