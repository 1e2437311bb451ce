"""ROS 1 bags: every compression read back value by value, and every kind of damage stepped over."""

from __future__ import annotations

import bz2
import io
import random
import re
import struct
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from lidarcli.errors import UnreadableError
from lidarcli.logs import rosbag1, unpacking
from lidarcli.logs.base import LASERSCAN, Topic
from lidarcli.logs.rosbag1_records import parse
from tests.logs.numbered import indices, laser_scan, record_time
from tests.logs.watched import Rosbag1Log

STORE = get_typestore(Stores.ROS1_NOETIC)
TYPES = STORE.types


def scan(index: int, beams: int = 37) -> bytes:
    message = laser_scan(TYPES, index, beams, seq=index)
    return bytes(STORE.serialize_ros1(message, "sensor_msgs/msg/LaserScan"))


def text(size: int) -> bytes:
    return bytes(STORE.serialize_ros1(TYPES["std_msgs/msg/String"](data="x" * size), "std_msgs/msg/String"))


def write_bag(path: Path, scans: int = 60, codec: str = "none", chunk: int = 4000, strings: int = 0) -> bytes:
    """A bag of scans on /scan, with a string on /chatter after every `strings`-th of them."""
    writer = Writer(path)
    writer.chunk_threshold = chunk
    if codec != "none":
        writer.set_compression(Writer.CompressionFormat[codec.upper()])
    with writer:
        scan_topic = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=STORE)
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=STORE)
        for index in range(scans):
            writer.write(scan_topic, record_time(index), scan(index))
            if strings and index % strings == 0:
                writer.write(chatter, record_time(index) + 1, text(20 + index % 7))
    return path.read_bytes()


def read(data: bytes) -> tuple[list[int], list[str]]:
    """Indices of the sweeps of a bag's bytes, and its damage."""
    with Rosbag1Log(io.BytesIO(data)) as log:
        found = indices(log)
        return found, [f"{item.place}: {item.cause}" for item in log.report.damage]


def records(data: bytes) -> list[tuple[int, int, int]]:
    """(start, op, end) of the records of a whole bag, chunks as one."""
    at, found = 13, []
    while at < len(data):
        record = parse(data, at)
        assert record is not None
        found.append((at, record.op, record.end))
        at = record.end
    return found


@pytest.mark.parametrize("codec", ["none", "bz2", "lz4"])
def test_reads_back_every_value(tmp_path: Path, codec: str) -> None:
    path = tmp_path / "a.bag"
    write_bag(path, 300, codec, strings=3)
    with Rosbag1Log(str(path)) as log:
        assert log.format == "ros1 bag"
        assert log.compression == codec
        assert log.size == path.stat().st_size
        assert log.topics() == [
            Topic("/scan", LASERSCAN, "ros1", 300),
            Topic("/chatter", "std_msgs/msg/String", "ros1", 100),
        ]
        assert indices(log) == list(range(300))
        assert log.report.damage == []
        assert log.position == log.size


def test_two_topics_and_two_publishers(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.bag") as writer:
        kind = "sensor_msgs/msg/LaserScan"
        topics = [
            writer.add_connection("/left", kind, typestore=STORE, callerid="/one"),
            writer.add_connection("right", kind, typestore=STORE),
            writer.add_connection("/left", kind, typestore=STORE, callerid="/two"),
        ]
        for index in range(90):
            writer.write(topics[index % 3], record_time(index), scan(index))
    with Rosbag1Log(str(tmp_path / "a.bag")) as log:
        assert log.topics() == [Topic("/left", LASERSCAN, "ros1", 60), Topic("right", LASERSCAN, "ros1", 30)]
        assert indices(log, topics=["/left"]) == [i for i in range(90) if i % 3 != 1]
        assert indices(log, topics={"right"}) == list(range(1, 90, 3))
        assert indices(log, topics=["/other"]) == []


# Index: reading never depends on it.


def bag_with_foreign_chunks(path: Path) -> bytes:
    """Chunks 0, 2, 4... hold scans, the others strings alone."""
    writer = Writer(path)
    writer.chunk_threshold = 1000
    with writer:
        topic = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=STORE)
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=STORE)
        for part in range(10):
            for index in range(4 * part, 4 * part + 4):
                writer.write(topic, record_time(index), scan(index, 55))
            writer.write(chatter, record_time(part), text(1100))
    return path.read_bytes()


def test_a_chunk_is_not_skipped_where_the_indexes_disagree(tmp_path: Path) -> None:
    data = bytearray(bag_with_foreign_chunks(tmp_path / "a.bag"))
    # Chunk infos lie: they name the strings' connection for every chunk.
    for start, op, end in records(bytes(data)):
        if op == 6:
            record = parse(bytes(data), start)
            assert record is not None
            for at in range(record.data_start, end, 8):
                data[at : at + 4] = struct.pack("<I", 1)
    assert read(bytes(data))[0] == list(range(40))


@pytest.mark.parametrize("codec", ["none", "lz4"])
def test_index_records_with_a_wrong_length(tmp_path: Path, codec: str) -> None:
    data = bytearray(write_bag(tmp_path / "a.bag", 60, codec))
    for start, op, _ in records(bytes(data)):
        if op == 4:
            record = parse(bytes(data), start)
            assert record is not None
            struct.pack_into("<I", data, record.data_start - 4, 20 * record.number(b"count"))
    assert read(bytes(data)) == (list(range(60)), [])


@pytest.mark.parametrize("codec", ["none", "bz2", "lz4"])
def test_unindexed_active_bag(tmp_path: Path, codec: str) -> None:
    data = write_bag(tmp_path / "a.bag", 60, codec)
    first_info = next(start for start, op, _ in records(data) if op == 7)
    at = data.index(b"index_pos=") + 10
    data = data[:at] + bytes(8) + data[at + 8 : first_info]
    assert read(data) == (
        list(range(60)),
        ["index: the bag was not closed properly and has no index; all 60 messages were read without it"],
    )
    with Rosbag1Log(io.BytesIO(data)) as log:
        assert log.topics() == [Topic("/scan", LASERSCAN, "ros1", 60), Topic("/chatter", "std_msgs/msg/String", "ros1", 0)]
        assert log.report.damage == []


def test_cut_before_the_index(tmp_path: Path) -> None:
    data = write_bag(tmp_path / "a.bag", 60)
    first_info = next(start for start, op, _ in records(data) if op == 7)
    assert read(data[:first_info]) == (
        list(range(60)),
        ["index: the bag is cut off before its index; all 60 messages were read without it"],
    )


# Truncation: everything before the cut, nothing behind it.


def test_truncated_lz4_chunk_gives_its_unpacked_part(tmp_path: Path) -> None:
    rng = random.Random(1)
    writer = Writer(tmp_path / "a.bag")
    writer.set_compression(Writer.CompressionFormat.LZ4)
    with writer:
        topic = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=STORE)
        noise = writer.add_connection("/noise", "std_msgs/msg/String", typestore=STORE)
        for index in range(200):
            writer.write(topic, record_time(index), scan(index))
            body = "".join(chr(rng.randrange(32, 127)) for _ in range(1500))
            message = TYPES["std_msgs/msg/String"](data=body)
            writer.write(noise, record_time(index), STORE.serialize_ros1(message, "std_msgs/msg/String"))
    data = (tmp_path / "a.bag").read_bytes()
    found, damage = read(data[: len(data) // 2])
    assert found == list(range(len(found)))
    assert 60 <= len(found) <= 110
    assert "inside a lz4 chunk" in damage[0]


# Flipped bytes.


def chunk_bounds(data: bytes) -> list[tuple[int, int]]:
    return [(start, end) for start, op, end in records(data) if op == 5]


@pytest.mark.parametrize("codec", ["none", "bz2", "lz4"])
def test_a_flipped_chunk_costs_no_other(tmp_path: Path, codec: str) -> None:
    data = write_bag(tmp_path / "a.bag", 120, codec)
    chunks = chunk_bounds(data)
    start, end = chunks[2]
    before = len(read(data[: chunks[1][1]])[0])
    behind = len(read(data[:end])[0])
    broken = bytearray(data)
    broken[start + 60 : end] = bytes(random.Random(3).randbytes(end - start - 60))
    found, damage = read(bytes(broken))
    assert found == [*range(before), *range(behind, 120)]
    assert damage
    assert any("are lost" in line or "the rest is lost" in line for line in damage)


def header_bytes(data: bytes) -> list[int]:
    """Where lengths and headers of the bag's own records stand, in and outside of (plain) chunks."""
    places: list[int] = []
    for found in re.finditer(rb"(?s)op=[\x02\x04-\x07]", data):
        places.extend(range(max(13, found.start() - 30), min(len(data), found.end() + 30)))
    return places


@pytest.mark.slow
@pytest.mark.parametrize("codec", ["none", "bz2", "lz4"])
def test_flips_in_lengths_and_headers_cost_little(tmp_path: Path, codec: str) -> None:
    data = write_bag(tmp_path / "a.bag", 60, codec, strings=4)
    rng = random.Random(7)
    per_chunk = 60 if codec == "none" else 20
    for at in rng.sample(header_bytes(data), 300):
        flipped = bytearray(data)
        flipped[at] ^= 1 << rng.randrange(8)
        with Rosbag1Log(io.BytesIO(bytes(flipped))) as log:
            found = [round(float(first)) for block in log.scans() for first in block.ranges[:, 0]]
        assert len(set(found)) == len(found)
        lost = set(range(60)) - set(found)
        assert len(lost) <= (2 if codec == "none" else per_chunk), (at, lost)


@pytest.mark.slow
def test_no_sweep_comes_out_of_a_broken_block(tmp_path: Path) -> None:
    data = write_bag(tmp_path / "a.bag", 60, "bz2", strings=4)
    places: list[int] = []
    for start, _ in chunk_bounds(data):
        record = parse(data, start)
        assert record is not None
        places += range(record.data_start, record.end)
    rng = random.Random(3)
    for at in rng.sample(places, 150):
        flipped = bytearray(data)
        flipped[at] ^= 1 << rng.randrange(8)
        with Rosbag1Log(io.BytesIO(bytes(flipped))) as log:
            found = indices(log)
            assert len(set(found)) == len(found) < 60
            assert log.report.damage


def test_a_lying_message_length_costs_at_most_what_it_swallows(tmp_path: Path) -> None:
    data = write_bag(tmp_path / "a.bag", 60, chunk=100_000)
    size = len(scan(0))
    places = [m.start() for m in re.finditer(re.escape(struct.pack("<II", size, 10)), data)]
    assert len(places) == 1
    for lie in (0, 3, size - 30, size + 5, size + 400, 20_000_000, 2**31, 2**32 - 1):
        lying = bytearray(data)
        struct.pack_into("<I", lying, places[0], lie)
        with Rosbag1Log(io.BytesIO(bytes(lying))) as log:
            found = [round(float(first)) for block in log.scans() for first in block.ranges[:, 0]]
            assert log.report.damage
        swallowed = lie // size if lie < len(data) else 0
        lost = set(range(60)) - set(found)
        assert lost <= set(range(10, 12 + swallowed)), lie


def test_a_lying_chunk_length_costs_nothing(tmp_path: Path) -> None:
    for codec in ("none", "bz2", "lz4"):
        data = write_bag(tmp_path / f"{codec}.bag", 60, codec)
        record = parse(data, chunk_bounds(data)[1][0])
        assert record is not None
        for lie in (0, 5, record.data_length - 7, record.data_length + 9, 100_000, 2**32 - 1):
            lying = bytearray(data)
            struct.pack_into("<I", lying, record.data_start - 4, lie)
            assert read(bytes(lying))[0] == list(range(60)), (codec, lie)


@pytest.mark.parametrize("codec", ["none", "bz2", "lz4"])
def test_a_broken_compression_name_is_seen_through(tmp_path: Path, codec: str) -> None:
    data = write_bag(tmp_path / "a.bag", 60, codec)
    named = b"compression=" + codec.encode()
    assert read(data.replace(named, named[:-1] + b"?")) == (list(range(60)), [])


def test_unknown_compression(tmp_path: Path) -> None:
    data = write_bag(tmp_path / "a.bag", 60, "lz4")
    start, _ = chunk_bounds(data)[1]
    at = data.index(b"compression=lz4", start)
    magic = data.index(b"\x04\x22\x4d\x18", start)
    found, damage = read(data[: at + 12] + b"zip" + data[at + 15 : magic] + b"PK.." + data[magic + 4 :])
    assert 30 < len(found) < 60
    assert damage == [
        f"chunk at byte {start}: unknown compression 'zip': the chunk is lost",
        f"index: {60 - len(found)} of 60 messages are lost",
    ]


# Hostile input.


def chunk_record(codec: bytes, size: int, data: bytes) -> bytes:
    fields = [b"op=\x05", b"compression=" + codec, b"size=" + struct.pack("<I", size)]
    head = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


@pytest.mark.parametrize(("codec", "pack"), [("bz2", bz2.compress), ("lz4", lz4.frame.compress)])
def test_a_chunk_of_two_frames_is_read_whole(tmp_path: Path, codec: str, pack: Callable[[bytes], bytes]) -> None:
    data = write_bag(tmp_path / "a.bag", 20, chunk=1 << 20)
    [(start, end)] = chunk_bounds(data)
    record = parse(data, start)
    assert record is not None
    content = data[record.data_start : end]
    packed = pack(content[:999]) + pack(content[999:])
    assert read(data[:start] + chunk_record(codec.encode(), len(content), packed) + data[end:])[0] == list(range(20))


def test_a_bomb_is_unpacked_to_its_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    monkeypatch.setattr(unpacking, "SMALL", 30_000)
    monkeypatch.setattr(unpacking, "MAX_RATIO", 100)
    data = write_bag(tmp_path / "a.bag", 20)
    start = chunk_bounds(data)[0][0]
    bomb = bz2.compress(bytes(50_000_000))
    for declared in (1000, 2**32 - 1):
        found, damage = read(data[:start] + chunk_record(b"bz2", declared, bomb) + data[start:])
        assert found == list(range(20))
        assert damage[0].startswith(f"chunk at byte {start}: ")


def test_a_message_too_large_for_memory_is_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosbag1, "MAX_MESSAGE", 50_000)
    for codec in ("none", "bz2", "lz4"):
        writer = Writer(tmp_path / f"{codec}.bag")
        if codec != "none":
            writer.set_compression(Writer.CompressionFormat[codec.upper()])
        with writer:
            topic = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=STORE)
            chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=STORE)
            for index in range(20):
                writer.write(topic, record_time(index), scan(index))
                if index == 10:
                    writer.write(chatter, record_time(index), text(3_000_000))
        found, damage = read((tmp_path / f"{codec}.bag").read_bytes())
        assert found == list(range(20)), codec
        if codec == "none":
            assert damage == []


# What is refused.


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", "not a ROS 1 bag"),
        (b"#ROSBAG", "not a ROS 1 bag"),
        (b"hello\n", "not a ROS 1 bag"),
        (b"#ROSRECORD V1.2\n" + bytes(100), r"has format 1\.2, which predates 2\.0.*rosbag fix"),
    ],
)
def test_not_a_bag(tmp_path: Path, data: bytes, cause: str) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(data)
    with pytest.raises(UnreadableError, match=cause):
        Rosbag1Log(str(path))


def test_encrypted(tmp_path: Path) -> None:
    data = write_bag(tmp_path / "a.bag", 2)
    field = b"encryptor=rosbag/AesCbcEncryptor"
    record = parse(data, 13)
    assert record is not None
    head = record.header + struct.pack("<I", len(field)) + field
    fresh = data[:13] + struct.pack("<I", len(head)) + head + data[record.data_start - 4 :]
    with pytest.raises(UnreadableError, match=r"encrypted \(rosbag/AesCbcEncryptor\)"):
        Rosbag1Log(io.BytesIO(fresh))
