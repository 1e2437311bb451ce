"""Writing MCAP."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from lidarcli.foxglove import descriptors, json_schema
from lidarcli.ros.messages import SCAN, ros1_definition, ros2_definition
from lidarcli.simulate import foxglove
from lidarcli.simulate.clouds import as_clouds
from lidarcli.simulate.definitions import LASERSCAN_IDL
from lidarcli.simulate.messages import CDR, ROS1_BYTES, Encoding
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.simulate.outgoing import outgoing
from lidarcli.sweeps import RawSweeps

COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}

SchemaOf = Callable[[str], tuple[str, str, bytes]]
"""Message type → name, encoding and text of its schema."""


def _ros2_schema(name: str) -> tuple[str, str, bytes]:
    return name, SchemaEncoding.ROS2, ros2_definition(name).encode()


def _idl_schema(name: str) -> tuple[str, str, bytes]:
    return (name, "ros2idl", LASERSCAN_IDL.encode()) if name == SCAN else _ros2_schema(name)


def _ros1_schema(name: str) -> tuple[str, str, bytes]:
    return name.replace("/msg/", "/"), SchemaEncoding.ROS1, ros1_definition(name).encode()


def _json_schema(name: str) -> tuple[str, str, bytes]:
    return name, SchemaEncoding.JSONSchema, json_schema(name).encode()


def _protobuf_schema(name: str) -> tuple[str, str, bytes]:
    return name, SchemaEncoding.Protobuf, descriptors().SerializeToString(deterministic=True)


ENCODINGS: dict[str, tuple[Encoding, str, str, SchemaOf]] = {
    "cdr": (CDR, MessageEncoding.CDR, "ros2", _ros2_schema),
    "cdr-idl": (CDR, MessageEncoding.CDR, "ros2", _idl_schema),
    "ros1": (ROS1_BYTES, MessageEncoding.ROS1, "ros1", _ros1_schema),
    "json": (foxglove.JSON, MessageEncoding.JSON, "", _json_schema),
    "protobuf": (foxglove.PROTOBUF, MessageEncoding.Protobuf, "", _protobuf_schema),
}
"""Encoding → how to make bytes, what the channel calls it, the profile of the file, and its schemas."""


def write_mcap(
    path: Path,
    blocks: Iterable[RawSweeps],
    *,
    encoding: str = "cdr",
    compression: str = "zstd",
    chunk_size: int = 1 << 20,
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write an MCAP file, indexed and with checksums; with `clouds` its sweeps are point clouds."""
    encode, channel_encoding, profile, schema_of = ENCODINGS[encoding]
    encode = as_clouds(encode) if clouds else encode
    with path.open("xb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=COMPRESSIONS[compression])
        # The library names its version here by default, and the bytes would change with it.
        writer.start(profile=profile, library="lidarcli")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for message in outgoing(blocks, poses, encode):
            if message.topic not in channels:
                if message.type not in schemas:
                    name, kind, text = schema_of(message.type)
                    schemas[message.type] = writer.register_schema(name, kind, text)
                channels[message.topic] = writer.register_channel(
                    message.topic, channel_encoding, schemas[message.type]
                )
            number = counts[message.topic] = counts.get(message.topic, -1) + 1
            writer.add_message(
                channels[message.topic], message.record_ns, message.data, message.stamp_ns, number
            )
        writer.finish()  # type: ignore[no-untyped-call]
