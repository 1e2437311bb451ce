"""Path of a track by what was observed before and after: a Kalman filter forward, then a smoother backward.

The state holds place and velocity in the plane and, of a person, how far the one leg that is visible is from the middle of
the target. Backward runs the smoother of Bryson and Frazier, which needs no inverse of a covariance."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism.tracking import results
from lidarcli.formalism.tracking.kalman import Sightings
from lidarcli.system import native

BOX = results.BOX
INFINITY = float("inf")
ACCELERATIONS = (0.02, 0.1, 0.4)
"""[m²/s³] Spectral densities of the acceleration that are tried: a parcel on a belt, a stroll, starts and stops."""
LIVELINESSES = len(ACCELERATIONS)
AROUND_SIGHTINGS, LIVELIER_GAIN = 20, 4.0
"""Sweeps before and after one that decide which acceleration fits, and least gain of twice the log-likelihood for which the
next larger one is taken."""
FIRST_SPEED_SD = 1.0
"""[m/s] Standard deviation of a velocity at first, along each axis."""
UNKNOWN_VAR = 100.0
"""[m²] Variance of a side that was not observed."""
PART_VAR = 0.0625
"""[m²] Variance of the place of one part in an object of several: (25 cm)²."""
LEGS_VAR, LEG_VAR, LEG_SECONDS = 0.0049, 0.0256, 0.35
"""Variance of the middle of two legs as the place of a person, (7 cm)², and of the distance of one leg from that, (16 cm)²,
along each axis [m²]; time in which that distance is forgotten, as the legs swing [s]."""
CHANGE_VAR = 0.0025
"""[m²] Variance that is added while a box was still taken for a disc: (5 cm)²."""
MAX_MISFIT = 9.0
"""Greatest squared residual, as a multiple of its variance in the plane. A larger one counts as this."""
MIN_SPEED, MOVING_SDS = 0.1, 2.0
"""Least speed of what moves [m/s], also in standard deviations."""
STATE, SQUARE, GAIN = 6, 36, 12
"""Numbers of a state (x, y, their velocities, the offset of a leg in x and y), of its covariance, and of a gain."""
KEPT = 1 + STATE + SQUARE
"""Numbers of what is kept of a track between windows: a time, a state and its covariance."""


class Smoother:
    """Room for the sightings and the sweeps of one track, and for estimates at each of these sweeps."""

    def __init__(self, sightings: int, sweeps: int) -> None:
        self.owner: list[Any] = []
        self.sweeps = sweeps
        self.place = native.doubles(self.owner, 2 * sightings)
        self.noise = native.doubles(self.owner, 3 * sightings)
        """Place of each sighting [m], and its covariance xx, xy, yy."""
        self.common = native.doubles(self.owner, 3 * sightings)
        """The part of that covariance by the size of the target: all sightings err alike."""
        self.z = native.doubles(self.owner, 2 * sweeps)
        self.r = native.doubles(self.owner, 3 * sweeps)
        """Measured place in each sweep [m], and its covariance xx, xy, yy."""
        self.lasting = native.doubles(self.owner, 3 * sweeps)
        """Covariance of each place that more sweeps do not reduce; of a hidden one that of the sweep before."""
        self.liveliness = native.doubles(self.owner, LIVELINESSES)
        for i, value in enumerate(ACCELERATIONS):
            self.liveliness[i] = value
        self.acceleration = native.doubles(self.owner, sweeps)
        """Spectral density of the acceleration of the step to each sweep [m²/s³]."""
        self.misfit = native.doubles(self.owner, LIVELINESSES * sweeps)
        """Misfit of each sweep with each of the accelerations, twice the negative log-likelihood."""
        self.x = native.doubles(self.owner, STATE * sweeps)
        self.p = native.doubles(self.owner, SQUARE * sweeps)
        """State after each sweep by those before it, and its covariance."""
        self.off = native.doubles(self.owner, 2 * sweeps)
        self.inverse = native.doubles(self.owner, 3 * sweeps)
        self.gain = native.doubles(self.owner, GAIN * sweeps)
        """Residual of each measured place, the inverse of its covariance, and the gain."""
        self.step = native.doubles(self.owner, 2 * sweeps)
        """Time of the step to each sweep [s], and what is left of the offset of a leg after it."""
        self.adjoint = native.doubles(self.owner, STATE)
        self.matrix = native.doubles(self.owner, SQUARE)
        self.product = native.doubles(self.owner, SQUARE)
        """Adjoint state of the backward pass, its matrix, and a product of that."""

    def locate(
        self, begin: int, sightings: Sightings, rows: Any, half: Any, half_var: Any, kind: int, several: bool
    ) -> int:
        """Write the places of a target at its sightings, from `begin` on; return the begin of the next target.

        Parameters
        ----------
        rows : (N,) int64 the sightings of the target
        half, half_var : (2,) half extents by all sightings, and their variances [m, m²]
        kind : kind of the target
        several : True for one of several parts
        """
        row, extent, extent_var = native.at_longs(rows), native.at_doubles(half), native.at_doubles(half_var)
        locate_sightings(self, begin, len(rows), row, sightings, extent, extent_var, kind, PART_VAR if several else 0.0)
        return begin + len(rows)

    def measure(self, order: Any, sweep: Any, parts: Any, legs: Any) -> None:
        """Join the located sightings of each sweep to one place.

        Parameters
        ----------
        order : (N,) int64 indices of the located sightings in the order of time
        sweep : (N,) int64 sweep of each of these, as an index
        parts : (S,) int64 numbers of sightings in each sweep, to be filled in
        legs : (S,) uint8 legs of a person that a sweep shows, 1 or 2; 0 for what is no person
        """
        at, sweeps, counts = native.at_longs(order), native.at_longs(sweep), native.at_longs(parts)
        average_parts(self, len(order), len(parts), at, sweeps, counts, native.at_bytes(legs))

    def smooth(self, time: Any, parts: Any, legs: Any, state: Any, keep: int, path: Any, moving: Any) -> None:
        """Fill in the path (S, 9) float64 at the measured sweeps, in the order of time, and moving (S,) uint8.

        Parameters
        ----------
        time : (S,) times [s]
        parts, legs : as of `measure`; a sweep without parts did not see the track
        state : (43,) time, state and covariance after the sweep before the first; time NaN for none. On return, those after
            sweep `keep` - 1
        keep : number of sweeps after which the state is kept
        path : columns x, y [m], vx, vy [m/s], variances and covariance xx, xy, yy [m²], variances of vx, vy [m²/s²]
        """
        at, counts, leg = native.at_doubles(time), native.at_longs(parts), native.at_bytes(legs)
        known, out, flags = native.at_doubles(state), native.at_doubles(path), native.at_bytes(moving)
        smooth_path(self, at, counts, leg, known, len(time), keep, out)
        decide_motion(len(time), out, flags)


def locate_sightings(
    smoother: Smoother,
    begin: int,
    count: int,
    rows: Any,
    sightings: Sightings,
    half: Any,
    half_var: Any,
    kind: int,
    more: float,
) -> None:
    """Compute the places of a target in the world, by the sides that were observed."""
    for i in range(count):
        row, side = rows[i], 4 * rows[i]
        c, s = sightings.cos[row], sightings.sin[row]
        half_1 = half[0] if kind == BOX else sightings.half_1[row]
        half_2 = half[1] if kind == BOX else sightings.half_2[row]
        middle_1, noise_1, size_1 = centre_of(sightings, side, half_1, half_var[0])
        middle_2, noise_2, size_2 = centre_of(sightings, side + 2, half_2, half_var[1])
        if sightings.centred[row]:
            middle_1, noise_1, size_1 = sightings.z[side], sightings.var[side], 0.0
            middle_2, noise_2, size_2 = sightings.z[side + 2], sightings.var[side + 2], 0.0
            if kind == BOX:
                noise_1 += CHANGE_VAR
                noise_2 += CHANGE_VAR
        at, cov = 2 * (begin + i), 3 * (begin + i)
        smoother.place[at], smoother.place[at + 1] = c * middle_1 - s * middle_2, s * middle_1 + c * middle_2
        smoother.noise[cov] = c * c * noise_1 + s * s * noise_2 + more
        smoother.noise[cov + 1] = c * s * (noise_1 - noise_2)
        smoother.noise[cov + 2] = s * s * noise_1 + c * c * noise_2 + more
        smoother.common[cov] = c * c * size_1 + s * s * size_2
        smoother.common[cov + 1] = c * s * (size_1 - size_2)
        smoother.common[cov + 2] = s * s * size_1 + c * c * size_2


def centre_of(sightings: Sightings, side: int, half: float, half_var: float) -> tuple[float, float, float]:
    """Return the middle between a side and the next one, its variance, and the part of the size in it."""
    low, high, low_var, high_var = sightings.z[side], sightings.z[side + 1], sightings.var[side], sightings.var[side + 1]
    middle, noise, size = 0.5 * (low + high), UNKNOWN_VAR, 0.0
    if low_var >= 0.0 and high_var >= 0.0:
        noise = 0.25 * (low_var + high_var)
    elif low_var >= 0.0:
        middle, noise, size = low + half, low_var + half_var, half_var
    elif high_var >= 0.0:
        middle, noise, size = high - half, high_var + half_var, half_var
    return middle, noise, size


def average_parts(smoother: Smoother, sightings: int, sweeps: int, order: Any, sweep: Any, parts: Any, legs: Any) -> None:
    """Compute the mean place of the parts that each sweep shows; legs count alike."""
    for i in range(sweeps):
        parts[i] = 0
        smoother.z[2 * i] = smoother.z[2 * i + 1] = 0.0
        for c in range(3):
            smoother.r[3 * i + c] = smoother.lasting[3 * i + c] = 0.0
    for k in range(sightings):
        i, at = sweep[k], order[k]
        parts[i] += 1
        for c in range(2):
            smoother.z[2 * i + c] += smoother.place[2 * at + c]
        for c in range(3):
            smoother.r[3 * i + c] += smoother.noise[3 * at + c]
            smoother.lasting[3 * i + c] += smoother.common[3 * at + c]
    for i in range(sweeps):
        if parts[i] == 0:
            for c in range(3):
                smoother.lasting[3 * i + c] = smoother.lasting[3 * i - 3 + c] if i > 0 else 0.0
            continue
        share = 1.0 / parts[i]
        for c in range(2):
            smoother.z[2 * i + c] *= share
        for c in range(3):
            smoother.r[3 * i + c] *= share * share
            smoother.lasting[3 * i + c] *= share * share
        if legs[i] == 2:
            smoother.r[3 * i] += LEGS_VAR
            smoother.r[3 * i + 2] += LEGS_VAR


def smooth_path(smoother: Smoother, time: Any, parts: Any, legs: Any, state: Any, count: int, keep: int, path: Any) -> None:
    """Smooth a path, at each time with the acceleration that fits the sightings around it best."""
    for c in range(LIVELINESSES):
        for i in range(count):
            smoother.acceleration[i] = smoother.liveliness[c]
        filter_forward(smoother, time, parts, legs, state, count, 0, c)
    choose_accelerations(smoother, parts, legs, count)
    filter_forward(smoother, time, parts, legs, state, count, keep, -1)
    smooth_backward(smoother, parts, legs, count, path)


def choose_accelerations(smoother: Smoother, parts: Any, legs: Any, count: int) -> None:
    """Choose the acceleration of each step by the least misfit over the sweeps around it; hidden persons may do most."""
    for i in range(count):
        if parts[i] == 0 and legs[i] > 0:
            smoother.acceleration[i] = smoother.liveliness[LIVELINESSES - 1]
            continue
        first, stop = max(i - AROUND_SIGHTINGS, 0), min(i + AROUND_SIGHTINGS + 1, count)
        best, least = 0, INFINITY
        for c in range(LIVELINESSES):
            total = c * LIVELIER_GAIN
            for k in range(first, stop):
                total += smoother.misfit[c * smoother.sweeps + k]
            if total < least:
                best, least = c, total
        smoother.acceleration[i] = smoother.liveliness[best]


def filter_forward(
    smoother: Smoother, time: Any, parts: Any, legs: Any, state: Any, count: int, keep: int, trial: int
) -> None:
    """Estimate the state in each sweep by those before it; for a trial, also the misfit of each sweep."""
    # True for a number, which a time is once there was a sweep before.
    known = state[0] == state[0]
    for i in range(count):
        if trial >= 0:
            smoother.misfit[trial * smoother.sweeps + i] = 0.0
        if i == 0 and not known:
            begin_path(smoother, legs[0])
        else:
            before = state[0] if i == 0 else time[i - 1]
            predict_state(smoother, i, state, time[i] - before)
            if parts[i] > 0:
                misfit = update_state(smoother, i, legs[i])
                if trial >= 0:
                    smoother.misfit[trial * smoother.sweeps + i] = misfit
        if i == keep - 1:
            state[0] = time[i]
            for k in range(6):
                state[1 + k] = smoother.x[STATE * i + k]
            for k in range(SQUARE):
                state[1 + STATE + k] = smoother.p[SQUARE * i + k]


def begin_path(smoother: Smoother, legs: int) -> None:
    """Set the state in the first sweep of a track, which observed it."""
    for k in range(6):
        smoother.x[k] = 0.0
    for k in range(36):
        smoother.p[k] = 0.0
    offset = LEG_VAR if legs > 0 else 0.0
    apart = LEG_VAR if legs == 1 else 0.0
    for a in range(2):
        smoother.x[a] = smoother.z[a]
        smoother.p[7 * a] = smoother.r[2 * a] + apart
        smoother.p[7 * (2 + a)] = FIRST_SPEED_SD * FIRST_SPEED_SD
        smoother.p[7 * (4 + a)] = offset
        smoother.p[6 * a + 4 + a] = smoother.p[6 * (4 + a) + a] = -apart
    smoother.p[1] = smoother.p[6] = smoother.r[1]
    smoother.step[0], smoother.step[1] = 0.0, 1.0


def predict_state(smoother: Smoother, i: int, state: Any, dt: float) -> None:
    """Predict the state in sweep i from that before, `dt` seconds earlier."""
    q, left = smoother.acceleration[i], math.exp(-dt / LEG_SECONDS)
    smoother.step[2 * i], smoother.step[2 * i + 1] = dt, left
    x, p = STATE * i, SQUARE * i
    for k in range(6):
        smoother.x[x + k] = state[1 + k] if i == 0 else smoother.x[x - STATE + k]
    for k in range(36):
        smoother.p[p + k] = state[1 + STATE + k] if i == 0 else smoother.p[p - SQUARE + k]
    offset = smoother.p[p + 28]
    for a in range(2):
        smoother.x[x + a] += dt * smoother.x[x + 2 + a]
        smoother.x[x + 4 + a] *= left
    # F P Fᵀ: rows, then columns.
    for k in range(6):
        for a in range(2):
            smoother.p[p + 6 * a + k] += dt * smoother.p[p + 6 * (2 + a) + k]
            smoother.p[p + 6 * (4 + a) + k] *= left
    for k in range(6):
        for a in range(2):
            smoother.p[p + 6 * k + a] += dt * smoother.p[p + 6 * k + 2 + a]
            smoother.p[p + 6 * k + 4 + a] *= left
    # A person keeps the variance of the offset; what has none gets none.
    lost = LEG_VAR * (1.0 - left * left) if offset > 0.0 else 0.0
    for a in range(2):
        smoother.p[p + 7 * a] += q * dt * dt * dt / 3.0
        smoother.p[p + 6 * a + 2 + a] += 0.5 * q * dt * dt
        smoother.p[p + 6 * (2 + a) + a] += 0.5 * q * dt * dt
        smoother.p[p + 7 * (2 + a)] += q * dt
        smoother.p[p + 7 * (4 + a)] += lost


def update_state(smoother: Smoother, i: int, legs: int) -> float:
    """Correct the state in sweep i by the measured place; return the misfit."""
    x, p, g = STATE * i, SQUARE * i, GAIN * i
    leg = 1.0 if legs == 1 else 0.0
    # P Hᵀ, with H of place and, for one leg, its offset.
    for k in range(6):
        for a in range(2):
            smoother.product[2 * k + a] = smoother.p[p + 6 * k + a] + leg * smoother.p[p + 6 * k + 4 + a]
    off_x = smoother.z[2 * i] - smoother.x[x] - leg * smoother.x[x + 4]
    off_y = smoother.z[2 * i + 1] - smoother.x[x + 1] - leg * smoother.x[x + 5]
    xx = smoother.product[0] + leg * smoother.product[8] + smoother.r[3 * i]
    xy = smoother.product[1] + leg * smoother.product[9] + smoother.r[3 * i + 1]
    yy = smoother.product[3] + leg * smoother.product[11] + smoother.r[3 * i + 2]
    size = xx * yy - xy * xy
    squared = (yy * off_x * off_x - 2.0 * xy * off_x * off_y + xx * off_y * off_y) / size
    misfit = min(squared, MAX_MISFIT) + math.log(size)
    less = MAX_MISFIT / squared if squared > MAX_MISFIT else 1.0
    a_xx, a_xy, a_yy = less * yy / size, -less * xy / size, less * xx / size
    smoother.inverse[3 * i], smoother.inverse[3 * i + 1], smoother.inverse[3 * i + 2] = a_xx, a_xy, a_yy
    smoother.off[2 * i], smoother.off[2 * i + 1] = off_x, off_y
    for k in range(6):
        c_x, c_y = smoother.product[2 * k], smoother.product[2 * k + 1]
        smoother.gain[g + 2 * k] = c_x * a_xx + c_y * a_xy
        smoother.gain[g + 2 * k + 1] = c_x * a_xy + c_y * a_yy
        smoother.x[x + k] += smoother.gain[g + 2 * k] * off_x + smoother.gain[g + 2 * k + 1] * off_y
    for k in range(6):
        c_x, c_y = smoother.product[2 * k], smoother.product[2 * k + 1]
        for m in range(k, 6):
            smoother.p[p + 6 * k + m] -= c_x * smoother.gain[g + 2 * m] + c_y * smoother.gain[g + 2 * m + 1]
            smoother.p[p + 6 * m + k] = smoother.p[p + 6 * k + m]
    return misfit


def smooth_backward(smoother: Smoother, parts: Any, legs: Any, count: int, path: Any) -> None:
    """Correct the path by what was observed after each sweep too (modified Bryson and Frazier)."""
    for k in range(6):
        smoother.adjoint[k] = 0.0
    for k in range(36):
        smoother.matrix[k] = 0.0
    for back in range(count):
        i = count - 1 - back
        write_path(smoother, i, path)
        if i > 0:
            if parts[i] > 0:
                adjoin_update(smoother, i, legs[i])
            adjoin_step(smoother, i)


def write_path(smoother: Smoother, i: int, path: Any) -> None:
    """Write place, velocity and their variances in sweep i."""
    x, p = STATE * i, SQUARE * i
    for k in range(4):
        value = smoother.x[x + k]
        for n in range(6):
            value -= smoother.p[p + 6 * k + n] * smoother.adjoint[n]
        path[9 * i + k] = value
    # Rows of P Λ that are needed.
    for k in range(4):
        for n in range(6):
            smoother.product[6 * k + n] = 0.0
        for o in range(6):
            for n in range(6):
                smoother.product[6 * k + n] += smoother.p[p + 6 * k + o] * smoother.matrix[6 * o + n]
    for c in range(5):
        k = c if c == 0 else c - 1
        n = 1 if c == 1 else k
        value = smoother.p[p + 6 * k + n]
        for o in range(6):
            value -= smoother.product[6 * k + o] * smoother.p[p + 6 * o + n]
        if c < 3:
            value += smoother.lasting[3 * i + c]
        path[9 * i + 4 + c] = value if c == 1 else max(value, 0.0)


def adjoin_update(smoother: Smoother, i: int, legs: int) -> None:
    """Take the adjoint state back through the measurement of sweep i."""
    g = GAIN * i
    leg = 1.0 if legs == 1 else 0.0
    off_x, off_y = smoother.off[2 * i], smoother.off[2 * i + 1]
    a_xx, a_xy, a_yy = smoother.inverse[3 * i], smoother.inverse[3 * i + 1], smoother.inverse[3 * i + 2]
    # Kᵀ λ and Kᵀ Λ.
    one = other = 0.0
    for k in range(6):
        one += smoother.gain[g + 2 * k] * smoother.adjoint[k]
        other += smoother.gain[g + 2 * k + 1] * smoother.adjoint[k]
    for n in range(6):
        first = second = 0.0
        for k in range(6):
            first += smoother.gain[g + 2 * k] * smoother.matrix[6 * k + n]
            second += smoother.gain[g + 2 * k + 1] * smoother.matrix[6 * k + n]
        smoother.product[n], smoother.product[6 + n] = first, second
    one += a_xx * off_x + a_xy * off_y
    other += a_xy * off_x + a_yy * off_y
    smoother.adjoint[0] -= one
    smoother.adjoint[1] -= other
    smoother.adjoint[4] -= leg * one
    smoother.adjoint[5] -= leg * other
    # Kᵀ Λ K, which with S⁻¹ is what the measurement adds.
    xx = xy = yy = 0.0
    for n in range(6):
        xx += smoother.product[n] * smoother.gain[g + 2 * n]
        xy += smoother.product[n] * smoother.gain[g + 2 * n + 1]
        yy += smoother.product[6 + n] * smoother.gain[g + 2 * n + 1]
    xx, xy, yy = xx + a_xx, xy + a_xy, yy + a_yy
    for a in range(2):
        for n in range(6):
            less = smoother.product[6 * a + n]
            smoother.matrix[6 * a + n] -= less
            smoother.matrix[6 * (4 + a) + n] -= leg * less
    for a in range(2):
        for n in range(6):
            less = smoother.product[6 * a + n]
            smoother.matrix[6 * n + a] -= less
            smoother.matrix[6 * n + 4 + a] -= leg * less
    for a in range(2):
        for b in range(2):
            more = xy
            if a == b:
                more = xx if a == 0 else yy
            smoother.matrix[6 * a + b] += more
            smoother.matrix[6 * a + 4 + b] += leg * more
            smoother.matrix[6 * (4 + a) + b] += leg * more
            smoother.matrix[6 * (4 + a) + 4 + b] += leg * more


def adjoin_step(smoother: Smoother, i: int) -> None:
    """Take the adjoint state back through the step to sweep i."""
    dt, left = smoother.step[2 * i], smoother.step[2 * i + 1]
    for a in range(2):
        smoother.adjoint[2 + a] += dt * smoother.adjoint[a]
        smoother.adjoint[4 + a] *= left
    for n in range(6):
        for a in range(2):
            smoother.matrix[6 * (2 + a) + n] += dt * smoother.matrix[6 * a + n]
            smoother.matrix[6 * (4 + a) + n] *= left
    for n in range(6):
        for a in range(2):
            smoother.matrix[6 * n + 2 + a] += dt * smoother.matrix[6 * n + a]
            smoother.matrix[6 * n + 4 + a] *= left


def decide_motion(count: int, path: Any, moving: Any) -> None:
    """Decide which velocities are motion."""
    for i in range(count):
        at = 9 * i
        moving[i] = 0
        x, y = path[at + 2], path[at + 3]
        speed, var = x * x + y * y, 0.5 * (path[at + 7] + path[at + 8])
        if speed > MIN_SPEED * MIN_SPEED and speed > MOVING_SDS * MOVING_SDS * var:
            moving[i] = 1
