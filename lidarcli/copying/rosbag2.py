"""Copies of ROS 2 bags: a folder or one file of SQLite, packed as they were; of databases the rows alone change."""

from __future__ import annotations

import re
import shutil
import sqlite3
import tempfile
from contextlib import closing
from functools import partial
from operator import itemgetter
from pathlib import Path
from urllib.parse import quote

import zstandard

from lidarcli.copying.copies import Copy
from lidarcli.copying.mcap import copy_mcap, edited
from lidarcli.errors import OutputError
from lidarcli.logs.base import MULTI_ECHO, ros_type
from lidarcli.logs.laserscan import locate
from lidarcli.logs.mcap.log import McapLog
from lidarcli.logs.rosbag2.database import BATCH, ROWID, SQLITE_ERRORS, SqliteBag, is_cdr, quoted
from lidarcli.logs.rosbag2.log import DatabaseLog, Rosbag2Log
from lidarcli.logs.unpacking import Unpacking, is_zstd
from lidarcli.ros.bag_metadata import METADATA

_INDEX = "timestamp_idx ON messages (timestamp ASC)"
_TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
    "data BLOB NOT NULL)",
    f"CREATE INDEX {_INDEX}",
)
"""Tables of a bag, as rosbag2 makes them."""
_NAMES = "SELECT name FROM main.sqlite_master WHERE type = 'table' AND substr(name, 1, 7) != 'sqlite_'"
_TYPE = re.compile(r"\w{1,40}")
"""Types of columns that are declared as in the log; a column of any other takes all values as they are."""
_BEYOND = 1 << 63
"""A rowid is below."""


def copy_folder(log: Rosbag2Log, target: Path, copy: Copy) -> None:
    """Write a bag once more: a folder for a folder, with files of the same names, or one file."""
    is_folder = Path(log.path).is_dir()
    if is_folder:
        target.mkdir()
        _copy_metadata(Path(log.path) / METADATA, target / METADATA, copy)
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


def _copy_metadata(source: Path, target: Path, copy: Copy) -> None:
    """Copy the metadata.yaml of a bag; a link may lead to any file of whoever reads the bag."""
    if source.is_symlink():
        copy.report.add_damage(METADATA, "is a link, and not copied; 'ros2 bag reindex' makes a new one")
    elif source.is_file():
        shutil.copyfile(source, target)


def _copy_storage(storage: object, path: Path, copy: Copy) -> None:
    if isinstance(storage, McapLog):
        with path.open("xb") as out:
            copy_mcap(storage, out, copy)
    else:
        assert isinstance(storage, DatabaseLog)
        try:
            _copy_database(storage.bag, path, copy)
        except SQLITE_ERRORS as err:
            raise OutputError(f"cannot write {path.name}: SQLite says: {err}") from err
        copy.report.add(storage.met)


def _pack(plain: Path, path: Path) -> None:
    """Pack a file by zstd, with its size at the begin, without which rosbag2 does not unpack it."""
    with plain.open("rb") as source, path.open("xb") as out:
        zstandard.ZstdCompressor().copy_stream(source, out, size=plain.stat().st_size)


def _copy_database(bag: SqliteBag, path: Path, copy: Copy) -> None:
    """Write a database once more: a sound one with all its tables, of a damaged one what can be read."""
    sound = bag.sound_file()
    if sound is None:
        _write_anew(bag, path, copy)
        return
    scans = [topic.id for topic in bag.topics.values() if is_cdr(topic) and bag.read_as(topic)]
    unpacking = Unpacking()
    where = f"file:{quote(str(sound.absolute()))}?mode=ro&immutable=1"
    with closing(sqlite3.connect(where, uri=True, isolation_level=None)) as database:
        database.execute("ATTACH ? AS copy", (f"file:{quote(str(path.absolute()))}",))
        database.execute("PRAGMA copy.journal_mode = off")
        database.execute("PRAGMA copy.synchronous = off")
        database.execute("BEGIN")
        for (name,) in database.execute(_NAMES).fetchall():
            _copy_table(database, quoted(name), name.lower() == "messages" and bag.number == ROWID)
        database.execute(f"CREATE INDEX copy.{_INDEX}")
        for rows in bag.batches(scans) if scans else ():
            for row, topic_id, timestamp, data in rows:
                if data is None or timestamp is None:
                    continue
                changed = _edited(bag, topic_id, data, copy, unpacking)
                if changed is not data:
                    update = f"UPDATE copy.messages SET data = ? WHERE {bag.number} = ?"
                    if (count := database.execute(update, (changed, row)).rowcount) != 1:
                        raise OutputError(f"cannot write {path.name}: {count} messages have the number {row}")
        database.execute("COMMIT")
    for topic_id, count in bag.counts().items():
        if (topic := bag.topics.get(topic_id)) is not None:
            copy.messages[topic.name, ros_type(topic.type)] += count


def _copy_table(database: sqlite3.Connection, table: str, is_numbered: bool) -> None:
    """Copy a table with all its rows into columns of our own: what else a log declares is SQL that would run.

    `is_numbered`: its rows keep their rowids, and come a few at a time, between which an interrupt is heard.
    """
    columns = database.execute(f"PRAGMA main.table_info({table})").fetchall()
    indexes = database.execute(f"PRAGMA main.index_list({table})").fetchall()
    # INTEGER stands for the rowid in a key that has no index of its own, and INT for any number.
    has_key = any(origin == "pk" for _, _, _, origin, _ in indexes)
    kinds = {"INTEGER": "INT"} if has_key else {}
    declared = [
        f"{quoted(name)} {kinds.get(kind.upper(), kind) if _TYPE.fullmatch(kind) else ''}" for _, name, kind, *_ in columns
    ]
    if keys := [quoted(name) for _, name, *_, place in sorted(columns, key=itemgetter(5)) if place]:
        declared.append(f"PRIMARY KEY ({', '.join(keys)})")
    database.execute(f"CREATE TABLE copy.{table} ({', '.join(declared)})")
    if not is_numbered:
        database.execute(f"INSERT INTO copy.{table} SELECT * FROM main.{table} NOT INDEXED")
        return
    names = ", ".join(quoted(name) for _, name, *_ in columns)
    first, copied = -_BEYOND, 1
    while copied and first < _BEYOND:
        copied = database.execute(
            f"INSERT INTO copy.{table} ({ROWID}, {names}) SELECT {ROWID}, {names} FROM main.{table} NOT INDEXED "
            f"WHERE {ROWID} >= ? ORDER BY {ROWID} LIMIT {BATCH}",
            (first,),
        ).rowcount
        (last,) = database.execute(f"SELECT max({ROWID}) FROM copy.{table}").fetchone()
        first = first if last is None else last + 1


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
