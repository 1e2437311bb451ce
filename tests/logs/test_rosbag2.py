"""ROS 2 bags: every storage read back value by value; broken databases, metadata and leftovers of recorders."""

from __future__ import annotations

import os
import random
import re
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from lidarcli.errors import UnreadableError
from lidarcli.logs import base, unpacking
from lidarcli.logs.base import LASERSCAN, Topic
from lidarcli.logs.rosbag2 import read_folder
from lidarcli.logs.unpacking import unpack_file
from tests.logs.numbered import indices, laser_scan, ranges_of, record_time
from tests.logs.numbered import read_bag as read
from tests.logs.watched import Rosbag2Log

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
SCAN = "sensor_msgs/msg/LaserScan"
TEXT = "std_msgs/msg/String"


def scan(index: int, beams: int = 37) -> bytes:
    return bytes(STORE.serialize_cdr(laser_scan(TYPES, index, beams), SCAN))


def text(value: str) -> bytes:
    return bytes(STORE.serialize_cdr(TYPES[TEXT](data=value), TEXT))


def write_bag(
    path: Path,
    indices: range = range(60),
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
    beams: int = 37,
) -> Path:
    """A bag of scans on /scan, with a string on /chatter after every fourth; its storage file."""
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        scans = writer.add_connection("/scan", SCAN, typestore=STORE)
        chatter = writer.add_connection("/chatter", TEXT, typestore=STORE)
        for index in indices:
            writer.write(scans, record_time(index), scan(index, beams))
            if index % 4 == 0:
                writer.write(chatter, record_time(index) + 1, text(f"message {index}"))
    (file,) = (item for item in path.iterdir() if item.name != "metadata.yaml")
    return file


pytestmark = pytest.mark.usefixtures("nothing_left_behind")


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        # This storage packs its chunks instead of its messages.
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
    ],
)
def test_reads_back_every_value(tmp_path: Path, storage: StoragePlugin, mode: CompressionMode) -> None:
    file = write_bag(tmp_path / "bag", range(700), storage, mode)
    before = sorted((item.name, item.stat().st_size) for item in (tmp_path / "bag").iterdir())
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        name = "mcap" if storage is StoragePlugin.MCAP else "sqlite3"
        assert log.format == f"ros2 bag ({name})"
        assert log.size == file.stat().st_size
        assert log.topics() == [Topic("/scan", LASERSCAN, "cdr", 700), Topic("/chatter", TEXT, "cdr", 175)]
        assert indices(log) == list(range(700))
        assert log.report.damage == []
        assert log.report.notes == []
        assert log.position == log.size
        assert log.compression == ("none" if mode is CompressionMode.NONE else "zstd")
        messages = list(log.messages({TEXT}))
        assert [m.data for m in messages] == [text(f"message {i}") for i in range(0, 700, 4)]
        assert [m.record_ns for m in messages] == [record_time(i) + 1 for i in range(0, 700, 4)]
        assert {(m.topic, m.type, m.encoding) for m in messages} == {("/chatter", TEXT, "cdr")}
    assert sorted((item.name, item.stat().st_size) for item in (tmp_path / "bag").iterdir()) == before


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.FILE])
def test_a_bare_storage_file(tmp_path: Path, mode: CompressionMode) -> None:
    file = write_bag(tmp_path / "bag", mode=mode)
    assert file.name == ("bag.db3" if mode is CompressionMode.NONE else "bag.db3.zstd")
    assert read(file) == (list(range(60)), [])


# Old schemas and odd rows.


def plain_database(path: Path, rows: list[tuple[Any, ...]], topics: str = "") -> None:
    """A database as Foxy and its forerunners made them."""
    database = sqlite3.connect(path)
    columns = "id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL"
    database.execute(f"CREATE TABLE topics({columns}{topics})")
    database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    more = ", ''" if topics else ""
    database.execute(f"INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr'{more})")
    database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    database.commit()
    database.close()


@pytest.mark.parametrize("topics", ["", ", offered_qos_profiles TEXT NOT NULL"])
def test_old_schemas(tmp_path: Path, topics: str) -> None:
    rows = [(i + 1, 1, record_time(i), scan(i)) for i in range(20)]
    plain_database(tmp_path / "a.db3", rows, topics)
    assert read(tmp_path / "a.db3") == (list(range(20)), [])
    data = (tmp_path / "a.db3").read_bytes()
    (tmp_path / "b.db3").write_bytes(data[: len(data) - 4096])
    found, damage = read(tmp_path / "b.db3")
    assert found == list(range(len(found)))
    assert len(found) > 10
    assert len(damage) == 1


def test_rows_that_are_no_message_are_refused_alone(tmp_path: Path) -> None:
    good = [(10 * i + 1, 1, record_time(i), scan(i)) for i in range(20)]
    odd = [
        (15, 1, record_time(1), None),
        (25, 1, record_time(2), "text"),
        (35, 1, record_time(3), b""),
        (45, 1, record_time(4), scan(4)[:60]),
        (55, 1, "noon", scan(5)),
        (65, 7, record_time(6), scan(6)),
        (75, 1, record_time(6), bytes(base.MAX_MESSAGE + 1)),
    ]
    plain_database(tmp_path / "a.db3", sorted(good + odd))
    with Rosbag2Log(str(tmp_path / "a.db3")) as log:
        assert indices(log) == list(range(20))
        assert log.report.refused.total() == 6
        assert log.report.refused["/scan", "no data, or more than a sweep can have"] == 3
        for _ in range(2):
            assert [topic.messages for topic in log.topics()] == [25 + 1]
            assert [(item.place, item.cause) for item in log.report.damage] == [
                ("topics table", "has no topic 7; messages lost: 1")
            ]


@pytest.mark.parametrize("value", ["NULL", "x'00ff'", "7"])
@pytest.mark.parametrize("column", ["name", "type", "serialization_format"])
def test_a_topic_that_is_none_costs_its_own_messages_alone(tmp_path: Path, column: str, value: str) -> None:
    rows = [(i + 1, 1 + i % 2, record_time(i), scan(i)) for i in range(20)]
    plain_database(tmp_path / "a.db3", rows)
    with sqlite3.connect(tmp_path / "a.db3") as database:
        database.execute("CREATE TABLE loose(id INTEGER PRIMARY KEY, name, type, serialization_format)")
        database.execute("INSERT INTO loose SELECT * FROM topics")
        database.execute("INSERT INTO loose VALUES (2, '/rear', 'sensor_msgs/msg/LaserScan', 'cdr')")
        database.execute(f"UPDATE loose SET {column} = {value} WHERE id = 2")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE loose RENAME TO topics")
    database.close()
    with Rosbag2Log(str(tmp_path / "a.db3")) as log:
        assert log.topics() == [Topic("/scan", LASERSCAN, "cdr", 10)]
        assert indices(log) == list(range(0, 20, 2))
        assert [item.cause for item in log.report.damage] == ["has no topic 2; messages lost: 10"]


# Leftovers of recorders that were stopped the hard way.


def wal_bag(folder: Path) -> Path:
    """A database with 30 scans in its file and 30 more in a write-ahead log beside it."""
    file = write_bag(folder / "source", range(30))
    work = folder / "work.db3"
    shutil.copy(file, work)
    database = sqlite3.connect(work, isolation_level=None)
    database.execute("PRAGMA journal_mode = wal")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    for index in range(30, 60):
        values = (record_time(index), scan(index))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", values)
    bag = folder / "bag"
    bag.mkdir()
    shutil.copy(work, bag / "bag_0.db3")
    shutil.copy(f"{work}-wal", bag / "bag_0.db3-wal")
    database.close()
    return bag


def test_write_ahead_log(tmp_path: Path) -> None:
    bag = wal_bag(tmp_path)
    before = {item.name: item.read_bytes() for item in bag.iterdir()}
    bag.chmod(0o555)
    try:
        assert read(bag) == (list(range(60)), [])
        assert {item.name: item.read_bytes() for item in bag.iterdir()} == before
    finally:
        bag.chmod(0o755)


def test_a_recorder_killed_amid_a_transaction(tmp_path: Path) -> None:
    """Recorders keep the journal in memory: what the transaction wrote stands in the file, but not in its tree."""
    file = write_bag(tmp_path / "bag", range(30), beams=361)
    work = tmp_path / "work.db3"
    shutil.copy(file, work)
    database = sqlite3.connect(work, isolation_level=None)
    database.execute("PRAGMA journal_mode = memory")
    database.execute("PRAGMA cache_size = 5")
    database.execute("BEGIN")
    for index in range(30, 200):
        values = (record_time(index), scan(index, 361))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", values)
    shutil.copy(work, tmp_path / "killed.db3")
    database.close()
    found, damage = read(tmp_path / "killed.db3")
    assert found == list(range(len(found)))
    assert len(found) > 170
    assert re.match(r"database: not closed properly: [\d,]+ bytes behind its declared end; read page", damage[0])


# Truncated and flipped databases.


def last_bytes(data: bytes, beams: int) -> list[int]:
    """For each of the 60 scans, where the last of its pieces stands; a scan may be spread over many pages."""
    found = []
    for index in range(60):
        raw = ranges_of(index, beams).tobytes()
        pieces = (data.rfind(raw[at : at + 20]) for at in range(0, len(raw), 20))
        found.append(max(pieces) + 20)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("beams", [37, 361, 3000])
def test_truncation_gives_what_is_whole(tmp_path: Path, beams: int) -> None:
    """3000 beams need chains of overflow pages."""
    file = write_bag(tmp_path / "bag", beams=beams)
    data = file.read_bytes()
    ends = last_bytes(data, beams)
    cut = tmp_path / "cut.db3"
    for size in sorted(random.Random(beams).sample(range(9 * 4096, len(data)), 40)):
        cut.write_bytes(data[:size])
        found, damage = read(cut)
        assert found == sorted(set(found))
        assert {index for index in range(60) if ends[index] + 50 <= size} <= set(found), size
        assert set(found) <= {index for index in range(60) if ends[index] <= size + 50}, size
        assert len(damage) == 1
        assert re.fullmatch(
            rf"database: cut off: {size:,} of {len(data):,} bytes; read page by page: {len(found)} messages"
            r" recovered(, \d+ not whole)?(, \d+ of all topics missing before the last)?",
            damage[0],
        ), damage[0]


def test_a_flipped_page_costs_its_own_messages_alone(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "bag", beams=361)
    data = file.read_bytes()
    rng = random.Random(2)
    for page in range(1, len(data) // 4096):
        broken = bytearray(data)
        broken[page * 4096 : (page + 1) * 4096] = rng.randbytes(4096)
        flipped = tmp_path / "flipped.db3"
        flipped.write_bytes(broken)
        with Rosbag2Log(str(flipped)) as log:
            blocks = list(log.scans())
            first = [round(float(value)) for block in blocks for value in block.ranges[:, 0]]
            damage = log.report.damage
        assert first == sorted(set(first))
        # A page holds two messages and a half; the first ones are in the topics' own page or the like.
        assert len(first) >= 56, (page, first)
        if len(first) < 60:
            assert damage or log.report.refused, page


def test_lost_topics_table(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "bag", beams=361)
    data = bytearray(file.read_bytes())
    for row in re.finditer(rb"/scan|/chatter", bytes(data)):
        page = row.start() // 4096 * 4096
        data[page : page + 4096] = bytes(4096)
    file.write_bytes(data)
    with Rosbag2Log(str(file)) as log:
        blocks = list(log.scans())
        assert {block.topic for block in blocks} == {"/topic_1"}
        assert sum(map(len, blocks)) >= 55
        assert [(topic.name, topic.type) for topic in log.topics() or []] == [("/topic_1", LASERSCAN)]
        assert log.report.damage


def test_broken_header(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "bag")
    data = bytearray(file.read_bytes())
    data[:100] = bytes(100)
    file.write_bytes(data)
    found, damage = read(file)
    assert found == list(range(60))
    assert "read page by page: 60 messages recovered" in damage[0]


def split_bag(folder: Path, parts: int = 12) -> None:
    """A bag of several storage files of five scans each, as a recorder splits it."""
    folder.mkdir()
    for part in range(parts):
        file = write_bag(folder / f"part{part}", range(5 * part, 5 * part + 5))
        file.rename(folder / f"bag_{part}.db3")
        shutil.rmtree(folder / f"part{part}")


def metadata(folder: Path, names: list[str]) -> None:
    lines = "".join(f"\n  - {name}" for name in names)
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:{lines}\n")


def test_several_files_in_numeric_order(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag")
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        assert indices(log) == list(range(60))
        assert log.report.notes == ["metadata.yaml is missing, the storage files were read without it"]
        assert log.report.damage == []
        assert log.topics() == [Topic("/scan", LASERSCAN, "cdr", 60), Topic("/chatter", TEXT, "cdr", 15)]
        assert log.position == log.size


@pytest.mark.parametrize("lines", ["[bag_1.db3, 'bag_0.db3']", '\n  - "bag_1.db3"\n  - bag/bag_0.db3 '])
def test_ways_to_write_a_list(tmp_path: Path, lines: str) -> None:
    split_bag(tmp_path / "bag", 2)
    (tmp_path / "bag" / "metadata.yaml").write_text(f"info:\n  relative_file_paths: {lines}\n  files:\n  - path: x\n")
    assert read(tmp_path / "bag") == ([*range(5, 10), *range(5)], [])


def test_metadata_names_files_that_are_not_there(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag", 3)
    metadata(tmp_path / "bag", ["bag_0.db3", "bag_1.db3", "bag_2.db3", "../../bag_3.db3"])
    assert read(tmp_path / "bag") == (list(range(15)), ["bag_3.db3: metadata.yaml names this file, but it is not there"])


def test_metadata_names_too_few_files(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag")
    metadata(tmp_path / "bag", ["bag_0.db3", "bag_2.db3"])
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        assert indices(log) == list(range(60))
        unnamed = ", ".join(f"bag_{part}.db3" for part in range(12) if part not in (0, 2))
        assert log.report.notes == [f"metadata.yaml does not name {unnamed}: read as well"]
        assert log.report.damage == []


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("a: 1\n<<<<<<<< HEAD\nb\n========\n", "metadata.yaml holds an unresolved merge conflict"),
        ("", "metadata.yaml lists no files"),
        ("[1, 2]", "metadata.yaml lists no files"),
        ("rosbag2_bagfile_information: {version: 5}", "metadata.yaml lists no files"),
        ("rosbag2_bagfile_information:\n  relative_file_paths:\n  files:\n", "metadata.yaml lists no files"),
        ("\x00\x01\xff", "metadata.yaml lists no files"),
        ("[" * 1_000_000, "metadata.yaml lists no files"),
    ],
)
def test_broken_metadata_is_a_note_only(tmp_path: Path, text: str, note: str) -> None:
    split_bag(tmp_path / "bag", 2)
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        assert indices(log) == list(range(10))
        assert log.report.damage == []
        assert log.report.notes == [f"{note}, the storage files were read without it"]


@pytest.mark.parametrize("kind", ["pipe", "folder"])
def test_metadata_that_is_no_file_is_not_opened(tmp_path: Path, kind: str) -> None:
    """A pipe would have to be written to before anything comes out of it."""
    split_bag(tmp_path / "bag", 2)
    metadata = tmp_path / "bag" / "metadata.yaml"
    if kind == "pipe":
        os.mkfifo(metadata)
    else:
        metadata.mkdir()
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        assert indices(log) == list(range(10))
        assert log.report.damage == []
        assert log.report.notes == ["metadata.yaml is no file, the storage files were read without it"]


def test_packed_and_unpacked_twins_are_read_once(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag", 2)
    for part in range(2):
        file = tmp_path / "bag" / f"bag_{part}.db3"
        (tmp_path / "bag" / f"bag_{part}.db3.zstd").write_bytes(zstandard.compress(file.read_bytes()))
    assert [file.name for file in read_folder(tmp_path / "bag")[0]] == ["bag_0.db3", "bag_1.db3"]
    metadata(tmp_path / "bag", ["bag_0.db3.zstd", "bag_1.db3.zstd"])
    assert [file.name for file in read_folder(tmp_path / "bag")[0]] == ["bag_0.db3.zstd", "bag_1.db3.zstd"]
    assert read(tmp_path / "bag") == (list(range(10)), [])


def test_storages_may_be_mixed(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag", 2)
    file = write_bag(tmp_path / "other", range(10, 20), StoragePlugin.MCAP)
    file.rename(tmp_path / "bag" / "bag_2.mcap")
    with Rosbag2Log(str(tmp_path / "bag")) as log:
        assert log.format == "ros2 bag (sqlite3+mcap)"
        assert indices(log) == list(range(20))
        assert log.report.damage == []


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_one_broken_file_costs_no_other(tmp_path: Path, storage: StoragePlugin) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    suffix = "mcap" if storage is StoragePlugin.MCAP else "db3"
    for part in range(3):
        file = write_bag(tmp_path / f"part{part}", range(100 * part, 100 * part + 100), storage)
        data = file.read_bytes()
        size = len(data) * 2 // 3 if part == 1 else len(data)
        (folder / f"bag_{part}.{suffix}").write_bytes(data[:size])
    found, damage = read(folder)
    assert found[:100] == list(range(100))
    assert found[-100:] == list(range(200, 300))
    assert found == sorted(set(found))
    if storage is StoragePlugin.SQLITE3:
        assert len(found) > 220
    assert damage
    assert all(line.startswith(f"bag_1.{suffix}: ") for line in damage)


def test_a_file_that_is_nothing_costs_no_other(tmp_path: Path) -> None:
    split_bag(tmp_path / "bag", 3)
    (tmp_path / "bag" / "bag_0.db3").write_bytes(b"")
    (tmp_path / "bag" / "bag_1.db3").write_bytes(b"hello" * 5000)
    assert read(tmp_path / "bag") == (
        list(range(10, 15)),
        [
            "bag_0.db3: the whole file is lost: the file is empty",
            "bag_1.db3: the whole file is lost: holds no ROS 2 messages (SQLite says: file is not a database)",
        ],
    )


def test_cut_packed_file(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "bag", range(400), beams=361, mode=CompressionMode.FILE)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 3 // 4])
    found, damage = read(tmp_path / "bag")
    assert found == list(range(len(found)))
    assert 100 < len(found) < 400
    assert re.match(r"bag.db3.zstd: its zstd data is cut off after [\d,]+ unpacked bytes", damage[0])
    assert f"{len(found)} messages recovered" in damage[1]


def test_unpacking_has_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed, target = tmp_path / "bomb.zstd", tmp_path / "bomb"
    packed.write_bytes(zstandard.compress(bytes(20_000_000)))
    assert unpack_file(packed, target) == ""
    assert target.stat().st_size == 20_000_000
    monkeypatch.setattr(unpacking, "SMALL", 1000)
    assert "is not believed" in unpack_file(packed, target)
    frames = zstandard.compress(b"one") + zstandard.compress(b"two")
    packed.write_bytes(frames)
    assert unpack_file(packed, target) == ""
    assert target.read_bytes() == b"onetwo"
    packed.write_bytes(frames[:-1])
    assert "is cut off after" in unpack_file(packed, target)
    packed.write_bytes(frames + b"junk" * 10)
    assert "its zstd data is broken after 6 unpacked bytes" in unpack_file(packed, target)


def test_messages_that_do_not_unpack_are_refused_alone(tmp_path: Path) -> None:
    packed = [zstandard.compress(scan(index)) for index in range(20)]
    packed[3] = packed[3][:40]
    packed[7] = zstandard.compress(bytes(base.MAX_MESSAGE + 1))
    streamed = zstandard.ZstdCompressor().compressobj()
    packed[9] = streamed.compress(scan(9)) + streamed.flush()
    plain_database(tmp_path / "a.db3", [(i + 1, 1, record_time(i), data) for i, data in enumerate(packed)])
    with Rosbag2Log(str(tmp_path / "a.db3")) as log:
        assert indices(log) == [i for i in range(20) if i not in (3, 7)]
        assert dict(log.report.refused) == {("/scan", "zstd message that is broken or too long"): 2}
        assert log.compression == "zstd"


# What is refused.


def test_files_that_are_no_bag(tmp_path: Path) -> None:
    file = tmp_path / "a.db3"
    with pytest.raises(UnreadableError, match=r"a\.db3: cannot be read: No such file"):
        Rosbag2Log(str(file))
    file.write_bytes(b"")
    with pytest.raises(UnreadableError, match=r"a\.db3: the file is empty"):
        Rosbag2Log(str(file))
    database = sqlite3.connect(file)
    database.execute("CREATE TABLE things(id INTEGER PRIMARY KEY, name TEXT)")
    database.commit()
    database.close()
    with pytest.raises(UnreadableError) as err:
        Rosbag2Log(str(file))
    assert str(err.value) == f"{file}: holds no ROS 2 messages (SQLite says: no such table: topics)"
