"""Corners between straight faces."""

import numpy as np

from libc.math cimport INFINITY, fabs, sqrt

from lidarcli.kernels.lines cimport Lines, columns, join, split

cdef enum:
    PASSES = 4


cdef struct Meeting:
    double x
    double y
    bint usable


cdef inline Meeting _meeting(
    const double* middle_x,
    const double* middle_y,
    const double* direction_x,
    const double* direction_y,
    Py_ssize_t one,
    Py_ssize_t other,
    double blunt,
) noexcept nogil:
    cdef double ax = direction_x[one], ay = direction_y[one], bx = direction_x[other], by = direction_y[other]
    cdef double cross = ax * by - ay * bx, dx, dy, along
    cdef Meeting meeting
    meeting.usable = fabs(cross) > blunt
    dx = middle_x[other] - middle_x[one]
    dy = middle_y[other] - middle_y[one]
    along = (dx * by - dy * bx) / (cross if meeting.usable else 1.0)
    meeting.x = middle_x[one] + along * ax
    meeting.y = middle_y[one] + along * ay
    return meeting


cdef inline void _stand(
    const double* x,
    const double* y,
    Py_ssize_t n,
    double tolerance,
    unsigned char* inner,
    Py_ssize_t* at,
    double* share,
) noexcept nogil:
    """Unmark the flat vertices of a run, of which neighbours never go in the same pass."""
    cdef Py_ssize_t i, a, b, c, kept, vertices = 0
    cdef int turn
    cdef double chord_x, chord_y, dx, dy, length
    cdef bint low
    for i in range(n):
        if inner[i] or i == 0 or i == n - 1:
            at[vertices] = i
            vertices += 1
    for turn in range(PASSES):
        share[0] = share[vertices - 1] = INFINITY
        low = False
        for i in range(1, vertices - 1):
            a, b, c = at[i - 1], at[i], at[i + 1]
            chord_x = x[c] - x[a]
            chord_y = y[c] - y[a]
            dx = x[b] - x[a]
            dy = y[b] - y[a]
            length = sqrt(chord_x * chord_x + chord_y * chord_y)
            share[i] = INFINITY
            if length > tolerance:
                share[i] = fabs(dx * chord_y - dy * chord_x) / length / tolerance
                low = low or share[i] <= 1.0
        if not low:
            break
        kept = 1
        low = False
        for i in range(1, vertices):
            if (
                i < vertices - 1
                and share[i] <= 1.0
                and share[i] < share[i - 1]
                and share[i] <= share[i + 1]
            ):
                inner[at[i]] = 0
                low = True
            else:
                at[kept] = at[i]
                kept += 1
        vertices = kept
        if not low:
            break


cdef inline bint _merge(
    const double* x, const double* y, long long first, unsigned char* inner, Lines* lines, Py_ssize_t since, double blunt
) noexcept nogil:
    """Unmark one of two vertices on neighbouring points where the faces beside them meet; whether there were any."""
    cdef Py_ssize_t f
    cdef double start, end
    cdef long long a, b
    cdef bint some = False
    cdef Meeting meeting
    for f in range(since + 1, lines.count - 1):
        if lines.points[f] != 2 or lines.points[f - 1] <= 2 or lines.points[f + 1] <= 2:
            continue
        meeting = _meeting(
            lines.middle_x, lines.middle_y, lines.direction_x, lines.direction_y, f - 1, f + 1, blunt
        )
        a = lines.first[f] - first
        b = lines.last[f] - first
        start = (x[a] - meeting.x) * (x[a] - meeting.x) + (y[a] - meeting.y) * (y[a] - meeting.y)
        end = (x[b] - meeting.x) * (x[b] - meeting.x) + (y[b] - meeting.y) * (y[b] - meeting.y)
        if meeting.usable and (start if start < end else end) < 2.0 * lines.length[f] * (2.0 * lines.length[f]):
            inner[a if start > end else b] = 0
            some = True
    return some


def settled(
    const long long[::1] first,
    const long long[::1] size,
    chosen,
    const double[::1] x,
    const double[::1] y,
    const double[::1] tolerance,
    double blunt,
):
    cdef const unsigned char[::1] wanted = chosen.view(np.uint8)
    cdef Py_ssize_t j, n, since, runs = first.shape[0], room = 1, longest = 1
    cdef const double* from_x
    cdef const double* from_y
    for j in range(runs):
        if wanted[j]:
            room += size[j]
            longest = size[j] if size[j] > longest else longest
    integers, floats, offset = np.empty((4, room), np.int64), np.empty((6, room)), np.empty(runs + 1, np.int64)
    cdef long long[::1] offsets = offset
    cdef unsigned char[::1] marks = np.empty(longest, np.uint8)
    cdef Py_ssize_t[::1] vertices = np.empty(longest, np.intp)
    cdef double[::1] share = np.empty(longest)
    cdef unsigned char* inner = &marks[0]
    cdef Lines lines = columns(integers, floats)
    with nogil:
        for j in range(runs):
            since = offsets[j] = lines.count
            if not wanted[j] or size[j] < 2:
                continue
            n = size[j]
            from_x, from_y = &x[first[j]], &y[first[j]]
            split(from_x, from_y, n, tolerance[j], inner)
            _stand(from_x, from_y, n, tolerance[j], inner, &vertices[0], &share[0])
            join(from_x, from_y, inner, n, j, first[j], n, 1, &lines)
            if _merge(from_x, from_y, first[j], inner, &lines, since, blunt):
                lines.count = since
                join(from_x, from_y, inner, n, j, first[j], n, 1, &lines)
        offsets[runs] = lines.count
    n = lines.count
    return *integers[:, :n], *floats[:, :n], offset


def located(
    const double[::1] cloud_x, const double[::1] cloud_y, faces, const double[::1] tolerance, double blunt
):
    cdef const long long[::1] face_offsets = faces.offsets
    cdef const long long[::1] first = faces.first
    cdef const long long[::1] last = faces.last
    cdef const long long[::1] points = faces.points
    cdef const double[::1] middle_x = faces.middle_x
    cdef const double[::1] middle_y = faces.middle_y
    cdef const double[::1] direction_x = faces.direction_x
    cdef const double[::1] direction_y = faces.direction_y
    cdef const double[::1] length = faces.length
    cdef Py_ssize_t j, f, v = 0, runs = face_offsets.shape[0] - 1
    cdef long long at
    cdef double along, spacing, other, dx, dy
    cdef Meeting meeting
    for j in range(runs):
        if face_offsets[j + 1] > face_offsets[j]:
            v += face_offsets[j + 1] - face_offsets[j] + 1
    offset, moves, xs, ys = np.empty(runs + 1, np.int64), np.zeros(v, bool), np.empty(v), np.empty(v)
    cdef long long[::1] offsets = offset
    cdef unsigned char[::1] moved = moves.view(np.uint8)
    cdef double[::1] x = xs
    cdef double[::1] y = ys
    with nogil:
        v = 0
        for j in range(runs):
            offsets[j] = v
            for f in range(face_offsets[j], face_offsets[j + 1]):
                if f == face_offsets[j]:
                    at = first[f]
                    along = (cloud_x[at] - middle_x[f]) * direction_x[f] + (
                        cloud_y[at] - middle_y[f]
                    ) * direction_y[f]
                    x[v] = middle_x[f] + along * direction_x[f]
                    y[v] = middle_y[f] + along * direction_y[f]
                    v += 1
                at = last[f]
                along = (cloud_x[at] - middle_x[f]) * direction_x[f] + (cloud_y[at] - middle_y[f]) * direction_y[f]
                x[v] = middle_x[f] + along * direction_x[f]
                y[v] = middle_y[f] + along * direction_y[f]
                if f + 1 < face_offsets[j + 1] and points[f] > 2 and points[f + 1] > 2:
                    meeting = _meeting(
                        &middle_x[0], &middle_y[0], &direction_x[0], &direction_y[0], f, f + 1, blunt
                    )
                    spacing = length[f] / <double>points[f]
                    other = length[f + 1] / <double>points[f + 1]
                    spacing = other if other < spacing else spacing
                    dx = meeting.x - x[v]
                    dy = meeting.y - y[v]
                    if meeting.usable and sqrt(dx * dx + dy * dy) <= tolerance[j] + 2.0 * spacing:
                        x[v], y[v], moved[v] = meeting.x, meeting.y, True
                v += 1
        offsets[runs] = v
    return offset, moves, xs, ys
