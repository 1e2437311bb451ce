"""Copies of the databases of ROS 2 bags: rows stay what and where they are, and no SQL of a log is run."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from lidarcli.copying.copying import Copy, copy_log
from lidarcli.errors import OutputError
from lidarcli.logs.blocks import ScanLayout
from lidarcli.logs.rosbag2 import Rosbag2Log
from lidarcli.pipeline.reading.one_log import damage_lines
from lidarcli.simulation.writers import write_log
from tests.sweeping import raw_sweeps, round_room

ROWS = 8
COLUMNS = "topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL"
PLAIN = f"CREATE TABLE messages(id INTEGER PRIMARY KEY, {COLUMNS})"
BOMB = "length(hex(zeroblob(150000000))) + length(data)"
"""Takes a gigabyte where it is run."""
OTHERS = (
    "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)",
    "INSERT INTO schema VALUES (4, 'jazzy')",
    "CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL)",
    "INSERT INTO metadata VALUES (3, 9, 'rosbag2_bagfile_information:')",
    'CREATE TABLE "an ""odd"" one"("a b" VARCHAR(10), c)',
    """INSERT INTO "an ""odd"" one" VALUES (1, x'00ff'), (NULL, 2.5), ('1', CAST(x'ff41' AS TEXT))""",
)


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    log = tmp_path_factory.mktemp("scans") / "run.db3"
    write_log(log, [raw_sweeps(round_room(ROWS, 90))])
    return [data for (data,) in asked(log, "SELECT data FROM messages ORDER BY id")]


def asked(path: Path, sql: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as database:
        database.text_factory = bytes
        return database.execute(sql).fetchall()


def database(
    path: Path,
    scans: list[bytes],
    messages: str = PLAIN,
    number: Callable[[int], Any] = lambda row: row + 1,
    more: tuple[str, ...] = (),
    encoding: str = "UTF-8",
) -> Path:
    """A database whose rows are scans and words in turns; `number` is what stands in their `id`."""
    with closing(sqlite3.connect(path)) as made:
        made.execute(f"PRAGMA encoding = '{encoding}'")
        made.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT)"
        )
        kinds = (("/scan", "sensor_msgs/msg/LaserScan"), ("/words", "std_msgs/msg/String"))
        for topic, (name, kind) in enumerate(kinds, 1):
            made.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '- history: 3', 'RIHS01')", (topic, name, kind))
        made.execute(messages)
        for row in range(2 * ROWS):
            data = b"\0\1\0\0words" if row % 2 else scans[row // 2]
            values = (number(row), row % 2 + 1, 10**9 + row, data)
            made.execute("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", values)
        for statement in more:
            made.execute(statement)
        made.commit()
    return path


def changed(topic: str, number: int, data: bytes, written: ScanLayout) -> bytes:
    """A scan whose last byte is another."""
    assert (topic, data[:4]) == ("/scan", b"\0\1\0\0")
    return data[:-1] + b"!"


def copied(log: Path) -> tuple[Path, list[str]]:
    """The copy of a log in which all scans are changed, and the damage that is told."""
    out, copy = log.with_name("copy.db3"), Copy(changed)
    with closing(Rosbag2Log(log)) as opened:
        copy_log(opened, out, copy)
    assert copy.messages["/scan", "sensor_msgs/msg/LaserScan"] == ROWS
    return out, damage_lines(copy.report)


KEYS: dict[str, tuple[str, Callable[[int], Any]]] = {
    "primary key": (PLAIN, lambda row: row + 1),
    "with gaps": (PLAIN, lambda row: 1000 * row - 5),
    "of each topic": (f"CREATE TABLE messages(id INTEGER, {COLUMNS})", lambda row: row // 2 + 1),
    "all the same": (f"CREATE TABLE messages(id INTEGER, {COLUMNS})", lambda row: 1),
    "backwards": (f"CREATE TABLE messages(id INTEGER, {COLUMNS})", lambda row: -row),
    "none": (f"CREATE TABLE messages(id INTEGER, {COLUMNS})", lambda row: None),
    "text": (f"CREATE TABLE messages(id TEXT PRIMARY KEY, {COLUMNS})", lambda row: f"m{row}"),
    "real": (f"CREATE TABLE messages(id REAL, {COLUMNS})", lambda row: row + 0.5),
    "no rowid by a quirk": (f"CREATE TABLE messages(id INTEGER PRIMARY KEY DESC, {COLUMNS})", lambda row: 99 - row),
    "without rowid": (f"{PLAIN} WITHOUT ROWID", lambda row: row + 1),
    "beside a rowid": (f"CREATE TABLE messages(id INTEGER, {COLUMNS}, rowid TEXT DEFAULT 'x')", lambda row: 1),
    "checked": (PLAIN.replace("data BLOB NOT NULL", f"data BLOB CHECK ({BOMB} > 0)"), lambda row: row),
}


@pytest.mark.parametrize("key", KEYS)
def test_only_scans_change_whatever_numbers_the_rows(key: str, scans: list[bytes], tmp_path: Path) -> None:
    messages, number = KEYS[key]
    # A check of this cost cannot be run while the log is made.
    made = messages.replace(BOMB, "length(data)")
    log = database(tmp_path / "run.db3", scans, made, number, OTHERS)
    if made != messages:
        with closing(sqlite3.connect(log)) as again:
            again.execute("PRAGMA writable_schema = on")
            again.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'messages'", (messages,))
            again.commit()
    before, order = log.read_bytes(), "SELECT * FROM messages"
    out, damage = copied(log)
    assert (log.read_bytes(), damage) == (before, [])
    wanted = [(*row[:3], row[3] if row[1] == 2 else row[3][:-1] + b"!", *row[4:]) for row in asked(log, order)]
    assert asked(out, order) == wanted
    for table in ("topics", "schema", "metadata", '"an ""odd"" one"'):
        assert asked(out, f"SELECT * FROM {table}") == asked(log, f"SELECT * FROM {table}")


def test_an_index_of_the_log_is_not_computed_and_that_of_rosbag2_is_there(scans: list[bytes], tmp_path: Path) -> None:
    log = database(tmp_path / "run.db3", scans, more=("CREATE INDEX odd ON messages(length(data))",))
    with closing(sqlite3.connect(log)) as made:
        made.execute("PRAGMA writable_schema = on")
        made.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'odd'", (f"CREATE INDEX odd ON messages({BOMB})",))
        made.commit()
    indexes = asked(copied(log)[0], "SELECT name FROM sqlite_master WHERE type = 'index'")
    assert indexes == [(b"timestamp_idx",)]


def test_rows_that_are_no_messages_stay(scans: list[bytes], tmp_path: Path) -> None:
    odd = (
        "INSERT INTO messages VALUES (100, 77, 5, x'00')",
        "INSERT INTO messages VALUES (101, 2, 'late', x'00')",
        "INSERT INTO messages VALUES (102, 2, 5, 'text')",
    )
    log = database(tmp_path / "run.db3", scans, more=odd)
    rows = "SELECT * FROM messages WHERE id >= 100"
    assert asked(copied(log)[0], rows) == asked(log, rows)


def test_rows_that_cannot_be_told_apart_are_refused(scans: list[bytes], tmp_path: Path) -> None:
    messages = f"CREATE TABLE messages(id INTEGER, {COLUMNS}, PRIMARY KEY (topic_id, id)) WITHOUT ROWID"
    log = database(tmp_path / "run.db3", scans, messages, lambda row: row // 2 + 1)
    with pytest.raises(OutputError, match=r"^cannot write copy\.db3: 2 messages have the number 1$"):
        copied(log)


def test_a_table_that_would_be_computed_is_left_out_and_told(scans: list[bytes], tmp_path: Path) -> None:
    log = database(tmp_path / "run.db3", scans, more=("CREATE TABLE more(a, b AS (a + 1))",))
    out, damage = copied(log)
    words = "more has columns that would be computed; topics and messages alone are copied"
    assert damage == [f"database: {words}"]
    assert len(asked(out, "SELECT * FROM messages")) == 2 * ROWS


def test_a_linked_metadata_is_not_copied(tmp_path: Path) -> None:
    """It may lead to any file of whoever reads the bag."""
    log, secret, out = tmp_path / "run", tmp_path / "secret", tmp_path / "out"
    write_log(log, [raw_sweeps(round_room(4))])
    secret.write_text("the key")
    (log / "metadata.yaml").unlink()
    (log / "metadata.yaml").symlink_to(secret)
    copy = Copy(changed)
    with closing(Rosbag2Log(log)) as opened:
        copy_log(opened, out, copy)
    assert "metadata.yaml: is a link, and not copied; 'ros2 bag reindex' makes a new one" in damage_lines(copy.report)
    assert [path.name for path in out.iterdir()] == ["run.db3"]
