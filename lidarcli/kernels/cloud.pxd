"""Bearings of points, as `lidarcli.formalism.points.Cloud` tells them."""

import numpy as np

cdef extern from *:
    """
    #define LIDARCLI_TURN 6.283185307179586476925286766559
    """
    double TURN "LIDARCLI_TURN"

cdef enum:
    MARGIN = 4


cdef struct Sight:
    const long long* cell
    const unsigned char* beyond
    const double* first
    const double* step
    long long points
    long long stride


cdef inline Sight sight_of(cloud):
    """The arrays of a cloud, which has to be kept as long as they are used."""
    cdef const long long[::1] cell = cloud.cell
    cdef const unsigned char[::1] beyond = cloud.beyond.view(np.uint8)
    cdef const double[::1] first = cloud.geometry.first
    cdef const double[::1] step = cloud.geometry.step
    cdef Sight sight
    # An empty array has no first element, of which a build with bounds checked would say so.
    sight.cell = &cell[0] if cell.shape[0] else NULL
    sight.beyond = &beyond[0] if beyond.shape[0] else NULL
    sight.first = &first[0] if first.shape[0] else NULL
    sight.step = &step[0] if step.shape[0] else NULL
    sight.points, sight.stride = len(cloud.grid), cloud.grid.stride
    return sight


cdef inline long long position(const Sight* sight, long long index, long long row) noexcept nogil:
    """Counter-clockwise position of a point of a known row."""
    return sight.cell[index] - (row * sight.stride + MARGIN)


cdef inline double bearing(const Sight* sight, long long index, long long row) noexcept nogil:
    """Bearing of a point of a known row [rad]."""
    cdef double theta = sight.first[row] + sight.step[row] * <double>position(sight, index, row)
    if index >= sight.points:
        theta += TURN * <double>sight.beyond[index - sight.points]
    return theta
