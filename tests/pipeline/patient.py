"""A stand-in for the tracker: it answers late, and what it answers is known beforehand."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from lidarcli.formalism.detection import AGENT, OBJECT, SETS, SHAPES, Detection
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import ENDS, TrackedBatch, Tracks, Trajectories
from lidarcli.sweeps.types import SweepBatch

PATIENCE = 100
"""Sweeps that are seen before the rows of one are settled."""


class Patient:
    """Every object is the thing of its number; things of even numbers are agents, which run 1 m/s along y."""

    label = -1
    """Entry of the catalogue that agents are."""

    def __init__(self, parameters: TrackParameters, catalogue: Catalogue | None = None, **_: Any) -> None:
        self.parameters = parameters
        self.sensors: list[tuple[str, str]] = []
        self.notes: list[str] = []
        self.most = 0
        """Batches that have waited at the same time."""
        self._things = 0
        self._seen = 0
        self._waiting: deque[tuple[int, SweepBatch, Detection]] = deque()

    def add(self, batch: SweepBatch, detection: Detection) -> list[TrackedBatch]:
        """What lies far enough behind."""
        if not self._seen:
            self.sensors, self._first = [(batch.topic, frame) for frame in batch.frame_ids], batch
        self._seen += len(batch)
        self._waiting.append((self._seen, batch, detection))
        self.most = max(self.most, len(self._waiting))
        done = []
        while self._waiting and self._waiting[0][0] <= self._seen - PATIENCE:
            done.append(self._settled(*self._waiting.popleft()[1:]))
        return done

    def finish(self) -> tuple[list[TrackedBatch], Tracks]:
        """The rest, and a thing for every number."""
        rest = [self._settled(batch, detection) for _, batch, detection in self._waiting]
        self._waiting.clear()
        self.notes.append(f"{self._things} things in {self._seen} sweeps of {self._first.topic}")
        return rest, things(self._things, int(self._first.stamp_ns[0]), self.label)

    def trajectories(self) -> Iterator[Trajectories]:
        """None: it does not know where things are."""
        return iter(())

    def _settled(self, batch: SweepBatch, detection: Detection) -> TrackedBatch:
        thing = detection.set == OBJECT
        agent = thing & (detection.object % 2 == 0)
        self._things = max(self._things, int(detection.object[thing].max(initial=0)))

        def per_sweep(weights: Any) -> Any:
            return np.bincount(detection.row[agent], weights, len(batch)).astype(np.int32)

        agents, beams = per_sweep(None), per_sweep(detection.beams[agent])
        return TrackedBatch(
            batch=batch,
            detection=detection,
            track=np.where(thing, detection.object, 0).astype(np.int64),
            vx=np.where(thing, 0.0, np.nan),
            vy=np.where(thing, agent * 1.0, np.nan),
            moving=np.where(thing, agent, -1).astype(np.int8),
            agent_score=np.where(thing, agent * 1.0, np.nan),
            set=np.where(agent, AGENT, detection.set).astype(np.uint8),
            shape=detection.shape,
            order=np.arange(len(detection)),
            object=detection.object,
            label=np.where(agent, self.label, -1).astype(np.int32),
            label_score=np.where(agent & (self.label >= 0), 0.75, np.nan),
            objects=detection.objects - agents,
            agents=agents,
            object_beams=detection.object_beams - beams,
            agent_beams=beams,
            noise_beams=detection.noise_beams,
        )


def things(count: int, stamp_ns: int, label: int) -> Tracks:
    """Things 1, 2, ...; those of even numbers moved from the first stamp on."""
    number = np.arange(1, count + 1)
    even = number % 2 == 0
    kinds: dict[str, Any] = {
        "sensor": 0,
        "track": number,
        "set": np.where(even, SETS.index("A"), SETS.index("O")),
        "shape": SHAPES.index("round"),
        "label": np.where(even, label, -1),
        "label_score": np.where(even & (label >= 0), 0.75, np.nan),
        "first_stamp_ns": stamp_ns,
        "last_stamp_ns": stamp_ns + 10**9,
        "moved": even,
        "moved_at_ns": stamp_ns,
        "length": np.nan,
        "end": ENDS.index("lost"),
    }
    return Tracks(
        **{
            field.name: np.broadcast_to(kinds.get(field.name, 0), count).astype(_KINDS[str(field.type)])
            for field in fields(Tracks)
        }
    )


_KINDS: dict[str, Any] = {"Int32": np.int32, "Int64": np.int64, "UInt8": np.uint8, "Float64": np.float64, "Bool": np.bool_}
