"""Rigid motions against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.pose.tracks import PoseMotion, compose, interpolate, inverse, planar, rotate
from lidarcli.sweeps.types import Float64


def flat(*poses: tuple[float, float, float]) -> PoseMotion:
    """Poses in the plane: x, y, yaw."""
    x, y, yaw = np.array(poses, float).reshape(-1, 3).T
    zero = np.zeros_like(x)
    return PoseMotion(np.column_stack([x, y, zero]), np.column_stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)]))


def about(axis: tuple[float, float, float], angle: float) -> Float64:
    """(1, 4) the turn by an angle about an axis."""
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.append(np.sin(angle / 2) * unit, np.cos(angle / 2))[None]


def matrix(rotation: Float64) -> Float64:
    """The (3, 3) matrix of a quaternion, column by column."""
    return np.column_stack([rotate(rotation, np.eye(3)[[k]])[0] for k in range(3)])


def test_the_inverse_undoes() -> None:
    motion = PoseMotion(np.array([[1.0, -2.0, 3.0]]), about((1, 2, 3), 0.8))
    for both in (compose(motion, inverse(motion)), compose(inverse(motion), motion)):
        np.testing.assert_allclose(both.position, 0, atol=1e-15)
        np.testing.assert_allclose(both.rotation, [[0, 0, 0, 1]], atol=1e-15)


def test_between_two_poses() -> None:
    stamps = np.array([0, 1000], np.int64)
    at = np.array([0, 250, 500, 1000], np.int64)
    poses = planar(interpolate(at, stamps, flat((0, 0, 0), (4, -2, 1.0))))
    np.testing.assert_allclose(poses.x, [0, 1, 2, 4])
    np.testing.assert_allclose(poses.y, [0, -0.5, -1, -2])
    np.testing.assert_allclose(poses.yaw, [0, 0.25, 0.5, 1.0], atol=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_shorter_way_over_the_seam(sign: float) -> None:
    motion = flat((0, 0, sign * 3.0), (0, 0, sign * -3.0))
    # The same rotation may come as the negative quaternion.
    for rotation in (motion.rotation, motion.rotation * [[1], [-1]]):
        yaw = planar(interpolate(np.array([1, 2, 3]), np.array([0, 4]), PoseMotion(motion.position, rotation))).yaw
        chain = 2 * np.pi - 6.0
        expected = sign * (3.0 + chain * np.array([0.25, 0.5, 0.75]))
        np.testing.assert_allclose(np.cos(yaw - expected), 1.0)
        np.testing.assert_allclose(np.abs(yaw[1]), np.pi)


def test_no_extrapolation() -> None:
    stamps = np.array([10, 20], np.int64)
    poses = planar(interpolate(np.array([9, 10, 20, 21]), stamps, flat((1, 1, 0), (2, 2, 0))))
    np.testing.assert_array_equal(np.isnan(poses.x), [True, False, False, True])
    np.testing.assert_array_equal(np.isnan(poses.yaw), [True, False, False, True])
    assert not poses.upside_down.any()


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 1))
def test_yaw_is_linear_along_the_shorter_way(first: float, second: float, share: float) -> None:
    turn = (second - first + np.pi) % (2 * np.pi) - np.pi
    if abs(abs(turn) - np.pi) < 1e-6:
        return
    at = np.array([round(share * 1e9)])
    yaw = planar(interpolate(at, np.array([0, 10**9]), flat((0, 0, first), (0, 0, second)))).yaw[0]
    expected = first + turn * at[0] / 1e9
    assert abs((yaw - expected + np.pi) % (2 * np.pi) - np.pi) < 1e-9


@pytest.mark.parametrize(
    ("axis", "angle", "yaw"), [((1, 0, 0), np.pi, 0.0), ((0, 1, 0), np.pi, np.pi)], ids=["rolled over", "pitched over"]
)
def test_a_sensor_upside_down(axis: tuple[float, float, float], angle: float, yaw: float) -> None:
    poses = planar(PoseMotion(np.array([[1.0, 2.0, 0.3]]), about(axis, angle)))
    assert poses.upside_down[0]
    assert np.cos(poses.yaw[0] - yaw) == pytest.approx(1.0)
    # Against the motion itself: a point and a direction of the sensor's plane.
    row = np.array([0])
    x, y, turned = poses.to_world(row, np.array([0.5]), np.array([0.2]), np.array([0.4]))
    point = rotate(about(axis, angle), np.array([[0.5, 0.2, 0.0]]))[0]
    assert (x[0], y[0]) == pytest.approx((1.0 + point[0], 2.0 + point[1]))
    line = rotate(about(axis, angle), np.array([[np.cos(0.4), np.sin(0.4), 0.0]]))[0]
    assert abs(np.sin(turned[0] - np.arctan2(line[1], line[0]))) < 1e-12
