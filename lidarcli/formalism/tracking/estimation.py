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
from lidarcli.formalism.tracking import observation, results
from lidarcli.formalism.tracking.observation import Views

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


class Bodies:
    """Arrays of `most` slots, one for each body. Values along axis i of body b stand at 2 b + i."""

    def __init__(self, most: int) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        """All arrays, by name."""
        self.most = most
        self.high = 0
        """Slot from which on all slots are empty."""
        self.born = 0
        """Number of bodies so far; a new body gets the next number."""
        self.state = native.at_longs(_new(self.arrays, "state", most, np.int64))
        self.number = native.at_longs(_new(self.arrays, "number", most, np.int64))
        self.kind = native.at_longs(_new(self.arrays, "kind", most, np.int64))
        self.sightings = native.at_longs(_new(self.arrays, "sightings", most, np.int64))
        """Number of sweeps that saw it."""
        self.settled = native.at_longs(_new(self.arrays, "settled", most, np.int64))
        """Number of sightings since its kind was chosen; of a person, its legs in this sweep."""
        self.boxy = native.at_longs(_new(self.arrays, "boxy", most, np.int64))
        """Number of sightings as a box with enough beams while it is a disc; of a person, sightings of one leg."""
        self.whole = native.at_longs(_new(self.arrays, "whole", most, np.int64))
        """Number of sightings with both edges its own; of a person, with two legs."""
        self.moved = native.at_longs(_new(self.arrays, "moved", most, np.int64))
        self.inside = native.at_longs(_new(self.arrays, "inside", most, np.int64))
        """Number of sweeps unseen inside an older body that was seen, less those in which it was seen."""
        self.same_as = native.at_longs(_new(self.arrays, "same_as", most, np.int64))
        """Number of the older body, or of the person of a leg; 0 for none."""
        self.member = native.at_longs(_new(self.arrays, "member", most, np.int64))
        """Number of the person that it is a leg of, 0 for none."""
        self.view = native.at_longs(_new(self.arrays, "view", most, np.int64))
        """View in this sweep, -1 for none."""
        self.first_sweep = native.at_longs(_new(self.arrays, "first_sweep", most, np.int64))
        self.last_sweep = native.at_longs(_new(self.arrays, "last_sweep", most, np.int64))
        self.onset = native.at_longs(_new(self.arrays, "onset", most, np.int64))
        """Last sweep without evidence of motion."""
        self.end = native.at_longs(_new(self.arrays, "end", most, np.int64))
        """Reason for its end, an index into `results.ENDS`."""
        self.size = native.at_doubles(_new(self.arrays, "size", most, np.float64))
        """Mean diagonal of its box, by views with both edges its own [m]."""
        self.existence = native.at_doubles(_new(self.arrays, "existence", most, np.float64))
        self.seen_at = native.at_doubles(_new(self.arrays, "seen_at", most, np.float64))
        """Time of the last sighting [s]."""
        self.first_at = native.at_doubles(_new(self.arrays, "first_at", most, np.float64))
        self.evidence = native.at_doubles(_new(self.arrays, "evidence", most, np.float64))
        """Evidence of motion, log-odds (a CUSUM)."""
        self.evidence_most = native.at_doubles(_new(self.arrays, "evidence_most", most, np.float64))
        self.yaw = native.at_doubles(_new(self.arrays, "yaw", most, np.float64))
        self.yaw_rate = native.at_doubles(_new(self.arrays, "yaw_rate", most, np.float64))
        self.yaw_var = native.at_doubles(_new(self.arrays, "yaw_var", most, np.float64))
        self.yaw_cov = native.at_doubles(_new(self.arrays, "yaw_cov", most, np.float64))
        self.rate_var = native.at_doubles(_new(self.arrays, "rate_var", most, np.float64))
        self.cos = native.at_doubles(_new(self.arrays, "cos", most, np.float64))
        self.sin = native.at_doubles(_new(self.arrays, "sin", most, np.float64))
        self.middle_x = native.at_doubles(_new(self.arrays, "middle_x", most, np.float64))
        self.middle_y = native.at_doubles(_new(self.arrays, "middle_y", most, np.float64))
        """Centroid of the points at the last sighting [m]."""
        self.from_x = native.at_doubles(_new(self.arrays, "from_x", most, np.float64))
        self.from_y = native.at_doubles(_new(self.arrays, "from_y", most, np.float64))
        """Centre at the last sighting [m]."""
        self.birth_x = native.at_doubles(_new(self.arrays, "birth_x", most, np.float64))
        self.birth_y = native.at_doubles(_new(self.arrays, "birth_y", most, np.float64))
        """Centre in the last sweep without evidence of motion [m]."""
        self.c = native.at_doubles(_new(self.arrays, "c", 2 * most, np.float64))
        self.v = native.at_doubles(_new(self.arrays, "v", 2 * most, np.float64))
        self.h = native.at_doubles(_new(self.arrays, "h", 2 * most, np.float64))
        self.cc = native.at_doubles(_new(self.arrays, "cc", 2 * most, np.float64))
        self.cv = native.at_doubles(_new(self.arrays, "cv", 2 * most, np.float64))
        self.ch = native.at_doubles(_new(self.arrays, "ch", 2 * most, np.float64))
        self.vv = native.at_doubles(_new(self.arrays, "vv", 2 * most, np.float64))
        self.vh = native.at_doubles(_new(self.arrays, "vh", 2 * most, np.float64))
        self.hh = native.at_doubles(_new(self.arrays, "hh", 2 * most, np.float64))
        """Centre, velocity and half extent along each axis, and their covariance."""
        self.still_c = native.at_doubles(_new(self.arrays, "still_c", 2 * most, np.float64))
        self.still_h = native.at_doubles(_new(self.arrays, "still_h", 2 * most, np.float64))
        self.still_cc = native.at_doubles(_new(self.arrays, "still_cc", 2 * most, np.float64))
        self.still_ch = native.at_doubles(_new(self.arrays, "still_ch", 2 * most, np.float64))
        self.still_hh = native.at_doubles(_new(self.arrays, "still_hh", 2 * most, np.float64))
        """Centre and half extent of the twin along each axis, and their covariance."""
        self.effect = native.at_doubles(_new(self.arrays, "effect", 6 * most, np.float64))
        """Effect of the error of the poses on the place of the twin, three numbers for each axis (`fold.Correction`)."""
        self.side = native.at_doubles(_new(self.arrays, "side", 2 * most, np.float64))
        self.side_weight = native.at_doubles(_new(self.arrays, "side_weight", 2 * most, np.float64))
        """Mean extent by sightings of both ends, and their weight [m, 1/m²]."""
        self.least = native.at_doubles(_new(self.arrays, "least", 2 * most, np.float64))
        """Least length along each axis [m]."""
        self.bulge = native.at_doubles(_new(self.arrays, "bulge", most, np.float64))
        """Sum of the squared distances of points from their faces, in variances of the noise."""
        self.bulge_points = native.at_doubles(_new(self.arrays, "bulge_points", most, np.float64))
        """Expected value of that sum for straight faces."""
        self.leg_x = native.at_doubles(_new(self.arrays, "leg_x", MOST_LEGS * most, np.float64))
        self.leg_y = native.at_doubles(_new(self.arrays, "leg_y", MOST_LEGS * most, np.float64))
        """Mean places of legs beside it that are too slim to be objects [m]."""
        self.leg_seen = native.at_longs(_new(self.arrays, "leg_seen", MOST_LEGS * most, np.int64))
        """Number of sightings of each of these legs."""
        self.shape_votes = native.at_doubles(_new(self.arrays, "shape_votes", 5 * most, np.float64))
        """Votes of its views, by shape."""

    def grow(self, old: Bodies) -> None:
        """Copy the bodies of `old`, which has less room."""
        self.high, self.born = old.high, old.born
        for name, values in old.arrays.items():
            self.arrays[name][: len(values)] = values


def _new(arrays: dict[str, NDArray[Any]], name: str, count: int, kind: Any) -> NDArray[Any]:
    """Add an array of zeros by its name, and return it."""
    arrays[name] = np.zeros(count, kind)
    return arrays[name]


def free_slot(bodies: Bodies) -> int:
    """Return the first empty slot; there is one."""
    b = 0
    while bodies.state[b] != EMPTY:
        b += 1
    bodies.high = max(bodies.high, b + 1)
    return b


def clear(bodies: Bodies, b: int) -> None:
    """Begin a new body in a slot."""
    bodies.born += 1
    bodies.number[b] = bodies.born
    bodies.state[b] = LIVE
    bodies.sightings[b] = bodies.settled[b] = bodies.boxy[b] = bodies.whole[b] = 0
    bodies.moved[b] = bodies.inside[b] = bodies.same_as[b] = bodies.member[b] = 0
    bodies.size[b] = 0.0
    bodies.evidence[b] = bodies.evidence_most[b] = 0.0
    bodies.yaw[b] = bodies.yaw_rate[b] = bodies.sin[b] = 0.0
    bodies.yaw_var[b] = bodies.yaw_cov[b] = bodies.rate_var[b] = 0.0
    bodies.cos[b] = 1.0
    bodies.bulge[b] = bodies.bulge_points[b] = 0.0
    for a in range(2 * b, 2 * b + 2):
        bodies.side[a] = bodies.side_weight[a] = bodies.least[a] = 0.0
    for i in range(6 * b, 6 * b + 6):
        bodies.effect[i] = 0.0
    for i in range(5 * b, 5 * b + 5):
        bodies.shape_votes[i] = 0.0
    for i in range(MOST_LEGS * b, MOST_LEGS * b + MOST_LEGS):
        bodies.leg_x[i] = bodies.leg_y[i] = 0.0
        bodies.leg_seen[i] = 0


def centre(bodies: Bodies, b: int) -> tuple[float, float]:
    """Return the centre of a body in the world [m]."""
    return to_world(bodies, b, bodies.c[2 * b], bodies.c[2 * b + 1])


def to_world(bodies: Bodies, b: int, along: float, across: float) -> tuple[float, float]:
    """Return a vector in the axes of a body as one in the world."""
    return bodies.cos[b] * along - bodies.sin[b] * across, bodies.sin[b] * along + bodies.cos[b] * across


def to_axes(bodies: Bodies, b: int, x: float, y: float) -> tuple[float, float]:
    """Return a vector in the world as one in the axes of a body."""
    return bodies.cos[b] * x + bodies.sin[b] * y, bodies.cos[b] * y - bodies.sin[b] * x


def half_extent(bodies: Bodies, b: int, x: float, y: float) -> float:
    """Return the half extent of a body in a direction of the world, given as a unit vector [m]."""
    if bodies.kind[b] != BOX:
        return 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
    along, across = to_axes(bodies, b, x, y)
    return abs(along) * bodies.h[2 * b] + abs(across) * bodies.h[2 * b + 1]


def outside(bodies: Bodies, b: int, x: float, y: float) -> float:
    """Return the distance of a point from a body [m], negative inside."""
    centre_x, centre_y = centre(bodies, b)
    dx, dy = x - centre_x, y - centre_y
    if bodies.kind[b] != BOX:
        return math.sqrt(dx * dx + dy * dy) - 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
    along, across = to_axes(bodies, b, dx, dy)
    return max(abs(along) - bodies.h[2 * b], abs(across) - bodies.h[2 * b + 1])


def turn(bodies: Bodies, b: int, angle: float) -> None:
    """Turn the axes of a body; its estimates in the world stay the same."""
    cos, sin = math.cos(angle), math.sin(angle)
    one, other = 2 * b, 2 * b + 1
    bodies.c[one], bodies.c[other] = (
        cos * bodies.c[one] + sin * bodies.c[other],
        cos * bodies.c[other] - sin * bodies.c[one],
    )
    bodies.v[one], bodies.v[other] = (
        cos * bodies.v[one] + sin * bodies.v[other],
        cos * bodies.v[other] - sin * bodies.v[one],
    )
    bodies.still_c[one], bodies.still_c[other] = (
        cos * bodies.still_c[one] + sin * bodies.still_c[other],
        cos * bodies.still_c[other] - sin * bodies.still_c[one],
    )
    for i in range(3 * one, 3 * one + 3):
        bodies.effect[i], bodies.effect[i + 3] = (
            cos * bodies.effect[i] + sin * bodies.effect[i + 3],
            cos * bodies.effect[i + 3] - sin * bodies.effect[i],
        )
    # The covariance between the axes is left out; turns from sweep to sweep are small.
    keep, give = cos * cos, sin * sin
    _mix(bodies.cc, one, keep, give)
    _mix(bodies.cv, one, keep, give)
    _mix(bodies.vv, one, keep, give)
    _mix(bodies.still_cc, one, keep, give)
    for a in range(one, one + 2):
        bodies.ch[a] *= cos
        bodies.vh[a] *= cos
        bodies.still_ch[a] *= cos
    bodies.yaw[b] += angle
    bodies.cos[b], bodies.sin[b] = math.cos(bodies.yaw[b]), math.sin(bodies.yaw[b])


def _mix(values: Any, at: int, keep: float, give: float) -> None:
    """Mix the values of both axes."""
    first, second = values[at], values[at + 1]
    values[at], values[at + 1] = keep * first + give * second, keep * second + give * first


def predict(bodies: Bodies, b: int, dt: float, creep: float) -> None:
    """Predict a body after a time dt [s]. `creep`: variance that is added to standing bodies as poses drift [m²]."""
    if bodies.kind[b] == BOX:
        bodies.yaw_var[b] += (
            dt * (2.0 * bodies.yaw_cov[b] + dt * bodies.rate_var[b]) + ANGULAR_ACCELERATION * dt * dt * dt / 3.0
        )
        bodies.yaw_cov[b] += dt * bodies.rate_var[b] + 0.5 * ANGULAR_ACCELERATION * dt * dt
        bodies.rate_var[b] += ANGULAR_ACCELERATION * dt
        if bodies.yaw_rate[b] != 0.0:
            turn(bodies, b, bodies.yaw_rate[b] * dt)
    for a in range(2 * b, 2 * b + 2):
        bodies.c[a] += dt * bodies.v[a]
        bodies.cc[a] += dt * (2.0 * bodies.cv[a] + dt * bodies.vv[a]) + ACCELERATION * dt * dt * dt / 3.0
        bodies.cv[a] += dt * bodies.vv[a] + 0.5 * ACCELERATION * dt * dt
        bodies.ch[a] += dt * bodies.vh[a]
        bodies.vv[a] += ACCELERATION * dt
        bodies.hh[a] += EXTENT_GROWTH * dt
        bodies.still_cc[a] += STANDING_GROWTH * dt + creep
        bodies.still_hh[a] += EXTENT_GROWTH * dt


def rest(bodies: Bodies, b: int) -> None:
    """Stop a body that is not seen and was never shown to move; it may begin to move at any time."""
    for a in range(2 * b, 2 * b + 2):
        bodies.c[a], bodies.h[a] = bodies.still_c[a], bodies.still_h[a]
        bodies.cc[a] = bodies.still_cc[a] + UNSEEN_VAR
        bodies.ch[a], bodies.hh[a] = bodies.still_ch[a], bodies.still_hh[a]
        bodies.v[a] = bodies.cv[a] = bodies.vh[a] = 0.0
        bodies.vv[a] = SPEED_SD * SPEED_SD
    bodies.yaw_rate[b] = 0.0


def residual(bodies: Bodies, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """Return the residual of a measurement of c + sign h [m], and its variance [m²]."""
    return (
        z - bodies.c[a] - sign * bodies.h[a],
        max(bodies.cc[a] + sign * (2.0 * bodies.ch[a] + sign * bodies.hh[a]), 0.0) + var,
    )


def still_residual(bodies: Bodies, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """Return the residual of a measurement of c + sign h for the twin [m], and its variance [m²]."""
    return (
        z - bodies.still_c[a] - sign * bodies.still_h[a],
        max(bodies.still_cc[a] + sign * (2.0 * bodies.still_ch[a] + sign * bodies.still_hh[a]), 0.0) + var,
    )


def update(bodies: Bodies, a: int, z: float, sign: float, var: float) -> None:
    """Update an axis with a measurement of c + sign h; sign is 0 for the centre itself."""
    off, s = residual(bodies, a, z, sign, var)
    if off * off > MOST_RESIDUAL * s:
        s = off * off / MOST_RESIDUAL
    p, q, w = (bodies.cc[a] + sign * bodies.ch[a], bodies.cv[a] + sign * bodies.vh[a], bodies.ch[a] + sign * bodies.hh[a])
    gain_c, gain_v, gain_h = p / s, q / s, w / s
    bodies.c[a] += gain_c * off
    bodies.v[a] += gain_v * off
    bodies.h[a] = max(bodies.h[a] + gain_h * off, 0.01)
    bodies.cc[a] = max(bodies.cc[a] - gain_c * p, LEAST_VAR)
    bodies.cv[a] -= gain_c * q
    bodies.ch[a] -= gain_c * w
    bodies.vv[a] = max(bodies.vv[a] - gain_v * q, LEAST_VAR)
    bodies.vh[a] -= gain_v * w
    bodies.hh[a] = max(bodies.hh[a] - gain_h * w, LEAST_VAR)


def update_still(bodies: Bodies, a: int, z: float, sign: float, var: float) -> float:
    """Update the twin with a measurement of c + sign h; return the gain of its centre."""
    off, s = still_residual(bodies, a, z, sign, var)
    if off * off > MOST_RESIDUAL * s:
        s = off * off / MOST_RESIDUAL
    p, w = bodies.still_cc[a] + sign * bodies.still_ch[a], bodies.still_ch[a] + sign * bodies.still_hh[a]
    gain_c, gain_h = p / s, w / s
    bodies.still_c[a] += gain_c * off
    bodies.still_h[a] = max(bodies.still_h[a] + gain_h * off, 0.01)
    bodies.still_cc[a] = max(bodies.still_cc[a] - gain_c * p, LEAST_VAR)
    bodies.still_ch[a] -= gain_c * w
    bodies.still_hh[a] = max(bodies.still_hh[a] - gain_h * w, LEAST_VAR)
    return gain_c


def update_extent(bodies: Bodies, a: int, half: float, var: float) -> None:
    """Update an axis with a measurement of its half extent."""
    gain = bodies.hh[a] / (bodies.hh[a] + var)
    off = half - bodies.h[a]
    bodies.h[a] = max(bodies.h[a] + gain * off, 0.01)
    bodies.hh[a] *= 1.0 - gain
    bodies.still_h[a], bodies.still_hh[a] = bodies.h[a], bodies.hh[a]


def update_yaw(bodies: Bodies, b: int, yaw: float, var: float) -> None:
    """Update the direction of a body with that of a face, which is known up to quarter turns."""
    off = yaw - bodies.yaw[b]
    off -= QUARTER_TURN * math.floor(off / QUARTER_TURN + 0.5)
    s = bodies.yaw_var[b] + var
    if abs(off) > MOST_TURN:
        # More likely another face than such a turn.
        s += off * off
    gain, gain_rate = bodies.yaw_var[b] / s, bodies.yaw_cov[b] / s
    turn(bodies, b, gain * off)
    bodies.yaw_rate[b] = min(max(bodies.yaw_rate[b] + gain_rate * off, -FASTEST_TURN), FASTEST_TURN)
    bodies.rate_var[b] -= gain_rate * bodies.yaw_cov[b]
    bodies.yaw_cov[b] *= 1.0 - gain
    bodies.yaw_var[b] *= 1.0 - gain


def begin_axis(bodies: Bodies, a: int, low: float, high: float, low_var: float, high_var: float) -> None:
    """Begin an axis with its two sides [m]; a negative variance means that the side goes on at least so far."""
    half = 0.5 * (high - low)
    bodies.v[a] = 0.0
    bodies.cv[a] = bodies.vh[a] = 0.0
    bodies.vv[a] = SPEED_SD * SPEED_SD
    if low_var >= 0.0 and high_var >= 0.0:
        bodies.c[a], bodies.h[a] = 0.5 * (low + high), max(half, 0.01)
        bodies.cc[a] = bodies.hh[a] = 0.25 * (low_var + high_var)
        bodies.ch[a] = 0.25 * (high_var - low_var)
    elif high_var >= 0.0:
        bodies.h[a] = max(half, 0.05) + 0.5 * NEW_EXTENT
        bodies.c[a] = high - bodies.h[a]
        bodies.hh[a] = NEW_EXTENT * NEW_EXTENT
        bodies.cc[a], bodies.ch[a] = bodies.hh[a] + high_var, -bodies.hh[a]
    elif low_var >= 0.0:
        bodies.h[a] = max(half, 0.05) + 0.5 * NEW_EXTENT
        bodies.c[a] = low + bodies.h[a]
        bodies.hh[a] = NEW_EXTENT * NEW_EXTENT
        bodies.cc[a], bodies.ch[a] = bodies.hh[a] + low_var, bodies.hh[a]
    else:
        bodies.c[a], bodies.h[a] = 0.5 * (low + high), max(half, 0.05) + 0.5 * NEW_EXTENT
        bodies.hh[a] = bodies.cc[a] = NEW_EXTENT * NEW_EXTENT
        bodies.ch[a] = 0.0
    stand_still(bodies, a)


def stand_still(bodies: Bodies, a: int) -> None:
    """Reset the twin to the estimate of the body."""
    bodies.still_c[a], bodies.still_h[a] = bodies.c[a], bodies.h[a]
    bodies.still_cc[a], bodies.still_ch[a], bodies.still_hh[a] = bodies.cc[a], bodies.ch[a], bodies.hh[a]


class Sides:
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


def measure(sides: Sides, views: Views, k: int, bodies: Bodies, b: int, pose_var: float) -> None:
    """Measure a body by view k.

    Parameters
    ----------
    pose_var : variance of a point there from the error of the pose [m²]
    """
    if bodies.kind[b] == DISC:
        radius = 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
        var = 0.5 * (bodies.hh[2 * b] + bodies.hh[2 * b + 1])
        measure_disc(sides, views, k, radius, var, pose_var)
    else:
        measure_box(sides, views, k, bodies.cos[b], bodies.sin[b], pose_var)


def measure_box(sides: Sides, views: Views, k: int, cos: float, sin: float, pose_var: float) -> None:
    """Measure the sides of a rectangle whose first axis has the direction cos, sin."""
    sides.by_centre = False
    observation.place_sensor(views, views.share[k])
    first, last = views.begin[k], views.begin[k + 1] - 1
    for side in range(4):
        sides.var[side] = AT_LEAST
    for p in range(first, last + 1):
        along = cos * views.point_x[p] + sin * views.point_y[p]
        across = cos * views.point_y[p] - sin * views.point_x[p]
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
    own_start = views.start[k] != observation.HIDDEN
    own_end = views.end[k] != observation.HIDDEN
    if own_start:
        _measure_end(sides, views, k, first, -1.0, cos, sin, pose_var + _edge_doubt(views.start[k]))
    if own_end:
        _measure_end(sides, views, k, last, 1.0, cos, sin, pose_var + _edge_doubt(views.end[k]))
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        _measure_face(sides, views, f, cos, sin, pose_var)
    observation.place_sensor(views, 0.0)


def _edge_doubt(edge: int) -> float:
    """Return the variance to add for an edge beside beams without a return that come and go [m²]."""
    return OPEN_EDGE_VAR if edge == observation.OPEN else 0.0


def _measure_face(sides: Sides, views: Views, f: int, cos: float, sin: float, pose_var: float) -> None:
    """Measure the near side of an axis by a face."""
    x, y = views.face_x[f], views.face_y[f]
    normal_x, normal_y = views.along_y[f], -views.along_x[f]
    if normal_x * (views.x - x) + normal_y * (views.y - y) < 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    along, across = cos * normal_x + sin * normal_y, cos * normal_y - sin * normal_x
    var = views.sigma * views.sigma / views.face_points[f] + SURFACE_VAR + pose_var
    # A crooked face is not exactly where its line is.
    var += CROOKED_SHARE * views.bulge[f] / views.face_points[f]
    if abs(along) > COS_ALONG:
        side = 1 if along > 0.0 else 0
        sides.z[side], sides.var[side] = cos * x + sin * y, var
    elif abs(across) > COS_ALONG:
        side = 3 if across > 0.0 else 2
        sides.z[side], sides.var[side] = cos * y - sin * x, var


def _measure_end(sides: Sides, views: Views, k: int, p: int, way: float, cos: float, sin: float, pose_var: float) -> None:
    """Measure the sides that end at an edge, half a beam past the last point on average."""
    x, y = views.point_x[p], views.point_y[p]
    far_x, far_y = x - views.x, y - views.y
    r = math.sqrt(far_x * far_x + far_y * far_y)
    if r <= 0.0:
        return
    far_x, far_y = far_x / r, far_y / r
    # Outwards, in the direction of the bearings.
    way *= views.side
    out_x, out_y = -way * far_y, way * far_x
    # The face that ends there, if any.
    face = -1
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_first[f] == p or views.face_last[f] == p:
            face = f
    for side in range(4):
        u_x, u_y = (cos, sin) if side < 2 else (-sin, cos)
        if side == 0 or side == 2:
            u_x, u_y = -u_x, -u_y
        sign = 1.0 if side == 1 or side == 3 else -1.0
        if u_x * x + u_y * y < sign * sides.z[side] - END_MARGIN:
            continue
        if face >= 0 and abs(views.along_x[face] * u_x + views.along_y[face] * u_y) > COS_ALONG:
            gap = views.extent[face] / (views.face_points[face] - 1)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + SURFACE_VAR + pose_var
        elif u_x * far_x + u_y * far_y <= SIN_BEHIND:
            gap = max(u_x * out_x + u_y * out_y, 0.0) * r * views.step
            depth = views.sigma * (u_x * far_x + u_y * far_y)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + depth * depth + SURFACE_VAR + pose_var


def measure_disc(sides: Sides, views: Views, k: int, radius: float, radius_var: float, pose_var: float) -> None:
    """Measure the centre of a disc, in the axes of the world.

    Parameters
    ----------
    radius, radius_var : estimate of its radius and variance [m, m²]; a negative variance without an estimate
    """
    sides.by_centre = True
    observation.place_sensor(views, views.share[k])
    first, last = views.begin[k], views.begin[k + 1] - 1
    sigma = views.sigma
    own_start = views.start[k] != observation.HIDDEN
    own_end = views.end[k] != observation.HIDDEN
    first_x, first_y = _unit_vector(views, views.point_x[first], views.point_y[first])
    last_x, last_y = _unit_vector(views, views.point_x[last], views.point_y[last])
    near = views.near[k]
    half_angle = 0.5 * (
        math.atan2(abs(first_x * last_y - first_y * last_x), first_x * last_x + first_y * last_y) + views.step
    )
    gap = near * views.step
    sine = math.sin(min(half_angle, 1.2))
    seen = near * sine / (1.0 - sine)
    seen = min(seen, 0.6 * max(views.length[k], views.chord[k]) + gap)
    sides.half_var = AT_LEAST
    if own_start and own_end:
        sides.half, sides.half_var = (seen, gap * gap / 24.0 + SURFACE_VAR + RAGGED_SHARE * RAGGED_SHARE * seen * seen)
    if radius_var < 0.0:
        radius, radius_var = seen, 0.0025
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
        inwards = math.asin(min(radius / (near + radius), 1.0)) - 0.5 * views.step
        if own_start:
            mid_x, mid_y = _turned(first_x, first_y, views.side * inwards)
        else:
            mid_x, mid_y = _turned(last_x, last_y, -views.side * inwards)
        across_var = gap * gap / 12.0 + radius_var
    else:
        across_var = 0.25 * views.chord[k] * views.chord[k] + radius_var + 0.01
    centre_x, centre_y = views.x + mid_x * (near + radius), views.y + mid_y * (near + radius)
    depth_var = sigma * sigma + radius_var
    if views.shape[k] == ROUND and own_start and own_end:
        centre_x, centre_y = views.centre_x[k], views.centre_y[k]
        sides.half = 0.5 * views.length[k]
        sides.half_var = 4.0 * sigma * sigma / views.size[k] + SURFACE_VAR
        depth_var = sides.half_var
    elif views.shape[k] == LEGGED:
        centre_x, centre_y = views.middle_x[k], views.middle_y[k]
        depth_var = across_var = LEGGED_VAR
    ragged = 0.0 if views.shape[k] == ROUND else RAGGED_SHARE * views.length[k]
    sides.lasting_var = ragged * ragged
    more = SURFACE_VAR + pose_var + sides.lasting_var
    across_var += more
    # The arc of a round object gives its middle, wherever the arc ends.
    sides.is_doubtful = views.shape[k] != ROUND and (views.start[k] == observation.OPEN or views.end[k] == observation.OPEN)
    if sides.is_doubtful:
        across_var += _edge_doubt(views.start[k]) + _edge_doubt(views.end[k])
    depth_var += more
    sides.z[0] = sides.z[1] = centre_x
    sides.z[2] = sides.z[3] = centre_y
    sides.var[0] = sides.var[1] = mid_x * mid_x * depth_var + mid_y * mid_y * across_var
    sides.var[2] = sides.var[3] = mid_y * mid_y * depth_var + mid_x * mid_x * across_var
    observation.place_sensor(views, 0.0)


def _unit_vector(views: Views, x: float, y: float) -> tuple[float, float]:
    """Return the unit vector from the sensor to a point."""
    dx, dy = x - views.x, y - views.y
    r = math.sqrt(dx * dx + dy * dy)
    return (dx / r, dy / r) if r > 0.0 else (1.0, 0.0)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


class Sightings:
    """Log of `count` sightings, kept until their windows are settled, in the arrays that `attach` sets."""

    def __init__(self) -> None:
        self.count = 0
        self.room = 0

    def attach(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Write to these arrays from now on; the caller keeps them alive."""
        self.room = len(arrays["number"])
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


def log_sighting(
    log: Sightings, bodies: Bodies, b: int, sides: Sides, views: Views, k: int, sweep: int, time: float, at: int
) -> None:
    """Write a sighting of a body by view k to the log; there is room."""
    i = log.count
    log.whole[i] = 0
    if views.start[k] != observation.HIDDEN and views.end[k] != observation.HIDDEN:
        log.whole[i] = 1
    log.chord[i] = views.chord[k]
    log.number[i], log.sweep[i], log.object[i], log.time[i] = bodies.number[b], sweep, at, time
    along, across = bodies.c[2 * b], bodies.c[2 * b + 1]
    log.x[i] = bodies.cos[b] * along - bodies.sin[b] * across
    log.y[i] = bodies.sin[b] * along + bodies.cos[b] * across
    log.cos[i], log.sin[i] = bodies.cos[b], bodies.sin[b]
    log.half_1[i], log.half_2[i] = bodies.h[2 * b], bodies.h[2 * b + 1]
    log.centred[i] = 1 if sides.by_centre else 0
    for side in range(4):
        log.z[4 * i + side], log.var[4 * i + side] = sides.z[side], sides.var[side]
    log.count += 1
