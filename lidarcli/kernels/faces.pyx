"""Definition 7: outlines, their splitting into faces, and the lines of these."""

import numpy as np

from libc.math cimport M_PI, fabs, sqrt

from lidarcli.kernels.sums cimport reduced

cdef int MAX_SPLITS = 24


def thinned(
    const long long[::1] first,
    const long long[::1] size,
    const long long[::1] most,
    const double[::1] x,
    const double[::1] y,
):
    cdef Py_ssize_t j, k, n = 0, runs = first.shape[0]
    cdef long long step, end, at
    starts = np.empty(runs + 1, np.int64)
    strides = np.empty(runs, np.int64)
    cdef long long[::1] start = starts
    cdef long long[::1] stride = strides
    with nogil:
        start[0] = 0
        for j in range(runs):
            stride[j] = 1
            if most[j] >= 2:
                if size[j] > most[j]:
                    stride[j] = (size[j] + most[j] - 1) // most[j]
                    n += (size[j] - 1 + stride[j] - 1) // stride[j] + 1
                else:
                    n += size[j]
            start[j + 1] = n
    indices, xs, ys = np.empty(n, np.int64), np.empty(n), np.empty(n)
    cdef long long[::1] index = indices
    cdef double[::1] to_x = xs
    cdef double[::1] to_y = ys
    with nogil:
        for j in range(runs):
            at, step, end = first[j], stride[j], first[j] + size[j] - 1
            if step == 1:
                for k in range(start[j], start[j + 1]):
                    index[k] = at
                    to_x[k] = x[at]
                    to_y[k] = y[at]
                    at += 1
            else:
                for k in range(start[j], start[j + 1]):
                    if at > end:
                        at = end
                    index[k] = at
                    to_x[k] = x[at]
                    to_y[k] = y[at]
                    at += step
    return indices, starts, xs, ys


cdef inline double _away(double nx, double ny, double base, double x, double y) noexcept nogil:
    return fabs(nx * x + ny * y - base)


cdef inline double _greater(double a, double b) noexcept nogil:
    return a if a > b else b


cdef Py_ssize_t _farthest(
    const double* x, const double* y, Py_ssize_t begin, Py_ssize_t end, double tolerance
) noexcept nogil:
    """The first point farthest from the chord of a stretch, or -1 where none is beyond the tolerance."""
    cdef Py_ssize_t i, k, at = -1
    cdef double x0 = x[begin], y0 = y[begin], dx = x[end] - x0, dy = y[end] - y0
    cdef double length = sqrt(dx * dx + dy * dy), best = tolerance, away, scale, nx, ny, base, most
    if length < tolerance:
        for i in range(begin + 1, end):
            away = sqrt((x[i] - x0) * (x[i] - x0) + (y[i] - y0) * (y[i] - y0))
            if away > best:
                best = away
                at = i
        return at
    scale = 1.0 / length
    nx, ny = dy * scale, -dx * scale
    base = x0 * nx + y0 * ny
    i = begin + 1
    # By blocks, of which few hold a point farther than all before.
    while i + 8 <= end:
        most = _greater(
            _greater(
                _greater(_away(nx, ny, base, x[i], y[i]), _away(nx, ny, base, x[i + 1], y[i + 1])),
                _greater(_away(nx, ny, base, x[i + 2], y[i + 2]), _away(nx, ny, base, x[i + 3], y[i + 3])),
            ),
            _greater(
                _greater(_away(nx, ny, base, x[i + 4], y[i + 4]), _away(nx, ny, base, x[i + 5], y[i + 5])),
                _greater(_away(nx, ny, base, x[i + 6], y[i + 6]), _away(nx, ny, base, x[i + 7], y[i + 7])),
            ),
        )
        if most > best:
            for k in range(i, i + 8):
                away = _away(nx, ny, base, x[k], y[k])
                if away > best:
                    best = away
                    at = k
        i += 8
    while i < end:
        away = _away(nx, ny, base, x[i], y[i])
        if away > best:
            best = away
            at = i
        i += 1
    return at


def split_straight(shape, const double[::1] tolerance):
    cdef const double[::1] x = shape.x
    cdef const double[::1] y = shape.y
    cdef const long long[::1] start = shape.start
    cdef Py_ssize_t j, begin, end, middle, runs = start.shape[0] - 1
    cdef Py_ssize_t begins[64]
    cdef Py_ssize_t ends[64]
    cdef int levels[64]
    cdef int waiting, level
    marks = np.zeros(x.shape[0], bool)
    cdef unsigned char[::1] inner = marks.view(np.uint8)
    with nogil:
        for j in range(runs):
            if start[j + 1] - start[j] < 3:
                continue
            begins[0], ends[0], levels[0] = start[j], start[j + 1] - 1, 1
            waiting = 1
            while waiting:
                waiting -= 1
                begin, end, level = begins[waiting], ends[waiting], levels[waiting]
                middle = _farthest(&x[0], &y[0], begin, end, tolerance[j])
                if middle < 0:
                    continue
                inner[middle] = True
                if level == MAX_SPLITS:
                    continue
                if end - middle > 1:
                    begins[waiting], ends[waiting], levels[waiting] = middle, end, level + 1
                    waiting += 1
                if middle - begin > 1:
                    begins[waiting], ends[waiting], levels[waiting] = begin, middle, level + 1
                    waiting += 1
    return marks


def straight_lines(
    const double[::1] x, const double[::1] y, const long long[::1] start, inner
):
    cdef const unsigned char[::1] marks = inner.view(np.uint8)
    cdef Py_ssize_t j, i, k, f, begin, end, stop, n, runs = start.shape[0] - 1, faces = 0, longest = 0
    cdef double x0, y0, dx, dy, end_x, end_y, share, mean_x, mean_y, xx, xy, yy, half, spread
    cdef bint shared
    with nogil:
        for j in range(runs):
            n = start[j + 1] - start[j]
            faces += n > 1
            longest = n if n > longest else longest
        for i in range(marks.shape[0]):
            faces += marks[i]
    offset = np.empty(runs + 1, np.int64)
    ints = np.empty((4, faces), np.int64)
    floats = np.empty((5, faces))
    cdef long long[::1] offsets = offset
    cdef long long[::1] run = ints[0]
    cdef long long[::1] first = ints[1]
    cdef long long[::1] last = ints[2]
    cdef long long[::1] points = ints[3]
    cdef double[::1] middle_x = floats[0]
    cdef double[::1] middle_y = floats[1]
    cdef double[::1] twice_xy = floats[2]
    cdef double[::1] difference = floats[3]
    cdef double[::1] rms = floats[4]
    cdef double[::1] buffer = np.empty(5 * longest + 1)
    cdef double* by_x = &buffer[0]
    cdef double* by_y
    cdef double* by_xy
    cdef double* by_xx
    cdef double* by_yy
    f = 0
    with nogil:
        for j in range(runs):
            offsets[j] = f
            stop = start[j + 1]
            if stop - start[j] < 2:
                continue
            begin = start[j]
            while begin < stop:
                end = begin + 1
                while end < stop and not marks[end]:
                    end += 1
                # The vertex between two faces belongs to both.
                shared = end < stop
                n = end - begin
                by_y, by_xy, by_xx, by_yy = by_x + n, by_x + 2 * n, by_x + 3 * n, by_x + 4 * n
                x0, y0 = x[begin], y[begin]
                for k in range(n):
                    dx, dy = x[begin + k] - x0, y[begin + k] - y0
                    by_x[k] = dx
                    by_y[k] = dy
                    by_xy[k] = dx * dy
                    by_xx[k] = dx * dx
                    by_yy[k] = dy * dy
                i = end - 1 + shared
                end_x, end_y = (x[i] - x0) * shared, (y[i] - y0) * shared
                share = 1.0 / <double>(n + shared)
                mean_x = (reduced(by_x, n) + end_x) * share
                mean_y = (reduced(by_y, n) + end_y) * share
                xy = (reduced(by_xy, n) + end_x * end_y) * share - mean_x * mean_y
                xx = (reduced(by_xx, n) + end_x * end_x) * share - mean_x * mean_x
                yy = (reduced(by_yy, n) + end_y * end_y) * share - mean_y * mean_y
                half = 0.5 * (xx - yy)
                spread = 0.5 * (xx + yy) - sqrt(half * half + xy * xy)
                run[f] = j
                first[f] = begin
                last[f] = i
                points[f] = n + shared
                middle_x[f] = x0 + mean_x
                middle_y[f] = y0 + mean_y
                twice_xy[f] = 2.0 * xy
                difference[f] = xx - yy
                rms[f] = sqrt(spread if spread > 0.0 else 0.0)
                f += 1
                begin = end
        offsets[runs] = f
    return (*ints, *floats, offset)


def directed(
    const double[::1] x,
    const double[::1] y,
    const long long[::1] first,
    const long long[::1] last,
    double[::1] direction_x,
    double[::1] direction_y,
    double[::1] angle,
):
    cdef Py_ssize_t f
    cdef double along
    cdef bint turned
    lengths = np.empty(first.shape[0])
    cdef double[::1] length = lengths
    with nogil:
        for f in range(first.shape[0]):
            along = (x[last[f]] - x[first[f]]) * direction_x[f] + (y[last[f]] - y[first[f]]) * direction_y[f]
            turned = along < 0
            if turned:
                direction_x[f] = -direction_x[f]
                direction_y[f] = -direction_y[f]
            angle[f] += M_PI * turned
            length[f] = fabs(along)
    return lengths
