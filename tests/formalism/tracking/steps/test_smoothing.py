"""Velocities by what was seen before and after, against a smoother in matrices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.tracking import smoothing
from lidarcli.formalism.tracking.results import BOX, DISC
from lidarcli.formalism.tracking.smoothing import Smoother

Array = np.ndarray[Any, Any]


def step_of(dt: float, q: float) -> tuple[Array, Array]:
    """How place and velocity go on, and the noise of that."""
    return np.array([[1, dt], [0, 1]]), q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])


def filtered(
    z: Array, var: Array, time: Array, q: Array, start: tuple[float, Array, Array] | None = None
) -> tuple[list[Array], list[Array], Array]:
    """States, covariances and misfits; `start`: time, state and covariance of the sighting before."""
    states: list[Array] = []
    covs: list[Array] = []
    misfits = np.zeros(len(z))
    for i in range(len(z)):
        if i == 0 and start is None:
            states.append(np.array([z[0], 0.0]))
            covs.append(np.diag([var[0], smoothing.FIRST_SPEED_SD**2]))
            continue
        before, x, p = start if i == 0 and start is not None else (time[i - 1], states[-1], covs[-1])
        step, noise = step_of(time[i] - before, q[i])
        x, p = step @ x, step @ p @ step.T + noise
        off, s = z[i] - x[0], p[0, 0] + var[i]
        misfits[i] = min(off**2 / s, smoothing.MOST_MISFIT) + math.log(s)
        s = max(s, off**2 / smoothing.MOST_MISFIT)
        gain = p[:, 0] / s
        states.append(x + gain * off)
        covs.append(p - np.outer(gain, p[0]))
    return states, covs, misfits


def smoothed(states: list[Array], covs: list[Array], time: Array, q: Array) -> Array:
    """(N,) velocities by Rauch, Tung and Striebel."""
    x = states[-1]
    speeds = [x[1]]
    for i in range(len(states) - 2, -1, -1):
        step, noise = step_of(time[i + 1] - time[i], q[i + 1])
        ahead = step @ covs[i] @ step.T + noise
        x = states[i] + covs[i] @ step.T @ np.linalg.inv(ahead) @ (x - step @ states[i])
        speeds.append(x[1])
    return np.array(speeds[::-1])


def chosen(z: Array, var: Array, time: Array, start: tuple[float, Array, Array] | None) -> Array:
    """(N,) the acceleration of each step that explains the sightings around it best."""
    levels = smoothing.ACCELERATIONS
    misfits = [filtered(z, var, time, np.full(len(z), q), start)[2] for q in levels]
    best = []
    for i in range(len(z)):
        around = slice(max(i - smoothing.AROUND_SIGHTINGS, 0), i + smoothing.AROUND_SIGHTINGS + 1)
        totals = [c * smoothing.LIVELIER_GAIN + misfits[c][around].sum() for c in range(len(levels))]
        best.append(levels[int(np.argmin(totals))])
    return np.array(best)


def sightings(rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """Noisy places along x and y, their variances and times; some far off, some after a pause."""
    time = np.cumsum(rng.choice([0.1, 0.1, 0.1, 0.5], count))
    true = np.array([0.3 * time, np.where(time < time.mean(), 0.0, 2.0 * (time - time.mean()))])
    var = rng.choice([1e-4, 4e-4, 0.01], (2, count))
    z = true + np.sqrt(var) * rng.normal(size=var.shape)
    z[:, rng.random(count) < 0.05] += 1.5
    return z, var, time


def smooth(
    z: Array, var: Array, time: Array, state: Array, keep: int, onset: int = 0
) -> tuple[Array, Array, Array]:
    """What the core says of sightings by their centres."""
    count = len(time)
    sighted = {name: np.zeros(count) for name in ("half_1", "half_2", "sin")}
    sighted |= {"centred": np.ones(count, np.int64), "cos": np.ones(count)}
    sighted |= {"z": np.repeat(z.T, 2, axis=1).copy(), "var": np.repeat(var.T, 2, axis=1).copy()}
    room = Smoother(count + 3)
    half = np.zeros(2)
    assert room.locate(0, sighted, half, half, DISC, False) == count
    vx, vy, moving = np.full(count, 9.0), np.full(count, 9.0), np.full(count, 9, np.uint8)
    room.smooth(np.arange(count), time, state, keep, onset, vx, vy, moving)
    return vx, vy, moving


@pytest.mark.parametrize("seed", range(8))
def test_velocities_are_those_of_a_smoother_in_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    z, var, time = sightings(rng, int(rng.choice([1, 2, 3, 60, 120])))
    state = np.full(12, -1.0)
    found = smooth(z, var, time, state, len(time))
    for axis in range(2):
        q = chosen(z[axis], var[axis], time, None)
        states, covs, _ = filtered(z[axis], var[axis], time, q)
        np.testing.assert_allclose(found[axis], smoothed(states, covs, time, q), rtol=1e-6, atol=1e-9)
        # What is handed on is what is known after the last of them.
        known = [time[-1], *states[-1], covs[-1][0, 0], covs[-1][0, 1], covs[-1][1, 1]]
        np.testing.assert_allclose(state[6 * axis : 6 * axis + 6], known, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_window_goes_on_where_the_one_before_has_ended(seed: int) -> None:
    rng = np.random.default_rng([1, seed])
    z, var, time = sightings(rng, 90)
    keep = 50
    state = np.full(12, -1.0)
    smooth(z, var, time, state, keep)
    found = smooth(z[:, keep:], var[:, keep:], time[keep:], state.copy(), 20)
    for axis in range(2):
        begin, x, v, xx, xv, vv = state[6 * axis : 6 * axis + 6]
        assert begin == time[keep - 1]
        start = (float(begin), np.array([x, v]), np.array([[xx, xv], [xv, vv]]))
        q = chosen(z[axis, keep:], var[axis, keep:], time[keep:], start)
        states, covs, _ = filtered(z[axis, keep:], var[axis, keep:], time[keep:], q, start)
        np.testing.assert_allclose(found[axis], smoothed(states, covs, time[keep:], q), rtol=1e-6, atol=1e-9)


def test_a_steady_speed_is_found_and_a_body_that_stands_does_not_move() -> None:
    rng = np.random.default_rng(5)
    time = 0.1 * np.arange(100)
    z = np.array([0.8 * time, np.zeros(100)]) + 0.01 * rng.normal(size=(2, 100))
    var = np.full((2, 100), 1e-4)
    vx, vy, moving = smooth(z, var, time, np.full(12, -1.0), 100)
    assert np.abs(vx - 0.8).max() < 0.05
    assert np.abs(vy).max() < 0.05
    assert moving.all()
    _, _, moving = smooth(0.0 * z + [[1.0], [2.0]], var, time, np.full(12, -1.0), 100)
    assert not moving.any()


def test_before_the_onset_it_stands() -> None:
    time = 0.1 * np.arange(60)
    z = np.array([0.8 * time, 0.0 * time])
    vx, vy, moving = smooth(z, np.full((2, 60), 1e-4), time, np.full(12, -1.0), 60, onset=25)
    assert (vx[:25] == 0).all()
    assert (vy[:25] == 0).all()
    assert not moving[:25].any()
    assert moving[25:].all()


def test_the_middle_between_two_sides_of_which_one_may_be_unknown() -> None:
    assert smoothing.centre_of(1.0, 2.0, 0.04, 0.08, 0.7, 0.01) == (1.5, pytest.approx(0.03))
    assert smoothing.centre_of(1.0, 1.2, 0.04, -1.0, 0.7, 0.01) == (pytest.approx(1.7), pytest.approx(0.05))
    assert smoothing.centre_of(1.8, 2.0, -1.0, 0.04, 0.7, 0.01) == (pytest.approx(1.3), pytest.approx(0.05))
    middle, var = smoothing.centre_of(1.0, 2.0, -1.0, -1.0, 0.7, 0.01)
    assert (middle, var) == (1.5, smoothing.UNKNOWN_VAR)


def test_sides_along_the_axes_of_a_body_are_a_place_in_the_world() -> None:
    yaw = 0.6
    c, s = math.cos(yaw), math.sin(yaw)
    sighted: dict[str, Any] = {
        "centred": np.zeros(1, np.int64),
        "cos": np.array([c]),
        "sin": np.array([s]),
        "half_1": np.array([0.1]),
        "half_2": np.array([0.1]),
        "z": np.array([[1.0, 1.8, 0.3, 0.4]]),
        "var": np.array([[0.02, 0.02, 0.01, -1.0]]),
    }
    room = Smoother(1)
    # Early sightings did not know how large it is: what is known in the end counts.
    room.locate(0, sighted, np.array([0.4, 0.25]), np.array([0.0, 0.002]), BOX, False)
    along, across, var_1, var_2 = 1.4, 0.55, 0.01, 0.012
    assert (room.z[0], room.z[1]) == pytest.approx((c * along - s * across, s * along + c * across))
    assert (room.var[0], room.var[1]) == pytest.approx(
        (c * c * var_1 + s * s * var_2, s * s * var_1 + c * c * var_2)
    )
    room.locate(0, sighted, np.array([0.4, 0.25]), np.array([0.0, 0.002]), BOX, True)
    assert room.var[0] == pytest.approx(c * c * var_1 + s * s * var_2 + smoothing.PART_VAR)
