"""A map as a ROS 2 message in an MCAP file, which RViz, Foxglove and `ros2 bag play` show."""

from __future__ import annotations

import struct
from typing import BinaryIO

import numpy as np

from lidarcli.formalism.mapping.occupancy import Occupancy
from lidarcli.ros.mcap_file import add_channel, offered, start_ros2

TYPE = "nav_msgs/msg/OccupancyGrid"
_RULE = "=" * 80
DEFINITION = f"""\
std_msgs/Header header
nav_msgs/MapMetaData info
int8[] data
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: nav_msgs/MapMetaData
builtin_interfaces/Time map_load_time
float32 resolution
uint32 width
uint32 height
geometry_msgs/Pose origin
{_RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
"""The message and all that it contains."""

_LAST_STAMP_NS = (1 << 31) * 1_000_000_000 - 1


def write_occupancy_mcap(file: BinaryIO, grid: Occupancy, stamp_ns: int, topic: str = "/map") -> None:
    """Write an MCAP file with the map as its one message, on a latched topic.

    A stamp [ns] that ROS 2 cannot hold, before 1970 or after 2038, becomes the nearest one that it can.
    """
    stamp_ns = min(max(stamp_ns, 0), _LAST_STAMP_NS)
    writer = start_ros2(file)
    channel = add_channel(writer, topic, TYPE, DEFINITION, offered(1, latched=True))
    writer.add_message(channel, stamp_ns, occupancy_cdr(grid, stamp_ns), stamp_ns)
    writer.finish()  # type: ignore[no-untyped-call]


def occupancy_cdr(grid: Occupancy, stamp_ns: int) -> bytes:
    """The map as a nav_msgs/msg/OccupancyGrid in little-endian CDR, stamped with a time of 0 ns to 2^31 s."""
    stamp = divmod(stamp_ns, 1_000_000_000)
    frame = grid.frame_id.encode("utf-8", "replace") + b"\0"
    height, width = grid.cells.shape
    body = bytearray(struct.pack("<iII", *stamp, len(frame)) + frame)
    _align(body, 4)
    body += struct.pack("<iIfII", *stamp, grid.resolution, width, height)
    _align(body, 8)
    body += struct.pack("<7d", grid.x, grid.y, 0, 0, 0, 0, 1)
    body += struct.pack("<I", grid.cells.size)
    return b"".join((b"\0\1\0\0", body, np.ascontiguousarray(grid.cells, np.int8).data.cast("B")))


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)
