"""Places and velocities of a track by what was seen before and after: a Kalman filter forward, then a smoother backward."""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.tracking import results

BOX = results.BOX
INFINITY = float("inf")
ACCELERATIONS = (0.02, 0.1, 0.4)
"""[m²/s³] Spectral densities of the acceleration that are tried: a parcel on a belt, a stroll, starts and stops."""
LIVELINESSES = len(ACCELERATIONS)
AROUND_SIGHTINGS = 20
"""Sightings before and after one that decide which acceleration fits."""
LIVELIER_GAIN = 4.0
"""Least gain of twice the log-likelihood for which the next larger acceleration is taken."""
FIRST_SPEED_SD = 1.0
"""[m/s] Standard deviation of a velocity at first."""
UNKNOWN_VAR = 100.0
"""[m²] Variance of a side that was not seen."""
PART_VAR = 0.0625
"""[m²] Variance of the place of one leg in a track of several: (25 cm)²."""
CHANGE_VAR = 0.0025
"""[m²] Variance that is added while a box was still taken for a disc: (5 cm)²."""
MOST_MISFIT = 6.0
"""Greatest squared residual, as a multiple of its variance. A larger one counts as this."""
LEAST_SPEED = 0.1
"""[m/s] Least speed of what moves."""
MOVING_SDS = 2.0
"""Least speed of what moves, in standard deviations."""


class Smoother:
    """Room for the sightings of one track: places, and estimates along each axis of the world."""

    def __init__(self, most: int) -> None:
        self.owner: list[Any] = []
        self.most = most
        self.z = native.doubles(self.owner, 2 * most)
        self.var = native.doubles(self.owner, 2 * most)
        """Measured place along x and y [m], and its variance [m²]."""
        self.v = native.doubles(self.owner, 2 * most)
        self.v_var = native.doubles(self.owner, 2 * most)
        """Smoothed velocity at each sighting [m/s], and its variance."""
        self.liveliness = native.doubles(self.owner, LIVELINESSES)
        for i, value in enumerate(ACCELERATIONS):
            self.liveliness[i] = value
        self.acceleration = native.doubles(self.owner, most)
        """Spectral density of the acceleration of the step to each sighting [m²/s³]."""
        self.misfit = native.doubles(self.owner, LIVELINESSES * most)
        """Misfit of each sighting with each of the accelerations, twice the negative log-likelihood."""
        self.x = native.doubles(self.owner, most)
        self.speed = native.doubles(self.owner, most)
        self.xx = native.doubles(self.owner, most)
        self.xv = native.doubles(self.owner, most)
        self.vv = native.doubles(self.owner, most)
        """Forward estimate of place and speed at each sighting, and its covariance."""

    def locate(
        self, begin: int, sighted: dict[str, Any], half: Any, half_var: Any, kind: int, several: bool
    ) -> int:
        """Write the places of a body at its sightings, from `begin` on; return the begin of the next body.

        Parameters
        ----------
        sighted : arrays (N,) `centred`, `cos`, `sin`, `half_1`, `half_2` and (N, 4) `z`, `var` as `Sightings` has them
        half, half_var : (2,) half extents by all sightings, and their variances [m, m²]
        kind : kind of the body
        several : True for one of several parts
        """
        count = len(sighted["centred"])
        locate_sightings(
            self,
            begin,
            count,
            native.at_longs(sighted["centred"]),
            native.at_doubles(sighted["cos"]),
            native.at_doubles(sighted["sin"]),
            native.at_doubles(sighted["half_1"]),
            native.at_doubles(sighted["half_2"]),
            native.at_doubles(sighted["z"]),
            native.at_doubles(sighted["var"]),
            native.at_doubles(half),
            native.at_doubles(half_var),
            kind,
            PART_VAR if several else 0.0,
        )
        return begin + count

    def smooth(
        self, order: Any, time: Any, state: Any, keep: int, onset: int, vx: Any, vy: Any, moving: Any
    ) -> None:
        """Fill in vx, vy (N,) float64 [m/s] and moving (N,) uint8 for the located sightings, in the order of time.

        Parameters
        ----------
        order : (N,) int64 indices of the located sightings in the order of time
        time : (N,) times in that order [s]
        state : (12,) time, x, v and covariance xx, xv, vv after the sighting before the first, for x and for y; xx < 0 for
            none. On return, the state after sighting `keep` - 1
        keep : number of sightings after which the state is kept
        onset : index of the first sighting that may move
        """
        lead, at = native.at_longs(order), native.at_doubles(time)
        known = native.at_doubles(state)
        out_x, out_y, flags = native.at_doubles(vx), native.at_doubles(vy), native.at_bytes(moving)
        count = len(time)
        smooth_axis(self, 0, lead, at, known, count, keep)
        smooth_axis(self, 1, lead, at, known, count, keep)
        decide_motion(self, count, onset, out_x, out_y, flags)


def locate_sightings(
    room: Smoother,
    begin: int,
    count: int,
    centred: Any,
    cos: Any,
    sin: Any,
    half_1: Any,
    half_2: Any,
    z: Any,
    var: Any,
    half: Any,
    half_var: Any,
    kind: int,
    more: float,
) -> None:
    """Compute the places of a body in the world, by the sides that were seen."""
    for i in range(count):
        c, s = cos[i], sin[i]
        middle_1, noise_1 = centre_of(
            z[4 * i],
            z[4 * i + 1],
            var[4 * i],
            var[4 * i + 1],
            half[0] if kind == BOX else half_1[i],
            half_var[0],
        )
        middle_2, noise_2 = centre_of(
            z[4 * i + 2],
            z[4 * i + 3],
            var[4 * i + 2],
            var[4 * i + 3],
            half[1] if kind == BOX else half_2[i],
            half_var[1],
        )
        if centred[i]:
            middle_1, noise_1 = z[4 * i], var[4 * i]
            middle_2, noise_2 = z[4 * i + 2], var[4 * i + 2]
            if kind == BOX:
                noise_1 += CHANGE_VAR
                noise_2 += CHANGE_VAR
        at = 2 * (begin + i)
        room.z[at], room.z[at + 1] = c * middle_1 - s * middle_2, s * middle_1 + c * middle_2
        room.var[at] = c * c * noise_1 + s * s * noise_2 + more
        room.var[at + 1] = s * s * noise_1 + c * c * noise_2 + more


def centre_of(
    low: float, high: float, low_var: float, high_var: float, half: float, half_var: float
) -> tuple[float, float]:
    """Return the middle between two sides, of which one may be unknown, and its variance."""
    middle, noise = 0.5 * (low + high), UNKNOWN_VAR
    if low_var >= 0.0 and high_var >= 0.0:
        noise = 0.25 * (low_var + high_var)
    elif low_var >= 0.0:
        middle, noise = low + half, low_var + half_var
    elif high_var >= 0.0:
        middle, noise = high - half, high_var + half_var
    return middle, noise


def smooth_axis(room: Smoother, axis: int, order: Any, time: Any, state: Any, count: int, keep: int) -> None:
    """Smooth along one axis of the world, at each time with the acceleration that fits the sightings around it best."""
    for c in range(LIVELINESSES):
        for i in range(count):
            room.acceleration[i] = room.liveliness[c]
        filter_forward(room, axis, order, time, state, count, 0, c)
    choose_accelerations(room, count)
    filter_forward(room, axis, order, time, state, count, keep, -1)
    smooth_backward(room, axis, time, count)


def choose_accelerations(room: Smoother, count: int) -> None:
    """Choose the acceleration of each step by the least misfit over the sightings around it."""
    for i in range(count):
        first, stop = max(i - AROUND_SIGHTINGS, 0), min(i + AROUND_SIGHTINGS + 1, count)
        best, least = 0, INFINITY
        for c in range(LIVELINESSES):
            total = c * LIVELIER_GAIN
            for k in range(first, stop):
                total += room.misfit[c * room.most + k]
            if total < least:
                best, least = c, total
        room.acceleration[i] = room.liveliness[best]


def filter_forward(
    room: Smoother, axis: int, order: Any, time: Any, state: Any, count: int, keep: int, trial: int
) -> None:
    """Estimate place and speed at each sighting by those before it; for a trial, also the misfit of each sighting."""
    first = 2 * order[0] + axis
    known = state[6 * axis + 3] >= 0.0
    begin, place, speed = time[0], room.z[first], 0.0
    xx, xv, vv = room.var[first], 0.0, FIRST_SPEED_SD * FIRST_SPEED_SD
    if known:
        begin, place, speed = state[6 * axis], state[6 * axis + 1], state[6 * axis + 2]
        xx, xv, vv = state[6 * axis + 3], state[6 * axis + 4], state[6 * axis + 5]
    for i in range(count):
        if trial >= 0:
            room.misfit[trial * room.most + i] = 0.0
        if i > 0 or known:
            dt, acceleration = time[i] - begin, room.acceleration[i]
            place += dt * speed
            xx += dt * (2.0 * xv + dt * vv) + acceleration * dt * dt * dt / 3.0
            xv += dt * vv + 0.5 * acceleration * dt * dt
            vv += acceleration * dt
            at = 2 * order[i] + axis
            off, s = room.z[at] - place, xx + room.var[at]
            if trial >= 0:
                room.misfit[trial * room.most + i] = min(off * off / s, MOST_MISFIT) + math.log(s)
            if off * off > MOST_MISFIT * s:
                s = off * off / MOST_MISFIT
            gain, gain_v = xx / s, xv / s
            place += gain * off
            speed += gain_v * off
            vv -= gain_v * xv
            xv -= gain * xv
            xx -= gain * xx
        begin = time[i]
        room.x[i], room.speed[i] = place, speed
        room.xx[i], room.xv[i], room.vv[i] = xx, xv, vv
        if i == keep - 1:
            state[6 * axis], state[6 * axis + 1], state[6 * axis + 2] = begin, place, speed
            state[6 * axis + 3], state[6 * axis + 4], state[6 * axis + 5] = xx, xv, vv


def smooth_backward(room: Smoother, axis: int, time: Any, count: int) -> None:
    """Smooth the speeds by the sightings after each one too (Rauch, Tung and Striebel)."""
    last = count - 1
    place, speed = room.x[last], room.speed[last]
    room.v[2 * last + axis], room.v_var[2 * last + axis] = speed, room.vv[last]
    for step in range(1, count):
        i = last - step
        dt, acceleration = time[i + 1] - time[i], room.acceleration[i + 1]
        a, b, d = room.xx[i], room.xv[i], room.vv[i]
        ahead_xx = a + dt * (2.0 * b + dt * d) + acceleration * dt * dt * dt / 3.0
        ahead_xv = b + dt * d + 0.5 * acceleration * dt * dt
        ahead_vv = d + acceleration * dt
        size = ahead_xx * ahead_vv - ahead_xv * ahead_xv
        if size <= 0.0:
            size = 1e-30
        # Gain: the covariance of now and ahead, over that of ahead.
        g_xx = ((a + dt * b) * ahead_vv - b * ahead_xv) / size
        g_xv = (b * ahead_xx - (a + dt * b) * ahead_xv) / size
        g_vx = ((b + dt * d) * ahead_vv - d * ahead_xv) / size
        g_vv = (d * ahead_xx - (b + dt * d) * ahead_xv) / size
        at = 2 * i + axis
        off_x = place - (room.x[i] + dt * room.speed[i])
        off_v = speed - room.speed[i]
        place = room.x[i] + g_xx * off_x + g_xv * off_v
        speed = room.speed[i] + g_vx * off_x + g_vv * off_v
        room.v[at] = speed
        # Only the variance of the speed is needed; the place ahead is taken as certain.
        room.v_var[at] = max(
            d
            - g_vx * (ahead_xx * g_vx + ahead_xv * g_vv)
            - g_vv * (ahead_xv * g_vx + ahead_vv * g_vv)
            + g_vv * g_vv * room.v_var[at + 2],
            0.0,
        )


def decide_motion(room: Smoother, count: int, onset: int, vx: Any, vy: Any, moving: Any) -> None:
    """Write the velocities from the onset on, and decide which of them are motion."""
    for i in range(count):
        vx[i] = vy[i] = 0.0
        moving[i] = 0
        if i < onset:
            continue
        x, y = room.v[2 * i], room.v[2 * i + 1]
        vx[i], vy[i] = x, y
        speed = x * x + y * y
        var = 0.5 * (room.v_var[2 * i] + room.v_var[2 * i + 1])
        if speed > LEAST_SPEED * LEAST_SPEED and speed > MOVING_SDS * MOVING_SDS * var:
            moving[i] = 1
