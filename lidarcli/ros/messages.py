"""Messages of ROS as they are written: definitions, LaserScan as bytes built in bulk, bags of ROS 1, and MCAP of ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from lz4.frame import compress
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lidarcli.sweeps.types import RawSweeps

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
    return _scans(raw, is_ros1=False)


def ros1_scans(raw: RawSweeps) -> list[bytes]:
    """Return LaserScan messages as ROS 1 serialises them, one per sweep."""
    return _scans(raw, is_ros1=True)


def _scans(raw: RawSweeps, is_ros1: bool) -> list[bytes]:
    """Build all messages of one frame and beam count at once, and return them in the order of the sweeps."""
    out: list[bytes] = [b""] * len(raw)
    groups, member = np.unique(np.column_stack([raw.frame, raw.beams]), axis=0, return_inverse=True)
    for number, (frame_number, beams) in enumerate(groups):
        rows = np.flatnonzero(member.reshape(-1) == number)
        frame = raw.frame_ids[frame_number].encode()
        # Strings of CDR end with a zero, and what follows is aligned to four bytes.
        length = len(frame) if is_ros1 else len(frame) + 1
        width = length if is_ros1 else length + -length % 4
        # The first word is the sequence number of ROS 1, or the encapsulation of CDR.
        head = [("first", "<u4"), ("seconds", "<u4" if is_ros1 else "<i4"), ("nanoseconds", "<u4"), ("length", "<u4")]
        fields: list[Any] = [*head, *([("frame", f"S{width}")] if width else [])]
        fields += [*((name, "<f4") for name in _GEOMETRY), ("count", "<u4")]
        fields += [("ranges", "<f4", (int(beams),)), ("strengths", "<u4")]
        if raw.intensities is not None:
            fields += [("intensities", "<f4", (int(beams),))]
        message = np.zeros(len(rows), np.dtype(fields))
        message["first"], message["length"] = 0 if is_ros1 else 0x100, length
        message["seconds"], message["nanoseconds"] = np.divmod(raw.stamp_ns[rows], 1_000_000_000)
        if frame:
            message["frame"] = frame
        message["angle_max"] = raw.angle_min[rows] + (beams - 1) * raw.angle_increment[rows]
        for name in _GEOMETRY:
            if name != "angle_max" and (values := getattr(raw, name)) is not None:
                message[name] = values[rows]
        message["count"], message["ranges"] = beams, raw.ranges[rows, :beams]
        if raw.intensities is not None:
            message["strengths"], message["intensities"] = beams, raw.intensities[rows, :beams]
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
    if (form := BAG_COMPRESSIONS.get(compression)) is not None:
        writer.set_compression(form)
    if compression == "lz4":
        writer.compressor = lz4_frame
    return writer


def lz4_frame(data: bytes) -> bytes:
    """Return a frame of independent blocks, a checksum at its end and no size at its start: roslz4 reads no other."""
    frame: bytes = compress(data, compression_level=0, block_linked=False, content_checksum=True, store_size=False)
    return frame


ALL = 0


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
