"""Writing ROS 1 and ROS 2 bags."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Iterable
from pathlib import Path

from rosbags import rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from lidarcli.errors import OutputError
from lidarcli.ros.messages import ROS1, ROS2, bag_writer
from lidarcli.simulate.clouds import as_clouds
from lidarcli.simulate.messages import CDR, ROS1_BYTES
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.simulate.outgoing import outgoing
from lidarcli.sweeps import RawSweeps

DATABASE_ERRORS: tuple[type[Exception], ...] = (sqlite3.Error,)
try:
    import apsw
except ImportError:  # older releases of rosbags write through the standard library
    pass
else:
    DATABASE_ERRORS += (apsw.Error,)

FOLDER_COMPRESSIONS = {
    "none": CompressionMode.NONE,
    "zstd": CompressionMode.FILE,
    "zstd-message": CompressionMode.MESSAGE,
}


def write_bag(
    path: Path,
    blocks: Iterable[RawSweeps],
    *,
    compression: str = "none",
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write a ROS 1 bag; with `clouds` its sweeps are point clouds."""
    encode = as_clouds(ROS1_BYTES) if clouds else ROS1_BYTES
    with bag_writer(path, compression) as writer:
        channels: dict[str, Connection] = {}
        for message in outgoing(blocks, poses, encode):
            if message.topic not in channels:
                channels[message.topic] = writer.add_connection(message.topic, message.type, typestore=ROS1)
            writer.write(channels[message.topic], message.record_ns, message.data)


def write_folder(
    path: Path,
    blocks: Iterable[RawSweeps],
    *,
    storage: str = "sqlite3",
    compression: str = "none",
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write a ROS 2 bag: a folder with its metadata and one file, `sqlite3` or `mcap`; sweeps as of `write_bag`."""
    encode = as_clouds(CDR) if clouds else CDR
    plugin = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[storage]
    writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    mode = FOLDER_COMPRESSIONS[compression]
    if storage == "mcap" and compression == "zstd":
        mode = CompressionMode.STORAGE  # the MCAP file packs its own chunks, and stays readable as it is
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    try:
        with writer:
            channels: dict[str, Connection] = {}
            for message in outgoing(blocks, poses, encode):
                if message.topic not in channels:
                    channels[message.topic] = writer.add_connection(
                        message.topic, message.type, typestore=ROS2
                    )
                writer.write(channels[message.topic], message.record_ns, message.data)
    except DATABASE_ERRORS as err:
        raise OutputError(f"{path}: cannot write the database: {err}") from err


def write_db3(
    path: Path, blocks: Iterable[RawSweeps], *, poses: SimulatedPoses | None = None, clouds: bool = False
) -> None:
    """Write the bare database of a ROS 2 bag, without its folder; sweeps as of `write_bag`."""
    with tempfile.TemporaryDirectory(prefix=f".{path.stem}.", dir=path.parent) as scratch:
        folder = Path(scratch) / path.stem
        write_folder(folder, blocks, poses=poses, clouds=clouds)
        next(folder.glob("*.db3")).replace(path)
