"""Rigid motions against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.pose.tracks import Motion, compose, interpolate, inverse, multiply, planar, rotate, tilt
from lidarcli.sweeps import Float64


def flat(*poses: tuple[float, float, float]) -> Motion:
    """Poses in the plane: x, y, yaw."""
    x, y, yaw = np.array(poses, float).reshape(-1, 3).T
    zero = np.zeros_like(x)
    return Motion(np.column_stack([x, y, zero]), np.column_stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)]))


def about(axis: tuple[float, float, float], angle: float) -> Float64:
    """(1, 4) the turn by an angle about an axis."""
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.append(np.sin(angle / 2) * unit, np.cos(angle / 2))[None]


def matrix(rotation: Float64) -> Float64:
    """The (3, 3) matrix of a quaternion, column by column."""
    return np.column_stack([rotate(rotation, np.eye(3)[[k]])[0] for k in range(3)])


def test_rotation_about_each_axis() -> None:
    quarter = np.pi / 2
    np.testing.assert_allclose(matrix(about((0, 0, 1), quarter)), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(matrix(about((1, 0, 0), quarter)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(matrix(about((0, 1, 0), quarter)), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)


def test_a_product_turns_by_the_second_first() -> None:
    first, second = about((1, 2, 3), 0.7), about((-2, 0.5, 1), 1.9)
    np.testing.assert_allclose(matrix(multiply(first, second)), matrix(first) @ matrix(second), atol=1e-14)


def test_composition_in_the_plane() -> None:
    poses = planar(compose(flat((1.0, 2.0, np.pi / 2)), flat((3.0, 1.0, 0.25))))
    assert (poses.x[0], poses.y[0], poses.yaw[0]) == pytest.approx((0.0, 5.0, np.pi / 2 + 0.25))


def test_the_inverse_undoes() -> None:
    motion = Motion(np.array([[1.0, -2.0, 3.0]]), about((1, 2, 3), 0.8))
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
        yaw = planar(interpolate(np.array([1, 2, 3]), np.array([0, 4]), Motion(motion.position, rotation))).yaw
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


def test_the_first_and_the_last_pose_hold_as_long_as_they_may() -> None:
    stamps = np.array([10, 20])
    at = np.array([4, 5, 9, 15, 21, 25, 26])
    poses = planar(interpolate(at, stamps, flat((1, 1, 0), (2, 2, 0)), hold_ns=5))
    np.testing.assert_array_equal(poses.x, [np.nan, 1, 1, 1.5, 2, 2, np.nan])


def test_a_stamp_at_the_end_of_its_type_is_far_from_all() -> None:
    ends = np.array([np.iinfo(np.int64).min, np.iinfo(np.int64).max])
    poses = planar(interpolate(ends, np.array([-10, 10]), flat((1, 1, 0), (2, 2, 0)), hold_ns=5))
    assert np.isnan(poses.x).all()
    poses = planar(interpolate(ends, ends[1:] - np.array([3, 2]), flat((1, 1, 0), (2, 2, 0)), hold_ns=5))
    np.testing.assert_array_equal(poses.x, [np.nan, 2])


def test_a_single_pose_holds_at_its_stamp_alone() -> None:
    poses = planar(interpolate(np.array([4, 5, 6]), np.array([5]), flat((1, 2, 0.5))))
    np.testing.assert_array_equal(np.isnan(poses.x), [True, False, True])
    assert poses.yaw[1] == pytest.approx(0.5)


def test_no_poses_at_all() -> None:
    empty = Motion(np.empty((0, 3)), np.empty((0, 4)))
    assert np.isnan(interpolate(np.array([1, 2]), np.empty(0, np.int64), empty).position).all()


def test_nanoseconds_of_today_are_told_apart() -> None:
    start = 1_700_000_000_000_000_000
    stamps = np.array([start, start + 8], np.int64)
    poses = planar(interpolate(start + np.arange(9), stamps, flat((0, 0, 0), (8, 0, 0))))
    np.testing.assert_allclose(poses.x, np.arange(9))


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
    poses = planar(Motion(np.array([[1.0, 2.0, 0.3]]), about(axis, angle)))
    assert poses.upside_down[0]
    assert np.cos(poses.yaw[0] - yaw) == pytest.approx(1.0)
    # Against the motion itself: a point and a direction of the sensor's plane.
    row = np.array([0])
    x, y, turned = poses.to_world(row, np.array([0.5]), np.array([0.2]), np.array([0.4]))
    point = rotate(about(axis, angle), np.array([[0.5, 0.2, 0.0]]))[0]
    assert (x[0], y[0]) == pytest.approx((1.0 + point[0], 2.0 + point[1]))
    line = rotate(about(axis, angle), np.array([[np.cos(0.4), np.sin(0.4), 0.0]]))[0]
    assert abs(np.sin(turned[0] - np.arctan2(line[1], line[0]))) < 1e-12


def test_to_world_turns_and_moves() -> None:
    poses = planar(flat((10, 0, 0), (1, 2, np.pi / 2)))
    x, y, yaw = poses.to_world(
        np.array([1, 0, 1]), np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 2.0]), np.array([0.3, -0.3, 1.2])
    )
    np.testing.assert_allclose(x, [1, 11, -1])
    np.testing.assert_allclose(y, [3, 0, 2])
    np.testing.assert_allclose(yaw, [0.3 + np.pi / 2 - np.pi, -0.3, 1.2 - np.pi / 2])


def test_tilt() -> None:
    motion = Motion(np.zeros((2, 3)), np.concatenate([about((1, 0, 0), 0.3), about((0, 1, 0), np.pi - 0.2)]))
    assert tilt(motion) == pytest.approx(0.3)
    assert tilt(Motion(np.full((1, 3), np.nan), np.full((1, 4), np.nan))) == 0.0
