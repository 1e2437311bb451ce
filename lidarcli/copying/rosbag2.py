"""Copies of ROS 2 bags: a folder or one file of SQLite, packed as they were; of databases the rows alone change."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from contextlib import closing
from functools import partial
from pathlib import Path
from urllib.parse import quote

import zstandard

from lidarcli.copying.copies import Copy
from lidarcli.copying.mcap import copy_mcap, edited
from lidarcli.errors import OutputError
from lidarcli.logs.base import MULTI_ECHO, ros_type
from lidarcli.logs.laserscan import locate
from lidarcli.logs.mcap.log import McapLog
from lidarcli.logs.rosbag2.database import SqliteBag, is_cdr
from lidarcli.logs.rosbag2.folder import METADATA
from lidarcli.logs.rosbag2.log import DatabaseLog, Rosbag2Log
from lidarcli.logs.unpacking import Unpacking, is_zstd

_TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
    "data BLOB NOT NULL)",
    "CREATE INDEX timestamp_idx ON messages (timestamp ASC)",
)
"""Tables of a bag, as rosbag2 makes them."""


def copy_folder(log: Rosbag2Log, target: Path, copy: Copy) -> None:
    """Write a bag once more: a folder for a folder, with files of the same names, or one file."""
    is_folder = Path(log.path).is_dir()
    if is_folder:
        target.mkdir()
        if (Path(log.path) / METADATA).is_file():
            shutil.copyfile(Path(log.path) / METADATA, target / METADATA)
    for number, storage, report in log.opened(copy.report):
        original = Path(log.parts[number].path)
        path = target / original.name if is_folder else target
        mine = Copy(copy.edit, report, copy.messages)
        if is_zstd(original):
            with tempfile.TemporaryDirectory(prefix="lidarcli-", dir=path.parent) as folder:
                plain = Path(folder) / "plain"
                _copy_storage(storage, plain, mine)
                _pack(plain, path)
        else:
            _copy_storage(storage, path, mine)
        copy.left_out += mine.left_out


def _copy_storage(storage: object, path: Path, copy: Copy) -> None:
    if isinstance(storage, McapLog):
        with path.open("xb") as out:
            copy_mcap(storage, out, copy)
    else:
        assert isinstance(storage, DatabaseLog)
        try:
            _copy_database(storage.bag, path, copy)
        except sqlite3.Error as err:
            raise OutputError(f"cannot write {path.name}: SQLite says: {err}") from err
        copy.report.add(storage.met)


def _pack(plain: Path, path: Path) -> None:
    """Pack a file by zstd, with its size at the begin, without which rosbag2 does not unpack it."""
    with plain.open("rb") as source, path.open("xb") as out:
        zstandard.ZstdCompressor().copy_stream(source, out, size=plain.stat().st_size)


def _copy_database(bag: SqliteBag, path: Path, copy: Copy) -> None:
    """Write a database once more: a sound one with all that is in it, of a damaged one what can be read."""
    sound = bag.sound_file
    if sound is None or not _is_whole(sound):
        _write_anew(bag, path, copy)
        return
    shutil.copyfile(sound, path)
    scans = [topic.id for topic in bag.topics.values() if is_cdr(topic) and bag.read_as(topic)]
    unpacking = Unpacking()
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = memory")
        database.execute("PRAGMA synchronous = off")
        for rows in bag.batches(scans) if scans else ():
            changes = []
            for row, topic_id, timestamp, data in rows:
                if data is None or timestamp is None:
                    continue
                changed = _edited(bag, topic_id, data, copy, unpacking)
                if changed is not data:
                    changes.append((changed, row))
            database.executemany("UPDATE messages SET data = ? WHERE id = ?", changes)
        database.commit()
    for topic_id, count in bag.counts().items():
        if (topic := bag.topics.get(topic_id)) is not None:
            copy.messages[topic.name, ros_type(topic.type)] += count


def _is_whole(path: Path) -> bool:
    """Return True if SQLite finds no page damaged."""
    with closing(
        sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)
    ) as database:
        try:
            return bool(database.execute("PRAGMA quick_check(1)").fetchone() == ("ok",))
        except sqlite3.Error:
            return False


def _edited(bag: SqliteBag, topic_id: int, data: bytes, copy: Copy, unpacking: Unpacking) -> bytes:
    topic = bag.topics[topic_id]
    kind = bag.read_as(topic)
    if not is_cdr(topic) or not kind:
        return data
    where = partial(locate, encoding="cdr", several=kind == MULTI_ECHO)
    return edited(copy, topic.name, data, where, unpacking)


def _write_anew(bag: SqliteBag, path: Path, copy: Copy) -> None:
    """Write the topics and messages of a damaged database that can be read into a new one."""
    unpacking = Unpacking()
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = memory")
        database.execute("PRAGMA synchronous = off")
        for statement in _TABLES:
            database.execute(statement)
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, ?, '')",
            [(topic.id, topic.name, topic.type, topic.encoding) for topic in bag.topics.values()],
        )
        for rows in bag.batches([*bag.topics]):
            whole = [row for row in rows if row[2] is not None and row[3] is not None]
            for row, topic_id, timestamp, data in whole:
                assert data is not None
                data = _edited(bag, topic_id, data, copy, unpacking)
                database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", (row, topic_id, timestamp, data))
                topic = bag.topics[topic_id]
                copy.messages[topic.name, ros_type(topic.type)] += 1
        database.commit()
