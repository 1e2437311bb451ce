"""`lidarcli overlay`: what viewers get of each kind of log, and what is refused."""

from __future__ import annotations

import errno
import json
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_typestore

from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.logs import open_log
from lidarcli.logs.base import POSE_TYPES, SCAN_TYPES, ReadReport
from lidarcli.maps.grids import pgm_bytes, yaml_bytes
from lidarcli.overlays import viewers
from lidarcli.overlays.objects import PART
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests import text_logs
from tests.overlays.reading import Read, read_back, stamp_ns
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs
from tests.sweeping import room_sweeps

Run = Callable[..., Any]
OBJECTS, MARKERS = "/lidarcli/objects", "visualization_msgs/msg/MarkerArray"
DRIVE, PEOPLE = SAMPLES / "drive.db3", SAMPLES / "people.csv.gz"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Overlays with their logs: of a driving robot (ROS 2) for ROS 2 and ROS 1, and of people (CSV)."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("overlays")
    for log in (DRIVE, PEOPLE):
        name = log.name.split(".")[0]
        assert run(["-q", "track", str(log), "-o", str(folder)]) == 0
        for suffix in (".mcap", ".bag"):
            out = folder / f"{name}{suffix}"
            assert run(["-q", "overlay", str(log), "-o", str(out), "--with-log", "--overwrite"]) == 0
    return folder


def sweeps_of(log: Path) -> list[tuple[str, int, int, str]]:
    """Topic, record time, stamp and frame of every sweep."""
    with open_log(log) as opened:
        return [
            (block.topic, record, stamp, block.frame_ids[frame])
            for block in opened.scans(None, ReadReport())
            for record, stamp, frame in zip(
                block.record_ns.tolist(), block.time_ns.tolist(), block.frame.tolist(), strict=True
            )
        ]


def scans_of(log: Path) -> RawSweeps:
    """All sweeps of a log with one topic."""
    with open_log(log) as opened:
        return concatenate(list(opened.scans(None, ReadReport())))


def number_of(marker: Any) -> int:
    """The track that a marker belongs to, or the object that has none, below 0."""
    return int(marker.id if marker.id < 0 else marker.id % PART)


def markers(messages: list[Read], namespace: str) -> list[Any]:
    return [marker for each in messages for marker in each.message.markers if marker.ns == namespace]


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
@pytest.mark.parametrize("log", [DRIVE, PEOPLE], ids=["drive", "people"])
def test_there_is_a_message_for_every_sweep_at_its_time(made: Path, log: Path, suffix: str) -> None:
    found = read_back(made / f"{log.name.split('.')[0]}{suffix}", OBJECTS)
    assert {each.type for each in found} == {MARKERS}
    expected = [(record, stamp, frame) for _, record, stamp, frame in sweeps_of(log)]
    assert [
        (each.record_ns, stamp_ns(each.message.markers[0]), each.message.markers[0].header.frame_id) for each in found
    ] == expected
    for each, (_, stamp, frame) in zip(found, expected, strict=True):
        assert {(stamp_ns(marker), marker.header.frame_id) for marker in each.message.markers} == {(stamp, frame)}


@pytest.mark.parametrize("name", ["drive", "people"])
def test_what_is_drawn_is_what_the_tables_say(made: Path, name: str) -> None:
    table = pq.read_table(made / f"{name}.objects.parquet").to_pylist()
    found = read_back(made / f"{name}.mcap", OBJECTS)
    bodies = {
        (number, number_of(marker), round(marker.pose.position.x, 6), round(marker.pose.position.y, 6)): marker
        for number, each in enumerate(found)
        for marker in each.message.markers
        if marker.ns == "body"
    }
    expected = {
        (row["sweep"], row["track"] or -row["object"], round(row["box_x"], 6), round(row["box_y"], 6)): row for row in table
    }
    assert bodies.keys() == expected.keys()
    for key, marker in bodies.items():
        assert (marker.type == 3) == (expected[key]["shape"] == "round")
    seen = [(row["sweep"], row["track"] or -row["object"]) for row in table]
    assert len(markers(found, "label")) == len(set(seen))
    moving = {(row["sweep"], row["track"]) for row in table if row["moving"] and np.hypot(row["vx"], row["vy"]) > 0.05}
    arrows = {(number, m.id) for number, each in enumerate(found) for m in each.message.markers if m.ns == "velocity"}
    assert arrows <= moving
    assert len(arrows) > 100 if name == "people" else not arrows


@pytest.mark.parametrize("log", [DRIVE, SAMPLES / "corridor.bag"], ids=["ros2", "ros1"])
@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_the_log_is_copied_as_it_is(lidarcli: Run, tmp_path: Path, log: Path, suffix: str) -> None:
    out = tmp_path / f"o{suffix}"
    assert lidarcli("-q", "overlay", str(log), "-o", str(out), "--with-log").code == 0
    with open_log(log) as opened:
        there = list(opened.messages(SCAN_TYPES | POSE_TYPES, ReadReport()))
    found = [each for each in read_back(out) if each.type != MARKERS]
    assert Counter((one.topic, one.type) for one in there) == Counter((one.topic, one.type) for one in found)
    assert sorted((one.topic, one.record_ns) for one in there) == sorted((one.topic, one.record_ns) for one in found)
    if (log is DRIVE) == (suffix == ".mcap"):
        assert sorted(one.data for one in there) == sorted(one.data for one in found)
    else:
        store = get_typestore(Stores.ROS2_HUMBLE)
        turned = [
            bytes((store.cdr_to_ros1 if suffix == ".bag" else store.ros1_to_cdr)(one.data, one.type)) for one in there
        ]
        assert sorted(turned) == sorted(one.data for one in found)
    before, after = scans_of(log), scans_of(out)
    assert np.array_equal(before.ranges, after.ranges, equal_nan=True)
    assert np.array_equal(before.stamp_ns, after.stamp_ns)


def test_an_mcap_is_as_rosbag2_wants_it(made: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with (made / "drive.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    for schema in summary.schemas.values():
        assert schema.data.decode() == store.generate_msgdef(schema.name, ros_version=2)[0]
    offered = {}
    for channel in summary.channels.values():
        (offered[channel.topic],) = parse_qos(channel.metadata["offered_qos_profiles"])
    assert {topic for topic, qos in offered.items() if qos.durability is QosDurability.TRANSIENT_LOCAL} == {"/tf_static"}
    assert offered["/tf_static"].history is QosHistory.KEEP_ALL


def test_a_bag_has_the_types_that_ros1_knows(made: Path) -> None:
    # What every ROS 1 node compares before it takes a message.
    known = {
        MARKERS: "d155b9ce5188fbaf89745847fd5882d7",
        "sensor_msgs/msg/LaserScan": "90c7ef2dc6895d81024acba2ac42f369",
        "tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec",
        "nav_msgs/msg/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    }
    with AnyReader([made / "drive.bag"]) as reader:
        assert {each.msgtype: each.digest for each in reader.connections} == known
        assert {each.topic for each in reader.connections if each.ext.latching} == {"/tf_static"}


def test_a_map_is_latched_in_the_world_of_the_log(lidarcli: Run, tmp_path: Path) -> None:
    cells = np.random.default_rng(1).choice(np.array([-1, 0, 100], np.int8), (5, 7))
    grid = Occupancy(0.05, -1.0, -2.0, cells)
    (tmp_path / "room.yaml").write_bytes(yaml_bytes(grid, "room.pgm"))
    (tmp_path / "room.pgm").write_bytes(pgm_bytes(grid))
    for suffix in (".mcap", ".bag"):
        out = tmp_path / f"o{suffix}"
        told = ("overlay", str(DRIVE), "-o", str(out), "--map", str(tmp_path / "room.yaml"), "--overwrite")
        assert lidarcli("-q", *told).code == 0
        (shown,) = read_back(out, "/lidarcli/map")
        assert shown.type == "nav_msgs/msg/OccupancyGrid"
        assert shown.message.header.frame_id == "odom"
        # Beams of a sensor at 0 are above it.
        assert shown.message.info.origin.position.z == -0.05
        assert shown.message.data.tolist() == cells.ravel().tolist()
        assert shown.record_ns == min(each.record_ns for each in read_back(out))
    with AnyReader([tmp_path / "o.bag"]) as reader:
        (ext,) = [each.ext for each in reader.connections if each.topic == "/lidarcli/map"]
    assert ext.latching == 1
    with (tmp_path / "o.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    (latched,) = [each for each in channels if each.topic == "/lidarcli/map"]
    (qos,) = parse_qos(latched.metadata["offered_qos_profiles"])
    assert (qos.durability, qos.depth) == (QosDurability.TRANSIENT_LOCAL, 1)
    layout = json.loads((tmp_path / "o.layout.json").read_text())
    assert "/lidarcli/map" in layout["configById"]["3D!lidarcli"]["topics"]


def test_each_sensor_has_a_topic_of_its_own(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "two.mcap"
    assert lidarcli("-q", "overlay", str(logs / "two.mcap"), "-o", str(out), "--with-log").code == 0
    found = Counter(each.topic for each in read_back(out))
    counts = Counter(topic for topic, *_ in sweeps_of(logs / "two.mcap"))
    assert found == counts + Counter({f"{OBJECTS}{topic}": number for topic, number in counts.items()})
    chosen = tmp_path / "one.mcap"
    told = ("overlay", str(logs / "two.mcap"), "-o", str(chosen), "--with-log", "--topic", "/rear")
    assert lidarcli("-q", *told).code == 0
    assert Counter(each.topic for each in read_back(chosen)) == {"/rear": counts["/rear"], OBJECTS: counts["/rear"]}


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_a_log_that_is_not_ros_is_written_anew(lidarcli: Run, tmp_path: Path, encoding: str) -> None:
    log, out = tmp_path / "run.mcap", tmp_path / "o.mcap"
    text_logs.simulate(SAMPLES / "drive.toml", log, 200, encoding=encoding)
    ran = lidarcli("overlay", str(log), "-o", str(out), "--with-log", code=0)
    found = read_back(out)
    before, after = scans_of(log), scans_of(out)
    assert np.array_equal(before.ranges, after.ranges, equal_nan=True)
    assert np.array_equal(before.time_ns, after.time_ns)
    assert "is not copied" in ran.err
    with out.open("rb") as file:
        times = [message.log_time for *_, message in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    # The sensor's way is told by transforms that were not in the log as such.
    transforms = [each.message.transforms[0] for each in found if each.topic == "/tf"]
    assert {(one.header.frame_id, one.child_frame_id) for one in transforms} == {("odom", "laser")}
    assert len(transforms) == Counter(each.topic for each in found)["/scan"]
    assert "transforms of laser are written by its poses" in ran.err
    # By these transforms each body is where the tables have it in the world.
    assert lidarcli("-q", "track", str(log), "-o", str(tmp_path)).code == 0
    table = pq.read_table(tmp_path / "run.objects.parquet").to_pylist()
    expected = [(row["sweep"], row["world_x"], row["world_y"]) for row in table]
    placed = []
    messages = [each.message for each in found if each.topic == OBJECTS]
    for number, (moved, message) in enumerate(zip(transforms, messages, strict=True)):
        turn, at = moved.transform.rotation, moved.transform.translation
        yaw = 2 * np.arctan2(turn.z, turn.w)
        for marker in message.markers:
            if marker.ns == "body":
                x, y = marker.pose.position.x, marker.pose.position.y
                world = (at.x + np.cos(yaw) * x - np.sin(yaw) * y, at.y + np.sin(yaw) * x + np.cos(yaw) * y)
                placed.append((number, *world))
    # Places in the sensor frame are of single precision.
    assert np.array(sorted(placed)) == pytest.approx(np.array(sorted(expected)), abs=2e-6)
    assert json.loads((tmp_path / "o.layout.json").read_text())["configById"]["3D!lidarcli"]["followTf"] == "odom"


def test_the_same_input_gives_the_same_bytes(lidarcli: Run, made: Path, tmp_path: Path) -> None:
    for suffix in (".mcap", ".bag"):
        out = tmp_path / f"drive{suffix}"
        told = ("--objects", str(made / "drive.objects.parquet"), "--with-log", "--overwrite")
        assert lidarcli("-q", "overlay", str(DRIVE), "-o", str(out), *told).code == 0
        # Also with the tables in place of the run that makes them.
        assert out.read_bytes() == (made / out.name).read_bytes()
    assert (tmp_path / "drive.rviz").read_bytes() == (made / "drive.rviz").read_bytes()


def test_tables_that_know_more_than_the_log_are_told_of(lidarcli: Run, tmp_path: Path) -> None:
    sweeps = room_sweeps(count=60)
    write_log(tmp_path / "run.mcap", [sweeps])
    assert lidarcli("-q", "track", str(tmp_path / "run.mcap"), "-o", str(tmp_path)).code == 0
    write_log(tmp_path / "short.mcap", [sweeps.rows(slice(0, 40))])
    out = tmp_path / "o.mcap"
    ran = lidarcli(
        "overlay", str(tmp_path / "short.mcap"), "-o", str(out), "--objects", str(tmp_path / "run.objects.parquet"), code=3
    )
    assert "20 sweeps of the tables are not in the log" in ran.err
    assert len(read_back(out, OBJECTS)) == 40


@pytest.mark.parametrize(
    ("told", "code", "says"),
    [
        (("-o", "o.txt"), 2, "the suffix of an overlay has to be one of .mcap, .bag, .rrd"),
        (("-o", "o.mcap", "--objects", "none.objects.parquet"), 3, "no such file"),
        (("-o", "o.mcap", "--map", "none.yaml"), 3, "none.yaml"),
        (("-o", "o.mcap", "--topic", "/none"), 4, "/none"),
        (("-o", "o.mcap", "--objects", "x.objects.parquet", "--max-width", "3"), 2, "--max-width"),
    ],
)
def test_what_cannot_be_is_refused(
    lidarcli: Run, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: tuple[str, ...], code: int, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = lidarcli("overlay", str(logs / "run.mcap"), *told, code=code)
    assert says in ran.err
    assert not list(tmp_path.iterdir())


def test_no_file_is_replaced_unasked(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    log = str(logs / "run.mcap")
    assert lidarcli("-q", "overlay", log, "-o", str(tmp_path / "o.mcap")).code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"o.mcap", "o.layout.json", "o.rviz"}
    (tmp_path / "o.mcap").unlink()
    ran = lidarcli("overlay", log, "-o", str(tmp_path / "o.mcap"), code=5)
    assert "o.layout.json exists" in ran.err
    assert lidarcli("-q", "overlay", log, "-o", str(tmp_path / "o.mcap"), "--no-layout").code == 0
    assert lidarcli("overlay", log, "-o", log, "--overwrite").code == 5
    assert lidarcli("-q", "overlay", log, "-o", str(tmp_path / "o.mcap"), "--overwrite").code == 0


def test_a_topic_of_two_frames_is_drawn_in_both(lidarcli: Run, tmp_path: Path) -> None:
    sweeps = replace(room_sweeps(count=50), frame_ids=("left", "right"), frame=(np.arange(50) % 2).astype(np.int32))
    write_log(tmp_path / "run.mcap", [sweeps])
    out = tmp_path / "o.mcap"
    assert lidarcli("-q", "overlay", str(tmp_path / "run.mcap"), "-o", str(out)).code == 0
    with out.open("rb") as file:
        times = [message.log_time for *_, message in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sweeps.record_ns.tolist()
    assert lidarcli("-q", "track", str(tmp_path / "run.mcap"), "-o", str(tmp_path)).code == 0
    objects = pq.read_table(tmp_path / "run.objects.parquet", columns=["sweep", "frame_id"]).to_pylist()
    counts = Counter((row["sweep"], row["frame_id"]) for row in objects)
    found = Counter(
        (number, marker.header.frame_id)
        for number, each in enumerate(read_back(out, OBJECTS))
        for marker in each.message.markers
        if marker.ns == "body"
    )
    assert found == counts
    assert {frame for _, frame in found} == {"left", "right"}


@pytest.mark.usefixtures("nothing_left_behind")
@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_a_full_disk_is_told_and_leaves_nothing(
    lidarcli: Run, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(viewers.McapFile, "write", full)
    monkeypatch.setattr(viewers.BagFile, "write", full)
    out = tmp_path / "out"
    ran = lidarcli("overlay", str(logs / "run.mcap"), "-o", str(out / f"o{suffix}"), code=5)
    assert f"cannot write {out / f'o{suffix}'}: No space left on device" in ran.err
    assert not list(out.iterdir())


@needs_real_logs
@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
@pytest.mark.parametrize(
    ("name", "frame"), [("datmo/parallel.bag", "map"), ("ros2_selfdriving/full_bag_nav/full_bag_nav_0.db3", "base_scan")]
)
def test_real_logs(lidarcli: Run, tmp_path: Path, name: str, frame: str, suffix: str) -> None:
    log, out = REAL_LOGS / name, tmp_path / f"o{suffix}"
    assert lidarcli("-q", "overlay", str(log), "-o", str(out), "--with-log").code == 0
    sweeps = sweeps_of(log)
    found = [each for each in read_back(out) if each.type == MARKERS]
    assert sorted(each.record_ns for each in found) == sorted(record for _, record, _, _ in sweeps)
    assert sorted(stamp_ns(each.message.markers[0]) for each in found) == sorted(stamp for _, _, stamp, _ in sweeps)
    layout = json.loads((tmp_path / "o.layout.json").read_text())
    assert layout["configById"]["3D!lidarcli"]["followTf"] == frame
