"""Told paths beside matched ones: which fit, with which delay and mount, where they jump, and who stands."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from lidarcli.options.times import SECOND_NS
from lidarcli.pose.fit import MAX_PAIRS, MIN_PAIRS, PoseFit, evaluate_poses, far_delay, jump_of, poses_after
from lidarcli.pose.matched import stands, still_at, wrapped
from lidarcli.sweeps.types import Float64, Int64
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
    return evaluate_poses(STAMPS[: len(matched)], seen, told_by(chain), pieces)


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
    assert MIN_PAIRS < fit.pairs <= MAX_PAIRS


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


def test_too_little_is_unchecked() -> None:
    for fit in (
        judged(round_about, TRUE[:12]),
        judged(round_about, np.where(np.arange(COUNT)[:, None] % 5 < 2, np.nan, TRUE)),
        judged(lambda seconds: np.zeros((len(seconds), 3)), np.zeros((COUNT, 3))),
        evaluate_poses(STAMPS[:0], TRUE[:0], told_by(round_about)),
    ):
        assert fit.verdict == "unchecked"
        assert np.isnan(fit.share)
        assert (fit.delay, fit.mount) == (0.0, (0.0, 0.0, 0.0))


# --- jumps --------------------------------------------------------------------------------------------------


def jump_in(poses: Float64, step: float = 0.1) -> float:
    """Return the longest jump of odometry."""
    messages = [
        odometry(int(stamp), "odom", "laser", tuple(pose))
        for stamp, pose in zip(stamps(len(poses), step), poses, strict=True)
    ]
    chain = sources(messages).chain("laser")
    assert chain is not None
    return jump_of(chain)[0]


def test_jumps_are_longer_and_faster_than_any_sensor() -> None:
    assert jump_in(TRUE) == 0.0
    far = TRUE.copy()
    far[100:] += [3.0, 0.0, 0.0]
    assert jump_in(far) == pytest.approx(3.0, abs=0.1)
    # A car at 9 m/s jumps not, and 0.4 m are no jump however fast.
    assert jump_in(np.outer(SECONDS, [9.0, 0.0, 0.0])) == 0.0
    assert jump_in(np.outer(SECONDS, [11.0, 0.0, 0.0])) == pytest.approx(1.1)
    assert jump_in(np.outer(np.arange(COUNT), [0.4, 0.0, 0.0]), 0.02) == 0.0
    # Stamps that tell no times tell no speed.
    assert jump_in(np.outer(np.arange(COUNT), [3.0, 0.0, 0.0]), 1e-6) == 0.0


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


def test_links_that_are_never_known_at_the_same_time_have_no_delay() -> None:
    stamp_ns = np.arange(30, dtype=np.int64) * 100_000_000
    path = np.column_stack([0.1 * np.arange(30.0), np.zeros(30), np.zeros(30)])
    # The first link is known from two years after the last stamp of the second.
    span_ns = (63_072_000 * 1_000_000_000, int(stamp_ns[-1]))
    asked: list[int] = []

    def given_at(at_ns: Int64) -> Float64:
        asked.append(len(at_ns))
        return np.full((len(at_ns), 3), np.nan)

    assert far_delay(stamp_ns, path, given_at, None, span_ns, 0) is None
    assert not asked
