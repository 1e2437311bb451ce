"""What three containers have in common: odd messages, odd topics, lies about sizes, and files that change."""

from __future__ import annotations

import ast
import os
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

import lidarcli
from lidarcli.errors import NoScanError
from lidarcli.logs import open_log
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, ReadReport
from lidarcli.pipeline.detecting import detect_files, detect_to_files
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.ros.messages import ros2_definition
from tests.logs.mcap_samples import chunks
from tests.logs.scan_messages import scan
from tests.waiting import HANG

TF = "tf2_msgs/msg/TFMessage"
CLOUD = "sensor_msgs/msg/PointCloud2"
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)

Topics = dict[str, tuple[str, list[bytes]]]
"""Topic → its type and its messages."""


def write_mcap(path: Path, topics: Topics) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.NONE)
        writer.start("ros2", "a test")
        for name, (kind, messages) in topics.items():
            text = ros2_definition(kind) if kind == LASERSCAN else ROS2.generate_msgdef(kind, ros_version=2)[0]
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel(name, "cdr", schema)
            for number, data in enumerate(messages):
                writer.add_message(channel, log_time=number, publish_time=number, data=data)
        writer.finish()


def write_bag(path: Path, topics: Topics) -> None:
    with BagWriter(path) as writer:
        for name, (kind, messages) in topics.items():
            known = {"typestore": ROS1} if kind in ROS1.fielddefs else {"msgdef": "byte x", "md5sum": "0" * 32}
            connection = writer.add_connection(name, kind, **known)  # type: ignore[arg-type]
            for number, data in enumerate(messages):
                writer.write(connection, number, data)


def write_db3(path: Path, topics: Topics) -> None:
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    for index, (name, (kind, messages)) in enumerate(topics.items(), 1):
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", (index, name, kind))
        rows = [(index, number, data) for number, data in enumerate(messages)]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    database.close()


WRITERS: dict[str, tuple[str, Callable[[Path, Topics], None]]] = {
    "run.mcap": ("cdr", write_mcap),
    "run.bag": ("ros1", write_bag),
    "run.db3": ("cdr", write_db3),
}


@pytest.fixture(params=WRITERS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def written(name: str, folder: Path, topics: Topics) -> Path:
    WRITERS[name][1](folder / name, topics)
    return folder / name


def sweeps(path: Path, topic: str = "/scan") -> tuple[list[list[float]], Any]:
    """The ranges of every sweep of a topic, and the report."""
    report = ReadReport()
    with open_log(path) as log:
        rows = [
            block.ranges[row, : block.beams[row]].tolist()
            for block in log.scans(None, report)
            if block.topic == topic
            for row in range(len(block))
        ]
        return rows, report


def test_multi_echo_and_plain_scans_side_by_side(name: str, tmp_path: Path) -> None:
    encoding = WRITERS[name][0]
    echoes = [[1.0, 2.0], [], [3.0, 9.0, 27.0]]
    topics: Topics = {
        "/scan": (LASERSCAN, [scan([5.0, 6.0], encoding=encoding)] * 3),
        "/echoes": (MULTI_ECHO, [scan([], encoding=encoding, echoes=echoes)] * 3),
    }
    path = written(name, tmp_path, topics)
    summary = detect_to_files(Source(str(path), "run"), tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code, summary.topics) == (6, 0, {"/scan", "/echoes"})
    assert sweeps(path)[0] == [[5.0, 6.0]] * 3
    found = np.array(sweeps(path, "/echoes")[0])
    np.testing.assert_array_equal(found, [[1.0, np.nan, 3.0]] * 3)


@pytest.mark.parametrize(
    ("intensities", "kept"),
    [
        (b"", None),
        (struct.pack("<I", 0), None),
        (struct.pack("<I2f", 2, 1, np.nan), [1.0, np.nan, np.nan]),
        (struct.pack("<I3f", 3, 1, 2, 3), [1.0, 2.0, 3.0]),
        (struct.pack("<I4f", 4, 1, 2, 3, 4), [1.0, 2.0, 3.0]),
        (struct.pack("<I3f", 3, 0, 0, 0), None),
        (b"\xff" * 4, None),
    ],
)
def test_intensities_are_kept_as_far_as_they_go(
    name: str, intensities: bytes, kept: list[float] | None, tmp_path: Path
) -> None:
    """Absent, empty, fewer than the ranges, NaN, more, all 0, or a count that lies."""
    message = scan([1.0, 2.0, 3.0], encoding=WRITERS[name][0])[:-4] + intensities
    path = written(name, tmp_path, {"/scan": (LASERSCAN, [message] * 3)})
    rows, report = sweeps(path)
    assert (rows, report.refused, report.damage) == ([[1.0, 2.0, 3.0]] * 3, {}, [])
    (batch,) = lidarcli.read(path)
    if kept is None:
        assert batch.intensities is None
    else:
        np.testing.assert_array_equal(batch.intensities, np.float32([kept] * 3))


@pytest.mark.parametrize(("topic", "kind"), [("/tf", TF), ("/scan", CLOUD)])
def test_a_log_without_a_laser_scan(name: str, topic: str, kind: str, tmp_path: Path) -> None:
    """Recordings called laserdata that hold only tf, and point clouds on /scan."""
    path = written(name, tmp_path, {topic: (kind, [bytes(80)] * 3)})
    info = inspect_log(Source(str(path), "run"))
    assert [(known.name, known.type) for known in info.topics] == [(topic, kind)]
    assert (info.exit_code, info.scans) == (4, ())
    with pytest.raises(NoScanError) as caught:
        detect_to_files(Source(str(path), "run"), tmp_path, DetectOptions())
    hint = "; to read the point clouds of /scan as sweeps, add --slice ZMIN ZMAX (heights in metres)"
    words = f"no LaserScan topic in this log (its topics: {topic} {kind})"
    assert str(caught.value) == words + (hint if kind == CLOUD else "")


# Sizes that lie: the process that reads has a bound, whatever a log declares.

PEAK = """
import resource, sys
from lidarcli.errors import LidarcliError
from lidarcli.logs.base import OpenOptions
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
inspect_log(Source(sys.argv[1], "warm"), OpenOptions(fov=3.0))
before = peak()
try:
    info = inspect_log(Source(sys.argv[2], "run"), OpenOptions(fov=3.0))
    said = list(info.damage)
    sweeps = sum(scan.sweeps for scan in info.scans)
except LidarcliError as err:
    said, sweeps = [str(err)], 0
print(repr((sweeps, said, (peak() - before) >> 20)))
"""


def measured(path: Path, plain: Path) -> tuple[int, list[str], int]:
    """Sweeps, what was said, and the memory [MiB] that a log takes beyond that of a plain one of its kind."""
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", PEAK, str(plain), str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=HANG,
    )
    found: tuple[int, list[str], int] = ast.literal_eval(ran.stdout)
    return found


def lying_mcap(data: bytes) -> bytes:
    """The length of the first message record."""
    at = data.index(scan([1.0, 2.0, 3.0])) - 22 - 9
    return data[: at + 1] + struct.pack("<Q", 2**60) + data[at + 9 :]


def lying_bag(data: bytes) -> bytes:
    """The length of the data of the first message record."""
    at = data.index(scan([1.0, 2.0, 3.0], encoding="ros1")) - 4
    return data[:at] + struct.pack("<I", 2**32 - 1) + data[at + 4 :]


def lying_db3(data: bytes) -> bytes:
    """The number of pages, and so the size of the database."""
    return data[:28] + struct.pack(">I", 2**32 - 1) + data[32:]


def lying_cell(data: bytes) -> bytes:
    """The size of the last row of the messages, as SQLite's nine-byte number."""
    at = data.index(scan([1.0, 2.0, 3.0])) - 10
    return data[:at] + b"\xff" * 9 + data[at + 9 :]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "lie", "least"),
    [("run.mcap", lying_mcap, 0), ("run.bag", lying_bag, 19), ("run.db3", lying_db3, 20), ("run.db3", lying_cell, 19)],
    indirect=["name"],
)
def test_a_declared_size_beyond_everything(name: str, lie: Callable[[bytes], bytes], least: int, tmp_path: Path) -> None:
    plain = written(name, tmp_path, {"/scan": (LASERSCAN, [scan([1.0, 2.0, 3.0], encoding=WRITERS[name][0])] * 20)})
    path = tmp_path / f"lie-{name}"
    path.write_bytes(lie(plain.read_bytes()))
    found, said, peak = measured(path, plain)
    assert least <= found <= 20
    assert 1 <= len(said) <= 2
    assert peak < 32


@pytest.mark.slow
def test_a_bomb_of_an_mcap_chunk_stays_below_what_is_believed(tmp_path: Path) -> None:
    """Beyond what is believed of so little data only its start is looked at, for channels it describes."""
    plain = written("run.mcap", tmp_path, {"/scan": (LASERSCAN, [scan([1.0])] * 3)})
    data = plain.read_bytes()
    [(at, _)] = chunks(data)
    for size, most in ((1 << 28, 100), ((1 << 30) + 1, 100)):
        packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
        packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(size >> 20))
        packed += packer.compress(bytes(size & 1)) + packer.flush()
        body = struct.pack("<QQQII", 0, 9, size, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
        bomb = tmp_path / "bomb.mcap"
        bomb.write_bytes(data[:at] + struct.pack("<BQ", 6, len(body)) + body + data[at:])
        found, said, peak = measured(bomb, plain)
        assert found == 3
        assert [line.split(":")[0] for line in said if "chunk" in line] == [f"chunk at byte {at}"]
        assert peak < most, peak


# Files that change, and folders of all sorts.


@pytest.mark.parametrize("upper", ["RUN.MCAP", "RUN.BAG", "RUN.DB3"])
def test_suffixes_in_capitals(upper: str, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    name = upper.lower()
    message = scan([1.0, 2.0], encoding=WRITERS[name][0])
    written(name, tmp_path, {"/scan": (LASERSCAN, [message] * 4)}).rename(folder / upper)
    found = find_logs([str(folder), str(folder / upper)])
    assert [source.name for source in found if isinstance(source, Source)] == ["RUN", "RUN"]
    assert [inspect_log(source).scans[0].sweeps for source in found if isinstance(source, Source)] == [4, 4]


def test_a_folder_of_all_kinds(tmp_path: Path) -> None:
    """ROS 1 and ROS 2 side by side, a pipe, a link in a circle, a bag without its metadata and what is no log."""
    for name, (encoding, write) in WRITERS.items():
        message = scan([1.0, 2.0], encoding=encoding)
        write(tmp_path / name.replace("run", name.split(".")[1]), {"/scan": (LASERSCAN, [message] * 4)})
    lost = tmp_path / "lost"
    lost.mkdir()
    for part in range(2):
        write_db3(lost / f"lost_{part}.db3", {"/scan": (LASERSCAN, [scan([1.0, 2.0])] * 3)})
    (tmp_path / "notes.txt").write_text("calibrated on Tuesday\n")
    (tmp_path / "photo.bag").write_bytes(os.urandom(500))
    (tmp_path / "circle").symlink_to(tmp_path)
    (lost / "up").symlink_to("..")
    os.mkfifo(tmp_path / "pipe.bag")
    outcomes = list(detect_files(find_logs([str(tmp_path)]), tmp_path / "out", DetectOptions()))
    assert [(Path(out.label).name, out.exit_code, out.summary and out.summary.sweeps) for out in outcomes] == [
        ("bag.bag", 0, 4),
        ("db3.db3", 0, 4),
        ("lost", 0, 6),
        ("mcap.mcap", 0, 4),
        ("photo.bag", 3, None),
    ]
