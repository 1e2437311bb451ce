"""One pass over a ROS 1 bag, record by record; damage is reported and stepped over."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import BinaryIO

import numpy as np

from lidarcli.logs.rosbag1.feeds import CODECS, ChunkFeed, FileFeed, read_at
from lidarcli.logs.rosbag1.index import Connection, Index, State, connection_of
from lidarcli.logs.rosbag1.records import MAGIC, MAX_HEADER, Op, Record, Search, parse
from lidarcli.logs.rosbag1.run import WINDOW, MessageBlock, RecordRun, Stop
from lidarcli.logs.unpacking import Unpacking, too_much

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
        """How many wanted messages have been read so far."""
        return sum(count for connection, count in self.counts.items() if self._is_wanted(connection))

    def blocks(self) -> Iterator[MessageBlock]:
        """Every message of the bag, in file order."""
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
        """Whether the file ends at a position, or another record begins there."""
        return at == self._size or (at < self._size and self._record(at) is not None)

    def _end_of(self, record: Record) -> int:
        """Where a record ends. Some index records declare 20 bytes per entry and have the usual 12."""
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
        """Messages and connections that stand in the file itself: those of an uncompressed chunk, too."""
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
        """A message too large for memory, such as a dense point cloud: a LaserScan cannot be."""
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
            self._damaged(
                f"chunk at byte {record.start}", f"unknown compression '{codec}': the chunk is lost"
            )
            yield from self._pass_over(record, record.end)

    def _codec(self, record: Record) -> str:
        """The chunk's compression; where its name is broken, what its first bytes look like."""
        codec = record.value(b"compression").decode("utf-8", "replace")[:40]
        if codec != "none" and codec not in CODECS:
            head = read_at(self._file, record.data_start, 4)
            if self._record(record.data_start) is not None:
                return "none"
            return next((known for known, magic in CODECS.items() if head.startswith(magic)), codec)
        return codec

    def _unpack(self, record: Record, codec: str) -> Iterator[MessageBlock]:
        """Messages of a compressed chunk."""
        place = f"chunk at byte {record.start}"
        sane = self._sane(record.end)
        size = record.number(b"size")
        packed = min(record.end, self._size) - record.data_start
        room = self._unpacking.room(packed)
        feed = ChunkFeed(
            self._file, record.data_start, record.end if sane else self._size, codec, min(size, room)
        )
        run = RecordRun(
            feed,
            self._search,
            lambda _, cause: self._damaged(place, cause),
            others_end=False,
            expected=size,
        )
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
        """Position behind a chunk that holds nothing wanted, if both indexes agree on that; else None."""
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
        """An unknown connection might be wanted, for all we know."""
        known = self.connections.get(connection)
        return known is None or self._wanted(known)

    def _cut_off(self, at: int, where: str) -> None:
        self._cut = f"cut off {where}: the {self._size - at:,} bytes from byte {at} on hold no whole record"
        self.at = self._size

    def _conclude(self) -> None:
        """Say what the whole bag lacks, as far as it can be known."""
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
