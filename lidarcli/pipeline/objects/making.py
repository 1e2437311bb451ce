"""From batches to rows of the tables: finds objects, fills rows, and shares the work among threads.

The compiled core releases the interpreter, so that threads work side by side. The batches and their order do not depend on
the number of threads, and neither does any byte that is written.
"""

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
    """Finds the objects of batches, in any order and in several threads at once, and counts for its notes."""

    def admit(self, batch: SweepBatch) -> None:
        """Refuse a batch for which it cannot be used; called in the order of the log, before anything is found in it."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection: ...

    def notes(self) -> list[str]:
        """Return notes in the end, a line each."""


def finder(
    parameters: Parameters,
    background: BackgroundOptions | None,
    catalogue: Catalogue | None = None,
    *,
    explain: bool = False,
) -> Finder:
    """Return the finder of objects in each sweep alone, or of differences from a background; a catalogue adds labels.

    `explain`: also keep the features, for the column `why`; only without a background.
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
        """Accept every batch."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        return detect(batch, self._parameters, per_beam=per_beam, explain=self._explain)

    def notes(self) -> list[str]:
        """Return no notes."""
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
        from lidarcli.formalism.matching.catalogue import evidence_of

        found = self._find(batch, per_beam)
        label, score = name(evidence_of(batch, found), self._catalogue)
        return replace(found, label=label, label_score=score)


Rows = tuple[str, str, pa.RecordBatch]
"""(table, topic, rows)"""

_ROWS = {"sweeps": sweeps_rows, "beams": beams_rows}


def rows_of(
    log: str, tables: Sequence[str], batch: SweepBatch, detection: Detection, labels: Sequence[str] = ()
) -> list[Rows]:
    """Return the rows of a batch of a log, of each of the tables; `labels` are the names in the catalogue."""
    return [(table, batch.topic, _rows(table, log, batch, detection, labels)) for table in tables]


def _rows(table: str, log: str, batch: SweepBatch, detection: Detection, labels: Sequence[str]) -> pa.RecordBatch:
    if table == "objects":
        return objects_rows(log, batch, detection, labels)
    return _ROWS[table](log, batch, detection)


@dataclass(frozen=True, slots=True)
class Recipe:
    """Instructions for every batch of a log."""

    log: str
    """Its name, as the tables have it."""
    tables: tuple[str, ...]
    parameters: Parameters
    background: BackgroundOptions | None = None
    catalogue: Catalogue | None = None
    followed: bool = False
    """True where the objects are followed afterwards, which needs more than rows."""
    explain: bool = False
    """True to fill the column `why`."""


@dataclass(slots=True)
class Made:
    """Rows of one batch."""

    rows: list[Rows]
    seen: tuple[SweepBatch, Detection] | None = None
    """The batch and its detection, where the objects are followed afterwards."""


@dataclass(slots=True)
class Part:
    """Rows of some batches."""

    batches: list[Made] = field(default_factory=list)
    """In the order of the log."""
    found: RunSummary = field(default_factory=RunSummary)
    """Counts of its objects, unless they are followed afterwards."""

    @property
    def rows(self) -> Iterator[Rows]:
        """Rows of all batches, for each table in the order of the log."""
        return (rows for made in self.batches for rows in made.rows)


class Maker:
    """Makes parts by a recipe, in any order and in several threads at once."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._labels = names_in(recipe.catalogue)
        self.find = finder(recipe.parameters, recipe.background, recipe.catalogue, explain=recipe.explain)

    def make(self, batches: Sequence[SweepBatch]) -> Part:
        """Make the rows of some batches."""
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
"""Least ranges of a block, some milliseconds of work: less is not worth handing over."""
ALONE = 2_000_000
"""Ranges ahead from which on other threads help: a tenth of a second of work."""
DEPTH = 2
"""Blocks that a thread has at once: one at work, one waiting, as this thread is busy in between."""
MOST_WAITING = 4
"""Finished blocks per thread that may wait for an earlier one; one where every beam is a row."""
MAX_THREADS = 8
"""Most threads of one log: the interpreter and the encoding of tables limit the use of more."""
PATIENCE = 0.5
"""Wait for a batch after which a source is taken as live [s]: finished parts go out at once."""


@dataclass(eq=False, slots=True)
class _Block:
    """Batches whose part is made by this thread or by another one."""

    batches: list[SweepBatch]
    part: Part | None = None
    future: Future[Part] | None = None

    @property
    def busy(self) -> bool:
        """True while another thread has it."""
        return self.part is None and self.future is not None and not self.future.done()

    def take_back(self) -> bool:
        """Take a block back that no thread has begun; returns whether that was so."""
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
        """`threads`: most threads at work, this one included."""
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
        """Yield the parts of the log, in its order."""
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
        """Return the notes of the finder, a line each."""
        return self._maker.find.notes()

    def _timed(self, batches: Iterator[SweepBatch]) -> Iterator[tuple[SweepBatch, float]]:
        """Yield every batch with the time that was spent waiting for it [s]."""
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
        """Start threads once enough work lies ahead, or, for a pipe of unknown length, once enough lies behind."""
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
                # The system starts no more threads: this one does all.
                self._helping = 0

    def _handed_out(self, batches: list[SweepBatch]) -> _Block:
        """Hand a block to another thread, or make it here where all have enough to do."""
        assert self._helpers is not None
        if sum(block.busy for block in self._line) < DEPTH * self._helping:
            return _Block(batches, future=self._helpers.submit(self._maker.make, batches))
        return _Block(batches, self._make(batches))

    def _finished(self, most: int) -> Iterator[Part]:
        """Yield the parts that are next and finished, and wait for parts while more than `most` stand in line."""
        while self._line and (len(self._line) > most or not self._line[0].busy):
            part = self._line[0].result()
            self._line.popleft()
            yield part

    def _rest(self) -> Iterator[Part]:
        """Yield all parts that are left; this thread makes those that no other has begun, rather than wait."""
        for block in reversed([*self._line]):
            if block.take_back():
                block.part = self._make(block.batches)
                yield from self._finished(len(self._line))
        yield from self._finished(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._helpers is not None:
            self._helpers.close()
