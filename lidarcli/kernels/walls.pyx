"""Walls, told from objects by their extent and by the lines they share."""

import numpy as np

from libc.math cimport fabs, sqrt

cdef double LINE_LENGTH = 0.5
cdef double COLLINEAR = 0.03
cdef double NOISE_GAIN = 3.0
cdef double WALL_THICKNESS = 0.5
cdef double DOORWAY = 2.0
cdef double NEXT_PIECE = 3.0
cdef double PAIR_ERROR = 0.1
cdef double REACH_LIMIT = 0.1
cdef double STRAIGHT = 0.02
cdef double STRAIGHT_NOISE = 3.0

cdef enum:
    LINE_POINTS = 4
    WALL_STRIDE = 4
    WALL_POINTS = 32


cdef struct Line:
    double middle_x
    double middle_y
    double direction_x
    double direction_y
    double normal_x
    double normal_y
    double distance
    double behind
    double length
    double spread


cdef struct Position:
    bint on_line
    bint jamb
    double reach
    double beyond
    double error


cdef inline double _least(double a, double b) noexcept nogil:
    return a if a < b else b


cdef inline double _most(double a, double b) noexcept nogil:
    return a if a > b else b


def surveyed(runs, const double[::1] sigma, long long min_beams, double max_width):
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const double[::1] x = runs.points.x
    cdef const double[::1] y = runs.points.y
    cdef Py_ssize_t j, count = first.shape[0]
    cdef long long a, b, few
    chords, tolerances, counts = np.empty(count), np.empty(count), np.empty(count, np.int64)
    cdef double[::1] ends = chords, tolerance = tolerances
    cdef long long[::1] most = counts
    with nogil:
        for j in range(count):
            a, b = first[j], first[j] + size[j] - 1
            ends[j] = sqrt((x[b] - x[a]) * (x[b] - x[a]) + (y[b] - y[a]) * (y[b] - y[a]))
            tolerance[j] = STRAIGHT + STRAIGHT_NOISE * sigma[row[j]]
            if ends[j] <= max_width:
                most[j] = size[j] if size[j] >= min_beams else 0
            else:
                few = size[j] if size[j] < WALL_POINTS else WALL_POINTS
                most[j] = (size[j] + WALL_STRIDE - 1) // WALL_STRIDE
                most[j] = few if few > most[j] else most[j]
    return chords, tolerances, counts


def reached(runs, faces, const double[::1] ends):
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const double[::1] x = runs.points.x
    cdef const double[::1] y = runs.points.y
    cdef const long long[::1] vertex = faces.last
    cdef const long long[::1] offsets = faces.offsets
    cdef Py_ssize_t j, f, count = first.shape[0]
    cdef long long a, b, at
    cdef double from_first, from_last
    extents = np.empty(count)
    cdef double[::1] reach = extents
    with nogil:
        for j in range(count):
            reach[j] = ends[j]
            if offsets[j + 1] - offsets[j] < 2:
                continue
            a, b = first[j], first[j] + size[j] - 1
            from_first = from_last = 0.0
            for f in range(offsets[j], offsets[j + 1]):
                at = vertex[f]
                from_first = _most(from_first, (x[at] - x[a]) * (x[at] - x[a]) + (y[at] - y[a]) * (y[at] - y[a]))
                from_last = _most(from_last, (x[at] - x[b]) * (x[at] - x[b]) + (y[at] - y[b]) * (y[at] - y[b]))
            reach[j] = _most(_most(reach[j], sqrt(from_first)), sqrt(from_last))
    return extents


def on_wall_lines(runs, faces, wall, candidate, partial, const double[::1] sigma, double max_width):
    cdef const long long[::1] run_row = runs.row
    cdef const long long[::1] run = faces.run
    cdef const long long[::1] points = faces.points
    cdef const double[::1] middle_x = faces.middle_x
    cdef const double[::1] middle_y = faces.middle_y
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const double[::1] rms = faces.rms
    cdef const double[::1] length = faces.length
    cdef const unsigned char[::1] is_wall = wall.view(np.uint8)
    cdef const unsigned char[::1] small = candidate.view(np.uint8)
    cdef const unsigned char[::1] hidden = partial.view(np.uint8)
    cdef Py_ssize_t f, g, i, j, begin, end, lines, count = run.shape[0], runs_ = run_row.shape[0]
    cdef long long row
    cdef double allowed, deepest, depth, noise
    cdef Line line
    cdef Position lies
    cdef bint pair, on_line
    found, balances = np.empty(runs_, bool), np.zeros(runs_)
    cdef unsigned char[::1] out = found.view(np.uint8)
    cdef double[::1] balance = balances
    cdef unsigned char[::1] matched = np.zeros(count, np.uint8)
    cdef long long[::1] line_face = np.empty(count, np.int64)
    with nogil:
        begin = 0
        while begin < count:
            # The faces of one sweep, and those of them that give a line.
            row = run_row[run[begin]]
            noise = sigma[row]
            lines = 0
            end = begin
            while end < count and run_row[run[end]] == row:
                j = run[end]
                if (is_wall[j] or small[j] and hidden[j]) and length[end] >= LINE_LENGTH and points[end] >= LINE_POINTS:
                    line_face[lines] = end
                    lines += 1
                end += 1
            allowed = COLLINEAR + REACH_LIMIT + NOISE_GAIN * noise
            deepest = _most(allowed, WALL_THICKNESS)
            for i in range(lines):
                f = line_face[i]
                line.middle_x, line.middle_y = middle_x[f], middle_y[f]
                line.direction_x, line.direction_y = direction_x[f], direction_y[f]
                line.distance = middle_x[f] * direction_y[f] + middle_y[f] * -direction_x[f]
                line.behind = 1.0 if line.distance > 0 else -1.0
                line.distance *= line.behind
                line.normal_x, line.normal_y = direction_y[f] * line.behind, -direction_x[f] * line.behind
                line.length = length[f]
                line.spread = _most(rms[f], noise) / sqrt(<double>points[f])
                for g in range(begin, end):
                    if not small[run[g]]:
                        continue
                    depth = middle_x[g] * line.normal_x + middle_y[g] * line.normal_y - line.distance
                    if not (depth >= -allowed and depth <= deepest):
                        continue
                    lies = _place(
                        line, middle_x[g], middle_y[g], direction_x[g], direction_y[g], length[g],
                        <double>points[g], noise,
                    )
                    j = run[g]
                    pair = hidden[j] and run[f] != j and lies.reach > max_width and lies.error < PAIR_ERROR
                    on_line = lies.on_line and (hidden[j] or lies.beyond < NEXT_PIECE)
                    if (on_line or lies.jamb) and is_wall[run[f]] or on_line and pair:
                        matched[f] = matched[g] = 1
            for g in range(begin, end):
                if small[run[g]]:
                    balance[run[g]] += length[g] if matched[g] else -length[g]
            begin = end
        for j in range(runs_):
            out[j] = small[j] and balance[j] > 0
    return found


cdef inline Position _place(
    Line line, double middle_x, double middle_y, double direction_x, double direction_y, double length, double points,
    double noise,
) noexcept nogil:
    """How a face lies to a line."""
    cdef double dx, dy, side, line_error
    cdef double depth[2]
    cdef double along[2]
    cdef double allowed[2]
    cdef double own_error = NOISE_GAIN * noise * _least(1.0, 2.0 / sqrt(points)), half = 0.5 * length
    cdef int i
    cdef bint first, last
    cdef Position lies
    lies.error = 0.0
    for i in range(2):
        side = half if i else -half
        dx = middle_x + side * direction_x - line.middle_x
        dy = middle_y + side * direction_y - line.middle_y
        depth[i] = (dx * line.direction_y - dy * line.direction_x) * line.behind
        along[i] = fabs(dx * line.direction_x + dy * line.direction_y)
        line_error = NOISE_GAIN * line.spread * sqrt(
            1.0 + 12.0 * ((along[i] / line.length) * (along[i] / line.length))
        )
        lies.error = _most(lies.error, line_error)
        allowed[i] = COLLINEAR + own_error + _least(line_error, REACH_LIMIT)
    lies.reach = _most(along[0], along[1]) + 0.5 * line.length
    lies.beyond = _least(along[0], along[1]) - 0.5 * line.length
    first, last = fabs(depth[0]) <= allowed[0], fabs(depth[1]) <= allowed[1]
    lies.on_line = first and last
    lies.jamb = (
        (first or last)
        and depth[0] >= -allowed[0]
        and depth[0] <= WALL_THICKNESS
        and depth[1] >= -allowed[1]
        and depth[1] <= WALL_THICKNESS
        and lies.beyond < DOORWAY
    )
    return lies
