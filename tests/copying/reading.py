"""Messages of logs as they stand in their files, read without the project's readers."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

MAGIC = b"#ROSBAG V2.0\n"
ZSTD = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class Message:
    """One message, with all that the file says of it."""

    topic: str
    type: str
    head: tuple[object, ...]
    """Times, sequence, and channel or connection."""
    data: bytes = field(repr=False)


def messages(path: Path) -> list[Message]:
    """The messages of a log in file order."""
    if path.is_dir():
        files = sorted(each for each in path.iterdir() if ".db3" in each.name or ".mcap" in each.name)
        return [message for file in files for message in messages(file)]
    if path.suffix in (".zstd", ".zst"):
        plain = path.with_name(f"{path.name}.plain{Path(path.stem).suffix}")
        plain.write_bytes(zstandard.ZstdDecompressor().stream_reader(path.read_bytes()).read())
        try:
            return messages(plain)
        finally:
            plain.unlink()
    return {".mcap": _mcap, ".bag": _bag, ".db3": _database}[path.suffix](path)


def _mcap(path: Path) -> list[Message]:
    with path.open("rb") as file:
        found = [*make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)]
    return [
        Message(
            channel.topic,
            "" if schema is None else schema.name,
            (message.log_time, message.publish_time, message.sequence, str(channel), str(schema)),
            message.data,
        )
        for schema, channel, message in found
    ]


def _fields(header: bytes) -> dict[str, bytes]:
    found = {}
    at = 0
    while at < len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, value = header[at + 4 : at + 4 + length].split(b"=", 1)
        found[name.decode()] = value
        at += 4 + length
    return found


def records(data: bytes) -> list[tuple[dict[str, bytes], bytes]]:
    """Header and data of the records of a ROS 1 bag."""
    found = []
    at = 0
    while at < len(data):
        parts = []
        for _ in range(2):
            (length,) = struct.unpack_from("<I", data, at)
            parts.append(data[at + 4 : at + 4 + length])
            at += 4 + length
        found.append((_fields(parts[0]), parts[1]))
    return found


def _bag(path: Path) -> list[Message]:
    data = path.read_bytes()
    assert data.startswith(MAGIC)
    unpack: dict[bytes, Any] = {b"none": bytes, b"bz2": bz2.decompress, b"lz4": lz4.frame.decompress}
    connections: dict[bytes, tuple[str, bytes]] = {}
    found = []
    for head, body in records(data[len(MAGIC) :]):
        if head["op"] != b"\5":
            continue
        for inner, content in records(unpack[head["compression"]](body)):
            if inner["op"] == b"\7":
                connections[inner["conn"]] = inner["topic"].decode(), content
            elif inner["op"] == b"\2":
                topic, connection = connections[inner["conn"]]
                kind = _fields(connection)["type"].decode()
                found.append(Message(topic, kind, (inner["time"], inner["conn"], connection), content))
    return found


def _database(path: Path) -> list[Message]:
    with closing(sqlite3.connect(path)) as database:
        topics = {row[0]: row for row in database.execute("SELECT * FROM topics")}
        rows = database.execute("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
    return [
        Message(topics[topic][1], topics[topic][2], (row, time, topics[topic]), data) for row, topic, time, data in rows
    ]


def ranges(message: Message, schema: bytes = b"") -> tuple[list[int], list[float]]:
    """Place [bytes] and value of each range, of MultiEchoLaserScan of each echo; of protobuf the values alone."""
    data = message.data
    if data.startswith(ZSTD):
        data = zstandard.ZstdDecompressor().decompress(data)
    if message.type == "foxglove.LaserScan":
        return [], _protobuf(data, schema)
    cdr = "/msg/" in message.type
    order = ">" if cdr and data[1] == 0 else "<"
    at = 12
    (length,) = struct.unpack_from(f"{order}I", data, at)
    at += 4 + length
    at += -at % 4 if cdr else 0
    at += 28
    (count,) = struct.unpack_from(f"{order}I", data, at)
    at += 4
    places: list[int] = []
    if "MultiEcho" in message.type:
        for _ in range(count):
            (echoes,) = struct.unpack_from(f"{order}I", data, at)
            places += range(at + 4, at + 4 + 4 * echoes, 4)
            at += 4 + 4 * echoes
    else:
        places += range(at, at + 4 * count, 4)
    return places, [struct.unpack_from(f"{order}f", data, place)[0] for place in places]


def _protobuf(data: bytes, schema: bytes) -> list[float]:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.LaserScan"))
    message: Any = kind.FromString(data)
    return [*message.ranges]


def bytes_that_differ(one: bytes, other: bytes) -> set[int]:
    """Places at which messages of the same length differ."""
    assert len(one) == len(other)
    return set(np.flatnonzero(np.frombuffer(one, np.uint8) != np.frombuffer(other, np.uint8)).tolist())
