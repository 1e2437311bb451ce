"""Worker processes behind `concurrent.futures`, started quietly and ended without a trace."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType


def start(count: int, initializer: Callable[[], object]) -> ProcessPoolExecutor:
    """A pool of `count` processes that are on their way up."""
    # A fork of a process with threads (progress bar, Arrow) may hang; a spawned process cannot.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=initializer)
    try:
        with signals_held():
            for _ in range(count):
                pool.submit(_up)
        return pool
    except BaseException:
        stop(pool)
        raise


def stop(pool: ProcessPoolExecutor) -> None:
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
    """In a worker: ctrl-C is for the parent, which says when to stop. So does its end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow, daemon=True).start()


def _up() -> None:
    """What a worker does first."""


def _follow() -> None:
    """Wait for the end of the parent, whatever ended it: a worker without one would wait for work for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def signals_held() -> Iterator[None]:
    """Keep ctrl-C and SIGTERM waiting: half a start leaves a child that complains, and so does a child that they meet
    half started."""
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
