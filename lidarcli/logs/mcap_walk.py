"""A pass over an MCAP from record to record: chunks, messages and definitions, and the ways past damage.

The walk goes in file order, whatever the index says: an index only saves work, so that a missing, partial or lying one
loses nothing. One chunk is held at a time; one that declares more than 1 GiB is refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Generator, Iterator
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from lidarcli.logs.base import CLOUD_TYPES, POSE_TYPES, SCAN_TYPES, ReadReport, ros_type
from lidarcli.logs.mcap_records import (
    CHUNK_PEEK,
    ENTRY,
    MAGIC,
    MAX_SMALL,
    MESSAGE_HEAD,
    PART,
    RECORD,
    ChannelCatalogue,
    ChunkHead,
    McapMessages,
    McapSummary,
    RecordCursor,
    chunk_head,
    find_record,
    inflate_start,
    is_chunk,
    list_indexed,
    list_records,
    skippable_chunks,
)
from lidarcli.logs.unpacking import MAX_CHUNK, CodecError, DecompressionBudget, inflate
from lidarcli.sweeps.types import Int64
from lidarcli.system.records import dataclass, field

WINDOW = 1 << 20
"""Bytes looked at together where messages stand outside chunks, or where a way past damage is sought."""

_FAR = 1 << 62
_CUT = "the log is cut off here, inside a record"
_SMALL = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE_INDEX)
_KEPT = (Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA)
_PRIVATE = 0x80
_END_LENGTHS = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}

UNKNOWN = -2
UNWANTED = -1


class OtherRecord(NamedTuple):
    """A header, an attachment, metadata, or the record of an application."""

    opcode: int
    content: bytes


class Wanted:
    """The channels that a pass reads: topics of sweeps, or all channels of some types."""

    def __init__(
        self, catalogue: ChannelCatalogue, topics: Collection[str] | None = None, types: Collection[str] | None = None
    ):
        """`topics` None: every topic of sweeps; `types` None: sweeps."""
        self.first: list[int] = []
        """A channel of each group. A group has one topic, type and encoding: publishers share it, so that their sweeps
        stay in the order of the log; protobuf brings its own types."""
        self._catalogue, self._topics, self._types = catalogue, topics, types
        self._groups = np.full(1 << 16, UNKNOWN, np.int32)
        self._known = 0, 0
        self._numbers: dict[tuple[str, str, str, int], int] = {}

    def groups(self) -> NDArray[np.int32]:
        """Return the group of every channel id: `UNWANTED`, or `UNKNOWN` where its type is not known so far."""
        catalogue = self._catalogue
        known = len(catalogue.channels), len(catalogue.schemas)
        if self._known != known:
            self._known = known
            for key in catalogue.channels:
                if self._groups[key] == UNKNOWN and catalogue.knows(key):
                    self._groups[key] = self._group(key)
        return self._groups

    def _group(self, key: int) -> int:
        channel, kind = self._catalogue.channels[key], self._catalogue.type(key)
        if self._types is not None:
            wanted = kind in self._types
        else:
            wanted = self._catalogue.read_as(key) != "" and (self._topics is None or channel.topic in self._topics)
        if not wanted:
            return UNWANTED
        own_types = channel.schema_id if channel.message_encoding == "protobuf" else 0
        number = self._numbers.setdefault((channel.topic, kind, channel.message_encoding, own_types), len(self.first))
        if number == len(self.first):
            self.first.append(key)
        return number


@dataclass(slots=True)
class _Chunk:
    """A chunk that has been passed, and what the message indexes behind it say so far."""

    place: int
    head: ChunkHead
    data: bytes | None
    """None where it can be read again (files)."""
    offsets: dict[int, Int64] = field(default_factory=dict)
    """Channel → offsets of its messages in the chunk."""
    sound: bool = True

    @property
    def counts(self) -> dict[int, int]:
        """Messages by channel, as far as the indexes can be used."""
        return {channel: len(offsets) for channel, offsets in self.offsets.items()} if self.sound else {}


@dataclass(slots=True)
class Walk:
    """One pass from record to record: definitions go to the catalogue, damage to the report."""

    source: RecordCursor
    catalogue: ChannelCatalogue
    report: ReadReport
    summary: McapSummary | None
    """Its chunk positions are a way past damage, never a reason to leave a record out."""
    wanted: Wanted | None
    """None: all messages, and `OtherRecord`s."""
    counting: bool = False
    """Pass over every chunk whose index counts known channels; `skipped` has the counts."""
    skipped: Counter[int] = field(default_factory=Counter)
    """Messages by channel of the chunks that were passed over."""
    compressions: dict[str, None] = field(default_factory=dict)
    _budget: DecompressionBudget = field(default_factory=DecompressionBudget)
    _skippable: frozenset[int] | None = None
    _cut: bool = False
    _recovered: bool = False
    _chunks: int = 0
    _unknown: int = 0

    def records(self) -> Iterator[McapMessages | OtherRecord]:
        """Yield all messages, in file order, and without `wanted` the other records that a copy keeps."""
        if not self.source.position:
            self.source.skip(len(MAGIC))
        try:
            yield from self._records()
        except OSError as err:
            self._damage(self.source.position, f"cannot be read: {err.strerror or err}")
        if self._unknown:
            self.report.notes.append(f"{self._unknown} records of unknown kinds were ignored")

    def _records(self) -> Iterator[McapMessages | OtherRecord]:
        chunk: _Chunk | None = None
        for place, opcode, length in self._heads():
            if opcode == Opcode.MESSAGE_INDEX:
                self._take_index(chunk, place, self.source.take(RECORD.size + length)[RECORD.size :])
                continue
            if chunk is not None:
                yield from self._read(chunk)
                chunk = None
            if opcode == Opcode.CHUNK:
                chunk = self._pass_chunk(place, length)
            elif opcode == Opcode.MESSAGE:
                yield from self._read_plain(place, length)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = self.source.take(RECORD.size + length)
                if not self._is_cut(place, len(content), RECORD.size + length):
                    self._define([(opcode, RECORD.size, len(content))], content, f"byte {place}")
            elif self.wanted is None and (opcode in _KEPT or opcode >= _PRIVATE):
                content = self.source.take(RECORD.size + length)[RECORD.size :]
                if not self._is_cut(place, len(content), length):
                    yield OtherRecord(opcode, content)
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
        if opcode == Opcode.CHUNK:
            if chunk_head(self.source.peek(CHUNK_PEEK)) is None:
                return _CUT if left is not None and left < CHUNK_PEEK else "a chunk whose lengths contradict each other"
            if length > MAX_CHUNK + CHUNK_PEEK:
                return f"a chunk of {length} bytes, more than the {MAX_CHUNK} that are believed"
        after = self._next_chunk(place)
        if after < min(end, _FAR) and is_chunk(self.source.read_at(after, CHUNK_PEEK)):
            return f"a record that declares {length} bytes and runs into the chunk at byte {after}"
        small = opcode in _SMALL or (opcode == Opcode.MESSAGE and left is None)
        if length > (MAX_SMALL if small else 1 << 40):
            return f"a record that declares {length} bytes"
        return _CUT if left is not None and length + RECORD.size > left and opcode != Opcode.CHUNK else None

    def _next_chunk(self, place: int) -> int:
        """Return the position of the next chunk after `place` by the summary; far away without one."""
        offsets = () if self.summary is None else self.summary.chunk_offsets
        at = int(np.searchsorted(offsets, place, side="right"))
        return int(offsets[at]) if at < len(offsets) else _FAR

    def _recover(self, place: int, wrong: str) -> bool:
        """Go to the next readable place; False if there is none."""
        self._recovered = True
        after = self._next_chunk(place)
        while after != _FAR and not is_chunk(self.source.read_at(after, CHUNK_PEEK)):
            after = self._next_chunk(after)
        if after != _FAR:
            self.source.skip(after - place)
        elif not self._search():
            self._damage(place, _CUT if wrong == _CUT else f"{wrong}; nothing readable follows")
            return False
        wrong = "a record that runs beyond the end" if wrong == _CUT else wrong
        self._damage(place, f"{wrong}; reading goes on at byte {self.source.position}")
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
            self.source.skip(len(window) - ((1 << 16) if len(window) == WINDOW else 0))
            if len(window) < WINDOW:
                return False

    def _read_plain(self, place: int, length: int) -> Iterator[McapMessages]:
        """Yield messages outside chunks: all whole ones of a window."""
        if length > MAX_SMALL:
            self.report.notes.append(f"a message of {length} bytes at byte {place} was passed over")
            self._is_cut(place, self.source.skip(RECORD.size + length), RECORD.size + length)
            return
        window = self.source.peek(max(WINDOW, RECORD.size + length))
        found = list_records(window, 0, min(len(window), self._next_chunk(place) - place), messages_only=True)
        if len(found.messages):
            self.source.skip(found.end)
            yield found.messages
        else:
            self._cut = not self._recover(place, _CUT)

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
            self._cut = len(record) < whole
            return _Chunk(place, head, record[head.data_at :])
        self._cut = self.source.skip(whole) < whole
        return _Chunk(place, head, None)

    def _take_index(self, chunk: _Chunk | None, place: int, content: bytes) -> None:
        """Note a message index for the chunk before it."""
        if chunk is None:
            if not self._recovered:
                self._damage(place, "a message index without its chunk: a chunk before it is lost")
                self._recovered = True
            return
        channel, size = int.from_bytes(content[:2], "little"), int.from_bytes(content[2:6], "little")
        if len(content) < 6 or size % 16 or 6 + size > len(content) or channel in chunk.offsets:
            chunk.sound = False
        else:
            chunk.offsets[channel] = np.frombuffer(content, ENTRY, size // 16, 6)["offset"].astype(np.int64)

    def _is_unwanted(self, chunk: _Chunk) -> bool:
        """Return True if a chunk may be passed over, which is counted then."""
        counts = chunk.counts
        if self.wanted is None or not counts or self._cut:
            return False
        groups = self.wanted.groups()
        if any(groups[channel] != UNWANTED for channel in counts):
            return False
        if not self.counting:
            if self._skippable is None:
                self._skippable = skippable_chunks(self.source, self.summary, set(np.flatnonzero(groups >= 0).tolist()))
            if chunk.place not in self._skippable:
                return False
        self.skipped.update(counts)
        return True

    def _read(self, chunk: _Chunk) -> Iterator[McapMessages]:
        """Yield the messages of a chunk, unless it may be passed over."""
        if self._is_unwanted(chunk):
            return
        place, head, data = chunk.place, chunk.head, b""
        try:
            data = chunk.data if chunk.data is not None else self.source.read_at(place + head.data_at, head.data_length)
            if len(data) < head.data_length:
                count, _ = yield from self._messages_of(place, inflate_start(head, data), [])
                cause = f"inside the chunk at byte {place}: {count} whole messages of it are read"
                self._damage(place + head.data_at + len(data), f"the log is cut off here, {cause}")
                return
            content = inflate(data, head.compression, head.size, head.crc, self._budget)
        except (CodecError, OSError, MemoryError) as err:
            lost = f", {sum(chunk.counts.values())} messages are lost" if chunk.counts else ""
            self._damage(place, f"the chunk cannot be read: {err or 'out of memory'}{lost}", "chunk at byte")
            self._rescue_definitions(chunk, data)
            return
        _, end = yield from self._messages_of(place, content, [*chunk.offsets.values()] if chunk.sound else [])
        if end < len(content):
            self._damage(place, f"no record at byte {end} of its {len(content)}", "chunk at byte")

    def _messages_of(
        self, place: int, content: bytes, offsets: list[Int64]
    ) -> Generator[McapMessages, None, tuple[int, int]]:
        """Yield the messages of a chunk's bytes, take in what it defines; return their count and where records end."""
        indexed = list_indexed(content, np.concatenate(offsets)) if offsets else None
        count = end = 0
        while True:
            found = indexed or list_records(content, end, len(content))
            self._define(found.others, content, f"chunk at byte {place}")
            yield found.messages
            count, end = count + len(found.messages), found.end
            if indexed or len(found.messages) < PART:
                return count, end

    def _rescue_definitions(self, chunk: _Chunk, data: bytes) -> None:
        """Recover channels that only a damaged chunk described, if they name a known type."""
        start = inflate_start(chunk.head, data, 1 << 24)
        doubtful = ChannelCatalogue()
        for opcode, first, end in list_records(start, 0, len(start)).others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                doubtful.add(opcode, start[first:end])
        for key, channel in doubtful.channels.items():
            schema = doubtful.schema(key) or self.catalogue.schemas.get(channel.schema_id)
            if key in self.catalogue.channels or schema is None:
                continue
            if ros_type(schema.name) in SCAN_TYPES | CLOUD_TYPES | POSE_TYPES:
                self.catalogue.schemas.setdefault(schema.id, schema)
                self.catalogue.channels[key] = channel
                note = f"{channel.topic} is described only in the damaged chunk at byte {chunk.place}"
                self.report.notes.append(note)

    def _define(self, others: list[tuple[int, int, int]], data: bytes, where: str) -> None:
        for opcode, first, end in others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not self.catalogue.add(opcode, data[first:end]):
                self.report.add_damage(where, "a channel or schema that cannot be understood")

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
