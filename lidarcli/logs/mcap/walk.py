"""One pass over an MCAP in file order, whatever it is: indexed, unindexed, cut off or piped; and its summary."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from lidarcli.logs.base import CLOUD_TYPES, POSE_TYPES, SCAN_TYPES, ReadReport, ros_type
from lidarcli.logs.mcap.records import (
    CHUNK_PEEK,
    MAX_CHUNK,
    MAX_ENTRIES,
    MAX_SMALL,
    MESSAGE_HEAD,
    RECORD,
    ChunkHead,
    CodecError,
    Cursor,
    Messages,
    chunk_head,
    find_record,
    index_entries,
    inflate,
    inflate_start,
    is_chunk,
    list_records,
    messages_at,
    stretches,
)
from lidarcli.logs.unpacking import Unpacking
from lidarcli.sweeps import Int64

MAGIC = b"\x89MCAP0\r\n"
MAX_SUMMARY = 1 << 28
"""Longest summary that is used [bytes]."""

_FOOTER = struct.Struct("<BQQQI")
T = TypeVar("T")
_UNPARSABLE = (McapError, struct.error, ValueError, MemoryError, OverflowError)


@dataclass(slots=True)
class Catalogue:
    """Channels and schemas by their ids; the first definition of an id counts."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    changes: int = 0
    """Grows with every definition, so that what was derived can be derived anew."""

    def add(self, opcode: int, content: bytes) -> bool:
        """Take a Schema or Channel record's content; False where it cannot be understood."""
        if opcode == Opcode.CHANNEL:
            channel = parse(Channel.read, content)
            return channel is not None and self._put(self.channels, channel.id, channel)
        schema = parse(Schema.read, content)
        return schema is not None and self._put(self.schemas, schema.id, schema)

    def define(self, schema: Schema, channel: Channel) -> None:
        """Take a channel with its schema."""
        self._put(self.schemas, schema.id, schema)
        self._put(self.channels, channel.id, channel)

    def _put(self, definitions: dict[int, Any], key: int, definition: object) -> bool:
        if key not in definitions:
            definitions[key] = definition
            self.changes += 1
        return True

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


@dataclass(slots=True)
class Summary:
    """Summary section of an MCAP that was closed properly."""

    catalogue: Catalogue = field(default_factory=Catalogue)
    counts: dict[int, int] | None = None
    """Number of messages by channel; None without statistics."""
    chunks: list[ChunkIndex] = field(default_factory=list)
    """Chunk indexes in file order."""
    chunk_offsets: Int64 = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def chunk_places(self) -> frozenset[int]:
        """Positions of chunks, if no position is named twice."""
        places = frozenset(self.chunk_offsets.tolist())
        return places if len(places) == len(self.chunks) else frozenset()

    @property
    def sane(self) -> bool:
        """True if its channels can be taken for all channels of the log."""
        known = self.catalogue
        ids = set(known.channels) | set(self.counts or ())
        return all(map(known.knows, ids)) and (self.counts is not None or bool(known.channels))


def parse(read: Callable[[ReadDataStream], T], content: bytes) -> T | None:
    """Parse the content of a record with the `mcap` library; None if that fails."""
    try:
        return read(ReadDataStream(io.BytesIO(content)))
    except _UNPARSABLE:
        return None


def read_summary(source: Cursor, report: ReadReport) -> Summary | None:
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
        return Summary()
    if not len(MAGIC) <= start <= footer_at or footer_at - start > MAX_SUMMARY:
        report.add_damage(f"footer at byte {footer_at}", f"its summary cannot begin at byte {start}; not used")
        return None
    data = source.read_at(start, footer_at - start)
    if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(data)) != crc:
        report.add_damage(f"summary at byte {start}", "its checksum does not hold; not used")
        return None
    return _summary(data)


def _summary(data: bytes) -> Summary:
    summary = Summary()
    place = 0
    while True:
        found = list_records(data, place, len(data))
        for opcode, first, end in found.others:
            content = data[first:end]
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                summary.catalogue.add(opcode, content)
            elif opcode == Opcode.STATISTICS:
                statistics = parse(Statistics.read, content)
                summary.counts = None if statistics is None else statistics.channel_message_counts
            elif opcode == Opcode.CHUNK_INDEX and (chunk := parse(ChunkIndex.read, content)) is not None:
                summary.chunks.append(chunk)
        if found.end in (place, len(data)):
            break
        place = found.end
    summary.chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
    offsets = {min(chunk.chunk_start_offset, 2**62) for chunk in summary.chunks}
    summary.chunk_offsets = np.array(sorted(offsets), np.int64)
    return summary


def index_is_complete(source: Cursor, summary: Summary, wanted: set[int]) -> bool:
    """Return True if the message indexes of all chunks agree with the statistics, for each wanted channel.

    Only then may a chunk be passed over because its index does not mention a wanted channel.
    """
    if summary.counts is None:
        return False
    seen = dict.fromkeys(wanted, 0)
    for chunk in summary.chunks:
        after = chunk.chunk_start_offset + chunk.chunk_length
        if chunk.message_index_length > MAX_SMALL or after > (source.size or 0):
            return False
        data = source.read_at(after, chunk.message_index_length)
        for opcode, first, end in list_records(data, 0, len(data)).others:
            if opcode == Opcode.MESSAGE_INDEX and end - first >= 6:
                channel, size = struct.unpack_from("<HI", data, first)
                if channel in seen:
                    seen[channel] += size // 16
    return all(summary.counts.get(channel, 0) == count for channel, count in seen.items())


WINDOW = 1 << 20
"""Bytes looked at together where messages stand outside chunks, or where a way past damage is sought."""
FREE_MESSAGES = 100_000
"""Messages read of any log; beyond these, one per byte of the log."""
RESCUED = 1 << 24
"""Bytes of a damaged chunk in which channels are looked for."""
MAX_RECORD = 1 << 40
"""A record of a pipe that declares more bytes than this is damaged; of a file, the file's size tells."""

_OVERLAP = 1 << 16
_FAR = 1 << 62
_CUT = "the log is cut off here, inside a record"
_OVERRUN = "a record that runs beyond the end"
_SMALL = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE_INDEX)
_KEPT = (Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA)
_PRIVATE = 0x80
"""Opcodes from here on are those of applications."""
_END_LENGTHS = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}


@dataclass(slots=True)
class _Chunk:
    """A chunk that has been passed, and the message indexes that followed it so far."""

    place: int
    head: ChunkHead
    data: bytes | None
    """None where it can be read again (files)."""
    offsets: dict[int, Int64] = field(default_factory=dict)
    entries: int = 0
    """Messages that its indexes count."""
    sound: bool = True
    """True while its indexes can be used."""


@dataclass(slots=True)
class Walker:
    """Goes from record to record and yields the messages; definitions go to the catalogue, damage to the report."""

    source: Cursor
    catalogue: Catalogue
    report: ReadReport
    chunk_offsets: Int64
    """Chunk positions by the summary: a way past damage, never a reason to leave a record out."""
    skip: Callable[[int, Mapping[int, int]], bool]
    """Predicate: may the chunk at this byte, with these message counts by channel, be skipped?"""
    compressions: dict[str, None] = field(default_factory=dict)
    others: Callable[[int, bytes], None] | None = None
    """Takes the records that are of no use for sweeps, opcode and content, when their turn comes."""
    index_lies: bool = False
    """True after a message index that disagreed with its chunk."""
    _messages: int = 0
    _unpacking: Unpacking = field(default_factory=Unpacking)
    _cut: bool = False
    _recovered: bool = False
    _chunks: int = 0
    _nested: int = 0
    _unknown: int = 0

    def parts(self) -> Iterator[Messages]:
        """Yield all messages, in file order."""
        if not self.source.position:
            self.source.skip(len(MAGIC))
        try:
            yield from self._parts()
        except OSError as err:
            self._damage(self.source.position, f"cannot be read: {err.strerror or err}")
        for count, what in (
            (self._nested, "chunks inside chunks were ignored"),
            (self._unknown, "records of unknown kinds were ignored"),
        ):
            if count:
                self.report.notes.append(f"{count} {what}")

    def _parts(self) -> Iterator[Messages]:
        chunk: _Chunk | None = None
        for place, opcode, length in self._heads():
            if opcode == Opcode.MESSAGE_INDEX:
                self._index(chunk, place, self.source.take(RECORD.size + length)[RECORD.size :])
                continue
            if chunk is not None:
                yield from self._read(chunk)
                chunk = None
            if opcode == Opcode.CHUNK:
                chunk = self._pass_chunk(place, length)
            elif opcode == Opcode.MESSAGE:
                yield from self._run(place, length)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = self.source.take(RECORD.size + length)
                if not self._is_cut(place, len(content), RECORD.size + length):
                    self._define([(opcode, RECORD.size, len(content))], content, f"byte {place}")
            elif self.others is not None and (opcode in _KEPT or opcode >= _PRIVATE):
                content = self.source.take(RECORD.size + length)[RECORD.size :]
                if not self._is_cut(place, len(content), length):
                    self.others(opcode, content)
            else:
                self._unknown += Opcode.DATA_END < opcode < _PRIVATE
                self._is_cut(place, self.source.skip(RECORD.size + length), RECORD.size + length)
        if chunk is not None:
            yield from self._read(chunk)

    def _heads(self) -> Iterator[tuple[int, int, int]]:
        """Yield place, opcode and length of each record that can be one, which the caller passes; leads past damage."""
        while not self._cut:
            place = self.source.position
            head = self.source.peek(RECORD.size)
            if len(head) < RECORD.size:
                self._damage(place, "the log is cut off here" if head else "the log ends here without an end mark")
                return
            opcode, length = RECORD.unpack_from(head)
            if _END_LENGTHS.get(opcode) == length:
                self._finish(place)
                return
            if opcode != Opcode.CHUNK and is_chunk(self.source.peek(CHUNK_PEEK)):
                self._damage(place, f"a chunk whose opcode is {opcode}; read as a chunk")
                opcode = Opcode.CHUNK
            wrong = self._wrong(place, opcode, length)
            if wrong is None:
                yield place, opcode, length
            elif not self._recover(place, wrong):
                return

    def _wrong(self, place: int, opcode: int, length: int) -> str | None:
        """Return why no record of this kind and length can begin here; None if one can."""
        end = place + RECORD.size + length
        left = None if self.source.size is None else self.source.size - place
        if opcode == 0:
            return "no record begins here"
        if opcode == Opcode.MESSAGE and length < MESSAGE_HEAD - RECORD.size:
            return f"a message of {length} bytes"
        if opcode in _SMALL and length > MAX_SMALL:
            return f"a record that declares {length} bytes"
        if opcode == Opcode.CHUNK:
            if chunk_head(self.source.peek(CHUNK_PEEK)) is None:
                return _CUT if left is not None and left < CHUNK_PEEK else "a chunk whose lengths contradict each other"
            if length > MAX_CHUNK + CHUNK_PEEK:
                return f"a chunk of {length} bytes, more than the {MAX_CHUNK} that are believed"
        after = self._next_chunk(place)
        if after < min(end, _FAR) and self._chunk_at(after):
            return f"a record that declares {length} bytes and runs into the chunk at byte {after}"
        if left is None:
            most = MAX_SMALL if opcode == Opcode.MESSAGE else MAX_RECORD
            return f"a record that declares {length} bytes" if length > most else None
        return _CUT if end > place + left and opcode != Opcode.CHUNK else None

    def _next_chunk(self, place: int) -> int:
        """Return the position of the next chunk after `place` by the summary; far away without one."""
        at = int(np.searchsorted(self.chunk_offsets, place, side="right"))
        return int(self.chunk_offsets[at]) if at < len(self.chunk_offsets) else _FAR

    def _chunk_at(self, place: int) -> bool:
        """Return True if a chunk begins at this byte of a file."""
        return is_chunk(self.source.read_at(place, CHUNK_PEEK))

    def _record_follows(self) -> bool:
        """Return True if a record, or the end, may come next."""
        head = self.source.peek(RECORD.size)
        if len(head) < RECORD.size:
            return not head
        opcode, length = RECORD.unpack_from(head)
        left = MAX_RECORD if self.source.size is None else self.source.size - self.source.position
        return bool((0 < opcode <= Opcode.DATA_END or opcode >= 0x80) and length <= left)

    def _recover(self, place: int, wrong: str) -> bool:
        """Go to the next readable place; False if there is none."""
        self._recovered = True
        after = self._next_chunk(place)
        while after != _FAR and not self._chunk_at(after):
            after = self._next_chunk(after)
        if after != _FAR:
            self.source.skip(after - place)
        elif not self._search():
            self._damage(place, _CUT if wrong == _CUT else f"{wrong}; nothing readable follows")
            return False
        self._damage(place, f"{_OVERRUN if wrong == _CUT else wrong}; reading goes on at byte {self.source.position}")
        return True

    def _search(self) -> bool:
        """Pass all bytes up to what proves itself to be a chunk, or a message where no chunks are used."""
        channels = () if self._chunks else self.catalogue.channels.keys()
        while True:
            window = self.source.peek(WINDOW)[:WINDOW]
            found = find_record(window, channels)
            if found is not None:
                self.source.skip(found)
                return True
            self.source.skip(max(len(window) - (_OVERLAP if len(window) == WINDOW else 0), 0))
            if len(window) < WINDOW:
                return False

    def _run(self, place: int, length: int) -> Iterator[Messages]:
        """Yield messages outside chunks: all whole ones of a window, or a single large one."""
        window = self.source.peek(WINDOW)
        found = list_records(window, 0, min(len(window), self._next_chunk(place) - place), messages_only=True)
        if found.messages:
            self.source.skip(found.end)
            yield messages_at(np.frombuffer(window, np.uint8), np.frombuffer(found.messages, np.int64))
        elif length <= MAX_SMALL:
            record = self.source.take(RECORD.size + length)
            cut = len(record) < RECORD.size + length
            if not cut and self._record_follows():
                yield messages_at(np.frombuffer(record, np.uint8), np.zeros(1, np.int64))
                return
            self.source.back(record)
            wrong = _CUT if cut else f"a record that declares {length} bytes, after which no record begins"
            self._cut = not self._recover(place, wrong)
        else:
            self.report.notes.append(f"a message of {length} bytes at byte {place} was passed over")
            self._is_cut(place, self.source.skip(RECORD.size + length), RECORD.size + length)

    def _pass_chunk(self, place: int, length: int) -> _Chunk:
        head = chunk_head(self.source.peek(CHUNK_PEEK))
        if head is None:
            raise RuntimeError("a chunk is passed only after it has been checked")
        self._chunks += 1
        self._recovered = False
        self.compressions[head.compression or "none"] = None
        whole = RECORD.size + length
        if self.source.size is None:
            record = self.source.take(whole)
            chunk = _Chunk(place, head, record[head.data_at :])
            self._cut = len(record) < whole
        else:
            chunk = _Chunk(place, head, None)
            self._cut = self.source.skip(whole) < whole
        return chunk

    def _index(self, chunk: _Chunk | None, place: int, content: bytes) -> None:
        """Note a message index for the chunk before it."""
        if chunk is None:
            if not self._recovered:
                self._damage(place, "a message index without its chunk: a chunk before it is lost")
                self._recovered = True
            return
        entries = index_entries(content)
        if entries is None or len(entries[1]) > MAX_ENTRIES or entries[0] in chunk.offsets:
            chunk.sound = False
        elif chunk.sound:
            chunk.offsets[entries[0]] = entries[1]
            chunk.entries += len(entries[1])
            chunk.sound = chunk.entries <= MAX_ENTRIES

    def _read(self, chunk: _Chunk) -> Iterator[Messages]:
        """Yield the messages of a chunk, unless it may be passed over."""
        head, counts = chunk.head, {channel: len(offsets) for channel, offsets in chunk.offsets.items()}
        if chunk.sound and counts and not self._cut and self.skip(chunk.place, counts):
            return
        if self._is_beyond_belief(chunk, 0):
            return
        data = b""
        try:
            data = chunk.data if chunk.data is not None else self._data(chunk)
            if len(data) < head.data_length:
                yield from self._read_cut(chunk, data)
                return
            content = inflate(head.compression, data, head.size, self._unpacking)
            if head.crc and zlib.crc32(content) != head.crc:
                raise CodecError("its checksum does not hold")
        except (CodecError, OSError, MemoryError) as err:
            lost = f", {sum(counts.values())} messages are lost" if chunk.sound and counts else ""
            self._damage(chunk.place, f"the chunk cannot be read: {err or 'out of memory'}{lost}", "chunk at byte")
            self._rescue_definitions(chunk, data)
            return
        offsets = np.concatenate(list(chunk.offsets.values())) if chunk.sound and counts else None
        seen = end = 0
        for found in stretches(content, offsets):
            self._define(found.others, content, f"chunk at byte {chunk.place}")
            yield found.messages
            seen, end = seen + len(found.messages), found.end
            self._messages += len(found.messages)
            if self._is_beyond_belief(chunk, seen):
                return
        if end < len(content):
            self._damage(chunk.place, f"no record at byte {end} of its {len(content)}", "chunk at byte")
        if offsets is not None and len(offsets) != seen and not self.index_lies:
            self.index_lies = True
            self.report.notes.append(
                f"the message index of the chunk at byte {chunk.place} counts {len(offsets)} messages where "
                f"{seen} are: the records are believed"
            )

    def _is_beyond_belief(self, chunk: _Chunk, seen: int) -> bool:
        """Return True after more messages than any compression can hide in the bytes so far."""
        beyond = self._messages > FREE_MESSAGES + self.source.position
        if beyond:
            cause = f"more messages than bytes, which is not believed: {seen:,} of it are read, the rest is lost"
            self._damage(chunk.place, cause, "chunk at byte")
        return beyond

    def _rescue_definitions(self, chunk: _Chunk, data: bytes) -> None:
        """Recover channels that only a damaged chunk described, if they name a known type."""
        start = inflate_start(chunk.head.compression, data, min(chunk.head.size, RESCUED))
        doubtful = Catalogue()
        for opcode, first, end in list_records(start, 0, len(start)).others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                doubtful.add(opcode, start[first:end])
        for key, channel in doubtful.channels.items():
            schema = doubtful.schema(key) or self.catalogue.schemas.get(channel.schema_id)
            if (
                key not in self.catalogue.channels
                and schema
                and ros_type(schema.name) in SCAN_TYPES | CLOUD_TYPES | POSE_TYPES
            ):
                self.catalogue.define(schema, channel)
                note = f"{channel.topic} is described only in the damaged chunk at byte {chunk.place}"
                self.report.notes.append(note)

    def _data(self, chunk: _Chunk) -> bytes:
        return self.source.read_at(chunk.place + chunk.head.data_at, chunk.head.data_length)

    def _read_cut(self, chunk: _Chunk, data: bytes) -> Iterator[Messages]:
        """Yield the whole messages of a chunk that the end of the log cuts off."""
        content = inflate_start(chunk.head.compression, data, chunk.head.size)
        seen = 0
        for found in stretches(content, None):
            self._define(found.others, content, f"chunk at byte {chunk.place}")
            yield found.messages
            seen += len(found.messages)
        self._damage(
            chunk.place + chunk.head.data_at + len(data),
            f"the log is cut off here, inside the chunk at byte {chunk.place}: {seen} whole messages of it are read",
        )

    def _define(self, others: list[tuple[int, int, int]], data: bytes, where: str) -> None:
        """Take in what is not a message."""
        for opcode, first, end in others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                if not self.catalogue.add(opcode, data[first:end]):
                    self.report.add_damage(where, "a channel or schema that cannot be understood")
            else:
                self._nested += opcode == Opcode.CHUNK

    def _is_cut(self, place: int, have: int, length: int) -> bool:
        """Return True if the log ended inside the record just passed."""
        if have < length:
            self._cut = True
            self._damage(place, _CUT)
        return self._cut

    def _finish(self, place: int) -> None:
        """Check that the log was closed: of a pipe the rest is passed, of a file only the end counts."""
        if self.source.size is not None:
            tail = self.source.read_at(self.source.size - len(MAGIC), len(MAGIC))
            self.source.skip(self.source.size)
        else:
            tail = b""
            while piece := self.source.take(WINDOW):
                tail = (tail + piece)[-len(MAGIC) :]
        if tail != MAGIC:
            self._damage(place, "the log is cut off in its summary, after the last message; no message is lost")

    def _damage(self, place: int, cause: str, where: str = "byte") -> None:
        self.report.add_damage(f"{where} {place}", cause)
