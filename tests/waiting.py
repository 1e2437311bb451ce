"""Waiting for what another process or thread does: as long as it takes, however busy the machine is."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import Any

HANG = 600.0
"""[s] after which a wait counts as a hang. Only a test that fails ever takes so long."""


def wait_until(condition: Callable[[], object], process: Popen[Any] | None = None) -> None:
    """Wait for a condition to hold.

    Raises
    ------
    AssertionError
        It does not hold although `process` has ended, or after `HANG` seconds.
    """
    until = time.monotonic() + HANG
    while True:
        ended = process is not None and process.poll() is not None
        if condition():
            return
        assert not ended, f"the process ended before: exit code {process.returncode if process else None}"
        assert time.monotonic() < until, "it never came"
        time.sleep(0.005)


@contextmanager
def endless(log: Path, *pipes: Path) -> Iterator[None]:
    """Make pipes that bring all of a log but its last bytes: whoever reads one is at work until it is stopped."""
    cats, ends = [], []
    for pipe in pipes:
        pipe.parent.mkdir(exist_ok=True)
        os.mkfifo(pipe)
        # An end that both reads and writes: nobody waits for another one, and none comes to its end.
        ends.append(os.open(pipe, os.O_RDWR))
        cats.append(Popen(["head", "-c", str(log.stat().st_size - 1000), str(log)], stdout=ends[-1]))
    try:
        yield
    finally:
        for cat in cats:
            cat.kill()
            cat.wait()
        for end in ends:
            os.close(end)
        for pipe in pipes:
            pipe.unlink()
