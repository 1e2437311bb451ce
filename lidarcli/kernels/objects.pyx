"""Which runs are objects."""

import numpy as np

from libc.math cimport fabs

cdef double END_WIDTH = 0.5
cdef double POINTED_WIDTH = 0.8
cdef double HIDDEN_WIDTH = 0.5
cdef double UNKNOWN_WIDTH = 0.4
cdef double SLOPE = np.tan(np.deg2rad(15.0))
cdef double PARTLY_HIDDEN_WIDTH = 0.65
cdef double FEW_WALLS = 0.1
cdef double ENCLOSED = 0.35

cdef enum:
    STRAIGHT = 0
    CONVEX = 1
    CONCAVE = 2
    OWN = 0
    HIDDEN = 1
    OPEN = 2
    UNKNOWN = 3
    VIEW = 4


cdef inline double _share(
    const long long[::1] row,
    const long long[::1] size,
    const long long[::1] start,
    const unsigned char[::1] wall,
    Py_ssize_t begin,
    Py_ssize_t end,
) noexcept nogil:
    """Share of the points of the sweep of some runs that lie on walls."""
    cdef Py_ssize_t j
    cdef long long on_walls = 0, points = start[row[begin] + 1] - start[row[begin]]
    for j in range(begin, end):
        if wall[j]:
            on_walls += size[j]
    return <double>on_walls / <double>(points if points > 1 else 1)


cdef inline Py_ssize_t _row_end(const long long[::1] row, Py_ssize_t begin) noexcept nogil:
    """Where the runs of the row end that run `begin` is one of."""
    cdef Py_ssize_t end = begin
    while end < row.shape[0] and row[end] == row[begin]:
        end += 1
    return end


def by_extent(runs, faces, const double[::1] reach, carved, long long min_beams, double max_width):
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] size = runs.size
    cdef const unsigned char[::1] start_edge = runs.start_edge
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const long long[::1] start = runs.points.start
    cdef const long long[::1] offsets = faces.offsets
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const unsigned char[::1] thing = carved.view(np.uint8)
    cdef Py_ssize_t j, f, begin = 0, end, count = row.shape[0]
    cdef bint doorways, alone
    walls, candidates, partials = (np.empty(count, bool) for _ in range(3))
    bends = np.empty(count, np.int8)
    cdef unsigned char[::1] wall = walls.view(np.uint8), candidate = candidates.view(np.uint8)
    cdef unsigned char[::1] partial = partials.view(np.uint8)
    cdef signed char[::1] bend = bends
    with nogil:
        for j in range(count):
            wall[j] = size[j] >= min_beams and not reach[j] <= max_width and not thing[j]
            partial[j] = start_edge[j] != OWN and start_edge[j] != OPEN or end_edge[j] != OWN and end_edge[j] != OPEN
            bend[j] = CONVEX if offsets[j + 1] - offsets[j] > 1 else STRAIGHT
            for f in range(offsets[j] + 1, offsets[j + 1]):
                if direction_x[f - 1] * direction_y[f] - direction_y[f - 1] * direction_x[f] > 0:
                    bend[j] = CONCAVE
        while begin < count:
            end = _row_end(row, begin)
            doorways = _share(row, size, start, wall, begin, end) > FEW_WALLS
            for j in range(begin, end):
                alone = bend[j] == CONVEX and not doorways or reach[j] <= UNKNOWN_WIDTH and (
                    start_edge[j] == UNKNOWN or end_edge[j] == UNKNOWN
                )
                candidate[j] = size[j] >= min_beams and reach[j] <= max_width and not thing[j] and not alone
            begin = end
    return walls, candidates, partials, bends


def pieces(runs, const double[::1] ends, walls, carved, double max_width):
    cdef const unsigned char[::1] start_edge = runs.start_edge
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const double[::1] s_start = runs.s_start
    cdef const unsigned char[::1] wall = walls.view(np.uint8)
    cdef const unsigned char[::1] thing = carved.view(np.uint8)
    cdef Py_ssize_t j, count = ends.shape[0]
    cdef bint around
    found = np.empty(count, bool)
    cdef unsigned char[::1] piece = found.view(np.uint8)
    with nogil:
        for j in range(count):
            around = start_edge[j] == HIDDEN and end_edge[j] == HIDDEN and s_start[j] != s_start[j]
            piece[j] = ends[j] <= max_width and not wall[j] and not thing[j] and not around
    return found


def chosen(runs, walls, pieces, carved, bodies, const signed char[::1] bend, long long min_beams, double max_width):
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] first = runs.first
    cdef const long long[::1] size = runs.size
    cdef const double[::1] x = runs.points.x
    cdef const double[::1] y = runs.points.y
    cdef const long long[::1] row_start = runs.points.start
    cdef const unsigned char[::1] start_edge = bodies.start_edge
    cdef const unsigned char[::1] end_edge = bodies.end_edge
    cdef const long long[::1] points = bodies.size
    cdef const double[::1] reach = bodies.reach
    cdef const long long[::1] parts = bodies.parts
    cdef const unsigned char[::1] wall = walls.view(np.uint8)
    cdef const unsigned char[::1] piece = pieces.view(np.uint8)
    cdef const unsigned char[::1] thing = carved.view(np.uint8)
    cdef Py_ssize_t j, begin = 0, end, count = row.shape[0]
    cdef bint enclosed
    chosen_ = np.empty(count, bool)
    cdef unsigned char[::1] out = chosen_.view(np.uint8)
    with nogil:
        while begin < count:
            end = _row_end(row, begin)
            enclosed = _share(row, size, row_start, wall, begin, end) > ENCLOSED
            for j in range(begin, end):
                if thing[j] and size[j] >= min_beams:
                    out[j] = 1
                    continue
                out[j] = piece[j] and points[j] >= min_beams and reach[j] <= max_width and _recognisable(
                    start_edge[j], end_edge[j], reach[j], parts[j] == 1, bend[j], enclosed, max_width,
                    x[first[j]], y[first[j]], x[first[j] + size[j] - 1], y[first[j] + size[j] - 1],
                )
            begin = end
    return chosen_


cdef inline bint _recognisable(
    unsigned char start,
    unsigned char end,
    double reach,
    bint whole,
    signed char bend,
    bint enclosed,
    double max_width,
    double x0,
    double y0,
    double x1,
    double y1,
) noexcept nogil:
    """Whether a body shows enough of its outline to be more than a piece of the background."""
    cdef bint own = start == OWN or end == OWN
    cdef bint open_start = start == OPEN or start == UNKNOWN, open_end = end == OPEN or end == UNKNOWN
    cdef bint straight = bend == STRAIGHT and whole, wide = straight and reach > HIDDEN_WIDTH
    cdef bint seen = (start == OWN or start == OPEN) and (end == OWN or end == OPEN)
    cdef bint slight = reach < END_WIDTH and (open_start or open_end) and start != VIEW and end != VIEW
    cdef bint free = open_start and open_end or slight
    if not (own or free or bend == CONVEX and reach < POINTED_WIDTH or not enclosed):
        return False
    if start == HIDDEN and end == HIDDEN and whole and (wide or bend == CONCAVE):
        return False
    if wide and enclosed and _grazing(x0, y0, x1, y1):
        return False
    return not (
        (straight and not seen or enclosed and (open_start or open_end)) and reach > PARTLY_HIDDEN_WIDTH * max_width
    )


cdef inline bint _grazing(double x0, double y0, double x1, double y1) noexcept nogil:
    """Whether a chord points at the sensor."""
    cdef double dx = x1 - x0, dy = y1 - y0, mx = x1 + x0, my = y1 + y0
    return fabs(dx * my - dy * mx) < SLOPE * fabs(dx * mx + dy * my)
