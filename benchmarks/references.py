"""What others take for the same work: `references.py WORK LOG`, `references.py WORK TABLE` and `references.py figure`.

All but `figure` print the seconds, the processor seconds and the number of sweeps of their work, without the start of
Python. `iterate` is the loop over the raw messages of an MCAP with the package `mcap`, in file order, `small` that of
`small-mcap`. `read` is the least that any reader of an MCAP must do: read its chunks and decompress them. `segment` is a
script that reads with `small-mcap`, cuts sweeps at jumps with numpy and writes nothing. `dbscan` is scikit-learn's
DBSCAN(0.3, 3) on the points of one sweep after the other, `loop` Definitions 2, 3 and 5 beam by beam in plain Python.
`norfair` and `hungarian` follow the objects of a table: the package `norfair`, and Kalman filters of `filterpy` that the
Hungarian algorithm of scipy assigns. `figure` draws as many points as a sweep has with matplotlib alone, and prints
nothing: all of its process counts.

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
    import numpy as np
    from numpy.typing import NDArray

    from lidarcli.sweeps.types import SweepBatch

FEW, TRACKED = 300, 1000
"""Sweeps for those that are slow, and of tables."""
NEAR = 0.5
"""How far something moves between two sweeps at most [m]."""


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


def small(log: Path) -> int:
    """Iterate the raw messages with another package; return their number."""
    from small_mcap import read_message

    with log.open("rb") as file, clock():
        return sum(1 for _ in read_message(file))


def segment(log: Path) -> int:
    """Points, jumps between neighbours, and the middle and size of what lies between; return the number of sweeps."""
    import numpy as np
    from small_mcap import include_topics, read_message

    count, kept = 0, 0
    with log.open("rb") as file, clock():
        for _, _, message in read_message(file, should_include=include_topics("/scan")):
            data = memoryview(message.data)[4:]
            at = (12 + int.from_bytes(data[8:12], "little") + 3) // 4 * 4
            first, _, step = np.frombuffer(data, np.float32, 3, at)
            r = np.frombuffer(data, np.float32, int.from_bytes(data[at + 28 : at + 32], "little"), at + 32)
            beams = np.flatnonzero(np.isfinite(r))
            r, angle = r[beams], first + step * beams
            x, y = r * np.cos(angle), r * np.sin(angle)
            jumps = np.hypot(np.diff(x), np.diff(y)) > 0.1 + 0.03 * np.minimum(r[1:], r[:-1])
            starts = np.concatenate(([0], np.flatnonzero(jumps) + 1))
            size = np.diff(starts, append=len(r))
            middle = np.add.reduceat(x, starts) / size, np.add.reduceat(y, starts) / size
            length = np.hypot(x[starts + size - 1] - x[starts], y[starts + size - 1] - y[starts])
            kept += int(np.count_nonzero((size >= 3) & (length < 3.0) & (np.hypot(*middle) < 30.0)))
            count += 1
    return count


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


def seen(table: Path) -> list[NDArray[np.float64]]:
    """Middles of the objects of the first sweeps of a table, [n, 2] for each sweep, m."""
    import numpy as np
    import pyarrow.parquet as pq

    rows = next(pq.ParquetFile(table).iter_batches(20_000, columns=["sweep", "x", "y"]))
    sweep, *middle = (column.to_numpy() for column in rows.columns)
    return np.split(np.column_stack(middle), np.flatnonzero(np.diff(sweep)) + 1)[:TRACKED]


def norfair(table: Path) -> int:
    """Follow objects with norfair; return the number of sweeps."""
    from norfair import Detection, Tracker

    sweeps = seen(table)
    tracker = Tracker(distance_function="euclidean", distance_threshold=NEAR)
    with clock():
        for middles in sweeps:
            tracker.update([Detection(middle[None]) for middle in middles])
    return len(sweeps)


def hungarian(table: Path) -> int:
    """Follow objects with filters of constant velocity, one for each; return the number of sweeps."""
    import numpy as np
    from filterpy.kalman import KalmanFilter
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    sweeps = seen(table)
    filters: list[KalmanFilter] = []
    missed: list[int] = []
    with clock():
        for middles in sweeps:
            for one in filters:
                one.predict()
            cost = cdist([one.x[:2, 0] for one in filters] or np.empty((0, 2)), middles)
            pairs = {k: n for k, n in zip(*linear_sum_assignment(cost), strict=True) if cost[k, n] < NEAR}
            for k, n in pairs.items():
                filters[k].update(middles[n])
            kept = [k for k in range(len(filters)) if k in pairs or missed[k] < 5]
            filters, missed = [filters[k] for k in kept], [0 if k in pairs else missed[k] + 1 for k in kept]
            for n in set(range(len(middles))) - set(pairs.values()):
                new = KalmanFilter(4, 2)
                new.x[:2, 0] = middles[n]
                new.F[[0, 1], [2, 3]] = 0.1
                new.H[[0, 1], [0, 1]] = 1.0
                filters.append(new)
                missed.append(0)
    return len(sweeps)


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
        works = (iterate, small, read, segment, dbscan, loop, norfair, hungarian)
        work = {each.__name__: each for each in works}[sys.argv[1]]
        print(work(Path(sys.argv[2])))
