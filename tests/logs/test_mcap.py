"""The MCAP reader on logs as writers leave them: every compression, encoding and kind of index."""

from __future__ import annotations

import io
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import IndexType, Writer

from lidarcli.errors import UnreadableError
from lidarcli.logs import foxglove, mcap_walk
from lidarcli.logs.base import LASERSCAN, ReadReport, Topic
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.ros.foxglove import SCAN as FOXGLOVE_SCAN
from lidarcli.ros.foxglove import descriptors
from lidarcli.sweeps.types import RawSweeps, concatenate
from lidarcli.tabular.reading import file_metadata
from lidarcli.tabular.writing import DAMAGE
from tests.logs import mcap_samples as samples
from tests.logs.mcap_samples import json_scan, protobuf_scan, ranges_of, sample
from tests.logs.scan_messages import scan
from tests.logs.watched import McapLog

N = 40
IDL = ("sensor_msgs/msg/LaserScan", "ros2idl", samples.LASERSCAN_IDL)
ROS1 = ("sensor_msgs/LaserScan", "ros1msg", samples.LASERSCAN_MSG.replace(b"std_msgs/", b""))
NO_TEXT = ("sensor_msgs/msg/LaserScan", "ros2msg", b"")
JSON = (FOXGLOVE_SCAN, "jsonschema", b"{}")
PROTOBUF = (FOXGLOVE_SCAN, "protobuf", descriptors().SerializeToString())


def read(source: Any, topics: set[str] | None = None) -> tuple[RawSweeps | None, ReadReport]:
    with McapLog(source) as log:
        blocks = list(log.scans(topics))
        assert {block.topic for block in blocks} <= {"/scan"}
        return (concatenate(blocks) if blocks else None), log.report


def assert_whole(raw: RawSweeps | None, report: ReadReport, sweeps: int = N) -> None:
    assert raw is not None
    assert not report.damage
    assert not report.refused
    assert raw.record_ns.tolist() == [10 * i for i in range(sweeps)]
    assert raw.stamp_ns.tolist() == [i * 10**9 + 8 for i in range(sweeps)]
    np.testing.assert_array_equal(raw.ranges, np.stack([ranges_of(i) for i in range(sweeps)]))
    assert raw.frame_ids == ("laser",)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"index": IndexType.NONE},
        {"index": IndexType.CHUNK},
        {"index": IndexType.MESSAGE},
        {"repeat_channels": False, "repeat_schemas": False},
        {"repeat_schemas": False},
        {"use_statistics": False},
        {"use_summary_offsets": False},
        {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False, "index": IndexType.NONE},
        {"use_chunking": False},
        {"enable_crcs": False},
        {"chunk_size": 1 << 20},
    ],
)
def test_every_way_of_writing_reads_the_same(tmp_path: Path, compression: str, options: dict[str, Any]) -> None:
    data = sample(N, compression=compression, chatter=3, **options)
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    assert_whole(*read(path))
    assert_whole(*read(io.BytesIO(data)))


@pytest.mark.parametrize(
    ("schema", "encoding", "payload"),
    [
        (IDL, "cdr", None),
        (NO_TEXT, "cdr", None),
        (ROS1, "ros1", None),
        (JSON, "json", json_scan),
        (PROTOBUF, "protobuf", protobuf_scan),
    ],
)
def test_every_encoding_reads_the_same(tmp_path: Path, schema: Any, encoding: str, payload: Any) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(sample(N, schema=schema, encoding=encoding, payload=payload, chatter=1))
    raw, report = read(path)
    assert_whole(raw, report)
    assert raw is not None
    assert raw.angle_min.tolist() == [-1.5] * N
    if payload is not None:
        assert raw.angle_increment.tolist() == [0.5] * N
        assert raw.range_min.tolist() == [0] * N
        assert np.isposinf(raw.range_max).all()
    with McapLog(path) as log:
        topics = log.topics()
    assert topics is not None
    assert (topics[0].name, topics[0].encoding, topics[0].messages) == ("/scan", encoding, N)
    assert topics[0].type in (LASERSCAN, FOXGLOVE_SCAN)


def test_big_sweeps_outside_chunks(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(sample(5, use_chunking=False, beams=400_000))
    raw, report = read(path)
    assert raw is not None
    assert not report.damage
    np.testing.assert_array_equal(raw.ranges, np.stack([ranges_of(i, 400_000) for i in range(5)]))


def test_what_a_log_tells_of_itself(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    for options in ({}, {"index": IndexType.NONE, "use_statistics": False, "repeat_channels": False}):
        data = sample(N, compression="lz4", chatter=2, **options)
        path.write_bytes(data)
        with McapLog(path) as log:
            assert (log.path, log.format, log.size) == (str(path), "mcap", len(data))
            assert log.topics() == [
                Topic("/scan", LASERSCAN, "cdr", N),
                Topic("/chat", "std_msgs/msg/String", "cdr", 2 * N),
            ]
            assert sum(map(len, log.scans())) == N
            assert sum(map(len, log.scans())) == N
            assert log.compression == "lz4"
            assert log.position == len(data)
    stream = McapLog(io.BytesIO(sample(2)))
    assert (stream.path, stream.size, stream.topics()) == ("-", None, None)


def test_a_stream_can_be_read_once() -> None:
    log = McapLog(io.BytesIO(sample(2)))
    assert sum(map(len, log.scans())) == 2
    with pytest.raises(UnreadableError, match="a stream can be read only once"):
        list(log.scans())


def test_publishers_of_one_topic_stay_in_order(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=300)
        writer.start("ros2")
        schema = writer.register_schema(*IDL)
        channels = [writer.register_channel("/scan", "cdr", schema) for _ in range(2)]
        for i in range(N):
            data = scan(ranges_of(i, 3 + i % 2), sec=i, frame=b"left" if i % 2 else b"right")
            writer.add_message(channels[i % 2], log_time=i * 10, publish_time=0, data=data)
        writer.finish()
    raw, report = read(path)
    assert raw is not None
    assert not report.damage
    assert raw.record_ns.tolist() == [10 * i for i in range(N)]
    assert [raw.frame_ids[code] for code in raw.frame] == ["right", "left"] * (N // 2)
    assert raw.beams.tolist() == [3, 4] * (N // 2)
    with McapLog(path) as log:
        assert log.topics() == [Topic("/scan", LASERSCAN, "cdr", N)]


def test_chunks_without_a_wanted_message_are_not_decompressed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inflated = []
    inflate = mcap_walk.inflate
    monkeypatch.setattr(mcap_walk, "inflate", lambda *args: inflated.append(args) or inflate(*args))
    data = sample(10, chatter=200)
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    assert_whole(*read(path), 10)
    assert 10 <= len(inflated) <= 21 < len(samples.chunks(data))


@pytest.mark.parametrize(
    ("schema", "encoding", "cause"),
    [
        (
            ("sensor_msgs/msg/LaserScan", "ros2msg", b"std_msgs/Header header\nfloat64 angle_min\n"),
            "cdr",
            "its definition is not the standard one: field 2 is 'float64 angle_min', not 'float32 angle_min'",
        ),
        (
            (*IDL[:2], samples.LASERSCAN_IDL.replace(b"float scan_time;", b"")),
            "cdr",
            "its definition is not the standard one: field 6 is 'float32 range_min', not 'float32 scan_time'",
        ),
        (IDL, "cbor", "the encoding 'cbor' is not read"),
        (
            (FOXGLOVE_SCAN, "protobuf", b"\xff\xff"),
            "protobuf",
            "its protobuf schema does not describe a foxglove.LaserScan",
        ),
    ],
)
def test_a_scan_that_is_none_is_counted(tmp_path: Path, schema: Any, encoding: str, cause: str) -> None:
    """Tables without it are marked, and the exit code is 3."""
    path = tmp_path / "run.mcap"
    path.write_bytes(sample(2, schema=schema, encoding=encoding, payload=lambda _: b"\0" * 99))
    raw, report = read(path)
    assert raw is None
    assert report.refused == {("/scan", cause): 2}
    summary = detect_to_files(Source(str(path), "run"), tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code) == (0, 3)
    assert f"topic /scan: 2 messages left out: {cause}" in file_metadata(tmp_path / "run.sweeps.parquet")[DAMAGE]


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", "is empty"),
        (b"\x89MCAP0\r\n", "an MCAP of its magic alone, without a record"),
        (b"\x89MCAP1\r\n" + b"x" * 99, "is not an MCAP: its first bytes are not the MCAP magic"),
        (
            sample(3).replace(b"\r", b""),
            "an MCAP whose carriage-return bytes were stripped, typically by git's autocrlf; "
            "the log is damaged throughout and must be fetched again as a binary file",
        ),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, data: bytes, cause: str) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    for source, name in ((path, str(path)), (io.BytesIO(data), "-")):
        with pytest.raises(UnreadableError) as caught:
            McapLog(source)
        assert str(caught.value) == f"{name}: {cause}"


def test_json_without_numbers(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    payloads = [
        json_scan(0, ranges=[1, None, "NaN", "Infinity", "-Infinity", 2.5]),
        json_scan(1).replace(b"1.0,", b"Infinity,"),
        json_scan(2, ranges="no"),
        b"{",
        b"[" * 100_000,
        json_scan(3, start_angle=0.5, end_angle=0.5),
        json_scan(4, ranges=["far"]),
        json_scan(5, timestamp={"sec": 1e300}),
        json_scan(6, ranges=[]),
        json_scan(7, start_angle=None),
    ]
    path.write_bytes(sample(10, schema=JSON, encoding="json", payload=lambda i: payloads[i]))
    raw, report = read(path)
    assert raw is not None
    assert raw.record_ns.tolist() == [0, 10, 80]
    np.testing.assert_array_equal(raw.ranges[0, :6], np.float32([1, np.nan, np.nan, np.inf, -np.inf, 2.5]))
    assert raw.ranges[1, 0] == np.inf
    assert raw.beams.tolist() == [6, 7, 0]
    assert report.refused == {
        ("/scan", foxglove.NOT_SCAN): 3,
        ("/scan", foxglove.NOT_JSON): 2,
        ("/scan", "angle_increment is zero"): 1,
        ("/scan", foxglove.STAMP): 1,
    }


def ros_json(number: int, stamp: Any, **changes: Any) -> bytes:
    """Sweep `number` of ROS in JSON."""
    fields = {
        "header": {"stamp": stamp, "frame_id": "laser"},
        "angle_min": -1.5,
        "angle_max": 1.5,
        "angle_increment": 0.5,
        "range_min": 0.0,
        "range_max": 99.0,
        "time_increment": 0.25,
        "scan_time": 0.5,
        "ranges": ranges_of(number).tolist(),
        "intensities": [],
    }
    return json.dumps(fields | changes).encode()


@pytest.mark.parametrize("schema", ["sensor_msgs/msg/LaserScan", "sensor_msgs/LaserScan"])
@pytest.mark.parametrize(
    "stamp",
    [
        lambda second: {"sec": second, "nanosec": 8},
        lambda second: {"secs": second, "nsecs": 8},
        lambda second: f"1970-01-01T00:00:{second:02}.000000008Z",
    ],
)
def test_a_scan_of_ros_in_json(tmp_path: Path, schema: str, stamp: Any) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(
        sample(
            N, schema=(schema, "jsonschema", b"{}"), encoding="json", payload=lambda number: ros_json(number, stamp(number))
        )
    )
    raw, report = read(path)
    assert_whole(raw, report)
    assert raw is not None
    assert raw.time_increment is not None
    assert (raw.angle_increment[0], raw.range_max[0], raw.time_increment[0]) == (0.5, 99.0, 0.25)


@pytest.mark.parametrize("package", ["ros.sensor_msgs", "gz.msgs", "ignition.msgs"])
def test_a_scan_of_ros_or_gazebo_in_protobuf(tmp_path: Path, package: str) -> None:
    """As ros-to-mcap converters named them before foxglove.LaserScan was there, and as Gazebo logs its own."""
    path = tmp_path / "run.mcap"
    schema = (f"{package}.LaserScan", "protobuf", samples.ros_schema(package).SerializeToString())
    payload = partial(samples.ros_protobuf_scan, package=package)
    path.write_bytes(sample(N, schema=schema, encoding="protobuf", payload=payload))
    raw, report = read(path)
    assert_whole(raw, report)
    assert raw is not None
    assert (raw.angle_min[0], raw.angle_increment[0], raw.range_max[0]) == (-1.5, 0.5, 99.0)
    with McapLog(path) as log:
        assert [(topic.type, topic.is_scan) for topic in log.topics() or ()][:1] == [(f"{package}.LaserScan", True)]


def test_a_scan_of_gazebo_in_json(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    plain = {"header": {"stamp": {"sec": "7", "nsec": 8}}, "frame": "laser", "angleMin": -1.5, "angleStep": 0.5}
    path.write_bytes(
        sample(1, schema=JSON, encoding="json", payload=lambda i: json.dumps({**plain, "ranges": [1.0, 2.0]}).encode())
    )
    raw, _ = read(path)
    assert raw is not None
    assert (raw.frame_ids, raw.angle_min[0], raw.angle_increment[0], raw.stamp_ns[0]) == (
        ("laser",),
        -1.5,
        0.5,
        7 * 10**9 + 8,
    )


def test_layers_of_gazebo_are_no_sweep(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    schema = ("gz.msgs.LaserScan", "protobuf", samples.ros_schema("gz.msgs").SerializeToString())
    payload = partial(samples.ros_protobuf_scan, package="gz.msgs", layers=2)
    path.write_bytes(sample(2, schema=schema, encoding="protobuf", payload=payload))
    assert read(path)[1].refused == {("/scan", foxglove.LAYERED): 2}


def test_broken_protobuf_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    payloads = [protobuf_scan(0), b"\xff" * 9, protobuf_scan(2)]
    path.write_bytes(sample(3, schema=PROTOBUF, encoding="protobuf", payload=lambda i: payloads[i]))
    raw, report = read(path)
    assert raw is not None
    assert raw.record_ns.tolist() == [0, 20]
    assert report.refused == {("/scan", foxglove.NOT_PROTOBUF): 1}
