"""A thread that makes parts of one log beside the main one, which the compiled kernels let run meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from lidarcli.pipeline.parts import Maker, Part, Recipe
from lidarcli.sweeps import SweepBatch
from lidarcli.threads import Beside

DEPTH = 2
"""Blocks that the thread has at once: one at work, one waiting."""


@dataclass(eq=False, slots=True)
class Work:
    """A block that was handed out."""

    batches: Sequence[SweepBatch]
    future: Future[Part]
    part: Part | None = None


class Companion:
    """The thread, in the place of worker processes: nothing is copied, nothing has to start, and it dies of nothing."""

    remark: str | None = None

    def __init__(self, recipe: Recipe) -> None:
        self._maker = Maker(recipe, helping=True)
        self._out: list[Work] = []
        self._thread = Beside("detect")

    def take(self, batches: Sequence[SweepBatch]) -> Work | None:
        """Hand out a block; None where the thread has enough to do."""
        self.settle()
        if len(self._out) >= DEPTH:
            return None
        work = Work(batches, self._thread.submit(self._make, batches))
        self._out.append(work)
        return work

    def settle(self) -> None:
        """Take in the parts that are there."""
        while self._out and self._out[0].future.done():
            work = self._out.pop(0)
            work.part = work.future.result()

    def result(self, work: Work) -> Part:
        """The part of a block, once it is there."""
        return work.part or work.future.result()

    def last(self) -> Work | None:
        """Take back the block that was handed out last, unless it is begun."""
        return self._out.pop() if self._out and self._out[-1].future.cancel() else None

    def let_go(self) -> None:
        """Nothing keeps the thread."""

    def close(self) -> None:
        """Wait until the thread has gone."""
        self._thread.close()

    stop = close

    def _make(self, batches: Sequence[SweepBatch]) -> Part:
        part = self._maker.make(batches)
        part.counted = self._maker.find.take()
        return part
