"""Logs that no robot writes: nothing crashes, Definition 4 sums, and the answer does not depend on batches."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, super_ellipse
from lidarcli.sweeps.types import SweepBatch, SweepPoses
from tests.formalism.test_compiled import run_core
from tests.formalism.tracking.following import assert_same, assert_sums, batches, follow, moving_log, scene_of, simulated
from tests.formalism.tracking.hostile import hostile_logs


def joined(log: list[SweepBatch]) -> SweepBatch:
    """All sweeps of a log in one batch, as wide as the widest."""
    width = max(batch.width for batch in log)

    def padded(name: str, empty: float) -> Any:
        rows = [np.full((len(batch), width), empty, getattr(batch, name).dtype) for batch in log]
        for row, batch in zip(rows, log, strict=True):
            row[:, : batch.width] = getattr(batch, name)
        return np.concatenate(rows)

    first = log[0]
    names = [one.name for one in fields(first) if np.shape(getattr(first, one.name)) == (len(first),)]
    columns = {name: np.concatenate([getattr(batch, name) for batch in log]) for name in names}
    poses = None
    if log[0].poses is not None:
        told = ("x", "y", "yaw", "upside_down")
        poses = SweepPoses(*(np.concatenate([getattr(batch.poses, name) for batch in log]) for name in told))
    return replace(log[0], ranges=padded("ranges", np.nan), status=padded("status", 4), poses=poses, **columns)


def test_some_hostile_logs_are_followed_and_definition_4_sums() -> None:
    tracks = 0
    for log, parameters in hostile_logs(150):
        told = follow(log, parameters)
        assert_sums(told, detect(joined(log), parameters))
        tracks += len(told.tracks)
    assert tracks > 50


@pytest.mark.whole
def test_many_hostile_logs_are_followed_and_definition_4_sums() -> None:
    for log, parameters in hostile_logs(1000, seed=7):
        assert_sums(follow(log, parameters), detect(joined(log), parameters))


@pytest.mark.whole
def test_hostile_logs_touch_nothing_outside_of_their_arrays() -> None:
    run_core("-m", "tests.formalism.tracking.digests", "150", core="no", bounds="1")


@pytest.mark.whole
def test_hostile_logs_are_told_alike_however_they_are_cut() -> None:
    for log, parameters in hostile_logs(600):
        whole = joined(log)
        told = follow(log, parameters)
        for size in (1, 5, len(whole)):
            assert_same(told, follow(batches(whole, size), parameters))


def test_scenes_touch_nothing_outside_of_their_arrays() -> None:
    code = (
        "from tests.formalism.tracking.following import *\n"
        "for kind, driving in (('people', False), ('room', True)):\n"
        "    log = moving_log(kind, 5, driving=driving).rows(np.arange(60))\n"
        "    print(len(follow(log).tracks))\n"
    )
    assert all(int(line) > 0 for line in run_core("-c", code, core="no", bounds="1").split())


def standing() -> SweepBatch:
    """Two things that stand, and a sensor that does as well."""
    return simulated(scene_of(make.box(2.0, 0.3, 0.6, 0.4), make.cylinder(-2.0, 1.0, 0.15)), 60, poses=True)


def poses_of(batch: SweepBatch, rows: Any, **values: float) -> SweepBatch:
    """The same with other poses for some sweeps."""
    assert batch.poses is not None
    told = {name: getattr(batch.poses, name).copy() for name in ("x", "y", "yaw")}
    for name, value in values.items():
        told[name][rows] = value
    return replace(batch, poses=replace(batch.poses, **told))


def test_sweeps_without_a_pose_have_no_tracks_and_end_none() -> None:
    log = poses_of(standing(), slice(20, 31), x=np.nan, y=np.nan, yaw=np.nan)
    told = follow(log)
    assert_sums(told, detect(log, Parameters()))
    without = np.isin(told.row, np.arange(20, 31))
    assert (told.columns["track"][without] == 0).all()
    assert (told.columns["track"][~without] > 0).mean() > 0.9
    assert len(told.tracks) == 2
    assert told.tracks.hidden == pytest.approx([1.1, 1.1])
    assert told.tracks.sweeps.tolist() == [49, 49]
    assert not told.tracks.moved.any()


@pytest.mark.parametrize("kind", ["back", "still", "zero", "far"])
def test_stamps_may_jump_back_or_stand_still(kind: str) -> None:
    log = standing()
    stamps = log.stamp_ns.copy()
    if kind == "back":
        stamps[30:] -= 50_000_000_000
    elif kind == "still":
        stamps[10:40] = stamps[10]
    elif kind == "zero":
        stamps[:] = 0
    else:
        stamps[30:] = np.iinfo(np.int64).max - 10**12
    told = follow(replace(log, stamp_ns=stamps))
    # After a pause of centuries nobody knows what is what.
    assert len(told.tracks) == 2 or (kind == "far" and len(told.tracks) <= 4)
    assert not told.tracks.moved.any()
    assert (told.columns["track"] > 0).mean() > 0.9


def test_the_number_of_beams_may_change() -> None:
    log = standing()
    other = simulated(
        scene_of(
            make.box(2.0, 0.3, 0.6, 0.4),
            make.cylinder(-2.0, 1.0, 0.15),
            sensor=replace(moving_sensor(), beams=1081, angle_increment=2 * np.pi / 1081),
        ),
        60,
        poses=True,
    )
    pieces = [one for pair in zip(batches(log, 7), batches(other, 7), strict=True) for one in pair]
    step = int(log.stamp_ns[1] - log.stamp_ns[0])
    first, turned = int(log.stamp_ns[0]), []
    for piece in pieces:
        before = sum(map(len, turned))
        turned.append(
            replace(piece, sweep=before + np.arange(len(piece)), stamp_ns=first + step * (before + np.arange(len(piece))))
        )
    told = follow(turned)
    assert len(told.tracks) == 2
    assert told.tracks.sweeps.tolist() == [120, 120]


def moving_sensor() -> Any:
    """The sensor of the scenes."""
    return scene_of().sensor


@pytest.mark.slow
def test_the_longest_log_keeps_no_more_than_a_short_one() -> None:
    log = moving_log("people", 4)
    tracker, most = Tracker(), []
    stamp = int(log.stamp_ns[1] - log.stamp_ns[0])
    sweeps = 0
    while sweeps < 20_000:
        index = sweeps + np.arange(len(log))
        batch = replace(log, sweep=index, stamp_ns=log.stamp_ns[0] + stamp * index)
        tracker.add(batch, detect(batch, Parameters()))
        sweeps += len(log)
        (sensor,) = tracker._followers
        most.append(
            (
                sensor.tracker.targets.capacity,
                sensor.tracker.sightings.capacity,
                sensor.tracker.sightings.count,
                len(sensor.register.tracklets),
                len(tracker._pending),
                len(tracker._windows),
            )
        )
    early, late = np.max(most[:10], axis=0), np.max(most[-10:], axis=0)
    assert (late <= 2 * early).all(), (early, late)
    assert late[0] <= 256
    assert late[3] < 100
    assert late[5] <= 3


def test_sweeps_a_nanosecond_apart_do_not_move_what_stands() -> None:
    """Nobody drives as fast as the steps of the path would be; after a pause all is still where it was."""
    path = Course(super_ellipse(3.0, 2.2, 2.5, points=36_000), speed=0.8)
    log = simulated(scene_of(make.box(2.0, 0.3, 0.6, 0.4), make.cylinder(-1.0, 0.5, 0.05), path=path), 80)
    stamps = log.stamp_ns[0] + np.arange(80) + 10**13 * (np.arange(80) >= 60)
    tracks = follow(replace(log, stamp_ns=stamps)).tracks
    assert len(tracks) >= 2
    assert (np.hypot(tracks.x, tracks.y) < 12.0).all()
    assert np.nanmax(tracks.length) < 3.0
