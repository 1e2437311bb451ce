"""What follows for the columns of a detection from the objects and their outlines."""

import numpy as np

cdef double SPACING_GAIN = 1.0

cdef enum:
    OBJECT = 0
    NOISE = 2
    HIDDEN = 1
    VIEW = 4
    FULL = 0
    START_HIDDEN = 1
    END_HIDDEN = 2
    BOTH_HIDDEN = 3
    CUT = 4


def tallied(members, outlines, faces, const double[::1] step, const double[::1] sweep_d_th, sigma, bint adaptive):
    cdef const long long[::1] row = members.row
    cdef const unsigned char[::1] wall = members.is_wall.view(np.uint8)
    cdef const unsigned char[::1] start_edge = members.start_edge
    cdef const unsigned char[::1] end_edge = members.end_edge
    cdef const double[::1] r = members.r_i
    cdef const double[::1] s = members.s_i
    cdef const long long[::1] offsets = members.offsets
    cdef const double[::1] theta = outlines.theta
    cdef const long long[::1] begin = outlines.begin
    cdef const long long[::1] face = outlines.face
    cdef const long long[::1] face_offsets = outlines.face_offsets
    cdef const long long[::1] vertex_offsets = outlines.offsets
    cdef const double[::1] rms = faces.rms
    cdef Py_ssize_t k, f, objects = row.shape[0], sweeps = sweep_d_th.shape[0], count = begin.shape[0]
    cdef double near
    cdef bint hidden_start, hidden_end
    codes, sizes, thresholds = np.empty((2, objects), np.uint8), np.empty(objects, np.int32), np.empty(objects)
    ends, of_faces, sums = np.empty((2, objects + 1), np.int32), np.empty((3, count)), np.zeros((2, sweeps), np.int32)
    cdef unsigned char[::1] sets = codes[0], visible = codes[1]
    cdef int[::1] beams = sizes, vertex_ends = ends[0], face_ends = ends[1], number = sums[0], covered = sums[1]
    cdef double[::1] d_th = thresholds
    cdef double[::1] theta_i = of_faces[0], theta_f = of_faces[1], scatter = of_faces[2]
    with nogil:
        for k in range(objects):
            beams[k] = <int>(offsets[k + 1] - offsets[k])
            sets[k] = NOISE if wall[k] else OBJECT
            if not wall[k]:
                number[row[k]] += 1
                covered[row[k]] += beams[k]
            hidden_start, hidden_end = start_edge[k] == HIDDEN, end_edge[k] == HIDDEN
            if start_edge[k] == VIEW or end_edge[k] == VIEW:
                visible[k] = CUT
            elif hidden_start and hidden_end:
                visible[k] = BOTH_HIDDEN
            else:
                visible[k] = START_HIDDEN if hidden_start else END_HIDDEN if hidden_end else FULL
            d_th[k] = sweep_d_th[row[k]]
            if adaptive:
                near = r[k] - s[k]
                d_th[k] += SPACING_GAIN * step[row[k]] * (near if near < r[k] else r[k])
        for k in range(objects + 1):
            vertex_ends[k], face_ends[k] = <int>vertex_offsets[k], <int>face_offsets[k]
        for f in range(count):
            theta_i[f], theta_f[f], scatter[f] = theta[begin[f]], theta[begin[f] + 1], rms[face[f]]
    return *codes, sizes, thresholds, *ends, *of_faces, *sums
