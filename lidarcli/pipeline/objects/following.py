"""Follows objects from batch to batch; rows wait until their tracks are settled."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.formalism import Parameters
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.matching.catalogue import Catalogue, names_in
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import Followed, Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.pipeline.objects.making import Made, Rows
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.tabular.tracked import tracked_beams, tracked_objects, tracked_sweeps, tracks_rows


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options of `track` beside those of `detect`."""

    parameters: TrackParameters = field(default_factory=TrackParameters)
    tracks: bool = True
    """True to fill the columns on tracks and write their table; without, memory only decides on objects."""

    def tracker(self, catalogue: Catalogue | None, found: Parameters) -> Tracker:
        """Make a tracker for one topic, which names things by a catalogue."""
        return Tracker(self.parameters, catalogue, found.min_thing)

    def found_with(self, parameters: Parameters) -> Parameters:
        """Return the parameters of the detection: memory decides on every body, whatever one sweep says of it."""
        if not self.parameters.memory:
            return parameters
        return replace(parameters, min_thing=0.0)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the tables' metadata."""
        return self.parameters.as_dict()


class Following:
    """Follows the objects of one log, each topic by itself, in the order of the log, and completes its rows."""

    def __init__(
        self, log: str, options: TrackOptions, parameters: Parameters, catalogue: Catalogue | None = None
    ) -> None:
        """`parameters`: those of the objects that the user asked for."""
        self._log = log
        self._parameters = parameters
        self._options = options
        self._catalogue = catalogue
        self._labels = names_in(catalogue)
        self._topics: dict[str, _Topic] = {}
        self.summary = RunSummary(things=0)
        """Counts of the objects and agents in complete rows; in the end also of the tracks."""
        self.notes: list[str] = []
        """Notes, a line each; complete when `finish` has ended."""

    def take(self, batches: Iterable[Made]) -> Iterator[Rows]:
        """Yield the rows that are complete once these batches have been seen, those of a topic in their order."""
        for made in batches:
            assert made.seen is not None
            batch, detection = made.seen
            topic = self._topics.get(batch.topic)
            if topic is None:
                topic = self._topics[batch.topic] = _Topic(
                    self._options.tracker(self._catalogue, self._parameters)
                )
            topic.waiting.append(_waiting(made))
            yield from self._complete(topic, topic.tracker.add(batch, detection))

    def finish(self) -> Iterator[Rows]:
        """Yield the rows that are left, and those of the tracks table."""
        for name in sorted(self._topics):
            topic = self._topics.pop(name)
            followed, tracks = topic.tracker.finish()
            yield from self._complete(topic, followed)
            assert not topic.waiting, "a tracker answers for every batch"
            if not self._options.tracks:
                continue
            self._count(tracks)
            yield "tracks", name, tracks_rows(self._log, name, tracks, topic.tracker.frames, self._labels)
            self.notes += topic.tracker.notes

    def _complete(self, topic: _Topic, followed: Sequence[Followed]) -> Iterator[Rows]:
        for one in followed:
            made = topic.waiting.popleft()
            self.summary.add_sets(one)
            for table, name, rows in made.rows:
                yield table, name, self._completed(table, rows, made, one)

    def _completed(self, table: str, rows: pa.RecordBatch, made: Made, one: Followed) -> pa.RecordBatch:
        """Return the rows of one table, completed by the tracking."""
        tracks = self._options.tracks
        if table == "objects":
            return tracked_objects(rows, one, self._labels, walls=self._parameters.walls, tracks=tracks)
        if table == "sweeps":
            return tracked_sweeps(rows, one, tracks=tracks)
        assert made.seen is not None
        return tracked_beams(rows, *made.seen, one, tracks=tracks)

    def _count(self, tracks: Tracks) -> None:
        self.summary.add_things(len(tracks), int(np.count_nonzero(tracks.set == AGENT)))


@dataclass(slots=True)
class _Topic:
    """Tracker of a topic, and the rows that wait for its answers."""

    tracker: Tracker
    waiting: deque[Made] = field(default_factory=deque)


def _waiting(made: Made) -> Made:
    """Return the part of a batch that waits: its rows, and for the beams table also the batch and its detection."""
    return made if any(table == "beams" for table, _, _ in made.rows) else Made(made.rows)
