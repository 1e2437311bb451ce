"""Which sweeps say something new: against one sweep after the other, and whatever the cut into batches."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.mapping.grid import PAUSE_NS, MotionFilter
from lidarcli.sweeps.types import Int64, SweepPoses

SECOND = 1_000_000_000


def poses_of(x: object, y: object = 0.0, yaw: object = 0.0) -> SweepPoses:
    told = np.broadcast_arrays(*(np.atleast_1d(np.asarray(each, float)) for each in (x, y, yaw)))
    return SweepPoses(*(each.copy() for each in told), np.zeros(len(told[0]), bool))


def every(count: int, seconds: float = 0.1) -> Int64:
    """Stamps of so many sweeps."""
    return 1_700_000_000 * SECOND + np.arange(count) * np.int64(seconds * SECOND)


def wander(seed: int, count: int = 400) -> tuple[SweepPoses, Int64]:
    """A robot that goes, turns, waits, and does not always know where it is."""
    random = np.random.default_rng(seed)
    goes = np.repeat(random.random(count // 10) < 0.6, 10)
    step = random.normal(0.0, 0.04, (count, 3)) * goes[:, None] * (1.0, 1.0, 2.0)
    x, y, yaw = 5.0 + np.cumsum(step, axis=0).T
    for values in (x, y, yaw):
        values[random.random(count) < 0.02] = np.nan
    # Some drivers tell angles from -π on, others count turns.
    yaw = np.where(random.random(count) < 0.5, yaw, yaw - 2 * np.pi)
    gaps = np.where(random.random(count) < 0.01, 6.0, random.uniform(0.05, 0.15, count))
    stamps = 1_700_000_000 * SECOND + np.cumsum(np.rint(gaps * SECOND)).astype(np.int64)
    return poses_of(x, y, yaw), stamps


def one_by_one(poses: SweepPoses, stamps: Int64, min_move: float) -> tuple[list[int], int]:
    """The sweeps that count, and how many have no pose."""
    taken: list[int] = []
    unplaced = 0
    for k, (x, y, yaw) in enumerate(zip(poses.x.tolist(), poses.y.tolist(), poses.yaw.tolist(), strict=True)):
        if any(math.isnan(value) for value in (x, y, yaw)):
            unplaced += 1
            continue
        if min_move and taken:
            last = taken[-1]
            far = math.dist((x, y), (poses.x[last], poses.y[last]))
            turned = math.acos(max(-1.0, min(1.0, math.cos(yaw - poses.yaw[last]))))
            waited = int(stamps[k]) - int(stamps[last])
            if far < min_move and math.degrees(turned) < 10.0 and waited < 5 * SECOND:
                continue
        taken.append(k)
    return taken, unplaced


@pytest.mark.parametrize("min_move", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_it_agrees_with_one_by_one(seed: int, min_move: float) -> None:
    poses, stamps = wander(seed)
    motion = MotionFilter(min_move)
    taken = motion.take(poses, stamps)
    assert (taken.tolist(), motion.unplaced) == one_by_one(poses, stamps, min_move)
    assert 5 < motion.unplaced < 60
    assert len(taken) == 400 - motion.unplaced if min_move == 0.0 else 20 < len(taken) < 300


def test_who_waits_counts_every_five_seconds() -> None:
    assert PAUSE_NS == 5 * SECOND
    motion = MotionFilter(0.1)
    taken = motion.take(poses_of(np.zeros(201)), every(201))
    assert taken.tolist() == [0, 50, 100, 150, 200]
    # A clock that is set back is a wait like another.
    back = MotionFilter(0.1)
    stamps = np.concatenate([every(3) + 60 * SECOND, every(3)])
    assert back.take(poses_of(np.zeros(6)), stamps).tolist() == [0, 3]
