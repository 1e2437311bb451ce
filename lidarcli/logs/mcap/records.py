"""Bytes and records of an MCAP: the source, chunks within bounds, messages of a chunk, the way back after damage."""

from __future__ import annotations

import io
import struct
import threading
from array import array
from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from numpy.typing import NDArray

from lidarcli.logs.unpacking import CHUNK_RATIO, SMALL, Unpacking, too_much
from lidarcli.sweeps import Bool, Int64, UInt8, record

RECORD = struct.Struct("<BQ")
"""Opcode and length, before every record."""
MESSAGE_HEAD = 31
"""Bytes of a message record before its payload, those of `RECORD` included."""
MAX_SMALL = 1 << 26
"""Schemas, channels and indexes of more bytes than this are not believed."""
MAX_ENTRIES = 1 << 20
"""An index of more messages than this for one chunk is not used."""
WORTH_PROVING = 32
"""An index of fewer messages saves nothing over a walk."""
MAX_OTHERS = 1 << 16
"""A chunk with more records than this that are no messages is not read on."""
PART = 1 << 16
"""Most messages that are handed on at once."""

_CHUNK = struct.Struct("<BQQQQII")
"""Opcode, length, first and last time, uncompressed size, CRC, length of the compression's name."""
_COMPRESSIONS = (b"", b"lz4", b"zstd")
CHUNK_PEEK = _CHUNK.size + 16 + 8
"""Bytes that hold the beginning of any chunk record up to its data."""

_MESSAGE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_ENTRY = np.dtype([("log", "<u8"), ("offset", "<u8")])


@record
class Messages:
    """K messages of one piece of bytes, in their order there."""

    data: UInt8
    channel: NDArray[np.uint16]
    log_ns: Int64
    start: Int64
    """Position of the payload [bytes]."""
    length: Int64

    def __len__(self) -> int:
        return len(self.channel)

    def take(self, rows: Bool) -> Messages:
        """Return the messages of a mask."""
        return Messages(self.data, *(getattr(self, field.name)[rows] for field in fields(self)[1:]))


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """The fields of a chunk record before its data."""

    size: int
    crc: int
    compression: str
    data_at: int
    """Offset of the data from the first byte of the record."""
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


def index_entries(record: bytes) -> tuple[int, Int64] | None:
    """Return the channel and offsets of a MessageIndex record; None if it contradicts itself."""
    if len(record) < 6:
        return None
    channel, size = struct.unpack_from("<HI", record)
    if size % 16 or 6 + size > len(record):
        return None
    offsets = np.frombuffer(record, _ENTRY, size // 16, 6)["offset"]
    return channel, offsets.astype(np.int64)


def _rows(data: UInt8, at: Int64, width: int) -> UInt8:
    """Return (K, width) the bytes from each of `at` on."""
    rows: UInt8 = np.ndarray((len(data) - width + 1,), f"V{width}", data, strides=(1,))[at].view(np.uint8)
    return rows.reshape(len(at), width)


def messages_at(data: UInt8, at: Int64) -> Messages:
    """Return the messages whose records begin at `at`, which must be in bounds."""
    if not len(at):
        empty = np.empty(0, np.int64)
        return Messages(data, np.empty(0, np.uint16), empty, empty, empty)
    heads = _rows(data, at, MESSAGE_HEAD).view(_MESSAGE)[:, 0]
    return Messages(
        data,
        heads["channel"].copy(),
        heads["log"].astype(np.int64),
        at + MESSAGE_HEAD,
        heads["length"].astype(np.int64) - (MESSAGE_HEAD - RECORD.size),
    )


@dataclass(slots=True)
class Records:
    """Positions of the records in a piece of bytes; `end` is the end of the last whole record."""

    messages: array[int]
    others: list[tuple[int, int, int]]
    """Opcode, first byte of the content and its end, of all that are no messages."""
    end: int


def list_records(data: bytes, first: int, last: int, most: int = PART, messages_only: bool = False) -> Records:
    """Go from record to record; stop at the first that is not whole, or has no opcode, or after `most` messages."""
    messages: array[int] = array("q")
    others: list[tuple[int, int, int]] = []
    place = first
    unpack = RECORD.unpack_from
    while last - place >= 9 and len(messages) < most:
        opcode, length = unpack(data, place)
        end = place + 9 + length
        if end > last or opcode == 0:
            break
        if opcode == Opcode.MESSAGE and length >= 22:
            messages.append(place)
        elif messages_only:
            break
        elif len(others) < MAX_OTHERS:
            others.append((opcode, place + 9, end))
        else:
            break
        place = end
    return Records(messages, others, place)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Messages and other records of a stretch of a chunk, in order. `end`: where whole records end so far."""

    messages: Messages
    others: list[tuple[int, int, int]]
    end: int


def stretches(data: bytes, offsets: Int64 | None) -> Iterator[Stretch]:
    """Yield all records of a chunk's bytes.

    `offsets` are where its message index says that messages begin. What the index says is only used as far as the
    records prove it: from each message's length follows where the next record begins, gaps are walked, and if any of
    this does not meet, the whole chunk is walked. So a lying index can lose nothing.
    """
    array_of_bytes = np.frombuffer(data, np.uint8)
    worth = offsets is not None and len(offsets) >= WORTH_PROVING
    known = _proved(data, array_of_bytes, offsets) if offsets is not None and worth else None
    if known is not None:
        at, others = known
        for first in range(0, len(at), PART):
            some = at[first : first + PART]
            yield Stretch(messages_at(array_of_bytes, some), others, len(data))
            others = []
        return
    place = 0
    while True:
        found = list_records(data, place, len(data))
        at = np.frombuffer(found.messages, np.int64) if found.messages else np.empty(0, np.int64)
        yield Stretch(messages_at(array_of_bytes, at), found.others, found.end)
        if found.end == place or found.end == len(data) or len(found.messages) < PART:
            return
        place = found.end


def _proved(data: bytes, view: UInt8, offsets: Int64) -> tuple[Int64, list[tuple[int, int, int]]] | None:
    """Return all messages of a chunk by its index and the walked gaps; None unless they tile the chunk."""
    at = np.sort(offsets)
    if at[0] < 0 or at[-1] > len(data) - MESSAGE_HEAD:
        return None
    heads = _rows(view, at, MESSAGE_HEAD).view(_MESSAGE)[:, 0]
    if (heads["opcode"] != Opcode.MESSAGE).any() or (heads["length"] > len(data)).any():
        return None
    ends = at + RECORD.size + heads["length"].astype(np.int64)
    gap_first = np.concatenate(([0], ends))
    gap_last = np.concatenate((at, [len(data)]))
    if (heads["length"] < MESSAGE_HEAD - RECORD.size).any() or (gap_first > gap_last).any():
        return None
    others: list[tuple[int, int, int]] = []
    missing: list[Int64] = []
    for gap in np.flatnonzero(gap_first < gap_last).tolist():
        found = list_records(data, int(gap_first[gap]), int(gap_last[gap]), MAX_ENTRIES)
        if found.end != gap_last[gap]:
            return None
        others += found.others
        if found.messages:
            missing.append(np.frombuffer(found.messages, np.int64))
    return (np.sort(np.concatenate([at, *missing])) if missing else at), others


def find_record(data: bytes, channels: Collection[int]) -> int | None:
    """Return the first place after byte 0 of a certain chunk, or of a message of one of `channels` with a successor.

    A chunk proves itself: two of its lengths and the name of its compression agree.
    """
    view = np.frombuffer(data, np.uint8)
    places: list[int] = []
    if len(data) > CHUNK_PEEK:
        at = np.flatnonzero(view[1 : len(data) - CHUNK_PEEK] == Opcode.CHUNK) + 1
        chunks = (place for place in _sane(view, at).tolist() if is_chunk(data[place : place + CHUNK_PEEK]))
        places += [place for place in [next(chunks, None)] if place is not None]
    if channels and len(data) > MESSAGE_HEAD:
        at = np.flatnonzero(view[1 : len(data) - MESSAGE_HEAD] == Opcode.MESSAGE) + 1
        ids = frozenset(channels)
        messages = (place for place in _sane(view, at).tolist() if _is_message(data, place, ids))
        places += [place for place in [next(messages, None)] if place is not None]
    return min(places, default=None)


def _sane(view: UInt8, at: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the places whose record length has three zero high bytes."""
    if not len(at):
        return at
    return at[~_rows(view, at + 6, 3).any(axis=1)]


def is_chunk(head: bytes) -> bool:
    """Return True if a chunk certainly begins here, whatever its opcode: its lengths and compression agree."""
    fields_of = chunk_head(head)
    return fields_of is not None and fields_of.compression.encode() in _COMPRESSIONS


def _is_message(data: bytes, place: int, channels: frozenset[int]) -> bool:
    length = RECORD.unpack_from(data, place)[1]
    after = place + RECORD.size + length
    if length < MESSAGE_HEAD - RECORD.size or after + RECORD.size > len(data):
        return False
    opcode, next_length = RECORD.unpack_from(data, after)
    channel = int.from_bytes(data[place + 9 : place + 11], "little")
    return channel in channels and 0 < opcode <= Opcode.DATA_END and next_length < 1 << 40


MAX_CHUNK = 1 << 30
"""A chunk that declares more than 1 GiB is refused, compressed or not: it is held as a whole."""

_LZ4_RATIO = 255
_STEP = 1 << 16
_LOCAL = threading.local()


class CodecError(ValueError):
    """A chunk that cannot be decompressed."""


def inflate(compression: str, data: bytes, size: int, unpacking: Unpacking) -> bytes:
    """Decompress a chunk of `size` bytes, within the declared size and the limits of `unpacking`."""
    if size > MAX_CHUNK:
        raise CodecError(f"it declares {size} bytes, more than the {MAX_CHUNK} that are believed")
    if compression == "":
        return data
    if compression == "lz4" and size > _LZ4_RATIO * len(data):
        raise CodecError(f"it declares {size} bytes, more than lz4 can make of {len(data)}")
    if size > min(unpacking.room(len(data)), SMALL + CHUNK_RATIO * len(data)):
        raise CodecError(too_much(size, len(data)))
    unpacking.used(size)
    if size == 0 and not data:
        return b""
    if compression == "zstd":
        inflated = _zstd(data, size)
    elif compression == "lz4":
        inflated = _lz4(data, size)
    else:
        raise CodecError(f"its compression '{compression}' is not one of none, lz4, zstd")
    if len(inflated) != size:
        raise CodecError(f"it declares {size} bytes and holds {len(inflated)}")
    return inflated


def _zstd(data: bytes, size: int) -> bytes:
    try:
        declared = zstandard.frame_content_size(data)
        if declared not in (-1, size):
            raise CodecError(f"it declares {size} bytes and holds {declared}")
        return _decompressor().decompress(data, max_output_size=max(size, 1))
    except zstandard.ZstdError as err:
        raise CodecError(f"zstd: {err}") from err


def _decompressor() -> zstandard.ZstdDecompressor:
    """Return the decompressor of this thread: making one costs more than decompressing a small chunk."""
    if not hasattr(_LOCAL, "zstd"):
        _LOCAL.zstd = zstandard.ZstdDecompressor()
    kept: zstandard.ZstdDecompressor = _LOCAL.zstd
    return kept


def _lz4(data: bytes, size: int) -> bytes:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        inflated: bytes = decompressor.decompress(data, size + 1)
    except (RuntimeError, EOFError, ValueError) as err:
        raise CodecError(f"lz4: {err}") from err
    return inflated


def inflate_start(compression: str, data: bytes, size: int) -> bytes:
    """Decompress as much of the beginning of a damaged chunk as possible."""
    limit = min(size, SMALL + CHUNK_RATIO * len(data))
    if compression == "":
        return data[:limit]
    start = bytearray()
    try:
        if compression == "zstd":
            reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data))
            while len(start) < limit and (piece := reader.read(min(_STEP, limit - len(start)))):
                start += piece
        elif compression == "lz4":
            decompressor = lz4.frame.LZ4FrameDecompressor()
            for place in range(0, len(data), _STEP):
                start += decompressor.decompress(data[place : place + _STEP])
                if len(start) >= limit or decompressor.eof:
                    break
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError):
        pass  # what came before the damage is all there is
    return bytes(start[:limit])


PIECE = 1 << 20
"""Most bytes asked of a pipe at once: a declared size is never allocated before the bytes are there."""


class Cursor:
    """A position in a stream of bytes. A file can also be read elsewhere (`read_at`), and ends where it ended at open."""

    def __init__(self, stream: BinaryIO, size: int | None) -> None:
        self.stream = stream
        self.size = size
        """None for a pipe."""
        self.position = 0
        self._ahead = b""

    def read_at(self, offset: int, length: int) -> bytes:
        """Return bytes of a file, fewer at its end."""
        if self.size is None:
            raise ValueError("a pipe has no offsets")
        self.stream.seek(offset)
        wanted = max(0, min(length, self.size - offset))
        return _read(self.stream, wanted, wanted)

    def peek(self, length: int) -> bytes:
        """Return the next bytes without passing them; fewer only at the end. May return more."""
        missing = length - len(self._ahead)
        if missing > 0:
            if self.size is None:
                self._ahead += _read(self.stream, missing, PIECE)
            else:
                self._ahead = self.read_at(self.position, max(length, 1 << 12))
        return self._ahead

    def take(self, length: int) -> bytes:
        """Pass the next bytes and return them; fewer only at the end."""
        data = self._ahead[:length]
        if len(data) < length:
            more = length - len(data)
            if self.size is None:
                data += _read(self.stream, more, PIECE)
            else:
                data = self.read_at(self.position, length)
        self._ahead = self._ahead[length:]
        self.position += len(data)
        return data

    def back(self, data: bytes) -> None:
        """Undo `take`."""
        self._ahead = data + self._ahead if self.size is None else b""
        self.position -= len(data)

    def skip(self, length: int) -> int:
        """Pass the next bytes; return their number."""
        if self.size is not None:
            return self._seek(min(length, self.size - self.position))
        passed = 0
        while passed < length:
            step = len(self.take(min(length - passed, PIECE)))
            if not step:
                break
            passed += step
        return passed

    def _seek(self, step: int) -> int:
        self._ahead = self._ahead[step:]
        self.position += step
        return step


def _read(stream: BinaryIO, length: int, piece: int) -> bytes:
    """Return exactly `length` bytes unless the stream ends."""
    pieces = []
    while length > 0:
        data = stream.read(min(length, piece))
        if not data:
            break
        pieces.append(data)
        length -= len(data)
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)
