"""The filters of a body along its axes, against one with full matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.tracking import kalman
from lidarcli.formalism.tracking.kalman import Targets

PAIRS = (("c", "c"), ("c", "v"), ("c", "h"), ("v", "v"), ("v", "h"), ("h", "h"))


class Filter:
    """A Kalman filter of (c, v, h) in matrices."""

    def __init__(self, rng: np.random.Generator) -> None:
        root = rng.normal(size=(3, 3)) * [[0.1], [0.3], [0.05]]
        self.x = np.array([rng.normal(), rng.normal(), rng.uniform(0.3, 0.6)])
        self.p = root @ root.T + 1e-4 * np.eye(3)

    def predict(self, dt: float) -> None:
        step = np.array([[1, dt, 0], [0, 1, 0], [0, 0, 1]])
        noise = np.zeros((3, 3))
        noise[:2, :2] = kalman.ACCELERATION * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        noise[2, 2] = kalman.EXTENT_GROWTH * dt
        self.x, self.p = step @ self.x, step @ self.p @ step.T + noise

    def update(self, z: float, sign: float, var: float) -> np.ndarray:
        look = np.array([1.0, 0.0, sign])
        off = z - look @ self.x
        s = max(look @ self.p @ look + var, off * off / kalman.MAX_RESIDUAL)
        gain = self.p @ look / s
        self.x = self.x + gain * off
        self.p = self.p - s * np.outer(gain, gain)
        return gain


def fill(targets: Targets, a: int, filt: Filter, still: Filter) -> None:
    """Let an axis of a body, and its twin, know what the filters do."""
    targets.c[a], targets.v[a], targets.h[a] = filt.x
    targets.static_c[a], targets.static_h[a] = still.x[0], still.x[2]
    for one, other in PAIRS:
        at = "cvh".index(one), "cvh".index(other)
        getattr(targets, one + other)[a] = filt.p[at]
        if "v" not in (one, other):
            getattr(targets, f"static_{one}{other}")[a] = still.p[at]


def state_of(targets: Targets, a: int, prefix: str = "") -> tuple[np.ndarray, np.ndarray]:
    """What an axis knows, in matrices; the twin knows no v."""
    names = "ch" if prefix else "cvh"
    x = np.array([getattr(targets, prefix + name)[a] for name in names])
    p = np.array([[getattr(targets, prefix + "".join(sorted((i, j), key="cvh".index)))[a] for j in names] for i in names])
    return x, p


def still(rng: np.random.Generator) -> Filter:
    """A filter whose velocity is known to be nil."""
    one = Filter(rng)
    one.x[1] = 0.0
    one.p[1] = one.p[:, 1] = 0.0
    return one


def assert_close(targets: Targets, a: int, filt: Filter, twin: Filter) -> None:
    x, p = state_of(targets, a)
    np.testing.assert_allclose(x, filt.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(p, filt.p, rtol=1e-7, atol=1e-12)
    x, p = state_of(targets, a, "static_")
    np.testing.assert_allclose(x, twin.x[[0, 2]], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(p, twin.p[np.ix_([0, 2], [0, 2])], rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_the_filters_are_those_of_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    targets = Targets(2)
    b = 1
    filters, twins = [Filter(rng) for _ in range(2)], [still(rng) for _ in range(2)]
    for i in range(2):
        fill(targets, 2 * b + i, filters[i], twins[i])
    for _ in range(12):
        dt, drift_var = float(rng.choice([0.0, 0.05, 0.1, 1.0])), float(rng.choice([0.0, 1e-4]))
        kalman.predict(targets, b, dt, drift_var)
        for filt, twin in zip(filters, twins, strict=True):
            filt.predict(dt)
            twin.p[0, 0] += kalman.STANDING_GROWTH * dt + drift_var
            twin.p[2, 2] += kalman.EXTENT_GROWTH * dt
        for i, sign in ((0, -1.0), (0, 1.0), (1, 0.0)):
            a = 2 * b + i
            # Sometimes what is hardly to be believed.
            z, var = filters[i].x[0] + sign * filters[i].x[2] + rng.choice([0.02, 2.0]) * rng.normal(), 4e-4
            expected, s = kalman.residual(targets, a, z, sign, var)
            look = np.array([1.0, 0.0, sign])
            assert expected == pytest.approx(z - look @ filters[i].x)
            assert s == pytest.approx(look @ filters[i].p @ look + var)
            kalman.update(targets, a, z, sign, var)
            gain = kalman.update_static(targets, a, z, sign, var)
            filters[i].update(z, sign, var)
            assert gain == pytest.approx(twins[i].update(z, sign, var)[0])
            if min(filters[i].x[2], twins[i].x[2]) < 0.01:
                # Nothing has a negative extent: from here on matrices know something else.
                return
            assert_close(targets, a, filters[i], twins[i])


def test_a_turn_keeps_all_that_is_known_in_the_world() -> None:
    rng = np.random.default_rng(3)
    targets = Targets(1)
    targets.yaw[0], targets.cos[0], targets.sin[0] = 0.3, math.cos(0.3), math.sin(0.3)
    for i in range(2):
        fill(targets, i, Filter(rng), still(rng))
    for i in range(6):
        targets.jacobian[i] = rng.normal()

    def world() -> list[float]:
        candidates = [(targets.c[0], targets.c[1]), (targets.v[0], targets.v[1])]
        candidates += [(targets.static_c[0], targets.static_c[1])]
        candidates += [(targets.jacobian[i], targets.jacobian[3 + i]) for i in range(3)]
        return [value for pair in candidates for value in kalman.to_world(targets, 0, *pair)]

    before, variances = world(), [(targets.cc[0], targets.vv[0]), (targets.cc[1], targets.vv[1])]
    sums = targets.cc[0] + targets.cc[1], targets.vv[0] + targets.vv[1]
    for angle in (0.1, -0.7, 2.0):
        kalman.turn(targets, 0, angle)
        assert world() == pytest.approx(before, abs=1e-12)
        # How uncertain it is altogether does not change either.
        assert (targets.cc[0] + targets.cc[1], targets.vv[0] + targets.vv[1]) == pytest.approx(sums)
    assert targets.yaw[0] == pytest.approx(0.3 + 0.1 - 0.7 + 2.0)
    for i in range(2):
        fill(targets, i, Filter(rng), still(rng))
    variances = [(targets.cc[i], targets.vv[i]) for i in range(2)]
    kalman.turn(targets, 0, math.pi / 2)
    assert [(targets.cc[i], targets.vv[i]) for i in range(2)] == [pytest.approx(variances[1]), pytest.approx(variances[0])]


def test_faces_tell_the_direction_up_to_quarter_turns() -> None:
    for quarters in range(-3, 4):
        targets = Targets(1)
        targets.kind[0], targets.yaw_var[0], targets.rate_var[0] = kalman.BOX, 4e-4, 0.02
        kalman.turn(targets, 0, 0.5)
        var = 1e-4
        kalman.predict(targets, 0, 0.1, 0.0)
        step = np.array([[1.0, 0.1], [0.0, 1.0]])
        known = step @ np.diag([4e-4, 0.02]) @ step.T
        known += kalman.ANGULAR_ACCELERATION * np.array([[0.1**3 / 3, 0.1**2 / 2], [0.1**2 / 2, 0.1]])
        gain = known[:, 0] / (known[0, 0] + var)
        kalman.update_yaw(targets, 0, 0.6 + quarters * math.pi / 2, var)
        assert targets.yaw[0] == pytest.approx(0.5 + 0.1 * gain[0])
        assert targets.yaw_rate[0] == pytest.approx(0.1 * gain[1])
        left = known - np.outer(gain, known[0])
        assert (targets.yaw_var[0], targets.yaw_cov[0], targets.rate_var[0]) == pytest.approx(
            (left[0, 0], left[0, 1], left[1, 1])
        )
