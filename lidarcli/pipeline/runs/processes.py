"""Several logs next to each other in worker processes; a worker that dies costs no log."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType
from typing import TypeVar

from lidarcli.system.interrupts import interrupt, wait_for_imports
from lidarcli.system.machine import keep_freed_memory

T = TypeVar("T")
R = TypeVar("R")


def side_by_side(items: Sequence[T], work: Callable[[T], R], jobs: int) -> Generator[tuple[R | None, bool]]:
    """Do `work` for each of `items` in `jobs` worker processes, and yield the results in their order.

    With each result: whether it is that of a second try, alone, because a worker died; it is None where that died, too. No
    more items are handed out than there are workers, so that only these are done again when a worker dies.
    """
    pool = start_workers(jobs)
    waiting = deque(range(len(items)))
    running: dict[int, Future[R]] = {}
    done: dict[int, tuple[R | None, bool]] = {}
    try:
        for turn in range(len(items)):
            while turn not in done:
                try:
                    while waiting and len(running) < jobs:
                        running[waiting[0]] = pool.submit(_do, work, items[waiting[0]])
                        waiting.popleft()
                    wait(running.values(), return_when=FIRST_COMPLETED)
                    for index in [index for index, future in running.items() if future.done()]:
                        done[index] = running[index].result(), False
                        del running[index]
                except BrokenProcessPool:
                    wait(running.values())
                    for index, future in sorted(running.items()):
                        is_done = future.exception() is None
                        done[index] = (future.result(), False) if is_done else (_again(work, items[index]), True)
                    running.clear()
                    pool.shutdown()
                    pool = start_workers(jobs)
            yield done.pop(turn)
    except BaseException:
        _stop_workers(pool)
        raise
    pool.shutdown()


def _again(work: Callable[[T], R], item: T) -> R | None:
    """Do one item again, alone in a fresh pool; None where its worker dies again."""
    pool = start_workers(1)
    try:
        result = pool.submit(_do, work, item).result()
    except BrokenProcessPool:
        return None
    except BaseException:
        _stop_workers(pool)
        raise
    pool.shutdown()
    return result


def start_workers(count: int) -> ProcessPoolExecutor:
    """Start a pool of `count` processes."""
    # A fork of a process with threads (progress bar, Arrow) may hang; a spawned process cannot.
    context = multiprocessing.get_context("spawn")
    pool: ProcessPoolExecutor | None = None
    try:
        with signals_held():
            pool = ProcessPoolExecutor(count, mp_context=context, initializer=_be_a_worker)
            for _ in range(count):
                pool.submit(_do_nothing)
        return pool
    except BaseException:
        if pool is not None:
            _stop_workers(pool)
        raise


def _stop_workers(pool: ProcessPoolExecutor) -> None:
    """End the workers as soon as they have removed their unfinished files; at once where an interrupt ends the wait."""
    # There are none after a shutdown. Those of a host program are no business of ours.
    workers = [*(pool._processes or {}).values()]
    try:
        for process in workers:
            process.terminate()
        for process in workers:
            process.join()
    finally:
        for process in workers:
            process.kill()
        # The thread behind the pool would wait for ever for the rest of an answer that broke off.
        if (answers := getattr(pool, "_result_queue", None)) is not None:
            answers._writer.close()
        # Waits for that thread, which at the end of the program would stumble over what is half closed.
        pool.shutdown(cancel_futures=True)


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


# In a worker process.


def _do(work: Callable[[T], R], item: T) -> R:
    """Do one item."""
    try:
        return _busy(work, item)
    finally:
        # Whatever has become on its way of the error that was raised.
        if signal.getsignal(signal.SIGTERM) is not _leave:
            os._exit(1)


def _busy(work: Callable[[T], R], item: T) -> R:
    """Do one item; on the stack it shows `_leave` that the worker is busy."""
    # What the one before has left; as `over_logs.one_by_one` does.
    gc.collect(1)
    return work(item)


def _do_nothing() -> None:
    """First task of a worker, which starts it."""


def _be_a_worker() -> None:
    """Prepare a worker: it ignores ctrl-C, which is for the parent, and ends with the parent or by SIGTERM."""
    signal.signal(signal.SIGTERM, _leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wait_for_imports()
    threading.Thread(target=_end_with_the_parent, daemon=True).start()
    keep_freed_memory()


def _end_with_the_parent() -> None:
    """Wait for the end of the parent, whatever ended it: a worker without one would wait for work for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _leave(number: int, frame: FrameType | None) -> None:
    """End this worker; one that is busy by an error, at which writers remove their unfinished files."""
    at = frame
    while at is not None and at.f_code is not _busy.__code__:
        at = at.f_back
    if at is None:
        os._exit(1)
    # The pool says it once more when another worker has gone; that must not disturb the clearing away.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    interrupt(number, frame)
