"""Two sensors: each is followed as if it were alone, or both together in one world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest

from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.tracking import tracker as tracking
from lidarcli.formalism.tracking.results import Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import SceneMotion, SceneMount
from lidarcli.sweeps.types import _BATCH_ROW_FIELDS, SweepBatch, SweepPoses
from tests.formalism.tracking.following import PER_OBJECT, assert_same, batches, follow, scene_of, simulated

COUNT = 40


@pytest.fixture(autouse=True)
def _short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "WINDOW", 16)


def of_sensors() -> tuple[SweepBatch, SweepBatch]:
    """What two sensors see that look at different places: a walker and a box, and a walker the other way."""
    ahead, back = (SceneMotion(velocity=(speed, 0.0)) for speed in (0.6, -0.5))
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
    return Tracks(**{field.name: getattr(tracks, field.name)[tracks.sensor == frame] for field in fields(Tracks)})


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
    assert sorted(both.tracks.sensor[both.tracks.moved].tolist()) == [0, 1]


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
    monkeypatch.setattr(tracking, "MAX_SENSORS", 2)
    one, other = of_sensors()
    both = in_turns(one, other)
    third = replace(both, frame_ids=("front", "rear", "third"), frame=np.where(both.frame == 1, 2, 0).astype(np.int32))
    told = follow([both[:40], third[40:]])
    assert told.tracks.moved.sum() == 2
    assert [frame for _, frame in told.tracker.sensors] == ["front", "rear", "third"]


# --- together -------------------------------------------------------------------------------------------------


def beside() -> tuple[SweepBatch, SweepBatch]:
    """What two sensors see that stand back to back, half a second of the way of a walker behind each other."""
    way = SceneMotion(velocity=(0.9, 0.0))
    scene = scene_of(make.box(2.0, 1.5, 0.5, 0.5), make.cylinder(-3.5, -1.5, 0.2, motion=way))
    half = replace(scene.sensor, beams=361, angle_min=-np.pi / 2, angle_increment=np.pi / 360)
    found = []
    for number, yaw in enumerate((0.0, np.pi)):
        seen = replace(scene, sensor=half, mount=SceneMount((0.0, 0.0, yaw)))
        batch = simulated(seen, 2 * COUNT, number)
        nowhere = np.zeros(len(batch))
        poses = SweepPoses(nowhere, nowhere, nowhere + yaw, np.zeros(len(batch), np.bool_))
        topic = "/front" if number == 0 else "/rear"
        found.append(replace(batch, topic=topic, poses=poses, still=np.ones(len(batch), np.bool_)))
    return found[0], replace(found[1], stamp_ns=found[1].stamp_ns + 50_000_000)


def follow_together(*sensors: Sequence[SweepBatch]) -> tuple[dict[str, np.ndarray], Tracks, Tracker]:
    """The tracks of each topic's objects, and all tracks, of sensors that are followed together."""
    tracker = Tracker(together=[(one[0].topic, one[0].frame_ids[0]) for one in sensors])
    waiting, found = {one[0].topic: [*one] for one in sensors}, []
    while (topic := tracker.lacks) is not None:
        batch = waiting[topic].pop(0) if waiting[topic] else None
        found += tracker.end(topic) if batch is None else tracker.add(batch, detect(batch, Parameters()))
    rest, tracks = tracker.finish()
    numbers: dict[str, list[np.ndarray]] = {}
    for one in [*found, *rest]:
        numbers.setdefault(one.batch.topic, []).append(one.track)
    return {topic: np.concatenate(parts) for topic, parts in numbers.items()}, tracks, tracker


def test_a_thing_that_goes_from_one_view_into_the_other_is_one() -> None:
    front, rear = beside()
    numbers, tracks, tracker = follow_together([front], [rear])
    assert tracks.moved.sum() == 1
    walker = int(tracks.track[tracks.moved][0])
    assert min(np.count_nonzero(numbers[topic] == walker) for topic in ("/front", "/rear")) > 15
    assert tracks.sensor[tracks.moved].tolist() == [-1]
    # The box ahead was seen by one of them.
    box = tracks.sensor[np.hypot(tracks.x - 2.0, tracks.y - 1.5) < 0.3]
    assert box.tolist() == [0]
    # Nobody hides: what one sensor cannot see the other one does.
    assert tracks.hidden[tracks.moved][0] < 1.0
    paths = [*tracker.trajectories()]
    sensors = np.concatenate([one.sensor[one.track == walker] for one in paths])
    assert set(sensors.tolist()) == {0, 1}
    apart = [follow(one).tracks for one in (front, rear)]
    assert sum(int(one.moved.sum()) for one in apart) == 2


def test_batches_and_the_order_of_topics_make_no_difference() -> None:
    front, rear = beside()
    whole, tracks, _ = follow_together([front], [rear])
    pieces, same, _ = follow_together(batches(front, 7), batches(rear, 13))
    for topic, numbers in whole.items():
        np.testing.assert_array_equal(numbers, pieces[topic])
    for field in fields(Tracks):
        np.testing.assert_array_equal(getattr(tracks, field.name), getattr(same, field.name), err_msg=field.name)
    other, _, _ = follow_together([rear], [front])
    for topic, numbers in whole.items():
        np.testing.assert_array_equal(numbers, other[topic])


def test_what_only_one_sensor_can_see_stays() -> None:
    """The other one, mounted higher, looks over the box in the same directions."""
    low = simulated(scene_of(make.box(2.0, 1.5, 0.5, 0.5)), COUNT)
    high = simulated(scene_of(), COUNT, 1)
    poses = SweepPoses(*np.zeros((3, COUNT)), np.zeros(COUNT, np.bool_))
    low, high = (replace(one, topic=f"/{name}", poses=poses) for name, one in (("low", low), ("high", high)))
    high = replace(high, stamp_ns=high.stamp_ns + 50_000_000)
    _, tracks, _ = follow_together([low], [high])
    assert len(tracks) == 1
    assert tracks.sweeps.tolist() == [COUNT]
    assert tracks.moved.tolist() == [False]
