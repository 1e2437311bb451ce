"""A thread beside the main one, which an interrupt cannot leave behind at work."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

P = ParamSpec("P")
T = TypeVar("T")


class Beside:
    """One thread that does what it is given, one after the other, behind `concurrent.futures`.

    Its first work comes only after it is up. An interrupt while `submit` waits for the start of a thread would leave one
    that works and that nobody knows of, so that `close` does not wait for it.
    """

    def __init__(self, name: str) -> None:
        # Most runs are short and need no thread, nor wait for this import.
        from concurrent.futures import ThreadPoolExecutor

        self._closed = False
        self._idle = False
        self._pool = ThreadPoolExecutor(1, name)
        self._pool.submit(_nothing).result()

    def submit(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have some work done after all that was submitted before."""
        return self._pool.submit(self._do, work, *args, **kwargs)

    def _do(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        if self._closed:
            raise RuntimeError("closed before it was begun")
        return work(*args, **kwargs)

    def close(self) -> None:
        """Wait until the work at hand is done, whatever interrupts; what was to follow is not begun. Repeats are idle."""
        interrupt: KeyboardInterrupt | None = None
        self._closed = True
        while not self._idle:
            # Not by joining the thread: Python takes one for ended whose join was interrupted.
            try:
                self._pool.submit(_nothing).result()
                self._idle = True
            except KeyboardInterrupt as err:
                interrupt = err
        self._pool.shutdown()
        if interrupt is not None:
            raise interrupt


def _nothing() -> None:
    """Work that is done when all work before it is."""
