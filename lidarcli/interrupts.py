"""Ctrl-C while modules are imported: it waits until they are whole. Imports next to nothing itself."""

from __future__ import annotations

import signal
from types import FrameType

_IMPORTING = "<frozen importlib"
_AGAIN = 0.01
"""[s]"""


def wait_for_imports() -> None:
    """From now on ctrl-C raises `KeyboardInterrupt` between imports only.

    Python makes a `RuntimeError` of one that strikes while the fields of a class are made, and swallows it in callbacks
    of its own; C libraries end the process where something fails while they are loaded.
    """
    # Where somebody else decides what ctrl-C does (ignored by `nohup`, a host program), nothing changes.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler and hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _interrupt)
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
            return
        frame = frame.f_back
    raise KeyboardInterrupt
