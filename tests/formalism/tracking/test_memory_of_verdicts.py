"""What a thing is, is decided by all sweeps that saw it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lidarcli
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.detection import NOISE, OBJECT, WALL
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import Followed, Tracks
from lidarcli.formalism.tracking.tracker import Standing, Tracker
from lidarcli.simulate import entities as make
from lidarcli.sweeps import SweepBatch
from tests.formalism.tracking.following import scene_of, simulated

SWEEPS = 60


def log() -> tuple[SweepBatch, Detection]:
    """Two boxes that stand, one to the left and one to the right."""
    batch = simulated(scene_of(make.box(2.0, 1.0, 0.5, 0.4), make.box(2.0, -1.0, 0.4, 0.5)), SWEEPS)
    return batch, detect(batch, Parameters(min_thing=0.0))


def told(
    batch: SweepBatch, found: Detection, least: float, *, memory: bool = True
) -> tuple[Followed, Tracks]:
    """What a tracker says of one batch."""
    tracker = Tracker(TrackParameters(memory=memory), None, least)
    answers = tracker.add(batch, found)
    rest, tracks = tracker.finish()
    (one,) = answers + rest
    return one, tracks


def with_odds(found: Detection, left: np.ndarray) -> Detection:
    """As if the box to the left were a thing with these probabilities, sweep by sweep, and the other one surely."""
    return replace(found, thing=np.where(found.y > 0, left[found.row], 0.95))


def test_one_sweep_in_doubt_does_not_turn_a_verdict() -> None:
    batch, found = log()
    shares = np.full(SWEEPS, 0.9)
    shares[[7, 20, 21]] = 0.02
    one, tracks = told(batch, with_odds(found, shares), 0.3)
    assert (one.set == OBJECT).all()
    assert len(tracks) == 2
    alone, _ = told(batch, with_odds(found, shares), 0.3, memory=False)
    assert (alone.set == OBJECT).all()
    np.testing.assert_array_equal(np.unique(one.thing[found.y > 0]).size, 1)


def test_what_is_mostly_taken_for_building_is_building_all_along() -> None:
    batch, found = log()
    shares = np.full(SWEEPS, 0.1)
    shares[::6] = 0.8
    one, tracks = told(batch, with_odds(found, shares), 0.3)
    left = found.y > 0
    assert (one.set[left] == NOISE).all()
    assert (one.shape[left] == WALL).all()
    assert (one.track[left] == 0).all()
    assert (one.set[~left] == OBJECT).all()
    assert tracks.track.tolist() == [1]
    assert one.objects.tolist() == [1] * SWEEPS
    assert (one.object_beams + one.agent_beams + one.noise_beams == batch.beams).all()
    # What is left is numbered anew, and walls come last.
    assert one.object[~left].tolist() == [1] * SWEEPS
    assert one.object[left].tolist() == [2] * SWEEPS


def test_what_no_sweep_has_decided_stays_a_thing() -> None:
    batch, found = log()
    one, tracks = told(batch, replace(found, thing=np.full(len(found), np.nan)), 0.9)
    assert (one.set == OBJECT).all()
    assert np.isnan(one.thing).all()
    assert len(tracks) == 2


def test_shapes_do_not_change_from_sweep_to_sweep() -> None:
    batch, found = log()
    shapes = found.shape.copy()
    shapes[::9] = 3
    one, _ = told(batch, replace(found, shape=shapes), 0.0)
    assert len(np.unique(one.shape[found.y > 0])) == 1
    again, _ = told(batch, replace(found, shape=shapes), 0.0, memory=False)
    np.testing.assert_array_equal(again.shape, shapes)


def test_a_sensor_stands_where_most_ranges_stay() -> None:
    batch, _ = log()
    assert Standing().see(batch).all()
    driven = replace(batch, ranges=batch.ranges + 0.2 * np.arange(SWEEPS, dtype=np.float32)[:, None])
    assert Standing().see(driven).tolist() == [True] + [False] * (SWEEPS - 1)
    whole, halves = Standing(), Standing()
    first, second = batch.rows(np.arange(30)), batch.rows(np.arange(30, SWEEPS))
    both = np.concatenate([halves.see(first), halves.see(second)])
    np.testing.assert_array_equal(whole.see(batch), both)


def test_without_a_place_each_sweep_is_for_itself() -> None:
    """Nobody tells where the sensor is, and it does not stand: what seems one thing may be several."""
    batch, found = log()
    shares = np.full(SWEEPS, 0.9)
    shares[20:30] = 0.02
    moved = batch.ranges + 0.2 * np.arange(SWEEPS, dtype=np.float32)[:, None]
    one, _ = told(replace(batch, ranges=moved), with_odds(found, shares), 0.3)
    left = found.y > 0
    refused = np.isin(found.row, np.arange(20, 30)) & left
    np.testing.assert_array_equal(one.set == NOISE, refused)


@pytest.mark.parametrize("memory", [False, True])
def test_memory_is_an_option_of_detect_and_of_track(memory: bool) -> None:
    batch, _ = log()
    objects = lidarcli.detect(batch, memory=memory)
    assert objects["track"].null_count == len(objects) == 2 * SWEEPS
    tables = lidarcli.track(batch, memory=memory)
    assert tables.objects["track"].null_count == 0
    shapes = [len(set(tables.objects["shape"].to_pylist()))]
    assert shapes[0] >= 1
    if memory:
        assert objects["shape"].to_pylist() == tables.objects["shape"].to_pylist()
