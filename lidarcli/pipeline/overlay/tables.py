"""Rows of tables that come with the sweeps of a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import Checksum
from lidarcli.logs.clock import mended
from lidarcli.overlays.objects import COLUMNS, PATH_COLUMNS, PathPoses, PathRows
from lidarcli.pipeline.inputs.tables import TableSet, other_recording
from lidarcli.sweeps.types import Bool, Int64, RawSweeps
from lidarcli.tabular.columns import COARSE, integers, numbers, plain
from lidarcli.tabular.reading import AGAIN, TopicRows, read_columns
from lidarcli.tabular.schemas import SCHEMAS


@dataclass(frozen=True, slots=True)
class TabledSweeps:
    """Some sweeps of one topic that the tables know, and their objects."""

    raw: RawSweeps
    """S sweeps."""
    poses: PathPoses
    """S poses."""
    objects: pa.RecordBatch
    """N rows."""
    row: Int64
    """(N,) index of the sweep of each object, ascending."""
    index: Int64
    """(S,) index of each sweep in the log."""

    def by_frame(self) -> Iterator[tuple[str, TabledSweeps]]:
        """Yield each frame with its sweeps."""
        codes = np.unique(self.raw.frame).tolist()
        for code in codes:
            yield self.raw.frame_ids[code], self if len(codes) == 1 else self.rows(self.raw.frame == code)

    def rows(self, own: Bool) -> TabledSweeps:
        """Return some of the sweeps."""
        poses = PathPoses(self.poses.x[own], self.poses.y[own], self.poses.yaw[own])
        its = own[self.row]
        place = np.cumsum(own) - 1
        objects = self.objects.take(plain(np.flatnonzero(its)))
        return TabledSweeps(self.raw.rows(own), poses, objects, place[self.row[its]], self.index[own])


class OverlayTables:
    """The sweeps and objects tables of one log, from which rows are taken as its sweeps come by."""

    def __init__(self, tables: TableSet) -> None:
        self._tables = tables
        columns = read_columns(tables.sweeps, "sweeps", SCHEMAS["sweeps"], ["topic", "pose_x"])
        self.topics: tuple[str, ...] = tuple(sorted(columns["topic"].unique().to_pylist()))
        self.is_posed = columns["pose_x"].null_count < columns.num_rows
        """True where some sweep has a pose."""
        self._cursors: dict[str, tuple[TopicRows, TopicRows]] = {}
        self._met: dict[str, Checksum] = {}
        self._trajectories: dict[str, PathRows] = {}

    def join(self, log: Log, report: ReadReport) -> Iterator[TabledSweeps]:
        """Yield all sweeps of the log that the tables have, in log order within each topic.

        `UnreadableError`: a table cannot be read, or is that of another log.
        """
        if not self.topics:
            return
        for block in mended(log.scans(frozenset(self.topics), report)):
            met = self._met.setdefault(block.topic, Checksum())
            joined = self._join(block, met.count)
            met.add(block)
            if joined is not None:
                yield joined

    def trajectories(self, topic: str) -> PathRows | None:
        """Return the trajectories of a topic; None where there is no such table."""
        path, schema = self._tables.trajectories, SCHEMAS["trajectories"]
        if topic not in self._trajectories and path.exists():
            self._trajectories[topic] = PathRows.of(read_columns(path, "trajectories", schema, PATH_COLUMNS), topic)
        return self._trajectories.get(topic)

    def notes(self) -> list[str]:
        """Return what a user should know of them."""
        return other_recording(self._tables, {topic: str(met) for topic, met in self._met.items()})

    def left(self) -> int:
        """Count the sweeps of the tables that the log does not have."""
        return sum(1 for topic in self.topics for rows in self._cursor(topic)[0].rest() for _ in range(rows.num_rows))

    def _join(self, block: RawSweeps, first: int) -> TabledSweeps | None:
        sweeps, objects = (cursor.until(first + len(block)) for cursor in self._cursor(block.topic))
        index = integers(sweeps, "sweep") - first
        if not len(index) and not objects.num_rows:
            return None
        raw = block if len(index) == len(block) else block.rows(index)
        stamps = integers(sweeps, "stamp")
        row = np.searchsorted(index, of := integers(objects, "sweep") - first)
        strays = not np.isin(of, index).all()
        if strays or (np.diff(index) <= 0).any() or (np.abs(raw.time_ns - stamps) >= COARSE).any():
            raise UnreadableError(
                f"{self._tables.sweeps}, {self._tables.objects.name}: not the tables of this log, whose sweeps have other "
                f"stamps; {AGAIN}"
            )
        poses = PathPoses(*(numbers(sweeps[name]) for name in ("pose_x", "pose_y", "pose_yaw")))
        return TabledSweeps(raw, poses, objects, row, index + first)

    def _cursor(self, topic: str) -> tuple[TopicRows, TopicRows]:
        if topic not in self._cursors:
            columns = ("topic", "sweep", "stamp", "pose_x", "pose_y", "pose_yaw")
            sweeps = TopicRows(self._tables.sweeps, "sweeps", columns, topic)
            self._cursors[topic] = sweeps, TopicRows(self._tables.objects, "objects", COLUMNS, topic)
        return self._cursors[topic]
