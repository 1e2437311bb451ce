"""Worker processes that make parts of one log; one that dies costs no part."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from threading import Thread

from lidarcli.errors import LidarcliError
from lidarcli.pipeline import processes
from lidarcli.pipeline.memory import keep_freed_memory
from lidarcli.pipeline.parts import Maker, Part, Recipe
from lidarcli.pipeline.parts_parcels import (
    Answer,
    Area,
    Parcel,
    SharedFile,
    dump,
    load,
    packed,
    read_rows,
    unpacked,
    write_rows,
)
from lidarcli.sweeps import SweepBatch

DEPTH = 3
"""Blocks that a worker has at once: one at work, the others so that it need not wait while row groups are written."""
SLOT = 6 << 20
"""Bytes of shared memory for a block; what takes more goes through a pipe."""
SLOT_BEAMS = 28 << 20
"""The same where every beam is a row."""
MAX_DEATHS = 3
"""After so many the log is finished without workers."""


@dataclass(eq=False, slots=True)
class Task:
    """A block that was handed out, kept until its part is there."""

    batches: Sequence[SweepBatch]
    future: Future[Answer]
    slot: int
    part: Part | None = None


class Helpers:
    """`count` worker processes. Nobody waits for their start: until then `take` takes nothing."""

    def __init__(self, recipe: Recipe, count: int) -> None:
        self._recipe = recipe
        self._count = count
        self._size = SLOT_BEAMS if "beams" in recipe.tables else SLOT
        self._deaths = 0
        self.remark: str | None = None
        """What happened on the way and was mended."""
        self._out: list[Task] = []
        self._free: list[int] = []
        self._ready = False
        self._pool: ProcessPoolExecutor | None = None
        self._going: Thread | None = None
        self._start()

    def take(self, batches: Sequence[SweepBatch]) -> Task | None:
        """Hand out a block; None where no worker is free for it."""
        self.settle()
        if not self._is_ready() or not self._free or self._pool is None:
            return None
        slot = self._free.pop()
        pieces = dump(batches)
        parcel = packed(pieces) if self._area is None else self._area.pack(slot, pieces)
        try:
            future = self._pool.submit(_make, parcel, slot)
        except BrokenExecutor:
            self._mend()
            return None
        task = Task(batches, future, slot)
        self._out.append(task)
        return task

    def settle(self) -> None:
        """Take in the parts that are there."""
        for task in [task for task in self._out if task.future.done()]:
            # Mending takes in all of them.
            if task.part is None:
                self._receive(task)

    def result(self, task: Task) -> Part:
        """The part of a block, once it is there."""
        while task.part is None:
            wait([task.future])
            self._receive(task)
        return task.part

    def last(self) -> Task | None:
        """Take back the block that was handed out last, unless its part is there or no other is being made."""
        self.settle()
        return self._out.pop() if len(self._out) > 1 else None

    def let_go(self) -> None:
        """Let the workers go; none has work any more. `close` waits for them."""
        if self._pool is not None:
            self._going = Thread(target=self._pool.shutdown, kwargs={"cancel_futures": True})
            self._going.start()

    def close(self) -> None:
        """Wait until the workers have gone."""
        if self._going is not None:
            self._going.join()
            self._pool = None
        self.stop()

    def stop(self) -> None:
        """End the workers, whatever they are doing."""
        if self._pool is not None:
            processes.stop(self._pool)
            self._pool = None
        self._file_done()

    def _start(self) -> None:
        slots = DEPTH * self._count
        self._file: SharedFile | None = None
        self._area: Area | None = None
        try:
            self._file = SharedFile(slots * self._size)
            self._area = Area(self._file.path, self._size)
        except OSError:
            # No room for it: everything goes through pipes.
            self._file_done()
        self._free = list(range(slots))
        self._ready = False
        path = None if self._file is None else self._file.path
        try:
            self._pool, self._up = processes.start(self._count, _begin, self._recipe, path, self._size)
        except (OSError, BrokenExecutor):
            self._give_up()
        except BaseException:
            self._file_done()
            raise

    def _is_ready(self) -> bool:
        if not self._ready and self._pool is not None:
            try:
                self._ready = any(up.done() and up.result() is None for up in self._up)
            except BrokenExecutor:
                self._give_up()
        return self._ready

    def _give_up(self) -> None:
        self.stop()
        self.remark = "worker processes could not be started; one process did all the work"

    def _file_done(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _receive(self, task: Task) -> None:
        try:
            answer = task.future.result()
        except BrokenExecutor:
            self._mend()
            return
        task.part = self._part(answer)
        self._out.remove(task)
        self._free.append(task.slot)

    def _part(self, answer: Answer) -> Part:
        rows = read_rows(self._recipe.tables, answer.topics, unpacked(answer.rows, self._area))
        return Part(rows, answer.found, answer.counted)

    def _mend(self) -> None:
        """A worker died, and its pool with it: do what is lost again, then go on with new workers."""
        self._deaths += 1
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        wait([task.future for task in self._out])
        lost = []
        for task in self._out:
            if isinstance(task.future.exception(), BrokenExecutor):
                lost.append(task)
            else:
                task.part = self._part(task.future.result())
        if lost:
            self._make_again(lost)
            self.remark = "a worker process died; its part of the log was done again"
        self._out.clear()
        self._file_done()
        if self._deaths < MAX_DEATHS:
            self._start()

    def _make_again(self, tasks: Sequence[Task]) -> None:
        """Do some blocks again, one by one in a fresh process: if that dies too, the block at hand is the cause."""
        pool, _ = processes.start(1, _begin, self._recipe, None, 0)
        try:
            for task in tasks:
                task.part = self._part(pool.submit(_make, packed(dump(task.batches)), None).result())
        except BrokenExecutor:
            raise LidarcliError(
                f"{_place(task.batches)}: a worker process died twice of it, ended by the system (out of memory?); "
                "try --jobs 1"
            ) from None
        except BaseException:
            processes.stop(pool)
            raise
        pool.shutdown()


def _place(batches: Sequence[SweepBatch]) -> str:
    first, last = batches[0], batches[-1]
    if first.topic == last.topic:
        return f"sweeps {first.sweep[0]:,} to {last.sweep[-1]:,} of {first.topic}"
    return f"sweep {first.sweep[0]:,} of {first.topic} to sweep {last.sweep[-1]:,} of {last.topic}"


# What follows runs in the workers.

_maker: Maker
_area: Area | None = None


def _begin(recipe: Recipe, path: str | None, size: int) -> None:
    global _maker, _area
    processes.obey_the_parent(path)
    keep_freed_memory()
    _maker = Maker(recipe, helping=True)
    _area = None if path is None else Area(path, size)


def _make(parcel: Parcel, slot: int | None) -> Answer:
    batches = load(unpacked(parcel, _area))
    part = _maker.make(batches)
    streams = write_rows(part, _maker.recipe.tables)
    # The batches lie in the slot, too; they are not needed any more.
    rows = packed(streams) if _area is None or slot is None else _area.pack(slot, streams)
    return Answer(tuple(batch.topic for batch in batches), rows, part.found, _maker.find.take())
