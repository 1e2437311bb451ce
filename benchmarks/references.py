"""What the others take: `references.py read LOG` or `references.py dbscan|loop LOG`; prints seconds and sweeps.

`read` is the least that any reader of an MCAP must do: read its chunks and decompress them. `dbscan` is scikit-learn's
DBSCAN(0.3, 3) on the points of one sweep after the other, `loop` Definitions 2, 3 and 5 beam by beam in plain Python.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from sklearn.cluster import DBSCAN

from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches

FEW = 300
"""Sweeps for those that are slow."""


def read(log: Path) -> tuple[float, int]:
    """Read the chunks of a zstd log and decompress them."""
    started, size = time.perf_counter(), 0
    decompress = zstandard.ZstdDecompressor().decompress
    with log.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                size += len(decompress(record.data, record.uncompressed_size))
    assert size > 0
    return time.perf_counter() - started, 0


def dbscan(ranges: list[np.ndarray], step: float) -> None:
    """Cluster the points of each sweep."""
    for sweep in ranges:
        angle = np.arange(len(sweep)) * step
        points = np.column_stack([sweep * np.cos(angle), sweep * np.sin(angle)])[np.isfinite(sweep)]
        DBSCAN(eps=0.3, min_samples=3).fit_predict(points)


def loop(ranges: list[np.ndarray], step: float) -> None:
    """Differences, their mean, discontinuities and the runs between them, for each sweep."""
    for sweep in ranges:
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


def main(what: str, log: str) -> None:
    """Measure one of them."""
    if what == "read":
        seconds, sweeps = read(Path(log))
    else:
        with open_log(log) as source:
            options = ReadOptions(end=FEW / 10.0, batch_size=FEW)
            batch = next(iter(read_batches(source, options, ReadReport())))
        ranges, step = list(batch.ranges.astype(float)), float(batch.angle_increment[0])
        started = time.perf_counter()
        {"dbscan": dbscan, "loop": loop}[what](ranges, step)
        seconds, sweeps = time.perf_counter() - started, len(ranges)
    print(seconds, sweeps)


if __name__ == "__main__":
    main(*sys.argv[1:])
