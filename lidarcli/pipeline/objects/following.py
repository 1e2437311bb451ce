"""Follows objects from batch to batch; rows wait until their tracks are settled."""

from __future__ import annotations

import pickle
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
import pyarrow as pa

from lidarcli.formalism import Detection, Parameters
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.mapping.places import Places
from lidarcli.formalism.matching.catalogue import Catalogue, names_in
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.newfiles import writing
from lidarcli.pipeline.objects.making import Made, Rows
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.sweeps import Int64, SweepBatch
from lidarcli.tabular.tracked import (
    explained_objects,
    tracked_beams,
    tracked_objects,
    tracked_sweeps,
    tracks_rows,
    trajectories_rows,
)
from lidarcli.tabular.writing import MOST_BYTES


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options of `track` beside those of `detect`."""

    parameters: TrackParameters = field(default_factory=TrackParameters)
    tracks: bool = True
    """True to fill the columns on tracks and write their table; without, memory only decides on objects."""
    trajectories: bool = True
    """True to write the trajectories of the tracks, too."""

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
        self,
        log: str,
        options: TrackOptions,
        parameters: Parameters,
        catalogue: Catalogue | None = None,
        *,
        waits: bool = False,
    ) -> None:
        """
        Parameters
        ----------
        parameters : those of the objects that the user asked for
        waits : all rows wait for the end of the log, so that memory decides by all of its sweeps; otherwise by those so far
        """
        self._log = log
        self._parameters = parameters
        self._options = options
        self._catalogue = catalogue
        self._labels = names_in(catalogue)
        self._topics: dict[str, _Topic] = {}
        self._waits = waits
        self._judges = options.parameters.memory and parameters.profile == "robust"
        self._waiting = _Waiting()
        self.summary = RunSummary(things=0)
        """Counts of the objects and agents in complete rows; in the end also of the tracks."""
        self.notes: list[str] = []
        """Notes, a line each; complete when `finish` has ended."""

    def take(self, batches: Iterable[Made]) -> Iterator[Rows]:
        """Yield the rows that are complete once these batches have been seen, those of a topic in their order."""
        for made in batches:
            assert made.seen is not None
            name = made.seen[0].topic
            if name not in self._topics:
                self._topics[name] = _Topic(Tracker(self._options.parameters, self._catalogue))
            if not self._judges:
                yield from self._follow(made)
                continue
            worlds = self._topics[name].places.add(*made.seen)
            if self._waits:
                self._waiting.put(made, worlds)
            else:
                yield from self._follow(self._judged(made, worlds))

    def finish(self) -> Iterator[Rows]:
        """Yield the rows that are left, and those of the tracks table."""
        for topic in self._topics.values():
            topic.places.settle()
        for made, worlds in self._waiting.taken():
            yield from self._follow(self._judged(made, worlds))
        for name in sorted(self._topics):
            topic = self._topics.pop(name)
            followed, tracks = topic.tracker.finish()
            yield from self._complete(topic, followed)
            assert not topic.waiting, "a tracker answers for every batch"
            if not self._options.tracks:
                continue
            self._count(tracks)
            yield "tracks", name, tracks_rows(self._log, name, tracks, topic.tracker.frames, self._labels)
            yield from self._told(name, topic)
            self.notes += topic.tracker.notes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._waiting.close()

    def _judged(self, made: Made, worlds: Int64) -> Made:
        """Return a batch whose bodies are things or building by their places."""
        assert made.seen is not None
        batch, detection = made.seen
        told = self._topics[batch.topic].places.read(batch, detection, worlds)
        rows = [
            (table, topic, explained_objects(each, told) if table == "objects" else each)
            for table, topic, each in made.rows
        ]
        return Made(rows, (batch, told.judged(detection, self._parameters.min_thing)))

    def _follow(self, made: Made) -> Iterator[Rows]:
        assert made.seen is not None
        name = made.seen[0].topic
        topic = self._topics[name]
        topic.waiting.append(_waiting(made))
        yield from self._complete(topic, topic.tracker.add(*made.seen))
        yield from self._told(name, topic)

    def _told(self, name: str, topic: _Topic) -> Iterator[Rows]:
        """Yield the rows of the trajectories of a topic that are settled."""
        for rows in topic.tracker.trajectories():
            if self._options.tracks and self._options.trajectories:
                yield "trajectories", name, trajectories_rows(self._log, name, rows)

    def _complete(self, topic: _Topic, followed: Sequence[TrackedBatch]) -> Iterator[Rows]:
        for one in followed:
            made = topic.waiting.popleft()
            self.summary.add_sets(one)
            for table, name, rows in made.rows:
                yield table, name, self._completed(table, rows, made, one)

    def _completed(self, table: str, rows: pa.RecordBatch, made: Made, one: TrackedBatch) -> pa.RecordBatch:
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
    """Tracker of a topic, its places, and the rows that wait for answers of the tracker."""

    tracker: Tracker
    places: Places = field(default_factory=Places)
    waiting: deque[Made] = field(default_factory=deque)


class _Waiting:
    """Batches that wait for the end of the log; what is more than `MOST_BYTES` waits in a file without a name."""

    def __init__(self) -> None:
        self._line: deque[tuple[Made, Int64]] = deque()
        self._bytes = 0
        self._file: IO[bytes] | None = None

    def put(self, made: Made, worlds: Int64) -> None:
        """Take a batch, and the worlds of its sweeps."""
        assert made.seen is not None
        self._line.append((made, worlds))
        self._bytes += sum(rows.nbytes for _, _, rows in made.rows) + sum(_bytes(each) for each in made.seen)
        if self._bytes <= MOST_BYTES:
            return
        with writing(f"a temporary file in {tempfile.gettempdir()}"):
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `close`)
            while self._line:
                pickle.dump(self._line.popleft(), self._file, pickle.HIGHEST_PROTOCOL)
        self._bytes = 0

    def taken(self) -> Iterator[tuple[Made, Int64]]:
        """Yield all of it, in order."""
        if self._file is not None:
            end = self._file.tell()
            self._file.seek(0)
            while self._file.tell() < end:
                yield pickle.load(self._file)
        while self._line:
            yield self._line.popleft()

    def close(self) -> None:
        """Remove the file."""
        if self._file is not None:
            # What is in its buffer is no longer needed, and may not fit on the disk.
            with suppress(OSError):
                self._file.close()


def _bytes(record: SweepBatch | Detection) -> int:
    """Return the size of the arrays of a record."""
    values = (getattr(record, each.name) for each in fields(record))
    return sum(each.nbytes for each in values if isinstance(each, np.ndarray))


def _waiting(made: Made) -> Made:
    """Return the part of a batch that waits: its rows, and for the beams table also the batch and its detection."""
    return made if any(table == "beams" for table, _, _ in made.rows) else Made(made.rows)
