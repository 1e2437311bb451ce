"""Sweeps as a log: MCAP, bags of ROS 1 and ROS 2, CSV; the suffix says which, unless a container is given."""

from __future__ import annotations

import gzip
import io
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import cos, sin
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys.store import Typestore

from lidarcli.errors import OptionError, OutputError
from lidarcli.options.choices import CONTAINER_BY_SUFFIX, CONTAINERS
from lidarcli.ros.messages import (
    BAG_COMPRESSIONS,
    ODOMETRY,
    ROS1,
    ROS2,
    SCAN,
    TF,
    Outgoing,
    bag_writer,
    cdr_scans,
    ros1_definition,
    ros1_scans,
    ros2_definition,
    start,
)
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.sweeps.types import Float32, RawSweeps


@dataclass(frozen=True, slots=True)
class Encoding:
    """An encoding of sweeps and poses as bytes."""

    name: str
    scan_type: str
    odometry_type: str
    tf_type: str
    scans: Callable[[RawSweeps], list[bytes]]
    odometry: Callable[[SimulatedPoses, int], bytes]
    link: Callable[[int, str, str, tuple[float, float, float]], bytes]
    """Encodes a transform, by its stamp [ns], the parent and child frames, and x, y, yaw."""

    def transform(self, rows: SimulatedPoses, row: int) -> bytes:
        """Encode a pose of the robot in the odometry frame."""
        x, y, yaw = rows.poses[row].tolist()
        frames = rows.odometry.frame_id, rows.odometry.child_frame_id
        return self.link(int(rows.stamp_ns[row]), *frames, (x, y, yaw))

    def mounting(self, rows: SimulatedPoses) -> bytes:
        """Encode the pose of the laser on the robot."""
        return self.link(int(rows.stamp_ns[0]), rows.odometry.child_frame_id, rows.laser_frame, rows.mount)


def _ros(name: str, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> Encoding:
    """Return the encoding of one generation of ROS."""
    types = store.types

    def header(stamp_ns: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        return types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, frame)

    vector = types["geometry_msgs/msg/Vector3"]

    def turn(yaw: float) -> Any:
        return types["geometry_msgs/msg/Quaternion"](0.0, 0.0, sin(yaw / 2), cos(yaw / 2))

    def odometry(rows: SimulatedPoses, row: int) -> bytes:
        x, y, yaw = rows.poses[row].tolist()
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x, y, 0.0), turn(yaw))
        twist = types["geometry_msgs/msg/Twist"](
            vector(float(rows.speed[row]), 0.0, 0.0), vector(0.0, 0.0, float(rows.yaw_rate[row]))
        )
        message = types[ODOMETRY](
            header(int(rows.stamp_ns[row]), rows.odometry.frame_id),
            rows.odometry.child_frame_id,
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )
        return bytes(serialize(message, ODOMETRY))

    def link(stamp_ns: int, parent: str, child: str, pose: tuple[float, float, float]) -> bytes:
        transform = types["geometry_msgs/msg/Transform"](vector(pose[0], pose[1], 0.0), turn(pose[2]))
        entry = types["geometry_msgs/msg/TransformStamped"](header(stamp_ns, parent), child, transform)
        return bytes(serialize(types[TF]([entry]), TF))

    return Encoding(name, SCAN, ODOMETRY, TF, ros1_scans if ros1 else cdr_scans, odometry, link)


CDR = _ros("cdr", ROS2, ROS2.serialize_cdr, ros1=False)
ROS1_BYTES = _ros("ros1", ROS1, ROS1.serialize_ros1, ros1=True)


POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
NEAR = 0.6
"""Floor and ceiling are visible at so much of the range of what is behind them."""

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")])


def as_clouds(encoding: Encoding) -> Encoding:
    """Return the encoding that writes a point cloud for each sweep."""
    is_ros1 = encoding is ROS1_BYTES
    serialize = ROS1.serialize_ros1 if is_ros1 else ROS2.serialize_cdr
    return replace(
        encoding, scan_type=POINTCLOUD2, scans=lambda raw: _ros_clouds(raw, ROS1 if is_ros1 else ROS2, serialize, is_ros1)
    )


def cloud_points(raw: RawSweeps, row: int) -> np.ndarray[tuple[int, int], np.dtype[Any]]:
    """Return (3, B) points of one sweep: on the floor, at the height of the sensor, at the ceiling; NaN without a range."""
    beams = int(raw.beams[row])
    bearing = raw.angle_min[row] + raw.angle_increment[row] * np.arange(beams)
    ranges = raw.ranges[row, :beams].astype(np.float64)
    ranges[~np.isfinite(ranges) | (ranges <= 0)] = np.nan
    points = np.zeros((3, beams), _POINT)
    for ring, (share, height) in enumerate(((NEAR, -0.5), (1.0, 0.0), (NEAR, 2.0))):
        points["x"][ring] = share * ranges * np.cos(bearing)
        points["y"][ring] = share * ranges * np.sin(bearing)
        points["z"][ring] = np.where(np.isnan(ranges), np.nan, height)
        points["ring"][ring] = ring
        if raw.intensities is not None:
            points["intensity"][ring] = raw.intensities[row, :beams]
    return points


def cloud_fields(floats: int, integers: int) -> list[tuple[str, int, int]]:
    """Return name, offset and type of the fields of a point."""
    kinds = (("x", floats), ("y", floats), ("z", floats), ("intensity", floats), ("ring", integers))
    offsets = {name: int(place[1]) for name, place in (_POINT.fields or {}).items()}
    return [(name, offsets[name], kind) for name, kind in kinds]


def _ros_clouds(raw: RawSweeps, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> list[bytes]:
    types = store.types
    float32, uint16 = 7, 4
    fields = [types["sensor_msgs/msg/PointField"](*each, 1) for each in cloud_fields(float32, uint16)]
    messages = []
    for row in range(len(raw)):
        points = cloud_points(raw, row)
        stamp = types["builtin_interfaces/msg/Time"](*divmod(int(raw.stamp_ns[row]), 10**9))
        header = types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, raw.frame_ids[raw.frame[row]])
        height, width = points.shape
        step = points.itemsize
        message = types[POINTCLOUD2](
            header, height, width, fields, False, step, step * width, points.reshape(-1).view(np.uint8), False
        )
        messages.append(bytes(serialize(message, POINTCLOUD2)))
    return messages


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


class McapEncoding(NamedTuple):
    """Encoding of the messages of an MCAP, and of their schemas."""

    messages: Encoding
    name: str
    profile: str
    schema_of: SchemaOf


ENCODINGS = {
    "cdr": McapEncoding(
        CDR, MessageEncoding.CDR, "ros2", lambda name: (name, SchemaEncoding.ROS2, ros2_definition(name).encode())
    ),
    "ros1": McapEncoding(
        ROS1_BYTES,
        MessageEncoding.ROS1,
        "ros1",
        lambda name: (name.replace("/msg/", "/"), SchemaEncoding.ROS1, ros1_definition(name).encode()),
    ),
}


def write_mcap(
    path: Path,
    blocks: Iterable[RawSweeps],
    *,
    encoding: McapEncoding = ENCODINGS["cdr"],
    compression: str = "zstd",
    chunk_size: int = 1 << 20,
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write an MCAP file, indexed and with checksums; with `clouds` its sweeps are point clouds."""
    encode = as_clouds(encoding.messages) if clouds else encoding.messages
    with path.open("xb") as file:
        writer = start(file, encoding.profile, MCAP_COMPRESSIONS[compression], chunk_size)
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for message in outgoing(blocks, poses, encode):
            if message.topic not in channels:
                if message.type not in schemas:
                    name, kind, text = encoding.schema_of(message.type)
                    schemas[message.type] = writer.register_schema(name, kind, text)
                channels[message.topic] = writer.register_channel(message.topic, encoding.name, schemas[message.type])
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


def _write_bag(path: Path, messages: Iterable[Outgoing], compression: str = "none") -> None:
    """Write a ROS 1 bag."""
    with bag_writer(path, compression) as writer:
        _write_messages(writer, ROS1, messages)


def _write_messages(writer: rosbag1.Writer | rosbag2.Writer, definitions: Typestore, messages: Iterable[Outgoing]) -> None:
    channels: dict[str, Connection] = {}
    for message in messages:
        if message.topic not in channels:
            channels[message.topic] = writer.add_connection(message.topic, message.type, typestore=definitions)
        writer.write(channels[message.topic], message.record_ns, message.data)


def _write_folder(path: Path, messages: Iterable[Outgoing], storage: str = "sqlite3", compression: str = "none") -> None:
    """Write a ROS 2 bag: a folder with its metadata and one file, `sqlite3` or `mcap`."""
    plugin = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[storage]
    writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    mode = FOLDER_COMPRESSIONS[compression]
    if storage == "mcap" and compression == "zstd":
        mode = CompressionMode.STORAGE  # the MCAP file packs its own chunks, and stays readable as it is
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    try:
        with writer:
            _write_messages(writer, ROS2, messages)
    except DATABASE_ERRORS as err:
        raise OutputError(f"{path}: cannot write the database: {err}") from err


def _write_db3(path: Path, messages: Iterable[Outgoing]) -> None:
    """Write the bare database of a ROS 2 bag, without its folder."""
    with tempfile.TemporaryDirectory(prefix=f".{path.stem}.", dir=path.parent) as scratch:
        folder = Path(scratch) / path.stem
        _write_folder(folder, messages)
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


def only_topic(blocks: Iterable[RawSweeps], what: str) -> Iterator[RawSweeps]:
    """Yield the blocks of a log of one topic; OptionError at a second topic."""
    topic = None
    for block in blocks:
        if topic not in (None, block.topic):
            raise OptionError(f"{what} holds one topic, not {topic} and {block.topic}")
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
    durations = [0.0 if each is None else each[row] for each in times]
    values = [block.angle_min[row], last, block.angle_increment[row], *durations]
    return shortest(np.array([*values, block.range_min[row], block.range_max[row]], np.float32))


def frame_of(block: RawSweeps, row: int) -> str:
    return block.frame_ids[int(block.frame[row])]


BAG_FOLDERS = ("ros2", "ros2-mcap")


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


_CHOICES: dict[str, dict[str, tuple[str, ...]]] = {
    "mcap": {"encoding": tuple(ENCODINGS), "compression": tuple(MCAP_COMPRESSIONS)},
    "bag": {"compression": tuple(BAG_COMPRESSIONS)},
    "ros2": {"compression": tuple(FOLDER_COMPRESSIONS)},
    "ros2-mcap": {"compression": tuple(FOLDER_COMPRESSIONS)},
    "db3": {"compression": ("none",)},
    "csv": {"layout": tuple(CSV_LAYOUTS), "compression": ("none",)},
}
"""Container → its options and their values."""


def check_options(
    path: Path,
    container: str | None,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    clouds: bool = False,
) -> str:
    """Return the container of a log; raise OptionError for options that do not fit it."""
    kind = container or container_of(path)
    if kind not in _CHOICES:
        raise OptionError(f"{path}: container '{kind}' is not one of {', '.join(CONTAINERS)}")
    if clouds and kind == "csv":
        raise OptionError(f"{path}: clouds do not apply to the container '{kind}'")
    for option, value in (("encoding", encoding), ("layout", layout), ("compression", compression)):
        choices = _CHOICES[kind].get(option, ())
        if value is not None and not choices:
            raise OptionError(f"{path}: {option} '{value}' does not apply to the container '{kind}'")
        if value is not None and value not in choices:
            raise OptionError(f"{path}: {option} '{value}' is not one of {', '.join(choices)} ({kind})")
    return kind


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
    folders. `encoding` (MCAP): cdr, ros1. `layout` (CSV): rostopic, wide. CSV has no place for `poses`.
    `clouds`: point clouds instead of LaserScan, in logs of messages. Raises OptionError for options that do not fit the
    container, OutputError for a path that exists.
    """
    target = Path(path)
    kind = check_options(target, container, compression, encoding, layout, clouds)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{path}: exists already")
    packed: dict[str, Any] = {} if compression is None else {"compression": compression}
    if kind == "csv":
        write_csv(target, blocks, layout or "rostopic")
        return
    if kind == "mcap":
        how = ENCODINGS[encoding or "cdr"]
        write_mcap(target, blocks, encoding=how, chunk_size=chunk_size, poses=poses, clouds=clouds, **packed)
        return
    encode = ROS1_BYTES if kind == "bag" else CDR
    messages = outgoing(blocks, poses, as_clouds(encode) if clouds else encode)
    if kind == "bag":
        _write_bag(target, messages, **packed)
    elif kind == "db3":
        _write_db3(target, messages)
    else:
        _write_folder(target, messages, "mcap" if kind == "ros2-mcap" else "sqlite3", **packed)
