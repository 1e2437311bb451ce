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
LOG_INTEGERS = ("number", "sweep", "object", "centred")
LOG_NUMBERS = ("time", "x", "y", "cos", "sin", "half_1", "half_2", "odds")
LOG_SIDES = ("z", "var")


class Bodies:
    """Room for `most` bodies. What is known along axis i of body b stands at 2 b + i."""

    def __init__(self, most: int) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        """What is known of all bodies, by name."""
        self.most = most
        self.high = 0
        """No slot from here on has a body."""
        self.born = 0
        """Bodies so far; each has a number of its own by that."""
        self.state = native.at_longs(_new(self.arrays, "state", most, np.int64))
        self.number = native.at_longs(_new(self.arrays, "number", most, np.int64))
        self.kind = native.at_longs(_new(self.arrays, "kind", most, np.int64))
        self.sightings = native.at_longs(_new(self.arrays, "sightings", most, np.int64))
        """Sweeps in which it was seen."""
        self.settled = native.at_longs(_new(self.arrays, "settled", most, np.int64))
        """Of these, since its kind was last chosen."""
        self.boxy = native.at_longs(_new(self.arrays, "boxy", most, np.int64))
        """Sightings as a box with enough beams while it is a disc."""
        self.whole = native.at_longs(_new(self.arrays, "whole", most, np.int64))
        """Sightings with both edges its own."""
        self.moved = native.at_longs(_new(self.arrays, "moved", most, np.int64))
        self.inside = native.at_longs(_new(self.arrays, "inside", most, np.int64))
        """Sweeps in which it was unseen within an older body that was seen, less those in which it was seen …"""
        self.same_as = native.at_longs(_new(self.arrays, "same_as", most, np.int64))
        """… and the number of that; of a body that has ended 0 where it is not the same thing."""
        self.member = native.at_longs(_new(self.arrays, "member", most, np.int64))
        """Number of the person that it is a leg of, 0 for none."""
        self.view = native.at_longs(_new(self.arrays, "view", most, np.int64))
        """Its view in this sweep, -1 for none."""
        self.first_sweep = native.at_longs(_new(self.arrays, "first_sweep", most, np.int64))
        self.last_sweep = native.at_longs(_new(self.arrays, "last_sweep", most, np.int64))
        self.onset = native.at_longs(_new(self.arrays, "onset", most, np.int64))
        """The sweep in which the evidence of motion was last nil."""
        self.end = native.at_longs(_new(self.arrays, "end", most, np.int64))
        """Why it ended (`results.ENDS`)."""
        self.size = native.at_doubles(_new(self.arrays, "size", most, np.float64))
        """Diagonal of its box by views with both edges its own [m]."""
        self.existence = native.at_doubles(_new(self.arrays, "existence", most, np.float64))
        self.seen_at = native.at_doubles(_new(self.arrays, "seen_at", most, np.float64))
        """When it was last seen [s]."""
        self.first_at = native.at_doubles(_new(self.arrays, "first_at", most, np.float64))
        self.evidence = native.at_doubles(_new(self.arrays, "evidence", most, np.float64))
        """Evidence of its own motion, log-odds (a CUSUM)."""
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
        """Centroid of the points when it was last seen [m] …"""
        self.from_x = native.at_doubles(_new(self.arrays, "from_x", most, np.float64))
        self.from_y = native.at_doubles(_new(self.arrays, "from_y", most, np.float64))
        """… and where its centre was then."""
        self.birth_x = native.at_doubles(_new(self.arrays, "birth_x", most, np.float64))
        self.birth_y = native.at_doubles(_new(self.arrays, "birth_y", most, np.float64))
        """Where it was first seen, or began to be without evidence of motion [m]."""
        self.c = native.at_doubles(_new(self.arrays, "c", 2 * most, np.float64))
        self.v = native.at_doubles(_new(self.arrays, "v", 2 * most, np.float64))
        self.h = native.at_doubles(_new(self.arrays, "h", 2 * most, np.float64))
        self.cc = native.at_doubles(_new(self.arrays, "cc", 2 * most, np.float64))
        self.cv = native.at_doubles(_new(self.arrays, "cv", 2 * most, np.float64))
        self.ch = native.at_doubles(_new(self.arrays, "ch", 2 * most, np.float64))
        self.vv = native.at_doubles(_new(self.arrays, "vv", 2 * most, np.float64))
        self.vh = native.at_doubles(_new(self.arrays, "vh", 2 * most, np.float64))
        self.hh = native.at_doubles(_new(self.arrays, "hh", 2 * most, np.float64))
        """The estimate along each axis, and its covariance."""
        self.still_c = native.at_doubles(_new(self.arrays, "still_c", 2 * most, np.float64))
        self.still_h = native.at_doubles(_new(self.arrays, "still_h", 2 * most, np.float64))
        self.still_cc = native.at_doubles(_new(self.arrays, "still_cc", 2 * most, np.float64))
        self.still_ch = native.at_doubles(_new(self.arrays, "still_ch", 2 * most, np.float64))
        self.still_hh = native.at_doubles(_new(self.arrays, "still_hh", 2 * most, np.float64))
        """The twin that stands still."""
        self.effect = native.at_doubles(_new(self.arrays, "effect", 6 * most, np.float64))
        """How the place of the twin depends on what the poses are off by (`correction`), three numbers for each axis."""
        self.side = native.at_doubles(_new(self.arrays, "side", 2 * most, np.float64))
        self.side_weight = native.at_doubles(_new(self.arrays, "side_weight", 2 * most, np.float64))
        """Extent by sightings of both ends, and the weight of these [m, 1/m²]."""
        self.least = native.at_doubles(_new(self.arrays, "least", 2 * most, np.float64))
        """It is at least so long [m]."""
        self.bulge = native.at_doubles(_new(self.arrays, "bulge", most, np.float64))
        """Sum of the squared distances of points from their faces, in variances of the noise …"""
        self.bulge_points = native.at_doubles(_new(self.arrays, "bulge_points", most, np.float64))
        """… and what that is where faces are straight."""
        self.leg_x = native.at_doubles(_new(self.arrays, "leg_x", MOST_LEGS * most, np.float64))
        self.leg_y = native.at_doubles(_new(self.arrays, "leg_y", MOST_LEGS * most, np.float64))
        """Where slim things stand beside a slim one, too few beams each to be objects [m] …"""
        self.leg_seen = native.at_longs(_new(self.arrays, "leg_seen", MOST_LEGS * most, np.int64))
        """… and in how many sightings of it they were seen."""
        self.shape_votes = native.at_doubles(_new(self.arrays, "shape_votes", 5 * most, np.float64))
        """Log-likelihood of what was seen of it, by shape."""

    def grow(self, old: Bodies) -> None:
        """Take over the bodies of what has less room."""
        self.high, self.born = old.high, old.born
        for name, values in old.arrays.items():
            self.arrays[name][: len(values)] = values


def _new(arrays: dict[str, NDArray[Any]], name: str, count: int, kind: Any) -> NDArray[Any]:
    """An array of zeros, by its name."""
    arrays[name] = np.zeros(count, kind)
    return arrays[name]


def free_slot(bodies: Bodies) -> int:
    """The first slot without a body; there is room."""
    b = 0
    while bodies.state[b] != EMPTY:
        b += 1
    bodies.high = max(bodies.high, b + 1)
    return b


def clear(bodies: Bodies, b: int) -> None:
    """A new body, of which nothing is known yet."""
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
    """Where the centre of a body is [m]."""
    return to_world(bodies, b, bodies.c[2 * b], bodies.c[2 * b + 1])


def to_world(bodies: Bodies, b: int, along: float, across: float) -> tuple[float, float]:
    """Something in the axes of a body, in the world."""
    return bodies.cos[b] * along - bodies.sin[b] * across, bodies.sin[b] * along + bodies.cos[b] * across


def to_axes(bodies: Bodies, b: int, x: float, y: float) -> tuple[float, float]:
    """Something in the world, in the axes of a body."""
    return bodies.cos[b] * x + bodies.sin[b] * y, bodies.cos[b] * y - bodies.sin[b] * x


def half_extent(bodies: Bodies, b: int, x: float, y: float) -> float:
    """How far a body reaches from its centre in a direction of the world [m]."""
    if bodies.kind[b] != BOX:
        return 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
    along, across = to_axes(bodies, b, x, y)
    return abs(along) * bodies.h[2 * b] + abs(across) * bodies.h[2 * b + 1]


def outside(bodies: Bodies, b: int, x: float, y: float) -> float:
    """How far a point is outside of a body [m], negative inside."""
    centre_x, centre_y = centre(bodies, b)
    dx, dy = x - centre_x, y - centre_y
    if bodies.kind[b] != BOX:
        return math.sqrt(dx * dx + dy * dy) - 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
    along, across = to_axes(bodies, b, dx, dy)
    return max(abs(along) - bodies.h[2 * b], abs(across) - bodies.h[2 * b + 1])


def turn(bodies: Bodies, b: int, angle: float) -> None:
    """Turn the axes of a body; what is known in the world stays."""
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
    # Of the covariance what the axes share is left out; turns from sweep to sweep are small.
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
    first, second = values[at], values[at + 1]
    values[at], values[at + 1] = keep * first + give * second, keep * second + give * first


def predict(bodies: Bodies, b: int, dt: float, creep: float) -> None:
    """Let time pass for a body [s]. `creep`: variance by which standing bodies seem to move, as poses drift [m²]."""
    if bodies.kind[b] == BOX:
        bodies.yaw_var[b] += (
            dt * (2.0 * bodies.yaw_cov[b] + dt * bodies.rate_var[b])
            + ANGULAR_ACCELERATION * dt * dt * dt / 3.0
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
    """A body that is unseen and was never shown to move stays where it is; it may begin to move at any time."""
    for a in range(2 * b, 2 * b + 2):
        bodies.c[a], bodies.h[a] = bodies.still_c[a], bodies.still_h[a]
        bodies.cc[a] = bodies.still_cc[a] + UNSEEN_VAR
        bodies.ch[a], bodies.hh[a] = bodies.still_ch[a], bodies.still_hh[a]
        bodies.v[a] = bodies.cv[a] = bodies.vh[a] = 0.0
        bodies.vv[a] = SPEED_SD * SPEED_SD
    bodies.yaw_rate[b] = 0.0


def residual(bodies: Bodies, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """What a measurement of c + sign h differs by from the expected [m], and the variance of that [m²]."""
    return (
        z - bodies.c[a] - sign * bodies.h[a],
        max(bodies.cc[a] + sign * (2.0 * bodies.ch[a] + sign * bodies.hh[a]), 0.0) + var,
    )


def still_residual(bodies: Bodies, a: int, z: float, sign: float, var: float) -> tuple[float, float]:
    """The same of the twin."""
    return (
        z - bodies.still_c[a] - sign * bodies.still_h[a],
        max(bodies.still_cc[a] + sign * (2.0 * bodies.still_ch[a] + sign * bodies.still_hh[a]), 0.0) + var,
    )


def update(bodies: Bodies, a: int, z: float, sign: float, var: float) -> None:
    """Take a measurement of c + sign h along an axis; sign is 0 for the centre itself."""
    off, s = residual(bodies, a, z, sign, var)
    if off * off > MOST_RESIDUAL * s:
        s = off * off / MOST_RESIDUAL
    p, q, w = (
        bodies.cc[a] + sign * bodies.ch[a],
        bodies.cv[a] + sign * bodies.vh[a],
        bodies.ch[a] + sign * bodies.hh[a],
    )
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
    """The same for the twin; returns the share of the measurement that its centre has taken."""
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
    """Take a measurement of a half extent."""
    gain = bodies.hh[a] / (bodies.hh[a] + var)
    off = half - bodies.h[a]
    bodies.h[a] = max(bodies.h[a] + gain * off, 0.01)
    bodies.hh[a] *= 1.0 - gain
    bodies.still_h[a], bodies.still_hh[a] = bodies.h[a], bodies.hh[a]


def update_yaw(bodies: Bodies, b: int, yaw: float, var: float) -> None:
    """Take the direction of a face, which is known up to quarter turns."""
    off = yaw - bodies.yaw[b]
    off -= QUARTER_TURN * math.floor(off / QUARTER_TURN + 0.5)
    s = bodies.yaw_var[b] + var
    if abs(off) > MOST_TURN:
        # Rather a face that was not recognised than a turn.
        s += off * off
    gain, gain_rate = bodies.yaw_var[b] / s, bodies.yaw_cov[b] / s
    turn(bodies, b, gain * off)
    bodies.yaw_rate[b] = min(max(bodies.yaw_rate[b] + gain_rate * off, -FASTEST_TURN), FASTEST_TURN)
    bodies.rate_var[b] -= gain_rate * bodies.yaw_cov[b]
    bodies.yaw_cov[b] *= 1.0 - gain
    bodies.yaw_var[b] *= 1.0 - gain


def begin_axis(bodies: Bodies, a: int, low: float, high: float, low_var: float, high_var: float) -> None:
    """Begin an axis with what is seen of its two sides [m]; a negative variance: seen to go on at least so far."""
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
    """Let the twin begin anew from what is known."""
    bodies.still_c[a], bodies.still_h[a] = bodies.c[a], bodies.h[a]
    bodies.still_cc[a], bodies.still_ch[a], bodies.still_hh[a] = bodies.cc[a], bodies.ch[a], bodies.hh[a]


class Sides:
    """What one view says of one body: of sides 0 to 3 (axis 0 low and high, axis 1 low and high) or of its centre."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.z = native.doubles(self.owner, 4)
        """Where the side is along its axis [m]."""
        self.var = native.doubles(self.owner, 4)
        """Its variance [m²], or `AT_LEAST`."""
        self.by_centre = False
        """Whether z[0] and z[2] are the centre of a disc; then `half` is its radius with the variance `half_var`."""
        self.lasting_var = 0.0
        """Variance of the centre that more sightings do not mend, as they see the same raggedness [m²]."""
        self.is_doubtful = False
        """Whether the centre is that of returns which come and go."""
        self.half = 0.0
        self.half_var = 0.0


def measure(sides: Sides, views: Views, k: int, bodies: Bodies, b: int, pose_var: float) -> None:
    """What view k says of a body.

    Parameters
    ----------
    pose_var : variance that the pose of the sensor gives to a point there [m²]
    """
    if bodies.kind[b] == DISC:
        radius = 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
        var = 0.5 * (bodies.hh[2 * b] + bodies.hh[2 * b + 1])
        measure_disc(sides, views, k, radius, var, pose_var)
    else:
        measure_box(sides, views, k, bodies.cos[b], bodies.sin[b], pose_var)


def measure_box(sides: Sides, views: Views, k: int, cos: float, sin: float, pose_var: float) -> None:
    """The sides of a rectangle whose first axis has the direction cos, sin."""
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
    """Further variance of an edge beside beams without a return, where such beams come and go [m²]."""
    return OPEN_EDGE_VAR if edge == observation.OPEN else 0.0


def _measure_face(sides: Sides, views: Views, f: int, cos: float, sin: float, pose_var: float) -> None:
    """A face is the near side of its axis."""
    x, y = views.face_x[f], views.face_y[f]
    normal_x, normal_y = views.along_y[f], -views.along_x[f]
    if normal_x * (views.x - x) + normal_y * (views.y - y) < 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    along, across = cos * normal_x + sin * normal_y, cos * normal_y - sin * normal_x
    var = views.sigma * views.sigma / views.face_points[f] + SURFACE_VAR + pose_var
    # What is not straight is not where its line is.
    var += CROOKED_SHARE * views.bulge[f] / views.face_points[f]
    if abs(along) > COS_ALONG:
        side = 1 if along > 0.0 else 0
        sides.z[side], sides.var[side] = cos * x + sin * y, var
    elif abs(across) > COS_ALONG:
        side = 3 if across > 0.0 else 2
        sides.z[side], sides.var[side] = cos * y - sin * x, var


def _measure_end(
    sides: Sides, views: Views, k: int, p: int, way: float, cos: float, sin: float, pose_var: float
) -> None:
    """Where the thing itself ends, its sides end: half a beam past the last point, on average."""
    x, y = views.point_x[p], views.point_y[p]
    far_x, far_y = x - views.x, y - views.y
    r = math.sqrt(far_x * far_x + far_y * far_y)
    if r <= 0.0:
        return
    far_x, far_y = far_x / r, far_y / r
    # Outwards, as the bearings run.
    way *= views.side
    out_x, out_y = -way * far_y, way * far_x
    # The face that ends there, if one does.
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


def measure_disc(
    sides: Sides, views: Views, k: int, radius: float, radius_var: float, pose_var: float
) -> None:
    """The centre of a disc, in the axes of the world.

    Parameters
    ----------
    radius, radius_var : what is known of its radius [m, m²]; a negative variance: nothing
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
        sides.half, sides.half_var = (
            seen,
            gap * gap / 24.0 + SURFACE_VAR + RAGGED_SHARE * RAGGED_SHARE * seen * seen,
        )
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
        # From the edge that is its own, the centre is a radius away.
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
    # Of what is round the arc tells the middle, wherever it ends.
    sides.is_doubtful = views.shape[k] != ROUND and (
        views.start[k] == observation.OPEN or views.end[k] == observation.OPEN
    )
    if sides.is_doubtful:
        across_var += _edge_doubt(views.start[k]) + _edge_doubt(views.end[k])
    depth_var += more
    sides.z[0] = sides.z[1] = centre_x
    sides.z[2] = sides.z[3] = centre_y
    sides.var[0] = sides.var[1] = mid_x * mid_x * depth_var + mid_y * mid_y * across_var
    sides.var[2] = sides.var[3] = mid_y * mid_y * depth_var + mid_x * mid_x * across_var
    observation.place_sensor(views, 0.0)


def _unit_vector(views: Views, x: float, y: float) -> tuple[float, float]:
    """Unit vector from the sensor to a point."""
    dx, dy = x - views.x, y - views.y
    r = math.sqrt(dx * dx + dy * dy)
    return (dx / r, dy / r) if r > 0.0 else (1.0, 0.0)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


class Sightings:
    """`count` sightings in the order of the log, in arrays of which `attach` tells."""

    def __init__(self) -> None:
        self.count = 0
        self.room = 0

    def attach(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Write to these arrays from now on, which are to be kept as long."""
        self.room = len(arrays["number"])
        self.number = native.at_longs(arrays["number"])
        """The number of the body."""
        self.sweep = native.at_longs(arrays["sweep"])
        """Sweeps of the topic before."""
        self.object = native.at_longs(arrays["object"])
        """Its object, counted from the first that was ever found."""
        self.centred = native.at_longs(arrays["centred"])
        """Whether z[0] and z[2] are its centre rather than sides."""
        self.time = native.at_doubles(arrays["time"])
        self.x = native.at_doubles(arrays["x"])
        self.y = native.at_doubles(arrays["y"])
        """The estimate of its centre then [m]."""
        self.cos = native.at_doubles(arrays["cos"])
        self.sin = native.at_doubles(arrays["sin"])
        """Its axes."""
        self.half_1 = native.at_doubles(arrays["half_1"])
        self.half_2 = native.at_doubles(arrays["half_2"])
        self.odds = native.at_doubles(arrays["odds"])
        """Log-odds of being a thing, by this sweep alone."""
        self.z = native.at_doubles(arrays["z"])
        self.var = native.at_doubles(arrays["var"])
        """(N, 4) the sides and their variances, see `Sides`."""


def sighting_arrays(count: int) -> dict[str, NDArray[Any]]:
    """Arrays for so many sightings."""
    arrays: dict[str, NDArray[Any]] = {name: np.zeros(count, np.int64) for name in LOG_INTEGERS}
    arrays |= {name: np.zeros(count) for name in LOG_NUMBERS}
    return arrays | {name: np.zeros((count, 4)) for name in LOG_SIDES}


def log_sighting(
    log: Sightings, bodies: Bodies, b: int, sides: Sides, sweep: int, time: float, at: int, odds: float
) -> None:
    """Write a sighting of a body; there is room."""
    i = log.count
    log.odds[i] = odds
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
