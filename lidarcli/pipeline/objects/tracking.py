"""Tracks objects from batch to batch; rows are made once their tracks are final."""

from __future__ import annotations

import pickle
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from types import TracebackType
from typing import IO, Self

import numpy as np

from lidarcli.display.texts import Routine
from lidarcli.files.newfiles import writing
from lidarcli.formalism.counting import PersonFinder
from lidarcli.formalism.detection import AGENT, Detection
from lidarcli.formalism.mapping.places import Places
from lidarcli.formalism.tracking.results import TrackedBatch
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.pipeline.objects.detection import DetectOptions, Rows
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.sweeps.types import Int64, SweepBatch
from lidarcli.tabular.columns import tracked_rows, tracks_rows, trajectories_rows
from lidarcli.tabular.writing import MAX_BYTES

OF_AGENTS = ("track", "first_stamp_ns", "last_stamp_ns", "distance", "speed_mean", "speed_max", "agent_score")
"""Columns of the tracks table that a summary has of each agent."""
ALONE = 0.1
"""Share of the sweeps without a known place of the sensor from which on there is a note."""


class LogTracker:
    """Tracks the objects of one log and makes its rows: each topic by itself, and those of a robot together."""

    def __init__(self, log: str, tables: Sequence[str], options: DetectOptions, *, waits: bool = False) -> None:
        """`tables`: those whose rows each batch has. With `waits` all batches wait for the end of the log, so that memory
        decides by all of its sweeps.
        """
        assert options.tracking is not None
        self._log, self._tables = log, tables
        self._parameters = options.parameters
        self._options = options.tracking
        self._catalogue = options.catalogue
        self._labels = () if options.catalogue is None else options.catalogue.names
        self._topics: dict[str, _TrackedTopic] = {}
        self._places: dict[object, Places] = {}
        """By topic, and for the sensors of a robot by these."""
        self._waits = waits
        self._judges = self._options.parameters.memory and self._parameters.profile == "robust"
        self._waiting = _WaitingBatches()
        self._shared = 0
        """Number of tracks of robots so far: no two of them have one number."""
        self.counts = RunSummary(things=0)
        """Counts of the objects and agents in the rows; in the end also of the tracks."""
        self.notes: list[str] = []
        """Notes, a line each; complete when `flush` has ended."""

    def take(self, detected: Iterable[tuple[SweepBatch, Detection]]) -> Iterator[Rows]:
        """Yield the rows that are known once these batches are, those of a topic in their order."""
        for batch, detection in detected:
            topic = self._topics.setdefault(batch.topic, _TrackedTopic())
            topic.robot = topic.robot or batch.robot
            worlds = None
            if self._judges:
                worlds = self._places_of(batch).add(batch, detection)
                topic.sweeps += len(worlds)
                topic.alone += int(np.count_nonzero(worlds < 0))
            if (self._waits and self._judges) or topic.robot:
                self._waiting.put(batch, detection, worlds)
                continue
            topic.tracker = topic.tracker or Tracker(self._options.parameters, self._catalogue)
            yield from self._rows(topic.tracker.add(batch, self._judged(batch, detection, worlds)))
            yield from self._trajectories(batch.topic, topic.tracker)

    def flush(self) -> Iterator[Rows]:
        """Yield the rows that are left, and those of the tracks table."""
        for name in sorted(self._topics):
            topic = self._topics[name]
            if topic.alone > ALONE * topic.sweeps:
                alone = f"{name}: {topic.alone:,} of {topic.sweeps:,} sweeps decide alone what is a thing"
                self.notes.append(Routine(f"{alone}: no path tells where the sensor is"))
            joint = [other for other in sorted(self._topics) if topic.robot and self._topics[other].robot == topic.robot]
            if joint and joint[0] != name:
                continue
            joint = joint or [name]
            if topic.tracker is None:
                sensors = [sensor for sensor in topic.robot if sensor[0] in joint]
                topic.tracker = Tracker(
                    self._options.parameters, self._catalogue, together=sensors, before=self._shared if sensors else 0
                )
            tracker = topic.tracker
            waited = {each: self._waited(each) for each in joint}
            while (wanted := tracker.lacks if topic.robot else name) is not None:
                following = next(waited[wanted], None)
                if following is None and not topic.robot:
                    break
                yield from self._rows(tracker.end(wanted) if following is None else tracker.add(*following))
                yield from self._trajectories(name, tracker)
            followed, tracks = tracker.finish()
            yield from self._rows(followed)
            yield from self._trajectories(name, tracker)
            tracks = topic.people.find(tracks)
            self._shared += len(tracks) if topic.robot else 0
            if self._options.tracks:
                agents = np.flatnonzero(tracks.set == AGENT)
                self.counts.add_things(len(tracks), len(agents), len({*tracks.person.tolist()} - {0}))
                columns = [getattr(tracks, column)[agents].tolist() for column in OF_AGENTS]
                self.counts.followed += [(name, *row) for row in zip(*columns, strict=True)]
                yield "tracks", name, tracks_rows(self._log, tracks, tracker.sensors, self._labels)
                self.notes += tracker.notes
            topic.tracker = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._waiting.close()

    def _places_of(self, batch: SweepBatch) -> Places:
        """Return the places by which the bodies of a batch are evaluated."""
        return self._places.setdefault(batch.robot or batch.topic, Places())

    def _waited(self, topic: str) -> Iterator[tuple[SweepBatch, Detection]]:
        """Yield the batches of a topic that have waited, as they are followed."""
        for batch, detection, worlds in self._waiting.taken(topic):
            yield batch, self._judged(batch, detection, worlds)

    def _judged(self, batch: SweepBatch, detection: Detection, worlds: Int64 | None) -> Detection:
        """Return the detection of a batch whose bodies are things or building by their places."""
        if worlds is None:
            return detection
        return self._places_of(batch).judged(batch, detection, worlds, self._parameters.min_thing)

    def _trajectories(self, name: str, tracker: Tracker) -> Iterator[Rows]:
        """Yield the rows of the trajectories of a tracker that are final."""
        for rows in tracker.trajectories():
            self._topics[name].people.add(rows)
            if self._options.tracks and self._options.trajectories:
                yield "trajectories", name, trajectories_rows(self._log, tracker.sensors, rows)

    def _rows(self, followed: Iterable[TrackedBatch]) -> Iterator[Rows]:
        """Yield the rows of the batches that the tracker has answered for."""
        walls, tracks = self._parameters.walls, self._options.tracks
        for one in followed:
            self.counts.add_sets(one)
            for table in self._tables:
                rows = tracked_rows(table, self._log, one, self._labels, walls=walls, tracks=tracks)
                yield table, one.batch.topic, rows


@dataclass(slots=True)
class _TrackedTopic:
    """Tracker of a topic, and its sweeps so far."""

    sweeps: int = 0
    alone: int = 0
    """Sweeps of which the place of the sensor is not known."""
    tracker: Tracker | None = None
    robot: tuple[tuple[str, str], ...] = ()
    """Sensors that are followed together, as of `SweepBatch.robot`."""
    people: PersonFinder = field(default_factory=PersonFinder)


_Waiting = tuple[SweepBatch, Detection, Int64 | None]
"""A batch, its detection, and the worlds of its sweeps, as of `Places.add`."""


class _WaitingBatches:
    """Batches that wait for the end of the log; what is more than `MAX_BYTES` waits in a file without a name."""

    def __init__(self) -> None:
        self._batches: dict[str, deque[_Waiting]] = {}
        """By topic."""
        self._places: dict[str, list[int]] = {}
        """Topic → places of its batches in the file."""
        self._bytes = 0
        self._file: IO[bytes] | None = None

    def put(self, batch: SweepBatch, detection: Detection, worlds: Int64 | None) -> None:
        """Take a batch, its detection, and the worlds of its sweeps."""
        self._batches.setdefault(batch.topic, deque()).append((batch, detection, worlds))
        arrays = (getattr(record, each.name) for record in (batch, detection) for each in fields(record))
        self._bytes += sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))
        if self._bytes <= MAX_BYTES:
            return
        with writing(f"a temporary file in {tempfile.gettempdir()}"):
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `close`)
            for topic, batches in self._batches.items():
                while batches:
                    self._places.setdefault(topic, []).append(self._file.tell())
                    pickle.dump(batches.popleft(), self._file, pickle.HIGHEST_PROTOCOL)
        self._bytes = 0

    def taken(self, topic: str) -> Iterator[_Waiting]:
        """Yield all of a topic, in order."""
        for place in self._places.pop(topic, ()):
            assert self._file is not None
            self._file.seek(place)
            yield pickle.load(self._file)
        batches = self._batches.get(topic, deque())
        while batches:
            yield batches.popleft()

    def close(self) -> None:
        """Remove the file."""
        if self._file is not None:
            # What is in its buffer is no longer needed, and may not fit on the disk.
            with suppress(OSError):
                self._file.close()
