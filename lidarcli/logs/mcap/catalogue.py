"""What an MCAP says about itself: its channels and schemas as they are met, and its summary."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from lidarcli.logs.base import ReadReport, ros_type
from lidarcli.logs.mcap.cursor import Cursor
from lidarcli.logs.mcap.records import MAX_SMALL, RECORD, list_records
from lidarcli.sweeps import Int64

MAGIC = b"\x89MCAP0\r\n"
MAX_SUMMARY = 1 << 28
"""A summary of more bytes than this is not used."""

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
        """The schema of a channel, where both are known."""
        known = self.channels.get(channel)
        return None if known is None else self.schemas.get(known.schema_id)

    def knows(self, channel: int) -> bool:
        """Whether a channel's type can be told: its record is there, and its schema if it has one."""
        known = self.channels.get(channel)
        return known is not None and (known.schema_id == 0 or known.schema_id in self.schemas)

    def type(self, channel: int) -> str:
        """The type as `ros_type` spells it, empty where unknown."""
        schema = self.schema(channel)
        return "" if schema is None else ros_type(schema.name)


@dataclass(slots=True)
class Summary:
    """The end of an MCAP that was closed properly."""

    catalogue: Catalogue = field(default_factory=Catalogue)
    counts: dict[int, int] | None = None
    """Messages by channel; None without statistics."""
    chunks: list[ChunkIndex] = field(default_factory=list)
    """In file order."""
    chunk_offsets: Int64 = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def chunk_places(self) -> frozenset[int]:
        """Where chunks begin, if no place is named twice."""
        places = frozenset(self.chunk_offsets.tolist())
        return places if len(places) == len(self.chunks) else frozenset()

    @property
    def sane(self) -> bool:
        """Whether its channels can be taken for all channels of the log."""
        known = self.catalogue
        ids = set(known.channels) | set(self.counts or ())
        return all(map(known.knows, ids)) and (self.counts is not None or bool(known.channels))


def parse(read: Callable[[ReadDataStream], T], content: bytes) -> T | None:
    """A record's content through the `mcap` library; None where it cannot be understood."""
    try:
        return read(ReadDataStream(io.BytesIO(content)))
    except _UNPARSABLE:
        return None


def read_summary(source: Cursor, report: ReadReport) -> Summary | None:
    """The summary of a file; None where the log was not closed, or where its summary is damaged.

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
        report.add_damage(
            f"footer at byte {footer_at}", f"its summary cannot begin at byte {start}; not used"
        )
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
    """Whether the message indexes of all chunks together count what the statistics count, for each wanted channel.

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
