"""The two sources of an overlay: messages that are copied from the log, and the rows of the tables beside its sweeps."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, POSE_TYPES, SCAN_TYPES, Log, Message, ReadReport
from lidarcli.logs.clock import mended
from lidarcli.overlays.files import topic_name
from lidarcli.overlays.objects import COLUMNS, PATH_COLUMNS, Poses, Trajectories
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pose.messages import TRANSFORMS
from lidarcli.ros.messages import ROS2, SCAN, TF, Outgoing, cdr_scans, ros1_scans
from lidarcli.sweeps import Bool, Int64, RawSweeps
from lidarcli.tabular.arrays import are, held, numbers, plain
from lidarcli.tabular.reading import Readable, read_columns, read_pieces, read_schema
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.tabular.stamps import COARSE

WINDOW = 4096
"""Messages that are sorted at a time: more than come of one topic at a stretch."""
_ROS = ("cdr", "ros1")
SLICED = "sliced"
"""Stands for an encoding where sweeps are made of point clouds, which no message of the log holds."""
_OLD_TF = "tf/msg/tfMessage"


def scan_encodings(log: Log) -> dict[str, str]:
    """Return the encoding of each topic of sweeps; a log without an index is read once for it."""
    topics = log.topics()
    if topics is not None:
        return {one.name: one.encoding if one.type in SCAN_TYPES else SLICED for one in topics if one.is_scan}
    return {message.topic: message.encoding for message in log.messages(SCAN_TYPES, ReadReport())}


def is_ros(encoding: str) -> bool:
    """Tell whether messages can be copied; others are written anew."""
    return encoding in _ROS


def transform_topics(log: Log, *, of_ros: bool) -> frozenset[str]:
    """Return the topics of transforms, all or those that can be copied; of a log without an index those that ROS uses."""
    topics = log.topics()
    if topics is None:
        return frozenset({"/tf", "/tf_static"})
    transforming = [topic for topic in topics if topic.type in TRANSFORMS]
    return frozenset(topic.name for topic in transforming if is_ros(topic.encoding) or not of_ros)


def frames_told(log: Log, frames: Collection[str]) -> set[str]:
    """Return those of the frames that transforms of the log name."""
    names = {frame: _spelled(frame) for frame in frames}
    told: set[str] = set()
    for message in log.messages(TRANSFORMS, ReadReport()):
        if not is_ros(message.encoding):
            continue
        told |= {frame for frame, forms in names.items() if any(form in message.data for form in forms)}
        if len(told) == len(names):
            break
    return told


def _spelled(frame: str) -> tuple[bytes, bytes]:
    """Return the bytes of a frame in messages of ROS 1 and of ROS 2; old transforms have no leading slash."""
    name = frame.removeprefix("/").encode()
    return len(name).to_bytes(4, "little") + name, (len(name) + 1).to_bytes(4, "little") + name + b"\0"


class Copies:
    """Copies messages of a log, and counts those that cannot be copied."""

    def __init__(self, topics: Collection[str], is_ros2: bool) -> None:
        """`topics`: those of the sweeps that are wanted; `is_ros2`: whether for ROS 2, else for ROS 1."""
        self._topics = topics
        self._is_ros2 = is_ros2
        self._left_out: Counter[tuple[str, str]] = Counter()

    def of(self, log: Log, report: ReadReport) -> Iterator[Outgoing]:
        """Yield scans, transforms, odometry and poses in log order."""
        for message in log.messages({LASERSCAN, MULTI_ECHO} | POSE_TYPES, report):
            if message.type in SCAN_TYPES and message.topic not in self._topics:
                continue
            if not is_ros(message.encoding):
                if message.type in POSE_TYPES:
                    self._left_out[message.topic, message.type] += 1
                continue
            kind = TF if message.type == _OLD_TF else message.type
            try:
                data = self._data(message, kind)
            # The library raises errors of many kinds for messages that are not what they say.
            except Exception:
                report.refused[message.topic, f"its {kind} cannot be copied: it is damaged"] += 1
                continue
            yield Outgoing(message.topic, kind, message.record_ns, message.record_ns, data)

    def written_anew(self, raw: RawSweeps) -> Iterator[Outgoing]:
        """Yield sweeps of a log that is not of ROS, as LaserScan."""
        data = cdr_scans(raw) if self._is_ros2 else ros1_scans(raw)
        return of_sweeps(topic_name(raw.topic), SCAN, raw, data)

    def notes(self) -> list[str]:
        """Return a line for each topic that was left out."""
        return [
            f"{topic} ({kind}) is not copied: {number:,} messages that are not of ROS"
            for (topic, kind), number in sorted(self._left_out.items())
        ]

    def _data(self, message: Message, kind: str) -> bytes:
        if (message.encoding == "cdr") == self._is_ros2:
            return message.data
        turned = ROS2.ros1_to_cdr if self._is_ros2 else ROS2.cdr_to_ros1
        return bytes(turned(message.data, kind))


def of_sweeps(topic: str, kind: str, raw: RawSweeps, data: Sequence[bytes]) -> Iterator[Outgoing]:
    """Yield a message for each of some sweeps, recorded when the sweep was."""
    times = raw.record_ns.tolist()
    # Header stamps may go back where record times do not, and a file of messages has one order.
    return (Outgoing(topic, kind, at, at, one) for at, one in zip(times, data, strict=True))


def in_order(messages: Iterable[Outgoing]) -> Iterator[Outgoing]:
    """Yield messages by record time, within a window of `WINDOW` messages; equal times keep their order."""
    heap: list[tuple[int, int, Outgoing]] = []
    for number, message in zip(count(), messages, strict=False):
        entry = (message.record_ns, number, message)
        if len(heap) < WINDOW:
            heapq.heappush(heap, entry)
        else:
            yield heapq.heappushpop(heap, entry)[2]
    for _, _, message in sorted(heap):
        yield message


_SWEEP_COLUMNS = ("topic", "sweep", "stamp", "pose_x", "pose_y", "pose_yaw")
AGAIN = "write both again with lidarcli track"


@dataclass(frozen=True, slots=True)
class Joined:
    """Some sweeps of one topic that the tables know, and their objects."""

    raw: RawSweeps
    """S sweeps."""
    poses: Poses
    """S poses."""
    objects: pa.RecordBatch
    """N rows."""
    row: Int64
    """(N,) index of the sweep of each object, ascending."""
    index: Int64
    """(S,) index of each sweep in the log."""

    def by_frame(self) -> Iterator[tuple[str, Joined]]:
        """Yield each frame with its sweeps."""
        codes = np.unique(self.raw.frame).tolist()
        for code in codes:
            yield self.raw.frame_ids[code], self if len(codes) == 1 else self.rows(self.raw.frame == code)

    def rows(self, mine: Bool) -> Joined:
        """Return some of the sweeps."""
        poses = Poses(self.poses.x[mine], self.poses.y[mine], self.poses.yaw[mine])
        its = mine[self.row]
        place = np.cumsum(mine) - 1
        objects = self.objects.take(plain(np.flatnonzero(its)))
        return Joined(self.raw.rows(mine), poses, objects, place[self.row[its]], self.index[mine])


class Tables:
    """The sweeps and objects tables of one log, from which rows are taken as its sweeps come by."""

    def __init__(self, pair: TableSet) -> None:
        self._pair = pair
        told = read_columns(pair.sweeps, "sweeps", SCHEMAS["sweeps"], ["topic", "pose_x"])
        self.topics: tuple[str, ...] = tuple(sorted(told["topic"].unique().to_pylist()))
        self.is_posed = told["pose_x"].null_count < told.num_rows
        """True where some sweep has a pose."""
        self._cursors: dict[str, tuple[Cursor, Cursor]] = {}
        self._counts: dict[str, int] = {}

    def join(self, log: Log, report: ReadReport) -> Iterator[Joined]:
        """Yield all sweeps of the log that the tables have, in log order within each topic.

        Raises
        ------
        UnreadableError
            A table cannot be read, or is that of another log.
        """
        if not self.topics:
            return
        for block in mended(log.scans(frozenset(self.topics), report)):
            first = self._counts.get(block.topic, 0)
            self._counts[block.topic] = first + len(block)
            joined = self._join(block, first)
            if joined is not None:
                yield joined

    def trajectories(self, topic: str) -> Trajectories | None:
        """Return the trajectories of a topic; None where there is no such table."""
        if not self._pair.trajectories.exists():
            return None
        path, schema = self._pair.trajectories, SCHEMAS["trajectories"]
        return Trajectories.of(read_columns(path, "trajectories", schema, PATH_COLUMNS), topic)

    def left(self) -> int:
        """Count the sweeps of the tables that the log does not have."""
        return sum(1 for topic in self.topics for rows in self._cursor(topic)[0].rest() for _ in range(rows.num_rows))

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
        if (np.diff(index) <= 0).any() or (np.abs(raw.time_ns - stamps) >= COARSE).any() or strays.any():
            raise self._other()
        poses = Poses(*(numbers(sweeps[name]) for name in ("pose_x", "pose_y", "pose_yaw")))
        return Joined(raw, poses, objects, row, index + first)

    def _other(self) -> UnreadableError:
        return UnreadableError(
            f"{self._pair.sweeps}, {self._pair.objects.name}: not the tables of this log, whose sweeps have other stamps; "
            f"{AGAIN}"
        )

    def _cursor(self, topic: str) -> tuple[Cursor, Cursor]:
        if topic not in self._cursors:
            self._cursors[topic] = (
                Cursor(self._pair.sweeps, "sweeps", _SWEEP_COLUMNS, topic),
                Cursor(self._pair.objects, "objects", COLUMNS, topic),
            )
        return self._cursors[topic]


class Cursor:
    """The rows of one topic of a table, taken in their order."""

    def __init__(self, path: Readable, table: str, columns: tuple[str, ...], topic: str) -> None:
        self._path = path
        self._schema = read_schema(SCHEMAS[table], columns)
        self._pieces = self._read(table, columns, topic)
        self._rows: pa.RecordBatch | None = None

    def until(self, sweep: int) -> pa.RecordBatch:
        """Return the rows that are left of the sweeps before this one."""
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
        """Yield all rows that are left."""
        if self._rows is not None:
            yield self._rows
        yield from self._pieces

    def _read(self, table: str, columns: tuple[str, ...], topic: str) -> Iterator[pa.RecordBatch]:
        last = -1
        for piece in read_pieces(self._path, table, SCHEMAS[table], columns):
            mine = are(piece["topic"], topic)
            rows = piece if mine.all() else piece.take(plain(np.flatnonzero(mine)))
            if not rows.num_rows:
                if last >= 0:
                    return
                continue
            sweeps = _ints(rows, "sweep")
            if sweeps[0] < last or (np.diff(sweeps) < 0).any():
                raise UnreadableError(f"{self._path}: its rows are not in the order of topic and sweep; {AGAIN}")
            last = int(sweeps[-1])
            yield rows


def _ints(rows: pa.RecordBatch, name: str) -> Int64:
    """Return a column of whole numbers or stamps [ns]; nulls are -1."""
    column = rows[name]
    if pa.types.is_timestamp(column.type):
        column = column.view(pa.int64())
    values, there = held(column)
    return np.where(there, values, -1)
