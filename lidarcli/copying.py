"""Logs written once more with other ranges: every other message stays byte for byte, whatever its container.

Writers are those of the containers' libraries: chunks and index are made anew, and of databases the rows alone change.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata
from mcap.writer import CompressionType, Writer

from lidarcli.errors import OutputError
from lidarcli.logs.base import MULTI_ECHO, Log, ReadReport, ros_type
from lidarcli.logs.blocks import Locate, ScanLayout
from lidarcli.logs.laserscan import locate
from lidarcli.logs.mcap import McapLog
from lidarcli.logs.mcap_records import Catalogue, Messages, parse
from lidarcli.logs.rosbag1 import Rosbag1Log
from lidarcli.logs.rosbag2 import SQLITE_ERRORS, Rosbag2Log, SqliteLog, is_cdr
from lidarcli.logs.unpacking import ZSTD_MAGIC, DecompressionBudget, is_zstd, unpack_message
from lidarcli.ros.bag_metadata import METADATA
from lidarcli.sweeps import Bool

_PUBLISHED = struct.Struct("<IQQ")
"""Sequence, log time and publish time of an MCAP message, before its payload."""
_TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
    "data BLOB NOT NULL)",
    "CREATE INDEX timestamp_idx ON messages (timestamp ASC)",
)

Edit = Callable[[str, bytes, Locate], bytes]
"""Takes topic and message, and what finds its ranges; returns the message to write, the same one if nothing changes."""


@dataclass(slots=True)
class Copy:
    """One copy of a log, as far as it has come."""

    edit: Edit
    """Called for every message of sweeps, in log order."""
    report: ReadReport = field(default_factory=ReadReport)
    messages: Counter[tuple[str, str]] = field(default_factory=Counter)
    left_out: int = 0
    """Records of applications that are no messages, attachments or metadata."""
    budget: DecompressionBudget = field(default_factory=DecompressionBudget)
    """Limit for messages that are packed one by one."""

    def edited(self, topic: str, data: bytes, locate: Locate) -> bytes:
        """Return the message to write for one of sweeps, which may be packed by zstd, and is so again."""
        if not data.startswith(ZSTD_MAGIC):
            return self.edit(topic, data, locate)
        plain = unpack_message(data, self.budget)
        if plain is None:
            return data
        changed = self.edit(topic, plain, locate)
        return data if changed is plain else zstandard.ZstdCompressor().compress(changed)


def replaced(message: bytes, written: ScanLayout, chosen: Bool, value: float) -> bytes:
    """Return a message in which all ranges of the chosen beams (B,) have a value."""
    places = written.place[chosen[written.beam]]
    number = np.frombuffer(np.array(value, written.kind).tobytes(), np.uint8)
    data = np.frombuffer(message, np.uint8).copy()
    data[places[:, None] + np.arange(len(number))] = number
    return data.tobytes()


def copy_log(log: Log, target: Path, copy: Copy) -> None:
    """Write a log of any of the containers once more (`OutputError`)."""
    if isinstance(log, Rosbag2Log):
        _copy_rosbag2(log, target, copy)
    elif isinstance(log, Rosbag1Log):
        _copy_rosbag1(log, target, copy)
    else:
        assert isinstance(log, McapLog)
        _copy_mcap(log, target, copy)


class _McapTarget:
    """An MCAP that is written, as far as it has come."""

    def __init__(self, out: BinaryIO, header: Header, compression: str, known: Catalogue) -> None:
        """`compression` is that of the first chunk of the log; all channels `known` so far keep their order."""
        kind = CompressionType.__members__.get(compression.upper(), CompressionType.NONE)
        self.writer = Writer(out, compression=kind, use_summary_offsets=False)
        self.writer.start(profile=header.profile, library=header.library)
        self._known = known
        self._schemas, self._channels = {0: 0}, dict[int, int]()
        self.define()

    def define(self) -> None:
        """Write the schemas and channels that have become known."""
        for key, schema in sorted(self._known.schemas.items()):
            if key not in self._schemas:
                self._schemas[key] = self.writer.register_schema(schema.name, schema.encoding, schema.data)
        for key, channel in sorted(self._known.channels.items()):
            if key not in self._channels:
                own = self._schemas.get(channel.schema_id, 0)
                self._channels[key] = self.writer.register_channel(
                    channel.topic, channel.message_encoding, own, channel.metadata
                )

    def message(self, key: int, head: tuple[int, int, int], data: bytes) -> None:
        """Write a message with its sequence number, log time and publish time."""
        if key not in self._channels:
            self.define()
        sequence, log_ns, publish_ns = head
        self.writer.add_message(self._channels[key], log_ns, data, publish_ns, sequence)

    def add(self, record: Attachment | Metadata) -> None:
        """Write an attachment or metadata."""
        if isinstance(record, Metadata):
            self.writer.add_metadata(record.name, record.metadata)
        else:
            name, kind = record.name, record.media_type
            self.writer.add_attachment(record.create_time, record.log_time, name, kind, record.data)


def _copy_mcap(log: McapLog, target: Path, copy: Copy) -> None:
    """Copy an MCAP: times, sequence numbers, attachments and metadata stay."""
    walk, known = log.raw_records(copy.report), log.catalogue
    header = Header(profile="", library="")
    waiting: list[Attachment | Metadata] = []
    locators: dict[int, Locate | None] = {}
    made: _McapTarget | None = None
    with target.open("xb") as out:
        for rows in walk.records():
            if isinstance(rows, Messages):
                made = made or _McapTarget(out, header, next(iter(walk.compressions), ""), known)
                for row, key in enumerate(rows.channel.tolist()):
                    if (channel := known.channels.get(key)) is None:
                        continue
                    start, length = int(rows.start[row]), int(rows.length[row])
                    data = rows.data[start : start + length].tobytes()
                    if key not in locators:
                        locators[key] = log.locator(key)
                    if (locator := locators[key]) is not None:
                        data = copy.edited(channel.topic, data, locator)
                    copy.messages[channel.topic, known.type(key)] += 1
                    made.message(key, _PUBLISHED.unpack_from(rows.data.data, start - _PUBLISHED.size), data)
            elif rows.opcode == Opcode.HEADER:
                header = parse(Header.read, rows.content) or header
            elif rows.opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
                record = parse(Attachment.read if rows.opcode == Opcode.ATTACHMENT else Metadata.read, rows.content)
                waiting += [] if record is None else [record]
                copy.left_out += record is None
            else:
                copy.left_out += 1
            if made is not None:
                for record in waiting:
                    made.add(record)
                waiting.clear()
        made = made or _McapTarget(out, header, "", known)
        for record in waiting:
            made.add(record)
        made.define()
        made.writer.finish()  # type: ignore[no-untyped-call]


def _copy_rosbag1(log: Rosbag1Log, target: Path, copy: Copy) -> None:
    """Copy a ROS 1 bag; messages whose connection is not described are damage, and left out."""
    from lidarcli.ros.messages import bag_writer

    reading = log.raw_records(copy.report)
    with bag_writer(target, log.compression.partition("+")[0]) as writer:
        written: dict[int, Any] = {}
        alike: dict[tuple[object, ...], Any] = {}

        def add(number: int, topic: str, fields: dict[str, str]) -> None:
            """Write a connection; those of one publisher that are alike become one."""
            latching = fields.get("latching", "")
            key = (
                topic,
                *map(fields.__getitem__, ("type", "md5sum", "message_definition")),
                fields.get("callerid"),
                latching,
            )
            if key not in alike:
                alike[key] = writer.add_connection(
                    topic,
                    ros_type(fields["type"]),
                    md5sum=fields["md5sum"],
                    msgdef=fields["message_definition"],
                    callerid=fields.get("callerid"),
                    latching=int(latching) if latching.isdecimal() else None,
                )
            written[number] = alike[key]

        for block in reading.blocks():
            for row, number in enumerate(block.connection.tolist()):
                connection = reading.connections.get(number)
                if connection is None or not connection.fields:
                    continue
                if number not in written:
                    add(number, connection.topic, connection.fields)
                start, length = int(block.starts[row]), int(block.lengths[row])
                data = block.data[start : start + length].tobytes()
                if connection.read_as:
                    where = partial(locate, encoding="ros1", several=connection.read_as == MULTI_ECHO)
                    data = copy.edit(connection.topic, data, where)
                writer.write(written[number], int(block.time_ns[row]), data)
                copy.messages[connection.topic, connection.type] += 1
        for number, connection in sorted(reading.connections.items()):
            if number not in written and connection.fields:
                add(number, connection.topic, connection.fields)


def _copy_rosbag2(log: Rosbag2Log, target: Path, copy: Copy) -> None:
    """Write a bag once more: a folder for a folder, with files of the same names, or one file."""
    is_folder = Path(log.path).is_dir()
    if is_folder:
        target.mkdir()
        metadata = Path(log.path) / METADATA
        if metadata.is_symlink():
            # It may lead to any file of whoever reads the bag.
            copy.report.add_damage(METADATA, "is a link, and not copied; 'ros2 bag reindex' makes a new one")
        elif metadata.is_file():
            shutil.copyfile(metadata, target / METADATA)
    for number, storage, report in log.opened(copy.report):
        original = Path(log.parts[number].path)
        path = target / original.name if is_folder else target
        mine = Copy(copy.edit, report, copy.messages)
        if is_zstd(original):
            with tempfile.TemporaryDirectory(prefix="lidarcli-", dir=path.parent) as folder:
                plain = Path(folder) / "plain"
                _copy_storage(storage, plain, mine)
                with plain.open("rb") as source, path.open("xb") as out:
                    # With its size at the begin, without which rosbag2 does not unpack it.
                    zstandard.ZstdCompressor().copy_stream(source, out, size=plain.stat().st_size)
        else:
            _copy_storage(storage, path, mine)
        copy.left_out += mine.left_out


def _copy_storage(storage: Log, path: Path, copy: Copy) -> None:
    if isinstance(storage, McapLog):
        _copy_mcap(storage, path, copy)
        return
    assert isinstance(storage, SqliteLog)
    try:
        _copy_database(storage, path, copy)
    except SQLITE_ERRORS as err:
        raise OutputError(f"cannot write {path.name}: SQLite says: {err}") from err
    copy.report.add(storage.met)


def _copy_database(bag: SqliteLog, path: Path, copy: Copy) -> None:
    """Write a database once more: of a sound one only the changed messages differ, of a damaged one what can be read."""
    sound = bag.sound_file()
    if sound is None:
        _write_anew(bag, path, copy)
        return
    shutil.copyfile(sound, path)
    scans = [topic.id for topic in bag.topic_rows.values() if is_cdr(topic) and bag.read_as(topic)]
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for pragma in ("journal_mode = off", "synchronous = off", "ignore_check_constraints = on"):
            database.execute(f"PRAGMA {pragma}")
        database.execute("BEGIN")
        for rows in bag.batches(scans) if scans else ():
            for row, topic_id, timestamp, data in rows:
                if data is None or timestamp is None:
                    continue
                changed = _edited(bag, topic_id, data, copy)
                if changed is not data:
                    update = f"UPDATE messages SET data = ? WHERE {bag.number} = ?"
                    if (count := database.execute(update, (changed, row)).rowcount) != 1:
                        raise OutputError(f"cannot write {path.name}: {count} messages have the number {row}")
        database.execute("COMMIT")
    for topic_id, count in bag.counts().items():
        if (topic := bag.topic_rows.get(topic_id)) is not None:
            copy.messages[topic.name, ros_type(topic.type)] += count


def _edited(bag: SqliteLog, topic_id: int, data: bytes, copy: Copy) -> bytes:
    topic = bag.topic_rows[topic_id]
    kind = bag.read_as(topic)
    if not is_cdr(topic) or not kind:
        return data
    where = partial(locate, encoding="cdr", several=kind == MULTI_ECHO)
    return copy.edited(topic.name, data, where)


def _write_anew(bag: SqliteLog, path: Path, copy: Copy) -> None:
    """Write the topics and messages of a damaged database that can be read into a new one."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = memory")
        database.execute("PRAGMA synchronous = off")
        for statement in _TABLES:
            database.execute(statement)
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, ?, '')",
            [(topic.id, topic.name, topic.type, topic.encoding) for topic in bag.topic_rows.values()],
        )
        for rows in bag.batches([*bag.topic_rows]):
            whole = [row for row in rows if row[2] is not None and row[3] is not None]
            for row, topic_id, timestamp, data in whole:
                assert data is not None
                data = _edited(bag, topic_id, data, copy)
                database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", (row, topic_id, timestamp, data))
                topic = bag.topic_rows[topic_id]
                copy.messages[topic.name, ros_type(topic.type)] += 1
        database.commit()
