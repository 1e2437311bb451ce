"""Threads in addition to the main one; and the processors and the memory of this machine."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from threading import Barrier, BrokenBarrierError
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

P = ParamSpec("P")
T = TypeVar("T")

_QUOTA = Path("/sys/fs/cgroup/cpu.max")
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Numbers of two settings in malloc.h of the GNU C library."""
_KEPT, _LARGE, _SMALL = 256 << 20, 32 << 20, 1 << 20


class Threads:
    """One thread or several that do submitted work in its order, behind `concurrent.futures`.

    Their first work comes only after all of them are up. An interrupt while `submit` waits for the start of a thread would
    leave one that works and that nobody knows of, so that `close` does not wait for it. `RuntimeError` where the system
    starts no more of them.
    """

    def __init__(self, name: str, count: int = 1) -> None:
        # Most runs are short, need no thread and should not wait for this import.
        from concurrent.futures import ThreadPoolExecutor

        self._count = count
        self._closed = False
        self._idle = False
        self._pool = ThreadPoolExecutor(count, name)
        try:
            self._meet()
        except RuntimeError:
            # The system has no more threads to give: those that are up have nothing to wait for.
            self._pool.shutdown(wait=False)
            raise

    def submit(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Queue some work after all that was submitted before."""
        return self._pool.submit(self._do, work, *args, **kwargs)

    def _do(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        if self._closed:
            raise RuntimeError("closed before it was begun")
        return work(*args, **kwargs)

    def close(self) -> None:
        """Wait until the work at hand is done, whatever interrupts; queued work is dropped. Further calls do nothing."""
        interrupt: KeyboardInterrupt | None = None
        self._closed = True
        while not self._idle:
            # Not by joining threads: Python takes one for ended whose join was interrupted.
            try:
                self._meet()
                self._idle = True
            except KeyboardInterrupt as err:
                interrupt = err
        self._pool.shutdown()
        if interrupt is not None:
            raise interrupt

    def _meet(self) -> None:
        """Return when all threads have come to one place, each after the work that it was given before."""
        place = Barrier(self._count)
        try:
            for coming in [self._pool.submit(_come, place) for _ in range(self._count)]:
                coming.result()
        except BaseException:
            # Threads that are there already would wait for ever for those that were not called.
            place.abort()
            raise


def _come(place: Barrier) -> None:
    try:
        place.wait()
    except BrokenBarrierError:
        # This meeting is off.
        return


def cores() -> int:
    """Return the number of processors that this process may use, by its affinity and the quota of its container."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = _QUOTA.read_text(encoding="ascii").split()
        return max(1, min(count, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError):
        # There is no quota, or it is "max".
        return count


def keep_freed_memory() -> None:
    """Make the allocator keep freed memory, where it can be told to: for our own processes, not for those of others.

    A batch allocates and frees the same arrays as the one before. By default they go back to the system in between and
    come again, page by page, which takes up to a tenth of the time.
    """
    _set_allocator({_TRIM_THRESHOLD: _KEPT, _MMAP_THRESHOLD: _LARGE})


def give_freed_memory_back() -> None:
    """Make the allocator give large arrays back when they are freed: for work that needs each of them once."""
    _set_allocator({_MMAP_THRESHOLD: _SMALL})


def _set_allocator(values: dict[int, int]) -> None:
    """Set numbers of the allocator, where it can be told."""
    import ctypes

    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        # Another C library, or another system.
        return
    for name, value in values.items():
        mallopt(name, value)
