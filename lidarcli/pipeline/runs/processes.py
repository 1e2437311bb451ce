"""Several logs side by side in worker processes; a worker that dies costs no log."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import resource_tracker
from types import FrameType

from lidarcli.machine import keep_freed_memory
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.runs.outcomes import INTERNAL_ERROR, Outcome, Work, outcome_of


def start_workers(count: int, initializer: Callable[[], object]) -> ProcessPoolExecutor:
    """Start a pool of `count` processes."""
    # A fork of a process with threads (progress bar, Arrow) may hang; a spawned process cannot.
    context = multiprocessing.get_context("spawn")
    pool: ProcessPoolExecutor | None = None
    try:
        with signals_held():
            pool = ProcessPoolExecutor(count, mp_context=context, initializer=initializer)
            for _ in range(count):
                pool.submit(_up)
        return pool
    except BaseException:
        if pool is not None:
            stop_workers(pool)
        raise


def stop_workers(pool: ProcessPoolExecutor) -> None:
    """End the workers at once."""
    workers = multiprocessing.active_children()
    for process in workers:
        process.terminate()
    for process in workers:
        process.join(5)
        process.kill()
    # The thread behind the pool would wait for ever for the rest of an answer that broke off.
    answers = getattr(pool, "_result_queue", None)
    if answers is not None:
        answers._writer.close()
    # Waits for that thread, which at the end of the program would stumble over what is half closed.
    pool.shutdown(cancel_futures=True)


def obey_the_parent() -> None:
    """Prepare a worker: it ignores ctrl-C, which is for the parent, and ends with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow, daemon=True).start()


def _up() -> None:
    """Do nothing: the first task of a worker."""


def _follow() -> None:
    """Wait for the end of the parent, whatever ended it: a worker without one would wait for work for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold ctrl-C and SIGTERM back: a child or a semaphore that they meet half made would print a warning or an error."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    before = {
        number: signal.signal(number, lambda number, frame: came.append((number, frame)))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    # Its start would let ctrl-C through again.
    resource_tracker.ensure_running()
    # Children inherit what this thread blocks, and keep it. It is not enough here: other threads take the signal, too.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for held, handler in before.items():
            signal.signal(held, handler)
        if came:
            number, frame = came[0]
            handler = before[signal.Signals(number)]
            if callable(handler):
                handler(number, frame)
            elif handler == signal.SIG_DFL:
                os.kill(os.getpid(), number)


_working = False
"""True while this worker process is busy with a log (set in workers only)."""


class _Stopped(BaseException):
    """The parent ends this worker: unwinds through the writers, which remove their unfinished files."""


def side_by_side(sources: Sequence[Source | MissingInput], work: Work, jobs: int) -> Iterator[Outcome]:
    """Do `work` for each of `sources` in `jobs` worker processes, and yield the outcomes in their order.

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
        stop_workers(pool)
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


def _again(work: Work, source: Source | MissingInput) -> Outcome:
    """Do one log again, alone in a fresh pool, after a worker died."""
    pool = _pool(1)
    try:
        outcome = pool.submit(_do, work, source).result()
    except BrokenProcessPool:
        error = "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
        return Outcome(source.label, INTERNAL_ERROR, error=error, source=source)
    except BaseException:
        stop_workers(pool)
        raise
    pool.shutdown()
    return replace(outcome, remark="a worker process died; this log was done again")


def _pool(jobs: int) -> ProcessPoolExecutor:
    return start_workers(jobs, _be_a_worker)


def _be_a_worker() -> None:
    """Prepare this process as a worker, which the parent ends by SIGTERM."""
    signal.signal(signal.SIGTERM, _leave)
    obey_the_parent()
    keep_freed_memory()


def _leave(number: int, frame: object) -> None:
    if not _working:
        os._exit(1)
    # The pool says it once more when another worker has gone; that must not disturb the clearing away.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Stopped


def _do(work: Work, source: Source | MissingInput) -> Outcome:
    """One log, in a worker process."""
    global _working
    _working = True
    try:
        return outcome_of(source, work)
    except _Stopped:
        os._exit(1)
    finally:
        _working = False
