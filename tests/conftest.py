"""What holds for all tests."""

from __future__ import annotations

import signal


def pytest_configure() -> None:
    """Let ctrl-C work again where it is ignored, as below `nohup` and in many schedulers.

    All processes that tests start would ignore it, too, also those that are to be interrupted.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
