"""Bytes and records of an MCAP: source, chunks within bounds, messages by column, definitions, and the summary."""

from __future__ import annotations

import io
import struct
import zlib
from array import array
from collections.abc import Callable, Collection
from typing import BinaryIO, NamedTuple, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from numpy.typing import NDArray

from lidarcli.logs.base import SCAN_TYPES, ReadReport, ros_type
from lidarcli.logs.laserscan import scan_type
from lidarcli.logs.unpacking import CHUNK_RATIO, MAX_CHUNK, SMALL
from lidarcli.sweeps.types import Bool, Int64, UInt8, record
from lidarcli.system.records import dataclass, field, fields

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
"""Opcode and length, before every record."""
MESSAGE_HEAD = 31
"""Bytes of a message record before its payload, those of `RECORD` included."""
MAX_SMALL = 1 << 26
"""Schemas, channels and indexes of more bytes than this are not believed."""
MAX_OTHERS = 1 << 16
"""A chunk with more records than this that are no messages is not read on."""
PART = 1 << 16
PIECE = 1 << 20
"""Most bytes asked of a pipe at once: a declared size is never allocated before the bytes are there."""

_CHUNK = struct.Struct("<BQQQQII")
"""Opcode, length, first and last time, uncompressed size, CRC, length of the compression's name."""
CHUNK_PEEK = _CHUNK.size + 16 + 8
"""Bytes that hold the beginning of any chunk record up to its data."""
_MESSAGE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
ENTRY = np.dtype([("log", "<u8"), ("offset", "<u8")])
_FOOTER = struct.Struct("<BQQQI")
_STEP = 1 << 16
T = TypeVar("T")
K = TypeVar("K")
V = TypeVar("V")


class RecordCursor:
    """A position in a stream of bytes. A file can also be read elsewhere (`read_at`), and ends where it ended at open."""

    def __init__(self, stream: BinaryIO, size: int | None) -> None:
        self.stream = stream
        self.size = size
        self.position = 0
        self._ahead = b""

    def read_at(self, offset: int, length: int) -> bytes:
        """Return bytes of a file, fewer at its end."""
        self.stream.seek(offset)
        return self._read(max(0, min(length, (self.size or 0) - offset)))

    def peek(self, length: int) -> bytes:
        """Return the next bytes without passing them; fewer only at the end. May return more."""
        missing = length - len(self._ahead)
        if missing > 0:
            if self.size is None:
                self._ahead += self._read(missing)
            else:
                self._ahead = self.read_at(self.position, max(length, 1 << 12))
        return self._ahead

    def take(self, length: int) -> bytes:
        """Pass the next bytes and return them; fewer only at the end."""
        data = self.peek(length)[:length]
        self.skip(len(data))
        return data

    def skip(self, length: int) -> int:
        """Pass the next bytes; return their number."""
        if self.size is not None:
            passed = min(length, self.size - self.position)
            self._ahead = self._ahead[passed:]
            self.position += passed
            return passed
        passed = 0
        while passed < length and (step := len(self.peek(min(length - passed, PIECE))[: length - passed])):
            self._ahead = self._ahead[step:]
            self.position += step
            passed += step
        return passed

    def _read(self, length: int) -> bytes:
        """Return exactly `length` bytes unless the stream ends."""
        piece = PIECE if self.size is None else length
        pieces = []
        while length > 0 and (data := self.stream.read(min(length, piece))):
            pieces.append(data)
            length -= len(data)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)


@record
class McapMessages:
    """K messages of one piece of bytes, in their order there."""

    data: UInt8
    channel: NDArray[np.uint16]
    log_ns: Int64
    start: Int64
    length: Int64

    def __len__(self) -> int:
        return len(self.channel)

    def take(self, rows: Bool) -> McapMessages:
        """Return the messages of a mask."""
        return McapMessages(self.data, *(getattr(self, field.name)[rows] for field in fields(self)[1:]))


class Records(NamedTuple):
    """Records that follow one another in a piece of bytes."""

    messages: McapMessages
    others: list[tuple[int, int, int]]
    """Opcode, first byte of the content and its end, of all that are no messages."""
    end: int


def list_records(data: bytes, first: int, last: int, messages_only: bool = False) -> Records:
    """Go from record to record; stop at the first that is not whole, or has no opcode, or after `PART` messages."""
    messages: array[int] = array("q")
    others: list[tuple[int, int, int]] = []
    place = first
    unpack = RECORD.unpack_from
    while last - place >= 9 and len(messages) < PART:
        opcode, length = unpack(data, place)
        end = place + 9 + length
        if end > last or opcode == 0:
            break
        if opcode == Opcode.MESSAGE and length >= 22:
            messages.append(place)
        elif not messages_only and len(others) < MAX_OTHERS:
            others.append((opcode, place + 9, end))
        else:
            break
        place = end
    return Records(_messages_at(data, np.array(messages, np.int64))[0], others, place)


def list_indexed(data: bytes, offsets: Int64) -> Records | None:
    """Return all records of a chunk by the offsets of its message index; None unless its messages and the rest tile it.

    What an index says is only used as far as the records prove it, so a lying one loses nothing.
    """
    at = np.sort(offsets)
    if len(at) == 0 or at[0] < 0 or at[-1] > len(data) - MESSAGE_HEAD:
        return None
    messages, opcodes = _messages_at(data, at)
    begins = np.append(0, messages.start + messages.length)
    ends = np.append(at, len(data))
    sound = (opcodes == Opcode.MESSAGE) & (messages.length >= 0) & (messages.length <= len(data))
    if not sound.all() or (begins > ends).any():
        return None
    others: list[tuple[int, int, int]] = []
    for gap in np.flatnonzero(begins < ends).tolist():
        found = list_records(data, int(begins[gap]), int(ends[gap]))
        if found.end != ends[gap] or len(found.messages):
            return None
        others += found.others
    return Records(messages, others, len(data))


def _messages_at(data: bytes, at: Int64) -> tuple[McapMessages, UInt8]:
    """Return the messages whose records begin at `at`, which must be in bounds, and the opcodes there."""
    view = np.frombuffer(data, np.uint8)
    if not len(at):
        return McapMessages(view, np.empty(0, np.uint16), at, at, at), view[:0]
    heads = _rows(view, at, MESSAGE_HEAD).view(_MESSAGE)[:, 0]
    lengths = heads["length"].astype(np.int64) - (MESSAGE_HEAD - RECORD.size)
    messages = McapMessages(view, heads["channel"].copy(), heads["log"].astype(np.int64), at + MESSAGE_HEAD, lengths)
    return messages, heads["opcode"]


def _rows(data: UInt8, at: NDArray[np.integer], width: int) -> UInt8:
    """Return (K, width) the bytes from each of `at` on."""
    rows: UInt8 = np.ndarray((len(data) - width + 1,), f"V{width}", data, strides=(1,))[at].view(np.uint8)
    return rows.reshape(len(at), width)


class ChunkHead(NamedTuple):
    """The fields of a chunk record before its data."""

    size: int
    crc: int
    compression: str
    data_at: int
    data_length: int


def chunk_head(head: bytes) -> ChunkHead | None:
    """Read the beginning of a chunk record; None if its lengths contradict each other."""
    if len(head) < _CHUNK.size:
        return None
    _, length, _, _, size, crc, name_length = _CHUNK.unpack_from(head)
    data_at = _CHUNK.size + name_length + 8
    if name_length > 16 or len(head) < data_at:
        return None
    data_length = int.from_bytes(head[data_at - 8 : data_at], "little")
    if data_at + data_length != RECORD.size + length:
        return None
    name = head[_CHUNK.size : _CHUNK.size + name_length].decode("utf-8", "replace")
    return ChunkHead(size, crc, name, data_at, data_length)


def is_chunk(head: bytes) -> bool:
    """Return True if a chunk certainly begins here, whatever its opcode: its lengths and compression agree."""
    known = chunk_head(head)
    return known is not None and known.compression in ("", "lz4", "zstd")


def find_record(data: bytes, channels: Collection[int]) -> int | None:
    """Return the first place after byte 0 of a certain chunk, or of a message of one of `channels` with a successor."""
    view = np.frombuffer(data, np.uint8)

    def places(opcode: int, head: int) -> list[int]:
        at = np.flatnonzero(view[1 : max(len(data) - head, 1)] == opcode) + 1
        # A record's length has three zero high bytes.
        return at[~_rows(view, at + 6, 3).any(axis=1)].tolist() if len(at) else []

    chunks = (place for place in places(Opcode.CHUNK, CHUNK_PEEK) if is_chunk(data[place : place + CHUNK_PEEK]))
    messages = (place for place in places(Opcode.MESSAGE, MESSAGE_HEAD) if _is_message(data, place, channels))
    found = [next(chunks, None), next(messages, None) if channels else None]
    return min((place for place in found if place is not None), default=None)


def _is_message(data: bytes, place: int, channels: Collection[int]) -> bool:
    length = RECORD.unpack_from(data, place)[1]
    after = place + RECORD.size + length
    if length < MESSAGE_HEAD - RECORD.size or after + RECORD.size > len(data):
        return False
    opcode, next_length = RECORD.unpack_from(data, after)
    channel = int.from_bytes(data[place + 9 : place + 11], "little")
    return channel in channels and 0 < opcode <= Opcode.DATA_END and next_length < 1 << 40


def inflate_start(head: ChunkHead, data: bytes, most: int = MAX_CHUNK) -> bytes:
    """Decompress as much of the beginning of a damaged chunk as possible."""
    limit = min(head.size, most, SMALL + CHUNK_RATIO * len(data))
    if head.compression == "":
        return data[:limit]
    start = bytearray()
    try:
        if head.compression == "zstd":
            reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data), read_across_frames=True)
            while len(start) < limit and (piece := reader.read(min(_STEP, limit - len(start)))):
                start += piece
        elif head.compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            decompressor = LZ4FrameDecompressor()
            for place in range(0, len(data), _STEP):
                start += decompressor.decompress(data[place : place + _STEP])
                if len(start) >= limit or decompressor.eof:
                    break
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError):
        pass  # what came before the damage is all there is
    return bytes(start[:limit])


def parse(read: Callable[[ReadDataStream], T], content: bytes) -> T | None:
    """Parse the content of a record by the stream of the `mcap` library; None if that fails."""
    try:
        return read(ReadDataStream(io.BytesIO(content)))
    except (McapError, struct.error, ValueError, MemoryError, OverflowError):
        return None


# The classes of the library take as long to import as all of ours.


@dataclass(frozen=True, slots=True)
class Schema:
    """Definition of a type."""

    id: int
    name: str
    encoding: str
    data: bytes


def _schema(stream: ReadDataStream) -> Schema:
    head = stream.read2(), stream.read_prefixed_string(), stream.read_prefixed_string()
    return Schema(*head, stream.read(stream.read4()))


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic as one writer fills it; `schema_id` 0 is no schema."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


def _channel(stream: ReadDataStream) -> Channel:
    head = stream.read2(), stream.read2(), stream.read_prefixed_string(), stream.read_prefixed_string()
    return Channel(*head, _pairs(stream, stream.read_prefixed_string, stream.read_prefixed_string))


class ChunkIndex(NamedTuple):
    """Where a chunk is; lengths [bytes] of it and of the message indexes after it."""

    chunk_start_offset: int
    chunk_length: int
    message_index_length: int
    compression: str


def _chunk_index(stream: ReadDataStream) -> ChunkIndex:
    _times, place = stream.read(16), (stream.read8(), stream.read8())
    _pairs(stream, stream.read2, stream.read8)
    found = ChunkIndex(*place, stream.read8(), stream.read_prefixed_string())
    _sizes = stream.read8(), stream.read8()
    return found


def _message_counts(stream: ReadDataStream) -> dict[int, int]:
    _totals = stream.read(42)
    return _pairs(stream, stream.read2, stream.read8)


def _pairs(stream: ReadDataStream, key: Callable[[], K], value: Callable[[], V]) -> dict[K, V]:
    length, pairs = stream.read4(), dict[K, V]()
    end = stream.count + length
    while stream.count < end:
        name = key()
        pairs[name] = value()
    return pairs


@dataclass(slots=True)
class ChannelCatalogue:
    """Channels and schemas by their ids; the first definition of an id counts."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)

    def add(self, opcode: int, content: bytes) -> bool:
        """Take a Schema or Channel record's content; False where it cannot be understood."""
        if opcode == Opcode.CHANNEL:
            channel = parse(_channel, content)
            return channel is not None and self.channels.setdefault(channel.id, channel) is not None
        schema = parse(_schema, content)
        return schema is not None and self.schemas.setdefault(schema.id, schema) is not None

    def schema(self, channel: int) -> Schema | None:
        """Return the schema of a channel, where both are known."""
        known = self.channels.get(channel)
        return None if known is None else self.schemas.get(known.schema_id)

    def knows(self, channel: int) -> bool:
        """Return True if the type of a channel is known: its record, and its schema if it has one."""
        known = self.channels.get(channel)
        return known is not None and (known.schema_id == 0 or known.schema_id in self.schemas)

    def type(self, channel: int) -> str:
        """Return the type as `ros_type` spells it, empty where unknown."""
        schema = self.schema(channel)
        return "" if schema is None else ros_type(schema.name)

    def read_as(self, channel: int) -> str:
        """Return the type as which the messages of a channel are read as sweeps; empty where they are none."""
        schema, kind = self.schema(channel), self.type(channel)
        if schema is None or kind in SCAN_TYPES:
            return kind
        return scan_type(kind, schema.encoding, schema.data.decode("utf-8", "replace"))


@dataclass(slots=True)
class McapSummary:
    """Summary section of an MCAP that was closed properly."""

    catalogue: ChannelCatalogue = field(default_factory=ChannelCatalogue)
    counts: dict[int, int] | None = None
    """Number of messages by channel; None without statistics."""
    chunks: list[ChunkIndex] = field(default_factory=list)
    chunk_offsets: Int64 = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def sane(self) -> bool:
        """True if its channels can be taken for all channels of the log."""
        ids = set(self.catalogue.channels) | set(self.counts or ())
        return all(map(self.catalogue.knows, ids)) and (self.counts is not None or bool(self.catalogue.channels))


def read_summary(source: RecordCursor, report: ReadReport) -> McapSummary | None:
    """Return the summary of a file; None where the log was not closed, or where its summary is damaged.

    Nothing in it is needed to read the log: it saves time, it names what can be skipped, and it leads past damage.
    """
    if source.size is None or source.size < 2 * len(MAGIC) + _FOOTER.size:
        return None
    footer_at = source.size - len(MAGIC) - _FOOTER.size
    tail = source.read_at(footer_at, _FOOTER.size + len(MAGIC))
    if not tail.endswith(MAGIC) or len(tail) < _FOOTER.size:
        return None
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if opcode != Opcode.FOOTER or length != _FOOTER.size - RECORD.size:
        return None
    if start == 0:
        return McapSummary()
    if not len(MAGIC) <= start <= footer_at or footer_at - start > 1 << 28:
        report.add_damage(f"footer at byte {footer_at}", f"its summary cannot begin at byte {start}; not used")
        return None
    data = source.read_at(start, footer_at - start)
    if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(data)) != crc:
        report.add_damage(f"summary at byte {start}", "its checksum does not hold; not used")
        return None
    summary = McapSummary()
    place, end = -1, 0
    while place < end < len(data):
        place = end
        found = list_records(data, place, len(data))
        for opcode, first, last in found.others:
            content = data[first:last]
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                summary.catalogue.add(opcode, content)
            elif opcode == Opcode.STATISTICS:
                summary.counts = parse(_message_counts, content)
            elif opcode == Opcode.CHUNK_INDEX and (chunk := parse(_chunk_index, content)) is not None:
                summary.chunks.append(chunk)
        end = found.end
    summary.chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
    offsets = {min(chunk.chunk_start_offset, 2**62) for chunk in summary.chunks}
    summary.chunk_offsets = np.array(sorted(offsets), np.int64)
    return summary


def skippable_chunks(source: RecordCursor, summary: McapSummary | None, wanted: Collection[int]) -> frozenset[int]:
    """Return the positions of chunks that may be passed over where their message index names no wanted channel.

    None may, unless the message indexes of all chunks agree with the statistics for each wanted channel.
    """
    if summary is None or not summary.sane or summary.counts is None or len(summary.chunk_offsets) < len(summary.chunks):
        return frozenset()
    counts = dict.fromkeys(wanted, 0)
    for chunk in summary.chunks:
        after = chunk.chunk_start_offset + chunk.chunk_length
        if chunk.message_index_length > MAX_SMALL or after > (source.size or 0):
            return frozenset()
        data = source.read_at(after, chunk.message_index_length)
        for opcode, first, end in list_records(data, 0, len(data)).others:
            if opcode == Opcode.MESSAGE_INDEX and end - first >= 6:
                channel, size = struct.unpack_from("<HI", data, first)
                if channel in counts:
                    counts[channel] += size // 16
    agree = all(summary.counts.get(channel, 0) == count for channel, count in counts.items())
    return frozenset(summary.chunk_offsets.tolist()) if agree else frozenset()
