"""Small logs of every container, and how to mutate what is inside their compressed parts."""

from __future__ import annotations

import bz2
import gzip
import io
import struct
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard

from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.simulation.scene import Odometry
from lidarcli.sweeps.types import RawSweeps
from tests.text_logs import LAYOUTS, write_log
from tools.fuzz.mutate import Random, mutate

SWEEPS = 10
BEAMS = 24
STEP_NS = 100_000_000

Pack = Callable[[bytes], bytes]


@dataclass(frozen=True, slots=True)
class Sample:
    """A log as the files it is made of."""

    log: str
    """What is opened: a file of `files`, or the folder they are in."""
    files: Mapping[str, bytes]
    inside: Mapping[str, tuple[bytes, Pack]] = field(default_factory=dict)
    """File → what its packed part holds, and how to make the file again from that."""

    def mutated(self, random: Random) -> dict[str, bytes]:
        """The same log with one of its files changed, before or after packing."""
        name = sorted(self.files)[int(random.integers(len(self.files)))]
        if name in self.inside and random.integers(2):
            content, pack = self.inside[name]
            changed = pack(mutate(content, random))
        else:
            changed = mutate(self.files[name], random)
        return {**self.files, name: changed}


def sweeps(topic: str = "/scan", beams: int = BEAMS, seed: int = 1, lit: bool = False) -> RawSweeps:
    """Sweeps with some beams of every kind, from two frames; `lit`: with intensities."""
    random = np.random.default_rng(seed)
    ranges = random.uniform(0.05, 9.0, (SWEEPS, beams)).round(3).astype(np.float32)
    ranges[:, 5], ranges[:, 9], ranges[:, 11] = np.inf, 0.0, np.nan
    stamps = 1_700_000_000_000_000_000 + STEP_NS * np.arange(SWEEPS)
    return RawSweeps(
        topic=topic,
        frame_ids=("laser", "rear"),
        frame=np.arange(SWEEPS, dtype=np.int32) % 2,
        stamp_ns=stamps,
        record_ns=stamps + 7,
        angle_min=np.full(SWEEPS, -1.5),
        angle_increment=np.full(SWEEPS, 0.125),
        range_min=np.full(SWEEPS, 0.1, np.float32),
        range_max=np.full(SWEEPS, 8.0, np.float32),
        beams=np.full(SWEEPS, beams, np.int32),
        ranges=ranges,
        intensities=random.integers(1, 4000, ranges.shape).astype(np.float32) if lit else None,
    )


def poses() -> SimulatedPoses:
    """A straight way for the sweeps."""
    return SimulatedPoses(
        odometry=Odometry(),
        laser_frame="laser",
        stamp_ns=sweeps().stamp_ns,
        poses=np.column_stack([np.arange(SWEEPS) * 0.1, np.zeros(SWEEPS), np.zeros(SWEEPS)]),
        speed=np.ones(SWEEPS),
        yaw_rate=np.zeros(SWEEPS),
    )


def _written(log: str, container: str | None = None, with_poses: bool = True, lit: bool = False, **options: Any) -> Sample:
    blocks = [sweeps(lit=lit), sweeps("/rear", BEAMS - 5, 2, lit)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / log
        if container in ("csv", "rplidar"):
            write_log(path, blocks[:1], container=container, **options)
        elif container == "carmen":
            write_log(path, blocks[:1], container=container, poses=poses() if with_poses else None)
        else:
            write_log(path, blocks, container=container, poses=poses(), **options)
        found = [path] if path.is_file() else sorted(path.iterdir())
        return Sample(log, {str(file.relative_to(folder)): file.read_bytes() for file in found})


def _mcap(encoding: str, compression: str, lit: bool = False, chunk_size: int = 1500, clouds: bool = False) -> Sample:
    """Chunks of half a dozen messages; inside, one chunk without a checksum is packed again."""
    sample, plain = (
        _written("run.mcap", encoding=encoding, compression=packed, chunk_size=chunk_size, lit=lit, clouds=clouds)
        for packed in (compression, "none")
    )
    return _of_chunks(sample, plain.files["run.mcap"], compression)


def _echoes(encoding: str) -> Sample:
    """Messages with up to three echoes of each beam, and how strong they are."""
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/MultiEchoLaserScan"
    text, _ = store.generate_msgdef(kind, ros_version=1 if encoding == "ros1" else 2)
    out = io.BytesIO()
    writer = Writer(out, chunk_size=1500, compression=CompressionType.NONE)
    writer.start(library="lidarcli")
    ros1 = encoding == "ros1"
    name = kind.replace("/msg/", "/") if ros1 else kind
    schema = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", text.encode())
    channel = writer.register_channel("/scan", encoding, schema)
    raw = sweeps(lit=True)
    for row in range(SWEEPS):
        stamp = int(raw.stamp_ns[row])
        data = _echo_message(store, kind, raw, row, ros1)
        writer.add_message(channel, stamp, data, stamp)
    writer.finish()  # type: ignore[no-untyped-call]
    return _of_chunks(Sample("run.mcap", {"run.mcap": out.getvalue()}), out.getvalue(), "none")


def _echo_message(store: Any, kind: str, raw: RawSweeps, row: int, ros1: bool) -> bytes:
    """The echoes of a beam are its range and those of the beams behind it; of every second sweep all have two."""
    types = store.types
    echo = types["sensor_msgs/msg/LaserEcho"]
    assert raw.intensities is not None

    def lists(values: Any) -> list[Any]:
        counts = [2] * BEAMS if row % 2 else [beam % 4 for beam in range(BEAMS)]
        return [echo(np.roll(values, -beam)[:count].copy()) for beam, count in enumerate(counts)]

    whole, rest = divmod(int(raw.stamp_ns[row]), 1_000_000_000)
    stamp = types["builtin_interfaces/msg/Time"](whole, rest)
    header = types["std_msgs/msg/Header"](*([row] if ros1 else []), stamp, raw.frame_ids[raw.frame[row]])
    message = types[kind](header, -1.5, 1.5, 0.125, 0.0, 0.0, 0.1, 8.0, lists(raw.ranges[row]), lists(raw.intensities[row]))
    return bytes(store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind))


def _of_chunks(sample: Sample, plain: bytes, compression: str) -> Sample:
    """The same, and what is inside its first chunk; `plain` is the file without compression."""
    first, content, end = _first_chunk(plain)

    def pack(changed: bytes) -> bytes:
        packed = _PACKERS[compression](changed)
        name = b"" if compression == "none" else compression.encode()
        head = struct.pack("<QQQII", 0, 2**62, len(changed), 0, len(name)) + name
        chunk = head + struct.pack("<Q", len(packed)) + packed
        return plain[:first] + struct.pack("<BQ", 6, len(chunk)) + chunk + plain[end:]

    return Sample(sample.log, sample.files, {"run.mcap": (content, pack)})


def _first_chunk(data: bytes) -> tuple[int, bytes, int]:
    """Where the first chunk of an uncompressed MCAP begins, what it holds, and where it ends."""
    place = 8
    while data[place] != 6:
        place += 9 + int(struct.unpack_from("<Q", data, place + 1)[0])
    end = place + 9 + int(struct.unpack_from("<Q", data, place + 1)[0])
    return place, data[place + 9 + 32 + 8 : end], end


def _bag(compression: str, clouds: bool = False) -> Sample:
    """Inside, the one chunk of the bag is packed again."""
    sample = _written("run.bag", compression=compression, clouds=clouds)
    plain = _written("run.bag", compression="none", clouds=clouds).files["run.bag"]
    # The bag record fills the file's first 4096 bytes.
    first = 13 + 4096
    header = int(struct.unpack_from("<I", plain, first)[0])
    size = int(struct.unpack_from("<I", plain, first + 4 + header)[0])
    start = first + 8 + header

    def pack(changed: bytes) -> bytes:
        packed = _PACKERS[compression](changed)
        fields = (b"compression=" + compression.encode(), b"op=\x05", b"size=" + struct.pack("<I", len(changed)))
        head = b"".join(struct.pack("<I", len(part)) + part for part in fields)
        record = struct.pack("<I", len(head)) + head + struct.pack("<I", len(packed)) + packed
        return plain[:first] + record + plain[start + size :]

    return Sample(sample.log, sample.files, {"run.bag": (plain[start : start + size], pack)})


def _folder(container: str, compression: str) -> Sample:
    sample = _written("run", container, compression=compression)
    if compression != "zstd" or container != "ros2":
        return sample
    plain = _written("run", container).files
    content = next(data for name, data in plain.items() if name.endswith(".db3"))
    packed = next(name for name in sample.files if name.endswith(".zstd"))
    return Sample(sample.log, sample.files, {packed: (content, _PACKERS["zstd"])})


def _csv(log: str, layout: str, lit: bool = False) -> Sample:
    return _perhaps_packed(log, _written(log, "csv", lit=lit, layout=layout))


def _text(container: str, log: str, with_poses: bool = True, lit: bool = False) -> Sample:
    """A text log of one message per line; of CARMEN without poses RAWLASER1 in the place of FLASER and ODOM.

    With intensities (`lit`) CARMEN has REMISSIONFLASER in the place of FLASER.
    """
    return _perhaps_packed(log, _written(log, container, with_poses, lit))


def _rplidar(log: str) -> Sample:
    return _perhaps_packed(log, _written(log, "rplidar"))


def _jsonl(log: str) -> Sample:
    return _perhaps_packed(log, _written(log))


def _perhaps_packed(log: str, sample: Sample) -> Sample:
    if not log.endswith(".gz"):
        return sample
    return Sample(log, sample.files, {log: (gzip.decompress(sample.files[log]), _PACKERS["gzip"])})


def _lz4(data: bytes) -> bytes:
    return bytes(lz4.frame.compress(data))


def _zstd(data: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(data)


_PACKERS: Mapping[str, Pack] = {"none": bytes, "lz4": _lz4, "zstd": _zstd, "bz2": bz2.compress, "gzip": gzip.compress}

_MAKERS: dict[str, Callable[[], Sample]] = {
    **{
        f"mcap-{encoding}-{compression}": partial(_mcap, encoding, compression)
        for encoding in ("cdr", "ros1", "json", "protobuf")
        for compression in ("none", "lz4", "zstd")
    },
    **{f"bag-{compression}": partial(_bag, compression) for compression in ("none", "bz2", "lz4")},
    "db3": partial(_written, "run.db3"),
    **{f"ros2-{compression}": partial(_folder, "ros2", compression) for compression in ("none", "zstd", "zstd-message")},
    "ros2-mcap": partial(_folder, "ros2-mcap", "none"),
    **{
        f"csv-{layout}": partial(_csv, "run" if layout == "per-sweep" else "run.csv", layout)
        for layout in LAYOUTS
        if layout != "drow"
    },
    "csv-gz": partial(_csv, "run.csv.gz", "rostopic"),
    **{
        f"clouds-mcap-{encoding}": partial(_mcap, encoding, "zstd", lit, 8000, True)
        for encoding, lit in (("cdr", True), ("ros1", False), ("json", False), ("protobuf", True))
    },
    "clouds-bag": partial(_bag, "lz4", True),
    "clouds-bag-none": partial(_bag, "none", True),
    "clouds-db3": partial(_written, "run.db3", clouds=True),
    "carmen": partial(_text, "carmen", "run.log"),
    "carmen-raw": partial(_text, "carmen", "run.clf", False),
    "carmen-gz": partial(_text, "carmen", "run.log.gz"),
    "rplidar": partial(_rplidar, "run.txt"),
    "rplidar-gz": partial(_rplidar, "run.txt.gz"),
    "jsonl": partial(_jsonl, "run.jsonl"),
    "jsonl-gz": partial(_jsonl, "run.jsonl.gz"),
    **{f"mcap-{encoding}-lit": partial(_mcap, encoding, "none", True) for encoding in ("cdr", "ros1", "json")},
    **{f"mcap-{encoding}-echoes": partial(_echoes, encoding) for encoding in ("cdr", "ros1")},
    **{f"csv-{layout}-lit": partial(_csv, "run.csv", layout, True) for layout in ("plotjuggler", "bagpy", "list")},
    "carmen-remission": partial(_text, "carmen", "run.log", True, True),
    "carmen-raw-lit": partial(_text, "carmen", "run.log", False, True),
}

CONTAINERS = tuple(_MAKERS)


@cache
def sample_of(container: str) -> Sample:
    """The sample of one of `CONTAINERS`, the same bytes every time."""
    return _MAKERS[container]()
