"""One log over several processors: this process reads, writes and keeps the order; others help with what is between.

Helpers are worker processes or, where one process is to do it all, a thread. Whatever their number, the batches and their
order are the same, and so is every byte that is written.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

from lidarcli.pipeline.parts import Maker, Part, Recipe
from lidarcli.pipeline.reading import Progress, Reading
from lidarcli.sweeps import SweepBatch

BLOCK = 160_000
"""Ranges that are handed out together at least, some milliseconds of work; with a full batch they still fit a slot."""
ALONE = 12_000_000
"""Work of fewer ranges than these, half a second's, is done before a worker would be of use."""
ALONE_BESIDE = 2_000_000
"""The same of a thread, a tenth of a second's."""
WINDOW = 4
"""Finished blocks per process that may wait for an earlier one; where every beam is a row, one."""
MAX_PROCESSES = 8
"""More are of no use to one log: encoding the tables takes about a fifth of the time and stays in one process."""
PATIENCE = 0.5
"""[s] A source that lets one wait longer for a batch is live: what there is goes out at once."""


class Task(Protocol):
    """A block that was handed out."""

    batches: Sequence[SweepBatch]
    part: Part | None
    """What was made of it, once it is there."""


class Help(Protocol):
    """Who makes parts beside this thread, from its first `take` to `close` or, if something went wrong, `stop`."""

    remark: str | None
    """What happened on the way and was mended."""

    def take(self, batches: Sequence[SweepBatch]) -> Task | None:
        """Hand out a block; None where nobody is free for it."""

    def settle(self) -> None:
        """Take in the parts that are there."""

    def result(self, task: Any) -> Part:
        """The part of a block that was handed out, once it is there."""

    def last(self) -> Task | None:
        """Take back the block that was handed out last, where that may save time."""

    def let_go(self) -> None:
        """No more blocks will come."""

    def close(self) -> None:
        """Wait until nothing is left of it."""

    def stop(self) -> None:
        """End it, whatever it is doing."""


class Splitting:
    """Makes the parts of a log; leaving ends all workers."""

    def __init__(self, reading: Reading, recipe: Recipe, jobs: int, cores: int = 1) -> None:
        """`jobs`: processes, this one included; `cores`: processors that there are for them."""
        self._reading = reading
        self._recipe = recipe
        self._jobs = min(jobs, MAX_PROCESSES)
        self._cores = cores
        self._block = BLOCK if jobs > 1 else 0
        self._window = self._jobs * (1 if "beams" in recipe.tables else WINDOW)
        self._maker = Maker(recipe)
        self._helpers: Help | None = None
        self._line: deque[Part | Task] = deque()
        self._ranges = 0
        self._waited = 0.0
        self._worked = 0.0

    def parts(self, progress: Progress | None) -> Iterator[Part]:
        """What is made of the log, in its order."""
        block: list[SweepBatch] = []
        for batch, waited in self._timed(self._reading.batches(progress)):
            self._maker.find.admit(batch)
            self._ranges += batch.ranges.size
            block.append(batch)
            if self._helpers is None:
                self._start_when_worth_it()
                yield self._make(block)
            elif waited > PATIENCE:
                yield from self._finished(0)
                yield self._make(block)
            elif sum(batch.ranges.size for batch in block) < self._block:
                continue
            else:
                self._line.append(self._helpers.take(block) or self._make(block))
                yield from self._finished(self._window)
            block = []
        if block:
            self._line.append(self._make(block))
        yield from self._rest()

    def notes(self) -> list[str]:
        """What a user should know, a line each."""
        return self._maker.find.notes()

    @property
    def remark(self) -> str | None:
        """What happened on the way and was mended."""
        return None if self._helpers is None else self._helpers.remark

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

    def _make(self, block: list[SweepBatch]) -> Part:
        started = time.perf_counter()
        part = self._maker.make(block)
        self._worked += time.perf_counter() - started
        return part

    def _start_when_worth_it(self) -> None:
        """Call workers once what lies ahead is long enough; of a pipe nobody knows, and what lies behind must be."""
        if self._jobs < 2 and self._cores < 2:
            return
        alone = ALONE if self._jobs > 1 else ALONE_BESIDE
        ahead = self._reading.ahead()
        if ahead is None:
            # A sensor that sends as it turns is slower than the work: there is nothing to help with.
            worth_it = self._ranges >= alone and self._waited < self._worked
        else:
            worth_it = ahead * self._ranges >= alone * self._reading.summary.sweeps
        # Most logs are short and need not wait for the imports.
        if worth_it and self._jobs > 1:
            from lidarcli.pipeline.parts_workers import Helpers

            self._helpers = Helpers(self._recipe, self._jobs - 1)
        elif worth_it:
            from lidarcli.pipeline.parts_beside import Companion

            self._helpers = Companion(self._recipe)

    def _finished(self, most: int) -> Iterator[Part]:
        """The parts that are next and there; also those that are not, while more than `most` stand in line."""
        if self._helpers is None:
            return
        self._helpers.settle()
        while self._line:
            entry = self._line[0]
            if not isinstance(entry, Part):
                if entry.part is None and len(self._line) <= most:
                    return
                entry = self._helpers.result(entry)
                if entry.counted is not None:
                    self._maker.find.add(entry.counted)
            self._line.popleft()
            yield entry

    def _rest(self) -> Iterator[Part]:
        """All parts that are still to come; rather than wait for the last ones, this process makes them, too."""
        if self._helpers is None:
            return
        while (task := self._helpers.last()) is not None:
            task.part = self._make(list(task.batches))
            yield from self._finished(len(self._line))
        yield from self._finished(0)
        self._helpers.let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._helpers is None:
            return
        if kind is None:
            self._helpers.close()
        else:
            self._helpers.stop()
