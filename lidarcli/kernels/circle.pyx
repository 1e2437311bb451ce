"""The circle through the points of a round object."""

import numpy as np

from libc.math cimport INFINITY, sqrt

cdef enum:
    REFINEMENTS = 4

cdef double LARGEST = 2.0


# Of an object: its n centred points, and room for their ways from a centre and the lengths of these.
cdef struct Arc:
    Py_ssize_t n
    double share
    double* u
    double* v
    double* distance
    double* x
    double* y


cdef struct Circle:
    double a
    double b
    double radius
    bint known


cdef inline double _at_least(double value, double least) noexcept nogil:
    return value if value > least else least


cdef inline void _measure(Arc* arc, double a, double b) noexcept nogil:
    cdef Py_ssize_t i
    for i in range(arc.n):
        arc.x[i] = arc.u[i] - a
        arc.y[i] = arc.v[i] - b
        arc.distance[i] = sqrt(arc.x[i] * arc.x[i] + arc.y[i] * arc.y[i])


cdef inline double _rms(Arc* arc, double radius) noexcept nogil:
    cdef Py_ssize_t i
    cdef double total = 0.0
    for i in range(arc.n):
        total += (arc.distance[i] - radius) * (arc.distance[i] - radius)
    return sqrt(total * arc.share)


cdef inline Circle _algebraic(Arc* arc) noexcept nogil:
    cdef Py_ssize_t i
    cdef double uu = 0.0, vv = 0.0, uv = 0.0, uw = 0.0, vw = 0.0, u, v, w, determinant, scale
    cdef Circle found
    for i in range(arc.n):
        u = arc.u[i]
        v = arc.v[i]
        w = u * u + v * v
        uu += u * u
        vv += v * v
        uv += u * v
        uw += u * w
        vw += v * w
    uw *= 0.5
    vw *= 0.5
    determinant = uu * vv - uv * uv
    found.known = determinant > 1e-9 * ((uu + vv) * (uu + vv))
    scale = 1.0 / (determinant if found.known else 1.0)
    found.a = (uw * vv - vw * uv) * scale * <double>found.known
    found.b = (vw * uu - uw * uv) * scale * <double>found.known
    found.radius = sqrt(found.a * found.a + found.b * found.b + (uu + vv) * arc.share)
    return found


cdef inline double _mean(const double* values, Py_ssize_t n, double share) noexcept nogil:
    cdef Py_ssize_t i
    cdef double total = 0.0
    for i in range(n):
        total += values[i]
    return total * share


cdef inline void _refine(Arc* arc, Circle* circle, double mean) noexcept nogil:
    """One step; the arc is measured from the centre before and after, and `mean` is that of its distances before."""
    cdef Py_ssize_t i
    cdef double mean_x = 0.0, mean_y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0, rx = 0.0, ry = 0.0
    cdef double inverse, jx, jy, residual
    cdef double determinant, scale, step_x, step_y, length, limit
    for i in range(arc.n):
        inverse = 1.0 / _at_least(arc.distance[i], 1e-9)
        arc.x[i] *= inverse
        arc.y[i] *= inverse
        mean_x += arc.x[i]
        mean_y += arc.y[i]
    mean_x *= arc.share
    mean_y *= arc.share
    for i in range(arc.n):
        jx = mean_x - arc.x[i]
        jy = mean_y - arc.y[i]
        residual = arc.distance[i] - mean
        xx += jx * jx
        yy += jy * jy
        xy += jx * jy
        rx += jx * residual
        ry += jy * residual
    determinant = xx * yy - xy * xy
    circle.known = circle.known and determinant > 1e-12 * ((xx + yy) * (xx + yy))
    scale = <double>circle.known / (determinant if circle.known else 1.0)
    step_x = (ry * xy - rx * yy) * scale
    step_y = (rx * xy - ry * xx) * scale
    length = sqrt(step_x * step_x + step_y * step_y)
    limit = _at_least(circle.radius, 1e-9) / _at_least(length, 1e-9)
    limit = limit if limit < 1.0 else 1.0
    circle.a += step_x * limit
    circle.b += step_y * limit
    _measure(arc, circle.a, circle.b)
    circle.radius = _mean(arc.distance, arc.n, arc.share)


def least_squares(
    const double[::1] x, const double[::1] y, const long long[::1] offsets, const double[::1] within
):
    cdef Py_ssize_t j, i, n, most = 1, objects = offsets.shape[0] - 1
    cdef const double* from_x
    cdef const double* from_y
    cdef double middle_x, middle_y, rms, mean
    cdef Circle circle
    cdef Arc arc
    cdef int step
    for j in range(objects):
        n = offsets[j + 1] - offsets[j]
        most = n if n > most else most
    found = np.empty((4, objects))
    cdef double[:, ::1] out = found
    cdef double[:, ::1] buffer = np.empty((5, most))
    arc.u, arc.v = &buffer[0, 0], &buffer[1, 0]
    arc.distance, arc.x, arc.y = &buffer[2, 0], &buffer[3, 0], &buffer[4, 0]
    with nogil:
        for j in range(objects):
            if not within[j] >= 0.0:
                out[0, j] = out[1, j] = out[2, j] = 0.0
                out[3, j] = INFINITY
                continue
            n = offsets[j + 1] - offsets[j]
            from_x, from_y = &x[offsets[j]], &y[offsets[j]]
            arc.n = n
            arc.share = 1.0 / <double>n
            middle_x = _mean(from_x, n, arc.share)
            middle_y = _mean(from_y, n, arc.share)
            for i in range(n):
                arc.u[i] = from_x[i] - middle_x
                arc.v[i] = from_y[i] - middle_y
            circle = _algebraic(&arc)
            _measure(&arc, circle.a, circle.b)
            rms = _rms(&arc, circle.radius) if circle.known else INFINITY
            if rms <= within[j]:
                for step in range(REFINEMENTS):
                    mean = circle.radius if step else _mean(arc.distance, n, arc.share)
                    _refine(&arc, &circle, mean)
                rms = INFINITY
                if circle.known and circle.radius < LARGEST:
                    rms = _rms(&arc, circle.radius)
            else:
                rms = INFINITY
            out[0, j] = circle.a + middle_x
            out[1, j] = circle.b + middle_y
            out[2, j] = circle.radius
            out[3, j] = rms
    return tuple(found)
