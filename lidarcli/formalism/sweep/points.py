"""Definition 1: the points of one sweep, counter-clockwise; Definition 2: the differences between them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli import native, sweeps

NEVER = 1 << 24
"""Number of lost beams between a point and a predecessor that does not exist: above every `max_gap`, in 32 bits, too."""
NAN = float("nan")
INFINITE = float("inf")
TURN = sweeps.TURN
LONGEST_GAP = 3
"""Of more lost beams in a row nobody knows whether they should have returned."""
GAP_STEP, GAP_STEP_GROWS = 0.1, 0.02
"""[m], and per metre of range: a surface goes on past a gap if its range changes by no more."""
NO_RETURN = sweeps.Status.NO_RETURN.value
OPEN, SHARED = sweeps.Closure.OPEN.value, sweeps.Closure.SHARED.value


class Scans:
    """The columns of a batch of S sweeps with up to B beams, as the loops over one sweep read them."""

    def __init__(self, batch: sweeps.SweepBatch, direction: Any, within: Any, sigma: Any) -> None:
        """`direction`: cos θ and sin θ, (D, B) each by increasing bearing, and which of them each sweep has, (S,)."""
        cos, sin, code = direction
        columns = (
            (batch.ranges, np.float32),
            (batch.status, np.uint8),
            (batch.beams, np.int32),
            (batch.closure, np.uint8),
            (batch.angle_min, np.float64),
            (batch.angle_increment, np.float64),
            (cos, np.float64),
            (sin, np.float64),
            (code, np.int64),
            (np.zeros(0) if within is None else within, np.bool_),
            (np.zeros(0) if sigma is None else sigma, np.float64),
        )
        self.owner: list[Any] = [np.require(values, kind, ["C", "A"]) for values, kind in columns]
        self.rows = len(batch)
        self.width = batch.width
        self.ranges = native.at_singles(self.owner[0])
        self.status = native.at_bytes(self.owner[1])
        self.beams = native.at_ints(self.owner[2])
        self.closure = native.at_bytes(self.owner[3])
        self.angle_min = native.at_doubles(self.owner[4])
        self.angle_increment = native.at_doubles(self.owner[5])
        self.cos = native.at_doubles(self.owner[6])
        self.sin = native.at_doubles(self.owner[7])
        self.direction = native.at_longs(self.owner[8])
        self.within = native.at_bytes(self.owner[9])
        self.sigma = native.at_doubles(self.owner[10])
        self.has_within = within is not None
        self.has_sigma = sigma is not None


class Points:
    """The `count` beams of one sweep that have a range, each bearing once, by increasing bearing.

    Position k = 0, 1, … counts the bearings counter-clockwise, whatever the sign of the increment. The first points are
    listed once more after the last, so that a segment over the seam of a full turn has consecutive points, too.
    """

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.most = most
        self.position = native.integers(self.owner, 2 * most)
        self.r = native.doubles(self.owner, 2 * most)
        self.x = native.doubles(self.owner, 2 * most)
        self.y = native.doubles(self.owner, 2 * most)
        self.s = native.doubles(self.owner, most)
        self.missing = native.integers(self.owner, most)
        self.row = 0
        self.count = 0
        self.first = 0.0
        self.step = 0.0
        self.cos_half = 1.0
        self.sin_half = 0.0
        self.sigma = 0.0
        self.d_th = 0.0
        self.flicker = 0.0
        self.beams = 0
        self.bearings = 0
        self.period = 0
        self.reverse = False


def load(points: Points, scans: Scans, row: int) -> None:
    """Lay out the sweep in a row of a batch: r on Θ_k, and where the points are [m]."""
    increment = scans.angle_increment[row]
    points.row = row
    points.beams = scans.beams[row]
    # The second beam on the first bearing says nothing new.
    points.bearings = points.beams - (scans.closure[row] == SHARED)
    points.period = 0 if scans.closure[row] == OPEN else points.bearings
    points.reverse = increment < 0
    points.step = abs(increment)
    points.cos_half, points.sin_half = math.cos(0.5 * points.step), math.sin(0.5 * points.step)
    points.first = scans.angle_min[row]
    if points.reverse:
        points.first += (points.bearings - 1) * increment

    position, r, x, y = points.position, points.r, points.x, points.y
    ranges, cos, sin = scans.ranges, scans.cos, scans.sin
    directions = scans.direction[row] * scans.width
    beam, way = row * scans.width, 1
    if points.reverse:
        beam, way = beam + points.bearings - 1, -1
    count = 0
    for k in range(points.bearings):
        distance = ranges[beam]
        position[count] = k
        r[count] = distance
        x[count] = distance * cos[directions + k]
        y[count] = distance * sin[directions + k]
        # A lost beam is NaN: the next one takes its place.
        count += distance == distance
        beam += way
    points.count = count


def repeat(points: Points, lead: int) -> None:
    """List the first `lead` points once more after the last."""
    for k in range(lead):
        points.position[points.count + k] = points.position[k]
        points.r[points.count + k] = points.r[k]
        points.x[points.count + k] = points.x[k]
        points.y[points.count + k] = points.y[k]


def bearing(points: Points, at: int) -> float:
    """θ of a point [rad]; it grows past the seam."""
    theta = points.first + points.step * points.position[at]
    return theta + TURN if at >= points.count else theta


def beam_at(points: Points, position: int) -> int:
    """Index in the log of the beam at a position, at most one turn beyond the seam on either side (Def. 1's n)."""
    if points.period > 0:
        if position >= points.period:
            position -= points.period
        elif position < 0:
            position += points.period
    return points.bearings - 1 - position if points.reverse else position


def distance(points: Points, a: int, b: int) -> float:
    """How far two points are apart [m]."""
    dx, dy = points.x[b] - points.x[a], points.y[b] - points.y[a]
    return math.sqrt(dx * dx + dy * dy)


def nearest(points: Points) -> int:
    """The point with the least range, of several the first; -1 without a point."""
    at = 0
    least = INFINITE
    for k in range(points.count):
        if points.r[k] < least:
            least = points.r[k]
            at = k
    return at if points.count > 0 else -1


def differences(points: Points) -> None:
    """Def. 2: s(θ_n) = r(θ_n) - r(θ_{n-1}) [m] and the lost beams between the two.

    The point before the first is the last one on a full turn; on a partial view there is none, and s is NaN.
    """
    position, r, s, missing = points.position, points.r, points.s, points.missing
    last = points.count - 1
    for k in range(1, points.count):
        s[k] = r[k] - r[k - 1]
    for k in range(1, points.count):
        missing[k] = position[k] - position[k - 1] - 1
    if points.period > 0 and last > 0:
        s[0] = r[0] - r[last]
        missing[0] = position[0] + points.period - position[last] - 1
    else:
        s[0] = NAN
        missing[0] = NEVER


def flicker(points: Points, scans: Scans) -> float:
    """The share of the beams of a sweep that should have returned and did not: short gaps in what goes on past them."""
    gone = 0
    for k in range(points.count):
        lost = points.missing[k]
        if lost == 0 or lost > LONGEST_GAP:
            continue
        nearer = min(points.r[k], points.r[k] - points.s[k])
        if abs(points.s[k]) > GAP_STEP + GAP_STEP_GROWS * nearer:
            continue
        for back in range(1, lost + 1):
            beam = beam_at(points, points.position[k] - back)
            if beam >= 0 and scans.status[points.row * scans.width + beam] == NO_RETURN:
                gone += 1
    return gone / max(gone + points.count, 1.0)


def mean_difference(points: Points) -> float:
    """Def. 3's d_th = (1/N) Σ |s(θ_n)| [m], N the number of neighbouring beams that both have a range; 0 without any."""
    s, missing = points.s, points.missing
    total, number = 0.0, 0
    for k in range(points.count):
        if missing[k] == 0:
            total += abs(s[k])
            number += 1
    return total / number if number > 0 else 0.0
