"""The sweeps of a log beside the rows that tables have of them, piece by piece: neither has to fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.overlays.objects import COLUMNS, Poses
from lidarcli.pipeline.inputs.tables import Pair
from lidarcli.stores.url import Place
from lidarcli.sweeps import Bool, Int64, RawSweeps
from lidarcli.tabular.reading import read_columns, read_pieces
from lidarcli.tabular.schemas import SCHEMAS

_SWEEP_COLUMNS = ("topic", "sweep", "stamp", "pose_x", "pose_y", "pose_yaw")
AGAIN = "write both again with lidarcli track"


@dataclass(frozen=True, slots=True)
class Joined:
    """Some sweeps of one topic that the tables know, and their objects."""

    raw: RawSweeps
    """S sweeps."""
    poses: Poses
    """Of each."""
    objects: pa.RecordBatch
    """N rows."""
    row: Int64
    """(N,) which of the sweeps each belongs to, ascending."""

    def by_frame(self) -> Iterator[tuple[str, Joined]]:
        """The sweeps of each frame, and its name."""
        codes = np.unique(self.raw.frame).tolist()
        for code in codes:
            yield self.raw.frame_ids[code], self if len(codes) == 1 else self._of(self.raw.frame == code)

    def _of(self, mine: Bool) -> Joined:
        """Some of the sweeps."""
        poses = Poses(self.poses.x[mine], self.poses.y[mine], self.poses.yaw[mine])
        its = mine[self.row]
        place = np.cumsum(mine) - 1
        return Joined(self.raw.rows(mine), poses, self.objects.filter(pa.array(its)), place[self.row[its]])


class Tables:
    """The sweeps and objects tables of one log, from which rows are taken as its sweeps come by."""

    def __init__(self, pair: Pair) -> None:
        self._pair = pair
        self.topics: tuple[str, ...] = tuple(
            sorted(
                read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ["topic"])["topic"]
                .unique()
                .to_pylist()
            )
        )
        self._cursors: dict[str, tuple[_Cursor, _Cursor]] = {}
        self._counts: dict[str, int] = {}

    def join(self, log: Log, report: ReadReport) -> Iterator[Joined]:
        """All sweeps of the log that the tables know, in log order within each topic.

        Raises
        ------
        UnreadableError
            A table cannot be read, or is that of another log.
        """
        if not self.topics:
            return
        for block in log.scans(frozenset(self.topics), report):
            first = self._counts.get(block.topic, 0)
            self._counts[block.topic] = first + len(block)
            joined = self._join(block, first)
            if joined is not None:
                yield joined

    def left(self) -> int:
        """Sweeps of the tables that the log had not."""
        return sum(
            1 for topic in self.topics for rows in self._cursor(topic)[0].rest() for _ in range(rows.num_rows)
        )

    def _join(self, block: RawSweeps, first: int) -> Joined | None:
        sweeps, objects = (cursor.until(first + len(block)) for cursor in self._cursor(block.topic))
        index = _ints(sweeps, "sweep") - first
        if not len(index):
            if objects.num_rows:
                raise self._other()
            return None
        raw = block if len(index) == len(block) else block.rows(index)
        stamps = _ints(sweeps, "stamp")
        row = np.searchsorted(index, of := _ints(objects, "sweep") - first)
        strays = (row >= len(index)) | (index[np.minimum(row, len(index) - 1)] != of)
        if (np.diff(index) <= 0).any() or (raw.time_ns != stamps).any() or strays.any():
            raise self._other()
        poses = Poses(
            *(sweeps[name].to_numpy(zero_copy_only=False) for name in ("pose_x", "pose_y", "pose_yaw"))
        )
        return Joined(raw, poses, objects, row)

    def _other(self) -> UnreadableError:
        return UnreadableError(
            f"{self._pair.sweeps}, {self._pair.objects.name}: not the tables of this log, whose sweeps have other stamps; "
            f"{AGAIN}"
        )

    def _cursor(self, topic: str) -> tuple[_Cursor, _Cursor]:
        if topic not in self._cursors:
            self._cursors[topic] = (
                _Cursor(self._pair.sweeps, "sweeps", _SWEEP_COLUMNS, topic),
                _Cursor(self._pair.objects, "objects", COLUMNS, topic),
            )
        return self._cursors[topic]


class _Cursor:
    """The rows of one topic of a table, taken in their order."""

    def __init__(self, path: Place, table: str, columns: tuple[str, ...], topic: str) -> None:
        self._path = path
        self._schema = pa.schema([field for field in SCHEMAS[table] if field.name in columns])
        self._pieces = self._read(table, columns, topic)
        self._rows: pa.RecordBatch | None = None

    def until(self, sweep: int) -> pa.RecordBatch:
        """The rows that are left of the sweeps before this one."""
        taken = []
        while (rows := next(self._pieces, None) if self._rows is None else self._rows) is not None:
            count = int(np.searchsorted(_ints(rows, "sweep"), sweep))
            if count:
                taken.append(rows.slice(0, count))
            self._rows = rows.slice(count) if count < rows.num_rows else None
            if self._rows is not None:
                break
        if len(taken) == 1:
            return taken[0]
        whole = pa.Table.from_batches(taken, self._schema).unify_dictionaries().combine_chunks()
        return whole.to_batches()[0] if taken else pa.RecordBatch.from_pylist([], self._schema)

    def rest(self) -> Iterator[pa.RecordBatch]:
        """All rows that are left."""
        if self._rows is not None:
            yield self._rows
        yield from self._pieces

    def _read(self, table: str, columns: tuple[str, ...], topic: str) -> Iterator[pa.RecordBatch]:
        last = -1
        for piece in read_pieces(self._path, table, SCHEMAS[table], columns):
            mine = pc.equal(piece["topic"], topic)
            rows = piece if mine.true_count == len(mine) else piece.filter(mine)
            if not rows.num_rows:
                if last >= 0:
                    return
                continue
            sweeps = _ints(rows, "sweep")
            if sweeps[0] < last or (np.diff(sweeps) < 0).any():
                raise UnreadableError(
                    f"{self._path}: its rows are not in the order of topic and sweep; {AGAIN}"
                )
            last = int(sweeps[-1])
            yield rows


def _ints(rows: pa.RecordBatch, name: str) -> Int64:
    """A column of whole numbers or stamps [ns]; nulls are -1."""
    column = rows[name]
    if pa.types.is_timestamp(column.type):
        column = column.view(pa.int64())
    values: Int64 = column.fill_null(-1).to_numpy(zero_copy_only=False)
    return values
