"""Stretches of logs as messages in memory, read and written by rosbags and mcap alone."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags import rosbag1, rosbag2
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SECOND = 1_000_000_000
SCAN, TRANSFORMS, ODOMETRY = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"
KINDS = {kind: kind for kind in (SCAN, TRANSFORMS, ODOMETRY)} | {"tf/msg/tfMessage": TRANSFORMS}
"""Types of messages that are taken along, and as what."""
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))


@dataclass(frozen=True)
class Message:
    """One message of a log."""

    topic: str
    type: str
    time: int
    """Record time [ns]."""
    data: bytes
    """As CDR, whatever the log has."""

    @property
    def value(self) -> Any:
        """Its fields, as objects of rosbags."""
        return ROS2.deserialize_cdr(self.data, self.type)

    def of(self, value: Any) -> Message:
        """The same with other fields."""
        return replace(self, data=bytes(ROS2.serialize_cdr(value, self.type)))


Messages = Sequence[Message]


def messages_of(log: Path, seconds: float) -> list[Message]:
    """The sweeps, transforms and odometry of the first seconds of a log, and its static transforms."""
    if log.name.endswith(".csv.gz"):
        return list(_lines(log, seconds))
    found = []
    with AnyReader([log], default_typestore=ROS2) as reader:
        chosen = [each for each in reader.connections if each.msgtype in KINDS]
        begin = None
        for connection, time, data in reader.messages(chosen):
            if begin is None and connection.msgtype == SCAN:
                begin = time
            if begin is not None and time - begin > seconds * SECOND:
                break
            cdr = data if reader.is2 else ROS2.ros1_to_cdr(data, KINDS[connection.msgtype])
            found.append(Message(connection.topic, KINDS[connection.msgtype], time, bytes(cdr)))
    return found


def _lines(log: Path, seconds: float) -> Iterator[Message]:
    """The sweeps of a CSV of `rostopic echo -p`."""
    with gzip.open(log, "rt") as file:
        names = file.readline().strip().split(",")
        at = {name: index for index, name in enumerate(names)}
        ranges = [index for index, name in enumerate(names) if re.fullmatch(r"field\.ranges\d+", name)]
        begin = None
        for line in file:
            cells = line.strip().split(",")
            time, stamp = int(cells[at["%time"]]), int(cells[at["field.header.stamp"]])
            begin = time if begin is None else begin
            if time - begin > seconds * SECOND:
                return
            numbers = {name: float(cells[at[f"field.{name}"]]) for name in _NUMBERS}
            values = np.array([float(cells[index]) for index in ranges], np.float32)
            yield Message("/scan", SCAN, time, b"").of(_scan(stamp, cells[at["field.header.frame_id"]], numbers, values))


_NUMBERS = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")


def _scan(stamp: int, frame: str, numbers: dict[str, float], ranges: Any) -> Any:
    return ROS2.types[SCAN](**numbers, header=header(stamp, frame), ranges=ranges, intensities=np.zeros(0, np.float32))


def header(stamp: int, frame: str) -> Any:
    """A header of these [ns]."""
    sec, nanosec = divmod(stamp, SECOND)
    return ROS2.types["std_msgs/msg/Header"](ROS2.types["builtin_interfaces/msg/Time"](sec, nanosec), frame)


def write_mcap(
    path: Path,
    messages: Iterable[Message],
    compression: CompressionType = CompressionType.ZSTD,
    index: IndexType = IndexType.ALL,
    twice: bool = False,
    **options: Any,
) -> Path:
    """Write an MCAP; `twice`: every topic has two channels, which take turns; `options` are those of mcap."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, index_types=index, **options)
        writer.start("ros2")
        channels: dict[tuple[str, bool], int] = {}
        for number, message in enumerate(messages):
            key = message.topic, twice and number % 2 == 1
            if key not in channels:
                text = ROS2.generate_msgdef(message.type, ros_version=2)[0].encode()
                schema = writer.register_schema(message.type, "ros2msg", text)
                channels[key] = writer.register_channel(message.topic, "cdr", schema)
            writer.add_message(channels[key], message.time, message.data, message.time, number)
        writer.finish()
    return path


def write_bag(path: Path, messages: Iterable[Message], compression: str = "", chunk: int = 0, twice: bool = False) -> Path:
    """Write a bag of ROS 1 with chunks of so many bytes (0: the default), each topic with two connections on demand."""
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    if chunk:
        writer.chunk_threshold = chunk
    with closing(_opened(writer)):
        connections: dict[tuple[str, bool], Connection] = {}
        for number, message in enumerate(messages):
            key = message.topic, twice and number % 2 == 1
            if key not in connections:
                caller, latching = f"/node{key[1]:d}", int(message.topic.endswith("_static"))
                connections[key] = writer.add_connection(
                    message.topic, message.type, typestore=ROS1, callerid=caller, latching=latching
                )
            writer.write(connections[key], message.time, ROS2.cdr_to_ros1(message.data, message.type))
    return path


def write_ros2(
    path: Path,
    messages: Iterable[Message],
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a bag of ROS 2, a folder."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with closing(_opened(writer)):
        connections: dict[str, Connection] = {}
        for message in messages:
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.type, typestore=ROS2)
            writer.write(connections[message.topic], message.time, message.data)
    return path


def _opened(writer: Any) -> Any:
    writer.open()
    return writer


def batched(messages: Messages, parts: int) -> Iterator[list[Message]]:
    """About equally many messages for each of so many parts, in their order."""
    left = iter(messages)
    while part := list(islice(left, -(-len(messages) // parts))):
        yield part
