"""Rigid motions as arrays: composing, inverting, interpolating, and what is left of them in the plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidarcli.sweeps import Float64, Int64, SweepPoses

SMALL_TURN = 1e-4
"""Below this angle [rad] the arc between two rotations is as good as the straight line."""

_STAMPS = np.iinfo(np.int64)


class Motion(NamedTuple):
    """N poses of one frame in another; NaN where unknown."""

    position: Float64
    """(N, 3) metres."""
    rotation: Float64
    """(N, 4) unit quaternions x, y, z, w."""


def compose(outer: Motion, inner: Motion) -> Motion:
    """The pose of c in a from that of b in a and that of c in b."""
    return Motion(
        outer.position + rotate(outer.rotation, inner.position), multiply(outer.rotation, inner.rotation)
    )


def inverse(motion: Motion) -> Motion:
    """The pose of a in b from that of b in a."""
    back = motion.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
    return Motion(-rotate(back, motion.position), back)


def multiply(first: Float64, second: Float64) -> Float64:
    """(N, 4) products of quaternions: the second rotation, then the first."""
    a, b = first[:, :3], second[:, :3]
    v, w = first[:, 3:], second[:, 3:]
    vector = v * b + w * a + np.cross(a, b)
    scalar = v * w - np.sum(a * b, axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)


def rotate(rotation: Float64, vectors: Float64) -> Float64:
    """(N, 3) vectors turned by (N, 4) quaternions."""
    axis = rotation[:, :3]
    twice = 2.0 * np.cross(axis, vectors)
    turned: Float64 = vectors + rotation[:, 3:] * twice + np.cross(axis, twice)
    return turned


def interpolate(at_ns: Int64, stamp_ns: Int64, motion: Motion, hold_ns: int = 0) -> Motion:
    """Poses at the times `at_ns` (S,) between those at `stamp_ns` (N, increasing), NaN outside their span.

    The first and the last pose hold for `hold_ns` before and after it: what stands there is no motion made up.

    Positions go along the straight line, rotations along the shortest arc at constant rate: in the plane that is linear
    in x, y and, by the shorter way round, in yaw.
    """
    if not len(stamp_ns):
        return Motion(np.full((len(at_ns), 3), np.nan), np.full((len(at_ns), 4), np.nan))
    first, last = int(stamp_ns[0]), int(stamp_ns[-1])
    # A stamp may be as great as its type allows.
    earliest, latest = max(first - hold_ns, _STAMPS.min), min(last + hold_ns, _STAMPS.max)
    held = (at_ns >= earliest) & (at_ns <= latest)
    at_ns = np.where(held, np.clip(at_ns, first, last), at_ns)
    before = np.clip(np.searchsorted(stamp_ns, at_ns, side="right") - 1, 0, max(len(stamp_ns) - 2, 0))
    after = np.minimum(before + 1, len(stamp_ns) - 1)
    step = np.maximum(stamp_ns[after] - stamp_ns[before], 1)
    share = ((at_ns - stamp_ns[before]) / step)[:, None]
    share[(at_ns < first) | (at_ns > last)] = np.nan
    position = motion.position[before] * (1.0 - share) + motion.position[after] * share
    return Motion(position, _arc(motion.rotation[before], motion.rotation[after], share))


def _arc(start: Float64, end: Float64, share: Float64) -> Float64:
    """(N, 4) rotations a share (N, 1) of the way from start to end."""
    cosine = np.sum(start * end, axis=1, keepdims=True)
    # A quaternion and its negative are one rotation; the nearer of the two is the shorter way.
    end = np.where(cosine < 0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    wide = angle > SMALL_TURN
    sine = np.where(wide, np.sin(angle), 1.0)
    first = np.where(wide, np.sin((1.0 - share) * angle) / sine, 1.0 - share)
    second = np.where(wide, np.sin(share * angle) / sine, share)
    between = first * start + second * end
    turned: Float64 = between / np.linalg.norm(between, axis=1, keepdims=True)
    return turned


def planar(motion: Motion) -> SweepPoses:
    """The poses seen from above: the direction of the frame's x axis is the yaw."""
    x, y, z, w = motion.rotation.T
    up = 1.0 - 2.0 * (x * x + y * y)
    yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return SweepPoses(
        x=motion.position[:, 0].copy(), y=motion.position[:, 1].copy(), yaw=yaw, upside_down=up < 0.0
    )


def tilt(motion: Motion) -> float:
    """Largest angle between the frame's plane and the ground, upside down or not [rad]; 0 without a pose."""
    x, y = motion.rotation[:, 0], motion.rotation[:, 1]
    flat = np.abs(1.0 - 2.0 * (x * x + y * y))
    known = flat[~np.isnan(flat)]
    return float(np.arccos(np.clip(known.min(), 0.0, 1.0))) if len(known) else 0.0
