"""Sweeps as a log: MCAP, bags of ROS 1 and ROS 2, CSV; the suffix says which, unless told otherwise."""

from __future__ import annotations

import gzip
import io
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys.store import Typestore

from lidarcli.choices import CONTAINER_BY_SUFFIX, CONTAINERS
from lidarcli.errors import OptionError, OutputError
from lidarcli.foxglove import descriptors, json_schema
from lidarcli.ros.mcap_file import start
from lidarcli.ros.messages import BAG_COMPRESSIONS, ROS1, ROS2, SCAN, Outgoing, bag_writer, ros1_definition, ros2_definition
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.simulation.messages import CDR, JSON, LASERSCAN_IDL, PROTOBUF, ROS1_BYTES, Encoding, as_clouds
from lidarcli.sweeps import Float32, RawSweeps


def outgoing(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None, encoding: Encoding) -> Iterator[Outgoing]:
    """Encode sweeps block by block, merging in the poses."""
    pose = 0
    if poses is not None and len(poses) and poses.odometry.tf:
        first = int(poses.stamp_ns[0])
        yield Outgoing("/tf_static", encoding.tf_type, first, first, encoding.mounting(poses))
    for block in blocks:
        records, stamps = block.record_ns.tolist(), block.stamp_ns.tolist()
        for record_ns, stamp_ns, data in zip(records, stamps, encoding.scans(block), strict=True):
            while poses is not None and pose < len(poses) and poses.stamp_ns[pose] <= record_ns:
                yield from _pose(poses, pose, encoding)
                pose += 1
            yield Outgoing(block.topic, encoding.scan_type, record_ns, stamp_ns, data)


def _pose(poses: SimulatedPoses, row: int, encoding: Encoding) -> Iterator[Outgoing]:
    stamp_ns = int(poses.stamp_ns[row])
    odometry = encoding.odometry(poses, row)
    yield Outgoing(poses.odometry.topic, encoding.odometry_type, stamp_ns, stamp_ns, odometry)
    if poses.odometry.tf:
        yield Outgoing("/tf", encoding.tf_type, stamp_ns, stamp_ns, encoding.transform(poses, row))


MCAP_COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}

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
    "json": (JSON, MessageEncoding.JSON, "", _json_schema),
    "protobuf": (PROTOBUF, MessageEncoding.Protobuf, "", _protobuf_schema),
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
        writer = start(file, profile, MCAP_COMPRESSIONS[compression], chunk_size)
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for message in outgoing(blocks, poses, encode):
            if message.topic not in channels:
                if message.type not in schemas:
                    name, kind, text = schema_of(message.type)
                    schemas[message.type] = writer.register_schema(name, kind, text)
                channels[message.topic] = writer.register_channel(message.topic, channel_encoding, schemas[message.type])
            number = counts[message.topic] = counts.get(message.topic, -1) + 1
            writer.add_message(channels[message.topic], message.record_ns, message.data, message.stamp_ns, number)
        writer.finish()  # type: ignore[no-untyped-call]


DATABASE_ERRORS: tuple[type[Exception], ...] = (sqlite3.Error,)
try:
    import apsw
except ImportError:  # older releases of rosbags write through the standard library
    pass
else:
    DATABASE_ERRORS += (apsw.Error,)

FOLDER_COMPRESSIONS = {"none": CompressionMode.NONE, "zstd": CompressionMode.FILE, "zstd-message": CompressionMode.MESSAGE}


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
        _write_messages(writer, ROS1, outgoing(blocks, poses, encode))


def _write_messages(writer: rosbag1.Writer | rosbag2.Writer, definitions: Typestore, messages: Iterable[Outgoing]) -> None:
    channels: dict[str, Connection] = {}
    for message in messages:
        if message.topic not in channels:
            channels[message.topic] = writer.add_connection(message.topic, message.type, typestore=definitions)
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
            _write_messages(writer, ROS2, outgoing(blocks, poses, encode))
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


_S = 1_000_000_000
GEOMETRY = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")


def write_csv(path: Path, blocks: Iterable[RawSweeps], layout: str = "rostopic") -> None:
    """Write sweeps of one topic as CSV, packed where its name ends in `.gz`.

    Ranges and geometry are the shortest decimals that read back as the same float32.
    """
    write_lines(path, CSV_LAYOUTS[layout](only_topic(blocks, "a CSV")))


def sweep_texts(blocks: Iterable[RawSweeps]) -> Iterator[tuple[int, RawSweeps, int, list[str]]]:
    """Yield the number of each sweep, its block, its row there, and its ranges as text."""
    rows = ((block, row, ranges) for block in blocks for row, ranges in enumerate(texts(block)))
    for number, (block, row, ranges) in enumerate(rows):
        yield number, block, row, ranges


def _rostopic(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in sweep_texts(blocks):
        if not number:
            names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
            names += [f"field.{name}" for name in GEOMETRY]
            names += [f"field.ranges{i}" for i in range(len(ranges))]
            yield ",".join(names + [f"field.intensities{i}" for i in range(len(ranges))])
        head = [str(block.record_ns[row]), str(number), str(block.stamp_ns[row]), frame_of(block, row)]
        yield ",".join(head + geometry_texts(block, row) + ranges + intensity_texts(block, row, "0.0"))


def _wide(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in sweep_texts(blocks):
        if not number:
            yield ",".join(["time"] + [f"r{i}" for i in range(len(ranges))])
        yield ",".join([seconds(int(block.stamp_ns[row])), *ranges])


CSV_LAYOUTS: dict[str, Callable[[Iterable[RawSweeps]], Iterator[str]]] = {"rostopic": _rostopic, "wide": _wide}
"""Layouts of a CSV: as `rostopic echo -p` writes it, and one of times and ranges alone."""


@contextmanager
def opened(path: Path) -> Iterator[IO[str]]:
    """Open a text file with bare newlines; the gzip header has neither time nor name: equal input, equal bytes."""
    if path.suffix != ".gz":
        with path.open("w", encoding="utf-8", newline="") as out:
            yield out
        return
    with (
        path.open("wb") as raw,
        gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed,
        io.TextIOWrapper(packed, encoding="utf-8", newline="") as out,
    ):
        yield out


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines to a new text file, packed where its name ends in `.gz`."""
    with opened(path) as out:
        for line in lines:
            out.write(line)
            out.write("\n")


def only_topic(blocks: Iterable[RawSweeps], what: str, instead: str = "") -> Iterator[RawSweeps]:
    """Yield the blocks of a log of one topic; OptionError, with what to do `instead`, at a second topic."""
    topic = None
    for block in blocks:
        if topic not in (None, block.topic):
            hint = f": {instead}" if instead else ""
            raise OptionError(f"{what} holds one topic, not {topic} and {block.topic}{hint}")
        topic = block.topic
        yield block


def texts(block: RawSweeps) -> Iterator[list[str]]:
    """Yield the ranges of each sweep as shortest decimals."""
    for row, beams in zip(block.ranges, block.beams.tolist(), strict=True):
        yield shortest(row[:beams])


def intensity_texts(block: RawSweeps, row: int, otherwise: str | None = None) -> list[str]:
    """Return the intensities of a sweep as shortest decimals; without any, `otherwise` for each beam, or nothing."""
    beams = int(block.beams[row])
    if block.intensities is None:
        return [] if otherwise is None else [otherwise] * beams
    return shortest(block.intensities[row, :beams])


def shortest(values: Float32) -> list[str]:
    """Return the shortest decimals that read back as the same float32."""
    numbers: list[str] = values.astype("U").tolist()
    return numbers


def seconds(stamp_ns: int) -> str:
    """Return nanoseconds as seconds with nine decimals.

    >>> seconds(-1_500_000_000)
    '-1.500000000'
    """
    sign, rest = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{rest // _S}.{rest % _S:09d}"


def geometry_texts(block: RawSweeps, row: int) -> list[str]:
    beams = int(block.beams[row])
    last = block.angle_min[row] + (beams - 1) * block.angle_increment[row]
    times = (block.time_increment, block.scan_time)
    told = [0.0 if each is None else each[row] for each in times]
    values = [block.angle_min[row], last, block.angle_increment[row], *told]
    return shortest(np.array([*values, block.range_min[row], block.range_max[row]], np.float32))


def frame_of(block: RawSweeps, row: int) -> str:
    return block.frame_ids[int(block.frame[row])]


def stamp_parts(block: RawSweeps, row: int) -> list[str]:
    """Return seconds and nanoseconds of the stamp of a sweep."""
    return [str(part) for part in divmod(int(block.stamp_ns[row]), _S)]


_COMPRESSIONS: dict[str, tuple[Iterable[str], str]] = {
    "mcap": (MCAP_COMPRESSIONS, "zstd"),
    "bag": (BAG_COMPRESSIONS, "none"),
    "ros2": (FOLDER_COMPRESSIONS, "none"),
    "ros2-mcap": (FOLDER_COMPRESSIONS, "none"),
}
"""Container → its compressions and the default; the others are not compressed."""
BAG_FOLDERS = ("ros2", "ros2-mcap")
"""Containers that are a folder."""


def container_of(path: Path) -> str:
    """Return the container that a path's suffix asks for; a name without a suffix is a ROS 2 bag folder."""
    name = path.name.lower()
    for suffix, container in CONTAINER_BY_SUFFIX.items():
        if name.endswith(suffix) or (container == "csv" and name.endswith(f"{suffix}.gz")):
            return container
    if not path.suffix:
        return "ros2"
    raise OptionError(
        f"{path}: no log format has the suffix '{path.suffix}'; use {', '.join(CONTAINER_BY_SUFFIX)} "
        "(.csv also with .gz), or no suffix for a ROS 2 bag folder"
    )


def write_log(
    path: str | Path,
    blocks: Iterable[RawSweeps],
    *,
    container: str | None = None,
    compression: str | None = None,
    encoding: str | None = None,
    layout: str | None = None,
    chunk_size: int = 1 << 20,
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write sweeps into a new log; the same sweeps and options give the same bytes.

    `compression`: none, lz4, zstd for MCAP; none, bz2, lz4 for ROS 1 bags; none, zstd (the file), zstd-message for ROS 2
    folders. `encoding` (MCAP): cdr, cdr-idl, ros1, json, protobuf. `layout` (CSV): rostopic, wide. CSV has no place
    for `poses`. `clouds`: point clouds instead of LaserScan, in logs of messages.
    Raises OptionError for options that do not fit the container, OutputError for a path that exists.
    """
    target = Path(path)
    kind = container or container_of(target)
    write = _writer(str(path), kind, compression, encoding, layout, chunk_size, poses, clouds)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{path}: exists already")
    write(target, blocks)


def check_options(
    path: Path,
    container: str | None,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    clouds: bool = False,
) -> None:
    """Raise OptionError where `write_log` would, before any work is done."""
    _writer(str(path), container or container_of(path), compression, encoding, layout, 1, None, clouds)


def _writer(
    path: str,
    container: str,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    chunk_size: int,
    poses: SimulatedPoses | None,
    clouds: bool,
) -> Callable[[Path, Iterable[RawSweeps]], None]:
    """Check the options against the container and bind them to its writer."""

    def one_of(option: str, value: str | None, choices: Sequence[str], default: str) -> str:
        if value is None:
            return default
        if not choices:
            raise OptionError(f"{path}: {option} '{value}' does not apply to the container '{container}'")
        if value not in choices:
            raise OptionError(f"{path}: {option} '{value}' is not one of {', '.join(choices)} ({container})")
        return value

    encodings = tuple(ENCODINGS) if container == "mcap" else ()
    encode = one_of("encoding", encoding, encodings, "cdr")
    if container != "csv":
        one_of("layout", layout, (), "")
    if clouds and container == "csv":
        raise OptionError(f"{path}: clouds do not apply to the container '{container}'")
    if container not in CONTAINERS:
        raise OptionError(f"{path}: container '{container}' is not one of {', '.join(CONTAINERS)}")
    compressions, default = _COMPRESSIONS.get(container, (("none",), "none"))
    packed = one_of("compression", compression, tuple(compressions), default)
    if container == "mcap":
        return partial(write_mcap, encoding=encode, compression=packed, chunk_size=chunk_size, poses=poses, clouds=clouds)
    if container == "bag":
        return partial(write_bag, compression=packed, poses=poses, clouds=clouds)
    if container in BAG_FOLDERS:
        storage = "mcap" if container == "ros2-mcap" else "sqlite3"
        return partial(write_folder, storage=storage, compression=packed, poses=poses, clouds=clouds)
    if container == "db3":
        return partial(write_db3, poses=poses, clouds=clouds)
    return partial(write_csv, layout=one_of("layout", layout, tuple(CSV_LAYOUTS), next(iter(CSV_LAYOUTS))))
