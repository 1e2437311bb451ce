"""The things that are followed: where each is, how fast, how large, in the axes of its own sides.

A body is a rectangle with the half extents h along two axes, or a disc. Along each axis its centre c, velocity v and half
extent h are estimated by a filter of their own, as a side of the body is a measurement of c + h or c - h alone. Beside it a
twin that stands still is kept, against which motion has to be shown.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli import native
from lidarcli.formalism.tracking import tracked

EMPTY, LIVE, ENDED = tracked.EMPTY, tracked.LIVE, tracked.ENDED
DISC, BOX, PERSON = tracked.DISC, tracked.BOX, tracked.PERSON
ACCELERATION = 0.6
"""[m²/s³] Spectral density of a body's acceleration."""
BREATHING = 1e-5
"""[m²/s] How fast the variance of a half extent grows: a plant in the wind."""
CREEP = 1e-7
"""[m²/s] The same of where a standing body is, for what the poses do not tell."""
SPEED_AT_FIRST = 0.7
"""[m/s] Standard deviation of a velocity before anything is known."""
TURNING = 0.02
"""[rad²/s³] Spectral density of the angular acceleration of a body."""
ASKEW = math.radians(15.0)
"""No body turns by more than this from one sweep to the next."""
FASTEST_TURN = 2.0
"""[rad/s] Nothing that is followed turns faster."""
TURN_AT_FIRST = 0.15
"""[rad/s] Standard deviation of a turn rate before anything is known."""
UNSEEN = 0.0025
"""[m²] Variance of where a standing body is that nobody sees: (5 cm)²."""
UNLIKELY = 16.0
"""Squared residuals above this share of their variance are not believed."""
LEAST = 1e-8
"""No variance becomes smaller than this by rounding [m²]."""
LEGS = tracked.LEGS
QUARTER = 0.5 * math.pi


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
        """Why it ended (`tracked.ENDS`)."""
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
        self.leg_x = native.at_doubles(_new(self.arrays, "leg_x", LEGS * most, np.float64))
        self.leg_y = native.at_doubles(_new(self.arrays, "leg_y", LEGS * most, np.float64))
        """Where slim things stand beside a slim one, too few beams each to be objects [m] …"""
        self.leg_seen = native.at_longs(_new(self.arrays, "leg_seen", LEGS * most, np.int64))
        """… and in how many sightings of it they were seen."""
        self.looks = native.at_doubles(_new(self.arrays, "looks", 5 * most, np.float64))
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
        bodies.looks[i] = 0.0
    for i in range(LEGS * b, LEGS * b + LEGS):
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
            dt * (2.0 * bodies.yaw_cov[b] + dt * bodies.rate_var[b]) + TURNING * dt * dt * dt / 3.0
        )
        bodies.yaw_cov[b] += dt * bodies.rate_var[b] + 0.5 * TURNING * dt * dt
        bodies.rate_var[b] += TURNING * dt
        if bodies.yaw_rate[b] != 0.0:
            turn(bodies, b, bodies.yaw_rate[b] * dt)
    for a in range(2 * b, 2 * b + 2):
        bodies.c[a] += dt * bodies.v[a]
        bodies.cc[a] += dt * (2.0 * bodies.cv[a] + dt * bodies.vv[a]) + ACCELERATION * dt * dt * dt / 3.0
        bodies.cv[a] += dt * bodies.vv[a] + 0.5 * ACCELERATION * dt * dt
        bodies.ch[a] += dt * bodies.vh[a]
        bodies.vv[a] += ACCELERATION * dt
        bodies.hh[a] += BREATHING * dt
        bodies.still_cc[a] += CREEP * dt + creep
        bodies.still_hh[a] += BREATHING * dt


def rest(bodies: Bodies, b: int) -> None:
    """A body that is unseen and was never shown to move stays where it is; it may begin to move at any time."""
    for a in range(2 * b, 2 * b + 2):
        bodies.c[a], bodies.h[a] = bodies.still_c[a], bodies.still_h[a]
        bodies.cc[a] = bodies.still_cc[a] + UNSEEN
        bodies.ch[a], bodies.hh[a] = bodies.still_ch[a], bodies.still_hh[a]
        bodies.v[a] = bodies.cv[a] = bodies.vh[a] = 0.0
        bodies.vv[a] = SPEED_AT_FIRST * SPEED_AT_FIRST
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
    if off * off > UNLIKELY * s:
        s = off * off / UNLIKELY
    p, q, w = (
        bodies.cc[a] + sign * bodies.ch[a],
        bodies.cv[a] + sign * bodies.vh[a],
        bodies.ch[a] + sign * bodies.hh[a],
    )
    gain_c, gain_v, gain_h = p / s, q / s, w / s
    bodies.c[a] += gain_c * off
    bodies.v[a] += gain_v * off
    bodies.h[a] = max(bodies.h[a] + gain_h * off, 0.01)
    bodies.cc[a] = max(bodies.cc[a] - gain_c * p, LEAST)
    bodies.cv[a] -= gain_c * q
    bodies.ch[a] -= gain_c * w
    bodies.vv[a] = max(bodies.vv[a] - gain_v * q, LEAST)
    bodies.vh[a] -= gain_v * w
    bodies.hh[a] = max(bodies.hh[a] - gain_h * w, LEAST)


def update_still(bodies: Bodies, a: int, z: float, sign: float, var: float) -> float:
    """The same for the twin; returns the share of the measurement that its centre has taken."""
    off, s = still_residual(bodies, a, z, sign, var)
    if off * off > UNLIKELY * s:
        s = off * off / UNLIKELY
    p, w = bodies.still_cc[a] + sign * bodies.still_ch[a], bodies.still_ch[a] + sign * bodies.still_hh[a]
    gain_c, gain_h = p / s, w / s
    bodies.still_c[a] += gain_c * off
    bodies.still_h[a] = max(bodies.still_h[a] + gain_h * off, 0.01)
    bodies.still_cc[a] = max(bodies.still_cc[a] - gain_c * p, LEAST)
    bodies.still_ch[a] -= gain_c * w
    bodies.still_hh[a] = max(bodies.still_hh[a] - gain_h * w, LEAST)
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
    off -= QUARTER * math.floor(off / QUARTER + 0.5)
    s = bodies.yaw_var[b] + var
    if abs(off) > ASKEW:
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
    # Of what is not seen to end nobody knows how far it goes on.
    unknown = 0.15
    bodies.v[a] = 0.0
    bodies.cv[a] = bodies.vh[a] = 0.0
    bodies.vv[a] = SPEED_AT_FIRST * SPEED_AT_FIRST
    if low_var >= 0.0 and high_var >= 0.0:
        bodies.c[a], bodies.h[a] = 0.5 * (low + high), max(half, 0.01)
        bodies.cc[a] = bodies.hh[a] = 0.25 * (low_var + high_var)
        bodies.ch[a] = 0.25 * (high_var - low_var)
    elif high_var >= 0.0:
        bodies.h[a] = max(half, 0.05) + 0.5 * unknown
        bodies.c[a] = high - bodies.h[a]
        bodies.hh[a] = unknown * unknown
        bodies.cc[a], bodies.ch[a] = bodies.hh[a] + high_var, -bodies.hh[a]
    elif low_var >= 0.0:
        bodies.h[a] = max(half, 0.05) + 0.5 * unknown
        bodies.c[a] = low + bodies.h[a]
        bodies.hh[a] = unknown * unknown
        bodies.cc[a], bodies.ch[a] = bodies.hh[a] + low_var, bodies.hh[a]
    else:
        bodies.c[a], bodies.h[a] = 0.5 * (low + high), max(half, 0.05) + 0.5 * unknown
        bodies.hh[a] = bodies.cc[a] = unknown * unknown
        bodies.ch[a] = 0.0
    stand_still(bodies, a)


def stand_still(bodies: Bodies, a: int) -> None:
    """Let the twin begin anew from what is known."""
    bodies.still_c[a], bodies.still_h[a] = bodies.c[a], bodies.h[a]
    bodies.still_cc[a], bodies.still_ch[a], bodies.still_hh[a] = bodies.cc[a], bodies.ch[a], bodies.hh[a]
