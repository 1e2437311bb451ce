"""Batches in, rows of the tables out: finds objects, fills rows, and shares the work among threads."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import pyarrow as pa

from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.matching.catalogue import Catalogue, name, names_in
from lidarcli.machine import Beside
from lidarcli.pipeline.reading.one_log import Progress, Reading, RunSummary
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular.rows import beams_rows, objects_rows, sweeps_rows

if TYPE_CHECKING:
    from concurrent.futures import Future

    from lidarcli.pipeline.objects.subtracting import BackgroundOptions


class Finder(Protocol):
    """Finds the objects of batches, in any order and in several threads at once; counts what a user should know."""

    def admit(self, batch: SweepBatch) -> None:
        """Refuse a batch for which it cannot be used; asked in the order of the log, before anything is found in it."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection: ...

    def notes(self) -> list[str]:
        """What a user should know of it in the end, a line each."""


def finder(
    parameters: Parameters,
    background: BackgroundOptions | None,
    catalogue: Catalogue | None = None,
    *,
    explain: bool = False,
) -> Finder:
    """Each sweep by itself, or what differs from a background; with a catalogue its objects have labels.

    `explain`: also tell why a body is a thing, where that is decided by the sweep alone.
    """
    if catalogue is not None:
        return Naming(finder(parameters, background, explain=explain), catalogue)
    if background is None:
        return _Alone(parameters, explain)
    from lidarcli.pipeline.objects.subtracting import Subtracting

    return Subtracting(background, parameters)


class _Alone:
    """Finds objects by the sweep alone."""

    def __init__(self, parameters: Parameters, explain: bool) -> None:
        self._parameters = parameters
        self._explain = explain

    def admit(self, batch: SweepBatch) -> None:
        """Every batch will do."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        return detect(batch, self._parameters, per_beam=per_beam, explain=self._explain)

    def notes(self) -> list[str]:
        """Nothing."""
        return []


class Naming:
    """A finder whose objects have labels: indices into the names of the catalogue."""

    def __init__(self, find: Finder, catalogue: Catalogue) -> None:
        self._find = find
        self._catalogue = catalogue
        self.admit = find.admit
        self.notes = find.notes

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        """The objects of a batch."""
        from lidarcli.formalism.matching.evidence import evidence_of

        found = self._find(batch, per_beam)
        label, score = name(evidence_of(batch, found), self._catalogue)
        return replace(found, label=label, label_score=score)


Rows = tuple[str, str, pa.RecordBatch]
"""(table, topic, rows)"""

_ROWS = {"sweeps": sweeps_rows, "beams": beams_rows}


def rows_of(
    log: str, tables: Sequence[str], batch: SweepBatch, detection: Detection, labels: Sequence[str] = ()
) -> list[Rows]:
    """The rows that a batch of a log gives, of each of the tables; `labels` are the names in the catalogue."""
    return [(table, batch.topic, _rows(table, log, batch, detection, labels)) for table in tables]


def _rows(
    table: str, log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str]
) -> pa.RecordBatch:
    if table == "objects":
        return objects_rows(log, batch, detection, labels)
    return _ROWS[table](log, batch, detection)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is to be made of every batch."""

    log: str
    """Its name, as the tables have it."""
    tables: tuple[str, ...]
    parameters: Parameters
    background: BackgroundOptions | None = None
    catalogue: Catalogue | None = None
    followed: bool = False
    """Whether the objects are followed afterwards, which needs more than rows."""
    explain: bool = False
    """Whether to tell why a body is a thing."""


@dataclass(slots=True)
class Made:
    """What was made of one batch."""

    rows: list[Rows]
    seen: tuple[SweepBatch, Detection] | None = None
    """What it was made of, where the objects are followed afterwards."""


@dataclass(slots=True)
class Part:
    """What was made of some batches."""

    batches: list[Made] = field(default_factory=list)
    """In the order of the log."""
    found: RunSummary = field(default_factory=RunSummary)
    """Its objects, counted, unless they are followed afterwards."""

    @property
    def rows(self) -> Iterator[Rows]:
        """The rows of all batches, for each table in the order of the log."""
        return (rows for made in self.batches for rows in made.rows)


class Maker:
    """Makes parts by a recipe, in any order and in several threads at once."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._labels = names_in(recipe.catalogue)
        self.find = finder(recipe.parameters, recipe.background, recipe.catalogue, explain=recipe.explain)

    def make(self, batches: Sequence[SweepBatch]) -> Part:
        """The rows of some batches."""
        part = Part()
        tables, followed = self._recipe.tables, self._recipe.followed
        for batch in batches:
            detection = self.find(batch, "beams" in tables)
            if not followed:
                part.found.add_sets(detection)
            rows = rows_of(self._recipe.log, tables, batch, detection, self._labels)
            part.batches.append(Made(rows, (batch, detection) if followed else None))
        return part


BLOCK = 160_000
"""Ranges that are handed out together at least, some milliseconds of work: less is not worth the handing over."""
ALONE = 2_000_000
"""Work of fewer ranges than these, a tenth of a second's, needs no help."""
DEPTH = 2
"""Blocks that a thread has at once: one at work, one waiting, as this thread is busy in between."""
MOST_WAITING = 4
"""Finished blocks per thread that may wait for an earlier one; where every beam is a row, one."""
MAX_THREADS = 8
"""More are of no use to one log: what holds the interpreter, and the encoding of tables, take their share of the time."""
PATIENCE = 0.5
"""[s] A source that lets one wait longer for a batch is live: what there is goes out at once."""


@dataclass(eq=False, slots=True)
class _Block:
    """Batches whose part is made by this thread or by another one."""

    batches: list[SweepBatch]
    part: Part | None = None
    future: Future[Part] | None = None

    @property
    def busy(self) -> bool:
        """Whether another thread has still to do with it."""
        return self.part is None and self.future is not None and not self.future.done()

    def take_back(self) -> bool:
        """Whether nobody has begun with it; then nobody else will."""
        return self.busy and self.future is not None and self.future.cancel()

    def result(self) -> Part:
        """The part, once it is there."""
        if self.part is None and self.future is not None:
            self.part = self.future.result()
        assert self.part is not None
        return self.part


class Splitting:
    """Makes the parts of a log; leaving waits for the threads that help."""

    def __init__(self, reading: Reading, recipe: Recipe, threads: int = 1) -> None:
        """`threads`: so many at work at most, this one included."""
        self._reading = reading
        self._maker = Maker(recipe)
        self._helping = min(threads, MAX_THREADS) - 1
        self._window = (self._helping + 1) * (1 if "beams" in recipe.tables else MOST_WAITING)
        self._helpers: Beside | None = None
        self._line: deque[_Block] = deque()
        self._ranges = 0
        self._waited = 0.0
        self._worked = 0.0

    def parts(self, progress: Progress | None) -> Iterator[Part]:
        """What is made of the log, in its order."""
        batches: list[SweepBatch] = []
        for batch, waited in self._timed(self._reading.batches(progress)):
            self._maker.find.admit(batch)
            self._ranges += batch.ranges.size
            batches.append(batch)
            if self._helpers is None:
                self._call_for_help()
                yield self._make(batches)
            elif waited > PATIENCE:
                yield from self._finished(0)
                yield self._make(batches)
            elif sum(batch.ranges.size + len(batch) for batch in batches) < BLOCK:
                # Sweeps without beams take room, too.
                continue
            else:
                self._line.append(self._handed_out(batches))
                yield from self._finished(self._window)
            batches = []
        if batches:
            self._line.append(_Block(batches, self._make(batches)))
        yield from self._rest()

    def notes(self) -> list[str]:
        """What a user should know, a line each."""
        return self._maker.find.notes()

    def _timed(self, batches: Iterator[SweepBatch]) -> Iterator[tuple[SweepBatch, float]]:
        """Every batch, and how long nothing was done because it had not come."""
        while True:
            started, busy = time.perf_counter(), time.thread_time()
            batch = next(batches, None)
            if batch is None:
                return
            waited = time.perf_counter() - started - (time.thread_time() - busy)
            self._waited += waited
            yield batch, waited

    def _make(self, batches: list[SweepBatch]) -> Part:
        started = time.perf_counter()
        part = self._maker.make(batches)
        self._worked += time.perf_counter() - started
        return part

    def _call_for_help(self) -> None:
        """Start threads once what lies ahead is long enough; of a pipe nobody knows, and what lies behind must be."""
        if self._helping < 1:
            return
        ahead = self._reading.ahead()
        if ahead is None:
            # A sensor that sends as it turns is slower than the work: there is nothing to help with.
            worth_it = self._ranges >= ALONE and self._waited < self._worked
        else:
            worth_it = ahead * self._ranges >= ALONE * self._reading.summary.sweeps
        if worth_it:
            try:
                self._helpers = Beside("detect", self._helping)
            except RuntimeError:
                # The system has no thread to give; it goes without.
                self._helping = 0

    def _handed_out(self, batches: list[SweepBatch]) -> _Block:
        """A block in the hands of another thread, or made here where all have enough to do."""
        assert self._helpers is not None
        if sum(block.busy for block in self._line) < DEPTH * self._helping:
            return _Block(batches, future=self._helpers.submit(self._maker.make, batches))
        return _Block(batches, self._make(batches))

    def _finished(self, most: int) -> Iterator[Part]:
        """The parts that are next and there; also those that are not, while more than `most` stand in line."""
        while self._line and (len(self._line) > most or not self._line[0].busy):
            part = self._line[0].result()
            self._line.popleft()
            yield part

    def _rest(self) -> Iterator[Part]:
        """All parts that are still to come; rather than wait for the last ones, this thread makes them, too."""
        for block in reversed([*self._line]):
            if block.take_back():
                block.part = self._make(block.batches)
                yield from self._finished(len(self._line))
        yield from self._finished(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._helpers is not None:
            self._helpers.close()
