"""Databases of ROS 2 bags as killed recorders leave them, and as somebody makes them to do harm."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

from tests.logs.numbered import laser_scan, record_time

STORE = get_typestore(Stores.ROS2_HUMBLE)
SCAN = "sensor_msgs/msg/LaserScan"
PAGE = 4096
JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"


def scan(index: int) -> bytes:
    return bytes(STORE.serialize_cdr(laser_scan(STORE.types, index), SCAN))


def bag(path: Path, ids: list[int] | None = None, sweeps: int = 20) -> sqlite3.Connection:
    """A database as ROS 2 writes it, with scans at the given row ids; open, each statement a transaction."""
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    database.execute(MESSAGES)
    database.execute(f"INSERT INTO topics VALUES (1, '/scan', '{SCAN}', 'cdr')")
    rows = [
        (ids[index] if ids else index + 1, record_time(index), scan(index)) for index in range(len(ids or range(sweeps)))
    ]
    database.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", rows)
    return database


def killed(folder: Path, first: int = 30, second: int = 400) -> Path:
    """A database and its journal, left by a recorder that was killed amid a transaction with pages on the disk."""
    work = folder / "work.db3"
    database = bag(work, sweeps=first)
    database.execute("PRAGMA journal_mode = delete")
    database.execute("PRAGMA cache_size = 5")
    database.execute("BEGIN")
    database.execute("UPDATE messages SET data = zeroblob(200)")
    for index in range(first, second):
        values = (record_time(index), scan(index))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", values)
    target = folder / "run.db3"
    shutil.copy(work, target)
    shutil.copy(f"{work}-journal", f"{target}-journal")
    database.close()
    work.unlink()
    return target


def name_super_journal(journal: Path, name: str) -> None:
    """The end of a journal that is a part of a transaction over several databases."""
    encoded = name.encode()
    with journal.open("ab") as file:
        file.write(struct.pack(">I", (1 << 30) // PAGE + 1) + encoded)
        file.write(struct.pack(">II", len(encoded), sum(encoded)) + JOURNAL_MAGIC)


ENDLESS = "WITH RECURSIVE r(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM r)"
MESSAGES_VIEW = "CREATE VIEW messages AS"
TOPICS_VIEW = "CREATE VIEW topics AS"
NO_MESSAGES, NO_TOPICS = "ALTER TABLE messages RENAME TO m", "ALTER TABLE topics RENAME TO t"
TOPIC = "'b' type, 'cdr' serialization_format"
HOSTILE: dict[str, tuple[tuple[str, ...], str]] = {
    "endless messages": (
        (NO_MESSAGES, f"{MESSAGES_VIEW} {ENDLESS} SELECT i id, 1 topic_id, i timestamp, x'00' data FROM r"),
        "messages is a view that would run",
    ),
    "endless topics": (
        (NO_TOPICS, f"{TOPICS_VIEW} {ENDLESS} SELECT i id, 'a' name, {TOPIC} FROM r"),
        "topics is a view that would run",
    ),
    "random messages": (
        (
            NO_MESSAGES,
            f"{MESSAGES_VIEW} {ENDLESS} SELECT i id, 1 topic_id, i timestamp, randomblob(8000000) data FROM r"
            " WHERE i < 100000",
        ),
        "messages is a view that would run",
    ),
    "a long name": (
        (NO_TOPICS, f"{TOPICS_VIEW} SELECT 1 id, hex(zeroblob(250000000)) name, {TOPIC}"),
        "topics is a view that would run",
    ),
    "a trigger": (
        ("CREATE TRIGGER bang AFTER INSERT ON messages BEGIN DELETE FROM messages; END",),
        "bang is a trigger that would run",
    ),
    "a computed column": (
        ("ALTER TABLE messages ADD COLUMN more BLOB AS (zeroblob(800000000))",),
        "messages has columns that would be computed",
    ),
    "a virtual table": (("CREATE VIRTUAL TABLE other USING fts5(words)",), "other is a table that would run"),
}
