"""What is compared: each method turns the same detections into tracks."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.tracking.recordings import Detected, Recording
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.parameters import Parameters
from lidarcli.formalism.tracking.tracked import Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

PARAMETERS = Parameters()
"""Of the detection, the same for all."""


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


Method = Callable[[Recording, Detected], Result]


def lidarcli(recording: Recording, found: Detected) -> Result:
    """The tracker of this project."""
    begin = time.process_time()
    tracker, followed = Tracker(), []
    for batch, detection in zip(found.batches, found.detections, strict=True):
        followed += tracker.add(batch, detection)
    rest, tracks = tracker.finish()
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


OURS, ORACLE = "lidarcli", "oracle"
METHODS: dict[str, Method] = {OURS: lidarcli, ORACLE: oracle}
