"""Logs made by the packages `mcap`, `rosbags` and `sqlite3`: other chunks, indexes and tables than our own writers make."""

from __future__ import annotations

import io
import sqlite3
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as FolderWriter
from rosbags.typesys import Stores, get_typestore

from tools.fuzz.containers import Sample
from tools.fuzz.sqlite_files import journal_of_killed_writer, live_wal

SWEEPS = 10
BEAMS = 24
SCAN = "sensor_msgs/msg/LaserScan"
TEXT = "std_msgs/msg/String"
START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000

TOPICS = (
    "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
)
MESSAGES = (
    "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
    " timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
)
INDEX = "CREATE INDEX timestamp_idx ON messages (timestamp ASC)"
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def scan_cdr(number: int, beams: int = BEAMS) -> bytes:
    """A LaserScan as ROS 2 serialises it."""
    return bytes(ROS2.serialize_cdr(_scan(ROS2.types, number, beams), SCAN))


def stamp_of(number: int) -> int:
    """When sweep `number` was recorded [ns]."""
    return START_NS + number * STEP_NS


def _scan(types: Any, number: int, beams: int = BEAMS, **more: Any) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](START_NS // 10**9, number * STEP_NS)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser", **more)
    ranges = (1 + number / 100 + np.linspace(0, 3, beams) % 0.7).astype(np.float32)
    return types[SCAN](
        header=header,
        angle_min=-1.5,
        angle_max=1.5,
        angle_increment=3.0 / (beams - 1),
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.05,
        range_max=12.0,
        ranges=ranges,
        intensities=np.zeros(0, np.float32),
    )


def _mcap(**options: Any) -> Sample:
    """Two topics, an attachment and a metadata record, by the writer of `mcap`."""
    file = io.BytesIO()
    writer = McapWriter(file, **{"chunk_size": 900, "compression": CompressionType.NONE, **options})
    writer.start(profile="ros2", library="another")
    definition = ROS2.generate_msgdef(SCAN, ros_version=2)[0].encode()
    scan = writer.register_channel("/scan", "cdr", writer.register_schema(SCAN, "ros2msg", definition))
    text_schema = writer.register_schema(TEXT, "ros2msg", b"string data\n")
    text = writer.register_channel("/chatter", "cdr", text_schema, {"offered_qos_profiles": "- depth: 1"})
    spoken = bytes(ROS2.serialize_cdr(ROS2.types[TEXT]("hello"), TEXT))
    for number in range(SWEEPS):
        writer.add_message(scan, stamp_of(number), scan_cdr(number), stamp_of(number), number)
        writer.add_message(text, stamp_of(number), spoken, stamp_of(number), number)
        if number == SWEEPS // 2:
            writer.add_attachment(stamp_of(number), stamp_of(number), "map.txt", "text/plain", b"#" * 200)
            writer.add_metadata("robot", {"name": "r2", "site": "hall"})
    writer.finish()  # type: ignore[no-untyped-call]
    return Sample("run.mcap", {"run.mcap": file.getvalue()})


def _bag(compression: Any) -> Sample:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.bag"
        writer = BagWriter(path)
        if compression is not None:
            writer.set_compression(compression)
        with writer:
            scan = writer.add_connection("/scan", SCAN, typestore=ROS1, callerid="/laser", latching=1)
            text = writer.add_connection("/chatter", TEXT, typestore=ROS1)
            spoken = ROS1.serialize_ros1(ROS1.types[TEXT]("hello"), TEXT)
            for number in range(SWEEPS):
                data = ROS1.serialize_ros1(_scan(ROS1.types, number, seq=number), SCAN)
                writer.write(scan, stamp_of(number), data)
                writer.write(text, stamp_of(number), spoken)
        return Sample("run.bag", {"run.bag": path.read_bytes()})


def _folder(version: int, storage: StoragePlugin, mode: CompressionMode) -> Sample:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        writer = FolderWriter(path, version=version, storage_plugin=storage)  # type: ignore[arg-type]
        if mode is not CompressionMode.NONE:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            scan = writer.add_connection("/scan", SCAN, typestore=ROS2)
            text = writer.add_connection("/chatter", TEXT, typestore=ROS2)
            spoken = ROS2.serialize_cdr(ROS2.types[TEXT]("hello"), TEXT)
            for number in range(SWEEPS):
                writer.write(scan, stamp_of(number), scan_cdr(number))
                writer.write(text, stamp_of(number), spoken)
        return Sample("run", {f"run/{file.name}": file.read_bytes() for file in sorted(path.iterdir())})


def database(path: Path, *pragmas: str, messages: str = MESSAGES, sweeps: int = SWEEPS) -> None:
    """A storage file of a ROS 2 bag by SQLite alone; `pragmas` come before the tables."""
    connection = sqlite3.connect(path, isolation_level=None)
    try:
        for pragma in ("synchronous = off", *pragmas):
            connection.execute(f"PRAGMA {pragma}").fetchall()
        for statement in (TOPICS, messages, INDEX):
            connection.execute(statement)
        connection.execute("INSERT INTO topics VALUES (1, '/scan', ?, 'cdr', '')", (SCAN,))
        connection.execute("BEGIN")
        for number in range(sweeps):
            row = (number + 1, 1, stamp_of(number), scan_cdr(number))
            connection.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
        connection.execute("COMMIT")
    finally:
        connection.close()


def altered(path: Path, *statements: str) -> None:
    """Run statements on a database, each for itself."""
    connection = sqlite3.connect(path, isolation_level=None)
    try:
        for statement in ("PRAGMA synchronous = off", *statements):
            connection.execute(statement).fetchall()
    finally:
        connection.close()


NEWER = (
    "CREATE TABLE schema (schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)",
    "INSERT INTO schema VALUES (4, 'jazzy')",
    "CREATE TABLE metadata (id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL)",
    "INSERT INTO metadata VALUES (1, 9, 'rosbag2_bagfile_information: {version: 9}')",
    "CREATE TABLE message_definitions (id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,"
    " encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL)",
    "INSERT INTO message_definitions VALUES (1, 'sensor_msgs/msg/LaserScan', 'ros2msg', '', '')",
    "ALTER TABLE topics ADD COLUMN type_description_hash TEXT NOT NULL DEFAULT ''",
)
EXTRA_INDEXES = (
    "CREATE INDEX by_topic ON messages (topic_id, timestamp)",
    "CREATE UNIQUE INDEX by_name ON topics (name)",
    "CREATE INDEX partly ON messages (id) WHERE topic_id = 1",
    "ANALYZE",
)


def _db3(make: Callable[[Path], None]) -> Sample:
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / "run.db3")
        return Sample("run.db3", {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())})


def _database_of(pragma: str) -> Callable[[Path], None]:
    return lambda path: database(path, pragma)


def _then(*statements: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        database(path)
        altered(path, *statements)

    return make


def _wal(path: Path) -> None:
    database(path, "journal_mode = wal", sweeps=SWEEPS // 2)
    rows = [(number + 1, 1, stamp_of(number), scan_cdr(number)) for number in range(SWEEPS // 2, SWEEPS)]
    live_wal(path, "INSERT INTO messages VALUES (?, ?, ?, ?)", rows)


def _journal(path: Path) -> None:
    database(path, "page_size = 512")
    rows = [(number + 1, 1, stamp_of(number), bytes(3000)) for number in range(SWEEPS, 12 * SWEEPS)]
    changed = "UPDATE messages SET timestamp = 0, data = zeroblob(900)"
    journal_of_killed_writer(path, changed, "INSERT INTO messages VALUES (?, ?, ?, ?)", rows)


def _without_rowid(path: Path) -> None:
    database(path, messages=f"{MESSAGES} WITHOUT ROWID")


_SQLITE: dict[str, Callable[[Path], None]] = {
    **{f"page-{size}": _database_of(f"page_size = {size}") for size in (512, 1024, 8192, 65536)},
    "utf16": _database_of("encoding = 'UTF-16le'"),
    "vacuum": _database_of("auto_vacuum = incremental"),
    "wal": _wal,
    "journal": _journal,
    "newer": _then(*NEWER),
    "without-rowid": _without_rowid,
    "indexes": _then(*EXTRA_INDEXES),
    "deleted": _then("DELETE FROM messages WHERE id % 3 = 0"),
}
_MCAP: dict[str, dict[str, Any]] = {
    "unchunked": {"use_chunking": False},
    "lz4": {"compression": CompressionType.LZ4},
    "zstd": {"compression": CompressionType.ZSTD, "enable_data_crcs": True},
    "no-index": {"index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False},
    "no-summary": {
        "use_statistics": False,
        "use_summary_offsets": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "index_types": IndexType.NONE,
        "enable_crcs": False,
    },
    "one-chunk": {"chunk_size": 1 << 20, "compression": CompressionType.ZSTD},
}
_BAG = {"none": None, "bz2": BagWriter.CompressionFormat.BZ2, "lz4": BagWriter.CompressionFormat.LZ4}
_FOLDER = {
    "8-sqlite3": (8, StoragePlugin.SQLITE3, CompressionMode.NONE),
    "9-sqlite3": (9, StoragePlugin.SQLITE3, CompressionMode.NONE),
    "9-sqlite3-file": (9, StoragePlugin.SQLITE3, CompressionMode.FILE),
    "9-sqlite3-message": (9, StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "9-mcap": (9, StoragePlugin.MCAP, CompressionMode.NONE),
    "9-mcap-storage": (9, StoragePlugin.MCAP, CompressionMode.STORAGE),
    "9-mcap-message": (9, StoragePlugin.MCAP, CompressionMode.MESSAGE),
}
_MAKERS: dict[str, Callable[[], Sample]] = {
    **{f"mcap-by-mcap-{name}": partial(_mcap, **options) for name, options in _MCAP.items()},
    **{f"bag-by-rosbags-{name}": partial(_bag, form) for name, form in _BAG.items()},
    **{f"ros2-by-rosbags-{name}": partial(_folder, *options) for name, options in _FOLDER.items()},
    **{f"db3-by-sqlite-{name}": partial(_db3, make) for name, make in _SQLITE.items()},
}

LIBRARY_LOGS = tuple(_MAKERS)


@cache
def library_sample(name: str) -> Sample:
    """The sample of one of `LIBRARY_LOGS`, the same bytes every time."""
    return _MAKERS[name]()
