"""Follows things from sweep to sweep: a fold over the batches of one topic (§3, matching and tracking)."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import NOISE, REMOVED, Detection
from lidarcli.formalism.tracking.parameters import TrackParameters
from lidarcli.formalism.tracking.tracked import Followed, Tracks
from lidarcli.sweeps import SweepBatch

WINDOW = 256
"""Sweeps of a window: the rows of one are settled when the next one has been seen."""


class Tracker:
    """Follows the things of one topic. Memory is bounded; the result does not depend on how sweeps are cut into batches."""

    def __init__(self, parameters: TrackParameters | None = None) -> None:
        self.parameters = parameters or TrackParameters()
        self.frames: list[str] = []
        """Names of sensor frames, which `Tracks.frame` points into."""
        self.notes: list[str] = []
        """What a user should know, a line each; whole after `finish`."""
        self._waiting: deque[tuple[SweepBatch, Detection]] = deque()

    def add(self, batch: SweepBatch, detection: Detection) -> list[Followed]:
        """Take the next sweeps of the topic; returns what is settled by now, for earlier batches, in their order.

        Parameters
        ----------
        batch, detection : the sweeps of one topic in the order of the log, and what `detect` has found in them
        """
        self._waiting.append((batch, detection))
        return [self._settle(*self._waiting.popleft())] if len(self._waiting) > 1 else []

    def finish(self) -> tuple[list[Followed], Tracks]:
        """The rest, and all things."""
        rest = [self._settle(*one) for one in self._waiting]
        self._waiting.clear()
        empty: dict[str, NDArray[Any]] = {name: np.empty(0, kind) for name, kind in _TRACKS.items()}
        return rest, Tracks(**empty)

    def _settle(self, batch: SweepBatch, detection: Detection) -> Followed:
        count = len(detection)
        # PLACEHOLDER: every object of a sweep is the track of its own number.
        followed = (detection.set != NOISE) & (
            np.ones(count, bool) if detection.change is None else detection.change != REMOVED
        )
        return Followed(
            track=np.where(followed, detection.object, 0).astype(np.int64),
            vx=np.where(followed, 0.0, np.nan),
            vy=np.where(followed, 0.0, np.nan),
            moving=np.where(followed, 0, -1).astype(np.int8),
            set=detection.set.copy(),
            label=np.full(count, -1, np.int32),
            label_score=np.full(count, np.nan),
            objects=detection.objects,
            agents=detection.agents,
            object_beams=detection.object_beams,
            agent_beams=detection.agent_beams,
        )


_TRACKS = {
    "frame": np.int32,
    "track": np.int64,
    "set": np.uint8,
    "shape": np.uint8,
    "label": np.int32,
    "label_score": np.float64,
    "first_sweep": np.int64,
    "last_sweep": np.int64,
    "first_stamp_ns": np.int64,
    "last_stamp_ns": np.int64,
    "duration": np.float64,
    "sweeps": np.int64,
    "hidden": np.float64,
    "x": np.float64,
    "y": np.float64,
    "yaw": np.float64,
    "length": np.float64,
    "width": np.float64,
    "length_sd": np.float64,
    "width_sd": np.float64,
    "distance": np.float64,
    "speed_mean": np.float64,
    "speed_max": np.float64,
    "moved": np.bool_,
    "moved_at_ns": np.int64,
    "end": np.uint8,
}
