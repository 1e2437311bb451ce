"""What is known of each object: its points and its vertices."""

import numpy as np

from libc.math cimport sqrt

from lidarcli.kernels.cloud cimport Sight, bearing
from lidarcli.kernels.sums cimport reduced

cdef enum:
    START, END, CORNER, EXTREMUM


def gathered(
    const long long[::1] first,
    const long long[::1] size,
    const long long[::1] parts,
    const double[::1] x,
    const double[::1] y,
    const long long[::1] cell,
    const double[::1] ranges,
):
    cdef Py_ssize_t k, p, i, n = 0, objects = parts.shape[0] - 1
    cdef long long at
    cdef double r, dx, dy
    for p in range(first.shape[0]):
        n += size[p]
    offset = np.empty(objects + 1, np.int64)
    points = np.empty((2, n))
    where = np.empty((2, objects), np.int64)
    found = np.empty((4, objects))
    cdef long long[::1] offsets = offset
    cdef double[::1] to_x = points[0]
    cdef double[::1] to_y = points[1]
    cdef long long[::1] nearest = where[0]
    cdef long long[::1] part = where[1]
    cdef double[::1] least = found[0]
    cdef double[::1] middle_x = found[1]
    cdef double[::1] middle_y = found[2]
    cdef double[::1] width = found[3]
    with nogil:
        n = 0
        for k in range(objects):
            offsets[k] = n
            nearest[k] = -1
            for p in range(parts[k], parts[k + 1]):
                at = first[p]
                for i in range(size[p]):
                    r = ranges[cell[at]]
                    if nearest[k] < 0 or r < least[k]:
                        least[k], nearest[k], part[k] = r, at, p
                    to_x[n], to_y[n] = x[at], y[at]
                    at += 1
                    n += 1
            i = offsets[k]
            middle_x[k] = reduced(&to_x[i], n - i) / <double>(n - i)
            middle_y[k] = reduced(&to_y[i], n - i) / <double>(n - i)
            dx, dy = to_x[n - 1] - to_x[i], to_y[n - 1] - to_y[i]
            width[k] = sqrt(dx * dx + dy * dy)
        offsets[objects] = n
    return offset, *points, *where, *found


def outlines(
    runs,
    faces,
    corners,
    extremum,
    parts,
):
    cloud = runs.points
    cdef const long long[::1] run = parts.run
    cdef const double[::1] past = parts.past
    cdef const long long[::1] part_offsets = parts.offsets
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] run_first = runs.first
    cdef const long long[::1] cell = cloud.cell
    cdef const double[::1] ranges = cloud.grid.range
    cdef const double[::1] first = cloud.geometry.first
    cdef const double[::1] step = cloud.geometry.step
    cdef const unsigned char[::1] beyond = cloud.beyond.view(np.uint8)
    cdef const unsigned char[::1] is_extremum = extremum.view(np.uint8)
    cdef const double[::1] cloud_x = cloud.x
    cdef const double[::1] cloud_y = cloud.y
    cdef const long long[::1] face_offsets = faces.offsets
    cdef const long long[::1] face_last = faces.last
    cdef bint located = corners is not None
    cdef const long long[::1] corner_offsets = corners.offsets if located else face_offsets
    cdef const unsigned char[::1] moved = (corners.moved if located else extremum).view(np.uint8)
    cdef const double[::1] corner_x = corners.x if located else cloud_x
    cdef const double[::1] corner_y = corners.y if located else cloud_y
    cdef Py_ssize_t k, p, i, v = 0, f = 0, m = 0, objects = part_offsets.shape[0] - 1
    cdef long long j, at, c
    cdef double px, py, last_x = 0.0, last_y = 0.0
    cdef Sight sight
    sight.cell, sight.first, sight.step, sight.beyond = &cell[0], &first[0], &step[0], &beyond[0]
    sight.points, sight.stride = len(cloud.grid), cloud.grid.stride
    for p in range(run.shape[0]):
        f += face_offsets[run[p] + 1] - face_offsets[run[p]]
    v = f + run.shape[0]
    offset = np.empty(run.shape[0] + 1, np.int64)
    bearings, distances, codes, lengths = np.empty(v), np.empty(v), np.empty(v, np.uint8), np.empty(f)
    shift, sideways, away = np.empty(v, np.int64), np.empty(v), np.empty(v)
    cdef long long[::1] offsets = offset
    cdef double[::1] theta = bearings
    cdef double[::1] r = distances
    cdef unsigned char[::1] kind = codes
    cdef double[::1] length = lengths
    cdef long long[::1] shifted = shift
    cdef double[::1] across = sideways
    cdef double[::1] along = away
    with nogil:
        v = f = 0
        for k in range(objects):
            for p in range(part_offsets[k], part_offsets[k + 1]):
                j = run[p]
                offsets[p] = v
                for i in range(face_offsets[j + 1] - face_offsets[j] + 1):
                    at = face_last[face_offsets[j] + i - 1] if i else run_first[j]
                    px, py = cloud_x[at], cloud_y[at]
                    theta[v] = bearing(sight, at, row[j]) + past[p]
                    r[v] = ranges[cell[at]]
                    kind[v] = EXTREMUM if is_extremum[at] else CORNER
                    if located and corner_offsets[j + 1] > corner_offsets[j] and moved[corner_offsets[j] + i]:
                        c = corner_offsets[j] + i
                        shifted[m] = v
                        across[m] = corner_y[c] * px - corner_x[c] * py
                        along[m] = corner_x[c] * px + corner_y[c] * py
                        px, py = corner_x[c], corner_y[c]
                        r[v] = sqrt(px * px + py * py)
                        m += 1
                    if i:
                        length[f] = sqrt((px - last_x) * (px - last_x) + (py - last_y) * (py - last_y))
                        f += 1
                    last_x, last_y = px, py
                    v += 1
                kind[v - 1] = CORNER
                kind[offsets[p]] = CORNER
            kind[v - 1] = END
            kind[offsets[part_offsets[k]]] = START
        offsets[run.shape[0]] = v
    return offset, bearings, distances, codes, lengths, shift[:m], sideways[:m], away[:m]
