"""Ctrl-C, and the polite request to end (SIGTERM), at moments that can bear them. Imports next to nothing itself."""

from __future__ import annotations

import enum
import os
import signal
import sys
import time
from types import FrameType

_BUSY = ("<frozen importlib", str(enum.__file__))
"""Code during which an interrupt waits: imports, and the look for attributes of an enumeration, which numpy does before it
computes with one and of which it forgets every error."""
_ENOUGH = 1.0
"""Time after an interrupt in which further ones are ignored [s]: they would only disturb the clearing away."""
_last = -_ENOUGH


class Terminated(KeyboardInterrupt):
    """SIGTERM: like ctrl-C, but the process ends as the signal would have ended it."""


def wait_for_imports() -> None:
    """From now on ctrl-C raises `KeyboardInterrupt`, and SIGTERM `Terminated`, but not within imports or enumerations.

    Python makes a `RuntimeError` of one that strikes while the fields of a class are made; C libraries end the process
    where something fails while they are loaded.
    """
    sys.unraisablehook = _raise_again
    # Where somebody else decides what a signal does (`nohup`, a host program), nothing changes.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, interrupt)


def end_as_terminated() -> None:
    """Let SIGTERM do what it does by default."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal: raise its error, at once or as soon as what is under way can bear it."""
    global _last
    if time.monotonic() - _last < _ENOUGH:
        return
    _last = time.monotonic()
    error = Terminated if number == signal.SIGTERM else KeyboardInterrupt
    waiting = None
    while frame is not None:
        if frame.f_code.co_filename.startswith(_BUSY):
            waiting = frame.f_back
        frame = frame.f_back
    if waiting is None:
        raise error
    _raise_in(waiting, error)


def _raise_in(frame: FrameType, error: type[KeyboardInterrupt]) -> None:
    """Raise an error as soon as this frame, which waits for a call, goes on: as debuggers stop in a caller."""

    def trace(now: FrameType, _event: str, _about: object) -> None:
        if now is frame:
            sys.settrace(None)
            raise error

    frame.f_trace = trace
    sys.settrace(trace)


def _raise_again(ignored: sys.UnraisableHookArgs) -> None:
    """Raise an interrupt once more that struck where Python ignores errors (`__del__`, callbacks of weak references)."""
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        _raise_in(sys._getframe(1), ignored.exc_type)
    else:
        sys.__unraisablehook__(ignored)
