"""Point clouds as files: PLY and PCD for viewers, Parquet for programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from lidarcli.formalism.detection import SETS
from lidarcli.options.choices import NS
from lidarcli.sweeps.types import Bool, Float64, Int8, Int32, Int64, record
from lidarcli.tabular.columns import codes, constant, floats, in_unit, plain, restamped
from lidarcli.tabular.schemas import CLOUD, STAMP, TEXT
from lidarcli.tabular.writing import ParquetSink

_MAX_POINTS = 10**15 - 1


@record
class CloudPoints:
    """N points of one topic of one log, in the world frame. Writers may keep the arrays."""

    log: str
    topic: str
    sweep: Int64
    """(N,) index of the sweep within its topic, from 0."""
    beam: Int32
    """(N,) index of the beam in its sweep, from 0."""
    stamp_ns: Int64
    """(N,) time of the beam [ns]."""
    x: Float64
    """(N,) world frame [m]."""
    y: Float64
    set: Int8 | None = None
    """(N,) code into `SETS`, negative where it is unknown; None where it is unknown everywhere."""


class _Binary:
    """A header with the number of points, which is known only at the end, and their coordinates."""

    KIND: np.dtype[Any]
    HEADER: str

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._count = 0
        file.write(self._head())

    def write(self, points: CloudPoints) -> None:
        """Take points."""
        xyz = np.zeros((len(points.x), 3), self.KIND)
        xyz[:, 0], xyz[:, 1] = points.x, points.y
        self._file.write(xyz.tobytes())
        self._count += len(points.x)

    def finish(self, metadata: Mapping[bytes, bytes] | None = None) -> None:
        """Put the number of points into the header."""
        end = self._file.tell()
        self._file.seek(0)
        self._file.write(self._head())
        self._file.seek(end)

    def abandon(self) -> None:
        """Do nothing: the writer holds nothing."""

    def _head(self) -> bytes:
        """Return the header, always of the same length: a comment fills up the number, as readers split at every blank."""
        room = self.HEADER.count("{count}") * (len(str(_MAX_POINTS)) - len(str(self._count)))
        return self.HEADER.format(count=self._count, note="." * room).encode()


class PlyWriter(_Binary):
    """Binary PLY 1.0, little-endian: x, y and z = 0 in double precision [m], 24 bytes per point.

    Parameters
    ----------
    file : opened to write bytes (`w+b`), able to seek; the caller closes it
    """

    KIND = np.dtype("<f8")
    HEADER = (
        "ply\nformat binary_little_endian 1.0\ncomment lidarcli, metres {note}\nelement vertex {count}\n"
        "property double x\nproperty double y\nproperty double z\nend_header\n"
    )


class PcdWriter(_Binary):
    """Binary PCD 0.7: x, y and z = 0 in single precision [m], 12 bytes per point; `file` as of `PlyWriter`.

    PCL's points have no other precision. It rounds to 0.5 mm within 16 km of the origin, and to 2 cm at 500 km: where
    world coordinates are those of a map projection, take PLY.
    """

    KIND = np.dtype("<f4")
    HEADER = (
        "# .PCD v0.7 - Point Cloud Data file format\n# lidarcli, metres {note}\nVERSION 0.7\nFIELDS x y z\n"
        "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        "POINTS {count}\nDATA binary\n"
    )


class ParquetWriter:
    """The cloud table (docs/tables.md), one row per point, in the order in which they come.

    Parameters
    ----------
    file : opened to write bytes; the caller closes it
    stamps : unit of the stamps, as of `in_unit`
    """

    def __init__(self, file: BinaryIO, stamps: str = NS) -> None:
        self._stamps = stamps
        self._sink = ParquetSink(file, in_unit(CLOUD, stamps))

    def write(self, points: CloudPoints) -> None:
        """Take points; they wait until there are enough for a row group. May raise what befell the last one."""
        count = len(points.x)
        columns = {
            "log": constant(points.log, count),
            "topic": constant(points.topic, count),
            "sweep": plain(points.sweep),
            "beam": plain(points.beam),
            "stamp": plain(points.stamp_ns, STAMP),
            "x": floats(points.x),
            "y": floats(points.y),
            "set": pa.nulls(count, TEXT) if points.set is None else codes(points.set, SETS),
        }
        rows = pa.RecordBatch.from_arrays([columns[name] for name in CLOUD.names], schema=CLOUD)
        self._sink.write(restamped(rows, self._stamps))

    def finish(self, metadata: Mapping[bytes, bytes] | None = None) -> None:
        """Write what waits, the schema and its metadata."""
        self._sink.finish(dict(metadata or {}))

    def abandon(self) -> None:
        """Let go of the file, and of the thread that writes it, without making it whole."""
        self._sink.abandon()


CloudWriter = PlyWriter | PcdWriter | ParquetWriter
"""Takes points as they come and holds only a bounded number of them; errors of the file are its caller's."""


class VoxelFilter:
    """Keeps the first point in each square cell of a grid, over all calls, however the points are divided among them.

    It takes 8 bytes for each cell that ever had a point, twice that while it sorts: 10,000 m² in cells of 5 cm are 4
    million cells, 32 MB, if there is a point in every one of them.

    Parameters
    ----------
    size : side of a cell [m], above 0; the corner of one lies in the origin

    Raises
    ------
    ValueError
        The size is not above 0, or not finite.

    >>> grid = VoxelFilter(0.5)
    >>> grid.keep(np.array([0.1, 0.4, 0.6]), np.zeros(3)).tolist()
    [True, False, True]
    >>> grid.keep(np.array([0.2, 1.0]), np.zeros(2)).tolist()
    [False, True]
    """

    def __init__(self, size: float) -> None:
        if not 0 < size < np.inf:
            raise ValueError(f"the side of a cell is {size}, not above 0 and finite")
        self._size = size
        self._known: list[Int64] = []

    @property
    def cells(self) -> int:
        """Number of cells in which there was a point."""
        return sum(map(len, self._known))

    def keep(self, x: Float64, y: Float64) -> Bool:
        """Return (N,) True for points [m] that are the first in their cells.

        Points that are not finite or more than 2^31 cells from the origin never are.
        """
        with np.errstate(over="ignore"):
            column, row = np.floor(x / self._size), np.floor(y / self._size)
        fits = (np.abs(column) < 2.0**31) & (np.abs(row) < 2.0**31)
        at = np.flatnonzero(fits)
        key = (column[at].astype(np.int64) << 32) + row[at].astype(np.int64)
        # With its index `unique` sorts stably: the first of equal keys.
        key, first = np.unique(key, return_index=True)
        for known in self._known:
            new = known[np.minimum(np.searchsorted(known, key), len(known) - 1)] != key
            key, first = key[new], first[new]
        kept = np.zeros(len(x), np.bool_)
        kept[at[first]] = True
        # Runs of sorted keys double in length, so that each key is sorted again a few times only.
        while len(key) and self._known and len(self._known[-1]) < 2 * len(key):
            key = np.concatenate((self._known.pop(), key))
            # Two sorted runs: timsort, or radix sort, is done with them in one pass.
            key.sort(kind="stable")
        if len(key):
            self._known.append(key)
        return kept
