"""Two sensor frames on one topic: each is followed as if it were alone."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from lidarcli.formalism.tracking import tracker as tracking
from lidarcli.formalism.tracking.results import Tracks
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Motion
from lidarcli.sweeps import _BATCH_ROW_FIELDS, SweepBatch, SweepPoses
from tests.formalism.tracking.following import PER_OBJECT, assert_same, batches, follow, scene_of, simulated

COUNT = 40


@pytest.fixture(autouse=True)
def _short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "WINDOW", 16)


def of_sensors() -> tuple[SweepBatch, SweepBatch]:
    """What two sensors see that look at different places: a walker and a box, and a walker the other way."""
    ahead, back = (Motion(velocity=(speed, 0.0)) for speed in (0.6, -0.5))
    scenes = (
        scene_of(make.box(2.0, 1.5, 0.5, 0.5), make.cylinder(-1.0, -1.5, 0.2, motion=ahead)),
        scene_of(make.cylinder(1.0, 2.0, 0.2, motion=back)),
    )
    one, other = (simulated(scene, COUNT, seed) for seed, scene in enumerate(scenes))
    return one, replace(other, stamp_ns=other.stamp_ns + 50_000_000)


def in_turns(one: SweepBatch, other: SweepBatch) -> SweepBatch:
    """Both on one topic, in turns."""
    rows = np.arange(2 * COUNT).reshape(2, COUNT).T.ravel()
    joined = {name: np.concatenate([getattr(one, name), getattr(other, name)])[rows] for name in _BATCH_ROW_FIELDS}
    joined |= {"sweep": np.arange(2 * COUNT), "frame": np.tile(np.array([0, 1], np.int32), COUNT)}
    return replace(one, frame_ids=("front", "rear"), **joined)


def of_frame(tracks: Tracks, frame: int) -> Tracks:
    return Tracks(**{field.name: getattr(tracks, field.name)[tracks.frame == frame] for field in fields(Tracks)})


def test_each_is_followed_as_if_it_were_alone() -> None:
    """Times count from the first sweep of the topic, which changes the last bits."""
    pair = of_sensors()
    both = follow(in_turns(*pair))
    assert both.tracks.track.tolist() == [1, 2, 3]
    for frame, sensor in enumerate(pair):
        alone, mine = follow(sensor), of_frame(both.tracks, frame)
        for name in ("set", "shape", "x", "y", "length", "distance", "speed_mean", "sweeps", "first_stamp_ns"):
            np.testing.assert_allclose(getattr(mine, name), getattr(alone.tracks, name), rtol=1e-6, err_msg=name)
        rows = both.row % 2 == frame
        numbers = np.concatenate([[0], mine.track])
        # Last bits of the times decide which sweeps are keyframes, and these the score.
        for name in sorted({*PER_OBJECT} - {"agent_score"}):
            told = alone.columns[name]
            expected = numbers[told] if name == "track" else told
            np.testing.assert_allclose(both.columns[name][rows], expected, rtol=1e-4, atol=1e-5, err_msg=name)
    assert sorted(both.tracks.frame[both.tracks.moved].tolist()) == [0, 1]


def test_batches_make_no_difference() -> None:
    both = in_turns(*of_sensors())
    assert_same(follow(both), follow(batches(both, 7)))


def test_one_without_poses_is_taken_as_standing_beside_one_with_poses() -> None:
    one, other = of_sensors()
    both = in_turns(one, other)
    rear = both.frame == 1
    x, zero = np.where(rear, np.nan, 3.0), np.zeros(len(both))
    poses = SweepPoses(x, np.where(rear, np.nan, zero), zero, rear & False, absent=rear)
    told = follow(replace(both, poses=poses))
    alone = follow(other).tracks
    np.testing.assert_allclose(of_frame(told.tracks, 1).x, alone.x)
    assert of_frame(told.tracks, 1).moved.tolist() == [True]
    # In the world, the other one is elsewhere.
    assert of_frame(told.tracks, 0).x[0] == pytest.approx(follow(one).tracks.x[0] + 3.0, abs=0.02)


def test_further_frames_count_as_the_last_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "MOST_SENSORS", 2)
    one, other = of_sensors()
    both = in_turns(one, other)
    third = replace(both, frame_ids=("front", "rear", "third"), frame=np.where(both.frame == 1, 2, 0).astype(np.int32))
    told = follow([both[:40], third[40:]])
    assert told.tracks.moved.sum() == 2
    assert told.tracker.frames == ["front", "rear", "third"]
