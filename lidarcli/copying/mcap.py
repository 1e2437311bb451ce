"""Copies of MCAP files: ids, times, attachments and metadata stay; chunks and index are made anew."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from lidarcli.copying.copies import Copy
from lidarcli.logs.blocks import Locate
from lidarcli.logs.mcap.log import McapLog
from lidarcli.logs.mcap.records import MESSAGE_HEAD, RECORD, Messages
from lidarcli.logs.mcap.walk import MAGIC, Catalogue, Walker, parse
from lidarcli.logs.unpacking import ZSTD_MAGIC, Unpacking, unpack_message

CHUNK = 1 << 20
"""Bytes of a chunk before it is packed."""

_PACK: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "lz4": lz4.frame.compress,
    "zstd": lambda data: zstandard.ZstdCompressor().compress(data),
}
_FOOTER = struct.Struct("<BQQQ")
_KNOWN = (Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA)


def copy_mcap(log: McapLog, out: BinaryIO, copy: Copy) -> None:
    """Write an MCAP once more."""
    file = _File(out)

    def others(opcode: int, content: bytes) -> None:
        if opcode in _KNOWN:
            file.record(opcode, content)
        else:
            copy.left_out += 1

    walker, known, parts = log.everything(others, copy.report)
    writing = _Writing(file, walker, known)
    unpacking = Unpacking()
    locators: dict[int, Locate | None] = {}
    for part in parts:
        for row, key in enumerate(part.channel.tolist()):
            channel = known.channels.get(key)
            if channel is None:
                continue
            if key not in locators:
                locators[key] = log.locator(key)
            head, data = _message(part, row)
            locate = locators[key]
            if locate is not None:
                data = edited(copy, channel.topic, data, locate, unpacking)
            copy.messages[channel.topic, known.type(key)] += 1
            writing.message(key, head, data)
    writing.finish()


def edited(copy: Copy, topic: str, data: bytes, locate: Locate, unpacking: Unpacking) -> bytes:
    """Return the message to write for one of sweeps, which may be packed by zstd, and is so again."""
    if not data.startswith(ZSTD_MAGIC):
        return copy.edit(topic, data, locate)
    plain = unpack_message(data, unpacking)
    if plain is None:
        return data
    changed = copy.edit(topic, plain, locate)
    return data if changed is plain else zstandard.ZstdCompressor().compress(changed)


def _message(part: Messages, row: int) -> tuple[bytes, bytes]:
    """Return the head of a message, from its channel on, and its payload."""
    start, length = int(part.start[row]), int(part.length[row])
    begin = start - (MESSAGE_HEAD - RECORD.size)
    return part.data[begin:start].tobytes(), part.data[start : start + length].tobytes()


class _Writing:
    """Messages on their way into chunks, packed as those of the log are, each behind its channel and schema."""

    def __init__(self, file: _File, walker: Walker, known: Catalogue) -> None:
        self._file, self._walker, self._known = file, walker, known
        self._schemas: set[int] = set()
        self._channels: set[int] = set()

    def message(self, key: int, head: bytes, data: bytes) -> None:
        """Write a message."""
        self._define(key)
        self._file.message(key, head, data, self._compression)

    def finish(self) -> None:
        """Write what no message needed, and the summary."""
        for key in self._known.channels:
            self._define(key)
        for key, schema in self._known.schemas.items():
            if key not in self._schemas:
                self._schemas.add(key)
                self._file.definition(schema)
        self._file.finish(self._compression)

    @property
    def _compression(self) -> str:
        kinds = (kind.replace("none", "") for kind in self._walker.compressions)
        return next((kind for kind in kinds if kind in _PACK), "")

    def _define(self, key: int) -> None:
        if key in self._channels:
            return
        self._channels.add(key)
        channel = self._known.channels[key]
        schema = self._known.schemas.get(channel.schema_id)
        if schema is not None and channel.schema_id not in self._schemas:
            self._schemas.add(channel.schema_id)
            self._file.definition(schema)
        self._file.definition(channel)


class _File:
    """An MCAP that is written: the library's own writer gives ids of its own."""

    def __init__(self, out: BinaryIO) -> None:
        self._out = out
        self._at = 0
        self._chunk = RecordBuilder()
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._times: list[int] = []
        self._counts: Counter[int] = Counter()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._waiting: list[tuple[int, bytes]] = []
        self._has_header = False
        self._write(MAGIC)

    def record(self, opcode: int, content: bytes) -> None:
        """Write header, attachment or metadata as they are."""
        if opcode == Opcode.HEADER and self._has_header:
            return
        self._waiting.append((opcode, content))
        if not self._chunk.count:
            self._others()

    def definition(self, one: Schema | Channel) -> None:
        """Write a schema or channel."""
        (self._schemas if isinstance(one, Schema) else self._channels).append(one)  # type: ignore[arg-type]
        one.write(self._chunk)

    def message(self, key: int, head: bytes, data: bytes, compression: str) -> None:
        """Write a message; one that waits for a chunk behind other records begins a new chunk."""
        if self._waiting:
            self._flush(compression)
        log_ns = int.from_bytes(head[6:14], "little")
        self._entries.setdefault(key, []).append((log_ns, self._chunk.count))
        self._chunk.write(RECORD.pack(Opcode.MESSAGE, len(head) + len(data)) + head + data)
        if self._chunk.count >= CHUNK:
            self._flush(compression)

    def finish(self, compression: str) -> None:
        """Write the summary and the end."""
        self._flush(compression)
        self._add(DataEnd(0))
        start = self._at
        groups: list[SummaryOffset] = []
        summary = RecordBuilder()
        times = [one.message_start_time for one in self._chunks if one.message_index_length]
        ends = [one.message_end_time for one in self._chunks if one.message_index_length]
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=max(ends, default=0),
            message_start_time=min(times, default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        written: tuple[tuple[int, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, [*self._schemas]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachments]),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        )
        for opcode, records in written:
            before = summary.count
            for one in records:
                one.write(summary)
            if summary.count > before:
                groups.append(
                    SummaryOffset(group_opcode=opcode, group_start=start + before, group_length=summary.count - before)
                )
        offsets = start + summary.count
        for group in groups:
            group.write(summary)
        data = _taken(summary)
        self._write(data)
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 20, start, offsets), zlib.crc32(data))
        self._add(Footer(summary_offset_start=offsets, summary_start=start, summary_crc=crc))
        self._write(MAGIC)

    def _flush(self, compression: str) -> None:
        """Write the chunk, and then what came behind it."""
        if not self._has_header:
            # That of the log is lost, and what follows is not read without one.
            self._has_header = True
            self._add(Header(profile="", library=""))
        if self._chunk.count:
            self._write_chunk(compression)
        self._others()

    def _write_chunk(self, compression: str) -> None:
        plain = _taken(self._chunk)
        times = [log_ns for entries in self._entries.values() for log_ns, _ in entries]
        first, last = min(times, default=0), max(times, default=0)
        data = _PACK[compression](plain)
        start = self._at
        self._add(
            Chunk(
                compression=compression,
                data=data,
                message_end_time=last,
                message_start_time=first,
                uncompressed_crc=zlib.crc32(plain),
                uncompressed_size=len(plain),
            )
        )
        end = self._at
        offsets = {}
        for key, entries in self._entries.items():
            offsets[key] = self._at
            self._counts[key] += len(entries)
            self._add(MessageIndex(channel_id=key, records=entries))
        self._chunks.append(
            ChunkIndex(
                chunk_length=end - start,
                chunk_start_offset=start,
                compression=compression,
                compressed_size=len(data),
                message_end_time=last,
                message_index_length=self._at - end,
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(plain),
            )
        )
        self._entries = {}

    def _others(self) -> None:
        waiting, self._waiting = self._waiting, []
        for opcode, content in waiting:
            start, length = self._at, RECORD.size + len(content)
            self._has_header = True
            self._write(RECORD.pack(opcode, len(content)) + content)
            if opcode == Opcode.ATTACHMENT and (attachment := parse(Attachment.read, content)) is not None:
                self._attachments.append(
                    AttachmentIndex(
                        create_time=attachment.create_time,
                        data_size=len(attachment.data),
                        length=length,
                        log_time=attachment.log_time,
                        media_type=attachment.media_type,
                        name=attachment.name,
                        offset=start,
                    )
                )
            elif opcode == Opcode.METADATA and (metadata := parse(Metadata.read, content)) is not None:
                self._metadata.append(MetadataIndex(length=length, name=metadata.name, offset=start))

    def _add(self, one: McapRecord) -> None:
        builder = RecordBuilder()
        one.write(builder)
        self._write(_taken(builder))

    def _write(self, data: bytes) -> None:
        self._out.write(data)
        self._at += len(data)


def _taken(builder: RecordBuilder) -> bytes:
    """Return the bytes of some records, and empty the builder."""
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
