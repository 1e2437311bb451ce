"""Records of a ROS 1 bag (format 2.0): from the file or a compressed chunk, one or many, after damage; and its index.

A record is header_len, header, data_len, data; a header is a list of `name=value` fields, each behind its
length.
"""

from __future__ import annotations

import bz2
import struct
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import BinaryIO, NamedTuple, Protocol

import numpy as np
from lz4.frame import LZ4FrameDecompressor

from lidarcli.logs.base import ros_type
from lidarcli.logs.laserscan import scan_type
from lidarcli.sweeps import Int64, UInt8

MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER = 8192
"""Longest record header [bytes]: real ones hold a topic name and a few numbers."""
MAX_FIELDS = 32
MAX_LAYOUTS = 8
"""Most layouts of message headers read by column; a bag is written by one program, hence has one."""
OVERLAP = 4096
"""Bytes that two searched windows share, so that a header across their border is found."""

_U32 = struct.Struct("<I").unpack_from
_OP = b"\x04\x00\x00\x00op="


class Op(IntEnum):
    """Kinds of records."""

    MESSAGE = 2
    BAG = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


_REQUIRED: dict[int, dict[bytes, int | None]] = {
    Op.MESSAGE: {b"conn": 4, b"time": 8},
    Op.BAG: {b"index_pos": 8},
    Op.INDEX: {b"conn": 4, b"count": 4},
    Op.CHUNK: {b"compression": None, b"size": 4},
    Op.CHUNK_INFO: {b"chunk_pos": 8, b"count": 4},
    Op.CONNECTION: {b"conn": 4, b"topic": None},
}


class Field(NamedTuple):
    """Position of a field value in the header."""

    start: int
    end: int


class Record(NamedTuple):
    """A record: its position and header; positions in bytes of the buffer or the file."""

    start: int
    op: int
    header: bytes
    fields: dict[bytes, Field]
    data_length: int

    @property
    def data_start(self) -> int:
        return self.start + 8 + len(self.header)

    @property
    def end(self) -> int:
        return self.data_start + self.data_length

    def value(self, name: bytes) -> bytes:
        field = self.fields[name]
        return self.header[field.start : field.end]

    def number(self, name: bytes) -> int:
        return int.from_bytes(self.value(name), "little")


def parse_fields(header: bytes) -> dict[bytes, Field] | None:
    """Return the fields of a header by name; None if their lengths do not add up to it."""
    fields: dict[bytes, Field] = {}
    at, end = 0, len(header)
    while at < end:
        if at + 4 > end:
            return None
        (length,) = _U32(header, at)
        at += 4
        equals = header.find(b"=", at, at + length)
        if at + length > end or equals < 0 or len(fields) == MAX_FIELDS:
            return None
        fields[header[at:equals]] = Field(equals + 1, at + length)
        at += length
    return fields


def parse(data: bytes, at: int, origin: int = 0) -> Record | None:
    """Return the record at `data[at:]`, if a plausible header and its data length stand there.

    Its data may be cut off. `origin` is added to the record's position.
    """
    if at + 8 > len(data):
        return None
    (length,) = _U32(data, at)
    if length > MAX_HEADER or at + 8 + length > len(data):
        return None
    header = data[at + 4 : at + 4 + length]
    fields = parse_fields(header)
    if fields is None or b"op" not in fields:
        return None
    op = header[fields[b"op"].start : fields[b"op"].end]
    required = _REQUIRED.get(op[0]) if len(op) == 1 else None
    if required is None:
        return None
    for name, size in required.items():
        field = fields.get(name)
        if field is None or (size is not None and field.end - field.start != size):
            return None
    return Record(origin + at, op[0], header, fields, _U32(data, at + 4 + length)[0])


class Search:
    """Search for the next record after damage, with a budget that bounds what a hostile file can cost."""

    def __init__(self, budget: int = 100_000) -> None:
        self.budget = budget

    def next(self, data: bytes, start: int) -> int | None:
        """Position of the first plausible record that begins at or after `start`, or None."""
        mark = data.find(_OP, start)
        while mark >= 0 and self.budget > 0:
            self.budget -= 1
            found = self._start_of(data, mark, start)
            if found is not None:
                return found
            mark = data.find(_OP, mark + 1)
        return None

    def _start_of(self, data: bytes, mark: int, start: int) -> int | None:
        """Start of the record whose `op` field stands at `mark`: fields of any order may precede it."""
        first = max(start, mark - 1024)
        window = np.frombuffer(data, np.uint8, mark - first, first).astype(np.int64)
        if len(window) < 4:
            return None
        lengths = window[:-3] | window[1:-2] << 8 | window[2:-1] << 16 | window[3:] << 24
        reach = first + np.arange(len(lengths)) + 4 + lengths
        for candidate in np.nonzero((reach >= mark + 8) & (lengths <= MAX_HEADER))[0][::-1]:
            self.budget -= 1
            if parse(data, first + int(candidate)) is not None:
                return first + int(candidate)
        return None


@dataclass(frozen=True, slots=True)
class Walk:
    """Records that follow one another in a buffer, by column, before their headers are judged."""

    starts: Int64
    header_lengths: Int64
    data_lengths: Int64
    stop: int
    """Position of the first record that is not whole in the buffer; the end of the buffer if all are."""


def walk(data: bytes, at: int = 0) -> Walk:
    """Walk from record to record; runs of equal size, as one scan topic makes them, are taken in one step."""
    end = len(data)
    starts: list[int] = []
    headers: list[int] = []
    lengths: list[int] = []
    size_before, wait = -1, 0
    while at + 8 <= end:
        (header,) = _U32(data, at)
        body = at + 4 + header
        if body + 4 > end:
            break
        (length,) = _U32(data, body)
        size = 8 + header + length
        if at + size > end:
            break
        starts.append(at)
        headers.append(header)
        lengths.append(length)
        at += size
        if size == size_before and len(starts) >= wait:
            run = _equal_records(data, at, header, length)
            starts.extend(range(at, at + run * size, size))
            headers.extend([header] * run)
            lengths.extend([length] * run)
            at += run * size
            wait = len(starts) + (0 if run > 8 else 64)
        size_before = size
    return Walk(np.array(starts, np.int64), np.array(headers, np.int64), np.array(lengths, np.int64), at)


def _equal_records(data: bytes, at: int, header: int, length: int) -> int:
    """Return the number of consecutive records from `at` on with these lengths."""
    size = 8 + header + length
    count = (len(data) - at) // size
    if count < 2:
        return 0
    rows = np.frombuffer(data, np.uint8, count * size, at).reshape(count, size)
    same = (rows[:, :4].copy().view("<u4")[:, 0] == header) & (
        rows[:, 4 + header : 8 + header].copy().view("<u4")[:, 0] == length
    )
    return count if same.all() else int(np.argmin(same))


@dataclass(frozen=True, slots=True)
class Judged:
    """Message headers of a walk, by column."""

    connection: Int64
    """Connection of each message; -1 for other records."""
    time_ns: Int64
    others: list[tuple[int, Record]]
    """(row, record) of connection records."""
    good: int
    """Rows before the first one that is broken, or that does not belong into a chunk."""
    foreign: Record | None
    """The record that ended the good rows, if it is a sane one of another kind."""


def judge(data: bytes, walked: Walk) -> Judged:
    """Read the headers of a walk by column: those of messages all look alike."""
    rows = len(walked.starts)
    bytes_ = np.frombuffer(data, np.uint8)
    connection = np.full(rows, -1, np.int64)
    time_ns = np.zeros(rows, np.int64)
    others: list[tuple[int, Record]] = []
    pending = np.arange(rows)
    layouts = 0
    while len(pending):
        row = int(pending[0])
        record = parse(data, int(walked.starts[row]))
        if record is None or record.op not in (Op.MESSAGE, Op.CONNECTION):
            # Earlier rows are all judged, for rows leave `pending` in order or by whole layouts.
            return Judged(connection, time_ns, others, row, record)
        if record.op == Op.CONNECTION:
            others.append((row, record))
            pending = pending[1:]
            continue
        layouts += 1
        alike = pending[:1]
        if layouts <= MAX_LAYOUTS:
            alike = pending[walked.header_lengths[pending] == len(record.header)]
        headers = bytes_[walked.starts[alike, None] + 4 + np.arange(len(record.header))]
        fixed = np.ones(len(record.header), np.bool_)
        for name in (b"conn", b"time"):
            fixed[record.fields[name].start : record.fields[name].end] = False
        matches = (headers[:, fixed] == headers[0, fixed]).all(axis=1)
        headers, alike = headers[matches], alike[matches]
        connection[alike] = _column(headers, record.fields[b"conn"].start)
        time_at = record.fields[b"time"].start
        time_ns[alike] = _column(headers, time_at) * 1_000_000_000 + _column(headers, time_at + 4)
        if layouts <= MAX_LAYOUTS:
            left = np.ones(rows, np.bool_)
            left[alike] = False
            pending = pending[left[pending]]
        else:
            pending = pending[1:]
    return Judged(connection, time_ns, others, rows, None)


def _column(headers: UInt8, at: int) -> Int64:
    """Return a little-endian u32 of every header."""
    value: Int64 = headers[:, at : at + 4].copy().view("<u4")[:, 0].astype(np.int64)
    return value


INPUT = 1 << 20
"""Compressed bytes taken at a time."""
CAREFUL_INPUT = 512
"""Compressed bytes taken at a time from broken data, so that everything before the break comes out."""
CODECS = {"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18"}
"""Known compressions and how their data begins."""


def read_at(file: BinaryIO, at: int, size: int) -> bytes:
    """Return bytes of the file at a position, fewer at its end."""
    file.seek(at)
    return file.read(size)


class Feed(Protocol):
    """A source of bytes: `read` gives as many as asked for, fewer only at the end."""

    @property
    def left(self) -> int:
        """Most bytes that are still to come."""

    def read(self, size: int) -> bytes: ...


class FileFeed:
    """The bytes of a file from a position on."""

    def __init__(self, file: BinaryIO, at: int, end: int) -> None:
        self._file, self._at, self._end = file, at, end

    @property
    def left(self) -> int:
        return max(0, self._end - self._at)

    def read(self, size: int) -> bytes:
        data = read_at(self._file, self._at, max(0, min(size, self._end - self._at)))
        self._at += len(data)
        return data


class ChunkFeed:
    """The unpacked bytes of a compressed chunk, at most `most`.

    A block of bz2 data comes out only after its checksum has been compared: from a broken block come plausible records of
    shuffled bytes.
    """

    def __init__(self, file: BinaryIO, start: int, end: int, codec: str, most: int) -> None:
        self._file, self._start, self._end, self._codec = file, start, end, codec
        self._limit = most
        self._step = INPUT
        self.error = ""
        """Reason why the data could not be decompressed to its end; empty if it could."""
        self._begin()
        self._unpacked = self._given = 0
        self._spare = b""
        """Unpacked already and not yet asked for."""

    def _begin(self) -> None:
        self._at = self._start
        self._codec_state: bz2.BZ2Decompressor | LZ4FrameDecompressor = (
            bz2.BZ2Decompressor() if self._codec == "bz2" else LZ4FrameDecompressor()
        )

    @property
    def left(self) -> int:
        return self._limit - self._given

    @property
    def unpacked(self) -> int:
        """Number of decompressed bytes."""
        return self._unpacked

    @property
    def finished(self) -> bool:
        """True at the end mark of the compressed data."""
        return bool(self._codec_state.eof)

    @property
    def stop(self) -> int:
        """Position in the file behind the compressed data, where `finished`."""
        return self._at - len(self._codec_state.unused_data or b"")

    def read(self, size: int) -> bytes:
        parts, missing = [self._spare], size - len(self._spare)
        while missing > 0 and self._unpacked < self._limit and not self.finished and not self.error:
            parts.append(self._unpack(min(missing, self._limit - self._unpacked)))
            missing -= len(parts[-1])
        data = b"".join(parts)
        end = min(size, self.left)
        data, self._spare = data[:end], data[end:]
        self._given += len(data)
        return data

    def _unpack(self, size: int) -> bytes:
        """Return the next `size` bytes at most, of bz2 the next whole blocks."""
        compressed = b""
        if self._codec_state.needs_input:
            compressed = read_at(self._file, self._at, max(0, min(self._step, self._end - self._at)))
            self._at += len(compressed)
            if not compressed:
                self.error = "it is cut off"
                return b""
        try:
            data = self._decompress(compressed, size)
        except (OSError, RuntimeError, ValueError) as err:
            if self._step == CAREFUL_INPUT:
                self.error = f"its {self._codec} data is broken ({err})"
                return b""
            return self._again(size)
        self._unpacked += len(data)
        return data

    def _decompress(self, compressed: bytes, size: int) -> bytes:
        data: bytes = self._codec_state.decompress(compressed, max_length=size)
        if self._codec == "bz2":
            room = self._limit - self._unpacked
            # Only where it wants more than it has been given it has come to the end of a block.
            while not self.finished and not self._codec_state.needs_input and len(data) <= room:
                data += self._codec_state.decompress(b"", max_length=INPUT)
        return data

    def _again(self, size: int) -> bytes:
        """Start over in small steps: a step that fails gives nothing, not even what is good in it."""
        self._step = CAREFUL_INPUT
        self._begin()
        skip, self._unpacked = self._unpacked, 0
        data = b""
        while self._unpacked < skip and not self.finished and not self.error:
            data = self._unpack(min(skip - self._unpacked, INPUT))
        if self._unpacked > skip:
            return data[skip - self._unpacked :]
        return b"" if self.error or self.finished else self._unpack(size)

    def drain(self) -> None:
        """Read on to the end mark of the compressed data, so that `finished` and `stop` can be asked for."""
        while self._unpacked == self._limit and not self.finished and not self.error:
            self._unpack(1)
        if self._unpacked > self._limit:
            self.error = self.error or "it holds more than it declares"


MAX_INDEX = 256 << 20
"""Longest index section that is read [bytes]."""


class State(Enum):
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
    record: bytes = field(default=b"", compare=False, repr=False)
    """Its record, as it stands in the bag."""
    read_as: str = field(default="", compare=False)
    """Type as which its messages are read as sweeps; empty where they are none."""


@dataclass(frozen=True, slots=True)
class Index:
    """Connections of a bag and how many messages of which one each chunk holds."""

    state: State
    encryptor: str = ""
    connections: dict[int, Connection] = field(default_factory=dict)
    chunks: dict[int, bytes] = field(default_factory=dict)
    """Position of each chunk → its (connection, count) pairs of u32."""

    def chunk_counts(self, position: int) -> dict[int, int] | None:
        """Return the messages by connection of the chunk at a position; None if the index does not know it."""
        pairs = self.chunks.get(position)
        return None if pairs is None else dict(np.frombuffer(pairs, "<u4").reshape(-1, 2).tolist())

    def counts(self) -> dict[int, int]:
        """Return the messages by connection of the whole bag."""
        pairs = np.frombuffer(b"".join(self.chunks.values()), "<u4").reshape(-1, 2)
        connections, inverse = np.unique(pairs[:, 0], return_inverse=True)
        totals = np.zeros(len(connections), np.int64)
        np.add.at(totals, inverse, pairs[:, 1].astype(np.int64))
        return dict(zip(connections.tolist(), totals.tolist(), strict=True))


def connection_of(record: Record, data: bytes) -> Connection:
    """Return the topic and type of a connection record; the type is empty where its data is broken."""
    fields = parse_fields(data) or {}
    kind = fields.get(b"type")
    name = data[kind.start : kind.end].decode("utf-8", "replace") if kind else ""
    whole = b"".join(len(part).to_bytes(4, "little") + part for part in (record.header, data))
    definition = fields.get(b"message_definition")
    told = data[definition.start : definition.end].decode("utf-8", "replace") if definition else ""
    read_as = scan_type(ros_type(name), "ros1msg", told)
    return Connection(record.value(b"topic").decode("utf-8", "replace"), ros_type(name), whole, read_as)


def read_index(file: BinaryIO, size: int) -> Index:
    """Read the bag's header and its index section."""
    bag = parse(read_at(file, len(MAGIC), 8 + MAX_HEADER), 0)
    if bag is None or bag.op != Op.BAG:
        return Index(State.BROKEN)
    encryptor = bag.value(b"encryptor").decode("utf-8", "replace") if b"encryptor" in bag.fields else ""
    position = bag.number(b"index_pos")
    if position == 0:
        return Index(State.OPEN, encryptor)
    if position >= size:
        return Index(State.CUT, encryptor)
    if size - position > MAX_INDEX:
        return Index(State.BROKEN, encryptor)
    data = read_at(file, position, size - position)
    connections: dict[int, Connection] = {}
    chunks: dict[int, bytes] = {}
    at = 0
    while (record := parse(data, at)) is not None and record.end <= len(data):
        body = data[record.data_start : record.end]
        if record.op == Op.CONNECTION:
            connections[record.number(b"conn")] = connection_of(record, body)
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
        return Index(State.GOOD, encryptor, connections, chunks)
    cut = record is not None and record.end > len(data)
    return Index(State.CUT if cut or at == len(data) else State.BROKEN, encryptor, connections)
