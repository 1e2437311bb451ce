"""MCAP files of ROS 2 messages, as every rosbag2 reads them."""

from __future__ import annotations

from typing import BinaryIO

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

ALL = 0
"""Depth of an unbounded history."""


def start(
    file: BinaryIO, profile: str, compression: CompressionType = CompressionType.ZSTD, chunk_size: int = 1 << 20
) -> Writer:
    """Return a writer whose bytes depend on what is written alone."""
    # The library would write summary offsets of groups without any record, too, which are none; files need no offsets.
    writer = Writer(file, chunk_size, compression, use_summary_offsets=False)
    # The library names its version here by default, and the bytes would change with it.
    writer.start(profile=profile, library="lidarcli")
    return writer


def start_ros2(file: BinaryIO) -> Writer:
    """Return a writer of profile `ros2`, as of `start`."""
    writer = start(file, "ros2")
    # Says that what follows is as in Humble: without it, rosbag2 from Jazzy on takes a file for its own, where policies are
    # words.
    writer.add_metadata("rosbag2", {"ROS_DISTRO": "", "serialized_metadata": ""})
    return writer


def add_channel(writer: Writer, topic: str, kind: str, definition: str, offered: str) -> int:
    """Register a channel of CDR messages of a type, and return its number."""
    schema = writer.register_schema(kind, SchemaEncoding.ROS2, definition.encode())
    return writer.register_channel(topic, MessageEncoding.CDR, schema, {"offered_qos_profiles": offered})


def offered(depth: int, *, latched: bool) -> str:
    """Return the QoS profile of a topic, as rosbag2 writes it up to Humble.

    Parameters
    ----------
    depth : how many messages are kept for those who subscribe late, or read slowly; `ALL` for all
    latched : whether who subscribes later gets them all the same
    """
    # The numbers, which every rosbag2 reads: Humble does not know the words. History 1 is keep_last and 2 keep_all,
    # reliability 1 reliable, durability 1 transient_local and 2 volatile, liveliness 1 automatic. Times of 2^63 - 1 ns are
    # infinite.
    forever = "\n    sec: 9223372036\n    nsec: 854775807\n"
    return (
        f"- history: {2 if depth == ALL else 1}\n  depth: {depth}\n  reliability: 1\n  durability: {1 if latched else 2}\n"
        f"  deadline:{forever}  lifespan:{forever}  liveliness: 1\n  liveliness_lease_duration:{forever}"
        "  avoid_ros_namespace_conventions: false"
    )
