"""Paths by what was seen before and after, against a smoother in matrices."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from lidarcli.formalism.tracking import smoothing
from lidarcli.formalism.tracking.smoothing import KEPT, STATE, Smoother

Array = np.ndarray[Any, Any]
PLACE = np.eye(2, STATE)


class Sweeps(NamedTuple):
    """What S sweeps saw of a track: measured places, their covariance, and legs as in `Smoother.measure`."""

    time: Array
    z: Array
    r: Array
    parts: Array
    legs: Array

    def since(self, first: int) -> Sweeps:
        return Sweeps(*(values[first:] for values in self))


def measured_by(legs: int) -> Array:
    """What a measured place tells of the state: with one leg in view, where that leg is."""
    return PLACE + (np.eye(2, STATE, 4) if legs == 1 else 0.0)


def filtered(
    seen: Sweeps, q: Array, start: tuple[float, Array, Array] | None = None
) -> tuple[list[Array], list[Array], list[Array], list[Array], Array]:
    """States and covariances after and before each sweep, and misfits; `start`: time, state and covariance before."""
    states: list[Array] = []
    covs: list[Array] = []
    ahead: list[Array] = []
    steps: list[Array] = []
    misfits = np.zeros(len(seen.time))
    for i, time in enumerate(seen.time):
        legs = int(seen.legs[i])
        if i == 0 and start is None:
            one, other = np.eye(2, STATE, 2), np.eye(2, STATE, 4)
            p = PLACE.T @ seen.r[0] @ PLACE + one.T @ one * smoothing.FIRST_SPEED_SD**2
            if legs == 1:
                # The place of the body is that of the leg without its offset.
                p += smoothing.LEG_VAR * (PLACE - other).T @ (PLACE - other)
            elif legs == 2:
                p += smoothing.LEG_VAR * other.T @ other
            states.append(PLACE.T @ seen.z[0])
            covs.append(p)
            ahead.append(p)
            steps.append(np.eye(STATE))
            continue
        before, x, p = start if i == 0 and start is not None else (seen.time[i - 1], states[-1], covs[-1])
        dt = time - before
        left = math.exp(-dt / smoothing.LEG_SECONDS)
        step = np.eye(STATE)
        step[0, 2] = step[1, 3] = dt
        step[4, 4] = step[5, 5] = left
        noise = np.zeros((STATE, STATE))
        for axis in range(2):
            noise[axis, axis], noise[2 + axis, 2 + axis] = q[i] * dt**3 / 3, q[i] * dt
            noise[axis, 2 + axis] = noise[2 + axis, axis] = q[i] * dt**2 / 2
            noise[4 + axis, 4 + axis] = smoothing.LEG_VAR * (1 - left**2) if p[4, 4] > 0 else 0.0
        x, p = step @ x, step @ p @ step.T + noise
        ahead.append(p)
        steps.append(step)
        if seen.parts[i]:
            h = measured_by(legs)
            off, s = seen.z[i] - h @ x, h @ p @ h.T + seen.r[i]
            squared = off @ np.linalg.solve(s, off)
            misfits[i] = min(squared, smoothing.MAX_MISFIT) + math.log(np.linalg.det(s))
            s = s * max(squared / smoothing.MAX_MISFIT, 1.0)
            gain = np.linalg.solve(s, h @ p).T
            x, p = x + gain @ off, p - gain @ h @ p
        states.append(x)
        covs.append(p)
    return states, covs, ahead, steps, misfits


def smoothed(seen: Sweeps, q: Array, start: tuple[float, Array, Array] | None = None) -> Array:
    """(S, 9) paths by Rauch, Tung and Striebel."""
    states, covs, ahead, steps, _ = filtered(seen, q, start)
    x, p = states[-1], covs[-1]
    rows = [(x, p)]
    for i in range(len(states) - 2, -1, -1):
        gain = covs[i] @ steps[i + 1].T @ np.linalg.pinv(ahead[i + 1])
        x = states[i] + gain @ (x - steps[i + 1] @ states[i])
        p = covs[i] + gain @ (p - ahead[i + 1]) @ gain.T
        rows.append((x, p))
    return np.array([[*x[:4], p[0, 0], p[0, 1], p[1, 1], p[2, 2], p[3, 3]] for x, p in rows[::-1]])


def chosen(seen: Sweeps, start: tuple[float, Array, Array] | None = None) -> Array:
    """(S,) the acceleration of each step: that which explains the sweeps around it best; of hidden persons the most."""
    levels = smoothing.ACCELERATIONS
    misfits = [filtered(seen, np.full(len(seen.time), q), start)[4] for q in levels]
    best = []
    for i, parts in enumerate(seen.parts):
        around = slice(max(i - smoothing.AROUND_SIGHTINGS, 0), i + smoothing.AROUND_SIGHTINGS + 1)
        totals = [c * smoothing.LIVELIER_GAIN + misfits[c][around].sum() for c in range(len(levels))]
        hidden = parts == 0 and seen.legs[i] > 0
        best.append(levels[-1] if hidden else levels[int(np.argmin(totals))])
    return np.array(best)


def sightings(rng: np.random.Generator, count: int, person: bool = False) -> Sweeps:
    """Noisy places along x and y with their covariances; some far off, some after a pause, some hidden."""
    time = np.cumsum(rng.choice([0.1, 0.1, 0.1, 0.5], count))
    true = np.array([0.3 * time, np.where(time < time.mean(), 0.0, 2.0 * (time - time.mean()))]).T
    root = rng.normal(scale=0.03, size=(count, 2, 2))
    r = root @ root.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    z = true + np.einsum("nij,nj->ni", np.linalg.cholesky(r), rng.normal(size=(count, 2)))
    z[rng.random(count) < 0.05] += 1.5
    parts = np.where(rng.random(count) < 0.15, 0, 1)
    parts[0] = 1
    legs = rng.choice([1, 2], count) if person else np.zeros(count)
    return Sweeps(time, z, r, parts, legs.astype(np.uint8))


def smooth(seen: Sweeps, state: Array, keep: int) -> tuple[Array, Array]:
    """What the core says of sweeps."""
    count = len(seen.time)
    smoother = Smoother(1, count + 3)
    for i in range(count):
        smoother.z[2 * i], smoother.z[2 * i + 1] = seen.z[i]
        smoother.r[3 * i], smoother.r[3 * i + 1], smoother.r[3 * i + 2] = seen.r[i][[0, 0, 1], [0, 1, 1]]
    path, moving = np.full((count, 9), 9.0), np.full(count, 9, np.uint8)
    smoother.smooth(seen.time, seen.parts, seen.legs, state, keep, path, moving)
    return path, moving


@pytest.mark.parametrize("person", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_paths_are_those_of_a_smoother_in_matrices(seed: int, person: bool) -> None:
    rng = np.random.default_rng(seed)
    seen = sightings(rng, int(rng.choice([1, 2, 3, 60, 120])), person)
    state = np.full(KEPT, np.nan)
    path, _ = smooth(seen, state, len(seen.time))
    q = chosen(seen)
    np.testing.assert_allclose(path, smoothed(seen, q), rtol=1e-5, atol=1e-8)
    # What is handed on is what is known after the last of them.
    states, covs, *_ = filtered(seen, q)
    known = [seen.time[-1], *states[-1], *covs[-1].ravel()]
    np.testing.assert_allclose(state, known, rtol=1e-6, atol=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_a_window_goes_on_where_the_one_before_has_ended(seed: int) -> None:
    rng = np.random.default_rng([1, seed])
    seen = sightings(rng, 90, person=seed % 2 == 1)
    keep = 50
    state = np.full(KEPT, np.nan)
    smooth(seen, state, keep)
    rest = seen.since(keep)
    path, _ = smooth(rest, state.copy(), 20)
    assert state[0] == seen.time[keep - 1]
    start = float(state[0]), state[1 : 1 + STATE], state[1 + STATE :].reshape(STATE, STATE)
    np.testing.assert_allclose(path, smoothed(rest, chosen(rest, start), start), rtol=1e-5, atol=1e-8)


def steady(z: Array, var: float = 1e-4) -> Sweeps:
    """Sweeps at 10 Hz that see all of a thing."""
    count = len(z)
    return Sweeps(
        0.1 * np.arange(count),
        z,
        np.tile(var * np.eye(2), (count, 1, 1)),
        np.ones(count, np.int64),
        np.zeros(count, np.uint8),
    )


def test_a_steady_speed_is_found_and_a_body_that_stands_does_not_move() -> None:
    rng = np.random.default_rng(5)
    way = np.column_stack([0.08 * np.arange(100), np.zeros(100)])
    path, moving = smooth(steady(way + 0.01 * rng.normal(size=way.shape)), np.full(KEPT, np.nan), 100)
    assert np.abs(path[:, :2] - way).max() < 0.02
    assert np.abs(path[:, 2:4] - [0.8, 0.0]).max() < 0.05
    assert moving.all()
    _, moving = smooth(steady(0.0 * way + [1.0, 2.0]), np.full(KEPT, np.nan), 100)
    assert not moving.any()


def test_one_leg_swings_beside_its_person() -> None:
    """Legs 0.4 m apart in turn, of which one is seen, are no person who runs from side to side."""
    swing = 0.2 * np.sign(np.sin(2 * math.pi * 0.1 * np.arange(80) / 1.1))
    way = np.column_stack([0.1 * np.arange(80), np.zeros(80)])
    seen = steady(way + np.column_stack([swing, np.zeros(80)]), 4e-4)
    person, _ = smooth(seen._replace(legs=np.ones(80, np.uint8)), np.full(KEPT, np.nan), 80)
    thing, _ = smooth(seen, np.full(KEPT, np.nan), 80)
    assert np.abs(person[10:70, 2] - 1.0).max() < 0.25 < np.abs(thing[10:70, 2] - 1.0).max()
