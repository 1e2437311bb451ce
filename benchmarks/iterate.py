"""The yardstick: iterate the raw messages of an MCAP log with the `mcap` package, in file order: `iterate.py LOG`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mcap.reader import make_reader


def main(log: str) -> None:
    """Print the seconds and processor seconds that the loop over all messages took, and their number."""
    with Path(log).open("rb") as file:
        started, cpu = time.perf_counter(), time.process_time()
        count = sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))
        print(time.perf_counter() - started, time.process_time() - cpu, count)


if __name__ == "__main__":
    main(sys.argv[1])
