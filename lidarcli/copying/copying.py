"""Logs written once more with other sweeps, as a whole or in parts: every other message stays byte for byte.

Writers are those of the containers' libraries: chunks and index are made again; of complete databases only rows change.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata
from mcap.writer import CompressionType, Writer

from lidarcli.errors import OutputError
from lidarcli.logs.base import MULTI_ECHO, Log, ReadReport, ros_type
from lidarcli.logs.blocks import Locate, ScanLayout
from lidarcli.logs.laserscan import Locator
from lidarcli.logs.mcap import McapLog
from lidarcli.logs.mcap_records import ChannelCatalogue, McapMessages, parse
from lidarcli.logs.rosbag1 import Connection, Rosbag1Log
from lidarcli.logs.rosbag2 import Rosbag2Log
from lidarcli.logs.rosbag2_salvage import TopicRow
from lidarcli.logs.rosbag2_sqlite import SQLITE_ERRORS, SqliteLog, is_cdr
from lidarcli.logs.unpacking import ZSTD_MAGIC, DecompressionBudget, is_zstd, unpack_message
from lidarcli.ros.bag_metadata import METADATA
from lidarcli.ros.cursor import BadMessageError, Cursor
from lidarcli.sweeps.types import Bool

_PUBLISHED = struct.Struct("<IQQ")
"""Sequence, log time and publish time of an MCAP message, before its payload."""
_TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
    "data BLOB NOT NULL)",
    "CREATE INDEX timestamp_idx ON messages (timestamp ASC)",
)

LATCHED = ("tf_static", "robot_description", "map")
"""Ends of the names of topics whose messages count until the next: who begins to read later still gets them."""
DURABLE = re.compile(r"""durability["']?: *["']?(?:1\b|transient_local)""")
"""What a topic of ROS 2 says that is offered so."""
MAX_SAID = 1000
"""Most such messages that are held, the newest."""
TOGETHER = 16
"""Parts of a log that are written in one pass over it."""

Edit = Callable[[str, int, bytes, ScanLayout], bytes]
"""Takes the topic, number and message of a sweep, and where its ranges are; returns the message to write, the same one if
nothing changes."""

Enter = Callable[[Any], Any]
"""Opens a file until all is written."""


class Cut(NamedTuple):
    """A part of a log."""

    spans: tuple[tuple[int, int], ...] = ()
    """Times from and until which its messages were recorded, those of sweeps of `sweeps` apart; empty where no such times
    can be relied on: messages count that stand between two sweeps of one run."""
    leaves: frozenset[str] = frozenset()
    """Topics that are left out."""
    sweeps: Mapping[str, Mapping[int, int]] = MappingProxyType({})
    """Topic → number of each of its sweeps in log order → run, counted from 1."""


ALL = Cut(((-(1 << 63), 1 << 64),))
"""A part with all messages."""

Targets = Sequence[tuple[Path, Cut | None]]
"""Files to write, each with its part of the log; or one file or folder with all of it (None)."""


class Met(NamedTuple):
    """A message of a log."""

    topic: str
    type: str
    record_ns: int
    data: bytes
    origin: Any
    """The rest that its container holds, for the writer of this container."""


@dataclass(slots=True)
class Copy:
    """One copy of a log, or several parts of it, as far as it has come."""

    edit: Edit | None = None
    """Called for every message of sweeps, in log order; in each pass again."""
    report: ReadReport = field(default_factory=ReadReport)
    messages: Counter[tuple[str, str]] = field(default_factory=Counter)
    left_out: int = 0
    """Records of applications that are no messages, attachments or metadata."""
    budget: DecompressionBudget = field(default_factory=DecompressionBudget)
    """Limit for messages that are packed one by one."""
    sweeps: Counter[str] = field(default_factory=Counter)
    """Topic → sweeps so far."""
    written: Counter[str] = field(default_factory=Counter)
    """Topic → sweeps in the parts that are written."""
    is_cut: bool = False
    """True while parts of the log are written, which no metadata.yaml declares to be packed."""
    after: Callable[[Met], Sequence[Met]] | None = None
    """Returns what is written after a message, for copies that are cut."""
    said: dict[object, Met] = field(default_factory=dict)
    """Messages that come first in a file: given ones, and in a pass those that count until the next."""

    unsaid: int = 0
    """Messages that count until the next, and of which there are more than are held."""

    def note(self, met: Met) -> None:
        """Remember a message that counts until the next: the newest of each static transform, topic and publisher."""
        end, (publisher, offered, encoding) = met.topic.rpartition("/")[2], _channel_of(met)
        if end not in LATCHED and (met.topic in self.sweeps or not _is_durable(offered)):
            return
        key: object = (met.topic, publisher)
        if end == LATCHED[0]:
            frames = _children(met.data, encoding) if encoding in ("cdr", "ros1") else frozenset()
            key = (met.topic, frames or met.data)
            for topic, known in [one for one in self.said if isinstance(one, tuple)]:
                if topic == met.topic and isinstance(known, frozenset) and known < frames:
                    del self.said[topic, known]
        self.said.pop(key, None)
        self.said[key] = met
        if len(self.said) > MAX_SAID:
            self.said.pop(next(iter(self.said)))
            self.unsaid += 1

    def edited(self, topic: str, data: bytes, locate: Locate | None, encoding: str) -> bytes:
        """Return the message to write for one; messages that are packed by zstd are so again, but for parts of a log."""
        is_packed = data.startswith(ZSTD_MAGIC)
        unpacks = is_packed and self.is_cut and encoding == "cdr"
        plain = unpack_message(data, self.budget) if unpacks or (is_packed and locate is not None) else data
        if plain is None:
            return data
        layout, changed = None if self.edit is None or locate is None else locate(plain), plain
        if layout is not None and self.edit is not None:
            changed = self.edit(topic, self.sweeps[topic], plain, layout)
            self.sweeps[topic] += 1
        if unpacks or not is_packed:
            return changed
        return data if changed is plain else zstandard.ZstdCompressor().compress(changed)


def replaced(message: bytes, written: ScanLayout, chosen: Bool, value: float) -> bytes:
    """Return a message in which all ranges of the chosen beams (B,) have a value."""
    data, size = bytearray(message), np.dtype(written.kind).itemsize
    # A number may begin at every byte.
    numbers = np.ndarray((len(data) - size + 1,), written.kind, data, strides=(1,))
    numbers[written.place[chosen[written.beam]]] = value
    return bytes(data)


def renamed(met: Met, topic: str, data: bytes, known: dict[object, tuple[Any, Any]]) -> Met:
    """Return a message of another topic; `known` maps the origins of messages so far to those of their copies."""
    kept, *rest = met.origin if isinstance(met.origin, tuple) else (met.origin,)
    key = id(kept), met.topic
    if key not in known:
        if isinstance(kept, Connection):
            other: Any = replace(kept, topic=topic, fields={**kept.fields, "topic": topic})
        elif isinstance(kept, TopicRow):
            other = kept._replace(name=topic)
        else:
            other = ChannelCatalogue({rest[0]: replace(kept.channels[rest[0]], topic=topic)}, kept.schemas)
        known[key] = kept, other
    other = known[key][1]
    return met._replace(topic=topic, data=data, origin=(other, *rest) if isinstance(met.origin, tuple) else other)


def copy_log(log: Log, targets: Path | Targets, copy: Copy) -> None:
    """Write a log of any of the containers once more (`OutputError`); without targets `copy` sees its messages."""
    every = [(targets, None)] if isinstance(targets, Path) else targets
    given = copy.said
    for first in range(0, max(len(every), 1), TOGETHER):
        some = every[first : first + TOGETHER]
        copy.said, copy.is_cut = {**given}, all(cut is not None for _, cut in some)
        copy.left_out = 0
        copy.sweeps.clear()
        try:
            if not isinstance(log, Rosbag2Log):
                _write([log], some, copy)
            elif copy.is_cut:
                _write((storage for _, storage in _storages(log, copy)), some, copy)
            else:
                _copy_rosbag2(log, some[0][0], copy)
        except SQLITE_ERRORS as err:
            raise OutputError(f"cannot write {some[0][0].name if some else log.path}: SQLite says: {err}") from err


class _Part:
    """A file that is written, and how far its part of the log has come."""

    def __init__(self, writer: Any, cut: Cut) -> None:
        self.writer, self._cut = writer, cut
        self._left: Counter[int] = Counter()
        """Run → sweeps of this part that are still to come."""
        for runs in cut.sweeps.values():
            self._left.update(runs.values())
        self._run = 0
        self._is_empty = True

    def takes(self, met: Met, number: int | None) -> bool:
        """Return whether a message belongs to the part; `number` that of a sweep within its topic."""
        cut, runs = self._cut, self._cut.sweeps.get(met.topic)
        if number is not None and runs is not None:
            run = runs.get(number, 0)
            self._run = run or self._run
            self._left[run] -= 1
            return run > 0
        if cut.spans:
            return any(first <= met.record_ns <= last for first, last in cut.spans)
        return self._left[self._run] > 0

    def write(self, met: Met, more: Sequence[Met], copy: Copy) -> None:
        """Write a message, before the first one those that count since before, and what comes after it."""
        for one in (*(copy.said.values() if self._is_empty else ()), met, *more):
            if one.topic not in self._cut.leaves:
                copy.messages[one.topic, one.type] += 1
                self.writer.write(one if one is met else one._replace(record_ns=met.record_ns))
        self._is_empty = False


def _write(logs: Iterable[Log], targets: Targets, copy: Copy) -> None:
    """Write the messages of logs in one container into new files of it."""
    whole = not copy.is_cut and not copy.said
    with ExitStack() as stack:
        parts: list[_Part] = []
        for log in logs:
            records = _RECORDS[type(log)](log, copy)
            make = next(records)
            parts = parts or [_Part(make(stack.enter_context, path, whole), cut or ALL) for path, cut in targets]
            sweeps = copy.sweeps.copy()
            for met in records:
                if not isinstance(met, Met):
                    for part in parts:
                        part.writer.add(met)
                    continue
                more = copy.after(met) if copy.after is not None else ()
                is_sweep = copy.sweeps[met.topic] > sweeps[met.topic]
                number = sweeps[met.topic] if is_sweep else None
                sweeps[met.topic] += is_sweep
                for part in parts:
                    if part.takes(met, number):
                        part.write(met, more, copy)
                        copy.written[met.topic] += is_sweep
                # Of a whole log nothing is left for later.
                if copy.is_cut:
                    copy.note(met)
        for part in parts:
            part.writer.finish()


@lru_cache(maxsize=1024)
def _is_durable(offered: str) -> bool:
    """Return whether who begins to read later still gets the last messages of a topic, by how it was offered."""
    return DURABLE.search(offered) is not None


def _channel_of(met: Met) -> tuple[str, str, str]:
    """Return who sends a message, where that is known, how its topic was offered, and the encoding."""
    match met.origin:
        case Connection(fields=fields):
            return fields.get("callerid", ""), "durability: 1" if fields.get("latching") == "1" else "", "ros1"
        case (ChannelCatalogue() as known, key, *_):
            channel = known.channels[key]
            return "", channel.metadata.get("offered_qos_profiles", ""), channel.message_encoding
        case (topic, profile, *_):
            return "", profile, topic.encoding
    return "", "", ""


def _children(data: bytes, encoding: str) -> frozenset[str]:
    """Return the child frames of a message of transforms of ROS; none of a message that cannot be read."""
    found = set()
    try:
        cursor = Cursor(data, encoding)
        for _ in range(cursor.word()):
            cursor.skip(4 * (encoding == "ros1"))
            cursor.align(4)
            cursor.skip(8)
            cursor.text()
            cursor.align(4)
            found.add(cursor.text())
            cursor.align(8)
            cursor.skip(7 * 8)
    except BadMessageError:
        return frozenset()
    return frozenset(found)


def _mcap_records(log: McapLog, copy: Copy) -> Iterator[Any]:
    """Yield what makes a writer, once the first chunk is read, which has its compression; then all messages and records."""
    walk, known, begun = log.raw_records(copy.report), log.catalogue, False
    header = Header(profile="", library="")
    waiting: list[Attachment | Metadata] = []
    described: dict[int, tuple[str, str, str, Locate | None]] = {}
    for rows in walk.records():
        if isinstance(rows, McapMessages):
            if not begun:
                yield partial(_McapWriter, header, next(iter(walk.compressions), ""), known)
            begun = True
            yield from waiting
            waiting.clear()
            for row, key in enumerate(rows.channel.tolist()):
                if key not in described:
                    if (channel := known.channels.get(key)) is None:
                        continue
                    described[key] = channel.topic, known.type(key), channel.message_encoding, log.locator(key)
                topic, kind, encoding, where = described[key]
                start, length = int(rows.start[row]), int(rows.length[row])
                data = copy.edited(topic, rows.data[start : start + length].tobytes(), where, encoding)
                sequence, log_ns, publish_ns = _PUBLISHED.unpack_from(rows.data.data, start - _PUBLISHED.size)
                yield Met(topic, kind, log_ns, data, (known, key, sequence, publish_ns))
        elif rows.opcode == Opcode.HEADER:
            header = parse(Header.read, rows.content) or header
        elif rows.opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            record = parse(Attachment.read if rows.opcode == Opcode.ATTACHMENT else Metadata.read, rows.content)
            waiting += [] if record is None else [record]
            copy.left_out += record is None
        else:
            copy.left_out += 1
        if begun:
            yield from waiting
            waiting.clear()
    if not begun:
        yield partial(_McapWriter, header, "", known)
    yield from waiting


class _McapWriter:
    """An MCAP that is written, as far as it has come."""

    def __init__(
        self, header: Header, compression: str, known: ChannelCatalogue, enter: Enter, path: Path, whole: bool
    ) -> None:
        """`compression` is that of the first chunk of the log; a `whole` copy has all channels, in their order."""
        kind = CompressionType.__members__.get(compression.upper(), CompressionType.NONE)
        self.writer = Writer(enter(path.open("xb")), compression=kind, use_summary_offsets=False)
        self.writer.start(profile=header.profile, library=header.library)
        self._whole = known if whole else None
        self._known: dict[int, ChannelCatalogue] = {}
        self._ids: dict[tuple[str, int, int], int] = {}
        self._define()

    def _define(self) -> None:
        """Write the schemas and channels of a whole copy that have become known."""
        if self._whole is not None:
            for key in sorted(self._whole.schemas):
                self._schema(self._whole, key)
            for key in sorted(self._whole.channels):
                self._channel(self._whole, key)

    def _schema(self, known: ChannelCatalogue, key: int) -> int:
        at = ("schema", id(known), key)
        if at not in self._ids and (schema := known.schemas.get(key)) is not None:
            self._ids[at] = self.writer.register_schema(schema.name, schema.encoding, schema.data)
        return self._ids.get(at, 0)

    def _channel(self, known: ChannelCatalogue, key: int) -> int:
        # It is held, so that no other gets its number.
        self._known[id(known)] = known
        if (at := ("channel", id(known), key)) not in self._ids:
            channel = known.channels[key]
            own = self._schema(known, channel.schema_id)
            self._ids[at] = self.writer.register_channel(channel.topic, channel.message_encoding, own, channel.metadata)
        return self._ids[at]

    def write(self, met: Met) -> None:
        """Write a message with its sequence number, log time and publish time."""
        known, key, sequence, publish_ns = met.origin
        self.writer.add_message(self._channel(known, key), met.record_ns, met.data, publish_ns, sequence)

    def add(self, record: Attachment | Metadata) -> None:
        """Write an attachment or metadata."""
        if isinstance(record, Metadata):
            self.writer.add_metadata(record.name, record.metadata)
        else:
            name, kind = record.name, record.media_type
            self.writer.add_attachment(record.create_time, record.log_time, name, kind, record.data)

    def finish(self) -> None:
        """Write what no message has needed, and the index."""
        self._define()
        self.writer.finish()  # type: ignore[no-untyped-call]


def _bag_records(log: Rosbag1Log, copy: Copy) -> Iterator[Any]:
    """Yield what makes a writer, then messages; those whose connection is not described are damage, and left out."""
    reading = log.raw_records(copy.report)
    yield partial(_BagWriter, log.compression.partition("+")[0], reading.connections)
    locators: dict[tuple[int, str], Locator] = {}
    for block in reading.blocks():
        for row, number in enumerate(block.connection.tolist()):
            connection = reading.connections.get(number)
            if connection is None or not connection.fields:
                continue
            start, length, topic = int(block.starts[row]), int(block.lengths[row]), connection.topic
            data = block.data[start : start + length].tobytes()
            if kind := connection.read_as:
                where = locators.setdefault((number, kind), Locator("ros1", kind == MULTI_ECHO))
                data = copy.edited(topic, data, where, "ros1")
            yield Met(topic, connection.type, int(block.time_ns[row]), data, connection)


class _BagWriter:
    """A ROS 1 bag that is written, as far as it has come."""

    def __init__(self, compression: str, known: Mapping[int, Connection], enter: Enter, path: Path, whole: bool) -> None:
        """A `whole` copy also has connections without messages."""
        from lidarcli.ros.messages import bag_writer

        self._writer, self._known = enter(bag_writer(path, compression)), known if whole else {}
        self._written: dict[int, tuple[Connection, Any]] = {}
        self._alike: dict[tuple[object, ...], Any] = {}

    def _connection(self, connection: Connection) -> Any:
        """Return what a connection has become; those of one publisher that are alike become one."""
        # It is kept, so that no other gets its number.
        if (known := self._written.get(id(connection))) is not None:
            return known[1]
        topic, fields = connection.topic, connection.fields
        latching = fields.get("latching", "")
        same = map(fields.__getitem__, ("type", "md5sum", "message_definition"))
        key = (topic, *same, fields.get("callerid"), latching)
        if key not in self._alike:
            self._alike[key] = self._writer.add_connection(
                topic,
                ros_type(fields["type"]),
                md5sum=fields["md5sum"],
                msgdef=fields["message_definition"],
                callerid=fields.get("callerid"),
                latching=int(latching) if latching.isdecimal() else None,
            )
        self._written[id(connection)] = connection, self._alike[key]
        return self._alike[key]

    def write(self, met: Met) -> None:
        """Write a message."""
        self._writer.write(self._connection(met.origin), met.record_ns, met.data)

    def finish(self) -> None:
        """Write connections without messages."""
        for _, connection in sorted(self._known.items()):
            if connection.fields:
                self._connection(connection)


def _database_records(bag: SqliteLog, copy: Copy) -> Iterator[Any]:
    """Yield what makes a writer, then the messages; of a damaged database those that can be read."""
    yield partial(_DatabaseWriter, bag)
    profiles, locators = bag.profiles(), _locators(bag)
    for row, topic_id, timestamp, data in chain.from_iterable(bag.batches([*bag.topic_rows])):
        if timestamp is not None and data is not None:
            topic = bag.topic_rows[topic_id]
            origin = topic, profiles.get(topic_id, ""), row
            data = copy.edited(topic.name, data, locators[topic_id], topic.encoding)
            yield Met(topic.name, ros_type(topic.type), timestamp, data, origin)
    copy.report.add(bag.met)


class _DatabaseWriter:
    """A database of ROS 2 that is written, as far as it has come."""

    def __init__(self, bag: SqliteLog, enter: Enter, path: Path, whole: bool) -> None:
        """A `whole` copy has all topics, and the numbers of rows."""
        self._database, self._is_whole = enter(closing(sqlite3.connect(path))), whole
        self._ids: dict[tuple[object, ...], int] = {}
        for statement in ("PRAGMA journal_mode = memory", "PRAGMA synchronous = off", *_TABLES):
            self._database.execute(statement)
        profiles = bag.profiles()
        for topic in bag.topic_rows.values() if whole else ():
            self._topic(topic, profiles.get(topic.id, ""))

    def _topic(self, topic: TopicRow, profile: str) -> int:
        """Return the number of a topic: of a whole database its own."""
        key = topic if self._is_whole else topic[1:]
        if key not in self._ids:
            self._ids[key] = topic.id if self._is_whole else len(self._ids) + 1
            row = (self._ids[key], topic.name, topic.type, topic.encoding, profile)
            self._database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
        return self._ids[key]

    def write(self, met: Met) -> None:
        """Write a message."""
        topic, profile, row = met.origin
        number = row if self._is_whole else None
        self._database.execute(
            "INSERT INTO messages VALUES (?, ?, ?, ?)", (number, self._topic(topic, profile), met.record_ns, met.data)
        )

    def finish(self) -> None:
        """Make it last."""
        self._database.commit()


_RECORDS: Mapping[type[Any], Any] = {McapLog: _mcap_records, Rosbag1Log: _bag_records, SqliteLog: _database_records}


def _storages(log: Rosbag2Log, copy: Copy) -> Iterator[tuple[str, Log]]:
    """Yield the files of a bag, each with its name; its report is that of the copy meanwhile."""
    whole = copy.report
    for number, storage, copy.report in log.opened(whole):
        yield Path(log.parts[number].path).name, storage
    copy.report = whole


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
    for name, storage in _storages(log, copy):
        path = target / name if is_folder else target
        if is_zstd(Path(log.path) / name if is_folder else Path(log.path)):
            with tempfile.TemporaryDirectory(prefix="lidarcli-", dir=path.parent) as folder:
                plain = Path(folder) / "plain"
                _copy_storage(storage, plain, copy)
                with plain.open("rb") as source, path.open("xb") as out:
                    # With its size at the begin, without which rosbag2 does not unpack it.
                    zstandard.ZstdCompressor().copy_stream(source, out, size=plain.stat().st_size)
        else:
            _copy_storage(storage, path, copy)


def _copy_storage(storage: Log, path: Path, copy: Copy) -> None:
    sound = storage.sound_file() if isinstance(storage, SqliteLog) and not copy.said else None
    if isinstance(storage, SqliteLog) and sound is not None:
        _copy_database(storage, sound, path, copy)
    else:
        _write([storage], [(path, None)], copy)


def _copy_database(bag: SqliteLog, sound: Path, path: Path, copy: Copy) -> None:
    """Write a sound database once more: only the changed messages differ."""
    shutil.copyfile(sound, path)
    scans = {number: where for number, where in _locators(bag).items() if where is not None}
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for pragma in ("journal_mode = off", "synchronous = off", "ignore_check_constraints = on"):
            database.execute(f"PRAGMA {pragma}")
        database.execute("BEGIN")
        for rows in bag.batches([*scans]) if scans else ():
            for row, topic_id, timestamp, data in rows:
                if data is None or timestamp is None:
                    continue
                topic = bag.topic_rows[topic_id]
                changed = copy.edited(topic.name, data, scans[topic_id], topic.encoding)
                if changed is not data:
                    update = f"UPDATE messages SET data = ? WHERE {bag.number} = ?"
                    if (count := database.execute(update, (changed, row)).rowcount) != 1:
                        raise OutputError(f"cannot write {path.name}: {count} messages have the number {row}")
        database.execute("COMMIT")
    for topic_id, count in bag.counts().items():
        if topic_id in bag.topic_rows:
            topic = bag.topic_rows[topic_id]
            copy.messages[topic.name, ros_type(topic.type)] += count
    copy.report.add(bag.met)


def _locators(bag: SqliteLog) -> dict[int, Locator | None]:
    """Return what finds the ranges in the messages of each topic; None for one that is not of sweeps."""
    kinds = {number: bag.read_as(topic) if is_cdr(topic) else "" for number, topic in bag.topic_rows.items()}
    return {number: Locator("cdr", kind == MULTI_ECHO) if kind else None for number, kind in kinds.items()}
