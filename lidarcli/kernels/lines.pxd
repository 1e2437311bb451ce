"""Splitting runs into faces, and the straight lines of these, run by run."""

from libc.math cimport fabs, sqrt

cdef enum:
    MAX_SPLITS = 24


cdef struct Line:
    double middle_x
    double middle_y
    double direction_x
    double direction_y
    double rms
    double length


# Columns of all faces, of which `count` are filled.
cdef struct Lines:
    Py_ssize_t count
    long long* run
    long long* first
    long long* last
    long long* points
    double* middle_x
    double* middle_y
    double* direction_x
    double* direction_y
    double* rms
    double* length


cdef inline Lines columns(long long[:, ::1] integers, double[:, ::1] floats) noexcept nogil:
    cdef Lines lines
    lines.count = 0
    lines.run, lines.first = &integers[0, 0], &integers[1, 0]
    lines.last, lines.points = &integers[2, 0], &integers[3, 0]
    lines.middle_x, lines.middle_y = &floats[0, 0], &floats[1, 0]
    lines.direction_x, lines.direction_y = &floats[2, 0], &floats[3, 0]
    lines.rms, lines.length = &floats[4, 0], &floats[5, 0]
    return lines


cdef inline long long stride_of(long long size, long long most) noexcept nogil:
    """Of a run with so many points, every how many-th stands for it; 0 if none does."""
    if most < 2 or size < 2:
        return 0
    return (size + most - 1) // most if size > most else 1


cdef inline Py_ssize_t thin(
    const double* x, const double* y, long long size, long long stride, double* to_x, double* to_y
) noexcept nogil:
    """Copy every `stride`-th point of a run and its last; returns how many."""
    cdef Py_ssize_t n = 0
    cdef long long at = 0
    while at < size - 1:
        to_x[n] = x[at]
        to_y[n] = y[at]
        n += 1
        at += stride
    to_x[n] = x[size - 1]
    to_y[n] = y[size - 1]
    return n + 1


cdef inline double _away(double nx, double ny, double base, double x, double y) noexcept nogil:
    return fabs(nx * x + ny * y - base)


cdef inline double _greater(double a, double b) noexcept nogil:
    return a if a > b else b


cdef inline Py_ssize_t _farthest(
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
    nx = dy * scale
    ny = -dx * scale
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


cdef inline void split(
    const double* x, const double* y, Py_ssize_t n, double tolerance, unsigned char* inner
) noexcept nogil:
    """Mark the points where the faces of a run meet."""
    cdef Py_ssize_t begins[MAX_SPLITS + 2]
    cdef Py_ssize_t ends[MAX_SPLITS + 2]
    cdef int levels[MAX_SPLITS + 2]
    cdef int waiting = 1, level
    cdef Py_ssize_t i, begin, end, middle
    for i in range(n):
        inner[i] = 0
    if n < 3:
        return
    begins[0], ends[0], levels[0] = 0, n - 1, 1
    while waiting:
        waiting -= 1
        begin, end, level = begins[waiting], ends[waiting], levels[waiting]
        middle = _farthest(x, y, begin, end, tolerance)
        if middle < 0:
            continue
        inner[middle] = 1
        if level == MAX_SPLITS:
            continue
        if end - middle > 1:
            begins[waiting], ends[waiting], levels[waiting] = middle, end, level + 1
            waiting += 1
        if middle - begin > 1:
            begins[waiting], ends[waiting], levels[waiting] = begin, middle, level + 1
            waiting += 1


cdef inline Line fit(const double* x, const double* y, Py_ssize_t last) noexcept nogil:
    """The line through the points up to `last`, along the way from the first to the last."""
    cdef Py_ssize_t k
    cdef double x0 = x[0], y0 = y[0], dx, dy, share, xx, xy, yy, half, root, spread, far, scale
    cdef double sum_x = 0.0, sum_y = 0.0, sum_xx = 0.0, sum_xy = 0.0, sum_yy = 0.0
    cdef Line line
    for k in range(last + 1):
        dx = x[k] - x0
        dy = y[k] - y0
        sum_x += dx
        sum_y += dy
        sum_xy += dx * dy
        sum_xx += dx * dx
        sum_yy += dy * dy
    share = 1.0 / <double>(last + 1)
    dx = sum_x * share
    dy = sum_y * share
    xy = sum_xy * share - dx * dy
    xx = sum_xx * share - dx * dx
    yy = sum_yy * share - dy * dy
    half = 0.5 * (xx - yy)
    root = sqrt(half * half + xy * xy)
    spread = 0.5 * (xx + yy) - root
    line.rms = sqrt(spread if spread > 0.0 else 0.0)
    line.middle_x = x0 + dx
    line.middle_y = y0 + dy
    # Half the angle of (half, xy).
    far = root + fabs(half)
    scale = sqrt(far * far + xy * xy)
    scale = 1.0 / scale if scale > 0.0 else 0.0
    if half >= 0.0:
        line.direction_x = far * scale if scale > 0.0 else 1.0
        line.direction_y = xy * scale
    else:
        line.direction_x = xy * scale
        line.direction_y = far * scale
    line.length = (x[last] - x0) * line.direction_x + (y[last] - y0) * line.direction_y
    if line.length < 0.0:
        line.direction_x = -line.direction_x
        line.direction_y = -line.direction_y
    line.length = fabs(line.length)
    return line


cdef inline void join(
    const double* x,
    const double* y,
    const unsigned char* inner,
    Py_ssize_t n,
    long long run,
    long long first,
    long long size,
    long long stride,
    Lines* lines,
) noexcept nogil:
    """Append the faces between the marked points of a run; the vertex between two faces belongs to both."""
    cdef Py_ssize_t begin = 0, end, f
    cdef Line line
    while begin < n - 1:
        end = begin + 1
        while end < n - 1 and not inner[end]:
            end += 1
        line = fit(x + begin, y + begin, end - begin)
        f = lines.count
        lines.run[f] = run
        lines.first[f] = first + begin * stride
        lines.last[f] = first + (end * stride if end < n - 1 else size - 1)
        lines.points[f] = end - begin + 1
        lines.middle_x[f] = line.middle_x
        lines.middle_y[f] = line.middle_y
        lines.direction_x[f] = line.direction_x
        lines.direction_y[f] = line.direction_y
        lines.rms[f] = line.rms
        lines.length[f] = line.length
        lines.count += 1
        begin = end
