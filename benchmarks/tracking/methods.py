"""What is compared: each method turns the same detections into tracks."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from itertools import pairwise

import numpy as np

from benchmarks.tracking.more_rules import LegTracker, Sort
from benchmarks.tracking.recordings import Detected, Recording
from benchmarks.tracking.rules import Datmo, DynamicObstacleDetector, ObstacleDetector, Rules, Seen
from lidarcli.formalism.detection import AGENT, Detection
from lidarcli.formalism.parameters import Parameters
from lidarcli.formalism.tracking.results import Tracks, Trajectories
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.sweeps.types import Bool, Float64, Int64, SweepBatch, record

PARAMETERS = Parameters()
"""Of the detection, the same for all."""
AGENT_SPEED = 0.35
"""[m/s] From this speed on the published trackers take a thing for moving, row by row."""


@record
class Result:
    """What a method says of each of the K objects."""

    track: Int64
    """(K,) from 1, 0 for none."""
    velocity: Float64
    """(K, 2) over ground [m/s], NaN where unknown."""
    agent: Bool
    """(K,) whether it is an agent (set A)."""
    seconds: float
    """Time that it took."""
    tracks: Tracks | None = None
    trajectories: Trajectories | None = None


Method = Callable[[Detected], Result]


def lidarcli(found: Detected) -> Result:
    """The tracker of this project."""
    begin = time.process_time()
    tracker, followed = Tracker(), []
    paths: list[Trajectories] = []
    for batch, detection in zip(found.batches, found.detections, strict=True):
        followed += tracker.add(batch, detection)
        paths += tracker.trajectories()
    rest, tracks = tracker.finish()
    paths += tracker.trajectories()
    seconds = time.process_time() - begin
    followed += rest
    return Result(
        track=np.concatenate([one.track for one in followed]),
        velocity=np.column_stack(
            [np.concatenate([one.vx for one in followed]), np.concatenate([one.vy for one in followed])]
        ),
        agent=np.concatenate([one.set for one in followed]) == AGENT,
        seconds=seconds,
        tracks=tracks,
        trajectories=Trajectories(
            *(np.concatenate([getattr(one, each.name) for one in paths]) for each in fields(Trajectories))
        )
        if paths
        else None,
    )


def oracle(recording: Recording, found: Detected) -> Result:
    """The truth about each object: what no tracker can surpass with these detections."""
    sweep, entity = found.row, found.entity
    thing = (entity >= 0) & ~recording.wall[entity]
    return Result(
        track=np.where(thing, entity + 1, 0),
        velocity=np.where(thing[:, None], recording.velocity[sweep, entity], np.nan),
        agent=thing & recording.begun[sweep, entity],
        seconds=0.0,
    )


def following(make: Callable[[], Rules]) -> Method:
    """A method from the rules of a published tracker."""

    def method(found: Detected) -> Result:
        begin = time.process_time()
        rules, tracks, velocities = make(), [], []
        for batch, detection in zip(found.batches, found.detections, strict=True):
            for seen in sightings(batch, detection):
                track, velocity = rules.step(seen)
                tracks.append(track)
                velocities.append(velocity)
        seconds = time.process_time() - begin
        track, velocity = np.concatenate(tracks), np.concatenate(velocities)
        track[np.bincount(track)[track] < rules.SIGHTINGS] = 0
        return Result(track, velocity, np.hypot(*velocity.T) > AGENT_SPEED, seconds)

    return method


def sightings(batch: SweepBatch, detection: Detection) -> Iterator[Seen]:
    """What is seen in each sweep, in the world where there are poses, else in the frame of the sensor."""
    row, poses = detection.row, batch.poses
    x, y = detection.x, detection.y
    box_x, box_y, yaw = detection.box_x, detection.box_y, detection.box_yaw
    own = np.zeros((len(batch), 2))
    if poses is not None:
        x, y, _ = poses.to_world(row, x, y, yaw)
        box_x, box_y, yaw = poses.to_world(row, box_x, box_y, yaw)
        own = np.column_stack([poses.x, poses.y])
    corners = _corners(box_x, box_y, yaw, detection.box_length, detection.box_width)
    nearest = np.hypot(*(corners - own[row, None]).transpose(2, 0, 1)).argmin(axis=1)
    corners = np.take_along_axis(corners, ((nearest[:, None] + np.arange(4)) % 4)[:, :, None], axis=1)
    seconds = np.diff(batch.stamp_ns, prepend=batch.stamp_ns[:1]) / 1e9
    usual = float(np.median(seconds[1:])) if len(seconds) > 1 else 0.1
    place = np.column_stack([x, y])
    starts = np.searchsorted(row, np.arange(len(batch) + 1))
    for sweep, (start, end) in enumerate(pairwise(starts.tolist())):
        passed = float(seconds[sweep]) or usual
        yield Seen(passed, place[start:end], detection.width[start:end], corners[start:end])


def _corners(x: Float64, y: Float64, yaw: Float64, length: Float64, width: Float64) -> Float64:
    """(K, 4, 2) of oriented boxes, counter-clockwise."""
    along = np.array([1.0, -1.0, -1.0, 1.0]) * length[:, None] / 2
    across = np.array([1.0, 1.0, -1.0, -1.0]) * width[:, None] / 2
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    return np.stack([x[:, None] + cos * along - sin * across, y[:, None] + sin * along + cos * across], -1)


OURS, ORACLE = "lidarcli", "oracle"
METHODS: dict[str, Method] = {
    OURS: lidarcli,
    "leg_tracker": following(LegTracker),
    "obstacle_detector": following(ObstacleDetector),
    "dynamic_obstacle_detector": following(DynamicObstacleDetector),
    "datmo": following(Datmo),
    "SORT": following(Sort),
}
NAMES = (OURS, ORACLE, *(name for name in METHODS if name != OURS))


def follow(name: str, recording: Recording, found: Detected) -> Result:
    """What one of `NAMES` says of a simulated log."""
    return oracle(recording, found) if name == ORACLE else METHODS[name](found)
