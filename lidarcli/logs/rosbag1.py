"""ROS 1 bags (format 2.0): whole or damaged, closed or not, uncompressed, bz2 or lz4.

A bag is read record by record, in one pass; damage is reported and stepped over.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import MAX_MESSAGE, Closing, Message, OpenOptions, ReadReport, Topic, ros_type
from lidarcli.logs.laserscan import MessageBatcher, scan_type
from lidarcli.logs.rosbag1_records import (
    CODECS,
    MAGIC,
    MAX_HEADER,
    MessageBlock,
    Op,
    Record,
    Search,
    parse,
    parse_fields,
    read_messages,
    unpack,
    walk,
)
from lidarcli.logs.unpacking import DecompressionBudget, too_much
from lidarcli.sweeps.types import RawSweeps

OLD_MAGIC = b"#ROS"
"""Every bag begins so; format 2.0 goes on with its own magic."""
MAX_CHUNK = 256 << 20
"""Most bytes of one compressed chunk that are read, packed or not: it is held as a whole."""
WINDOW = 1 << 20


def read_at(file: BinaryIO, at: int, size: int) -> bytes:
    """Return bytes of the file at a position, fewer at its end."""
    file.seek(at)
    return file.read(size)


class ReaderState(Enum):
    """State of the index."""

    GOOD = "good"
    OPEN = "the bag was not closed properly and has no index"
    CUT = "the bag is cut off before its index"
    BROKEN = "the index is broken"


@dataclass(frozen=True, slots=True)
class Connection:
    """A publisher of a topic."""

    topic: str
    type: str
    fields: dict[str, str] = field(default_factory=dict, compare=False, repr=False)
    """All that its record holds; empty where that is broken."""
    read_as: str = field(default="", compare=False)
    """Type as which its messages are read as sweeps; empty where they are none."""


@dataclass(frozen=True, slots=True)
class Index:
    """Connections of a bag and how many messages of which one each chunk holds."""

    state: ReaderState
    encryptor: str = ""
    connections: dict[int, Connection] = field(default_factory=dict)
    chunks: dict[int, bytes] = field(default_factory=dict)
    """Position of each chunk → its (connection, count) pairs of u32."""

    def chunk_counts(self, position: int) -> dict[int, int] | None:
        """Return the messages by connection of the chunk at a position; None if the index does not know it."""
        pairs = self.chunks.get(position)
        return None if pairs is None else dict(np.frombuffer(pairs, "<u4").reshape(-1, 2).tolist())

    def counts(self) -> Counter[int]:
        """Return the messages by connection of the whole bag."""
        totals: Counter[int] = Counter()
        for connection, count in np.frombuffer(b"".join(self.chunks.values()), "<u4").reshape(-1, 2).tolist():
            totals[connection] += count
        return totals


def _connection(record: Record, data: bytes) -> Connection:
    """Return the topic and type of a connection record; the type is empty where its data is broken."""
    fields = parse_fields(data) or {}
    texts = {
        name.decode("utf-8", "replace"): data[at.start : at.end].decode("utf-8", "replace") for name, at in fields.items()
    }
    kind = ros_type(texts.get("type", ""))
    read_as = scan_type(kind, "ros1msg", texts.get("message_definition", ""))
    whole = texts.keys() >= {"type", "md5sum", "message_definition"}
    return Connection(record.value(b"topic").decode("utf-8", "replace"), kind, texts if whole else {}, read_as)


def _read_index(file: BinaryIO, size: int) -> Index:
    """Read the bag's header and its index section."""
    bag = parse(read_at(file, len(MAGIC), 8 + MAX_HEADER), 0)
    if bag is None or bag.op != Op.BAG:
        return Index(ReaderState.BROKEN)
    encryptor = bag.value(b"encryptor").decode("utf-8", "replace") if b"encryptor" in bag.fields else ""
    position = bag.number(b"index_pos")
    if position == 0:
        return Index(ReaderState.OPEN, encryptor)
    if position >= size:
        return Index(ReaderState.CUT, encryptor)
    if size - position > 256 << 20:
        return Index(ReaderState.BROKEN, encryptor)
    data = read_at(file, position, size - position)
    connections: dict[int, Connection] = {}
    chunks: dict[int, bytes] = {}
    at = 0
    while (record := parse(data, at)) is not None and record.end <= len(data):
        body = data[record.data_start : record.end]
        if record.op == Op.CONNECTION:
            connections[record.number(b"conn")] = _connection(record, body)
        elif record.op == Op.CHUNK_INFO and len(body) == 8 * record.number(b"count"):
            chunks[record.number(b"chunk_pos")] = body
        else:
            break
        at = record.end
    whole = (
        at == len(data)
        and bag.fields.keys() >= {b"conn_count", b"chunk_count"}
        and bag.number(b"conn_count") == len(connections)
        and bag.number(b"chunk_count") == len(chunks)
    )
    if whole:
        return Index(ReaderState.GOOD, encryptor, connections, chunks)
    cut = record is not None and record.end > len(data)
    return Index(ReaderState.CUT if cut or at == len(data) else ReaderState.BROKEN, encryptor, connections)


Wanted = Callable[[Connection], bool]


class Pass:
    """Reads a bag from its first record to its last. Nothing but speed depends on any index."""

    def __init__(self, file: BinaryIO, size: int, index: Index, wanted: Wanted, report: ReadReport) -> None:
        """Chunks that surely hold nothing `wanted` are skipped; `report` takes the damage."""
        self.connections = dict(index.connections)
        self.counts: Counter[int] = Counter()
        self.codecs: dict[str, None] = {}
        self.at = len(MAGIC)
        self._file, self._size, self._index, self._wanted, self._report = file, size, index, wanted, report
        self._search = Search()
        self._budget = DecompressionBudget()
        self._ahead_at, self._ahead = 0, b""
        self._cut = ""

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield every message of the bag, in file order."""
        while self.at < self._size:
            record = self._record(self.at)
            if record is None:
                self._find(self.at + 1)
            elif record.op in (Op.MESSAGE, Op.CONNECTION):
                yield from self._plain(record)
            elif record.op == Op.CHUNK:
                yield from self._chunk(record)
            else:
                self._go_behind(record)
        self._conclude()

    def _damaged(self, place: str, cause: str) -> None:
        """Report damage; however many records of a chunk are broken, in one line."""
        if all(known.place != place for known in self._report.damage):
            self._report.add_damage(place, cause)

    def _record(self, at: int) -> Record | None:
        offset = at - self._ahead_at
        if not 0 <= offset <= len(self._ahead) - 8 - MAX_HEADER:
            self._ahead_at, self._ahead, offset = at, read_at(self._file, at, 1 << 16), 0
        return parse(self._ahead, offset, at - offset)

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

    def _go_behind(self, record: Record) -> None:
        """Go behind a record that needs no reading, or search where its length cannot be right."""
        end = self._end_of(record)
        if self._sane(end):
            self.at = end
        else:
            self._find(record.data_start)

    def _find(self, start: int) -> None:
        """Go to the next plausible record from a position on; what lies between is lost."""
        lost, self.at = self.at, start
        while self.at < self._size and self._search.budget > 0:
            data = read_at(self._file, self.at, WINDOW)
            if (found := self._search.next(data, 0)) is not None:
                self.at += found
                self._damaged(f"byte {lost}", f"{self.at - lost:,} bytes are broken and were skipped")
                return
            # Windows overlap, so that a header across their border is found.
            self.at += len(data) - 4096 if len(data) == WINDOW else max(1, len(data))
        self._cut_off(lost)

    def _cut_off(self, at: int, where: str = "") -> None:
        self._cut = f"cut off{where}: the {self._size - at:,} bytes from byte {at} on hold no whole record"
        self.at = self._size

    def _plain(self, record: Record) -> Iterator[MessageBlock]:
        """Yield messages that stand in the file itself, as those of uncompressed chunks."""
        if record.data_length > MAX_MESSAGE and self._sane(record.end):
            # Such as a dense point cloud; a LaserScan cannot be.
            if self._is_wanted(record.number(b"conn")):
                self._damaged(f"byte {record.start}", f"a message of {record.data_length:,} bytes was not read")
            self.at = record.end
            return
        window = min(max(WINDOW, record.end - record.start), WINDOW + MAX_MESSAGE)
        block, end = self._messages(read_at(self._file, self.at, window))
        if end:
            yield block
            self.at += end
        else:
            self._find(record.data_start)

    def _messages(self, data: bytes, at: int = 0) -> tuple[MessageBlock, int]:
        """Return the messages from a position of a buffer on, and where they end."""
        columns = walk(data, at)
        block = read_messages(data, columns)
        good = len(block.starts)
        self._search.budget -= len(columns.starts) - good
        for record in block.declared:
            connection = _connection(record, data[record.data_start : record.end])
            if connection.type or record.number(b"conn") not in self.connections:
                self.connections[record.number(b"conn")] = connection
        numbers, counts = np.unique(block.connection, return_counts=True)
        self.counts.update({n: count for n, count in zip(numbers.tolist(), counts.tolist(), strict=True) if n >= 0})
        return block, int(block.starts[-1] + block.lengths[-1]) if good else at

    def _chunk(self, record: Record) -> Iterator[MessageBlock]:
        codec = self._codec(record)
        self.codecs[codec] = None
        behind = self._unwanted(record)
        if behind is not None:
            self.at = behind
        elif codec == "none":
            # Its records stand in the file as any others: whatever its length says, none is lost.
            self.at = record.data_start
        elif codec in CODECS:
            yield from self._unpack(record, codec)
        else:
            self._damaged(f"chunk at byte {record.start}", f"unknown compression '{codec}': the chunk is lost")
            self._go_behind(record)

    def _codec(self, record: Record) -> str:
        """Return the chunk's compression; where its name is broken, what its first bytes look like."""
        codec = record.value(b"compression").decode("utf-8", "replace")[:40]
        if codec != "none" and codec not in CODECS:
            if self._record(record.data_start) is not None:
                return "none"
            head = read_at(self._file, record.data_start, 4)
            return next((known for known, magic in CODECS.items() if head.startswith(magic)), codec)
        return codec

    def _unpack(self, record: Record, codec: str) -> Iterator[MessageBlock]:
        """Yield messages of a compressed chunk."""
        place, sane = f"chunk at byte {record.start}", self._sane(record.end)
        end = min(record.end if sane else self._size, record.data_start + MAX_CHUNK)
        packed = read_at(self._file, record.data_start, end - record.data_start)
        size, room = record.number(b"size"), min(self._budget.room(len(packed)), MAX_CHUNK)
        data, taken, error = unpack(packed, codec, min(size, room))
        self._budget.used(len(data))
        if size > room and not taken:
            error = too_much(size, len(packed))
        before = self.counts.total()
        block, at = self._messages(data)
        yield block
        while at < len(data) and (found := self._search.next(data, at + 1)) is not None:
            self._damaged(place, f"{found - at:,} bytes are broken and were skipped")
            block, at = self._messages(data, found)
            yield block
            at = max(at, found + 1)
        read = self.counts.total() - before
        if error and record.end > self._size:
            self._cut_off(record.start, f" inside a {codec} chunk, {read} messages of which were read")
            return
        if error or at < len(data):
            cause = error or "its last record is not whole"
            self._damaged(place, f"{cause}: {read} messages of it were read, the rest is lost")
        if sane:
            self.at = record.end
        elif taken:
            self.at = record.data_start + taken
        else:
            self._find(record.data_start)

    def _unwanted(self, record: Record) -> int | None:
        """Return the position behind a chunk without wanted messages, if both indexes agree on that; else None."""
        counts = self._index.chunk_counts(record.start) if self._index.state is ReaderState.GOOD else None
        if counts is None or any(self._is_wanted(connection) for connection in counts):
            return None
        found: dict[int, int] = {}
        at = record.end
        while at < self._size and (entry := self._record(at)) is not None and entry.op == Op.INDEX:
            found[entry.number(b"conn")] = entry.number(b"count")
            at = self._end_of(entry)
        return at if found == counts and self._sane(at) else None

    def _is_wanted(self, connection: int) -> bool:
        """Return True for wanted or unknown connections."""
        known = self.connections.get(connection)
        return known is None or self._wanted(known)

    def _conclude(self) -> None:
        """Report the losses of the whole bag, as far as they are known."""
        read = f"{sum(n for c, n in self.counts.items() if self._is_wanted(c)):,} messages were read"
        if self._cut:
            self._damaged(f"byte {self._size} (end of file)", f"{self._cut}; {read}")
        elif self._index.state is not ReaderState.GOOD:
            self._damaged("index", f"{self._index.state.value}; all {read} without it")
        else:
            promised = {c: n for c, n in self._index.counts().items() if self._is_wanted(c)}
            missing = sum(max(0, n - self.counts[c]) for c, n in promised.items())
            if missing:
                self._damaged("index", f"{missing:,} of {sum(promised.values()):,} messages are lost")
        unknown = sum(n for c, n in self.counts.items() if c not in self.connections)
        if unknown:
            self._damaged("connections", f"{unknown:,} messages whose topic is not recorded were left out")


class Rosbag1Log(Closing):
    """A ROS 1 bag of a path or of a stream; a stream is copied to a temporary file, whose name nobody sees."""

    format = "ros1 bag"
    position = 0

    def __init__(self, source: str | Path | BinaryIO, options: OpenOptions | None = None) -> None:
        self._echo = (options or OpenOptions()).echo
        self.path = path = str(source) if isinstance(source, str | Path) else "-"
        with unreadable(path):
            if isinstance(source, str | Path):
                self._file: BinaryIO = Path(source).open("rb")  # noqa: SIM115  closed with the log
            else:
                self._file = cast(BinaryIO, tempfile.TemporaryFile())  # noqa: SIM115  closed with the log
                shutil.copyfileobj(source, self._file, WINDOW)
        try:
            with unreadable(path):
                self.size: int | None = self._file.seek(0, 2)
                _check_magic(path, read_at(self._file, 0, 64))
                self._index = _read_index(self._file, self.size)
            if self._index.encryptor:
                raise UnreadableError(
                    f"{path}: the bag is encrypted ({self._index.encryptor}); write a plain one with 'rosbag decrypt'"
                )
        except UnreadableError:
            self._file.close()
            raise
        self._counted: list[Topic] | None = None
        self._codecs: dict[str, None] = {}

    @property
    def compression(self) -> str:
        """Compression of the chunks read so far, or of the first one."""
        if not self._codecs:
            bag = parse(read_at(self._file, len(MAGIC), 8 + MAX_HEADER), 0, len(MAGIC))
            chunk = parse(read_at(self._file, bag.end, 8 + MAX_HEADER), 0) if bag else None
            if chunk is not None and chunk.op == Op.CHUNK:
                self._codecs[chunk.value(b"compression").decode("utf-8", "replace")] = None
        return "+".join(sorted(self._codecs)) or "none"

    def topics(self) -> list[Topic]:
        """Return all topics: from the index, or where there is none by reading the whole bag once."""
        if self._index.state is ReaderState.GOOD:
            return _topics(self._index.connections, self._index.counts())
        if self._counted is None:
            reading = self.raw_records(ReadReport())
            for _ in reading.blocks():
                pass
            self._counted = _topics(reading.connections, reading.counts)
        return self._counted

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic."""

        def wanted(connection: Connection) -> bool:
            return bool(connection.read_as) and (topics is None or connection.topic in topics)

        gathers: dict[Connection, MessageBatcher] = {}
        for block, known in self._blocks(wanted, report):
            # Publishers of one topic and type are equal as connections.
            for first in dict.fromkeys(known.values()):
                gather = gathers.setdefault(first, MessageBatcher(first.topic, first.read_as, "ros1", report, self._echo))
                rows = np.flatnonzero(np.isin(block.connection, [number for number, it in known.items() if it == first]))
                yield from gather.take(block.data, block.starts[rows], block.lengths[rows], block.time_ns[rows])
        for gather in gathers.values():
            yield from gather.flush()

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order."""
        for block, known in self._blocks(lambda connection: connection.type in types, report):
            for row in np.flatnonzero(np.isin(block.connection, list(known))).tolist():
                connection = known[int(block.connection[row])]
                start = int(block.starts[row])
                data = block.data[start : start + int(block.lengths[row])].tobytes()
                yield Message(connection.topic, connection.type, "ros1", int(block.time_ns[row]), data)

    def raw_records(self, report: ReadReport) -> Pass:
        """Return a pass over all messages."""
        return Pass(self._file, self.size or 0, self._index, lambda _: True, report)

    def close(self) -> None:
        self._file.close()

    def _blocks(self, wanted: Wanted, report: ReadReport) -> Iterator[tuple[MessageBlock, dict[int, Connection]]]:
        """Yield the messages, each block with the wanted connections in it."""
        reading = Pass(self._file, self.size or 0, self._index, wanted, report)
        for block in reading.blocks():
            known = {number: reading.connections.get(number) for number in np.unique(block.connection).tolist()}
            yield block, {number: it for number, it in known.items() if it is not None and wanted(it)}
            self.position = reading.at
            self._codecs.update(reading.codecs)
        self.position = reading.at
        self._codecs.update(reading.codecs)


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


def _topics(connections: dict[int, Connection], counts: Counter[int]) -> list[Topic]:
    """Return one entry per topic and type, whatever the number of its publishers."""
    totals: dict[Connection, int] = {}
    for number, connection in sorted(connections.items()):
        totals[connection] = totals.get(connection, 0) + counts[number]
    return [Topic(it.topic, it.type, "ros1", count, read_as=it.read_as) for it, count in totals.items()]
