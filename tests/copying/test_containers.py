"""In every container a copy differs from its log by the ranges of the chosen beams, and by nothing else."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

import lidarcli
from lidarcli.cli import run
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.ros.foxglove import descriptors
from lidarcli.ros.messages import ROS1, bag_writer
from lidarcli.simulation.generate import simulate_blocks
from lidarcli.simulation.scene import load_scene
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.copying.reading import bytes_that_differ, messages, ranges
from tests.logs.scan_messages import scan
from tests.places import SAMPLES
from tests.text_logs import write_log

SWEEPS = 60
CONTAINERS: dict[str, tuple[str, dict[str, Any]]] = {
    "mcap": ("run.mcap", {}),
    "mcap lz4": ("run.mcap", {"compression": "lz4", "chunk_size": 100_000}),
    "mcap plain": ("run.mcap", {"compression": "none"}),
    "mcap ros1": ("run.mcap", {"encoding": "ros1"}),
    "mcap protobuf": ("run.mcap", {"encoding": "protobuf"}),
    "bag": ("run.bag", {}),
    "bag lz4": ("run.bag", {"compression": "lz4"}),
    "bag bz2": ("run.bag", {"compression": "bz2"}),
    "database": ("run.db3", {}),
    "folder": ("run", {}),
    "folder, file packed": ("run", {"compression": "zstd"}),
    "folder, messages packed": ("run", {"compression": "zstd-message"}),
    "folder of mcap": ("run", {"container": "ros2-mcap"}),
    "folder of mcap, messages packed": ("run", {"container": "ros2-mcap", "compression": "zstd-message"}),
}


@pytest.fixture(scope="module")
def people() -> RawSweeps:
    """People who walk through a room."""
    return concatenate([block.raw for block in simulate_blocks(load_scene(SAMPLES / "people.toml"), SWEEPS)])


@pytest.fixture(scope="module")
def nobody() -> RawSweeps:
    """A room where nobody is."""
    return concatenate([block.raw for block in simulate_blocks(load_scene(SAMPLES / "room_empty.toml"), SWEEPS)])


def copy_of(path: Path) -> Path:
    return path.with_name(f"copy{path.suffix}")


def cleaned(log: Path, **options: Any) -> tuple[Path, Any]:
    """The copy of a log, and the table beside it."""
    out = copy_of(log)
    return out, lidarcli.clean(log, out, overwrite=True, **options)


def assert_only_beams_differ(log: Path, out: Path, table: Any, said: float = math.nan) -> int:
    """Assert that messages are the same but for as many ranges as the table tells; returns how many differ."""
    before, after = messages(log), messages(out)
    assert [replace(each, data=b"") for each in before] == [replace(each, data=b"") for each in after]
    taken = [sum(row[name] for name in ("agents", "temporary", "body", "margin")) for row in table.to_pylist()]
    schema = descriptors().SerializeToString(deterministic=True)
    scans = [(one, other) for one, other in zip(before, after, strict=True) if "LaserScan" in one.type]
    assert len(scans) == len(taken)
    for one, other in zip(before, after, strict=True):
        assert "LaserScan" in one.type or one.data == other.data
    for (one, other), count in zip(scans, taken, strict=True):
        if not count:
            assert one.data == other.data
        places, values = ranges(one, schema)
        _, others = ranges(other, schema)
        differ = [at for at, (a, b) in enumerate(zip(values, others, strict=True)) if not same(a, b)]
        assert len(differ) == count
        assert all(same(others[at], said) for at in differ)
        if places and not one.data.startswith(b"\x28\xb5\x2f\xfd"):
            allowed = {places[at] + byte for at in differ for byte in range(4)}
            assert bytes_that_differ(one.data, other.data) <= allowed
        elif not places:
            assert len(one.data) == len(other.data)
            assert len(bytes_that_differ(one.data, other.data)) <= 8 * count
    return sum(taken)


def same(one: float, other: float) -> bool:
    return struct.pack("<d", one) == struct.pack("<d", other)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONTAINERS)
def test_only_ranges_of_chosen_beams_differ(kind: str, people: RawSweeps, tmp_path: Path) -> None:
    name, options = CONTAINERS[kind]
    log = tmp_path / name
    write_log(log, [people], **options)
    out, table = cleaned(log)
    assert assert_only_beams_differ(log, out, table) > 1500


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mcap lz4", "bag lz4", "folder, file packed", "folder of mcap"])
def test_where_nobody_moves_every_payload_is_the_same(kind: str, nobody: RawSweeps, tmp_path: Path) -> None:
    name, options = CONTAINERS[kind]
    log = tmp_path / name
    write_log(log, [nobody], **options)
    out, table = cleaned(log)
    assert assert_only_beams_differ(log, out, table) == 0
    assert [each.data for each in messages(log)] == [each.data for each in messages(out)]


@pytest.mark.slow
@pytest.mark.parametrize(("value", "said"), [("inf", math.inf), ("above", 31.0), (0.25, 0.25)])
def test_beams_say_what_is_asked_for(value: str | float, said: float, people: RawSweeps, tmp_path: Path) -> None:
    log = tmp_path / "run.bag"
    write_log(log, [people])
    out, table = cleaned(log, value=value)
    assert assert_only_beams_differ(log, out, table, said) > 1500


def payloads(people: RawSweeps, rows: int, echoes: int, **how: Any) -> list[bytes]:
    """The sweeps as messages, written field by field; with several `echoes` of each beam."""
    found = []
    for row in range(rows):
        values = people.ranges[row].tolist()
        several = [[r + 0.5 * echo for echo in range(echoes)] if beam % 7 else [] for beam, r in enumerate(values)]
        step = float(people.angle_increment[row])
        first = float(people.angle_min[row])
        geometry = (first, first + step * (len(values) - 1), step, 0.0, 0.05, 0.1, 30.0)
        seconds, nanoseconds = divmod(int(people.stamp_ns[row]), 1_000_000_000)
        found.append(
            scan(
                values,
                sec=seconds,
                nsec=nanoseconds,
                geometry=geometry,
                echoes=several if echoes else None,
                intensities=[1.0] * (0 if echoes else len(values)),
                **how,
            )
        )
    return found


MULTI = "sensor_msgs/msg/MultiEchoLaserScan"
SINGLE = "sensor_msgs/msg/LaserScan"


def write_odd(path: Path, people: RawSweeps, data: Sequence[bytes], kind: str) -> None:
    """An MCAP with two publishers of one topic, attachments, metadata, an unused channel, and others in between."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4, chunk_size=200_000)
        writer.start(profile="ros2", library="somebody")
        writer.add_metadata("begin", {"who": "somebody"})
        unused = writer.register_schema("pkg/msg/Unused", "ros2msg", b"int32 x")
        writer.register_channel("/unused", "cdr", unused, {"offered_qos_profiles": "- depth: 1"})
        schema = writer.register_schema(kind, "ros2msg", b"")
        scans = [writer.register_channel("/scan", "cdr", schema, {"publisher": each}) for each in "ab"]
        other = writer.register_channel("/status", "json", 0)
        for row, message in enumerate(data):
            time = int(people.stamp_ns[row])
            writer.add_message(scans[row % 2], time + 5, message, time, 1000 + 3 * row)
            writer.add_message(other, time + 6, b'{"row": %d}' % row, time + 6, row)
            if row == 30:
                writer.add_attachment(time, time + 1, "notes.txt", "text/plain", b"in the middle")
                writer.add_metadata("middle", {"row": "30"})
        writer.add_attachment(1, 2, "end.bin", "application/octet-stream", bytes(1000))
        writer.finish()  # type: ignore[no-untyped-call]


@pytest.mark.slow
@pytest.mark.parametrize(("big", "echoes"), [(False, 0), (True, 0), (False, 2), (True, 3)])
def test_byte_orders_echoes_and_all_that_is_no_message(big: bool, echoes: int, people: RawSweeps, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    write_odd(log, people, payloads(people, SWEEPS, echoes, big=big), MULTI if echoes else SINGLE)
    out, table = cleaned(log)
    if echoes:
        table = table.set_column(4, "agents", [[each * echoes for each in table["agents"].to_pylist()]])
        table = table.set_column(7, "margin", [[each * echoes for each in table["margin"].to_pylist()]])
    assert assert_only_beams_differ(log, out, table) > 1500
    with log.open("rb") as one, out.open("rb") as other:
        before, after = make_reader(one), make_reader(other)
        assert before.get_header() == after.get_header()
        assert [*before.iter_attachments()] == [*after.iter_attachments()]
        assert [*before.iter_metadata()] == [*after.iter_metadata()]
        told, found = before.get_summary(), after.get_summary()
    assert told is not None
    assert found is not None
    assert told.channels == found.channels
    assert told.schemas == found.schemas
    assert told.statistics is not None
    assert replace(told.statistics, chunk_count=0) == replace(found.statistics, chunk_count=0)


@pytest.mark.slow
def test_latched_topics_and_connections_of_a_bag_stay(people: RawSweeps, tmp_path: Path) -> None:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1 import Writer as BagWriter

    from lidarcli.ros.messages import ROS1

    log = tmp_path / "run.bag"
    string = ROS1.types["std_msgs/msg/String"]
    writer = BagWriter(log)
    writer.chunk_threshold = 50_000
    with writer:
        latched = writer.add_connection("/map_name", "std_msgs/msg/String", typestore=ROS1, callerid="/maps", latching=1)
        scans = [writer.add_connection("/scan", SINGLE, typestore=ROS1, callerid=f"/laser{number}") for number in range(2)]
        first = int(people.stamp_ns[0])
        writer.write(latched, first, ROS1.serialize_ros1(string(data="room"), "std_msgs/msg/String"))
        for row, message in enumerate(payloads(people, SWEEPS, 0, encoding="ros1")):
            writer.write(scans[row % 2], int(people.stamp_ns[row]), message)
    out, table = cleaned(log)
    assert assert_only_beams_differ(log, out, table) > 1500
    with Reader(log) as before, Reader(out) as after:
        told, found = ([each._replace(owner=None) for each in one.connections] for one in (before, after))
        assert told == found
        assert told[0].ext.latching == 1  # type: ignore[union-attr]
        assert before.message_count == after.message_count
        assert (before.start_time, before.end_time) == (after.start_time, after.end_time)


CUT = {"run.mcap": {"chunk_size": 100_000}, "run.bag": {}, "run.db3": {}}


@pytest.mark.slow
@pytest.mark.parametrize("name", CUT)
def test_of_a_log_that_is_cut_off_all_whole_messages_are_copied(name: str, people: RawSweeps, tmp_path: Path) -> None:
    whole, log = tmp_path / f"whole{Path(name).suffix}", tmp_path / name
    write_log(whole, [people], **CUT[name])
    log.write_bytes(whole.read_bytes()[: whole.stat().st_size * 7 // 10])
    out = copy_of(log)
    assert run(["-q", "clean", str(log), "-o", str(out)]) == 3
    before, after = messages(whole), messages(out)
    with open_log(str(log)) as opened:
        report = ReadReport()
        readable = sum(len(block) for block in opened.scans(None, report))
    assert report.damage
    assert 20 < len(after) == readable < len(before)
    for one, other in zip(before, after, strict=False):
        assert len(one.data) == len(other.data)
        assert np.mean(np.frombuffer(one.data, np.uint8) == np.frombuffer(other.data, np.uint8)) > 0.7


def test_a_log_with_odd_stamps_is_copied_as_it_is(nobody: RawSweeps, tmp_path: Path) -> None:
    stamps = nobody.stamp_ns.copy()
    stamps[[0, 20]] = 0, 5
    write_log(tmp_path / "run.mcap", [replace(nobody, stamp_ns=stamps, record_ns=nobody.stamp_ns)])
    out, table = cleaned(tmp_path / "run.mcap")
    assert assert_only_beams_differ(tmp_path / "run.mcap", out, table) == 0


def test_a_bag_is_written_without_compression_where_its_name_is_damaged(tmp_path: Path) -> None:
    """The name stands in the header of a chunk: without an index it is what the log says of itself."""
    with bag_writer(tmp_path / "copy.bag", "@\0\0\0") as writer:
        scans = writer.add_connection("/scan", SINGLE, typestore=ROS1)
        writer.write(scans, 1, scan([1.0, 2.0], encoding="ros1"))
    assert b"compression=none" in (tmp_path / "copy.bag").read_bytes()
