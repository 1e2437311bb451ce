"""Bags of ROS 1, as every rosbag reads them."""

from __future__ import annotations

from pathlib import Path

from lz4.frame import compress
from rosbags import rosbag1

COMPRESSIONS = {
    "none": None,
    "bz2": rosbag1.Writer.CompressionFormat.BZ2,
    "lz4": rosbag1.Writer.CompressionFormat.LZ4,
}


def bag_writer(path: Path, compression: str) -> rosbag1.Writer:
    """A writer of a new bag, packed by one of `COMPRESSIONS`; it is still to be opened."""
    writer = rosbag1.Writer(path)
    if (form := COMPRESSIONS[compression]) is not None:
        writer.set_compression(form)
    if compression == "lz4":
        writer.compressor = _lz4_frame
    return writer


def _lz4_frame(data: bytes) -> bytes:
    """A frame of independent blocks, a checksum at its end and no size at its start: roslz4 reads no other."""
    frame: bytes = compress(
        data, compression_level=0, block_linked=False, content_checksum=True, store_size=False
    )
    return frame
