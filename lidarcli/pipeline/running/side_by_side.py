"""Several logs side by side in worker processes; a worker that dies costs no log."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.running import processes
from lidarcli.pipeline.running.memory import keep_freed_memory
from lidarcli.pipeline.running.outcomes import INTERNAL_ERROR, Outcome, Work, outcome_of

_working = False
"""Whether this worker process is busy with a log (set in workers only)."""


class _Stopped(BaseException):
    """The parent wants this worker to end: unwinds through the writers, which remove their unfinished files."""


def side_by_side(sources: Sequence[Source | Nothing], work: Work, jobs: int) -> Iterator[Outcome]:
    """What becomes of `work` for each of `sources`, in their order, from `jobs` worker processes.

    No more logs are handed out than there are workers, so that only these are done again when a worker dies.
    """
    pool = _pool(jobs)
    waiting = deque(range(len(sources)))
    running: dict[int, Future[Outcome]] = {}
    done: dict[int, Outcome] = {}
    try:
        for turn in range(len(sources)):
            while turn not in done:
                try:
                    while waiting and len(running) < jobs:
                        running[waiting[0]] = pool.submit(_do, work, sources[waiting[0]])
                        waiting.popleft()
                    _collect(running, done)
                except BrokenProcessPool:
                    wait(running.values())
                    _collect_whole(running, done)
                    for index in sorted(running):
                        done[index] = _again(work, sources[index])
                    running.clear()
                    pool.shutdown()
                    pool = _pool(jobs)
            yield done.pop(turn)
    except BaseException:
        processes.stop(pool)
        raise
    pool.shutdown()


def _collect(running: dict[int, Future[Outcome]], done: dict[int, Outcome]) -> None:
    """Wait until some of `running` have ended and move them to `done`."""
    wait(running.values(), return_when=FIRST_COMPLETED)
    for index in [index for index, future in running.items() if future.done()]:
        done[index] = running[index].result()
        del running[index]


def _collect_whole(running: dict[int, Future[Outcome]], done: dict[int, Outcome]) -> None:
    """Move to `done` what had ended before the pool broke."""
    for index in [index for index, future in running.items() if future.exception() is None]:
        done[index] = running.pop(index).result()


def _again(work: Work, source: Source | Nothing) -> Outcome:
    """Do one log again, alone in a fresh pool, after a worker died."""
    pool = _pool(1)
    try:
        outcome = pool.submit(_do, work, source).result()
    except BrokenProcessPool:
        error = (
            "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
        )
        return Outcome(source.label, INTERNAL_ERROR, error=error, source=source)
    except BaseException:
        processes.stop(pool)
        raise
    pool.shutdown()
    return replace(outcome, remark="a worker process died; this log was done again")


def _pool(jobs: int) -> ProcessPoolExecutor:
    return processes.start(jobs, _be_a_worker)


def _be_a_worker() -> None:
    """The parent says when to stop."""
    signal.signal(signal.SIGTERM, _leave)
    processes.obey_the_parent()
    keep_freed_memory()


def _leave(number: int, frame: object) -> None:
    if not _working:
        os._exit(1)
    # The pool says it once more when another worker has gone; that must not disturb the clearing away.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Stopped


def _do(work: Work, source: Source | Nothing) -> Outcome:
    """One log, in a worker process."""
    global _working
    _working = True
    try:
        return outcome_of(source, work)
    except _Stopped:
        os._exit(1)
    finally:
        _working = False
