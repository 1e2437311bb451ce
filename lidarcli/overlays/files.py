"""Files of messages for viewers, MCAP of ROS 2 and bags of ROS 1, and names of topics that every viewer takes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from lidarcli.maps import MAP_TYPE
from lidarcli.overlays.markers import MARKER_TYPE
from lidarcli.ros.mcap_file import ALL, add_channel, offered, start_ros2
from lidarcli.ros.messages import ROS1, SCAN, TF, Outgoing, bag_writer, ros2_definition

OBJECTS, MAP = "/lidarcli/objects", "/lidarcli/map"
FRAME = "laser"
"""The frame of a sensor whose log names none."""
MCAP, BAG, RRD = ".mcap", ".bag", ".rrd"
SUFFIXES = (MCAP, BAG, RRD)
LATEST_NS = (1 << 32) * 1_000_000_000 - 1
"""Latest record time [ns]: bags of ROS 1 count seconds in 32 bits."""


def topic_name(text: str) -> str:
    """Return the topic of a log of any kind as a valid topic of ROS.

    >>> topic_name("front scan"), topic_name("/2d/scan")
    ('/front_scan', '/_2d/scan')
    """
    parts = [re.sub(r"[^A-Za-z0-9_]", "_", part) for part in text.split("/") if part]
    return "".join(f"/{'_' * part[:1].isdigit()}{part}" for part in parts) or "/scan"


def topics_of_objects(topics: Iterable[str]) -> dict[str, str]:
    """Return topic of sweeps → topic of its markers. Each needs its own: a message deletes all markers of its topic.

    >>> topics_of_objects(["/scan"])
    {'/scan': '/lidarcli/objects'}
    >>> topics_of_objects(["/front", "/rear"])
    {'/front': '/lidarcli/objects/front', '/rear': '/lidarcli/objects/rear'}
    """
    names = sorted(set(topics))
    if len(names) == 1:
        return {names[0]: OBJECTS}
    named: dict[str, str] = {}
    for name in names:
        mine = wanted = f"{OBJECTS}{topic_name(name)}"
        number = 1
        while mine in named.values():
            number += 1
            mine = f"{wanted}_{number}"
        named[name] = mine
    return named


class McapFile:
    """MCAP of profile ros2: every message in CDR, every topic with the definition of its type."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb")
        self._writer = start_ros2(self._file)
        self._channels: dict[tuple[str, str], tuple[int, list[int]]] = {}

    def write(self, message: Outgoing) -> None:
        """Append a message."""
        key = (message.topic, message.type)
        known = self._channels.get(key)
        if known is None:
            depth, latched = _offer(*key)
            channel = add_channel(self._writer, *key, ros2_definition(message.type), offered(depth, latched=latched))
            known = self._channels[key] = channel, [0]
        channel, count = known
        log_ns, stamp_ns = _within(message.record_ns), _within(message.stamp_ns)
        self._writer.add_message(channel, log_ns, message.data, stamp_ns, count[0] & 0xFFFFFFFF)
        count[0] += 1

    def finish(self) -> None:
        """Write the index, and close the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def abandon(self) -> None:
        """Let go of a file; what is not in it by now will not be."""
        with suppress(OSError):
            self._file.close()


class BagFile:
    """A bag of ROS 1, packed by lz4."""

    def __init__(self, path: Path) -> None:
        self._writer = bag_writer(path, "lz4")
        self._writer.open()
        self._connections: dict[tuple[str, str], Any] = {}

    def write(self, message: Outgoing) -> None:
        """Append a message."""
        key = (message.topic, message.type)
        if key not in self._connections:
            _, latched = _offer(*key)
            self._connections[key] = self._writer.add_connection(*key, typestore=ROS1, latching=1 if latched else None)
        self._writer.write(self._connections[key], _within(message.record_ns), message.data)

    def finish(self) -> None:
        """Write the index, and close the file."""
        self._writer.close()

    def abandon(self) -> None:
        """Let go of a file; what is not in it by now will not be."""
        if self._writer.bio is not None:
            with suppress(OSError):
                self._writer.bio.close()


def overlay_file(path: Path) -> McapFile | BagFile:
    """Create a file of the format that its suffix names."""
    return McapFile(path) if path.suffix.lower() == MCAP else BagFile(path)


def _within(time_ns: int) -> int:
    """Return the nearest time that files can hold [ns]."""
    return time_ns if 0 <= time_ns <= LATEST_NS else min(max(time_ns, 0), LATEST_NS)


def _offer(topic: str, kind: str) -> tuple[int, bool]:
    """Return the number of messages of a topic that are kept, and True if late subscribers get them."""
    if kind == MAP_TYPE:
        return 1, True
    if kind == TF and topic.endswith("tf_static"):
        # Each of several nodes tells of its own frames.
        return ALL, True
    return (5 if kind in (MARKER_TYPE, SCAN) else 100), False
