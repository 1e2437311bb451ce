"""The vertices of each object, and the faces between them."""

import numpy as np

from libc.math cimport sqrt

from lidarcli.kernels.cloud cimport Sight, bearing, sight_of

cdef enum:
    START, END, CORNER, EXTREMUM


def traced(runs, faces, corners, extremum, parts):
    cloud = runs.points
    cdef const long long[::1] run = parts.run
    cdef const double[::1] past = parts.past
    cdef const long long[::1] part_offsets = parts.offsets
    cdef const long long[::1] row = runs.row
    cdef const long long[::1] run_first = runs.first
    cdef const double[::1] ranges = cloud.grid.range
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
    cdef Sight sight = sight_of(cloud)
    cdef Py_ssize_t k, p, i, v, f = 0, m = 0, begin, objects = part_offsets.shape[0] - 1
    cdef long long j, at, c
    cdef double px, py, last_x = 0.0, last_y = 0.0
    for p in range(run.shape[0]):
        f += face_offsets[run[p] + 1] - face_offsets[run[p]]
    v = f + run.shape[0]
    face_indices, starts, shift = np.empty(f, np.int64), np.empty(f, np.int64), np.empty(v, np.int64)
    faces_of, vertices_of = np.empty(objects + 1, np.int64), np.empty(objects + 1, np.int64)
    bearings, distances, codes, lengths = np.empty(v), np.empty(v), np.empty(v, np.uint8), np.empty(f)
    sideways, away, place = np.empty(v), np.empty(v), np.empty((2, v))
    cdef long long[::1] face = face_indices
    cdef long long[::1] start = starts
    cdef long long[::1] shifted = shift
    cdef long long[::1] object_faces = faces_of
    cdef long long[::1] object_vertices = vertices_of
    cdef double[::1] theta = bearings
    cdef double[::1] r = distances
    cdef unsigned char[::1] kind = codes
    cdef double[::1] length = lengths
    cdef double[::1] x = place[0]
    cdef double[::1] y = place[1]
    cdef double[::1] across = sideways
    cdef double[::1] along = away
    with nogil:
        v = f = 0
        for k in range(objects):
            object_faces[k] = f
            object_vertices[k] = v
            for p in range(part_offsets[k], part_offsets[k + 1]):
                j = run[p]
                begin = v
                for i in range(face_offsets[j + 1] - face_offsets[j] + 1):
                    at = face_last[face_offsets[j] + i - 1] if i else run_first[j]
                    px = cloud_x[at]
                    py = cloud_y[at]
                    theta[v] = bearing(&sight, at, row[j]) + past[p]
                    r[v] = ranges[sight.cell[at]]
                    kind[v] = EXTREMUM if is_extremum[at] else CORNER
                    x[v] = px
                    y[v] = py
                    if located and corner_offsets[j + 1] > corner_offsets[j]:
                        c = corner_offsets[j] + i
                        x[v] = corner_x[c]
                        y[v] = corner_y[c]
                        if not moved[c]:
                            c = -1
                    else:
                        c = -1
                    if c >= 0:
                        shifted[m] = v
                        across[m] = corner_y[c] * px - corner_x[c] * py
                        along[m] = corner_x[c] * px + corner_y[c] * py
                        px = corner_x[c]
                        py = corner_y[c]
                        r[v] = sqrt(px * px + py * py)
                        m += 1
                    if i:
                        face[f] = face_offsets[j] + i - 1
                        start[f] = v - 1
                        length[f] = sqrt((px - last_x) * (px - last_x) + (py - last_y) * (py - last_y))
                        f += 1
                    last_x = px
                    last_y = py
                    v += 1
                kind[v - 1] = CORNER
                kind[begin] = CORNER
            kind[v - 1] = END
            kind[object_vertices[k]] = START
        object_faces[objects] = f
        object_vertices[objects] = v
    return (
        faces_of,
        face_indices,
        starts,
        lengths,
        vertices_of,
        *place,
        codes,
        distances,
        bearings,
        shift[:m],
        sideways[:m],
        away[:m],
    )
