"""Small MCAPs made with the `mcap` library, and an independent, slow walk over their records."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, IndexType, Writer

from lidarcli.ros.foxglove import SCAN, classes
from tests.logs.scan_messages import scan

COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
BEAMS = 7
LASERSCAN_MSG = (
    b"# a comment\nstd_msgs/Header header\nfloat32 angle_min # start\nfloat32 angle_max\nfloat32 angle_increment\n"
    b"float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\n"
    b"float32[] intensities\n" + b"=" * 80 + b"\nMSG: std_msgs/Header\nstring frame_id\n"
)
LASERSCAN_IDL = b"""#include "std_msgs/msg/Header.idl"
module sensor_msgs { module msg {
  @verbatim (language="comment", text="Single scan; (a comment)")
  struct LaserScan {
    std_msgs::msg::Header header;
    @unit (value="rad")
    float angle_min;
    float angle_max; float angle_increment; float time_increment; float scan_time; float range_min; float range_max;
    sequence<float> ranges;
    sequence<float> intensities;
  };
};};
"""


def ranges_of(number: int, beams: int = BEAMS) -> Any:
    """The ranges that sweep `number` of every sample holds."""
    return (number + np.arange(beams) / 16).astype(np.float32)


def sample(
    sweeps: int,
    *,
    compression: str = "zstd",
    index: IndexType = IndexType.ALL,
    chatter: int = 0,
    chunk_size: int = 400,
    beams: int = BEAMS,
    encoding: str = "cdr",
    schema: tuple[str, str, bytes] = ("sensor_msgs/msg/LaserScan", "ros2msg", LASERSCAN_MSG),
    payload: Any = None,
    **options: Any,
) -> bytes:
    """An MCAP with `sweeps` sweeps on /scan, and `chatter` messages of another topic after each."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size, compression=COMPRESSIONS[compression], index_types=index, **options)
    writer.start("ros2", "a test")
    scans = writer.register_channel("/scan", encoding, writer.register_schema(*schema))
    text = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    chat = writer.register_channel("/chat", "cdr", text)
    for number in range(sweeps):
        ranges = ranges_of(number, beams)
        data = payload(number) if payload else scan(ranges, sec=number, encoding=encoding)
        writer.add_message(scans, log_time=number * 10, publish_time=0, data=data, sequence=number)
        for _ in range(chatter):
            writer.add_message(chat, log_time=number * 10 + 1, publish_time=0, data=b"\0\1\0\0" + b"x" * 40)
    writer.finish()
    return stream.getvalue()


def records(data: bytes, start: int = 8) -> Iterator[tuple[int, int, int]]:
    """Opcode, first byte and end of each record."""
    place = start
    while place + 9 <= len(data) - (8 if start == 8 else 0):
        opcode, length = struct.unpack_from("<BQ", data, place)
        yield opcode, place, place + 9 + length
        place += 9 + length


def chunks(data: bytes) -> list[tuple[int, int]]:
    """First byte and end of each chunk."""
    return [(first, end) for opcode, first, end in records(data) if opcode == 6]


def protobuf_scan(number: int) -> bytes:
    """Sweep `number` in protobuf."""
    message: Any = classes()[SCAN]()
    message.timestamp.seconds = number
    message.timestamp.nanos = 8
    message.frame_id = "laser"
    message.start_angle, message.end_angle = -1.5, 1.5
    message.ranges.extend(ranges_of(number).tolist())
    return bytes(message.SerializeToString())


def ros_schema(package: str = "ros.sensor_msgs") -> descriptor_pb2.FileDescriptorSet:
    """LaserScan of ROS, or of Gazebo (`gz.msgs`), as an MCAP's schema record holds it."""
    field = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="LaserScan.proto", package=package, syntax="proto3")

    def add(message: Any, number: int, name: str, kind: Any, **more: Any) -> None:
        message.field.add(name=name, number=number, type=kind, **{"label": field.LABEL_OPTIONAL, **more})

    stamp, header, laser = (file.message_type.add(name=name) for name in ("Time", "Header", "LaserScan"))
    add(stamp, 1, "sec", field.TYPE_UINT32)
    add(stamp, 2, "nsec", field.TYPE_UINT32)
    add(header, 1, "stamp", field.TYPE_MESSAGE, type_name=f".{package}.Time")
    is_ros = package == "ros.sensor_msgs"
    add(header if is_ros else laser, 2 if is_ros else 10, "frame_id" if is_ros else "frame", field.TYPE_STRING)
    add(laser, 1, "header", field.TYPE_MESSAGE, type_name=f".{package}.Header")
    step = "angle_increment" if is_ros else "angle_step"
    for number, name in enumerate(("angle_min", "angle_max", step, "range_min", "range_max"), 2):
        add(laser, number, name, field.TYPE_FLOAT if is_ros else field.TYPE_DOUBLE)
    add(laser, 9, "ranges", field.TYPE_FLOAT if is_ros else field.TYPE_DOUBLE, label=field.LABEL_REPEATED)
    if not is_ros:
        add(laser, 11, "vertical_count", field.TYPE_UINT32)
    return descriptor_pb2.FileDescriptorSet(file=[file])


def ros_protobuf_scan(number: int, package: str = "ros.sensor_msgs", layers: int = 1) -> bytes:
    """Sweep `number` as a message of `ros_schema`."""
    pool = DescriptorPool()
    pool.Add(ros_schema(package).file[0])
    message: Any = GetMessageClass(pool.FindMessageTypeByName(f"{package}.LaserScan"))()
    message.header.stamp.sec, message.header.stamp.nsec = number, 8
    message.angle_min, message.range_max = -1.5, 99.0
    if package == "ros.sensor_msgs":
        message.header.frame_id, message.angle_increment = "laser", 0.5
    else:
        message.frame, message.angle_step, message.vertical_count = "laser", 0.5, layers
    message.ranges.extend(ranges_of(number).tolist())
    return bytes(message.SerializeToString())


def json_scan(number: int, **changes: Any) -> bytes:
    """Sweep `number` in JSON."""
    fields = {
        "timestamp": {"sec": number, "nsec": 8},
        "frame_id": "laser",
        "pose": {"position": {"x": 1, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "start_angle": -1.5,
        "end_angle": 1.5,
        "ranges": ranges_of(number).tolist(),
        "intensities": [],
    }
    return json.dumps({**fields, **changes}).encode()
