"""Tracks objects from batch to batch; rows wait until their tracks are settled."""

from __future__ import annotations

import pickle
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.mapping.places import Places
from lidarcli.formalism.matching.catalogue import names_in
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import TrackedBatch
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.newfiles import writing
from lidarcli.pipeline.objects.detection import BatchRows, DetectOptions, Rows
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.sweeps import Int64
from lidarcli.tabular.columns import (
    explained_objects,
    tracked_beams,
    tracked_objects,
    tracked_sweeps,
    tracks_rows,
    trajectories_rows,
)
from lidarcli.tabular.writing import MOST_BYTES

ALONE = 0.1
"""Share of the sweeps without a known place of the sensor from which on there is a note."""


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options of `track` beside those of `detect`."""

    parameters: TrackParameters = field(default_factory=TrackParameters)
    tracks: bool = True
    """True to fill the columns on tracks and write their table; without, memory only decides on objects."""
    trajectories: bool = True
    """True to write the trajectories of the tracks, too."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the tables' metadata."""
        return self.parameters.as_dict()


class LogTracker:
    """Tracks the objects of one log, each topic by itself, in the order of the log, and completes its rows."""

    def __init__(self, log: str, options: DetectOptions, *, waits: bool = False) -> None:
        """With `waits` all rows wait for the end of the log, so that memory decides by all of its sweeps."""
        assert options.tracking is not None
        self._log = log
        self._parameters = options.parameters
        self._options = options.tracking
        self._catalogue = options.catalogue
        self._labels = names_in(options.catalogue)
        self._topics: dict[str, _Topic] = {}
        self._waits = waits
        self._judges = self._options.parameters.memory and self._parameters.profile == "robust"
        self._waiting = _WaitingBatches()
        self.counts = RunSummary(things=0)
        """Counts of the objects and agents in complete rows; in the end also of the tracks."""
        self.notes: list[str] = []
        """Notes, a line each; complete when `flush` has ended."""

    def take(self, batches: Iterable[BatchRows]) -> Iterator[Rows]:
        """Yield the rows that are complete once these batches are known, those of a topic in their order."""
        for batch_rows in batches:
            assert batch_rows.detected is not None
            batch, detection = batch_rows.detected
            if batch.topic not in self._topics:
                self._topics[batch.topic] = _Topic(Tracker(self._options.parameters, self._catalogue))
            topic = self._topics[batch.topic]
            if not self._judges:
                yield from self._track(batch_rows)
                continue
            worlds = topic.places.add(batch, detection)
            topic.sweeps += len(worlds)
            topic.alone += int(np.count_nonzero(worlds < 0))
            if self._waits:
                self._waiting.put(batch_rows, worlds)
            else:
                yield from self._track(self._judged(batch_rows, worlds))

    def flush(self) -> Iterator[Rows]:
        """Yield the rows that are left, and those of the tracks table."""
        for batch_rows, worlds in self._waiting.taken():
            yield from self._track(self._judged(batch_rows, worlds))
        for name in sorted(self._topics):
            topic = self._topics.pop(name)
            if topic.alone > ALONE * topic.sweeps:
                self.notes.append(
                    f"{name}: nothing tells where the sensor is in {topic.alone:,} of {topic.sweeps:,} sweeps: each "
                    "of these decides by itself what is a thing"
                )
            followed, tracks = topic.tracker.finish()
            yield from self._completed(topic, followed)
            assert not topic.waiting, "a tracker answers for every batch"
            if not self._options.tracks:
                continue
            self.counts.add_things(len(tracks), int(np.count_nonzero(tracks.set == AGENT)))
            yield "tracks", name, tracks_rows(self._log, name, tracks, topic.tracker.frames, self._labels)
            yield from self._trajectories(name, topic)
            self.notes += topic.tracker.notes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._waiting.close()

    def _judged(self, batch_rows: BatchRows, worlds: Int64) -> BatchRows:
        """Return a batch whose bodies are things or building by their places."""
        assert batch_rows.detected is not None
        batch, detection = batch_rows.detected
        by_place = self._topics[batch.topic].places.read(batch, detection, worlds)
        rows = [
            (table, topic, explained_objects(each, by_place) if table == "objects" else each)
            for table, topic, each in batch_rows.rows
        ]
        return BatchRows(rows, (batch, by_place.judged(detection, self._parameters.min_thing)))

    def _track(self, batch_rows: BatchRows) -> Iterator[Rows]:
        assert batch_rows.detected is not None
        name = batch_rows.detected[0].topic
        topic = self._topics[name]
        # Only the beams table needs the batch once more.
        needs_batch = any(table == "beams" for table, _, _ in batch_rows.rows)
        topic.waiting.append(batch_rows if needs_batch else BatchRows(batch_rows.rows))
        yield from self._completed(topic, topic.tracker.add(*batch_rows.detected))
        yield from self._trajectories(name, topic)

    def _trajectories(self, name: str, topic: _Topic) -> Iterator[Rows]:
        """Yield the rows of the trajectories of a topic that are settled."""
        for rows in topic.tracker.trajectories():
            if self._options.tracks and self._options.trajectories:
                yield "trajectories", name, trajectories_rows(self._log, name, rows)

    def _completed(self, topic: _Topic, followed: Sequence[TrackedBatch]) -> Iterator[Rows]:
        """Yield the rows of the batches that wait, as far as the tracker has answered for them."""
        tracks = self._options.tracks
        for one in followed:
            batch_rows = topic.waiting.popleft()
            self.counts.add_sets(one)
            for table, name, rows in batch_rows.rows:
                if table == "objects":
                    walls = self._parameters.walls
                    yield table, name, tracked_objects(rows, one, self._labels, walls=walls, tracks=tracks)
                elif table == "sweeps":
                    yield table, name, tracked_sweeps(rows, one, tracks=tracks)
                else:
                    assert batch_rows.detected is not None
                    yield table, name, tracked_beams(rows, *batch_rows.detected, one, tracks=tracks)


@dataclass(slots=True)
class _Topic:
    """Tracker of a topic, its places, and the rows that wait for answers of the tracker."""

    tracker: Tracker
    places: Places = field(default_factory=Places)
    sweeps: int = 0
    alone: int = 0
    """Sweeps of which the place of the sensor is not known."""
    waiting: deque[BatchRows] = field(default_factory=deque)


class _WaitingBatches:
    """Batches that wait for the end of the log; what is more than `MOST_BYTES` waits in a file without a name."""

    def __init__(self) -> None:
        self._batches: deque[tuple[BatchRows, Int64]] = deque()
        self._bytes = 0
        self._file: IO[bytes] | None = None

    def put(self, batch_rows: BatchRows, worlds: Int64) -> None:
        """Take a batch, and the worlds of its sweeps."""
        assert batch_rows.detected is not None
        self._batches.append((batch_rows, worlds))
        self._bytes += sum(rows.nbytes for _, _, rows in batch_rows.rows)
        arrays = (getattr(record, each.name) for record in batch_rows.detected for each in fields(record))
        self._bytes += sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))
        if self._bytes <= MOST_BYTES:
            return
        with writing(f"a temporary file in {tempfile.gettempdir()}"):
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `close`)
            while self._batches:
                pickle.dump(self._batches.popleft(), self._file, pickle.HIGHEST_PROTOCOL)
        self._bytes = 0

    def taken(self) -> Iterator[tuple[BatchRows, Int64]]:
        """Yield all of it, in order."""
        if self._file is not None:
            end = self._file.tell()
            self._file.seek(0)
            while self._file.tell() < end:
                yield pickle.load(self._file)
        while self._batches:
            yield self._batches.popleft()

    def close(self) -> None:
        """Remove the file."""
        if self._file is not None:
            # What is in its buffer is no longer needed, and may not fit on the disk.
            with suppress(OSError):
                self._file.close()
