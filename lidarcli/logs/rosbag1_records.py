"""Records of ROS 1 bags: their headers, a search for them past damage, messages by column, and compressed chunks.

A record is header_len, header, data_len, data; a header is a list of `name=value` fields, each behind its length.
"""

from __future__ import annotations

import bz2
import struct
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from lz4.frame import LZ4FrameDecompressor

from lidarcli.logs.unpacking import LZ4_MAGIC, unpack_frames
from lidarcli.sweeps.types import Int64, UInt8

MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER = 8192
"""Longest record header [bytes]: real ones hold a topic name and a few numbers."""
MAX_LAYOUTS = 8
"""Most layouts of message headers read by column; a bag is written by one program, hence has one."""
STEP = 512
"""Compressed bytes taken at a time from broken lz4 data, so that everything before the break comes out."""
CODECS = {"bz2": b"BZh", "lz4": LZ4_MAGIC}
"""Known compressions and how their data begins."""

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
"""Fields of each kind of record, and their lengths."""


class HeaderField(NamedTuple):
    """Position of a field value in the header."""

    start: int
    end: int


class Record(NamedTuple):
    """A record: its position and header; positions in bytes of the buffer or the file."""

    start: int
    op: int
    header: bytes
    fields: dict[bytes, HeaderField]
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


def parse_fields(header: bytes) -> dict[bytes, HeaderField] | None:
    """Return the fields of a header by name; None if their lengths do not add up to it."""
    fields: dict[bytes, HeaderField] = {}
    at, end = 0, len(header)
    while at < end:
        if at + 4 > end:
            return None
        (length,) = _U32(header, at)
        at += 4
        equals = header.find(b"=", at, at + length)
        if at + length > end or equals < 0 or len(fields) == 32:
            return None
        fields[header[at:equals]] = HeaderField(equals + 1, at + length)
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
        """Return the position of the first plausible record that begins at or after `start`; None if there is none."""
        mark = data.find(_OP, start)
        while mark >= 0 and self.budget > 0:
            self.budget -= 1
            found = self._start_of(data, mark, start)
            if found is not None:
                return found
            mark = data.find(_OP, mark + 1)
        return None

    def _start_of(self, data: bytes, mark: int, start: int) -> int | None:
        """Return the start of the record whose `op` field stands at `mark`: fields of any order may precede it."""
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


class RecordColumns(NamedTuple):
    """Records that follow one another in a buffer, by column; their headers are not parsed yet."""

    starts: Int64
    header_lengths: Int64
    data_lengths: Int64


def walk(data: bytes, at: int = 0) -> RecordColumns:
    """Go from record to record up to one that is not whole; records of equal size, as one topic makes them, in one step."""
    end = len(data)
    starts: list[int] = []
    headers: list[int] = []
    lengths: list[int] = []
    size_before, wait = -1, 0
    while at + 8 <= end:
        (header,) = _U32(data, at)
        body = at + 4 + header
        if not 0 < header <= MAX_HEADER or body + 4 > end:
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
    return RecordColumns(np.array(starts, np.int64), np.array(headers, np.int64), np.array(lengths, np.int64))


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
class MessageBlock:
    """Messages in a buffer, by column; a connection of -1 is no message."""

    data: UInt8
    connection: Int64
    time_ns: Int64
    starts: Int64
    lengths: Int64
    declared: list[Record]


def read_messages(data: bytes, columns: RecordColumns) -> MessageBlock:
    """Read the headers of records by column, for those of messages all look alike.

    The block ends before the first record that is broken, or neither a message nor a connection.
    """
    rows = good = len(columns.starts)
    bytes_ = np.frombuffer(data, np.uint8)
    connection = np.full(rows, -1, np.int64)
    time_ns = np.zeros(rows, np.int64)
    declared: list[Record] = []
    pending = np.arange(rows)
    layouts = 0
    while len(pending):
        row = int(pending[0])
        record = parse(data, int(columns.starts[row]))
        if record is None or record.op not in (Op.MESSAGE, Op.CONNECTION):
            # Earlier rows are all read, for rows leave `pending` in order or by whole layouts.
            good = row
            break
        if record.op == Op.CONNECTION:
            declared.append(record)
            pending = pending[1:]
            continue
        layouts += 1
        alike = pending[:1]
        if layouts <= MAX_LAYOUTS:
            alike = pending[columns.header_lengths[pending] == len(record.header)]
        headers = bytes_[columns.starts[alike, None] + 4 + np.arange(len(record.header))]
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
    starts = columns.starts[:good] + 8 + columns.header_lengths[:good]
    return MessageBlock(bytes_, connection[:good], time_ns[:good], starts, columns.data_lengths[:good], declared)


def _column(headers: UInt8, at: int) -> Int64:
    """Return a little-endian u32 of every header."""
    value: Int64 = headers[:, at : at + 4].copy().view("<u4")[:, 0].astype(np.int64)
    return value


def unpack(packed: bytes, codec: str, most: int) -> tuple[bytes, int, str]:
    """Decompress a chunk as far as it goes: its data, the packed bytes that it took, and the cause of a loss.

    Nothing comes out of broken bz2 data: what precedes the comparison of a checksum may be plausible records of
    shuffled bytes. Data that is cut off gives its whole blocks.
    """
    data = b""
    make = bz2.BZ2Decompressor if codec == "bz2" else LZ4FrameDecompressor
    try:
        data, state = unpack_frames(make, packed, CODECS[codec], most + 1)
    except (OSError, RuntimeError, ValueError) as err:
        error = f"its {codec} data is broken ({err})"
        if codec == "lz4":
            again = LZ4FrameDecompressor()
            with suppress(OSError, RuntimeError, ValueError):
                for at in range(0, len(packed), STEP):
                    data += again.decompress(packed[at : at + STEP], max_length=most + 1 - len(data))
                    if len(data) > most:
                        break
        return data[:most], 0, error
    if len(data) > most:
        return data[:most] if codec == "lz4" else b"", 0, "it holds more than it declares"
    if not state.eof:
        return data, 0, "it is cut off"
    return data, len(packed) - len(state.unused_data or b""), ""
