"""Messages of ROS as they are written: definitions, LaserScan as bytes built in bulk, and bags of ROS 1."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from lz4.frame import compress
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lidarcli.sweeps import RawSweeps

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"

# The ROS 1 store knows the transforms, but not the message of tf2 that carries them.
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))


def ros2_definition(name: str) -> str:
    """Return the ROS 2 .msg text of a type with everything it contains."""
    return ROS2.generate_msgdef(name, ros_version=2)[0]


def ros1_definition(name: str) -> str:
    """Return the ROS 1 .msg text of a type; its Header has a `seq`."""
    return ROS1.generate_msgdef(name, ros_version=1)[0]


_GEOMETRY = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")


def cdr_scans(raw: RawSweeps) -> list[bytes]:
    """Return LaserScan messages as ROS 2 serialises them (little endian), one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        text = len(frame) + 1
        # Strings end with a zero; what follows is aligned to four bytes.
        return [
            ("magic", "<u4"),
            ("seconds", "<i4"),
            ("nanoseconds", "<u4"),
            ("text", "<u4"),
            ("frame", f"S{text + -text % 4}"),
        ]

    return _bulk(raw, layout, lambda message, frame: _set(message, magic=0x00000100, text=len(frame) + 1))


def ros1_scans(raw: RawSweeps) -> list[bytes]:
    """Return LaserScan messages as ROS 1 serialises them, one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        named = [("seq", "<u4"), ("seconds", "<u4"), ("nanoseconds", "<u4"), ("text", "<u4")]
        return [*named, ("frame", f"S{len(frame)}")] if frame else named

    return _bulk(raw, layout, lambda message, frame: _set(message, text=len(frame)))


def _set(message: np.ndarray[Any, Any], **values: object) -> None:
    for name, value in values.items():
        message[name] = value


def _bulk(
    raw: RawSweeps, layout: Callable[[bytes], list[tuple[str, str]]], finish: Callable[[np.ndarray[Any, Any], bytes], None]
) -> list[bytes]:
    """Build all messages of one frame and beam count at once, and return them in the order of the sweeps."""
    out: list[bytes] = [b""] * len(raw)
    groups, member = np.unique(np.column_stack([raw.frame, raw.beams]), axis=0, return_inverse=True)
    for number, (frame_number, beams) in enumerate(groups):
        rows = np.flatnonzero(member.reshape(-1) == number)
        frame = raw.frame_ids[frame_number].encode()
        fields: list[Any] = [*layout(frame), *((name, "<f4") for name in _GEOMETRY), ("count", "<u4")]
        fields += [("ranges", "<f4", (int(beams),)), ("strengths", "<u4")]
        if raw.intensities is not None:
            fields += [("intensities", "<f4", (int(beams),))]
        message = np.zeros(len(rows), np.dtype(fields))
        seconds, nanoseconds = np.divmod(raw.stamp_ns[rows], 1_000_000_000)
        finish(message, frame)
        angle_max = raw.angle_min[rows] + (beams - 1) * raw.angle_increment[rows]
        _set(message, seconds=seconds, nanoseconds=nanoseconds, count=beams, angle_max=angle_max)
        _set(message, angle_min=raw.angle_min[rows], angle_increment=raw.angle_increment[rows])
        _set(message, range_min=raw.range_min[rows], range_max=raw.range_max[rows])
        for name in ("time_increment", "scan_time"):
            values = getattr(raw, name)
            if values is not None:
                message[name] = values[rows]
        message["ranges"] = raw.ranges[rows, :beams]
        if raw.intensities is not None:
            _set(message, strengths=beams, intensities=raw.intensities[rows, :beams])
        if frame:
            message["frame"] = frame
        data, size = message.tobytes(), message.itemsize
        for place, row in enumerate(rows.tolist()):
            out[row] = data[place * size : (place + 1) * size]
    return out


class Outgoing(NamedTuple):
    """One message on its way into a file."""

    topic: str
    type: str
    record_ns: int
    stamp_ns: int
    """Stamp of the message [ns]; `record_ns` if it has none."""
    data: bytes


BAG_COMPRESSIONS = {"none": None, "bz2": rosbag1.Writer.CompressionFormat.BZ2, "lz4": rosbag1.Writer.CompressionFormat.LZ4}


class BagWriter(rosbag1.Writer):
    """A writer that forgets the entries of written chunks, but for their number: memory does not grow with messages."""

    def write_chunk(self, chunk: Any) -> None:
        super().write_chunk(chunk)
        for number, entries in chunk.connections.items():
            chunk.connections[number] = range(len(entries))


def bag_writer(path: Path, compression: str) -> BagWriter:
    """Return a writer of a new bag, packed by one of `BAG_COMPRESSIONS`; it is still to be opened."""
    writer = BagWriter(path)
    if (form := BAG_COMPRESSIONS[compression]) is not None:
        writer.set_compression(form)
    if compression == "lz4":
        writer.compressor = lz4_frame
    return writer


def lz4_frame(data: bytes) -> bytes:
    """Return a frame of independent blocks, a checksum at its end and no size at its start: roslz4 reads no other."""
    frame: bytes = compress(data, compression_level=0, block_linked=False, content_checksum=True, store_size=False)
    return frame
