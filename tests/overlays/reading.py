"""Overlays read back by another library."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader


@dataclass(frozen=True)
class Read:
    """One message of a file."""

    topic: str
    type: str
    record_ns: int
    data: bytes
    message: Any


def read_back(path: Path, topic: str | None = None) -> list[Read]:
    """The messages of an MCAP file or a bag, in the order of their record times, as rosbags has them."""
    return list(_messages(path, topic))


def _messages(path: Path, topic: str | None) -> Iterator[Read]:
    with AnyReader([path]) as reader:
        wanted = [each for each in reader.connections if topic is None or each.topic == topic]
        if not wanted:
            return
        for connection, time, data in reader.messages(wanted):
            message = reader.deserialize(data, connection.msgtype)
            yield Read(connection.topic, connection.msgtype, time, bytes(data), message)


def stamp_ns(message: Any) -> int:
    """The stamp of a message with a header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)
