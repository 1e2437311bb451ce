"""Bodies: place, velocity, extent and direction of what is followed, and how a view measures them.

A body is a rectangle with the half extents h along two axes, or a disc. Along each axis a filter estimates its centre c,
velocity v and half extent h, because a side of the body measures only c + h or c - h. Beside it stands a *twin*: the
estimate for a body that stands still. Motion has to be shown against the twin.

A view measures the sides of a body along its axes. A side that faces the sensor is where its face is, and a side that ends
in view is where its edge is. Of any other side the last point seen is only a lower bound. So there is no reference point
that could jump from corner to corner.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli import native
from lidarcli.formalism import detection
from lidarcli.formalism.tracking import measurement, results
from lidarcli.formalism.tracking.measurement import Measurements

EMPTY, LIVE, ENDED = results.EMPTY, results.LIVE, results.ENDED
DISC, BOX, PERSON = results.DISC, results.BOX, results.PERSON
MOST_LEGS = results.MOST_LEGS
ROUND, LEGGED = detection.ROUND, detection.LEGGED
QUARTER_TURN = 0.5 * math.pi
ACCELERATION = 0.6
"""[m²/s³] Spectral density of a body's acceleration."""
EXTENT_GROWTH = 1e-5
"""[m²/s] Growth of the variance of a half extent, as of a plant in the wind."""
STANDING_GROWTH = 1e-7
"""[m²/s] Growth of the variance of a standing body's place, for errors of the poses."""
SPEED_SD = 0.7
"""[m/s] Standard deviation of the velocity of a new body."""
ANGULAR_ACCELERATION = 0.02
"""[rad²/s³] Spectral density of a body's angular acceleration."""
MOST_TURN = math.radians(15.0)
"""[rad] Greatest turn of a body from one sweep to the next."""
FASTEST_TURN = 2.0
"""[rad/s] Greatest turn rate of a body."""
TURN_RATE_SD = 0.15
"""[rad/s] Standard deviation of the turn rate of a new body."""
UNSEEN_VAR = 0.0025
"""[m²] Variance that is added to the place of a standing body while it is not seen: (5 cm)²."""
MOST_RESIDUAL = 16.0
"""Greatest squared residual, as a multiple of its variance. A larger one counts as this."""
LEAST_VAR = 1e-8
"""[m²] Least variance, against rounding."""
NEW_EXTENT = 0.15
"""[m] Length that a new body may go on beyond an end that was not seen."""
AT_LEAST = -1.0
"""Mark in place of a variance: the side goes on at least so far."""
COS_ALONG = math.cos(math.radians(20.0))
"""Cosine of the greatest angle between the normal of a face and that of the side it belongs to."""
SIN_BEHIND = math.sin(math.radians(10.0))
"""Sine of an angle: a side that looks away from the sensor by more may go on behind the last point."""
END_MARGIN = 0.03
"""[m] An end of the points that is this close to the outermost point ends the side."""
SURFACE_VAR = 1.6e-5
"""[m²] Least variance of a side, for the roughness of surfaces and the error of scanners: (4 mm)²."""
CROOKED_SHARE = 0.25
"""Share of the mean squared distance of points from their face that adds to the variance of its place."""
RAGGED_SHARE = 0.12
"""Standard deviation of the middle of an object without faces, as a share of its size."""
OPEN_EDGE_VAR = 0.01
"""[m²] Variance of an edge beside beams that come and go: (10 cm)²."""
LEGGED_VAR = 0.0081
"""[m²] Variance of the middle of a group of legs: (9 cm)²."""
LOG_INTEGERS = ("number", "sweep", "object", "centred", "whole")
LOG_NUMBERS = ("time", "x", "y", "cos", "sin", "half_1", "half_2", "chord")
LOG_SIDES = ("z", "var")


class Targets:
    """Arrays of `most` slots, one for each body. Values along axis i of body b stand at 2 b + i."""

    def __init__(self, capacity: int) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        """All arrays, by name."""
        self.capacity = capacity
        self.slots_used = 0
        """Slot from which on all slots are empty."""
        self.last_number = 0
        """Number of bodies so far; a new body gets the next number."""
        self.state = native.at_longs(_new(self.arrays, "state", capacity, np.int64))
        self.number = native.at_longs(_new(self.arrays, "number", capacity, np.int64))
        self.kind = native.at_longs(_new(self.arrays, "kind", capacity, np.int64))
        self.sightings = native.at_longs(_new(self.arrays, "sightings", capacity, np.int64))
        """Number of sweeps that saw it."""
        self.kind_hits = native.at_longs(_new(self.arrays, "kind_hits", capacity, np.int64))
        """Number of sightings since its kind was chosen; of a person, its legs in this sweep."""
        self.boxy = native.at_longs(_new(self.arrays, "boxy", capacity, np.int64))
        """Number of sightings as a box with enough beams while it is a disc; of a person, sightings of one leg."""
        self.whole = native.at_longs(_new(self.arrays, "whole", capacity, np.int64))
        """Number of sightings with both edges its own; of a person, with two legs."""
        self.moved = native.at_longs(_new(self.arrays, "moved", capacity, np.int64))
        self.inside = native.at_longs(_new(self.arrays, "inside", capacity, np.int64))
        """Number of sweeps unseen inside an older body that was seen, less those in which it was seen."""
        self.same_as = native.at_longs(_new(self.arrays, "same_as", capacity, np.int64))
        """Number of the older body, or of the person of a leg; 0 for none."""
        self.member = native.at_longs(_new(self.arrays, "member", capacity, np.int64))
        """Number of the person that it is a leg of, 0 for none."""
        self.measurement = native.at_longs(_new(self.arrays, "measurement", capacity, np.int64))
        """View in this sweep, -1 for none."""
        self.first_sweep = native.at_longs(_new(self.arrays, "first_sweep", capacity, np.int64))
        self.last_sweep = native.at_longs(_new(self.arrays, "last_sweep", capacity, np.int64))
        self.onset = native.at_longs(_new(self.arrays, "onset", capacity, np.int64))
        """Last sweep without evidence of motion."""
        self.end = native.at_longs(_new(self.arrays, "end", capacity, np.int64))
        """Reason for its end, an index into `results.ENDS`."""
        self.size = native.at_doubles(_new(self.arrays, "size", capacity, np.float64))
        """Mean diagonal of its box, by views with both edges its own [m]."""
        self.existence = native.at_doubles(_new(self.arrays, "existence", capacity, np.float64))
        self.last_time = native.at_doubles(_new(self.arrays, "last_time", capacity, np.float64))
        """Time of the last sighting [s]."""
        self.first_time = native.at_doubles(_new(self.arrays, "first_time", capacity, np.float64))
        self.evidence = native.at_doubles(_new(self.arrays, "evidence", capacity, np.float64))
        """Evidence of motion, log-odds (a CUSUM)."""
        self.max_evidence = native.at_doubles(_new(self.arrays, "max_evidence", capacity, np.float64))
        self.yaw = native.at_doubles(_new(self.arrays, "yaw", capacity, np.float64))
        self.yaw_rate = native.at_doubles(_new(self.arrays, "yaw_rate", capacity, np.float64))
        self.yaw_var = native.at_doubles(_new(self.arrays, "yaw_var", capacity, np.float64))
        self.yaw_cov = native.at_doubles(_new(self.arrays, "yaw_cov", capacity, np.float64))
        self.rate_var = native.at_doubles(_new(self.arrays, "rate_var", capacity, np.float64))
        self.cos = native.at_doubles(_new(self.arrays, "cos", capacity, np.float64))
        self.sin = native.at_doubles(_new(self.arrays, "sin", capacity, np.float64))
        self.middle_x = native.at_doubles(_new(self.arrays, "middle_x", capacity, np.float64))
        self.middle_y = native.at_doubles(_new(self.arrays, "middle_y", capacity, np.float64))
        """Centroid of the points at the last sighting [m]."""
        self.from_x = native.at_doubles(_new(self.arrays, "from_x", capacity, np.float64))
        self.from_y = native.at_doubles(_new(self.arrays, "from_y", capacity, np.float64))
        """Centre at the last sighting [m]."""
        self.birth_x = native.at_doubles(_new(self.arrays, "birth_x", capacity, np.float64))
        self.birth_y = native.at_doubles(_new(self.arrays, "birth_y", capacity, np.float64))
        """Centre in the last sweep without evidence of motion [m]."""
        self.c = native.at_doubles(_new(self.arrays, "c", 2 * capacity, np.float64))
        self.v = native.at_doubles(_new(self.arrays, "v", 2 * capacity, np.float64))
        self.h = native.at_doubles(_new(self.arrays, "h", 2 * capacity, np.float64))
        self.cc = native.at_doubles(_new(self.arrays, "cc", 2 * capacity, np.float64))
        self.cv = native.at_doubles(_new(self.arrays, "cv", 2 * capacity, np.float64))
        self.ch = native.at_doubles(_new(self.arrays, "ch", 2 * capacity, np.float64))
        self.vv = native.at_doubles(_new(self.arrays, "vv", 2 * capacity, np.float64))
        self.vh = native.at_doubles(_new(self.arrays, "vh", 2 * capacity, np.float64))
        self.hh = native.at_doubles(_new(self.arrays, "hh", 2 * capacity, np.float64))
        """Centre, velocity and half extent along each axis, and their covariance."""
        self.static_c = native.at_doubles(_new(self.arrays, "static_c", 2 * capacity, np.float64))
        self.static_h = native.at_doubles(_new(self.arrays, "static_h", 2 * capacity, np.float64))
        self.static_cc = native.at_doubles(_new(self.arrays, "static_cc", 2 * capacity, np.float64))
        self.static_ch = native.at_doubles(_new(self.arrays, "static_ch", 2 * capacity, np.float64))
        self.static_hh = native.at_doubles(_new(self.arrays, "static_hh", 2 * capacity, np.float64))
        """Centre and half extent of the twin along each axis, and their covariance."""
        self.jacobian = native.at_doubles(_new(self.arrays, "jacobian", 6 * capacity, np.float64))
        """Effect of the error of the poses on the place of the twin, three numbers for each axis (`PoseErrorFilter`)."""
        self.side = native.at_doubles(_new(self.arrays, "side", 2 * capacity, np.float64))
        self.side_weight = native.at_doubles(_new(self.arrays, "side_weight", 2 * capacity, np.float64))
        """Mean extent by sightings of both ends, and their weight [m, 1/m²]."""
        self.least = native.at_doubles(_new(self.arrays, "least", 2 * capacity, np.float64))
        """Least length along each axis [m]."""
        self.bulge = native.at_doubles(_new(self.arrays, "bulge", capacity, np.float64))
        """Sum of the squared distances of points from their faces, in variances of the noise."""
        self.bulge_points = native.at_doubles(_new(self.arrays, "bulge_points", capacity, np.float64))
        """Expected value of that sum for straight faces."""
        self.leg_x = native.at_doubles(_new(self.arrays, "leg_x", MOST_LEGS * capacity, np.float64))
        self.leg_y = native.at_doubles(_new(self.arrays, "leg_y", MOST_LEGS * capacity, np.float64))
        """Mean places of legs beside it that are too slim to be objects [m]."""
        self.leg_hits = native.at_longs(_new(self.arrays, "leg_hits", MOST_LEGS * capacity, np.int64))
        """Number of sightings of each of these legs."""
        self.shape_votes = native.at_doubles(_new(self.arrays, "shape_votes", 5 * capacity, np.float64))
        """Votes of its views, by shape."""

    def grow(self, old: Targets) -> None:
        """Copy the bodies of `old`, which has less room."""
        self.slots_used, self.last_number = old.slots_used, old.last_number
        for name, values in old.arrays.items():
            self.arrays[name][: len(values)] = values


def _new(arrays: dict[str, NDArray[Any]], name: str, count: int, kind: Any) -> NDArray[Any]:
    """Add an array of zeros by its name, and return it."""
    arrays[name] = np.zeros(count, kind)
    return arrays[name]


def allocate(targets: Targets) -> int:
    """Return the first empty slot; there is one."""
    b = 0
    while targets.state[b] != EMPTY:
        b += 1
    targets.slots_used = max(targets.slots_used, b + 1)
    return b


def reset(targets: Targets, b: int) -> None:
    """Begin a new body in a slot."""
    targets.last_number += 1
    targets.number[b] = targets.last_number
    targets.state[b] = LIVE
    targets.sightings[b] = targets.kind_hits[b] = targets.boxy[b] = targets.whole[b] = 0
    targets.moved[b] = targets.inside[b] = targets.same_as[b] = targets.member[b] = 0
    targets.size[b] = 0.0
    targets.evidence[b] = targets.max_evidence[b] = 0.0
    targets.yaw[b] = targets.yaw_rate[b] = targets.sin[b] = 0.0
    targets.yaw_var[b] = targets.yaw_cov[b] = targets.rate_var[b] = 0.0
    targets.cos[b] = 1.0
    targets.bulge[b] = targets.bulge_points[b] = 0.0
    for a in range(2 * b, 2 * b + 2):
        targets.side[a] = targets.side_weight[a] = targets.least[a] = 0.0
    for i in range(6 * b, 6 * b + 6):
        targets.jacobian[i] = 0.0
    for i in range(5 * b, 5 * b + 5):
        targets.shape_votes[i] = 0.0
    for i in range(MOST_LEGS * b, MOST_LEGS * b + MOST_LEGS):
        targets.leg_x[i] = targets.leg_y[i] = 0.0
        targets.leg_hits[i] = 0


def centre(targets: Targets, b: int) -> tuple[float, float]:
    """Return the centre of a body in the world [m]."""
    return to_world(targets, b, targets.c[2 * b], targets.c[2 * b + 1])


def to_world(targets: Targets, b: int, along: float, across: float) -> tuple[float, float]:
    """Return a vector in the axes of a body as one in the world."""
    return targets.cos[b] * along - targets.sin[b] * across, targets.sin[b] * along + targets.cos[b] * across


def to_axes(targets: Targets, b: int, x: float, y: float) -> tuple[float, float]:
    """Return a vector in the world as one in the axes of a body."""
    return targets.cos[b] * x + targets.sin[b] * y, targets.cos[b] * y - targets.sin[b] * x


def half_extent(targets: Targets, b: int, x: float, y: float) -> float:
    """Return the half extent of a body in a direction of the world, given as a unit vector [m]."""
    if targets.kind[b] != BOX:
        return 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
    along, across = to_axes(targets, b, x, y)
    return abs(along) * targets.h[2 * b] + abs(across) * targets.h[2 * b + 1]


def outside(targets: Targets, b: int, x: float, y: float) -> float:
    """Return the distance of a point from a body [m], negative inside."""
    centre_x, centre_y = centre(targets, b)
    dx, dy = x - centre_x, y - centre_y
    if targets.kind[b] != BOX:
        return math.sqrt(dx * dx + dy * dy) - 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
    along, across = to_axes(targets, b, dx, dy)
    return max(abs(along) - targets.h[2 * b], abs(across) - targets.h[2 * b + 1])


def turn(targets: Targets, b: int, angle: float) -> None:
    """Turn the axes of a body; its estimates in the world stay the same."""
    cos, sin = math.cos(angle), math.sin(angle)
    one, other = 2 * b, 2 * b + 1
    targets.c[one], targets.c[other] = (
        cos * targets.c[one] + sin * targets.c[other],
        cos * targets.c[other] - sin * targets.c[one],
    )
    targets.v[one], targets.v[other] = (
        cos * targets.v[one] + sin * targets.v[other],
        cos * targets.v[other] - sin * targets.v[one],
    )
    targets.static_c[one], targets.static_c[other] = (
        cos * targets.static_c[one] + sin * targets.static_c[other],
        cos * targets.static_c[other] - sin * targets.static_c[one],
    )
    for i in range(3 * one, 3 * one + 3):
        targets.jacobian[i], targets.jacobian[i + 3] = (
            cos * targets.jacobian[i] + sin * targets.jacobian[i + 3],
            cos * targets.jacobian[i + 3] - sin * targets.jacobian[i],
        )
    # The covariance between the axes is left out; turns from sweep to sweep are small.
    keep, give = cos * cos, sin * sin
    _mix(targets.cc, one, keep, give)
    _mix(targets.cv, one, keep, give)
    _mix(targets.vv, one, keep, give)
    _mix(targets.static_cc, one, keep, give)
    for a in range(one, one + 2):
        targets.ch[a] *= cos
        targets.vh[a] *= cos
        targets.static_ch[a] *= cos
    targets.yaw[b] += angle
    targets.cos[b], targets.sin[b] = math.cos(targets.yaw[b]), math.sin(targets.yaw[b])


def _mix(values: Any, at: int, keep: float, give: float) -> None:
    """Mix the values of both axes."""
    first, second = values[at], values[at + 1]
    values[at], values[at + 1] = keep * first + give * second, keep * second + give * first


def predict(targets: Targets, b: int, dt: float, drift_var: float) -> None:
    """Predict a body after a time dt [s]. `creep`: variance that is added to standing bodies as poses drift [m²]."""
    if targets.kind[b] == BOX:
        targets.yaw_var[b] += (
            dt * (2.0 * targets.yaw_cov[b] + dt * targets.rate_var[b]) + ANGULAR_ACCELERATION * dt * dt * dt / 3.0
        )
        targets.yaw_cov[b] += dt * targets.rate_var[b] + 0.5 * ANGULAR_ACCELERATION * dt * dt
        targets.rate_var[b] += ANGULAR_ACCELERATION * dt
        if targets.yaw_rate[b] != 0.0:
            turn(targets, b, targets.yaw_rate[b] * dt)
    for a in range(2 * b, 2 * b + 2):
        targets.c[a] += dt * targets.v[a]
        targets.cc[a] += dt * (2.0 * targets.cv[a] + dt * targets.vv[a]) + ACCELERATION * dt * dt * dt / 3.0
        targets.cv[a] += dt * targets.vv[a] + 0.5 * ACCELERATION * dt * dt
        targets.ch[a] += dt * targets.vh[a]
        targets.vv[a] += ACCELERATION * dt
        targets.hh[a] += EXTENT_GROWTH * dt
        targets.static_cc[a] += STANDING_GROWTH * dt + drift_var
        targets.static_hh[a] += EXTENT_GROWTH * dt


def hold_still(targets: Targets, b: int) -> None:
    """Stop a body that is not seen and was never shown to move; it may begin to move at any time."""
    for a in range(2 * b, 2 * b + 2):
        targets.c[a], targets.h[a] = targets.static_c[a], targets.static_h[a]
        targets.cc[a] = targets.static_cc[a] + UNSEEN_VAR
        targets.ch[a], targets.hh[a] = targets.static_ch[a], targets.static_hh[a]
        targets.v[a] = targets.cv[a] = targets.vh[a] = 0.0
        targets.vv[a] = SPEED_SD * SPEED_SD
    targets.yaw_rate[b] = 0.0


def residual(targets: Targets, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """Return the residual of a measurement of c + sign h [m], and its variance [m²]."""
    return (
        z - targets.c[a] - sign * targets.h[a],
        max(targets.cc[a] + sign * (2.0 * targets.ch[a] + sign * targets.hh[a]), 0.0) + var,
    )


def static_residual(targets: Targets, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """Return the residual of a measurement of c + sign h for the twin [m], and its variance [m²]."""
    return (
        z - targets.static_c[a] - sign * targets.static_h[a],
        max(targets.static_cc[a] + sign * (2.0 * targets.static_ch[a] + sign * targets.static_hh[a]), 0.0) + var,
    )


def update(targets: Targets, a: int, z: float, sign: float, var: float) -> None:
    """Update an axis with a measurement of c + sign h; sign is 0 for the centre itself."""
    off, s = residual(targets, a, z, sign, var)
    if off * off > MOST_RESIDUAL * s:
        s = off * off / MOST_RESIDUAL
    p, q, w = (
        targets.cc[a] + sign * targets.ch[a],
        targets.cv[a] + sign * targets.vh[a],
        targets.ch[a] + sign * targets.hh[a],
    )
    gain_c, gain_v, gain_h = p / s, q / s, w / s
    targets.c[a] += gain_c * off
    targets.v[a] += gain_v * off
    targets.h[a] = max(targets.h[a] + gain_h * off, 0.01)
    targets.cc[a] = max(targets.cc[a] - gain_c * p, LEAST_VAR)
    targets.cv[a] -= gain_c * q
    targets.ch[a] -= gain_c * w
    targets.vv[a] = max(targets.vv[a] - gain_v * q, LEAST_VAR)
    targets.vh[a] -= gain_v * w
    targets.hh[a] = max(targets.hh[a] - gain_h * w, LEAST_VAR)


def update_static(targets: Targets, a: int, z: float, sign: float, var: float) -> float:
    """Update the twin with a measurement of c + sign h; return the gain of its centre."""
    off, s = static_residual(targets, a, z, sign, var)
    if off * off > MOST_RESIDUAL * s:
        s = off * off / MOST_RESIDUAL
    p, w = targets.static_cc[a] + sign * targets.static_ch[a], targets.static_ch[a] + sign * targets.static_hh[a]
    gain_c, gain_h = p / s, w / s
    targets.static_c[a] += gain_c * off
    targets.static_h[a] = max(targets.static_h[a] + gain_h * off, 0.01)
    targets.static_cc[a] = max(targets.static_cc[a] - gain_c * p, LEAST_VAR)
    targets.static_ch[a] -= gain_c * w
    targets.static_hh[a] = max(targets.static_hh[a] - gain_h * w, LEAST_VAR)
    return gain_c


def update_extent(targets: Targets, a: int, half: float, var: float) -> None:
    """Update an axis with a measurement of its half extent."""
    gain = targets.hh[a] / (targets.hh[a] + var)
    off = half - targets.h[a]
    targets.h[a] = max(targets.h[a] + gain * off, 0.01)
    targets.hh[a] *= 1.0 - gain
    targets.static_h[a], targets.static_hh[a] = targets.h[a], targets.hh[a]


def update_yaw(targets: Targets, b: int, yaw: float, var: float) -> None:
    """Update the direction of a body with that of a face, which is known up to quarter turns."""
    off = yaw - targets.yaw[b]
    off -= QUARTER_TURN * math.floor(off / QUARTER_TURN + 0.5)
    s = targets.yaw_var[b] + var
    if abs(off) > MOST_TURN:
        # More likely another face than such a turn.
        s += off * off
    gain, gain_rate = targets.yaw_var[b] / s, targets.yaw_cov[b] / s
    turn(targets, b, gain * off)
    targets.yaw_rate[b] = min(max(targets.yaw_rate[b] + gain_rate * off, -FASTEST_TURN), FASTEST_TURN)
    targets.rate_var[b] -= gain_rate * targets.yaw_cov[b]
    targets.yaw_cov[b] *= 1.0 - gain
    targets.yaw_var[b] *= 1.0 - gain


def initiate_axis(targets: Targets, a: int, low: float, high: float, low_var: float, high_var: float) -> None:
    """Begin an axis with its two sides [m]; a negative variance means that the side goes on at least so far."""
    half = 0.5 * (high - low)
    targets.v[a] = 0.0
    targets.cv[a] = targets.vh[a] = 0.0
    targets.vv[a] = SPEED_SD * SPEED_SD
    if low_var >= 0.0 and high_var >= 0.0:
        targets.c[a], targets.h[a] = 0.5 * (low + high), max(half, 0.01)
        targets.cc[a] = targets.hh[a] = 0.25 * (low_var + high_var)
        targets.ch[a] = 0.25 * (high_var - low_var)
    elif high_var >= 0.0:
        targets.h[a] = max(half, 0.05) + 0.5 * NEW_EXTENT
        targets.c[a] = high - targets.h[a]
        targets.hh[a] = NEW_EXTENT * NEW_EXTENT
        targets.cc[a], targets.ch[a] = targets.hh[a] + high_var, -targets.hh[a]
    elif low_var >= 0.0:
        targets.h[a] = max(half, 0.05) + 0.5 * NEW_EXTENT
        targets.c[a] = low + targets.h[a]
        targets.hh[a] = NEW_EXTENT * NEW_EXTENT
        targets.cc[a], targets.ch[a] = targets.hh[a] + low_var, targets.hh[a]
    else:
        targets.c[a], targets.h[a] = 0.5 * (low + high), max(half, 0.05) + 0.5 * NEW_EXTENT
        targets.hh[a] = targets.cc[a] = NEW_EXTENT * NEW_EXTENT
        targets.ch[a] = 0.0
    reset_static(targets, a)


def reset_static(targets: Targets, a: int) -> None:
    """Reset the twin to the estimate of the body."""
    targets.static_c[a], targets.static_h[a] = targets.c[a], targets.h[a]
    targets.static_cc[a], targets.static_ch[a], targets.static_hh[a] = targets.cc[a], targets.ch[a], targets.hh[a]


class EdgeMeasurement:
    """Measurement of a body by one view: of sides 0 to 3 (axis 0 low and high, axis 1 low and high) or of its centre."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.z = native.doubles(self.owner, 4)
        """Place of each side along its axis [m]."""
        self.var = native.doubles(self.owner, 4)
        """Variance of that place [m²], or `AT_LEAST`."""
        self.by_centre = False
        """True if z[0] and z[2] are the centre of a disc; then `half` is its radius with the variance `half_var`."""
        self.lasting_var = 0.0
        """Variance of the centre that more sightings do not reduce, as they see the same ragged outline [m²]."""
        self.is_doubtful = False
        """True if the centre is that of returns which come and go."""
        self.half = 0.0
        self.half_var = 0.0


def measure(sides: EdgeMeasurement, measurements: Measurements, k: int, targets: Targets, b: int, pose_var: float) -> None:
    """Measure a body by view k.

    Parameters
    ----------
    pose_var : variance of a point there from the error of the pose [m²]
    """
    if targets.kind[b] == DISC:
        radius = 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
        var = 0.5 * (targets.hh[2 * b] + targets.hh[2 * b + 1])
        measure_disc(sides, measurements, k, radius, var, pose_var)
    else:
        measure_box(sides, measurements, k, targets.cos[b], targets.sin[b], pose_var)


def measure_box(
    sides: EdgeMeasurement, measurements: Measurements, k: int, cos: float, sin: float, pose_var: float
) -> None:
    """Measure the sides of a rectangle whose first axis has the direction cos, sin."""
    sides.by_centre = False
    measurement.place_sensor(measurements, measurements.share[k])
    first, last = measurements.begin[k], measurements.begin[k + 1] - 1
    for side in range(4):
        sides.var[side] = AT_LEAST
    for p in range(first, last + 1):
        along = cos * measurements.point_x[p] + sin * measurements.point_y[p]
        across = cos * measurements.point_y[p] - sin * measurements.point_x[p]
        if p == first:
            sides.z[0] = sides.z[1] = along
            sides.z[2] = sides.z[3] = across
        if along < sides.z[0]:
            sides.z[0] = along
        if along > sides.z[1]:
            sides.z[1] = along
        if across < sides.z[2]:
            sides.z[2] = across
        if across > sides.z[3]:
            sides.z[3] = across
    own_start = measurements.start[k] != measurement.HIDDEN
    own_end = measurements.end[k] != measurement.HIDDEN
    if own_start:
        _measure_end(sides, measurements, k, first, -1.0, cos, sin, pose_var + _edge_doubt(measurements.start[k]))
    if own_end:
        _measure_end(sides, measurements, k, last, 1.0, cos, sin, pose_var + _edge_doubt(measurements.end[k]))
    for f in range(measurements.face_begin[k], measurements.face_begin[k + 1]):
        _measure_face(sides, measurements, f, cos, sin, pose_var)
    measurement.place_sensor(measurements, 0.0)


def _edge_doubt(edge: int) -> float:
    """Return the variance to add for an edge beside beams without a return that come and go [m²]."""
    return OPEN_EDGE_VAR if edge == measurement.OPEN else 0.0


def _measure_face(
    sides: EdgeMeasurement, measurements: Measurements, f: int, cos: float, sin: float, pose_var: float
) -> None:
    """Measure the near side of an axis by a face."""
    x, y = measurements.face_x[f], measurements.face_y[f]
    normal_x, normal_y = measurements.along_y[f], -measurements.along_x[f]
    if normal_x * (measurements.x - x) + normal_y * (measurements.y - y) < 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    along, across = cos * normal_x + sin * normal_y, cos * normal_y - sin * normal_x
    var = measurements.sigma * measurements.sigma / measurements.face_points[f] + SURFACE_VAR + pose_var
    # A crooked face is not exactly where its line is.
    var += CROOKED_SHARE * measurements.bulge[f] / measurements.face_points[f]
    if abs(along) > COS_ALONG:
        side = 1 if along > 0.0 else 0
        sides.z[side], sides.var[side] = cos * x + sin * y, var
    elif abs(across) > COS_ALONG:
        side = 3 if across > 0.0 else 2
        sides.z[side], sides.var[side] = cos * y - sin * x, var


def _measure_end(
    sides: EdgeMeasurement,
    measurements: Measurements,
    k: int,
    p: int,
    outwards: float,
    cos: float,
    sin: float,
    pose_var: float,
) -> None:
    """Measure the sides that end at an edge, half a beam past the last point on average."""
    x, y = measurements.point_x[p], measurements.point_y[p]
    far_x, far_y = x - measurements.x, y - measurements.y
    r = math.sqrt(far_x * far_x + far_y * far_y)
    if r <= 0.0:
        return
    far_x, far_y = far_x / r, far_y / r
    # Outwards, in the direction of the bearings.
    outwards *= measurements.side
    out_x, out_y = -outwards * far_y, outwards * far_x
    # The face that ends there, if any.
    face = -1
    for f in range(measurements.face_begin[k], measurements.face_begin[k + 1]):
        if measurements.face_first[f] == p or measurements.face_last[f] == p:
            face = f
    for side in range(4):
        u_x, u_y = (cos, sin) if side < 2 else (-sin, cos)
        if side == 0 or side == 2:
            u_x, u_y = -u_x, -u_y
        sign = 1.0 if side == 1 or side == 3 else -1.0
        if u_x * x + u_y * y < sign * sides.z[side] - END_MARGIN:
            continue
        if face >= 0 and abs(measurements.along_x[face] * u_x + measurements.along_y[face] * u_y) > COS_ALONG:
            gap = measurements.extent[face] / (measurements.face_points[face] - 1)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + SURFACE_VAR + pose_var
        elif u_x * far_x + u_y * far_y <= SIN_BEHIND:
            gap = max(u_x * out_x + u_y * out_y, 0.0) * r * measurements.step
            depth = measurements.sigma * (u_x * far_x + u_y * far_y)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + depth * depth + SURFACE_VAR + pose_var


def measure_disc(
    sides: EdgeMeasurement, measurements: Measurements, k: int, radius: float, radius_var: float, pose_var: float
) -> None:
    """Measure the centre of a disc, in the axes of the world.

    Parameters
    ----------
    radius, radius_var : estimate of its radius and variance [m, m²]; a negative variance without an estimate
    """
    sides.by_centre = True
    measurement.place_sensor(measurements, measurements.share[k])
    first, last = measurements.begin[k], measurements.begin[k + 1] - 1
    sigma = measurements.sigma
    own_start = measurements.start[k] != measurement.HIDDEN
    own_end = measurements.end[k] != measurement.HIDDEN
    first_x, first_y = _unit_vector(measurements, measurements.point_x[first], measurements.point_y[first])
    last_x, last_y = _unit_vector(measurements, measurements.point_x[last], measurements.point_y[last])
    near = measurements.near[k]
    half_angle = 0.5 * (
        math.atan2(abs(first_x * last_y - first_y * last_x), first_x * last_x + first_y * last_y) + measurements.step
    )
    gap = near * measurements.step
    sine = math.sin(min(half_angle, 1.2))
    visible_radius = near * sine / (1.0 - sine)
    visible_radius = min(visible_radius, 0.6 * max(measurements.length[k], measurements.chord[k]) + gap)
    sides.half_var = AT_LEAST
    if own_start and own_end:
        sides.half, sides.half_var = (
            visible_radius,
            gap * gap / 24.0 + SURFACE_VAR + RAGGED_SHARE * RAGGED_SHARE * visible_radius * visible_radius,
        )
    if radius_var < 0.0:
        radius, radius_var = visible_radius, 0.0025
        if sides.half_var >= 0.0:
            radius_var = sides.half_var
    mid_x, mid_y = first_x + last_x, first_y + last_y
    norm = math.sqrt(mid_x * mid_x + mid_y * mid_y)
    if norm > 0.0:
        mid_x, mid_y = mid_x / norm, mid_y / norm
    else:
        mid_x, mid_y = first_x, first_y
    across_var = 0.0
    if own_start and own_end:
        across_var = gap * gap / 24.0
    elif own_start or own_end:
        # The centre is a radius away from the edge that is its own.
        inwards = math.asin(min(radius / (near + radius), 1.0)) - 0.5 * measurements.step
        if own_start:
            mid_x, mid_y = _rotated(first_x, first_y, measurements.side * inwards)
        else:
            mid_x, mid_y = _rotated(last_x, last_y, -measurements.side * inwards)
        across_var = gap * gap / 12.0 + radius_var
    else:
        across_var = 0.25 * measurements.chord[k] * measurements.chord[k] + radius_var + 0.01
    centre_x, centre_y = measurements.x + mid_x * (near + radius), measurements.y + mid_y * (near + radius)
    depth_var = sigma * sigma + radius_var
    if measurements.shape[k] == ROUND and own_start and own_end:
        centre_x, centre_y = measurements.centre_x[k], measurements.centre_y[k]
        sides.half = 0.5 * measurements.length[k]
        sides.half_var = 4.0 * sigma * sigma / measurements.size[k] + SURFACE_VAR
        depth_var = sides.half_var
    elif measurements.shape[k] == LEGGED:
        centre_x, centre_y = measurements.middle_x[k], measurements.middle_y[k]
        depth_var = across_var = LEGGED_VAR
    ragged = 0.0 if measurements.shape[k] == ROUND else RAGGED_SHARE * measurements.length[k]
    sides.lasting_var = ragged * ragged
    more = SURFACE_VAR + pose_var + sides.lasting_var
    across_var += more
    # The arc of a round object gives its middle, wherever the arc ends.
    sides.is_doubtful = measurements.shape[k] != ROUND and (
        measurements.start[k] == measurement.OPEN or measurements.end[k] == measurement.OPEN
    )
    if sides.is_doubtful:
        across_var += _edge_doubt(measurements.start[k]) + _edge_doubt(measurements.end[k])
    depth_var += more
    sides.z[0] = sides.z[1] = centre_x
    sides.z[2] = sides.z[3] = centre_y
    sides.var[0] = sides.var[1] = mid_x * mid_x * depth_var + mid_y * mid_y * across_var
    sides.var[2] = sides.var[3] = mid_y * mid_y * depth_var + mid_x * mid_x * across_var
    measurement.place_sensor(measurements, 0.0)


def _unit_vector(measurements: Measurements, x: float, y: float) -> tuple[float, float]:
    """Return the unit vector from the sensor to a point."""
    dx, dy = x - measurements.x, y - measurements.y
    r = math.sqrt(dx * dx + dy * dy)
    return (dx / r, dy / r) if r > 0.0 else (1.0, 0.0)


def _rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


class Sightings:
    """Log of `count` sightings, kept until their windows are settled, in the arrays that `attach` sets."""

    def __init__(self) -> None:
        self.count = 0
        self.capacity = 0

    def attach(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Write to these arrays from now on; the caller keeps them alive."""
        self.capacity = len(arrays["number"])
        self.number = native.at_longs(arrays["number"])
        """Number of the body."""
        self.sweep = native.at_longs(arrays["sweep"])
        """Number of sweeps of the topic before."""
        self.object = native.at_longs(arrays["object"])
        """Number of objects of the topic before its own."""
        self.centred = native.at_longs(arrays["centred"])
        """1 if z[0] and z[2] are the centre, 0 if they are sides."""
        self.whole = native.at_longs(arrays["whole"])
        """1 if no edge of the view is hidden."""
        self.time = native.at_doubles(arrays["time"])
        self.x = native.at_doubles(arrays["x"])
        self.y = native.at_doubles(arrays["y"])
        """Estimate of the centre at the time [m]."""
        self.cos = native.at_doubles(arrays["cos"])
        self.sin = native.at_doubles(arrays["sin"])
        """Direction of the first axis."""
        self.chord = native.at_doubles(arrays["chord"])
        """Distance of the edges of the view [m]."""
        self.half_1 = native.at_doubles(arrays["half_1"])
        self.half_2 = native.at_doubles(arrays["half_2"])
        self.z = native.at_doubles(arrays["z"])
        self.var = native.at_doubles(arrays["var"])
        """(N, 4) sides and their variances, as in `Sides`."""


def sighting_arrays(count: int) -> dict[str, NDArray[Any]]:
    """Return arrays for so many sightings."""
    arrays: dict[str, NDArray[Any]] = {name: np.zeros(count, np.int64) for name in LOG_INTEGERS}
    arrays |= {name: np.zeros(count) for name in LOG_NUMBERS}
    return arrays | {name: np.zeros((count, 4)) for name in LOG_SIDES}


def record_sighting(
    sightings: Sightings,
    targets: Targets,
    b: int,
    sides: EdgeMeasurement,
    measurements: Measurements,
    k: int,
    sweep: int,
    time: float,
    at: int,
) -> None:
    """Write a sighting of a body by view k to the log; there is room."""
    i = sightings.count
    sightings.whole[i] = 0
    if measurements.start[k] != measurement.HIDDEN and measurements.end[k] != measurement.HIDDEN:
        sightings.whole[i] = 1
    sightings.chord[i] = measurements.chord[k]
    sightings.number[i], sightings.sweep[i], sightings.object[i], sightings.time[i] = targets.number[b], sweep, at, time
    along, across = targets.c[2 * b], targets.c[2 * b + 1]
    sightings.x[i] = targets.cos[b] * along - targets.sin[b] * across
    sightings.y[i] = targets.sin[b] * along + targets.cos[b] * across
    sightings.cos[i], sightings.sin[i] = targets.cos[b], targets.sin[b]
    sightings.half_1[i], sightings.half_2[i] = targets.h[2 * b], targets.h[2 * b + 1]
    sightings.centred[i] = 1 if sides.by_centre else 0
    for side in range(4):
        sightings.z[4 * i + side], sightings.var[4 * i + side] = sides.z[side], sides.var[side]
    sightings.count += 1
