"""Bearings of points, as `lidarcli.formalism.points.Cloud` tells them."""

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


cdef inline double bearing(Sight sight, long long index, long long row) noexcept nogil:
    """Bearing of a point of a known row [rad]."""
    cdef double theta = (
        sight.first[row] + sight.step[row] * <double>(sight.cell[index] - (row * sight.stride + MARGIN))
    )
    if index >= sight.points:
        theta += TURN * <double>sight.beyond[index - sight.points]
    return theta
