"""Kalman filters of the targets.

A target is a rectangle with the half extents h along two axes, or a disc. Along each axis a filter estimates its centre
c, velocity v and half extent h, because a side measures only c + h or c - h: no reference point can jump from corner to
corner. A *static model* estimates c and h as if the target was static; motion has to be shown against it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.tracking import measurement, results
from lidarcli.formalism.tracking.measurement import EdgeMeasurement, Measurements
from lidarcli.system import native

EMPTY, LIVE, ENDED = results.EMPTY, results.LIVE, results.ENDED
DISC, BOX, PERSON = results.DISC, results.BOX, results.PERSON
MAX_LEGS = results.MAX_LEGS
QUARTER_TURN = 0.5 * math.pi
ACCELERATION, ANGULAR_ACCELERATION = 0.6, 0.02
"""[m²/s³], [rad²/s³] Spectral densities of a target's acceleration and angular acceleration."""
EXTENT_GROWTH, STANDING_GROWTH = 1e-5, 1e-7
"""[m²/s] Growth of the variance of a half extent, as of a plant in the wind, and of a static target's place, as poses
err."""
SPEED_SD, TURN_RATE_SD = 0.7, 0.15
"""[m/s], [rad/s] Standard deviations of the velocity and the turn rate of a new target."""
MAX_TURN, FASTEST_TURN = math.radians(15.0), 2.0
"""Greatest turn of a target from one sweep to the next [rad], and greatest turn rate [rad/s]."""
UNSEEN_VAR = 0.0025
"""[m²] Variance that is added to the place of a static target while it is not observed: (5 cm)²."""
MAX_RESIDUAL, MIN_VAR = 16.0, 1e-8
"""Greatest squared residual, as a multiple of its variance: a larger one counts as this; least variance, against rounding
[m²]."""
NEW_EXTENT = 0.15
"""[m] Length that a new target may go on beyond an end that was not observed."""
LOG_INTEGERS = ("number", "sweep", "sensor", "object", "centred", "whole")
LOG_NUMBERS = (
    *("time", "x", "y", "cos", "sin", "half_1", "half_2", "chord"),
    *("middle_x", "middle_y", "ahead", "left", "sensor_x", "sensor_y", "travelled"),
)
LOG_SIDES = ("z", "var")


class Targets:
    """Arrays of `capacity` slots, one for each target. Values along axis i of target b stand at 2 b + i."""

    def __init__(self, capacity: int) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        """All arrays, by name."""
        self.capacity = capacity
        self.slots_used = 0
        """Slot from which on all slots are empty."""
        self.last_number = 0
        """Number of targets so far; a new target gets the next number."""
        self.state = native.at_longs(_new(self.arrays, "state", capacity, np.int64))
        self.number = native.at_longs(_new(self.arrays, "number", capacity, np.int64))
        self.kind = native.at_longs(_new(self.arrays, "kind", capacity, np.int64))
        self.sightings = native.at_longs(_new(self.arrays, "sightings", capacity, np.int64))
        """Number of sweeps that observed it."""
        self.kind_hits = native.at_longs(_new(self.arrays, "kind_hits", capacity, np.int64))
        """Number of sightings since its kind was chosen; of a person, its legs in this sweep."""
        self.boxy = native.at_longs(_new(self.arrays, "boxy", capacity, np.int64))
        """Number of sightings as a box with enough beams while it is a disc; of a person, sightings of one leg."""
        self.whole = native.at_longs(_new(self.arrays, "whole", capacity, np.int64))
        """Number of sightings with both edges its own; of a person, with two legs."""
        self.moved = native.at_longs(_new(self.arrays, "moved", capacity, np.int64))
        self.inside = native.at_longs(_new(self.arrays, "inside", capacity, np.int64))
        """Number of sweeps missed inside an older target that was hit, less those with a hit."""
        self.same_as = native.at_longs(_new(self.arrays, "same_as", capacity, np.int64))
        """Number of the older target, or of the person of a leg; 0 for none."""
        self.member = native.at_longs(_new(self.arrays, "member", capacity, np.int64))
        """Number of the person that it is a leg of, 0 for none."""
        self.sensors = native.at_longs(_new(self.arrays, "sensors", capacity, np.int64))
        """Bits of the sensors that have observed it."""
        self.measurement = native.at_longs(_new(self.arrays, "measurement", capacity, np.int64))
        """Measurement in this sweep, -1 for none."""
        self.first_sweep = native.at_longs(_new(self.arrays, "first_sweep", capacity, np.int64))
        self.last_sweep = native.at_longs(_new(self.arrays, "last_sweep", capacity, np.int64))
        self.onset = native.at_longs(_new(self.arrays, "onset", capacity, np.int64))
        """Last sweep without evidence of motion."""
        self.end = native.at_longs(_new(self.arrays, "end", capacity, np.int64))
        """Reason for its end, an index into `results.ENDS`."""
        self.size = native.at_doubles(_new(self.arrays, "size", capacity, np.float64))
        """Mean diagonal of its box, by measurements with both edges its own [m]."""
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
        """Centre and half extent of the static model along each axis, and their covariance."""
        self.jacobian = native.at_doubles(_new(self.arrays, "jacobian", 6 * capacity, np.float64))
        """Derivative of the place of the static model by the error of the poses, three numbers for each axis."""
        self.side = native.at_doubles(_new(self.arrays, "side", 2 * capacity, np.float64))
        self.side_weight = native.at_doubles(_new(self.arrays, "side_weight", 2 * capacity, np.float64))
        """Mean extent by sightings of both ends, and their weight [m, 1/m²]."""
        self.least = native.at_doubles(_new(self.arrays, "least", 2 * capacity, np.float64))
        """Least length along each axis [m]."""
        self.bulge = native.at_doubles(_new(self.arrays, "bulge", capacity, np.float64))
        """Sum of the squared distances of points from their faces, in variances of the noise."""
        self.bulge_points = native.at_doubles(_new(self.arrays, "bulge_points", capacity, np.float64))
        """Expected value of that sum for straight faces."""
        self.leg_x = native.at_doubles(_new(self.arrays, "leg_x", MAX_LEGS * capacity, np.float64))
        self.leg_y = native.at_doubles(_new(self.arrays, "leg_y", MAX_LEGS * capacity, np.float64))
        """Mean places of legs next to it that are too slim to be objects [m]."""
        self.leg_hits = native.at_longs(_new(self.arrays, "leg_hits", MAX_LEGS * capacity, np.int64))
        """Number of sightings of each of these legs."""
        self.shape_votes = native.at_doubles(_new(self.arrays, "shape_votes", 5 * capacity, np.float64))
        """Votes of its measurements, by shape."""

    def grow(self, old: Targets) -> None:
        """Copy the targets of `old`, which has less capacity."""
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
    """Initiate a target in a slot."""
    targets.last_number += 1
    targets.number[b] = targets.last_number
    targets.state[b] = LIVE
    targets.sightings[b] = targets.kind_hits[b] = targets.boxy[b] = targets.whole[b] = 0
    targets.moved[b] = targets.inside[b] = targets.same_as[b] = targets.member[b] = targets.sensors[b] = 0
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
    for i in range(MAX_LEGS * b, MAX_LEGS * b + MAX_LEGS):
        targets.leg_x[i] = targets.leg_y[i] = 0.0
        targets.leg_hits[i] = 0


def mark_seen(targets: Targets, b: int, sensor: int) -> None:
    """Note that a sensor has observed a target."""
    one = 1
    targets.sensors[b] |= one << sensor


def has_seen(targets: Targets, b: int, sensor: int) -> bool:
    """Return whether a sensor has ever observed a target: one that is mounted higher may look over it."""
    return (targets.sensors[b] >> sensor) & 1 == 1


def centre(targets: Targets, b: int) -> tuple[float, float]:
    """Return the centre of a target in the world [m]."""
    return to_world(targets, b, targets.c[2 * b], targets.c[2 * b + 1])


def to_world(targets: Targets, b: int, along: float, across: float) -> tuple[float, float]:
    """Return a vector in the axes of a target as one in the world."""
    return targets.cos[b] * along - targets.sin[b] * across, targets.sin[b] * along + targets.cos[b] * across


def to_axes(targets: Targets, b: int, x: float, y: float) -> tuple[float, float]:
    """Return a vector in the world as one in the axes of a target."""
    return targets.cos[b] * x + targets.sin[b] * y, targets.cos[b] * y - targets.sin[b] * x


def half_extent(targets: Targets, b: int, x: float, y: float) -> float:
    """Return the half extent of a target in a direction of the world, given as a unit vector [m]."""
    if targets.kind[b] != BOX:
        return 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
    along, across = to_axes(targets, b, x, y)
    return abs(along) * targets.h[2 * b] + abs(across) * targets.h[2 * b + 1]


def outside(targets: Targets, b: int, x: float, y: float) -> float:
    """Return the distance of a point from a target [m], negative inside."""
    centre_x, centre_y = centre(targets, b)
    dx, dy = x - centre_x, y - centre_y
    if targets.kind[b] != BOX:
        return math.sqrt(dx * dx + dy * dy) - 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
    along, across = to_axes(targets, b, dx, dy)
    return max(abs(along) - targets.h[2 * b], abs(across) - targets.h[2 * b + 1])


def turn(targets: Targets, b: int, angle: float) -> None:
    """Turn the axes of a target; its estimates in the world stay the same."""
    cos, sin = math.cos(angle), math.sin(angle)
    one, other = 2 * b, 2 * b + 1
    _rotate(targets.c, one, other, cos, sin)
    _rotate(targets.v, one, other, cos, sin)
    _rotate(targets.static_c, one, other, cos, sin)
    for i in range(3 * one, 3 * one + 3):
        _rotate(targets.jacobian, i, i + 3, cos, sin)
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


def _rotate(values: Any, one: int, other: int, cos: float, sin: float) -> None:
    """Turn a vector, whose numbers are at two places."""
    first, second = values[one], values[other]
    values[one], values[other] = cos * first + sin * second, cos * second - sin * first


def _mix(values: Any, at: int, keep: float, give: float) -> None:
    """Mix the values of both axes."""
    first, second = values[at], values[at + 1]
    values[at], values[at + 1] = keep * first + give * second, keep * second + give * first


def predict(targets: Targets, b: int, dt: float, drift_var: float) -> None:
    """Predict a target after a time dt [s]. `drift_var`: variance that is added to static targets as poses drift [m²]."""
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
    """Stop a target that is missed and never moved; it may begin to move at any time."""
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
    """Return the residual of a measurement of c + sign h for the static model [m], and its variance [m²]."""
    return (
        z - targets.static_c[a] - sign * targets.static_h[a],
        max(targets.static_cc[a] + sign * (2.0 * targets.static_ch[a] + sign * targets.static_hh[a]), 0.0) + var,
    )


def update(targets: Targets, a: int, z: float, sign: float, var: float) -> None:
    """Update an axis with a measurement of c + sign h; sign is 0 for the centre itself."""
    off, s = residual(targets, a, z, sign, var)
    if off * off > MAX_RESIDUAL * s:
        s = off * off / MAX_RESIDUAL
    p, q, w = (
        targets.cc[a] + sign * targets.ch[a],
        targets.cv[a] + sign * targets.vh[a],
        targets.ch[a] + sign * targets.hh[a],
    )
    gain_c, gain_v, gain_h = p / s, q / s, w / s
    targets.c[a] += gain_c * off
    targets.v[a] += gain_v * off
    targets.h[a] = max(targets.h[a] + gain_h * off, 0.01)
    targets.cc[a] = max(targets.cc[a] - gain_c * p, MIN_VAR)
    targets.cv[a] -= gain_c * q
    targets.ch[a] -= gain_c * w
    targets.vv[a] = max(targets.vv[a] - gain_v * q, MIN_VAR)
    targets.vh[a] -= gain_v * w
    targets.hh[a] = max(targets.hh[a] - gain_h * w, MIN_VAR)


def update_static(targets: Targets, a: int, z: float, sign: float, var: float) -> float:
    """Update the static model with a measurement of c + sign h; return the gain of its centre."""
    off, s = static_residual(targets, a, z, sign, var)
    if off * off > MAX_RESIDUAL * s:
        s = off * off / MAX_RESIDUAL
    p, w = targets.static_cc[a] + sign * targets.static_ch[a], targets.static_ch[a] + sign * targets.static_hh[a]
    gain_c, gain_h = p / s, w / s
    targets.static_c[a] += gain_c * off
    targets.static_h[a] = max(targets.static_h[a] + gain_h * off, 0.01)
    targets.static_cc[a] = max(targets.static_cc[a] - gain_c * p, MIN_VAR)
    targets.static_ch[a] -= gain_c * w
    targets.static_hh[a] = max(targets.static_hh[a] - gain_h * w, MIN_VAR)
    return gain_c


def update_extent(targets: Targets, a: int, half: float, var: float) -> None:
    """Update an axis with a measurement of its half extent."""
    gain = targets.hh[a] / (targets.hh[a] + var)
    off = half - targets.h[a]
    targets.h[a] = max(targets.h[a] + gain * off, 0.01)
    targets.hh[a] *= 1.0 - gain
    targets.static_h[a], targets.static_hh[a] = targets.h[a], targets.hh[a]


def update_yaw(targets: Targets, b: int, yaw: float, var: float) -> None:
    """Update the direction of a target with that of a face, which is known up to quarter turns."""
    off = yaw - targets.yaw[b]
    off -= QUARTER_TURN * math.floor(off / QUARTER_TURN + 0.5)
    s = targets.yaw_var[b] + var
    if abs(off) > MAX_TURN:
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
    """Reset the static model to the estimate of the target."""
    targets.static_c[a], targets.static_h[a] = targets.c[a], targets.h[a]
    targets.static_cc[a], targets.static_ch[a], targets.static_hh[a] = targets.cc[a], targets.ch[a], targets.hh[a]


def measure(sides: EdgeMeasurement, meas: Measurements, k: int, targets: Targets, b: int, pose_var: float) -> None:
    """Measure a target by measurement k.

    Parameters
    ----------
    pose_var : variance of a point there from the error of the pose [m²]
    """
    if targets.kind[b] == DISC:
        radius = 0.5 * (targets.h[2 * b] + targets.h[2 * b + 1])
        var = 0.5 * (targets.hh[2 * b] + targets.hh[2 * b + 1])
        measurement.measure_disc(sides, meas, k, radius, var, pose_var)
    else:
        measurement.measure_box(sides, meas, k, targets.cos[b], targets.sin[b], pose_var)


class Sightings:
    """Sightings (`count` of them) until their windows are closed; there is room for `capacity`."""

    def __init__(self) -> None:
        self.count = 0
        self.capacity = 0
        self.arrays: dict[str, NDArray[Any]] = {}
        """All arrays, by name."""

    def resize(self, capacity: int) -> None:
        """Make room for so many sightings; those so far are kept."""
        old, self.capacity = self.arrays, capacity
        arrays: dict[str, NDArray[Any]] = {name: np.zeros(capacity, np.int64) for name in LOG_INTEGERS}
        arrays |= {name: np.zeros(capacity) for name in LOG_NUMBERS} | {name: np.zeros((capacity, 4)) for name in LOG_SIDES}
        self.arrays = arrays
        for name, values in old.items():
            arrays[name][: len(values)] = values
        self.number = native.at_longs(arrays["number"])
        """Number of the target."""
        self.sweep = native.at_longs(arrays["sweep"])
        """Number of sweeps before."""
        self.sensor = native.at_longs(arrays["sensor"])
        self.object = native.at_longs(arrays["object"])
        """Number of objects before its own, in the order in which they were observed."""
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
        self.middle_x = native.at_doubles(arrays["middle_x"])
        self.middle_y = native.at_doubles(arrays["middle_y"])
        """Middle of the view in the world [m]."""
        self.ahead = native.at_doubles(arrays["ahead"])
        self.left = native.at_doubles(arrays["left"])
        """The same in the frame of the sensor [m]."""
        self.sensor_x = native.at_doubles(arrays["sensor_x"])
        self.sensor_y = native.at_doubles(arrays["sensor_y"])
        """Place of the sensor at the time [m]."""
        self.travelled = native.at_doubles(arrays["travelled"])
        """Distance that the sensor had gone [m]."""
        self.z = native.at_doubles(arrays["z"])
        self.var = native.at_doubles(arrays["var"])
        """(N, 4) sides and their variances, as in `Sides`."""


def record_sighting(
    sightings: Sightings, targets: Targets, b: int, sides: EdgeMeasurement, meas: Measurements, k: int, objects: int
) -> None:
    """Record a sighting of a target by measurement k; there is room. `objects`: number of objects before its batch."""
    i = meas.sighting[k] = sightings.count
    sightings.whole[i] = 0
    if meas.start[k] != measurement.HIDDEN and meas.end[k] != measurement.HIDDEN:
        sightings.whole[i] = 1
    sightings.chord[i] = meas.chord[k]
    sightings.number[i], sightings.object[i] = targets.number[b], objects + meas.object[k]
    sightings.sweep[i], sightings.time[i], sightings.sensor[i] = meas.sweep, meas.time, meas.sensor
    sightings.x[i], sightings.y[i] = centre(targets, b)
    sightings.cos[i], sightings.sin[i] = targets.cos[b], targets.sin[b]
    sightings.half_1[i], sightings.half_2[i] = targets.h[2 * b], targets.h[2 * b + 1]
    sightings.middle_x[i], sightings.middle_y[i] = meas.middle_x[k], meas.middle_y[k]
    measurement.place_sensor(meas, meas.share[k])
    sightings.ahead[i], sightings.left[i] = measurement.ahead_and_left(meas, meas.middle_x[k], meas.middle_y[k])
    sightings.sensor_x[i], sightings.sensor_y[i] = meas.x, meas.y
    measurement.place_sensor(meas, 0.0)
    sightings.travelled[i] = meas.travelled
    sightings.centred[i] = 1 if sides.by_centre else 0
    for side in range(4):
        sightings.z[4 * i + side], sightings.var[4 * i + side] = sides.z[side], sides.var[side]
    sightings.count += 1
