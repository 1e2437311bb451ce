"""Things that touch a wall."""

import numpy as np

from libc.math cimport fabs, sqrt

from lidarcli.kernels.sums cimport reduced

cdef double TURN = np.sin(np.deg2rad(25.0))
cdef double BACKING = 0.4
cdef double RELIEF = 0.1
cdef double WIDEST = 1.5
cdef double BEHIND = 0.1
cdef double PLANE = 0.03

cdef enum:
    TRIM = 6
    OWN = 0


# The line of a wall, and the side of it that the sensor is on.
cdef struct Wall:
    double middle_x
    double middle_y
    double direction_x
    double direction_y
    double side


cdef inline double _depth(Wall wall, double x, double y) noexcept nogil:
    """How far a point stands before a wall."""
    return ((x - wall.middle_x) * wall.direction_y - (y - wall.middle_y) * wall.direction_x) * wall.side


cdef inline double _most(double a, double b) noexcept nogil:
    return a if a > b else b


def stretches(runs, faces, worth, const double[::1] sigma):
    cloud = runs.points
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] run_first = runs.first
    cdef const long long[::1] run_size = runs.size
    cdef const unsigned char[::1] start_edge = runs.start_edge
    cdef const unsigned char[::1] end_edge = runs.end_edge
    cdef const double[::1] x = cloud.x
    cdef const double[::1] y = cloud.y
    cdef const long long[::1] period = cloud.geometry.period
    cdef const long long[::1] offsets = faces.offsets
    cdef const long long[::1] face_first = faces.first
    cdef const long long[::1] face_last = faces.last
    cdef const double[::1] length = faces.length
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const double[::1] middle_x = faces.middle_x
    cdef const double[::1] middle_y = faces.middle_y
    cdef const unsigned char[::1] enough = worth.view(np.uint8)
    cdef Py_ssize_t j, f, begin, end, low, high, found = 0, runs_ = row.shape[0], count = length.shape[0]
    cdef bint inner_start, inner_end, pointed
    cdef long long before = 0, after = 0, first, last, at
    cdef double least, level
    cdef double far[2]
    cdef double ahead[2]
    cdef Wall wall[2]
    of_run, firsts, lasts = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    cdef long long[::1] out_run = of_run, out_first = firsts, out_last = lasts
    # Sine of the angle by which each face turns left from the one before.
    cdef double[::1] turn = np.empty(count)
    with nogil:
        for j in range(runs_):
            low, high = offsets[j], offsets[j + 1]
            if not enough[j] or high - low < 2:
                continue
            for f in range(low + 1, high):
                turn[f] = direction_x[f - 1] * direction_y[f] - direction_y[f - 1] * direction_x[f]
            end = low
            while end < high:
                begin = end
                end = begin + 1
                pointed = False
                while end < high and not turn[end] > TURN:
                    pointed = pointed or turn[end] < -TURN
                    end += 1
                inner_start, inner_end = begin > low, end < high
                if not (inner_start or inner_end) or not (pointed or not inner_start or not inner_end):
                    continue
                # Of two straight faces without another corner the longer one is the wall.
                least = _most(BACKING, 0.0 if pointed else reduced(&length[begin], end - begin))
                if inner_start:
                    # The longest of the faces without a corner between that end here.
                    before = f = begin - 1
                    while f > low and not fabs(turn[f]) > TURN:
                        f -= 1
                        if length[f] >= length[before]:
                            before = f
                    if not length[before] >= least:
                        continue
                    wall[0] = _wall(
                        middle_x[before], middle_y[before], direction_x[before], direction_y[before]
                    )
                elif start_edge[j] != OWN:
                    continue
                if inner_end:
                    after = f = end
                    while f + 1 < high and not fabs(turn[f + 1]) > TURN:
                        f += 1
                        if length[f] > length[after]:
                            after = f
                    if not length[after] >= least:
                        continue
                    wall[1] = _wall(middle_x[after], middle_y[after], direction_x[after], direction_y[after])
                elif end_edge[j] != OWN:
                    continue
                first, last = face_first[begin], face_last[end - 1]
                level = sigma[row[j]]
                # How far it reaches from its ends, and how far it stands out from the walls beside it.
                far[0] = far[1] = ahead[0] = ahead[1] = 0.0
                for f in range(begin - 1, end):
                    at = face_last[f] if f >= begin else first
                    far[0] = _most(
                        far[0], (x[at] - x[first]) * (x[at] - x[first]) + (y[at] - y[first]) * (y[at] - y[first])
                    )
                    far[1] = _most(
                        far[1], (x[at] - x[last]) * (x[at] - x[last]) + (y[at] - y[last]) * (y[at] - y[last])
                    )
                    if inner_start and (f < begin or _depth(wall[0], x[at], y[at]) > ahead[0]):
                        ahead[0] = _depth(wall[0], x[at], y[at])
                    if inner_end and (f < begin or _depth(wall[1], x[at], y[at]) > ahead[1]):
                        ahead[1] = _depth(wall[1], x[at], y[at])
                if not (sqrt(far[0]) <= WIDEST and sqrt(far[1]) <= WIDEST):
                    continue
                if inner_start and not ahead[0] > RELIEF + 2.0 * level:
                    continue
                if inner_end and not ahead[1] > RELIEF + 2.0 * level:
                    continue
                # At a free end the wall goes on, or is seen through a doorway.
                if not inner_end:
                    at = run_first[_neighbour(row, period, j, 1)]
                    if not _depth(wall[0], x[at], y[at]) >= -(BEHIND + 2.0 * level):
                        continue
                if not inner_start:
                    f = _neighbour(row, period, j, -1)
                    at = run_first[f] + run_size[f] - 1
                    if not _depth(wall[1], x[at], y[at]) >= -(BEHIND + 2.0 * level):
                        continue
                if inner_start:
                    for f in range(TRIM):
                        if first >= last or not _depth(wall[0], x[first], y[first]) <= PLANE + 2.0 * level:
                            break
                        first += 1
                if inner_end:
                    for f in range(TRIM):
                        if first >= last or not _depth(wall[1], x[last], y[last]) <= PLANE + 2.0 * level:
                            break
                        last -= 1
                if last > first:
                    out_run[found], out_first[found], out_last[found] = j, first, last
                    found += 1
    return of_run[:found].copy(), firsts[:found].copy(), lasts[:found].copy()


cdef inline Wall _wall(double middle_x, double middle_y, double direction_x, double direction_y) noexcept nogil:
    cdef Wall wall
    wall.middle_x, wall.middle_y, wall.direction_x, wall.direction_y = middle_x, middle_y, direction_x, direction_y
    wall.side = 1.0 if middle_y * direction_x - middle_x * direction_y > 0 else -1.0
    return wall


cdef inline Py_ssize_t _neighbour(
    const long long[::1] row, const long long[::1] period, Py_ssize_t j, int way
) noexcept nogil:
    """The next run of the row, way = 1, or the one before, way = -1; over the seam of a full turn; else itself."""
    cdef Py_ssize_t other = j + way
    if 0 <= other < row.shape[0] and row[other] == row[j]:
        return other
    if period[row[j]] <= 0:
        return j
    other = j
    while 0 <= other - way < row.shape[0] and row[other - way] == row[j]:
        other -= way
    return other
