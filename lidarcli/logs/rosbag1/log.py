"""ROS 1 bags (format 2.0): whole or damaged, closed or not, uncompressed, bz2 or lz4.

A bag is read record by record, in one pass; damage is reported and stepped over.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import MAX_MESSAGE, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.laserscan import Gather
from lidarcli.logs.rosbag1.records import (
    CODECS,
    MAGIC,
    MAX_HEADER,
    OVERLAP,
    ChunkFeed,
    Connection,
    Feed,
    FileFeed,
    Index,
    Judged,
    Op,
    Record,
    Search,
    State,
    Walk,
    connection_of,
    judge,
    parse,
    read_at,
    read_index,
    walk,
)
from lidarcli.logs.unpacking import Unpacking, too_much
from lidarcli.sweeps import Int64, RawSweeps, UInt8

WINDOW = 1 << 20
"""Bytes read at a time."""
MAX_WINDOW = 4 << 20
"""Most bytes read at once to have a whole chunk in one piece."""
BEHIND = 1024
"""Bytes read beyond a chunk, so that the record behind it proves its end."""


@dataclass(frozen=True, slots=True)
class MessageBlock:
    """Messages in a buffer, by column, and the connections that were declared among them."""

    data: UInt8
    connection: Int64
    time_ns: Int64
    starts: Int64
    """Start of the data of each message [bytes]."""
    lengths: Int64
    connections: list[tuple[Record, bytes]]
    """Connection records and their data."""


class Stop(Enum):
    """Reason for the end of a run."""

    END = "the feed ended with a whole record"
    CUT = "the feed ended inside a record"
    OTHER = "a record of another kind stands here"
    LARGE = "a record too large for memory stands here"


class RecordRun:
    """Reads records until the feed ends or, where `others_end` says so, until a record of another kind."""

    def __init__(
        self,
        feed: Feed,
        search: Search,
        damaged: Callable[[int, str], None],
        *,
        others_end: bool,
        lost: bool = False,
        expected: int = WINDOW,
    ) -> None:
        """`damaged` is told the position in the feed and the cause; with `lost` a record must be found first.

        `expected` is how long the run should be, if its chunk is right about that: it is read in one piece then.
        """
        self.stop = Stop.END
        self.at = 0
        """Position in the feed where the run stopped, or how far it has come."""
        self._feed, self._search, self._damaged, self._others_end = feed, search, damaged, others_end
        self._data = b""
        self._base = 0
        """Position of the window in the feed."""
        self._at = 0
        """Position of the next record in the window."""
        self._ended = self._done = False
        self._lost: int | None = 0 if lost else None
        self._window = min(max(expected, OVERLAP), MAX_WINDOW) + BEHIND

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield the messages, window by window."""
        self._slide(0)
        while not self._done and (self._lost is None or self._find()):
            walked = walk(self._data, self._at)
            yield from self._step(walked, judge(self._data, walked))

    def _step(self, walked: Walk, judged: Judged) -> Iterator[MessageBlock]:
        """Yield the messages walked in a window, and go to where the next step begins."""
        whole = judged.good == len(walked.starts)
        self._at = walked.stop if whole else int(walked.starts[judged.good])
        record = parse(self._data, self._at) if whole else judged.foreign
        left = len(self._data) - self._at
        if record is not None and self._others_end and record.op not in (Op.MESSAGE, Op.CONNECTION):
            yield self._block(walked, judged)
            self._finish(Stop.OTHER, self._at)
        elif not whole or (record is None and left >= 8 + MAX_HEADER):
            yield self._broken(walked, judged)
        elif record is not None and record.end - self._at > MAX_MESSAGE:
            yield self._block(walked, judged)
            yield from self._large(record)
        elif not self._ended:
            # The last whole record waits: only a sane record behind it proves its length.
            held = max(0, judged.good - 1)
            yield self._block(walked, judged, rows=held)
            keep = int(walked.starts[held]) if judged.good else self._at
            self._slide(keep, 0 if record is None else record.end - self._at)
        else:
            yield self._block(walked, judged)
            yield from self._end(record)

    def _broken(self, walked: Walk, judged: Judged) -> MessageBlock:
        """Return the messages before a broken record, which the last of them may have swallowed."""
        cut = self._end_of_last(walked, judged.good, self._at)
        block = self._block(walked, judged, cut=cut)
        if cut is None:
            self._lose(self._at + 1)
        else:
            self._at = cut
        return block

    def _large(self, record: Record) -> Iterator[MessageBlock]:
        """Pass over a record too large for memory; if it ends behind the feed, its length is wrong."""
        if record.end - len(self._data) <= self._feed.left:
            if self._others_end:
                self._finish(Stop.LARGE, self._at)
            else:
                self._skip(record)
            return
        after = self._search.next(self._data, record.data_start)
        if after is None:
            self._lose(record.data_start)
        else:
            yield from self._shorten(record, after)

    def _end(self, record: Record | None) -> Iterator[MessageBlock]:
        """Yield what can be read at the end of the feed: no whole record is left, but others may stand in it."""
        at = self._at
        if at == len(self._data):
            self._finish(Stop.END, at)
            return
        after = self._search.next(self._data, at + 1 if record is None else record.data_start)
        if after is None:
            self._finish(Stop.CUT, at)
        elif record is None:
            self._damaged(self._base + at, f"{after - at:,} bytes are broken and were skipped")
            self._at = after
        else:
            yield from self._shorten(record, after)

    def _shorten(self, record: Record, end: int) -> Iterator[MessageBlock]:
        """Report a record whose declared length is too large; it ends where the next one begins."""
        self._damaged(self._base + record.start, "a record has a wrong length")
        self._at = end
        if record.op == Op.MESSAGE:
            yield _single(self._data, record, end)

    def _slide(self, keep: int, need: int = 0) -> None:
        """Drop what stands before `keep` and read on."""
        more = max(self._window, need)
        self._window = WINDOW
        new = self._feed.read(more)
        self._ended = len(new) < more
        self._base += keep
        self.at = self._base
        self._data = self._data[keep:] + new
        self._at = 0

    def _skip(self, record: Record) -> None:
        """Read past a record that is too large for memory."""
        self._damaged(self._base + record.start, f"a message of {record.data_length:,} bytes was not read")
        missing = record.end - len(self._data)
        self._base += record.end
        self._data = b""
        while missing > 0 and (data := self._feed.read(min(missing, WINDOW))):
            missing -= len(data)
        self._slide(0)

    def _finish(self, stop: Stop, at: int) -> None:
        self.stop, self.at, self._done = stop, self._base + at, True

    def _lose(self, search_from: int) -> None:
        """A broken record stands here: the next one is looked for from `search_from` on."""
        self._lost = self._base + self._at
        self._at = search_from

    def _find(self) -> bool:
        """Go to the next plausible record; False where there is none up to the feed's end."""
        lost = self._lost or 0
        while (found := self._search.next(self._data, self._at)) is None:
            if self._ended or self._search.budget <= 0:
                self._finish(Stop.CUT, lost - self._base)
                return False
            self._slide(max(self._at, len(self._data) - OVERLAP))
        self._damaged(lost, f"{self._base + found - lost:,} bytes are broken and were skipped")
        self._lost, self._at = None, found
        return True

    def _end_of_last(self, walked: Walk, good: int, at: int) -> int | None:
        """Return the real end of the record before the broken one at `at`, if it swallowed others."""
        if not good:
            return None
        start = int(walked.starts[good - 1] + 8 + walked.header_lengths[good - 1])
        inside = self._search.next(self._data, start)
        if inside is None or inside >= at:
            return None
        self._damaged(self._base + inside, "a record has a wrong length")
        return inside

    def _block(self, walked: Walk, judged: Judged, cut: int | None = None, rows: int | None = None) -> MessageBlock:
        """Return the first rows of a walk; `cut` is where the last of them really ends."""
        rows = judged.good if rows is None else rows
        starts = walked.starts[:rows] + 8 + walked.header_lengths[:rows]
        lengths = walked.data_lengths[:rows].copy()
        if cut is not None:
            lengths[-1] = cut - starts[-1]
        connections = [
            (record, self._data[starts[row] : starts[row] + lengths[row]]) for row, record in judged.others if row < rows
        ]
        data = np.frombuffer(self._data, np.uint8)
        return MessageBlock(data, judged.connection[:rows], judged.time_ns[:rows], starts, lengths, connections)


def _single(data: bytes, record: Record, end: int) -> MessageBlock:
    """Return one message of wrong length: it ends where the next record begins."""
    seconds, nanoseconds = np.frombuffer(record.value(b"time"), "<u4").tolist()
    return MessageBlock(
        np.frombuffer(data, np.uint8),
        np.array([record.number(b"conn")]),
        np.array([seconds * 1_000_000_000 + nanoseconds]),
        np.array([record.data_start]),
        np.array([end - record.data_start]),
        [],
    )


AHEAD = 1 << 16
"""Bytes read at once where small records may follow one another."""

Wanted = Callable[[Connection], bool]
Damaged = Callable[[str, str], None]


class Pass:
    """Reads a bag from its first record to its last. Nothing but speed depends on any index."""

    def __init__(self, file: BinaryIO, size: int, index: Index, wanted: Wanted, damaged: Damaged) -> None:
        """`damaged` takes place and cause. Chunks that surely hold nothing `wanted` are skipped."""
        self.connections = dict(index.connections)
        self.counts: Counter[int] = Counter()
        """Messages seen, by connection."""
        self.codecs: dict[str, None] = {}
        self.at = len(MAGIC)
        self._file, self._size, self._index, self._wanted, self._damaged = file, size, index, wanted, damaged
        self._search = Search()
        self._last: tuple[int, Record | None] = (-1, None)
        self._ahead_at, self._ahead = 0, b""
        self._cut = ""
        self._unpacking = Unpacking()

    @property
    def read(self) -> int:
        """Number of wanted messages read so far."""
        return sum(count for connection, count in self.counts.items() if self._is_wanted(connection))

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield every message of the bag, in file order."""
        while self.at < self._size and not self._cut:
            record = self._record(self.at)
            if record is None or record.op in (Op.MESSAGE, Op.CONNECTION):
                yield from self._run(self.at, lost=record is None)
            elif record.op == Op.CHUNK:
                yield from self._chunk(record)
            else:
                yield from self._pass_over(record, self._end_of(record))
        self._conclude()

    def _record(self, at: int) -> Record | None:
        if self._last[0] != at:
            offset = at - self._ahead_at
            if not 0 <= offset <= len(self._ahead) - 8 - MAX_HEADER:
                self._ahead_at, self._ahead, offset = at, read_at(self._file, at, AHEAD), 0
            self._last = (at, parse(self._ahead, offset, at - offset))
        return self._last[1]

    def _sane(self, at: int) -> bool:
        """Return True if the file ends at a position, or another record begins there."""
        return at == self._size or (at < self._size and self._record(at) is not None)

    def _end_of(self, record: Record) -> int:
        """Return the end of a record. Some index records declare 20 bytes per entry and have the usual 12."""
        if record.op == Op.INDEX:
            by_count = record.data_start + 12 * record.number(b"count")
            if by_count != record.end and self._sane(by_count):
                return by_count
        return record.end

    def _pass_over(self, record: Record, end: int) -> Iterator[MessageBlock]:
        """Go on behind a record that needs no reading, or search where its length cannot be right."""
        if self._sane(end):
            self.at = end
        elif end < self._size or self._index.state is State.GOOD:
            yield from self._run(record.data_start, lost=True)
        else:
            self._cut_off(record.start, "inside a record that holds no messages")

    def _run(self, start: int, lost: bool = False, expected: int = WINDOW) -> Iterator[MessageBlock]:
        """Yield messages and connections that stand in the file itself: those of an uncompressed chunk, too."""
        feed = FileFeed(self._file, start, self._size)
        run = RecordRun(
            feed,
            self._search,
            lambda at, cause: self._damaged(f"byte {start + at}", cause),
            others_end=True,
            lost=lost,
            expected=expected,
        )
        for block in run.blocks():
            yield self._take(block)
            self.at = start + run.at
        self.at = start + run.at
        if run.stop is Stop.CUT:
            self._cut_off(self.at, "inside a message")
        elif run.stop is Stop.LARGE:
            yield from self._large(self._record(self.at))

    def _large(self, record: Record | None) -> Iterator[MessageBlock]:
        """Pass over a message too large for memory, such as a dense point cloud: a LaserScan cannot be."""
        if record is None:
            return
        if record.op == Op.MESSAGE and self._is_wanted(record.number(b"conn")) and self._sane(record.end):
            self._damaged(f"byte {record.start}", f"a message of {record.data_length:,} bytes was not read")
        yield from self._pass_over(record, record.end)

    def _chunk(self, record: Record) -> Iterator[MessageBlock]:
        codec = self._codec(record)
        self.codecs[codec] = None
        behind = self._unwanted(record)
        if behind is not None:
            self.at = behind
        elif codec == "none":
            # Its records stand in the file as any others: whatever its length says, none is lost.
            self.at = record.data_start
            if self._record(self.at) is not None:
                yield from self._run(self.at, expected=record.data_length)
        elif codec in CODECS:
            yield from self._unpack(record, codec)
        else:
            self._damaged(f"chunk at byte {record.start}", f"unknown compression '{codec}': the chunk is lost")
            yield from self._pass_over(record, record.end)

    def _codec(self, record: Record) -> str:
        """Return the chunk's compression; where its name is broken, what its first bytes look like."""
        codec = record.value(b"compression").decode("utf-8", "replace")[:40]
        if codec != "none" and codec not in CODECS:
            head = read_at(self._file, record.data_start, 4)
            if self._record(record.data_start) is not None:
                return "none"
            return next((known for known, magic in CODECS.items() if head.startswith(magic)), codec)
        return codec

    def _unpack(self, record: Record, codec: str) -> Iterator[MessageBlock]:
        """Yield messages of a compressed chunk."""
        place = f"chunk at byte {record.start}"
        sane = self._sane(record.end)
        size = record.number(b"size")
        packed = min(record.end, self._size) - record.data_start
        room = self._unpacking.room(packed)
        feed = ChunkFeed(self._file, record.data_start, record.end if sane else self._size, codec, min(size, room))
        run = RecordRun(feed, self._search, lambda _, cause: self._damaged(place, cause), others_end=False, expected=size)
        before = self.counts.total()
        for block in run.blocks():
            yield self._take(block)
        feed.drain()
        read = self.counts.total() - before
        self._unpacking.used(feed.unpacked)
        if size > room and feed.unpacked >= room:
            feed.error = too_much(size, packed)
        if record.end > self._size and not feed.finished:
            self._cut_off(record.start, f"inside a {codec} chunk, {read} messages of which were read")
            return
        if feed.error or run.stop is not Stop.END:
            cause = feed.error or "its last record is not whole"
            self._damaged(place, f"{cause}: {read} messages of it were read, the rest is lost")
        if sane:
            self.at = record.end
        elif feed.finished:
            self.at = feed.stop
        else:
            yield from self._run(record.data_start, lost=True)

    def _unwanted(self, record: Record) -> int | None:
        """Return the position behind a chunk without wanted messages, if both indexes agree on that; else None."""
        counts = self._index.chunk_counts(record.start) if self._index.state is State.GOOD else None
        if counts is None or any(self._is_wanted(connection) for connection in counts):
            return None
        found: dict[int, int] = {}
        at = record.end
        while at < self._size and (entry := self._record(at)) is not None and entry.op == Op.INDEX:
            found[entry.number(b"conn")] = entry.number(b"count")
            at = self._end_of(entry)
        if found != counts or not self._sane(at):
            return None
        return at

    def _take(self, block: MessageBlock) -> MessageBlock:
        """Note connections and count messages."""
        for record, data in block.connections:
            connection = connection_of(record, data)
            if connection.type or record.number(b"conn") not in self.connections:
                self.connections[record.number(b"conn")] = connection
        for connection_id, count in zip(*np.unique(block.connection, return_counts=True), strict=True):
            if connection_id >= 0:
                self.counts[int(connection_id)] += int(count)
        return block

    def _is_wanted(self, connection: int) -> bool:
        """Return True for wanted or unknown connections."""
        known = self.connections.get(connection)
        return known is None or self._wanted(known)

    def _cut_off(self, at: int, where: str) -> None:
        self._cut = f"cut off {where}: the {self._size - at:,} bytes from byte {at} on hold no whole record"
        self.at = self._size

    def _conclude(self) -> None:
        """Report the losses of the whole bag, as far as they are known."""
        read = f"{self.read:,} messages were read"
        if self._cut:
            self._damaged(f"byte {self._size} (end of file)", f"{self._cut}; {read}")
        elif self._index.state is not State.GOOD:
            self._damaged("index", f"{self._index.state.value}; all {read} without it")
        else:
            promised = {c: n for c, n in self._index.counts().items() if self._is_wanted(c)}
            missing = sum(max(0, n - self.counts[c]) for c, n in promised.items())
            if missing:
                self._damaged("index", f"{missing:,} of {sum(promised.values()):,} messages are lost")
        unknown = sum(n for c, n in self.counts.items() if c not in self.connections)
        if unknown:
            self._damaged("connections", f"{unknown:,} messages whose topic is not recorded were left out")


OLD_MAGIC = b"#ROS"
"""Every bag begins so; format 2.0 goes on with its own magic."""
DENSE = 128
"""Fewest messages of one topic in one buffer that are decoded in place instead of gathered."""
COPY = 1 << 20


class Rosbag1Log:
    """A ROS 1 bag of a path or of a stream; a stream is copied to a temporary file, whose name nobody sees."""

    format = "ros1 bag"
    position = 0

    def __init__(self, source: str | Path | BinaryIO, options: OpenOptions | None = None) -> None:
        self._echo = (options or OpenOptions()).echo
        self.path = path = str(source) if isinstance(source, str | Path) else "-"
        self._file = _open(path, source)
        try:
            with unreadable(path):
                self.size: int | None = self._file.seek(0, 2)
                _check_magic(path, read_at(self._file, 0, 64))
                self._index = read_index(self._file, self.size)
        except UnreadableError:
            self._file.close()
            raise
        if self._index.encryptor:
            self._file.close()
            raise UnreadableError(
                f"{path}: the bag is encrypted ({self._index.encryptor}); write a plain one with 'rosbag decrypt'"
            )
        self._scanned: list[Topic] | None = None
        self._codecs: dict[str, None] = {}

    @property
    def compression(self) -> str:
        """Compression of the chunks seen so far, or of the first one."""
        if not self._codecs:
            self._codecs.update(_first_codec(self._file))
        return "+".join(sorted(self._codecs)) or "none"

    def topics(self) -> list[Topic]:
        """Return all topics: from the index, or where there is none by reading the whole bag once."""
        if self._index.state is State.GOOD:
            return _topics(self._index.connections, self._index.counts())
        if self._scanned is None:
            reading = self._pass(lambda _: True, ReadReport())
            for _ in reading.blocks():
                pass
            self._scanned = _topics(reading.connections, reading.counts)
        return self._scanned

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic."""

        def wanted(connection: Connection) -> bool:
            return bool(connection.read_as) and (topics is None or connection.topic in topics)

        gathers: dict[Connection, Gather] = {}
        reading = self._pass(wanted, report)
        for block in reading.blocks():
            for connections in _by_topic(block, reading, wanted):
                first = reading.connections[connections[0]]
                gather = gathers.setdefault(first, Gather(first.topic, first.read_as, "ros1", report, self._echo))
                yield from _decode(block, np.flatnonzero(np.isin(block.connection, connections)), gather)
            self._progress(reading)
        for gather in gathers.values():
            yield from gather.flush()
        self._progress(reading)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order."""
        reading = self._pass(lambda connection: connection.type in types, report)
        for block in reading.blocks():
            known = {c: reading.connections[c] for c in np.unique(block.connection).tolist() if c in reading.connections}
            rows = np.isin(block.connection, [c for c, it in known.items() if it.type in types])
            for row in np.flatnonzero(rows).tolist():
                connection = known[int(block.connection[row])]
                start = int(block.starts[row])
                data = block.data[start : start + int(block.lengths[row])].tobytes()
                yield Message(connection.topic, connection.type, "ros1", int(block.time_ns[row]), data)
            self._progress(reading)
        self._progress(reading)

    def everything(self, report: ReadReport) -> Pass:
        """Return a pass over all messages."""
        return self._pass(lambda _: True, report)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Rosbag1Log:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _pass(self, wanted: Wanted, report: ReadReport) -> Pass:
        def damaged(place: str, cause: str) -> None:
            # However many records of a chunk are broken, one line tells of it.
            if all(known.place != place for known in report.damage):
                report.add_damage(place, cause)

        return Pass(self._file, self.size or 0, self._index, wanted, damaged)

    def _progress(self, reading: Pass) -> None:
        self.position = reading.at
        self._codecs.update(reading.codecs)


def _open(path: str, source: str | Path | BinaryIO) -> BinaryIO:
    """Open the bag as a file with random access."""
    with unreadable(path):
        if isinstance(source, str | Path):
            return Path(source).open("rb")
        copy = cast(BinaryIO, tempfile.TemporaryFile())  # noqa: SIM115  closed with the log
        shutil.copyfileobj(source, copy, COPY)
        return copy


def _check_magic(path: str, head: bytes) -> None:
    """Refuse what is no bag of format 2.0."""
    if head.startswith(MAGIC):
        return
    line = head.split(b"\n")[0].decode("ascii", "replace")
    if head.startswith(OLD_MAGIC) and " V" in line:
        version = line.split(" V", 1)[1].strip()[:10]
        raise UnreadableError(
            f"{path}: this ROS 1 bag has format {version}, which predates 2.0; write a new one with ROS 1's"
            " 'rosbag fix OLD.bag NEW.bag' and read that"
        )
    raise UnreadableError(f"{path}: not a ROS 1 bag (it does not begin with '#ROSBAG V2.0')")


def _first_codec(file: BinaryIO) -> dict[str, None]:
    """Return the compression of the first chunk."""
    bag = parse(read_at(file, len(MAGIC), 8 + MAX_HEADER), 0, len(MAGIC))
    chunk = parse(read_at(file, bag.end, 8 + MAX_HEADER), 0) if bag else None
    if chunk is None or chunk.op != Op.CHUNK:
        return {}
    return {chunk.value(b"compression").decode("utf-8", "replace"): None}


def _topics(connections: dict[int, Connection], counts: dict[int, int]) -> list[Topic]:
    """Return one entry per topic and type, whatever the number of its publishers."""
    totals: dict[Connection, int] = {}
    for number, connection in sorted(connections.items()):
        totals[connection] = totals.get(connection, 0) + counts.get(number, 0)
    return [Topic(it.topic, it.type, "ros1", count, read_as=it.read_as) for it, count in totals.items()]


def _by_topic(block: MessageBlock, reading: Pass, wanted: Wanted) -> list[list[int]]:
    """Return the wanted connections of a block, grouped by topic and type."""
    groups: dict[Connection, list[int]] = {}
    for number in np.unique(block.connection).tolist():
        connection = reading.connections.get(number)
        if connection is not None and wanted(connection):
            groups.setdefault(connection, []).append(number)
    return list(groups.values())


def _decode(block: MessageBlock, rows: np.ndarray[tuple[int], np.dtype[np.intp]], gather: Gather) -> Iterator[RawSweeps]:
    """Decode many messages where they lie, gather few."""
    starts, lengths, times = block.starts[rows], block.lengths[rows], block.time_ns[rows]
    if len(rows) >= DENSE:
        yield from gather.decode(block.data, starts, lengths, times)
        return
    for start, length, time in zip(starts.tolist(), lengths.tolist(), times.tolist(), strict=True):
        if gather.add(block.data[start : start + length].tobytes(), time):
            yield from gather.flush()
