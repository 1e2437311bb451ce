"""The entry of the command line, also by `python -m lidarcli`."""

import gc
import os
import sys

from lidarcli.interrupts import wait_for_imports

# numpy would start a thread per processor for linear algebra, of which there is none here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if sys.platform == "linux":
    # Arrow's own allocator takes 40 MB more beside that of the C library, which numpy uses.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
# By default Python looks for garbage again and again while modules are imported.
gc.set_threshold(50_000, 20, 20)


def main() -> None:
    """Run the command line; ctrl-C has its one line also while modules are still being imported."""
    try:
        wait_for_imports()
        from lidarcli.cli import run

        code = run()
    except KeyboardInterrupt:
        sys.stderr.write("lidarcli: interrupted\n")
        code = 130
    _leave(code)


def _leave(code: int) -> None:
    """Exit without taking the interpreter apart first, which is a tenth of a short run; no file is open any more."""
    # With processes there are semaphores that have to be given back.
    if "multiprocessing" in sys.modules:
        sys.exit(code)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
