"""One log over several threads: this one reads, writes and keeps the order; others help with what is between.

The compiled core lets go of the interpreter, so that threads work side by side. Whatever their number, the batches and
their order are the same, and so is every byte that is written.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Self

from lidarcli.pipeline.objects.parts import Maker, Part, Recipe
from lidarcli.pipeline.reading.reading import Progress, Reading
from lidarcli.sweeps import SweepBatch
from lidarcli.threads import Beside

if TYPE_CHECKING:
    from concurrent.futures import Future

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
