"""The entry of the command line, also by `python -m lidarcli`."""

import gc
import io
import os
import sys
from contextlib import suppress
from typing import Any

from lidarcli.system.interrupts import Terminated, end_as_terminated, wait_for_imports

# numpy would start a thread per processor for linear algebra, of which there is none here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if sys.platform == "linux":
    # Arrow's own allocator takes 40 MB more beside that of the C library, which numpy uses.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
# By default Python looks for garbage again and again while modules are imported.
gc.set_threshold(100_000, 20, 20)


class _Unheard(io.FileIO):
    """Standard error whose reader may go away: the work, its outputs and its exit code do not depend on who listens."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            return len(data)


def main() -> None:
    """Run the command line; ctrl-C has its one line also while modules are still being imported."""
    if sys.stderr is not None:
        heard = io.BufferedWriter(_Unheard(sys.stderr.fileno(), "w", closefd=False))
        sys.stderr = io.TextIOWrapper(heard, sys.stderr.encoding, sys.stderr.errors, line_buffering=True)
    try:
        wait_for_imports()
        from lidarcli.cli import run

        code = run()
    except Terminated:
        return end_as_terminated()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write("lidarcli: interrupted\n")
        code = 130
    return _leave(code)


def _leave(code: int) -> None:
    """Exit without taking the interpreter apart first, which is a tenth of a short run; no file is open any more."""
    # With processes there are semaphores that have to be given back.
    if "multiprocessing" in sys.modules:
        sys.exit(code)
    for stream in (sys.stdout, sys.stderr):
        # There is none where it was closed; what it refuses has been said.
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
