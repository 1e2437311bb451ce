"""What others take for the same work: `references.py WORK LOG`, `references.py WORK TABLE` and `references.py figure`.

All but `figure` print the seconds, the processor seconds and the number of sweeps of their work, without the start of
Python. `iterate` is the loop over the raw messages of an MCAP with the package `mcap`, in file order, `small` that of
`small-mcap`. `segment` is a script that reads with `small-mcap`, cuts sweeps at jumps with numpy and writes nothing.
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

TRACKED = 1000
"""Sweeps whose objects are followed."""
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
    """Points, jumps between neighbours, and the middle and length of what lies between; return the number of sweeps."""
    import numpy as np
    from small_mcap import include_topics, read_message

    count = 0
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
            _ = np.add.reduceat(x, starts) / size, np.add.reduceat(y, starts) / size
            _ = np.hypot(x[starts + size - 1] - x[starts], y[starts + size - 1] - y[starts])
            count += 1
    return count


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
        works = (iterate, small, segment, norfair, hungarian)
        work = {each.__name__: each for each in works}[sys.argv[1]]
        print(work(Path(sys.argv[2])))
