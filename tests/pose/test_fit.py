"""Told paths beside matched ones: which fit, with which delay and mount, where they jump, and who stands."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from lidarcli.pose.fit import (
    LEAST_PAIRS,
    MOST_PAIRS,
    PoseFit,
    joined,
    judge_poses,
    jumps_of,
    poses_after,
    stands,
    still_at,
    wrapped,
)
from lidarcli.pose.tracks import SECOND_NS
from lidarcli.sweeps import Float64, Int64
from tests.pipeline.drawn import round_about, stamps, straight
from tests.pose.pose_messages import odometry
from tests.pose.test_sources import sources

COUNT = 200
SECONDS = np.arange(COUNT) * 0.1
STAMPS = stamps(COUNT)
TRUE = round_about(SECONDS)


def told_by(chain: Callable[[Float64], Float64]) -> Callable[[Int64], Float64]:
    """Poses at stamps by a way, which is told from 1 s before the first sweep to 1 s after the last one."""

    def at(stamp_ns: Int64) -> Float64:
        seconds = (stamp_ns - STAMPS[0]) / SECOND_NS
        poses = chain(seconds)
        poses[(seconds < -1.0) | (seconds > SECONDS[-1] + 1.0)] = np.nan
        return poses

    return at


def judged(chain: Callable[[Float64], Float64], matched: Float64 = TRUE, pieces: Float64 | None = None) -> PoseFit:
    """The verdict on a told way."""
    rng = np.random.default_rng(1)
    seen = matched + rng.normal(0.0, [0.003, 0.003, 0.001], matched.shape)
    return judge_poses(STAMPS[: len(matched)], seen, told_by(chain), pieces)


def late(seconds: Float64, delay: float) -> Float64:
    """Poses that are told so much too late."""
    return round_about(seconds - delay)


def scaled(seconds: Float64, length: float, turn: float = 1.0) -> Float64:
    """Poses in other units."""
    return round_about(seconds) * [length, length, turn]


# --- the verdict --------------------------------------------------------------------------------------------


def test_a_path_that_is_true_is_accepted() -> None:
    fit = judged(round_about)
    assert (fit.verdict, fit.share, fit.delay, fit.mount) == ("accepted", 1.0, 0.0, (0.0, 0.0, 0.0))
    assert LEAST_PAIRS < fit.pairs <= MOST_PAIRS
    assert (fit.cuts, fit.jumps, fit.good) == ((), (), ())


@pytest.mark.parametrize("delay", [-0.5, -0.4, -0.3, -0.25, -0.2, -0.13, -0.07, 0.07, 0.13, 0.2, 0.25, 0.3, 0.4, 0.5])
def test_a_delay_is_found(delay: float) -> None:
    fit = judged(partial(late, delay=delay))
    assert fit.verdict == "corrected"
    assert fit.delay == pytest.approx(delay, abs=0.011)
    assert fit.mount == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert fit.share > 0.98


@pytest.mark.parametrize("mount", [(0.2, 0.05, 0.0), (0.0, 0.0, 0.5 * np.pi), (-0.15, 0.1, np.pi), (0.3, 0.0, -0.4)])
def test_a_mount_is_found(mount: tuple[float, float, float]) -> None:
    fit = judged(round_about, poses_after(TRUE, np.array(mount)))
    assert fit.delay == 0.0
    if fit.verdict == "accepted":
        # A sensor a little ahead of the robot makes nearly the same steps.
        assert mount == (0.2, 0.05, 0.0)
        return
    assert fit.verdict == "corrected"
    assert fit.mount[:2] == pytest.approx(mount[:2], abs=0.03)
    assert abs(wrapped(np.array(fit.mount[2] - mount[2]))) < 0.02


@pytest.mark.parametrize(
    ("length", "turn", "ratio", "turn_ratio"),
    [
        (1000.0, 1.0, 1000.0, 1.0),
        (39.37, 1.0, 39.37, 1.0),
        (0.5, 1.0, 0.5, 1.0),
        (0.0, 0.0, 0.0, 0.0),
        (1.0, -1.0, 1.0, -1.0),
    ],
)
def test_poses_in_other_units_are_rejected_with_their_ratio(
    length: float, turn: float, ratio: float, turn_ratio: float
) -> None:
    fit = judged(partial(scaled, length=length, turn=turn))
    assert (fit.verdict, fit.delay) == ("rejected", 0.0)
    assert fit.share < 0.5
    assert fit.ratio == pytest.approx(ratio, rel=0.05, abs=0.02)
    assert fit.turn_ratio == pytest.approx(turn_ratio, rel=0.1, abs=0.05)


def test_stretches_that_fit_are_told() -> None:
    def half(seconds: Float64) -> Float64:
        poses = round_about(seconds)
        poses[seconds > 10.0, 2] += 0.5
        return poses

    fit = judged(half)
    assert fit.verdict == "stretches"
    assert 0.4 < fit.share < 0.7
    assert fit.good[0][0] == STAMPS[0]
    # On the spot a wrong heading makes no difference.
    begins = np.array([(first - STAMPS[0]) / SECOND_NS for first, _ in fit.good])
    assert np.mean(begins < 10.0) > 0.7


def test_too_little_is_unchecked() -> None:
    for fit in (
        judged(round_about, TRUE[:12]),
        judged(round_about, np.where(np.arange(COUNT)[:, None] % 5 < 2, np.nan, TRUE)),
        judged(lambda seconds: np.zeros((len(seconds), 3)), np.zeros((COUNT, 3))),
        judge_poses(STAMPS[:0], TRUE[:0], told_by(round_about)),
    ):
        assert fit.verdict == "unchecked"
        assert np.isnan(fit.share)
        assert (fit.delay, fit.mount) == (0.0, (0.0, 0.0, 0.0))


# --- jumps --------------------------------------------------------------------------------------------------


def jumps_in(poses: Float64, step: float = 0.1) -> tuple[list[float], float]:
    """Lengths and share of the jumps of odometry."""
    messages = [
        odometry(int(stamp), "odom", "laser", tuple(pose))
        for stamp, pose in zip(stamps(len(poses), step), poses, strict=True)
    ]
    chain = sources(messages).chain("laser")
    assert chain is not None
    found = jumps_of(chain)
    assert len(found.gaps_ns) == len(found.lengths)
    assert (np.diff(found.gaps_ns, axis=1) == round(step * SECOND_NS)).all()
    return found.lengths.tolist(), found.share


def test_jumps_are_longer_and_faster_than_any_sensor() -> None:
    assert jumps_in(TRUE) == ([], 0.0)
    far = TRUE.copy()
    far[100:] += [3.0, 0.0, 0.0]
    lengths, share = jumps_in(far)
    assert lengths == pytest.approx([3.0], abs=0.1)
    assert share == pytest.approx(1.0 / 199.0)
    # A car at 9 m/s jumps not, and 0.4 m are no jump however fast.
    assert jumps_in(np.outer(SECONDS, [9.0, 0.0, 0.0])) == ([], 0.0)
    assert jumps_in(np.outer(SECONDS, [11.0, 0.0, 0.0]))[1] == 1.0
    assert jumps_in(np.outer(np.arange(COUNT), [0.4, 0.0, 0.0]), 0.02) == ([], 0.0)


def test_parts_between_jumps_are_joined() -> None:
    told = TRUE.copy()
    told[60:] = poses_after(np.tile([5.0, 1.0, 2.0], (140, 1)), TRUE[60:])
    told[120:] = poses_after(np.tile([-7.0, 3.0, -1.0], (80, 1)), TRUE[120:])
    cuts = tuple((int(STAMPS[first - 1]), int(STAMPS[first])) for first in (60, 120))
    gaps, moves, lost = joined(STAMPS, TRUE, np.ones(COUNT), told, cuts)
    assert not lost
    assert gaps.tolist() == [list(cut) for cut in cuts]
    part = np.searchsorted(gaps[:, 1], STAMPS, "right")
    found = poses_after(moves[part], told)
    np.testing.assert_allclose(found[:, :2], TRUE[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(found[:, 2] - TRUE[:, 2]), 1.0)


def test_poses_that_go_back_and_forth_are_of_two_publishers() -> None:
    """Each is near those of its own publisher, however slowly both drift apart."""
    for publishers in (2, 3):
        apart = TRUE.copy()
        apart[:, 0] += 0.45 * (np.arange(COUNT) % publishers)
        assert jumps_in(apart)[1] > 0.6
    # One outlier, noise, and a way there and back are of one.
    spike = TRUE.copy()
    spike[50, 0] += 0.3
    assert jumps_in(spike) == ([], 0.0)
    assert jumps_in(TRUE + np.random.default_rng(5).normal(0.0, [0.1, 0.1, 0.0], TRUE.shape))[1] < 0.2
    assert jumps_in(np.abs(np.outer(np.arange(COUNT) % 40 - 20, [0.15, 0.0, 0.0]))) == ([], 0.0)


# --- standing -----------------------------------------------------------------------------------------------


def test_who_stands() -> None:
    rng = np.random.default_rng(2)
    parked = rng.normal(0.0, [0.003, 0.003, 0.001], (COUNT, 3))
    fixed = np.zeros(COUNT)
    assert stands(parked, fixed)
    assert still_at(STAMPS, parked, fixed).all()
    # Some outliers are none of its motion.
    parked[7] = (1.0, 0.0, 0.0)
    assert stands(parked, fixed)
    assert not stands(TRUE, fixed)
    assert not stands(straight(SECONDS), fixed)
    turning = np.column_stack([np.zeros((COUNT, 2)), 0.1 * SECONDS])
    assert not stands(turning, fixed)
    assert not still_at(STAMPS, turning, fixed).any()


def test_who_stops_stands_then() -> None:
    x = np.clip((SECONDS - 8.0) * 0.3, 0.0, 1.2)
    poses = np.column_stack([x, 0.0 * x, 0.0 * x])
    still = still_at(STAMPS, poses, np.zeros(COUNT))
    assert still.shape == (COUNT,)
    assert still[(SECONDS < 7.0) | (SECONDS > 13.0)].all()
    assert not still[(SECONDS > 8.5) & (SECONDS < 11.5)].any()
    # Sweeps without a pose are between those before and after.
    poses[30:35] = np.nan
    assert still_at(STAMPS, poses, np.zeros(COUNT)).tolist() == still.tolist()
