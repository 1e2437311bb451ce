"""The answer for a whole log: however it is cut, turned, mirrored or ended early."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from benchmarks.scenes.moving import Kind, moving_scene
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.tracking.results import END_OF_LOG
from lidarcli.formalism.tracking.tracker import WINDOW, Tracker
from lidarcli.sweeps.types import TURN, SweepBatch, SweepPoses
from tests.formalism.tracking.following import (
    SENSOR,
    TrackedLog,
    assert_same,
    assert_sums,
    batches,
    follow,
    moving_log,
    parts,
    repeated,
    simulated,
)

LOGS: tuple[tuple[Kind, bool], ...] = (
    ("room", False),
    ("room", True),
    ("hall", True),
    ("crossing", False),
    ("people", False),
)


def long_log(kind: Kind, driving: bool, seed: int = 3) -> SweepBatch:
    """About 1,000 sweeps: four windows."""
    return repeated(moving_log(kind, seed, driving=driving), 3)


@pytest.mark.parametrize(("kind", "driving"), LOGS)
def test_batches_of_any_size_give_the_same_bits(kind: Kind, driving: bool) -> None:
    log = long_log(kind, driving)
    told = follow(log)
    assert_sums(told, detect(log, Parameters()))
    assert len(told.agents) > 0
    for size in (1, 7, WINDOW, 1024):
        assert_same(told, follow(batches(log, size)))


def test_room_for_more_is_made_without_changing_anything() -> None:
    # First hardly anything, then a crowd.
    few, crowd = moving_log("room", 3), moving_log("hall", 8)
    assert detect(few).objects.max() < detect(crowd).objects.max()
    assert_same(follow([few, crowd]), follow([*batches(few, 5), *batches(crowd, 100)]))


def test_answers_come_no_later_than_two_windows() -> None:
    log = long_log("room", False)
    tracker, answered = Tracker(), 0
    for number, batch in enumerate(batches(log, 64), 1):
        answered += len(tracker.add(batch, detect(batch, Parameters())))
        assert answered >= number - 2 * WINDOW // 64
    rest, _ = tracker.finish()
    assert answered + len(rest) == number


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "driving"), LOGS)
def test_a_log_that_ends_early_was_told_alike_before(kind: Kind, driving: bool) -> None:
    log = long_log(kind, driving)
    told = follow(log)
    for stop in (40, 257, 511, 512, 513, 700, 901):
        short = follow(parts(log, [stop])[0])
        # Whatever was settled by then: rows up to one look-ahead before.
        settled = max((stop // WINDOW - 1) * WINDOW, 0)
        same = told.row < settled
        for name in ("track", "vx", "vy", "moving", "set"):
            np.testing.assert_array_equal(told.columns[name][same], short.columns[name][: same.sum()], err_msg=name)
        # The log has ended, so has nothing else that was there in the last sweep.
        there = np.isin(short.tracks.track, short.columns["track"][short.row == stop - 1])
        assert (short.tracks.end[there] == END_OF_LOG).all()


def turned(log: SweepBatch, beams: int) -> SweepBatch:
    """The same as a sensor sees it that is turned by so many beams of a full turn."""
    assert log.poses is None
    return replace(log, ranges=np.roll(log.ranges, beams, axis=1), status=np.roll(log.status, beams, axis=1))


def mirrored(log: SweepBatch) -> SweepBatch:
    """The same world with left and right exchanged: bearing θ becomes -θ."""
    ranges, status = log.ranges[:, ::-1], log.status[:, ::-1]
    first = -(log.angle_min + log.angle_increment * (log.beams - 1))
    return replace(log, ranges=ranges.copy(), status=status.copy(), angle_min=first)


def full_turn(kind: Kind, seed: int) -> SweepBatch:
    """A scene as seen by a sensor that stands, each bearing once."""
    sensor = replace(SENSOR, beams=360, angle_increment=TURN / 360)
    return simulated(moving_scene(kind, seed, sensor, legged=kind == "people"), seed=seed)


UNDOUBTED = Parameters(min_thing=0.1)
"""Where a verdict is close, the beam on the bearing that is measured twice may turn it: here none is."""
PLACES: tuple[tuple[Kind, int], ...] = (("room", 3), ("hall", 4), ("crossing", 5), ("people", 6))
SWAPPED = pytest.mark.xfail(
    reason="which piece of a track goes on as which person may depend on the last bit", strict=False
)


def matched(one: TrackedLog, other: TrackedLog, order: Any) -> float:
    """Share of the objects whose track is the same but for its number; `order` are those of `other`."""
    mine, its = one.columns["track"], other.columns["track"][order]
    pairs, counts = np.unique(np.stack([mine, its]), axis=1, return_counts=True)
    best = 0
    for number in np.unique(mine):
        best += counts[pairs[0] == number].max()
    return float(best / len(mine))


def order_of(one: TrackedLog, other: TrackedLog, bearing: Any) -> Any:
    """Which object of `other` each of `one` is, whose bearings are in its frame."""
    order = np.empty(len(one.row), np.int64)
    own = np.arctan2(other.detection["y"], other.detection["x"])
    for sweep in range(int(one.row.max()) + 1):
        mine, its = np.flatnonzero(one.row == sweep), np.flatnonzero(other.row == sweep)
        assert len(mine) == len(its)
        off = np.abs((bearing[mine, None] - own[None, its] + np.pi) % TURN - np.pi)
        order[mine] = its[off.argmin(axis=1)]
    assert len(np.unique(order)) == len(order)
    return order


def assert_alike(one: TrackedLog, other: TrackedLog, order: Any, cos: float, sin: float, side: float) -> None:
    """The same tracks, and velocities turned, then mirrored where the side is -1.

    Discs are measured along the axes of the frame, so that hardly anything is the same to the last bit.
    """
    assert matched(one, other, order) > 0.97
    agents = one.columns["set"] == AGENT
    assert (agents == (other.columns["set"][order] == AGENT)).mean() > 0.97
    vx, vy = other.columns["vx"][order], other.columns["vy"][order]
    expected_x = cos * one.columns["vx"] - sin * one.columns["vy"]
    expected_y = side * (sin * one.columns["vx"] + cos * one.columns["vy"])
    off = np.hypot(vx - expected_x, vy - expected_y)[agents]
    assert np.nanmedian(off) < 0.01
    assert np.nanmean(off < 0.2) > 0.95


@pytest.mark.parametrize(
    ("kind", "seed", "beams"),
    [
        pytest.param(kind, seed, beams, marks=SWAPPED if kind == "hall" else ())
        for kind, seed in PLACES
        for beams in (90, 180, 37)
    ],
)
def test_a_sensor_that_is_turned_tells_the_same(kind: Kind, seed: int, beams: int) -> None:
    log = full_turn(kind, seed)
    one, other = follow(log, UNDOUBTED), follow(turned(log, beams), UNDOUBTED)
    angle = beams * float(log.angle_increment[0])
    bearing = np.arctan2(one.detection["y"], one.detection["x"]) + angle
    assert_alike(one, other, order_of(one, other, bearing), np.cos(angle), np.sin(angle), 1.0)


@pytest.mark.parametrize(("kind", "seed"), PLACES)
def test_a_mirrored_world_is_told_mirrored(kind: Kind, seed: int) -> None:
    log = full_turn(kind, seed)
    one, other = follow(log, UNDOUBTED), follow(mirrored(log), UNDOUBTED)
    order = order_of(one, other, -np.arctan2(one.detection["y"], one.detection["x"]))
    assert_alike(one, other, order, 1.0, 0.0, -1.0)


def seen_backwards(log: SweepBatch) -> SweepBatch:
    """The same beams from the last to the first."""
    return replace(
        log,
        ranges=log.ranges[:, ::-1].copy(),
        status=log.status[:, ::-1].copy(),
        angle_min=log.angle_min + log.angle_increment * (log.beams - 1),
        angle_increment=-log.angle_increment,
    )


def in_world(log: SweepBatch, x: float, y: float, yaw: float) -> SweepBatch:
    """The same in a world whose axes lie elsewhere."""
    assert log.poses is not None
    cos, sin, poses = np.cos(yaw), np.sin(yaw), log.poses
    return replace(
        log,
        poses=replace(poses, x=x + cos * poses.x - sin * poses.y, y=y + sin * poses.x + cos * poses.y, yaw=poses.yaw + yaw),
    )


@pytest.mark.parametrize("kind", ["room", "hall"])
def test_beams_that_run_the_other_way_tell_the_same(kind: Kind) -> None:
    # Of the two beams at the seam the other one counts: in half of the halls a body there is told otherwise.
    log = moving_log(kind, 5, driving=True)
    one, other = follow(log, UNDOUBTED), follow(seen_backwards(log), UNDOUBTED)
    assert_alike(one, other, np.arange(len(one.row)), 1.0, 0.0, 1.0)


@pytest.mark.parametrize("kind", ["room", "hall"])
def test_a_sensor_that_hangs_head_down_tells_the_same(kind: Kind) -> None:
    # Of the two beams at the seam the mirror counts the other one: in half of the halls a body there is told otherwise.
    log = moving_log(kind, 7, driving=True)
    assert log.poses is not None
    hung = mirrored(log)
    hung = replace(hung, poses=replace(log.poses, upside_down=~log.poses.upside_down))
    one, other = follow(log, UNDOUBTED), follow(hung, UNDOUBTED)
    order = order_of(one, other, -np.arctan2(one.detection["y"], one.detection["x"]))
    assert_alike(one, other, order, 1.0, 0.0, 1.0)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 2.0])
@pytest.mark.parametrize("kind", ["room", "hall"])
def test_where_the_axes_of_the_world_lie_changes_nothing(kind: Kind, yaw: float) -> None:
    log = moving_log(kind, 3, driving=True)
    one, other = follow(log), follow(in_world(log, 100.0, -50.0, yaw))
    assert_alike(one, other, np.arange(len(one.row)), np.cos(yaw), np.sin(yaw), 1.0)


@pytest.mark.parametrize("kind", ["people", "hall", "room"])
def test_a_sensor_that_is_told_to_stand_tells_what_one_without_a_pose_does(kind: Kind) -> None:
    log = moving_log(kind, 3)
    nothing = np.zeros(len(log))
    told = replace(log, poses=SweepPoses(nothing, nothing, nothing, np.zeros(len(log), np.bool_)))
    one, other = follow(log), follow(told)
    assert_alike(one, other, np.arange(len(one.row)), 1.0, 0.0, 1.0)


def test_numbers_are_those_of_first_sight() -> None:
    told = follow(long_log("hall", True))
    assert told.tracks.track.tolist() == list(range(1, len(told.tracks) + 1))
    first = [told.row[told.of(number)][0] for number in told.tracks.track]
    assert all(before <= after for before, after in pairwise(first))
    np.testing.assert_array_equal(told.tracks.first_sweep, first)
    last = [told.row[told.of(number)][-1] for number in told.tracks.track]
    np.testing.assert_array_equal(told.tracks.last_sweep, last)
    seen = [len(np.unique(told.row[told.of(number)])) for number in told.tracks.track]
    np.testing.assert_array_equal(told.tracks.sweeps, seen)
