"""From batches to rows of the tables: options, finding objects, filling rows, and sharing the work among threads.

The compiled core releases the interpreter, so that threads work at once. The batches and their order do not depend on
the number of threads, and neither does any byte that is written.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import pyarrow as pa

from lidarcli.files.stores import Place
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.options.choices import NS
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.one_log import Reading, RunSummary, named_files, reading_as_dict
from lidarcli.sweeps.types import SweepBatch
from lidarcli.system.machine import Threads, cores
from lidarcli.system.records import dataclass, field, replace
from lidarcli.tabular.columns import beams_rows, objects_rows, sweeps_rows
from lidarcli.tabular.writing import table_paths

if TYPE_CHECKING:
    from concurrent.futures import Future

    from lidarcli.formalism.matching.catalogue import Catalogue
    from lidarcli.pipeline.objects.subtracting import BackgroundComparison, BackgroundOptions

OF_TRACKS = ("tracks", "trajectories")
"""Tables whose rows are known only once all sweeps of a track were read."""


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options of `track` in addition to those of `detect`."""

    parameters: TrackParameters = field(default_factory=TrackParameters)
    tracks: bool = True
    """True to fill the columns on tracks and write their table; without, memory only decides on objects."""
    trajectories: bool = True
    """True to write the trajectories of the tracks, too."""
    apart: bool = False
    """True to follow each sensor by itself, also where the places of several on one robot are known."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for the tables' metadata."""
        return self.parameters.as_dict() | ({"apart": True} if self.apart else {})


@dataclass(frozen=True, slots=True)
class DetectOptions:
    """Everything that `detect` and `track` let a user choose, apart from inputs and outputs."""

    parameters: Parameters = field(default_factory=Parameters)
    read: ReadOptions = field(default_factory=ReadOptions)
    opening: OpenOptions = field(default_factory=OpenOptions)
    poses: PoseOptions = field(default_factory=PoseOptions)
    background: BackgroundOptions | None = None
    """Background: only differences from it are objects."""
    tracking: TrackOptions | None = None
    """Follow things from sweep to sweep, and also write the tracks table."""
    catalogue: Catalogue | None = None
    """Things of interest, which objects are named by."""
    beams: bool = False
    """Also write the beams table."""
    explain: bool = False
    """Also fill the column `why`."""
    overwrite: bool = False
    layout: str | None = None
    """Layout of the tables below the folder, as of `table_paths`."""
    stamps: str = NS
    """Unit of the stamps, as of `in_unit`."""
    jobs: int = 0
    """Processors to use at most, 0 for all; the result does not depend on it."""
    cores: int = field(default_factory=cores)
    """Processors that there are."""

    @property
    def threads(self) -> int:
        """Threads for the objects of one log, no more than processors."""
        return max(1, min(self.jobs or self.cores, self.cores))

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables to write."""
        beams = ("beams",) if self.beams else ()
        if self.tracking is None or not self.tracking.tracks:
            return ("objects", "sweeps", *beams)
        trajectories = ("trajectories",) if self.tracking.trajectories else ()
        return ("objects", "sweeps", "tracks", *trajectories, *beams)

    def outputs(self, source: Source, folder: Place, date: str | None = None) -> dict[str, Place]:
        """Return the path of each table of a log; `date` as of `Reading.date`."""
        return table_paths(folder, source.name, self.tables, self.layout, date)

    def inputs(self, sources: Sequence[Source | MissingInput]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        options = [each.path for each in (self.background, self.catalogue) if each is not None]
        return [*files_of(sources), *filter(None, options), *named_files(self)]

    @property
    def need(self) -> Need:
        """Sensors whose path is matched where the log gives none."""
        return Need.TOLD if self.tracking is None else Need.MOVING

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the tables' metadata."""
        background = {} if self.background is None else {"background": self.background.as_dict()}
        # A delay of 0 that the user gave matters only where things are tracked.
        delay = {"pose_delay": 0.0} if self.tracking is not None and self.poses.delay == 0.0 else {}
        return {
            **self.parameters.as_dict(),
            **reading_as_dict(self.read, self.opening, self.poses),
            **delay,
            **background,
            **({} if self.tracking is None else {"tracking": self.tracking.as_dict()}),
            **({} if self.catalogue is None else {"catalogue": self.catalogue.as_dict()}),
            **({} if self.stamps == NS else {"stamps": self.stamps}),
        }


class ObjectFinder:
    """Finds the objects of batches, in any order and in several threads at once, and counts for its notes.

    Without a background each sweep is looked at alone, otherwise differences are found; a catalogue adds labels, and
    `explain` the features, for the column `why`, without a background.
    """

    def __init__(
        self,
        parameters: Parameters,
        background: BackgroundOptions | None = None,
        catalogue: Catalogue | None = None,
        *,
        explain: bool = False,
    ) -> None:
        self._parameters = parameters
        self._catalogue = catalogue
        self._explain = explain
        self._comparison: BackgroundComparison | None = None
        if background is not None:
            # Runs without a background should not wait for this import.
            from lidarcli.pipeline.objects.subtracting import BackgroundComparison

            self._comparison = BackgroundComparison(background, parameters)

    def admit(self, batch: SweepBatch) -> None:
        """Refuse a batch that cannot be compared; called in the order of the log, before anything is found in it."""
        if self._comparison is not None:
            self._comparison.admit(batch)

    def find(self, batch: SweepBatch, per_beam: bool) -> Detection:
        """Return the objects of a batch."""
        if self._comparison is None:
            found = detect(batch, self._parameters, per_beam=per_beam, explain=self._explain)
        else:
            found = self._comparison.detect(batch, per_beam)
        if self._catalogue is None:
            return found
        from lidarcli.formalism.matching.catalogue import evidence_of, name

        label, score = name(evidence_of(batch, found), self._catalogue)
        return replace(found, label=label, label_score=score)

    def notes(self) -> list[str]:
        """Return notes in the end, a line each."""
        return [] if self._comparison is None else self._comparison.notes()


Rows = tuple[str, str, pa.RecordBatch]
"""(table, topic, rows)"""


@dataclass(slots=True)
class BatchPart:
    """Rows of some batches, or, where the objects are tracked afterwards, the batches and their detections."""

    rows: list[Rows] = field(default_factory=list)
    """Rows of each table in the order of the log."""
    counts: RunSummary = field(default_factory=RunSummary)
    """Counts of these objects."""
    detected: list[tuple[SweepBatch, Detection]] = field(default_factory=list)
    """In the order of the log."""


class BatchDetector:
    """Finds the objects of batches and fills the rows of some tables, in any order and in several threads at once."""

    def __init__(self, log: str | None, tables: Sequence[str], options: DetectOptions) -> None:
        """`log`: its name, as the tables have it; by default that of each batch."""
        self._log = log
        self.tables = tuple(table for table in tables if table not in OF_TRACKS)
        self._is_tracked = options.tracking is not None
        # Tracked objects are named by their tracks.
        catalogue = None if self._is_tracked else options.catalogue
        self._labels = () if catalogue is None else catalogue.names
        parameters = options.parameters
        if options.tracking is not None and options.tracking.parameters.memory:
            # Memory decides on every body, whatever one sweep says of it.
            parameters = replace(parameters, min_thing=0.0)
        self.finder = ObjectFinder(parameters, options.background, catalogue, explain=options.explain)

    def detect(self, batches: Sequence[SweepBatch]) -> BatchPart:
        """Return the part of some batches."""
        part = BatchPart()
        for batch in batches:
            detection = self.finder.find(batch, "beams" in self.tables)
            if self._is_tracked:
                part.detected.append((batch, detection))
                continue
            part.counts.add_sets(detection)
            part.rows += [(table, batch.topic, self._rows(table, batch, detection)) for table in self.tables]
        return part

    def _rows(self, table: str, batch: SweepBatch, detection: Detection) -> pa.RecordBatch:
        log = batch.log if self._log is None else self._log
        if table == "objects":
            return objects_rows(log, batch, detection, self._labels)
        return (sweeps_rows if table == "sweeps" else beams_rows)(log, batch, detection)


BLOCK = 160_000
"""Least ranges of a block, some milliseconds of work: less is not worth handing over."""
ALONE = 2_000_000
"""Ranges ahead from which on threads help: a tenth of a second of work."""
MAX_WAITING = 4
"""Blocks per thread that are at work or wait in line; one where every beam is a row."""
MAX_THREADS = 8
"""Most threads of one log: the interpreter and the encoding of tables limit the use of more."""
PATIENCE = 0.5
"""Wait for a batch after which a source is taken as live [s]: finished parts go out at once."""


class ParallelDetection:
    """Finds the objects of the batches of a log, in its order; leaving waits for the threads that help."""

    def __init__(self, detector: BatchDetector, reading: Reading, threads: int = 1) -> None:
        """`reading`: where the batches come from; `threads`: most threads at work."""
        self._detector = detector
        self._reading = reading
        self._count = min(threads, MAX_THREADS)
        self._window = self._count if "beams" in detector.tables else self._count * MAX_WAITING - 1
        self._threads: Threads | None = None
        self._batches: list[SweepBatch] = []
        """Batches of the next block."""
        self._parts: deque[Future[BatchPart]] = deque()
        self._ranges = 0
        self._left = time.perf_counter(), time.thread_time()
        """Times at which this was left for the next batch."""
        self._waited = self._worked = 0.0

    def take(self, batch: SweepBatch) -> Iterator[BatchPart]:
        """Take the next batch of the log; yield the parts that are finished."""
        left, busy = self._left
        waited = time.perf_counter() - left - (time.thread_time() - busy)
        self._waited += waited
        self._detector.finder.admit(batch)
        self._ranges += batch.ranges.size
        self._batches.append(batch)
        if self._threads is None and self._is_worth_threads():
            try:
                self._threads = Threads("detect", self._count)
            except RuntimeError:
                # The system starts no more threads: this one does all.
                self._count = 1
        if self._threads is None or waited > PATIENCE:
            yield from self._finished(0)
            started = time.perf_counter()
            part = self._detector.detect(self._next_block())
            self._worked += time.perf_counter() - started
            yield part
        elif sum(each.ranges.size + len(each) for each in self._batches) >= BLOCK:
            # Sweeps without beams take room, too.
            self._parts.append(self._threads.submit(self._detector.detect, self._next_block()))
            yield from self._finished(self._window)
        self._left = time.perf_counter(), time.thread_time()

    def flush(self) -> Iterator[BatchPart]:
        """Yield all parts that are left."""
        last = self._next_block()
        if last and self._threads is not None:
            self._parts.append(self._threads.submit(self._detector.detect, last))
        yield from self._finished(0)

    def notes(self) -> list[str]:
        """Return the notes of the finder, a line each."""
        return self._detector.finder.notes()

    def _is_worth_threads(self) -> bool:
        """Return whether enough work lies ahead, or, for a pipe of unknown length, enough lies behind."""
        if self._count < 2:
            return False
        if (ahead := self._reading.ahead()) is None:
            # A sensor that sends as it turns is slower than the work: there is nothing to help with.
            return self._ranges >= ALONE and self._waited < self._worked
        return ahead * self._ranges >= ALONE * self._reading.summary.sweeps

    def _next_block(self) -> list[SweepBatch]:
        batches, self._batches = self._batches, []
        return batches

    def _finished(self, most: int) -> Iterator[BatchPart]:
        """Yield the parts that are next and finished, and wait for parts while more than `most` are in line."""
        while self._parts and (len(self._parts) > most or self._parts[0].done()):
            yield self._parts.popleft().result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._threads is not None:
            self._threads.close()
