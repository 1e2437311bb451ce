"""What others take for the same work: `references.py iterate|read|dbscan|loop LOG` and `references.py figure`.

The first four print the seconds, the processor seconds and the number of sweeps of their work, without the start of
Python. `iterate` is the loop over the raw messages of an MCAP with the package `mcap`, in file order. `read` is the least
that any reader of an MCAP must do: read its chunks and decompress them. `dbscan` is scikit-learn's DBSCAN(0.3, 3) on the
points of one sweep after the other, `loop` Definitions 2, 3 and 5 beam by beam in plain Python. `figure` draws as many
points as a sweep has with matplotlib alone, and prints nothing: all of its process counts.

Each function imports what it needs, because nothing else may take time or memory.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lidarcli.sweeps.types import SweepBatch

FEW = 300
"""Sweeps for those that are slow."""


@contextmanager
def clock() -> Iterator[None]:
    """Print the seconds and processor seconds of what is done inside."""
    started, cpu = time.perf_counter(), time.process_time()
    yield
    print(time.perf_counter() - started, time.process_time() - cpu, end=" ")


def iterate(log: Path) -> int:
    """Iterate the raw messages; return their number."""
    from mcap.reader import make_reader

    with log.open("rb") as file, clock():
        return sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))


def read(log: Path) -> int:
    """Read the chunks of a zstd log and decompress them; return the number of messages that its summary tells."""
    import zstandard
    from mcap.records import Chunk, Statistics
    from mcap.stream_reader import StreamReader

    count = 0
    decompress = zstandard.ZstdDecompressor().decompress
    with log.open("rb") as file, clock():
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                decompress(record.data, record.uncompressed_size)
            elif isinstance(record, Statistics):
                count = record.message_count
    return count


def dbscan(log: Path) -> int:
    """Cluster the points of each of the first sweeps; return their number."""
    import numpy as np
    from sklearn.cluster import DBSCAN

    batch = first_sweeps(log)
    with clock():
        for sweep in batch.ranges.astype(float):
            angle = np.arange(len(sweep)) * float(batch.angle_increment[0])
            points = np.column_stack([sweep * np.cos(angle), sweep * np.sin(angle)])[np.isfinite(sweep)]
            DBSCAN(eps=0.3, min_samples=3).fit_predict(points)
    return len(batch)


def loop(log: Path) -> int:
    """Differences, their mean, discontinuities and the runs between them, for each of the first sweeps."""
    batch = first_sweeps(log)
    step = float(batch.angle_increment[0])
    with clock():
        for sweep in batch.ranges:
            r = sweep.tolist()
            s = [r[n] - r[n - 1] for n in range(len(r))]
            known = [abs(d) for d in s if not math.isnan(d)]
            d_th = sum(known) / max(len(known), 1)
            first, objects = 0, []
            for n, d in enumerate(s):
                if not abs(d) <= d_th:
                    x = [r[k] * math.cos(k * step) for k in range(first, n)]
                    y = [r[k] * math.sin(k * step) for k in range(first, n)]
                    objects.append((first, n - 1, sum(x), sum(y)))
                    first = n
    return len(batch)


def first_sweeps(log: Path) -> SweepBatch:
    """The first sweeps of a log, at most `FEW`."""
    from lidarcli.logs import open_log
    from lidarcli.logs.base import ReadReport
    from lidarcli.logs.batches import ReadOptions, read_batches

    with open_log(log) as source:
        options = ReadOptions(end=FEW / 10.0, batch_size=FEW)
        return next(iter(read_batches(source, options, ReadReport())))


def figure() -> None:
    """Draw 360 points of a circle and write them as PNG."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    turn = [math.radians(degrees) for degrees in range(360)]
    pyplot.plot([math.cos(angle) for angle in turn], [math.sin(angle) for angle in turn], ".")
    with tempfile.TemporaryFile() as picture:
        pyplot.savefig(picture, format="png")


if __name__ == "__main__":
    if sys.argv[1] == "figure":
        figure()
    else:
        work = {"iterate": iterate, "read": read, "dbscan": dbscan, "loop": loop}[sys.argv[1]]
        print(work(Path(sys.argv[2])))
