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


def rectangles(members, outlines, by_vertices, faces, is_round, circles, double oblique):
    cdef const long long[::1] offsets = members.offsets
    cdef const double[::1] x = members.point_x
    cdef const double[::1] y = members.point_y
    cdef const long long[::1] vertex_offsets = outlines.offsets
    cdef const double[::1] vertex_x = outlines.x
    cdef const double[::1] vertex_y = outlines.y
    cdef const long long[::1] face_offsets = outlines.face_offsets
    cdef const long long[::1] face = outlines.face
    cdef const double[::1] length = faces.length
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const double[::1] circle_x = circles.x
    cdef const double[::1] circle_y = circles.y
    cdef const double[::1] radius = circles.radius
    cdef const unsigned char[::1] by_vertex = by_vertices.view(np.uint8)
    cdef const unsigned char[::1] as_circle = is_round.view(np.uint8)
    cdef Py_ssize_t k, i, n, objects = offsets.shape[0] - 1
    cdef const double* from_x
    cdef const double* from_y
    cdef long long longest, second
    cdef double ux, uy, wx, wy, far, u, v, along, across
    cdef Rectangle r, other
    found = np.empty((6, objects))
    cdef double[:, ::1] out = found
    with nogil:
        for k in range(objects):
            if as_circle[k]:
                ux, uy = circle_x[k], circle_y[k]
                out[0, k], out[1, k] = ux, uy
                out[2, k] = out[3, k] = 2.0 * radius[k]
            else:
                longest = second = -1
                for i in range(face_offsets[k], face_offsets[k + 1]):
                    if longest < 0 or length[face[i]] > length[longest]:
                        longest, second = face[i], longest
                    elif second < 0 or length[face[i]] > length[second]:
                        second = face[i]
                if longest >= 0:
                    ux, uy = direction_x[longest], direction_y[longest]
                else:
                    ux = x[offsets[k + 1] - 1] - x[offsets[k]]
                    uy = y[offsets[k + 1] - 1] - y[offsets[k]]
                    far = sqrt(ux * ux + uy * uy)
                    if far > 0.0:
                        ux, uy = ux / far, uy / far
                    else:
                        ux, uy = 1.0, 0.0
                if by_vertex[k]:
                    i, n = vertex_offsets[k], vertex_offsets[k + 1] - vertex_offsets[k]
                    from_x, from_y = &vertex_x[i], &vertex_y[i]
                else:
                    i, n = offsets[k], offsets[k + 1] - offsets[k]
                    from_x, from_y = &x[i], &y[i]
                r = _around(from_x, from_y, n, ux, uy)
                if second >= 0:
                    wx, wy = direction_x[second], direction_y[second]
                    if fabs(2.0 * (ux * wy - uy * wx) * (ux * wx + uy * wy)) > oblique:
                        other = _around(from_x, from_y, n, wx, wy)
                        if _area(other) < (1.0 - TIE) * _area(r):
                            r, ux, uy = other, wx, wy
                u, v = 0.5 * (r.low_u + r.high_u), 0.5 * (r.low_v + r.high_v)
                along, across = r.high_u - r.low_u, r.high_v - r.low_v
                out[0, k] = u * ux - v * uy + 0.0
                out[1, k] = u * uy + v * ux + 0.0
                if across > along:
                    along, across = across, along
                    ux, uy = -uy, ux
                out[2, k], out[3, k] = along, across
            # A side and its opposite are one: that which points forward tells the yaw.
            if ux < 0.0 or (ux == 0.0 and uy < 0.0):
                ux, uy = -ux, -uy
            out[4, k] = ux + 0.0
            out[5, k] = uy + 0.0
    return tuple(found)
