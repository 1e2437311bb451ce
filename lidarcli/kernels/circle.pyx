"""The circle through the points of a round object."""

import numpy as np

from libc.math cimport INFINITY, sqrt

from lidarcli.kernels.sums cimport reduced

cdef int REFINEMENTS = 4
cdef double LARGEST = 2.0


cdef struct Circle:
    double a
    double b
    double radius
    bint known


cdef inline double _at_least(double value, double least) noexcept nogil:
    return value if value > least else least


cdef inline void _distances(
    const double* u, const double* v, Py_ssize_t n, double a, double b, double* distance
) noexcept nogil:
    cdef Py_ssize_t i
    for i in range(n):
        distance[i] = sqrt((u[i] - a) * (u[i] - a) + (v[i] - b) * (v[i] - b))


cdef inline double _rms(const double* distance, Py_ssize_t n, double share, double radius, double* free) noexcept nogil:
    cdef Py_ssize_t i
    for i in range(n):
        free[i] = (distance[i] - radius) * (distance[i] - radius)
    return sqrt(reduced(free, n) * share)


cdef inline Circle _algebraic(
    const double* u, const double* v, Py_ssize_t n, double share, double* free
) noexcept nogil:
    cdef Py_ssize_t i
    cdef double uu, vv, uv, uw, vw, determinant, scale
    cdef double* by_uu = free
    cdef double* by_vv = free + n
    cdef double* by_uv = free + 2 * n
    cdef double* by_uw = free + 3 * n
    cdef double* by_vw = free + 4 * n
    cdef Circle found
    for i in range(n):
        by_uu[i] = u[i] * u[i]
        by_vv[i] = v[i] * v[i]
        by_uv[i] = u[i] * v[i]
        by_uw[i] = u[i] * (by_uu[i] + by_vv[i])
        by_vw[i] = v[i] * (by_uu[i] + by_vv[i])
    uu, vv, uv = reduced(by_uu, n), reduced(by_vv, n), reduced(by_uv, n)
    uw, vw = 0.5 * reduced(by_uw, n), 0.5 * reduced(by_vw, n)
    determinant = uu * vv - uv * uv
    found.known = determinant > 1e-9 * ((uu + vv) * (uu + vv))
    scale = 1.0 / (determinant if found.known else 1.0)
    found.a = (uw * vv - vw * uv) * scale * <double>found.known
    found.b = (vw * uu - uw * uv) * scale * <double>found.known
    found.radius = sqrt(found.a * found.a + found.b * found.b + (uu + vv) * share)
    return found


cdef inline Circle _refined(
    const double* u, const double* v, Py_ssize_t n, double share, Circle circle, double* distance, double* free
) noexcept nogil:
    """One step; `distance` is that from the centre, before and after."""
    cdef Py_ssize_t i
    cdef double inverse, mean, mean_x, mean_y, jx, jy, residual, xx, yy, xy, rx, ry
    cdef double determinant, scale, step_x, step_y, length, limit
    cdef double* dx = free
    cdef double* dy = free + n
    cdef double* by_xx = free + 2 * n
    cdef double* by_yy = free + 3 * n
    cdef double* by_xy = free + 4 * n
    for i in range(n):
        inverse = 1.0 / _at_least(distance[i], 1e-9)
        dx[i] = (u[i] - circle.a) * inverse
        dy[i] = (v[i] - circle.b) * inverse
    mean, mean_x, mean_y = reduced(distance, n) * share, reduced(dx, n) * share, reduced(dy, n) * share
    for i in range(n):
        jx, jy, residual = mean_x - dx[i], mean_y - dy[i], distance[i] - mean
        by_xx[i] = jx * jx
        by_yy[i] = jy * jy
        by_xy[i] = jx * jy
        dx[i] = jx * residual
        dy[i] = jy * residual
    xx, yy, xy, rx, ry = reduced(by_xx, n), reduced(by_yy, n), reduced(by_xy, n), reduced(dx, n), reduced(dy, n)
    determinant = xx * yy - xy * xy
    circle.known = circle.known and determinant > 1e-12 * ((xx + yy) * (xx + yy))
    scale = <double>circle.known / (determinant if circle.known else 1.0)
    step_x, step_y = (ry * xy - rx * yy) * scale, (rx * xy - ry * xx) * scale
    length = sqrt(step_x * step_x + step_y * step_y)
    limit = _at_least(circle.radius, 1e-9) / _at_least(length, 1e-9)
    limit = limit if limit < 1.0 else 1.0
    circle.a += step_x * limit
    circle.b += step_y * limit
    _distances(u, v, n, circle.a, circle.b, distance)
    circle.radius = reduced(distance, n) * share
    return circle


def least_squares(
    const double[::1] x, const double[::1] y, const long long[::1] offsets, const double[::1] within
):
    cdef Py_ssize_t j, i, n, most = 1, objects = offsets.shape[0] - 1
    cdef const double* from_x
    cdef const double* from_y
    cdef double share, middle_x, middle_y, rms
    cdef Circle circle
    cdef int step
    for j in range(objects):
        n = offsets[j + 1] - offsets[j]
        most = n if n > most else most
    found = np.empty((4, objects))
    cdef double[:, ::1] out = found
    cdef double[::1] buffer = np.empty(8 * most)
    cdef double* u = &buffer[0]
    cdef double* v = u + most
    cdef double* distance = u + 2 * most
    cdef double* free = u + 3 * most
    with nogil:
        for j in range(objects):
            if not within[j] >= 0.0:
                out[0, j] = out[1, j] = out[2, j] = 0.0
                out[3, j] = INFINITY
                continue
            n = offsets[j + 1] - offsets[j]
            from_x, from_y = &x[offsets[j]], &y[offsets[j]]
            share = 1.0 / <double>n
            middle_x, middle_y = reduced(from_x, n) * share, reduced(from_y, n) * share
            for i in range(n):
                u[i] = from_x[i] - middle_x
                v[i] = from_y[i] - middle_y
            circle = _algebraic(u, v, n, share, free)
            _distances(u, v, n, circle.a, circle.b, distance)
            rms = _rms(distance, n, share, circle.radius, free) if circle.known else INFINITY
            if rms <= within[j]:
                for step in range(REFINEMENTS):
                    circle = _refined(u, v, n, share, circle, distance, free)
                rms = INFINITY
                if circle.known and circle.radius < LARGEST:
                    rms = _rms(distance, n, share, circle.radius, free)
            else:
                rms = INFINITY
            out[0, j] = circle.a + middle_x
            out[1, j] = circle.b + middle_y
            out[2, j] = circle.radius
            out[3, j] = rms
    return tuple(found)
